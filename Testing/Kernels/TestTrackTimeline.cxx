// Breaks when snapshots come at wrong times or in the wrong order, or when one is lost without being named.
#include "TrackTimeline.h"

#include <cmath>
#include <gtest/gtest.h>

using namespace rimflow;
using Source = TrackTimeline::Source;

namespace {
const double none = std::nan("");
using Times = std::vector<double>;
using Order = std::vector<std::size_t>;
} // namespace

TEST(TrackTimeline, NumbersInTitlesAndFileNames) {
  EXPECT_EQ(numberAtEnd("Snapshot 0012"), 12);
  EXPECT_EQ(numberAtEnd("1200 "), 1200);
  EXPECT_EQ(numberAtEnd("t = 0.012"), -1);
  EXPECT_EQ(numberAtEnd("tracks"), -1);
  EXPECT_EQ(numberAtEnd("99999999999999999999999"), -1);
  EXPECT_EQ(numberOfFile("/run7/B00003.dat"), 3);
  EXPECT_EQ(numberOfFile("run7/B00003.dat.gz"), 3);
  EXPECT_EQ(numberOfFile("tracks.0012.dat"), 12);
  EXPECT_EQ(numberOfFile("/run7/tracks.dat"), -1);
  EXPECT_TRUE(naturallyBefore("B2.dat", "B10.dat"));
  EXPECT_FALSE(naturallyBefore("B10.dat", "B2.dat"));
  EXPECT_TRUE(naturallyBefore("B00009.dat", "B00010.dat"));
  EXPECT_TRUE(naturallyBefore("a", "b"));
  EXPECT_FALSE(naturallyBefore("a1", "a1"));
}

TEST(TrackTimeline, TheFilesTimesAreKeptAndSorted) {
  const auto t = arrangeTimes({{43.2, 5, -1, 0}, {43.1, 6, -1, 0}, {43.3, 7, -1, 0}}, {0.5, 0, false});
  EXPECT_EQ(t.times, (Times{43.1, 43.2, 43.3}));
  EXPECT_EQ(t.entries, (Order{1, 0, 2}));
  EXPECT_EQ(t.source, Source::File);
  EXPECT_EQ(t.withoutTime, 0u);
  EXPECT_FALSE(t.framePeriodMissing);
}

TEST(TrackTimeline, ShiftToZeroThenShift) {
  const auto t = arrangeTimes({{43.25, -1, -1, 0}, {43.5, -1, -1, 0}}, {0, 2, true});
  EXPECT_EQ(t.times, (Times{2.0, 2.25}));
  EXPECT_EQ(arrangeTimes({{43.25, -1, -1, 0}}, {0, -43, false}).times, Times{0.25});
}

TEST(TrackTimeline, FallsBackToTitleThenFileThenOrder) {
  const auto title = arrangeTimes({{none, 100, 1, 0}, {none, 102, 2, 1}}, {0.01, 0, false});
  EXPECT_EQ(title.times, (Times{1.0, 1.02}));
  EXPECT_EQ(title.source, Source::TitleNumber);
  const auto file = arrangeTimes({{none, 0, 4, 0}, {none, 0, 8, 1}}, {0.5, 0, false});
  EXPECT_EQ(file.times, (Times{2, 4}));
  EXPECT_EQ(file.source, Source::FileNumber);
  // Two snapshots in one file: its number cannot tell them apart.
  const auto order = arrangeTimes({{none, -1, 4, 0}, {none, -1, 4, 0}, {none, -1, 5, 1}}, {0, 0, false});
  EXPECT_EQ(order.times, (Times{0, 1, 2}));
  EXPECT_EQ(order.source, Source::Order);
  EXPECT_TRUE(order.framePeriodMissing);
}

TEST(TrackTimeline, EqualTimesEverywhereAreNotTimes) {
  const auto t = arrangeTimes({{0, 3, -1, 0}, {0, 4, -1, 0}}, {0.25, 0, false});
  EXPECT_TRUE(t.allTimesEqual);
  EXPECT_EQ(t.times, (Times{0.75, 1.0}));
  EXPECT_FALSE(arrangeTimes({{7, 3, -1, 0}}, {}).allTimesEqual);
}

TEST(TrackTimeline, SnapshotsWithoutTimeAreFittedIn) {
  const auto t = arrangeTimes(
      {{none, 0, -1, 0}, {10, 1, -1, 0}, {none, 2, -1, 0}, {14, 5, -1, 0}, {none, 6, -1, 0}}, {});
  EXPECT_EQ(t.times, (Times{9, 10, 11, 14, 15}));
  EXPECT_EQ(t.source, Source::PartlyFile);
  EXPECT_EQ(t.withoutTime, 3u);
  // Outside of the known times a given frame period rules.
  EXPECT_EQ(arrangeTimes({{10, 1, -1, 0}, {11, 2, -1, 0}, {none, 3, -1, 0}}, {0.5, 0, false}).times,
            (Times{10, 11, 11.5}));
  EXPECT_EQ(arrangeTimes({{10, 1, -1, 0}, {none, 3, -1, 0}}, {0.5, 0, false}).times, (Times{10, 11}));
}

TEST(TrackTimeline, OfEqualTimesTheLaterGivenIsKeptAndNamed) {
  const auto t = arrangeTimes({{1, -1, -1, 0}, {2, -1, -1, 0}, {1, -1, -1, 1}, {1, -1, -1, 2}}, {});
  EXPECT_EQ(t.times, (Times{1, 2}));
  EXPECT_EQ(t.entries, (Order{3, 1}));
  EXPECT_EQ(t.replaced, (Order{0, 2}));
  EXPECT_EQ(t.replacedBy, (Order{2, 3}));
}

TEST(TrackTimeline, NothingGivesNothing) { EXPECT_TRUE(arrangeTimes({}, {}).times.empty()); }
