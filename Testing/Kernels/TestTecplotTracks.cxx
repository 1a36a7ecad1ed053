// Breaks when a DaVis Tecplot ASCII file in any dialect gives other particles than it holds, or when a
// damaged one crashes, gives half a snapshot, or fails without naming file, line and remedy.
#include "PlainDecimal.h"
#include "TecplotTracks.h"
#include "TrackReading.h"
#include "TrackRows.h"

#include <cmath>
#include <csignal>
#include <gtest/gtest.h>
#include <omp.h>
#include <random>
#include <sys/resource.h>

using namespace rimflow;
using namespace testing_tracks;

namespace {

struct TecplotSeries {
  TecplotTracks tracks;
  TrackTimeline line;
  Strings warnings;

  explicit TecplotSeries(const Strings& files, const TrackTimeOptions& options = {}) {
    EXPECT_TRUE(tracks.open(files));
    line = tracks.timeline(options, warnings);
  }
  TrackSnapshot read(std::size_t s, LengthUnit unit = LengthUnit::Auto) {
    TrackSnapshot snapshot;
    EXPECT_TRUE(tracks.read(line.entries.at(s), unit, snapshot, warnings));
    return snapshot;
  }
};

// What open() or the first read() says.
std::string tecplotErrorOf(const Strings& files, std::size_t zone = 0) {
  TecplotTracks tracks;
  TrackSnapshot snapshot;
  Strings warnings;
  try {
    tracks.open(files);
    tracks.read(zone, LengthUnit::Auto, snapshot, warnings);
  } catch (const std::runtime_error& e) {
    EXPECT_EQ(snapshot.size(), 0u);
    EXPECT_TRUE(snapshot.trackId.empty() && snapshot.velocity.empty());
    return e.what();
  }
  return "no error";
}

// The snapshot against what Dialect wrote, in SI.
void expectParticles(const TrackSnapshot& s, const Dialect& d, const std::vector<long>& ids, int snapshot) {
  ASSERT_EQ(s.size(), ids.size());
  ASSERT_EQ(s.trackId.size(), ids.size());
  const auto near = [&](float found, int column, long id, double scale) {
    const double expected = scale * std::stod(print("%.6g", value(column, id, snapshot)));
    EXPECT_NEAR(found, expected, 2e-7 * std::abs(expected)) << d.names[std::size_t(column)];
  };
  for (std::size_t p = 0; p < ids.size(); ++p) {
    EXPECT_EQ(s.trackId[p], ids[p]);
    for (int c = 0; c < 3; ++c) near(s.position[3 * p + std::size_t(c)], c, ids[p], 1e-3);
    for (int c = 0; c < 3; ++c) near(s.velocity[3 * p + std::size_t(c)], 4 + c, ids[p], 1);
    if (!s.acceleration.empty())
      for (int c = 0; c < 3; ++c) near(s.acceleration[3 * p + std::size_t(c)], 9 + c, ids[p], 1);
    near(s.intensity[p], 3, ids[p], 1);
  }
}

const std::vector<long> ids0 = {7, 20000001, 3}, ids1 = {3, 7, 12, 20000001}, ids2 = {12};

} // namespace

TEST(TecplotTracks, OneFileManyZonesInEveryDialect) {
  Folder folder;
  std::vector<Dialect> dialects(7);
  dialects[1].newline = "\r\n";
  dialects[2].separator = "\t";
  dialects[3].separator = ", ";
  dialects[4].separator = ";";
  dialects[5].rowBegin = "  ";
  dialects[5].rowEnd = " \t";
  for (int c : {9, 10, 11})
    dialects[6].names[std::size_t(c)] = std::string("Axyz").substr(0, 1) + "xyz"[c - 9] + "[m/s\xB2]";
  for (const Dialect& d : dialects) {
    const std::string file =
        folder.write("t.dat", d.variables() + d.zone(0, ids0) + d.zone(1, ids1) + d.zone(2, ids2));
    ASSERT_TRUE(TecplotTracks::canRead(file));
    TecplotSeries series({file});
    ASSERT_EQ(series.line.times, (std::vector<double>{43.124719773, 43.125719773, 43.126719773}));
    for (std::size_t k : {1, 0, 2}) {
      const TrackSnapshot s = series.read(k);
      EXPECT_FALSE(s.acceleration.empty());
      expectParticles(s, d, k == 0 ? ids0 : k == 1 ? ids1 : ids2, int(k));
    }
    EXPECT_EQ(series.warnings, Strings());
  }
}

TEST(TecplotTracks, OneFilePerSnapshotInNaturalOrder) {
  Folder folder;
  const Dialect d;
  Strings files;
  for (int k : {2, 10, 1}) {
    std::string zone = d.zone(k, {k, 100 + k});
    zone.replace(zone.find("SOLUTIONTIME="), std::string("SOLUTIONTIME=43.124719773").size(),
                 "SOLUTIONTIME=None");
    zone.replace(zone.find("Snapshot"), 13, "tracks"); // no number in the title
    files.push_back(folder.write("B" + std::to_string(k) + ".dat", d.variables() + zone));
  }
  TecplotSeries series(files, {0.25, 0, false});
  EXPECT_EQ(series.line.times, (std::vector<double>{0.25, 0.5, 2.5}));
  expectParticles(series.read(2), d, {10, 110}, 10);
  ASSERT_EQ(series.warnings.size(), 0u); // the frame period is given
  EXPECT_TRUE(series.tracks.isOpen(files));
  TecplotSeries unknownPeriod(files);
  EXPECT_EQ(unknownPeriod.line.times, (std::vector<double>{1, 2, 10}));
  ASSERT_EQ(unknownPeriod.warnings.size(), 1u);
  expectParts(unknownPeriod.warnings[0], {"B1.dat, line 3", "FramePeriod", "the number in the file's name"});
}

TEST(TecplotTracks, JoinedFilesWithOtherColumnsComments_ByteOrderMarks_EmptyZones) {
  Folder folder;
  Dialect d, old;
  old.names = {"x[mm]", "y[mm]", "z[mm]", "Vx[m/s]", "Vy[m/s]", "Vz[m/s]", "|V|[m/s]", "trackID"};
  old.idColumn = 7;
  std::string second = d.zone(1, ids1);
  second.insert(second.find("12 "), ""); // unchanged; the comment goes between rows
  const std::size_t row = second.find("POINT\n") + 6;
  second.insert(row, "# a comment with ZONE in it\n\n");
  const std::string file = folder.write(
      "all.dat", "\xEF\xBB\xBF" + d.variables() + "# made by hand\n" + d.zone(0, ids0) + "\n" + second +
                     d.zone(2, {}) + "\xEF\xBB\xBF" + old.variables() + old.zone(3, {5, 6}) + d.zone(4, {}));
  TecplotSeries series({file});
  ASSERT_EQ(series.line.times.size(), 5u);
  expectParticles(series.read(0), d, ids0, 0);
  expectParticles(series.read(1), d, ids1, 1);
  EXPECT_EQ(series.read(2).size(), 0u);
  const TrackSnapshot s = series.read(3);
  EXPECT_EQ(s.trackId, (std::vector<std::int64_t>{5, 6}));
  EXPECT_TRUE(s.acceleration.empty() && s.intensity.empty());
  EXPECT_NEAR(s.velocity[4], value(4, 6, 3), 1e-5);
  EXPECT_EQ(series.read(4).size(), 0u);
  EXPECT_EQ(series.warnings, Strings());
}

TEST(TecplotTracks, RowCountMissingOrWrong) {
  Folder folder;
  const Dialect d;
  const std::string whole = d.variables() + d.zone(0, ids0) + d.zone(1, ids1);
  for (const char* instead : {"", "I=abc, ", "I=2, ", "I=99999999999999, "}) {
    std::string text = whole;
    for (const char* count : {"I=3, ", "I=4, "}) text.replace(text.find(count), 5, instead);
    TecplotSeries series({folder.write("t.dat", text)});
    ASSERT_EQ(series.line.times.size(), 2u) << instead;
    expectParticles(series.read(0), d, ids0, 0);
    expectParticles(series.read(1), d, ids1, 1);
    const bool number = instead[0] == 'I' && instead[2] != 'a';
    ASSERT_EQ(series.warnings.size(), number ? 2u : 0u) << instead;
    if (number)
      expectParts(series.warnings[1],
                  {"t.dat, line 10", std::string(instead).substr(0, 3), "4", "export again"});
  }
}

TEST(PlainDecimal, EqualsTheCLibraryToTheBitOrDeclines) {
  std::mt19937 random(7);
  int taken = 0;
  for (int n = 0; n < 200000; ++n) {
    std::string text = random() % 2 ? "-" : "";
    for (unsigned d = random() % 9; d > 0; --d) text += char('0' + random() % 10);
    if (random() % 4) {
      text += ".";
      for (unsigned d = random() % 10; d > 0; --d) text += char('0' + random() % 10);
    }
    const std::string padded = text + " 9.9999999999999999999999999";
    double x = 0;
    const char* end = plainDecimal(padded.data(), x);
    const std::size_t digits = text.find_first_of("0123456789");
    if (!end) continue;
    ++taken;
    ASSERT_NE(digits, text.npos) << text;
    char* expectedEnd = nullptr;
    const double expected = std::strtod(padded.c_str(), &expectedEnd);
    ASSERT_EQ(end, expectedEnd) << text;
    ASSERT_EQ(x, expected) << text;
    std::int64_t whole = 0;
    if (const char* after = plainInteger(padded.data(), whole); after && *after == ' ') {
      ASSERT_EQ(double(whole), expected);
    }
  }
  EXPECT_GT(taken, 150000);
  double x;
  std::int64_t i;
  for (const char* other : {"", "-", ".", "-.", "12345678", "1.123456789", "e5", "nan", "+1", " 1"})
    EXPECT_EQ(plainDecimal((other + std::string(32, '\0')).data(), x), nullptr) << other;
  for (const char* other : {"", "-1", "12345678", "x"})
    EXPECT_EQ(plainInteger((other + std::string(32, '\0')).data(), i), nullptr) << other;
}

TEST(TecplotTracks, UnusualNumbers) {
  Folder folder;
  const std::string file = folder.write(
      "t.dat",
      "VARIABLES = \"x[m]\" \"y[m]\" \"z[m]\" \"u[mm/s]\" \"v[mm/s]\" \"w[mm/s]\" \"trackID\" \"tag\"\n"
      "ZONE SOLUTIONTIME=1\n"
      "+1 -2.5e-1 .5 1.5D+2 1E3 -0 7.0 1e300\n"
      "1. 0.1 00.5 1e-400 2d1 +3e0 1.2e2 NaN\n"
      "1 2 3 4 5 6 9007199254740993 -1.#IND\n"
      "1 2 3 4 5 6 -1 inf"); // no newline at the end
  TecplotSeries series({file});
  const TrackSnapshot s = series.read(0);
  EXPECT_EQ(series.warnings, Strings());
  EXPECT_EQ(s.trackId, (std::vector<std::int64_t>{7, 120, 9007199254740993, -1}));
  ASSERT_EQ(s.size(), 4u);
  EXPECT_EQ(std::vector<float>(s.position.begin(), s.position.begin() + 6),
            (std::vector<float>{1, -0.25f, 0.5f, 1, 0.1f, 0.5f}));
  EXPECT_EQ(std::vector<float>(s.velocity.begin(), s.velocity.begin() + 6),
            (std::vector<float>{0.15f, 1, 0, 0, 0.02f, 0.003f}));
  ASSERT_EQ(s.further.size(), 1u);
  EXPECT_EQ(s.further[0].name, "tag");
  EXPECT_EQ(s.further[0].values[0], 1e300);
  EXPECT_TRUE(std::isnan(s.further[0].values[1]) && std::isnan(s.further[0].values[2]) &&
              std::isinf(s.further[0].values[3]));
}

TEST(TecplotTracks, NotFiniteParticlesAreLeftOutAndCounted) {
  Folder folder;
  const Dialect d;
  std::string text = d.variables() + d.zone(0, {1, 2, 3, 4, 5});
  const auto breakRow = [&](long id, int column, const char* with) {
    const std::string row = d.row(id, 0), was = print("%.6g", value(column, id, 0));
    std::string changed = row;
    changed.replace(row.find(was), was.size(), with);
    text.replace(text.find(row), row.size(), changed);
  };
  breakRow(2, 0, "NaN");
  breakRow(4, 5, "-inf");
  breakRow(5, 2, "1e60"); // more than a float holds
  TecplotSeries series({folder.write("t.dat", text)});
  expectParticles(series.read(0), d, {1, 3}, 0);
  ASSERT_EQ(series.warnings.size(), 1u);
  expectParts(series.warnings[0], {"t.dat, line 8: 3 of 5 particles left out"});
}

TEST(TecplotTracks, DuplicateIdsAreKeptAndNamed) {
  Folder folder;
  const Dialect d;
  TecplotSeries series({folder.write("t.dat", d.variables() + d.zone(0, {5, 9, 5, -1, -1, 5}))});
  EXPECT_EQ(series.read(0).size(), 6u);
  ASSERT_EQ(series.warnings.size(), 1u);
  expectParts(series.warnings[0], {"t.dat, line 3: 2 particles", "such as 5"});
}

TEST(TecplotTracks, LengthUnitIsChosenAtReading) {
  Folder folder;
  const Dialect d;
  TecplotSeries series({folder.write("t.dat", d.variables() + d.zone(0, {5}))});
  const float mm = series.read(0).position[1];
  EXPECT_FLOAT_EQ(series.read(0, LengthUnit::Metre).position[1], 1000 * mm);
  EXPECT_FLOAT_EQ(series.read(0, LengthUnit::Micrometre).position[1], 1e-3f * mm);
  EXPECT_EQ(series.read(0, LengthUnit::Metre).velocity, series.read(0).velocity);
}

TEST(TecplotTracks, TimesThatNeedAWord) {
  Folder folder;
  Dialect d;
  const auto withTimes = [&](const Strings& times) {
    std::string text = d.variables();
    for (std::size_t k = 0; k < times.size(); ++k) {
      std::string zone = d.zone(int(k), {1});
      const std::size_t t = zone.find("SOLUTIONTIME=") + 13;
      text += zone.replace(t, zone.find('\n', t) - t, times[k]);
    }
    return folder.write("t.dat", text);
  };
  TecplotSeries equal({withTimes({"0", "0", "0"})}, {0.5, 0, false});
  EXPECT_EQ(equal.line.times, (std::vector<double>{0, 0.5, 1}));
  expectParts(equal.warnings.at(0), {"line 3: all 3 snapshots have SOLUTIONTIME=0"});
  TecplotSeries twice({withTimes({"1", "2", "1"})});
  EXPECT_EQ(twice.line.times, (std::vector<double>{1, 2}));
  EXPECT_EQ(twice.line.entries, (std::vector<std::size_t>{2, 1}));
  expectParts(twice.warnings.at(0), {"line 3: ", "same time", "line 13"});
  TecplotSeries negative({withTimes({"-0.5", "0.5"})});
  EXPECT_EQ(negative.line.times, (std::vector<double>{-0.5, 0.5}));
  expectParts(negative.warnings.at(0), {"line 3: ", "-0.5 is negative", "ShiftTimeToZero"});
  TecplotSeries partly({withTimes({"1", "None", "nan", "4"})});
  EXPECT_EQ(partly.line.times, (std::vector<double>{1, 2, 3, 4}));
  expectParts(partly.warnings.at(0), {"line 8: ", "1 more"});
  const std::string file = withTimes({"1", "2"});
  TecplotSeries given({file, file});
  EXPECT_EQ(given.line.times.size(), 2u);
  expectParts(given.warnings.at(0), {"more than once"});
}

TEST(TecplotTracks, GzipIsUnpackedByContent) {
  Folder folder;
  const Dialect d;
  std::string text = d.variables();
  std::vector<long> many(3000);
  for (std::size_t i = 0; i < many.size(); ++i) many[i] = long(10 * i);
  for (int k = 0; k < 3; ++k) text += d.zone(k, many);
  const std::string file = folder.writeGzip("t.dat.gz", text);
  EXPECT_TRUE(TecplotTracks::canRead(file));
  TecplotSeries series({file});
  ASSERT_EQ(series.line.times.size(), 3u);
  expectParticles(series.read(2), d, many, 2);

  const std::uintmax_t size = std::filesystem::file_size(file);
  std::filesystem::resize_file(file, size - size / 3);
  expectParts(tecplotErrorOf({file}), {"t.dat.gz", "cut short", "gzip -t"});
  std::string damaged = folder.writeGzip("u.dat.gz", text);
  std::fstream f(damaged, std::ios::in | std::ios::out | std::ios::binary);
  f.seekp(std::streamoff(size / 2));
  f.write("\xFF\xFF\xFF\xFF\xFF\xFF\xFF\xFF", 8);
  f.close();
  expectParts(tecplotErrorOf({damaged}), {"u.dat.gz", "damaged"});
  const char* before = std::getenv("TMPDIR");
  const std::string kept = before ? before : "";
  setenv("TMPDIR", (folder / "none").c_str(), 1);
  expectParts(tecplotErrorOf({folder.writeGzip("v.dat.gz", text)}), {"v.dat.gz", "TMPDIR"});
  before ? setenv("TMPDIR", kept.c_str(), 1) : unsetenv("TMPDIR");
  expectParts(tecplotErrorOf({"/dev/null"}), {"/dev/null: this is no ordinary file"});
}

TEST(TecplotTracks, NoRoomToUnpackIsAnError) {
  Folder folder;
  const Dialect d;
  std::vector<long> many(20000);
  for (std::size_t i = 0; i < many.size(); ++i) many[i] = long(i);
  const std::string file = folder.writeGzip("t.dat.gz", d.variables() + d.zone(0, many));
  rlimit before{};
  getrlimit(RLIMIT_FSIZE, &before);
  const rlimit small{1 << 20, before.rlim_max};
  const auto handler = std::signal(SIGXFSZ, SIG_IGN);
  setrlimit(RLIMIT_FSIZE, &small);
  const std::string message = tecplotErrorOf({file});
  setrlimit(RLIMIT_FSIZE, &before);
  std::signal(SIGXFSZ, handler);
  expectParts(message, {"t.dat.gz: cannot be unpacked into ", "Free some space, set TMPDIR"});
}

TEST(TecplotTracks, ManySmallGzipFilesShareTheTemporarySpace) {
  Folder folder;
  const Dialect d;
  Strings files;
  for (int k = 0; k < 20; ++k)
    files.push_back(folder.writeGzip("B" + std::to_string(k) + ".dat.gz", d.variables() + d.zone(k, {k})));
  TecplotSeries series(files);
  for (int k : {19, 0, 7, 19, 3}) expectParticles(series.read(std::size_t(k)), d, {k}, k);
}

TEST(TecplotTracks, RandomJumpsEqualReadingInOrder_WhateverTheThreads) {
  Folder folder;
  const Dialect d;
  std::mt19937 random(1);
  std::string text = d.variables();
  for (int k = 0; k < 12; ++k) {
    std::vector<long> ids;
    for (long id = 0; id < 9000; ++id)
      if (random() % 4) ids.push_back(id);
    text += d.zone(k, ids);
  }
  const std::string file = folder.write("t.dat", text);
  TecplotSeries inOrder({file}), jumping({file});
  const int threads = omp_get_max_threads();
  std::vector<TrackSnapshot> expected;
  omp_set_num_threads(1);
  for (std::size_t k = 0; k < 12; ++k) expected.push_back(inOrder.read(k));
  omp_set_num_threads(4);
  for (int jump = 0; jump < 60; ++jump) {
    const std::size_t k = random() % 12;
    const TrackSnapshot s = jumping.read(k);
    ASSERT_EQ(s.trackId, expected[k].trackId);
    ASSERT_EQ(s.position, expected[k].position);
    ASSERT_EQ(s.velocity, expected[k].velocity);
    ASSERT_EQ(s.acceleration, expected[k].acceleration);
    ASSERT_EQ(s.intensity, expected[k].intensity);
  }
  omp_set_num_threads(threads);
  EXPECT_GT(expected[3].size(), 6000u);
}

TEST(TecplotTracks, TrackIdsAlone) {
  Folder folder;
  const Dialect d;
  TecplotSeries series({folder.write("t.dat", d.variables() + d.zone(0, ids0))});
  TrackSnapshot s;
  ASSERT_TRUE(
      series.tracks.read(0, LengthUnit::Auto, s, series.warnings, {}, TecplotTracks::Content::TrackIds));
  EXPECT_EQ(s.trackId, (std::vector<std::int64_t>{7, 20000001, 3}));
  EXPECT_TRUE(s.position.empty() && s.velocity.empty());
}

// The index jumps by I= only where zones are larger than 4 MiB.
class LargeZones : public testing::Test {
protected:
  static constexpr long rowsPerZone = 60000;
  static std::string zone(int k, long rows, long declared) {
    std::string text = "ZONE T=\"Snapshot " + std::to_string(k) + "\" SOLUTIONTIME=" + std::to_string(k) +
                       " I=" + std::to_string(declared) + "\n";
    std::string row = "1.25 -2.5 3.125 0.0125 -0.0225 0.0375 0.0425 0.5 0.12345678901 0.98765432109 ";
    for (long id = 0; id < rows; ++id) text += row + std::to_string(1000000 + id) + "\n";
    return text;
  }
  static std::string header() {
    return "VARIABLES = \"x\" \"y\" \"z\" \"u\" \"v\" \"w\" \"|V|\" \"I\" \"a\" \"b\" \"trackID\"\n";
  }
};

TEST_F(LargeZones, RightRowCountsGiveTheSameIndexFaster) {
  Folder folder;
  std::string text = header();
  for (int k = 0; k < 5; ++k) text += zone(k, rowsPerZone - 100 * k, rowsPerZone - 100 * k);
  const std::string file = folder.write("t.dat", text);
  TecplotTracks jumped, scanned;
  jumped.open({file});
  scanned.open({file}, {}, false);
  ASSERT_EQ(scanned.zones().size(), 5u);
  ASSERT_EQ(jumped.zones().size(), 5u);
  for (std::size_t z = 0; z < 5; ++z) {
    EXPECT_EQ(jumped.zones()[z].begin, scanned.zones()[z].begin);
    EXPECT_EQ(jumped.zones()[z].end, scanned.zones()[z].end);
  }
  TrackSnapshot s;
  Strings warnings;
  jumped.read(4, LengthUnit::Auto, s, warnings);
  EXPECT_EQ(s.size(), std::size_t(rowsPerZone - 400));
  EXPECT_EQ(warnings, Strings());
  EXPECT_EQ(jumped.lineOf(0, jumped.zones()[4].header), std::size_t(2 + 4 * (rowsPerZone + 1) - 600));
}

TEST_F(LargeZones, AWrongCountNeverHidesASnapshot) {
  Folder folder;
  // The second zone announces the rows of two and a header: exactly there, the fourth begins.
  const std::string file = folder.write("t.dat", header() + zone(0, rowsPerZone, rowsPerZone) +
                                                     zone(1, rowsPerZone, 2 * rowsPerZone) +
                                                     zone(2, rowsPerZone, rowsPerZone) + zone(3, 500, 500));
  TecplotTracks tracks;
  tracks.open({file});
  TrackSnapshot s;
  Strings warnings;
  ASSERT_EQ(tracks.zones().size(), 3u); // fooled, which reading finds out
  EXPECT_THROW(tracks.read(1, LengthUnit::Auto, s, warnings), TrackIndexOutdated);
  EXPECT_EQ(s.size(), 0u);
  tracks.open({file}, {}, false);
  ASSERT_EQ(tracks.zones().size(), 4u);
  tracks.read(1, LengthUnit::Auto, s, warnings);
  EXPECT_EQ(s.size(), std::size_t(rowsPerZone));
  ASSERT_EQ(warnings.size(), 1u);
  expectParts(warnings[0], {"I=120000", "60000"});

  // Other wrong counts are found while indexing.
  const std::string other = folder.write(
      "u.dat", header() + zone(0, rowsPerZone, rowsPerZone) + zone(1, rowsPerZone, rowsPerZone * 4 / 3) +
                   zone(2, rowsPerZone / 2, rowsPerZone) + zone(3, rowsPerZone, rowsPerZone));
  tracks.open({other});
  EXPECT_EQ(tracks.zones().size(), 4u);
}

TEST(TecplotTracksDamage, EveryKindNamesFileLineAndRemedy) {
  Folder folder;
  const Dialect d;
  const std::string head = d.variables(), good = head + d.zone(0, {1, 2, 3, 4});
  const auto changed = [&](const std::string& was, const std::string& is) {
    std::string text = good;
    return folder.write("t.dat", text.replace(text.find(was), was.size(), is));
  };
  // Rows 1 to 4 are lines 7 to 10.
  expectParts(tecplotErrorOf({changed(d.row(2, 0), "1.25 2.5 3\n")}),
              {"t.dat, line 8: found 3 values", "expected 13 values per row", "Repair"});
  expectParts(tecplotErrorOf({changed(d.row(2, 0), "1 " + d.row(2, 0))}),
              {"t.dat, line 8: found 14 values", "expected 13", "Repair"});
  expectParts(
      tecplotErrorOf({changed(d.row(3, 0), "1.5 2.x5 " + d.row(3, 0).substr(d.row(3, 0).find(" 1.75")))}),
      {"t.dat, line 9: found \"2.x5\" in column \"y[mm]\"", "expected a number", "Repair"});
  std::string fraction = d.row(4, 0);
  fraction.replace(fraction.find(" 4 "), 3, " 4.5 ");
  expectParts(tecplotErrorOf({changed(d.row(4, 0), fraction)}),
              {"t.dat, line 10: found \"4.5\" in column \"trackID\"", "whole number", "Repair"});
  expectParts(tecplotErrorOf({changed(d.row(4, 0), "0,125 1,5 2,25 1 0,1 0,2 0,3 0,4 7 1,5 2,5 3,5 4,5\n")}),
              {"t.dat, line 10: ", "decimal points"});
  expectParts(tecplotErrorOf({changed("J=1", "J=20")}),
              {"t.dat, line 3: ", "grid", "J=20", "export the tracks"});
  expectParts(tecplotErrorOf({changed("POINT", "BLOCK")}),
              {"t.dat, line 3: ", "BLOCK", "DATAPACKING=POINT", "export the tracks"});
  expectParts(tecplotErrorOf({changed("Ordered", "FETriangle")}),
              {"t.dat, line 3: ", "FETRIANGLE", "export the tracks"});
  expectParts(tecplotErrorOf({changed(d.row(1, 0), "abc" + d.row(1, 0))}),
              {"t.dat, line 7: found \"abc", "repair or export"});
  expectParts(tecplotErrorOf({changed("\"z[mm]\"", "\"depth[mm]\"")}),
              {"t.dat, line 3: no column z", "depth[mm]", "Export"});
  expectParts(tecplotErrorOf({changed("\"z[mm]\"", "\"z[voxel]\"")}),
              {"t.dat, line 3: ", "z[voxel]", "LengthUnit"});
  expectParts(tecplotErrorOf({changed(head, "")}),
              {"t.dat, line 5: found \"0.5 ", "VARIABLES", "with the header"});
  expectParts(tecplotErrorOf({changed(good.substr(head.size()), "")}), {"t.dat: ", "no ZONE", "Export"});

  expectParts(tecplotErrorOf({folder.write("t.dat", good.substr(0, good.size() - 20))}),
              {"t.dat, line 10: the file ends in the middle of a row, after ", "of 13 values and 3 of 4 rows",
               "copy or export the file again"});
  expectParts(tecplotErrorOf({folder.write("t.dat", "")}), {"t.dat: the file is empty", "Tecplot ASCII"});
  expectParts(tecplotErrorOf({folder.write("t.dat", std::string(5000, '\0'))}),
              {"t.dat: this is a binary file", "Tecplot ASCII"});
  expectParts(tecplotErrorOf({folder.write("t.dat", "#!TDV112\1\2")}),
              {"t.dat: this is a binary Tecplot file", "Tecplot ASCII"});
  expectParts(errorOf({folder.write("t.h5", std::string("\x89HDF\r\n\x1a\n", 8) + std::string(64, 0))}),
              {"t.h5: this is an HDF5 file", "CSV"});
  expectParts(tecplotErrorOf({folder.write("t.dat", "\xFF\xFEV\0A\0")}), {"t.dat: ", "UTF-16", "UTF-8"});
  const std::string set = folder.write("t.set", "SetIdentifier = \"ParticleField\";\nVersion = 1;\n");
  EXPECT_TRUE(TecplotTracks::canRead(set)); // so that the user gets to read this:
  expectParts(tecplotErrorOf({set}),
              {"t.set: ", "DaVis' own .set file", "export the tracks as Tecplot ASCII"});
  const std::string csv = folder.write("t.csv", "TrackID,FrameID,WorldX,WorldY,WorldZ\n0,1,2.5,3.5,4.5\n");
  EXPECT_FALSE(TecplotTracks::canRead(csv));
  expectParts(tecplotErrorOf({csv}), {"t.csv, line 2: found \"0,1,2.5,3.5,4.5\"", "VARIABLES", "Export"});
  expectParts(tecplotErrorOf({folder.write("t.txt", "Dear reader,\nthis is a letter.\n")}),
              {"t.txt, line 1: found \"Dear reader,\"", "no VARIABLES"});
  expectParts(tecplotErrorOf({folder / "none.dat"}), {"none.dat: cannot be opened: No such file"});
  expectParts(tecplotErrorOf({folder / ""}), {"a folder"});
  expectParts(tecplotErrorOf({}), {"FileNames"});

  // A damaged snapshot leaves the others readable.
  std::string one = d.row(2, 1);
  one.replace(0, 1, "x");
  const std::string file =
      folder.write("t.dat", head + d.zone(0, {1, 2}) + d.zoneHeader(1, 1) + "1 " + one + d.zone(2, {5}));
  expectParts(tecplotErrorOf({file}, 1), {"t.dat, line 13: "});
  TecplotSeries series({file});
  expectParticles(series.read(0), d, {1, 2}, 0);
  expectParticles(series.read(2), d, {5}, 2);
}

TEST(TecplotTracksDamage, LinesWithoutEndAreRefused) {
  Folder folder;
  const Dialect d;
  const auto sparse = [&](const std::string& name, const std::string& begin, char fill) {
    std::ofstream f(folder / name, std::ios::binary);
    f << begin;
    const std::string piece(1 << 20, fill);
    for (int i = 0; i < 24; ++i) f << piece;
    f.close();
    return folder / name;
  };
  expectParts(tecplotErrorOf({sparse("row.dat", d.variables() + d.zoneHeader(0, 1), '1')}),
              {"row.dat, line 7: a line of more than 1 MiB", "export it again"});
  expectParts(tecplotErrorOf({sparse("blank.dat", d.variables() + d.zoneHeader(0, 1) + d.row(1, 0), ' ')}),
              {"blank.dat, line 8: a line of more than 1 MiB"});
  expectParts(tecplotErrorOf({sparse("text.dat", "x", 'x')}), {"text.dat, line 1: ", "no VARIABLES"});
  expectParts(tecplotErrorOf({sparse("digits.dat", "1", '1')}), {"digits.dat, line 1: ", "VARIABLES"});
  // Two bytes a line would be twelve million particles: none of them is whole.
  std::string shortRows = d.variables() + d.zoneHeader(0, 1);
  for (int i = 0; i < 3000000; ++i) shortRows += "1\n";
  expectParts(tecplotErrorOf({folder.write("short.dat", shortRows)}),
              {"short.dat, line 7: found 1 value in the row"});
}

TEST(TecplotTracksDamage, TheFirstOfManyFaultsIsNamed) {
  Folder folder;
  const Dialect d;
  std::string text = d.variables() + d.zoneHeader(0, 20000);
  for (long id = 0; id < 20000; ++id) text += id == 11111 || id == 17000 ? "bad\n" : d.row(id, 0);
  const std::string file = folder.write("t.dat", text);
  const int threads = omp_get_max_threads();
  for (int t : {1, 2, 5}) {
    omp_set_num_threads(t);
    expectParts(tecplotErrorOf({file}),
                {"line " + std::to_string(7 + 11111) + ": found 1 value in the row \"bad\""});
  }
  omp_set_num_threads(threads);
}

TEST(TecplotTracksDamage, AFileThatChangesIsNoticed) {
  Folder folder;
  const Dialect d;
  const std::string file = folder.write("t.dat", d.variables() + d.zone(0, {1, 2, 3}));
  TecplotSeries series({file});
  EXPECT_TRUE(series.tracks.isOpen({file}));
  folder.write("t.dat", d.variables() + d.zone(0, {1}));
  EXPECT_FALSE(series.tracks.isOpen({file}));
  TrackSnapshot s;
  EXPECT_THROW(series.tracks.read(0, LengthUnit::Auto, s, series.warnings), TrackIndexOutdated);
  std::filesystem::remove(file);
  EXPECT_THROW(series.tracks.read(0, LengthUnit::Auto, s, series.warnings), std::runtime_error);
}

TEST(TecplotTracks, AbortLeavesNothing) {
  Folder folder;
  const Dialect d;
  const std::string file = folder.write("t.dat", d.variables() + d.zone(0, ids0));
  TecplotTracks tracks;
  EXPECT_FALSE(tracks.open({file}, [](double) { return false; }));
  EXPECT_TRUE(tracks.zones().empty());
  EXPECT_TRUE(tracks.open({file}));
  TrackSnapshot s;
  Strings warnings;
  EXPECT_FALSE(tracks.read(0, LengthUnit::Auto, s, warnings, [](double) { return false; }));
  EXPECT_EQ(s.size(), 0u);
}
