// Breaks when a broken track file of any format crashes, takes more memory than it should, gives particles
// that it does not hold, or fails without saying which file, which line and what to do.
#include "FrameTracks.h"
#include "TableTracks.h"
#include "TrackReading.h"

#include <algorithm>
#include <cmath>
#include <csignal>
#include <random>
#include <sys/resource.h>

using namespace rimflow;
using namespace testing_tracks;

namespace {

// A whole file of each format: two particles, with ids 1 and 2 where there are any. The second one, in
// `line`, has x = 2.5 mm.
struct Whole {
  std::string name, head, first, second;
  std::size_t line;     // of the second row
  bool byFrame = false; // rows of all snapshots are mixed: what a cut file has can be used
  std::string separator;
  std::string id, time;                  // of the second row, with what stands around it; empty: none
  std::size_t count = std::string::npos; // where the head says that there are 2 rows
  std::string all() const { return head + first + second; }
  std::string with(const std::string& was, const std::string& is) const {
    std::string row = second;
    return head + first + row.replace(row.find(was), was.size(), is);
  }
  std::string at(std::size_t lineNumber) const {
    return name + ", line " + std::to_string(lineNumber) + ": ";
  }
};

std::vector<Whole> wholeFiles() {
  const Dialect d;
  const std::string davis = d.variables() + d.zoneHeader(0, 2);
  std::string row = d.row(2, 0);
  row.replace(0, row.find(' '), "2.5");
  return {
      {"B00001.dat", davis, d.row(1, 0), row, 8, false, " ", " 2 ", "", davis.find("I=2") + 2},
      {"openlpt.csv", "TrackID,FrameID,WorldX,WorldY,WorldZ,R3D\n", "1,1,1.5,2,3,4\n", "2,1,2.5,2,3,4\n", 3,
       true, ",", "2,", ",1,"},
      {"lines.txt", "", "1,1,1.5,2,3\n", "2,1,2.5,2,3\n", 2, true, ",", "2,", ",1,"},
      {"smoothed_trajectories", "", "1\t1.5\t2\t3\t1.5\t1\t1\t1\t1\t1\t1.000\n",
       "2\t2.5\t2\t3\t1.5\t1\t1\t1\t1\t1\t1.000\n", 2, true, "\t", "2\t", "\t1.000"},
      {"trajectories", "", "1\t1.5\t2\t3\t9\t9\t1.000\n", "2\t2.5\t2\t3\t9\t9\t1.000\n", 2, true, "\t", "2\t",
       "\t1.000"},
      {"ptv_is.1", "2\n", "-1 -2 1.5 2 3\n", "-1 -2 2.5 2 3\n", 3, false, " ", "", "", 0},
      {"rt_is.1", "2\n", "1 1.5 2 3\n", "2 2.5 2 3\n", 3, false, " ", "", "", 0},
      {"part_1.dat", "a\nb\nx y z id\n", "1.5 2 3 1\n", "2.5 2 3 2\n", 5, false, " ", " 2\n", ""},
      {"p_1.csv", "x,y,z,id\n", "1.5,2,3,1\n", "2.5,2,3,2\n", 3, false, ",", ",2\n", ""},
      {"table.csv", "id;time[s];x;y;z\n", "1;1;1.5;2;3\n", "2;1;2.5;2;3\n", 3, true, ";", "2;", ";1;"},
      {"columns.txt", "# id frame x y z\n", "1 1 1.5 2 3\n", "2 1 2.5 2 3\n", 3, true, " ", "2 ", " 1 "},
  };
}

} // namespace

TEST(BrokenTracks, WholeFilesAreRead) {
  Folder folder;
  for (const Whole& w : wholeFiles()) {
    Series series({folder.write(w.name, w.all())});
    EXPECT_EQ(series.read(0).size(), 2u) << w.name;
    EXPECT_FLOAT_EQ(series.read(0).position[3], 2.5e-3f) << w.name;
  }
}

TEST(BrokenTracks, WrongExtensionsAreNoMatter) {
  Folder folder;
  for (const Whole& w : wholeFiles())
    for (const char* name : {"tracks.png", "tracks.vti", "tracks"}) {
      EXPECT_TRUE(looksLikeTracks(folder.write(name, w.all()))) << w.name;
      Series series({folder / name});
      EXPECT_EQ(series.read(0).size(), 2u) << w.name;
    }
}

TEST(BrokenTracks, CutInTheMiddleOfARow) {
  Folder folder;
  for (const Whole& w : wholeFiles()) {
    const std::string file = folder.write(w.name, w.head + w.first + w.second.substr(0, w.second.size() / 2));
    const Strings parts = {w.at(w.line) + "the file ends in the middle of a row", "export the file again"};
    if (w.byFrame) {
      Series series({file});
      EXPECT_EQ(series.read(0).size(), 1u) << w.name;
      expectParts(joined(series.warnings), parts);
    } else
      expectParts(errorOf({file}), parts);
  }
}

TEST(BrokenTracks, WrongCounts) {
  Folder folder;
  for (const Whole& w : wholeFiles()) {
    std::string more = w.second;
    more.insert(more.size() - 1, w.separator + "9");
    for (const std::string& row : {more, std::string("7\n")}) // a value too many, and too few
      expectParts(errorOf({folder.write(w.name, w.head + w.first + row + w.first)}),
                  {w.at(w.line), "found ", "in the row", "expected", "Repair"});
    if (w.count == std::string::npos) continue; // more rows than announced, and fewer
    for (const char* n : {"1", "3"}) {
      std::string head = w.head;
      Series series({folder.write(w.name, head.replace(w.count, 1, n) + w.first + w.second)});
      EXPECT_EQ(series.read(0).size(), 2u);
      expectParts(joined(series.warnings),
                  {w.name + ", line ", "announces ", n, "rows, but has 2", "export again"});
    }
  }
}

TEST(BrokenTracks, LettersInNumbers) {
  Folder folder;
  for (const Whole& w : wholeFiles())
    for (const std::string letters : {"2.x5", "2.5m", "0x1A", "2.5.1", "--2"}) {
      const std::string message = errorOf({folder.write(w.name, w.with("2.5", letters) + w.first)});
      if (w.name == "lines.txt") // numbers are all that this format can be known by
        expectParts(message, {w.at(1) + "found ", "names of the columns"});
      else
        expectParts(message, {w.at(w.line) + "found \"" + letters + "\" in column", "expected a", "epair"});
    }
}

TEST(BrokenTracks, NaNAndInfinityAreLeftOutAndCounted) {
  Folder folder;
  for (const Whole& w : wholeFiles())
    for (const std::string value : {"nan", "-inf", "1e99", "1.#QNAN"}) {
      if (value[1] == '.' && w.name == "lines.txt") continue; // numbers are all that it can be known by
      const std::string file = folder.write(w.name, w.with("2.5", value));
      Series series({file});
      EXPECT_EQ(series.read(0).size(), 1u) << w.name << value;
      expectParts(joined(series.warnings), {w.at(w.line) + "1 of 2 particles left out", "Check the export"});
    }
}

TEST(BrokenTracks, DuplicateIdsAreKeptAndNamed) {
  Folder folder;
  for (const Whole& w : wholeFiles()) {
    if (w.id.empty()) continue;
    std::string id = w.id;
    Series series({folder.write(w.name, w.with(w.id, id.replace(id.find('2'), 1, "1")))});
    EXPECT_EQ(series.read(0).size(), 2u) << w.name;
    expectParts(joined(series.warnings),
                {w.name, "1 particles of this snapshot have the trackID", "such as 1"});
  }
}

TEST(BrokenTracks, NegativeTimesAreKeptAndNamed) {
  Folder folder;
  for (const Whole& w : wholeFiles()) {
    if (w.time.empty()) continue;
    std::string time = w.time;
    Series series({folder.write(w.name, w.with(w.time, time.insert(1, "-")))});
    ASSERT_EQ(series.line.times.size(), 2u) << w.name;
    EXPECT_LT(series.line.times[0], 0);
    expectParts(joined(series.warnings), {w.name + ", ", "-1: this is negative", "ShiftTimeToZero"});
  }
}

TEST(BrokenTracks, EmptyAndBinaryFiles) {
  Folder folder;
  std::mt19937 random(1);
  std::string noise(20000, '\0');
  for (char& c : noise) c = char(random());
  noise[100] = '\0';
  for (const Whole& w : wholeFiles()) {
    expectParts(errorOf({folder.write(w.name, "")}), {w.name + ": the file is empty", "Export"});
    for (const std::string& bytes : {noise, std::string(5000, '\0'), "\x89PNG\r\n\x1A\n" + noise}) {
      EXPECT_FALSE(looksLikeTracks(folder.write(w.name, bytes)));
      expectParts(errorOf({folder / w.name}), {w.name + ": this is a binary file", "Export"});
    }
    for (const char* blank : {"\n", " \r\n\t\n", "\xEF\xBB\xBF"})
      expectParts(errorOf({folder.write(w.name, blank)}), {w.name, "xport"});
    // Half of the file, then noise, as after a crash of the disk: no byte of it becomes a particle.
    const std::string half = w.head + w.first + noise;
    try {
      Series series({folder.write(w.name, half)});
      EXPECT_LE(series.read(0).size(), 1u) << w.name;
    } catch (const std::runtime_error& e) {
      expectParts(e.what(), {w.name});
    }
  }
}

TEST(BrokenTracks, GzipCutAndDamaged) {
  Folder folder;
  for (const Whole& w : wholeFiles()) {
    std::string text = w.head;
    for (int i = 0; i < 3000; ++i) text += w.first;
    const std::string file = folder.writeGzip(w.name, text);
    const std::uintmax_t size = std::filesystem::file_size(file);
    std::filesystem::resize_file(file, size - size / 3);
    expectParts(errorOf({file}), {w.name, "cut short", "gzip -t"});
    folder.writeGzip(w.name, text);
    std::fstream f(file, std::ios::in | std::ios::out | std::ios::binary);
    f.seekp(std::streamoff(size - 6)); // the check sum
    f.write("\xFF\xFF", 2);
    f.close();
    expectParts(errorOf({file}), {w.name, "damaged", "gzip -t"});
  }
}

// Ten gigabytes without a line end, after rows that are whole: sparse, so that they take no room on disk.
TEST(BrokenTracks, EndlessLinesTakeNoMemory) {
  Folder folder;
  const auto peak = [] {
    rusage usage{};
    getrusage(RUSAGE_SELF, &usage);
    return usage.ru_maxrss / 1024; // MiB
  };
  const long before = peak();
  for (const Whole& w : wholeFiles()) {
    std::string text = w.head;
    while (text.size() < 100000) text += w.first;
    const std::string file = folder.write(w.name, text + "1");
    std::filesystem::resize_file(file, std::uintmax_t(10) << 30);
    const std::size_t line = 1 + std::size_t(std::count(text.begin(), text.end(), '\n'));
    expectParts(errorOf({file}), {w.name == "lines.txt" ? w.name + ", line " : w.at(line),
                                  "a line of more than 1 MiB", "export it again"});
  }
  for (const char fill : {'x', '1', ' ', ','}) { // from the beginning on
    const std::string file = folder.write("endless.dat", std::string(70000, fill));
    std::filesystem::resize_file(file, std::uintmax_t(10) << 30);
    EXPECT_FALSE(looksLikeTracks(file));
    expectParts(errorOf({file}), {"endless.dat, line 1: ", "xport"});
  }
  EXPECT_LT(peak() - before, 100);
}

TEST(BrokenTracks, NumbersAtTheEndOfTheirRange) {
  Folder folder;
  const std::string head = "TrackID,FrameID,WorldX,WorldY,WorldZ\n", last = "9223372036854775807,1,1,2,3\n";
  const Strings two = {folder.write("a.csv", head + last), folder.write("b.csv", head + "0,1,1,2,3\n")};
  EXPECT_EQ(Series({two[0]}).read(0).trackId.at(0), 9223372036854775807);
  expectParts(errorOf(two), {"b.csv: the track ids are too large", "one by one"});
  // A time axis that stays finite, whatever is added to it.
  Series times(
      {folder.write("t.csv", "t,id,x,y,z\n1e308,1,1,2,3\n-1e308,2,1,2,3\n1e29,3,1,2,3\n-1e29,4,1,2,3\n")},
      {0, 1e300, true});
  ASSERT_EQ(times.line.times.size(), 2u);
  EXPECT_TRUE(std::isfinite(times.line.times[1]) && times.line.times[1] > times.line.times[0]);
  expectParts(joined(times.warnings), {"t.csv, line 2: 2 of 4 particles left out"});
  Series zones(
      {folder.write("t.dat",
                    "VARIABLES = x y z\nZONE SOLUTIONTIME=1e308\n1 2 3\nZONE SOLUTIONTIME=-1e308\n1 2 3\n")},
      {1, 0, true});
  EXPECT_EQ(zones.line.times, (std::vector<double>{0, 1}));
  // A velocity that is finite in the file's unit only.
  Series fast(
      {folder.write("v.csv", "t,id,x,y,z,u[m/us],v[m/us],w[m/us]\n0,1,1,2,3,1e35,1,1\n0,2,1,2,3,1,1,1\n")});
  const TrackSnapshot s = fast.read(0);
  EXPECT_TRUE(std::isnan(s.velocity[0]) && std::isnan(s.velocity[1]) && s.velocity[3] == 1e6f);
  expectParts(joined(fast.warnings),
              {"v.csv, time 0: 1 velocities or accelerations are beyond single precision", "units"});
  Series chain({folder.write("ptv_is.9223372036854775806", "1\n-1 0 1 2 3\n"),
                folder.write("ptv_is.9223372036854775807", "1\n0 -2 1 2 3\n")});
  EXPECT_EQ(chain.tracks->snapshotCount(), 2u); // with one track
  EXPECT_EQ(chain.read(0).trackId, (std::vector<std::int64_t>{0}));
}

TEST(BrokenTracks, RandomDamageNeverCrashes) {
  Folder folder;
  std::mt19937 random(11);
  const std::vector<Whole> whole = wholeFiles();
  int readable = 0;
  for (int attempt = 0; attempt < 1100; ++attempt) {
    const Whole& w = whole[std::size_t(attempt) % whole.size()];
    const std::string file = folder.write(w.name, damaged(w.all(), random, 1 + attempt % 4));
    try {
      const auto tracks = makeTrackFile({file});
      tracks->open({file});
      Strings warnings;
      tracks->timeline({}, warnings);
      for (std::size_t s = 0; s < tracks->snapshotCount(); ++s) {
        TrackSnapshot particles;
        tracks->read(s, {LengthUnit::Auto, 1}, particles, warnings);
        EXPECT_TRUE(particles.trackId.empty() || particles.trackId.size() == particles.size());
        EXPECT_TRUE(particles.velocity.empty() || particles.velocity.size() == particles.position.size());
        ++readable;
      }
    } catch (const std::runtime_error& e) {
      expectParts(e.what(), {w.name});
    }
  }
  EXPECT_GT(readable, 80);
}

TEST(BrokenTracks, AFullDiskIsAnError) {
  Folder folder;
  std::string text = "id,frame,x,y,z\n";
  for (int i = 0; i < 200000; ++i) text += std::to_string(i) + ",1,2,3,4\n";
  const std::string file = folder.write("t.csv", text);
  rlimit before{};
  getrlimit(RLIMIT_FSIZE, &before);
  const rlimit small{1 << 20, before.rlim_max};
  const auto handler = std::signal(SIGXFSZ, SIG_IGN);
  setrlimit(RLIMIT_FSIZE, &small);
  std::string message;
  try {
    FrameTracks tracks(tableFormat(), {std::size_t(1) << 16, 0});
    tracks.open({file});
  } catch (const std::runtime_error& e) {
    message = e.what();
  }
  setrlimit(RLIMIT_FSIZE, &before);
  std::signal(SIGXFSZ, handler);
  expectParts(message, {"temporary file", "Free some space, or set TMPDIR"});
}
