// Breaks when a series gives velocities that are not those of the tracks, loses what the file itself says,
// shows snapshots outside the time range, tells wrong spans of tracks, holds a whole recording for its
// pathlines, or fails as a whole where one snapshot is damaged.
#include "TrackFiles.h"
#include "TrackSeries.h"

#include <algorithm>
#include <cmath>
#include <gtest/gtest.h>

using namespace rimflow;
using namespace testing_tracks;

namespace {

constexpr double Period = 0.002;

// Track `id` at frame k: a parabola in time (mm).
double place(int axis, long id, double t) {
  return 0.1 * double(id) + (axis + 1) * 30 * t + (axis - 1) * 4000 * t * t;
}
double speed(int axis, double t) { return 1e-3 * ((axis + 1) * 30 + (axis - 1) * 8000 * t); }
double acceleration(int axis) { return 1e-3 * (axis - 1) * 8000; }

// Tracks 0 to 19 over 40 frames; track 7 is in frames 10 to 14 only, track 8 in 20 alone, 9 not in 25.
bool isThere(long id, int k) {
  return id == 7 ? k >= 10 && k <= 14 : id == 8 ? k == 20 : id == 9 ? k != 25 : true;
}
std::string openLPT() {
  std::string text = "TrackID,FrameID,WorldX,WorldY,WorldZ\n";
  for (long id = 0; id < 20; ++id)
    for (int k = 0; k < 40; ++k) {
      if (!isThere(id, k)) continue;
      text += std::to_string(id) + "," + std::to_string(k);
      for (int a = 0; a < 3; ++a) text += "," + print("%.9g", place(a, id, k * Period));
      text += "\n";
    }
  return text;
}
// The same as Tecplot zones, with velocities that are 1 m/s too large, and no accelerations.
std::string tecplot(int damaged = -1, int notFinite = -1) {
  std::string text =
      "VARIABLES = \"x[mm]\" \"y[mm]\" \"z[mm]\" \"Vx[m/s]\" \"Vy[m/s]\" \"Vz[m/s]\" \"trackID\"\n";
  for (int k = 0; k < 40; ++k) {
    text += "ZONE T=\"Snapshot " + std::to_string(k) + "\" SOLUTIONTIME=" + print("%.6f", k * Period) + "\n";
    for (long id = 0; id < 20; ++id) {
      if (!isThere(id, k)) continue;
      for (int a = 0; a < 3; ++a)
        text += (k == notFinite && id == 3 && a == 0 ? "nan" : print("%.9g", place(a, id, k * Period))) + " ";
      for (int a = 0; a < 3; ++a) text += print("%.9g", speed(a, k * Period) + 1) + " ";
      text += (k == damaged && id == 5 ? "x" : std::to_string(id)) + "\n";
    }
  }
  return text;
}

struct Opened {
  Folder folder;
  TrackSeries series;
  TrackSeries::Settings settings;
  explicit Opened(const std::string& text) {
    settings.units.framePeriod = settings.time.framePeriod = Period;
    series.open({folder.write("tracks", text)});
    series.use(settings);
  }
  TrackSeries& with(const std::function<void(TrackSeries::Settings&)>& change) {
    change(settings);
    series.use(settings);
    return series;
  }
};

void expectMotion(const TrackSnapshot& s, int k, double extraSpeed = 0) {
  ASSERT_EQ(s.velocity.size(), s.position.size());
  ASSERT_EQ(s.acceleration.size(), s.position.size());
  for (std::size_t p = 0; p < s.size(); ++p)
    for (int a = 0; a < 3; ++a) {
      if (s.trackId[p] == 8) continue; // a single point
      EXPECT_NEAR(s.velocity[3 * p + a], speed(a, k * Period) + extraSpeed, 1e-4) << s.trackId[p];
      EXPECT_NEAR(s.acceleration[3 * p + a], acceleration(a), 0.1) << s.trackId[p];
    }
}

} // namespace

TEST(TrackSeries, VelocitiesFromPositionsWhereTheFileHasNone) {
  Opened o(openLPT());
  for (int k : {0, 20, 39, 12, 10, 25, 26}) {
    const auto s = o.series.particles(std::size_t(k));
    EXPECT_EQ(s->size(), k >= 10 && k <= 14 ? 19u : k == 20 ? 19u : k == 25 ? 17u : 18u);
    expectMotion(*s, k);
    EXPECT_TRUE(o.series.columns(std::size_t(k)).hasVelocity);
    for (std::size_t p = 0; p < s->size(); ++p) {
      if (s->trackId[p] == 8) {
        EXPECT_TRUE(std::isnan(s->velocity[3 * p]) && std::isnan(s->acceleration[3 * p]));
      }
    }
  }
  TrackSeries& bare = o.with([](auto& s) { s.estimate = TrackSeries::Estimate::Never; });
  EXPECT_TRUE(bare.particles(12)->velocity.empty());
  EXPECT_FALSE(bare.columns(12).hasVelocity);
}

TEST(TrackSeries, WhatTheFileHasIsKept) {
  Opened o(tecplot());
  expectMotion(*o.series.particles(30), 30, 1); // the file's velocities, and accelerations from them
  TrackSeries& all = o.with([](auto& s) { s.estimate = TrackSeries::Estimate::Always; });
  expectMotion(*all.particles(30), 30); // from the positions, after the other one was in the cache
  TrackSeries& none = o.with([](auto& s) { s.estimate = TrackSeries::Estimate::Never; });
  EXPECT_TRUE(none.particles(30)->acceleration.empty());
  EXPECT_FALSE(none.particles(30)->velocity.empty());
}

TEST(TrackSeries, OnlySnapshotsInTheTimeRange) {
  Opened o(openLPT());
  TrackSeries& s = o.with([](auto& x) { x.timeRange = {9.9 * Period, 20 * Period}; });
  EXPECT_EQ(s.first(), 10u);
  EXPECT_EQ(s.last(), 20u);
  EXPECT_EQ(s.nearest(-1), 10u);
  EXPECT_EQ(s.nearest(1), 20u);
  EXPECT_EQ(s.nearest(13.4 * Period), 13u);
  expectMotion(*s.particles(10), 10); // neighbours outside the range are used
  for (const std::array<double, 2> empty :
       {std::array{10.1 * Period, 10.9 * Period}, std::array{1., 2.}, std::array{3., -3.}})
    try {
      o.with([&](auto& x) { x.timeRange = empty; });
      FAIL();
    } catch (const std::runtime_error& e) {
      EXPECT_NE(std::string(e.what()).find("0.078"), std::string::npos) << e.what();
      EXPECT_NE(std::string(e.what()).find("TimeRange"), std::string::npos);
    }
}

TEST(TrackSeries, SpansOfTracks) {
  for (const std::string& text : {openLPT(), tecplot()}) {
    Opened o(text);
    const TrackStatistics& tracks = o.series.statistics();
    EXPECT_EQ(tracks.of(7).length, 5);
    EXPECT_EQ(tracks.of(7).first, 10);
    EXPECT_EQ(tracks.of(7).last, 14);
    EXPECT_EQ(tracks.of(9).length, 39);
    TrackSnapshot s = *o.series.particles(13);
    o.series.addStatistics(s, {o.series.times()[13]});
    ASSERT_EQ(s.further.size(), 4u);
    const std::size_t p = std::size_t(std::find(s.trackId.begin(), s.trackId.end(), 7) - s.trackId.begin());
    EXPECT_EQ(s.further[0].name, "TrackLength");
    EXPECT_EQ(s.further[0].values[p], 5);
    EXPECT_NEAR(s.further[1].values[p], 10 * Period, 1e-12); // start
    EXPECT_NEAR(s.further[2].values[p], 14 * Period, 1e-12); // end
    EXPECT_NEAR(s.further[3].values[p], 3 * Period, 1e-12);  // age
  }
}

TEST(TrackSeries, PathlinesAreTheSameWithAndWithoutMemory) {
  Opened o(tecplot());
  const Pathlines held = o.series.pathlines(0, 39, {});
  const Pathlines streamed = o.with([](auto& s) { s.cacheBytes = 0; }).pathlines(0, 39, {});
  EXPECT_EQ(held.offsets, streamed.offsets);
  EXPECT_EQ(held.time, streamed.time);
  EXPECT_EQ(held.points.position, streamed.points.position);
  EXPECT_EQ(held.points.velocity, streamed.points.velocity);
  EXPECT_EQ(held.points.acceleration.size(), held.points.velocity.size()); // the estimated ones too
  EXPECT_EQ(held.trackId.size(), 21u);                                     // track 9 is two lines
  TrackSelection stride;
  stride.stride = 10;
  EXPECT_EQ(o.series.pathlines(0, 39, stride).trackId, (std::vector<std::int64_t>{0, 10}));
}

// A particle that is not finite has an id in the file, but is left out when the snapshot is read.
TEST(TrackSeries, PathlinesBreakWhereAParticleIsLeftOut) {
  Opened o(tecplot(-1, 30));
  for (const std::size_t cache : {std::size_t(1) << 28, std::size_t(0)}) {
    const Pathlines lines = o.with([&](auto& s) { s.cacheBytes = cache; }).pathlines(0, 39, {});
    EXPECT_EQ(std::count(lines.trackId.begin(), lines.trackId.end(), 3), 2);
    for (std::size_t l = 0; l + 1 < lines.offsets.size(); ++l)
      for (auto p = lines.offsets[l]; p < lines.offsets[l + 1]; ++p) {
        EXPECT_EQ(lines.points.trackId[std::size_t(p)], lines.trackId[l]);
        EXPECT_NEAR(lines.points.position[std::size_t(3 * p)],
                    1e-3 * place(0, lines.trackId[l], lines.time[std::size_t(p)]), 1e-7);
      }
  }
}

// Found by fuzzing: some of the files have no column trackID.
TEST(TrackSeries, PathlinesPassOverSnapshotsWithoutIds) {
  Opened o("VARIABLES = \"x\" \"y\" \"z\" \"trackID\"\nZONE SOLUTIONTIME=0\n1 2 3 4\n5 6 7 8\n"
           "VARIABLES = \"x\" \"y\" \"z\"\nZONE SOLUTIONTIME=1\n1 2 3\n"
           "VARIABLES = \"x\" \"y\" \"z\" \"trackID\"\nZONE SOLUTIONTIME=2\n1 2 3 4\n");
  for (const std::size_t cache : {std::size_t(1) << 28, std::size_t(0)}) {
    const Pathlines lines = o.with([&](auto& s) { s.cacheBytes = cache; }).pathlines(0, 2, {});
    EXPECT_EQ(lines.trackId, (std::vector<std::int64_t>{4, 8, 4}));
    EXPECT_EQ(lines.points.size(), 3u);
  }
}

TEST(TrackSeries, ADamagedSnapshotCountsAsAbsentForItsNeighbours) {
  Opened o(tecplot(22));
  EXPECT_THROW(o.series.particles(22), std::runtime_error);
  expectMotion(*o.series.particles(21), 21, 1);
  const std::vector<std::string> warnings = o.series.takeWarnings();
  ASSERT_EQ(warnings.size(), 1u);
  EXPECT_NE(warnings[0].find("line"), std::string::npos);
  EXPECT_NE(warnings[0].find("absent"), std::string::npos);
  EXPECT_EQ(o.series.statistics().of(0).length, 39);
  EXPECT_EQ(o.series.pathlines(0, 39, {}).trackId.size(), 39u); // 18 tracks are broken there, 9 at 25 too
  EXPECT_TRUE(o.series.takeWarnings().empty());                 // said once
}

TEST(TrackSeries, AbortLeavesItUsable) {
  Opened o(tecplot());
  const Progress stop = [](double) { return false; };
  EXPECT_THROW(o.series.particles(5, stop), TrackReadAborted);
  EXPECT_THROW(o.series.statistics(stop), TrackReadAborted);
  EXPECT_THROW(o.series.pathlines(0, 39, {}, stop), TrackReadAborted);
  expectMotion(*o.series.particles(5), 5, 1);
  EXPECT_EQ(o.series.statistics().of(7).length, 5);
}
