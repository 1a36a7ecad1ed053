// Breaks when a file of any track format but Tecplot's gives other particles, ids, times or units than it
// holds, when it is taken for another format, or when a damaged one is read wrongly or fails without naming
// file, line and remedy.
#include "FrameTracks.h"
#include "MyPTVTracks.h"
#include "OpenLPTTracks.h"
#include "TableTracks.h"
#include "TrackFormat.h"
#include "TrackReading.h"

#include <algorithm>
#include <cmath>
#include <gtest/gtest.h>
#include <map>
#include <omp.h>
#include <random>
#include <set>

using namespace rimflow;
using namespace testing_tracks;
using Ids = std::vector<std::int64_t>;

namespace {

std::vector<float> floats(std::initializer_list<double> values) {
  std::vector<float> f;
  for (double v : values) f.push_back(float(v));
  return f;
}
void expectNear(const std::vector<float>& found, std::initializer_list<double> values) {
  const std::vector<float> expected = floats(values);
  ASSERT_EQ(found.size(), expected.size());
  for (std::size_t i = 0; i < found.size(); ++i)
    EXPECT_NEAR(found[i], expected[i], 3e-7 * std::abs(expected[i])) << i;
}

const std::string openLPTHeader = "TrackID,FrameID,WorldX,WorldY,WorldZ,cam0_x(col),cam0_y(row),R3D\n";
std::string openLPTRow(long id, long frame, double x) {
  return std::to_string(id) + "," + std::to_string(frame) + "," + print("%.6f", x) + "," + print("%.6f", -x) +
         "," + print("%.6f", 2 * x) + ",504.5,505.25,0.01\n";
}

} // namespace

TEST(OpenLPT, RowsTrackByTrackBecomeSnapshots) {
  Folder folder;
  const std::string file = folder.write("LongTrackActive_3.txt",
                                        openLPTHeader + openLPTRow(0, 4, 1) + openLPTRow(0, 5, 2) +
                                            openLPTRow(7, 3, 3) + openLPTRow(7, 4, 4) + openLPTRow(2, 5, 5));
  EXPECT_TRUE(looksLikeTracks(file));
  Series series({file});
  EXPECT_EQ(series.line.times, (std::vector<double>{1.5, 2, 2.5}));
  EXPECT_EQ(series.read(0).trackId, (Ids{7}));
  const TrackSnapshot s = series.read(1);
  EXPECT_EQ(s.trackId, (Ids{0, 7}));
  expectNear(s.position, {1e-3, -1e-3, 2e-3, 4e-3, -4e-3, 8e-3});
  EXPECT_TRUE(s.velocity.empty() && s.acceleration.empty() && s.intensity.empty());
  ASSERT_EQ(s.further.size(), 1u); // the cameras are left out
  EXPECT_EQ(s.further[0].name, "R3D");
  EXPECT_EQ(s.further[0].values, (std::vector<double>{0.01, 0.01}));
  EXPECT_EQ(series.read(2).trackId, (Ids{0, 2}));
  expectNear(series.read(0, {LengthUnit::Metre, 0}).position, {3, -3, 6});
  EXPECT_EQ(series.warnings, Strings());
  EXPECT_TRUE(series.tracks->isOpen({file}));
  Series unknownPeriod({file}, {});
  EXPECT_EQ(unknownPeriod.line.times, (std::vector<double>{3, 4, 5}));
  ASSERT_EQ(unknownPeriod.warnings.size(), 1u);
  expectParts(unknownPeriod.warnings[0], {"LongTrackActive_3.txt", "frame number times 1 s", "FramePeriod"});
}

TEST(OpenLPT, FilesOfARunHaveDisjointIds) {
  Folder folder;
  const std::string a =
      folder.write("ExitTrack_9.csv", openLPTHeader + openLPTRow(0, 1, 1) + openLPTRow(3, 1, 2));
  const std::string b =
      folder.write("LongTrackActive_9.csv", openLPTHeader + openLPTRow(0, 1, 3) + openLPTRow(1, 2, 4));
  const std::string c = folder.write("ShortTrackActive_9.csv", openLPTHeader + openLPTRow(0, 2, 5));
  Series series({c, a, b});
  EXPECT_EQ(series.read(0).trackId, (Ids{0, 3, 4}));
  EXPECT_EQ(series.read(1).trackId, (Ids{5, 6}));
  EXPECT_EQ(series.warnings, Strings());
}

TEST(OpenLPT, AFileOfARunMayBeEmpty) {
  Folder folder;
  const std::string empty = folder.write("ExitTrack_9.csv", openLPTHeader);
  const std::string b = folder.write("LongTrackActive_9.csv", openLPTHeader + openLPTRow(0, 1, 3));
  Series series({empty, b});
  EXPECT_EQ(series.read(0).trackId, (Ids{0}));
  ASSERT_EQ(series.warnings.size(), 1u);
  expectParts(series.warnings[0], {"ExitTrack_9.csv, line 1: there is no row of numbers", "Export"});
  expectParts(errorOf({empty}), {"ExitTrack_9.csv, line 1: there is no row of numbers", "Export"});
}

TEST(OpenLPT, OneLineOfTuples) {
  Folder folder;
  const std::string tuples = "0,10,1.5,2.5,3.5,0,11,4,5,6.25,1,11,7,8,9,";
  for (const std::string& text :
       {tuples, tuples + "\n", std::string("0,10,1.5,2.5,3.5\n0,11,4,5,6.25\r\n1,11,7,8,9")}) {
    Series series({folder.write("ActiveLongTracks.txt", text)});
    EXPECT_EQ(series.line.times, (std::vector<double>{5, 5.5})) << text;
    expectNear(series.read(0).position, {1.5e-3, 2.5e-3, 3.5e-3});
    EXPECT_EQ(series.read(1).trackId, (Ids{0, 1}));
    expectNear(series.read(1).position, {4e-3, 5e-3, 6.25e-3, 7e-3, 8e-3, 9e-3});
    EXPECT_EQ(series.warnings, Strings());
  }
}

// Also from many small blocks, from disk, and with any number of threads.
TEST(OpenLPT, ManyBlocksEqualOne) {
  Folder folder;
  std::mt19937 random(3);
  std::string lines = openLPTHeader, oneLine;
  std::map<long, std::vector<std::pair<long, float>>> expected;
  long rows = 0;
  for (long id = 0; id < 700; ++id) {
    const long first = long(random() % 30), last = first + long(random() % 30);
    for (long frame = first; frame <= last; ++frame, ++rows) {
      const double x = 0.001 * double(random() % 1000000);
      lines += openLPTRow(id, frame, x);
      oneLine += std::to_string(id) + "," + std::to_string(frame) + "," + print("%.6f", x) + "," +
                 print("%.6f", -x) + "," + print("%.6f", 2 * x) + ",";
      expected[frame].push_back({id, float(float(std::stod(print("%.6f", x))) * 1e-3)});
    }
  }
  const int threads = omp_get_max_threads();
  for (const bool line : {false, true})
    for (const std::size_t block : {std::size_t(1000), std::size_t(70000), std::size_t(16) << 20})
      for (const std::size_t memory : {std::size_t(0), std::size_t(50000), std::size_t(1) << 30}) {
        omp_set_num_threads(block == 70000 ? 3 : 1);
        FrameTracks tracks(line ? openLPTLineFormat() : openLPTFormat(), {block, memory});
        ASSERT_TRUE(tracks.open({folder.write("t.csv", line ? oneLine : lines)}));
        if (memory == 0) {
          // Three floats and an id, and R3D.
          EXPECT_EQ(tracks.bytesOnDisk(), (line ? 20 : 28) * std::size_t(rows));
        }
        EXPECT_EQ(tracks.bytesOnDisk() > 0, memory < (1 << 20));
        Strings warnings;
        const TrackTimeline timeline = tracks.timeline({1, 0, false}, warnings);
        ASSERT_EQ(timeline.times.size(), expected.size());
        for (std::size_t k = 0; k < timeline.times.size(); ++k) {
          TrackSnapshot s;
          ASSERT_TRUE(tracks.read(timeline.entries[k], {}, s, warnings));
          TrackSnapshot ids;
          ASSERT_TRUE(tracks.read(timeline.entries[k], {}, ids, warnings, {}, TrackFile::Content::TrackIds));
          ASSERT_EQ(ids.trackId, s.trackId);
          const auto& particles = expected[long(timeline.times[k])];
          ASSERT_EQ(s.size(), particles.size());
          for (std::size_t p = 0; p < particles.size(); ++p) {
            ASSERT_EQ(s.trackId[p], particles[p].first);
            ASSERT_EQ(s.position[3 * p], particles[p].second);
          }
        }
        EXPECT_EQ(warnings, Strings());
      }
  omp_set_num_threads(threads);
}

TEST(MyPTV, SmoothedTrajectoriesArePerFrame) {
  Folder folder;
  const std::string file = folder.write(
      "smoothed_trajectories", "1\t10.5\t20.25\t-30.5\t0.25\t-0.5\t1.0\t0.125\t-0.25\t0.5\t2.000\n"
                               "-1\t1.0\t2.0\t3.0\t0.0\t0.0\t0.0\t0.0\t0.0\t0.0\t2.000\n"
                               "1\t10.75\t19.75\t-29.5\t0.25\t-0.5\t1.0\t0.125\t-0.25\t0.5\t3.000\n");
  Series series({file}, {0.01, 0, false});
  ASSERT_EQ(series.line.times, (std::vector<double>{0.02, 0.03}));
  const TrackSnapshot s = series.read(0, {LengthUnit::Auto, 0.01});
  EXPECT_EQ(s.trackId, (Ids{1, -1}));
  expectNear(s.position, {10.5e-3, 20.25e-3, -30.5e-3, 1e-3, 2e-3, 3e-3});
  expectNear({s.velocity.begin(), s.velocity.begin() + 3}, {0.025, -0.05, 0.1});
  expectNear({s.acceleration.begin(), s.acceleration.begin() + 3}, {1.25, -2.5, 5});
  for (std::size_t c = 3; c < 6; ++c) EXPECT_TRUE(std::isnan(s.velocity[c]) && std::isnan(s.acceleration[c]));
  expectNear({series.read(0, {LengthUnit::Metre, 0.01}).velocity[0]}, {25});
  EXPECT_EQ(series.tracks->columns(0, LengthUnit::Auto).velocityUnit, "mm/frame");
  EXPECT_EQ(series.warnings, Strings());
  expectParts(errorOf({file}, 0), {"smoothed_trajectories, line 1: ", "per frame", "Set FramePeriod"});
}

TEST(MyPTV, RawTablesHaveAnyNumberOfCameras) {
  Folder folder;
  Series five(
      {folder.write("a", "0\t53.5\t31.25\t-1.5\t0.000\n1\t42\t1.5\t2\t0.000\n0\t53.75\t31\t-1\t1.000\n\n")});
  EXPECT_EQ(five.read(0).trackId, (Ids{0, 1}));
  expectNear(five.read(1).position, {53.75e-3, 31e-3, -1e-3});
  EXPECT_TRUE(five.read(0).velocity.empty());
  // Five cameras make eleven columns, as many as in smoothed_trajectories.
  Series eleven(
      {folder.write(
          "b",
          "4\t1.5\t2.5\t3.5\t49\t36\t43\t-1\t2\t0.02\t6.000\r\n-1\t1\t2\t3\t4\t5\t6\t7\t8\t0.03\t6.000\r\n")},
      {});
  const TrackSnapshot s = eleven.read(0, {});
  EXPECT_EQ(s.trackId, (Ids{4, -1}));
  EXPECT_TRUE(s.velocity.empty() && s.further.empty());
  EXPECT_EQ(eleven.line.times, (std::vector<double>{6}));
  Series particles({folder.write(
      "particles", "6.5\t17.5\t-3.75\t49\t36\t43\t0.02\t0.000\n3.5\t5\t4.5\t8\t9\t6\t0.016\t1.000\n")});
  expectNear(particles.read(0).position, {6.5e-3, 17.5e-3, -3.75e-3});
  EXPECT_TRUE(particles.read(0).trackId.empty());
  ASSERT_FALSE(particles.warnings.empty());
  expectParts(particles.warnings[0], {"particles: ", "no tracks", "open trajectories"});
  EXPECT_EQ(five.warnings, Strings());
}

TEST(OpenPTV, TracksAreChainedOverTheFiles) {
  Folder folder;
  const std::string a =
      folder.write("ptv_is.9", "3\n  -1    1   1.5   2.5  -3.5\n  -1   -2   4  5  6\n  -1  0  7 8 9\n");
  const std::string b =
      folder.write("ptv_is.10", "3\n   2   -2   7.5 8 9\n   0    0  1.75 2.5 -3.5\n  -1 -2 10 11 12\n");
  const std::string c = folder.write("ptv_is.11", "1\n   1   -2   2 2.5 -3.5\n");
  Series series({c, a, b});
  EXPECT_EQ(series.line.times, (std::vector<double>{4.5, 5, 5.5}));
  EXPECT_EQ(series.read(0).trackId, (Ids{0, 1, 2}));
  EXPECT_EQ(series.read(1).trackId, (Ids{2, 0, 3}));
  EXPECT_EQ(series.read(2).trackId, (Ids{0}));
  expectNear(series.read(2).position, {2e-3, 2.5e-3, -3.5e-3});
  EXPECT_EQ(series.warnings, Strings());

  Series gap({a, c});
  EXPECT_EQ(gap.read(1).trackId, (Ids{3}));
  ASSERT_EQ(gap.warnings.size(), 1u);
  expectParts(gap.warnings[0],
              {"ptv_is.11, line 1: the frame before 11 is not among the files", "Open all frames"});
  const std::string empty = folder.write("ptv_is.12", "0\n");
  Series withEmpty({c, empty});
  EXPECT_EQ(withEmpty.read(1).size(), 0u);
}

TEST(OpenPTV, DamagedLinksAndCounts) {
  Folder folder;
  const std::string a = folder.write("ptv_is.1", "2\n -1 0 1 2 3\n -1 -2 4 5 6\n");
  const auto next = [&](const std::string& text) { return folder.write("ptv_is.2", text); };
  expectParts(errorOf({a, next("2\n 0 -2 1 2 3\n 5 -2 4 5 6\n")}),
              {"ptv_is.2, line 3: found 5 in column prev", "frame 1 has 2 rows", "export them again"});
  expectParts(errorOf({a, next("2\n 0 -2 1 2 3\n 0.5 -2 4 5 6\n")}),
              {"ptv_is.2, line 3: found 0.5 in column prev"});
  expectParts(errorOf({a, next("2\n 0 -2 1 2 3\n 1 -2 4 5")}),
              {"ptv_is.2, line 3: the file ends in the middle of a row"});
  expectParts(errorOf({a, next("2\n 0 -2 1 2 3\n 1 -2 4 5\n 1 1 1 1 1\n")}),
              {"ptv_is.2, line 3: found 4 values", "Repair"});
  expectParts(errorOf({a, next("2\n 0 -2 1 2x 3\n")}), {"ptv_is.2", "line 1"}); // no row of ptv_is at all
  Series count({a, next("7\n 0 -2 1 2 3\n 1 -2 nan 5 6\n -1 -2 7 8 9\n")});
  ASSERT_EQ(count.warnings.size(), 3u);
  expectParts(count.warnings[0], {"ptv_is.2, line 1: announces 7 rows, but has 3"});
  expectParts(count.warnings[1], {"ptv_is.2, line 1: 1 particles name one of the frame before"});
  expectParts(count.warnings[2], {"ptv_is.2, line 3: 1 of 3 particles left out"});
  EXPECT_EQ(count.read(1).trackId, (Ids{0, 3}));
}

TEST(OpenPTV, PositionsAlone) {
  Folder folder;
  const std::string a =
      folder.write("rt_is.101", "2\n   1   1.5  2.5  3.5   4  5 6 7\n   2  4.5 5.5 6.5 -1 2 3 4\n");
  const std::string b = folder.write("rt_is.102", "0\n"),
                    c = folder.write("rt_is.103", "1\n   1   7.5  2.5  3.5   4  5 6 7\n");
  Series series({a, b, c});
  EXPECT_EQ(series.line.times, (std::vector<double>{50.5, 51, 51.5}));
  expectNear(series.read(0).position, {1.5e-3, 2.5e-3, 3.5e-3, 4.5e-3, 5.5e-3, 6.5e-3});
  EXPECT_EQ(series.read(1).size(), 0u);
  expectNear(series.read(2).position, {7.5e-3, 2.5e-3, 3.5e-3});
  EXPECT_TRUE(series.read(0).trackId.empty());
  expectParts(series.warnings.at(0), {"rt_is.101: ", "no tracks", "ptv_is"});
}

TEST(LPTChallenge, ThreeHeaderLinesWithAndWithoutNames) {
  Folder folder;
  const std::string named = "# DA challenge\n# case 1\n# X Y Z U V W trackID\n",
                    unnamed = "first\nsecond\nthird one\n";
  for (const std::string& head : {named, unnamed}) {
    const std::string a =
        folder.write("part_0007.dat", head + "1.5 2.5 3.5 0.1 0.2 0.3 20000001\n4 5 6 0.4 0.5 0.6 8\n");
    const std::string b = folder.write("part_0012.dat", head + "1.5 2.5 3.5 0.1 0.2 0.3 8\n");
    EXPECT_TRUE(looksLikeTracks(a)) << head;
    Series series({b, a});
    EXPECT_EQ(series.line.times, (std::vector<double>{3.5, 6}));
    const TrackSnapshot s = series.read(0);
    EXPECT_EQ(s.trackId, (Ids{20000001, 8}));
    expectNear(s.position, {1.5e-3, 2.5e-3, 3.5e-3, 4e-3, 5e-3, 6e-3});
    EXPECT_EQ(s.velocity.size(), head == named ? 6u : 0u);
    EXPECT_EQ(series.warnings.size(), head == named ? 0u : 1u);
  }
}

TEST(Table, ColumnsByNameInAnyDialect) {
  Folder folder;
  struct Case {
    const char* text;
    std::vector<double> times;
  };
  const std::vector<Case> cases = {
      {"frame,Track "
       "ID,x[m],y[m],z[m],Vx[mm/s],Vy[mm/s],Vz[mm/s],quality\n2,9,1,2,3,4,5,6,0.5\n1,9,7,8,9,1,1,1,0.25\n",
       {0.5, 1}},
      {"# trackID x [m] y [m] z [m] u[mm/s] v[mm/s] w[mm/s] quality time[ms]\n9 1 2 3 4 5 6 0.5 20\n9 7 8 9 "
       "1 1 1 0.25 10\n",
       {0.01, 0.02}},
      {"\xEF\xBB\xBF\"t\";\"x [m]\";\"y [m]\";\"z [m]\";\"vx [mm/s]\";\"vy [mm/s]\";\"vz "
       "[mm/s]\";\"quality\";\"track_id\"\r\n"
       "-0.25;1;2;3;4;5;6;0.5;9\r\n-1.5;7;8;9;1;1;1;0.25;9\r\n",
       {-1.5, -0.25}},
      {",x[m]\ty[m]\n", {}},
      {"x[m]\ty[m]\tz[m]\tVelocity x[mm/s]\tVelocity y[mm/s]\tVelocity z[mm/s]\tquality\tid\tframe\n"
       "1\t2\t3\t4\t5\t6\t0.5\t9\t20\n7\t8\t9\t1\t1\t1\t0.25\t9\t10\n",
       {5, 10}}};
  for (const Case& c : cases) {
    const std::string file = folder.write("table.csv", c.text);
    EXPECT_EQ(looksLikeTracks(file), !c.times.empty()) << c.text;
    if (c.times.empty()) continue;
    Series series({file});
    EXPECT_EQ(series.line.times, c.times) << c.text;
    const TrackSnapshot s = series.read(1);
    expectNear(s.position, {1, 2, 3});
    expectNear(s.velocity, {4e-3, 5e-3, 6e-3});
    EXPECT_EQ(s.trackId, (Ids{9}));
    ASSERT_EQ(s.further.size(), 1u);
    EXPECT_EQ(s.further[0].name, "quality");
    EXPECT_EQ(s.further[0].values, (std::vector<double>{0.5}));
    EXPECT_EQ(series.warnings.size(), c.times[0] < 0 ? 1u : 0u);
    if (c.times[0] < 0)
      expectParts(series.warnings[0], {"table.csv, time -1.5: this is negative", "ShiftTimeToZero"});
  }
}

TEST(Table, WithoutFrameEveryFileIsASnapshot) {
  Folder folder;
  Series series({folder.write("p12.csv", "id,x,y,z\n1,2,3,4\n"),
                 folder.write("p2.csv", "id,x,y,z\n5,2,3,4\n1,1,1,1\n")});
  EXPECT_EQ(series.line.times, (std::vector<double>{1, 6}));
  EXPECT_EQ(series.read(0).trackId, (Ids{5, 1}));
  EXPECT_EQ(series.read(1).trackId, (Ids{1}));
  expectNear(series.read(1).position, {2e-3, 3e-3, 4e-3});
  EXPECT_FALSE(looksLikeTracks(folder.write("xyz.csv", "x,y,z\n1,2,3\n"))); // any table may have these
}

TEST(Table, ASnapshotMayBeEmpty) {
  Folder folder;
  for (const char* head : {"id,x,y,z\n", "a\nb\nid x y z\n"}) {
    const std::string empty = folder.write("p1.csv", head);
    Series series({empty, folder.write("p2.csv", head + std::string("5,2,3,4\n"))});
    EXPECT_EQ(series.read(0).size(), 0u);
    EXPECT_EQ(series.read(1).trackId, (Ids{5}));
    EXPECT_EQ(series.warnings, Strings());
    expectParts(errorOf({empty}), {"p1.csv, line 1: there is no row of numbers", "Export"});
  }
}

TEST(Table, ColumnsOfTextAreLeftOut) {
  Folder folder;
  Series series(
      {folder.write("t.csv", "label,id,frame,x,y,z,q\nfirst,7,1,2,3,4,0.5\nsecond,8,1,2,3,4,0.25\n")});
  const TrackSnapshot s = series.read(0);
  EXPECT_EQ(s.trackId, (Ids{7, 8}));
  ASSERT_EQ(s.further.size(), 1u);
  EXPECT_EQ(s.further[0].values, (std::vector<double>{0.5, 0.25}));
}

// A particle without its position, velocity, id or frame is left out and counted; what else is missing is
// NaN.
TEST(Table, ValuesMayBeMissingBetweenCommasOrSemicolons) {
  Folder folder;
  const std::string rows = "7,0,1,2,3,4,5,6,0.5,a b\n" // whole
                           "8,0,1,2,3,4,5,6,,\n"       // q and the note are missing
                           "9,0,,2,3,4,5,6,0.5,c\n"    // no position
                           ",0,1,2,3,4,5,6,0.5,c\n"    // no id
                           "11,,1,2,3,4,5,6,0.5,c\n"   // no frame
                           "12,0,1,2,3,4,,6,0.5,c\n"   // no velocity
                           "13, 0 ,1,2,3,4,5,6,None,\"d,e\"\r\n"
                           "14,1,\"1.5\",2,3,4,5,6,N/A,f"; // no line end
  for (const char delimiter : {',', ';'}) {
    std::string text = "id,frame,x,y,z,u,v,w,q,note\n" + rows;
    if (delimiter == ';') std::replace(text.begin(), text.end(), ',', ';');
    Series series({folder.write("t.csv", text)});
    const TrackSnapshot s = series.read(0);
    EXPECT_EQ(s.trackId, (Ids{7, 8, 13})) << text;
    expectNear(s.position, {1e-3, 2e-3, 3e-3, 1e-3, 2e-3, 3e-3, 1e-3, 2e-3, 3e-3});
    ASSERT_EQ(s.further.size(), 1u);
    EXPECT_EQ(s.further[0].name, "q");
    EXPECT_EQ(s.further[0].values[0], 0.5);
    EXPECT_TRUE(std::isnan(s.further[0].values[1]) && std::isnan(s.further[0].values[2]));
    expectNear(series.read(1).position, {1.5e-3, 2e-3, 3e-3});
    ASSERT_EQ(series.warnings.size(), 1u);
    expectParts(series.warnings[0], {"t.csv, line 4: 4 of 8 particles left out", "missing"});
  }
  for (const char* missing : {"", "nan", "NaN", "None", "null", "NA", "N/A", "-"}) {
    const std::string value = missing;
    Series byFile({folder.write("p.csv", "x,y,z,id\n" + value + ",2,3,4\n1,2,3,5\n1,2,3," + value + "\n")});
    EXPECT_EQ(byFile.read(0).trackId, (Ids{5})) << value;
    expectParts(byFile.warnings.at(0), {"p.csv, line 2: 2 of 3 particles left out"});
  }
  // A blank in a text, or a decimal comma, does not stand in for the value that is missing.
  Series text({folder.write("t.csv", "id,note,frame,x,y,z\n1,a 5,0,1,2,3\n2,a 5,,1,2,3\n3,b,0,1,2,3\n")});
  EXPECT_EQ(text.line.times, (std::vector<double>{0}));
  EXPECT_EQ(text.read(0).trackId, (Ids{1, 3}));
  expectParts(errorOf({folder.write("t.csv", "id;frame;x;y;z\n1;0;1;2;3\n1;0;1,5;;3\n")}),
              {"t.csv, line 3: ", "decimal points"});
  // Many of them, so that they are in several chunks.
  std::string many = "frame,id,x,y,z,mass\n";
  for (long i = 0; i < 40000; ++i) many += "1," + std::to_string(i) + (i % 2 ? ",1,2,,5\n" : ",1,2,3,\n");
  Series chunks({folder.write("many.csv", many)});
  EXPECT_EQ(chunks.read(0).size(), 20000u);
  EXPECT_EQ(chunks.read(0).trackId.back(), 39998);
  // Between blanks or tabs nothing tells which value is missing.
  expectParts(errorOf({folder.write("t.txt", "id\tframe\tx\ty\tz\n1\t1\t1\t2\t3\n1\t2\t\t2\t3\n")}),
              {"t.txt, line 3: found 4 values in the row", "expected 5"});
  expectParts(errorOf({folder.write("t.csv", "id,frame,x,y,z\n1,1,1,2,3\n1,2,,2\n")}),
              {"t.csv, line 3: found 3 values in the row", "expected 5"});
}

TEST(Table, TheUnitOfTheTimeIsKnownOrAskedFor) {
  Folder folder;
  EXPECT_EQ(Series({folder.write("t.csv", "t[frame],id,x,y,z\n3,1,1,2,3\n")}).line.times,
            (std::vector<double>{1.5}));
  EXPECT_EQ(Series({folder.write("t.csv", "t [s],id,x,y,z\n3,1,1,2,3\n")}).line.times,
            (std::vector<double>{3}));
  EXPECT_EQ(Series({folder.write("t.csv", "time[h],frame,id,x,y,z\n3,4,1,1,2,3\n")}).line.times,
            (std::vector<double>{2}));
  expectParts(errorOf({folder.write("t.csv", "time[h],id,x,y,z\n3,1,1,2,3\n")}),
              {"t.csv, line 1: the unit of column \"time[h]\" is not known", "[frame]", "Correct"});
}

TEST(Table, UnknownUnitOfTheFileCanBeChosen) {
  Folder folder;
  const std::string file = folder.write("t.csv", "frame,id,x[px],y[px],z[px]\n1,2,3,4,5\n");
  expectParts(errorOf({file}), {"t.csv, line 1: the unit of column \"z[px]\"", "LengthUnit"});
  Series series({file});
  expectNear(series.read(0, {LengthUnit::Centimetre, 1}).position, {0.03, 0.04, 0.05});
}

TEST(TrackFormats, GzipAndWrongExtensionsAreNoMatter) {
  Folder folder;
  Series series({folder.writeGzip("t.dat", openLPTHeader + openLPTRow(4, 1, 1))});
  EXPECT_EQ(series.read(0).trackId, (Ids{4}));
  const Dialect d;
  Series davis({folder.write("davis.csv", d.variables() + d.zone(0, {1, 2}) + d.zone(1, {1}))});
  EXPECT_EQ(davis.line.times.size(), 2u);
}

TEST(TrackFormats, DavisSetFoldersAreRefusedWithAdvice) {
  Folder folder;
  const std::string set = folder.write("run.set", "SetIdentifier = \"ParticleField\";\nVersion = 1;\n");
  std::filesystem::create_directory(folder / "run");
  const std::string bin = folder.write("run/tracks.bin", std::string(100, '\0'));
  for (const std::string& path : {set, bin, folder / "run"}) {
    EXPECT_TRUE(looksLikeTracks(path)); // so that the user gets to read this:
    expectParts(errorOf({path}), {path + ": ", "DaVis' own .set", "export the tracks as Tecplot ASCII"});
  }
}

TEST(TrackFormatsDamage, ErrorsNameFileLineAndRemedy) {
  Folder folder;
  expectParts(errorOf({folder.write("t.csv", "id,frame,x,y,z\n1,1.5,x,3,4\n")}),
              {"t.csv, line 2: found \"x\" in column \"x\""});
  expectParts(errorOf({folder.write("t.csv", "id,frame,x,y,z\n1.5,1,2,3,4\n")}),
              {"t.csv, line 2: found \"1.5\" in column \"id\"", "whole number"});
  expectParts(errorOf({folder.write("t.csv", "id,frame,x,y,z\n1,nan,2,3,4\n")}),
              {"t.csv, line 2: 1 of 1 particles left out", "NaN"});
  expectParts(errorOf({folder.write("t.csv", "id;frame;x;y;z\n1;1;2,5;3,5;4,5\n")}),
              {"t.csv, line 2: ", "decimal points"});
  expectParts(errorOf({folder.write("t.csv", "id,frame,x,y,z\n")}),
              {"t.csv, line 1: there is no row of numbers", "Export"});
  expectParts(errorOf({folder.write("t.csv", "id,frame,x,y\n1,2,3,4\n")}),
              {"t.csv, line 1: found", "expected", "x, y and z"});
  expectParts(errorOf({folder.write("t.txt", "1 2 3 4\n5 6 7 8\n")}),
              {"t.txt, line 1: found \"1 2 3 4\"", "names of the columns"});
  expectParts(errorOf({folder.write("t.txt", "Dear reader,\nthis is a letter.\n")}),
              {"t.txt, line 1: found \"Dear reader,\"", "Export"});
  expectParts(errorOf({folder / "none.csv"}), {"none.csv: cannot be opened: No such file"});
  expectParts(errorOf({}), {"FileNames"});
  // The old OpenLPT text, cut and damaged.
  Series cut({folder.write("o.txt", "0,10,1.5,2.5,3.5,0,11,4,5,")});
  EXPECT_EQ(cut.line.times, (std::vector<double>{5}));
  expectParts(cut.warnings.at(0), {"o.txt, line 1: the file ends in the middle of a row"});
  std::string tuples;
  for (int i = 0; i < 9000; ++i) tuples += "3," + std::to_string(i) + ",1.5,2.5,3.5,";
  expectParts(errorOf({folder.write("o.txt", tuples + "3,x,1.5,2.5,3.5," + tuples)}),
              {"o.txt, line 1: byte " + std::to_string(tuples.size() + 3), "\"x\"", "Repair"});
  // Files that do not go together.
  const std::string csv = folder.write("a.csv", openLPTHeader + openLPTRow(0, 1, 1)),
                    dat = folder.write("b.csv", "id,frame,x,y,z\n1,1,2,3,4\n");
  expectParts(errorOf({csv, dat}),
              {"b.csv, line 1: this is table with a header, but ", "a.csv is OpenLPT", "one format"});
  const std::string more = folder.write("c.csv", "id,frame,x,y,z,q\n1,1,2,3,4,5\n");
  expectParts(errorOf({dat, more}), {"c.csv, line 1: other columns than in ", "b.csv", "one by one"});
  expectParts(errorOf({dat, folder.write("d.csv", "id,x,y,z\n1,2,3,4\n")}), {"d.csv, line 1: other columns"});
}

TEST(TrackFormatsDamage, GiganticLinesTakeNoMemory) {
  Folder folder;
  const auto filled = [&](const std::string& name, const std::string& begin, const std::string& piece) {
    std::ofstream f(folder / name, std::ios::binary);
    f << begin;
    for (int i = 0; i < 24; ++i)
      for (std::size_t n = 0; n < (1 << 20); n += piece.size()) f << piece;
    f.close();
    return folder / name;
  };
  expectParts(errorOf({filled("x.csv", "", std::string(64, 'x'))}),
              {"x.csv, line 1: a line of more than 64 KiB", "Export"});
  expectParts(errorOf({filled("d.csv", "", std::string(64, '1'))}),
              {"d.csv, line 1: a line of more than 64 KiB"});
  expectParts(errorOf({filled("r.csv", "id,frame,x,y,z\n1,2,3,4,5\n", std::string(64, '1'))}),
              {"r.csv, line 3: a line of more than 1 MiB", "export it again"});
  expectParts(errorOf({filled("o.txt", "1,2,3.5,4,5,", std::string(64, '1'))}),
              {"o.txt, line 1: byte 13: a line of more than 1 MiB"});
  expectParts(errorOf({filled(
                  "l.txt",
                  [] {
                    std::string t;
                    for (int i = 0; i < 9000; ++i) t += "1,2,3.5,4,5,";
                    return t;
                  }(),
                  std::string(64, '1'))}),
              {"l.txt, line 1: byte ", "a line of more than 1 MiB"});
  // The head decides: a sparse file of 10 GB is not looked at further.
  const std::string huge = folder.write("huge.csv", std::string(70000, 'y'));
  std::filesystem::resize_file(huge, std::uintmax_t(10) << 30);
  EXPECT_FALSE(looksLikeTracks(huge));
  expectParts(errorOf({huge}), {"huge.csv, line 1: "});
}

TEST(TrackFormats, AbortLeavesNothingAndChangesAreNoticed) {
  Folder folder;
  const Strings texts = {openLPTHeader + openLPTRow(0, 1, 1), "2\n -1 0 1 2 3\n -1 -2 4 5 6\n",
                         "id,x,y,z\n1,2,3,4\n"};
  for (const std::string& text : texts) {
    const std::string file = folder.write("t.1", text);
    const auto tracks = makeTrackFile({file});
    EXPECT_FALSE(tracks->open({file}, [](double) { return false; }));
    EXPECT_EQ(tracks->snapshotCount(), 0u);
    EXPECT_FALSE(tracks->isOpen({file}));
    EXPECT_TRUE(tracks->open({file}));
    TrackSnapshot s;
    Strings warnings;
    EXPECT_FALSE(tracks->read(0, {}, s, warnings, [](double) { return false; }));
    EXPECT_EQ(s.size(), 0u);
    EXPECT_TRUE(tracks->isOpen({file}));
    folder.write("t.1", text + "\n");
    EXPECT_FALSE(tracks->isOpen({file}));
  }
}
