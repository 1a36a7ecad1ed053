// Breaks when a sphere's trajectory file gives other times or places than it holds, when what was written
// reads back differently, when a damaged file is read wrongly or fails without file, line and remedy, and
// when the motion between the rows is not that of the path.
#include "SphereMotion.h"
#include "SphereTrajectoryFile.h"
#include "TrackFormat.h"
#include "TrackReading.h"

#include <clocale>
#include <cmath>
#include <gtest/gtest.h>
#include <limits>
#include <random>
#include <sys/stat.h>

using namespace rimflow;
using namespace testing_tracks;
using Vector = Eigen::Vector3d;

namespace {

constexpr double none = std::numeric_limits<double>::quiet_NaN();
const std::string header = "TITLE = \"run 7\"\nVARIABLES = \"Time\" \"x\" \"y\" \"z\"\nDIAMETER=11.11[mm]\n"
                           "SOLID/FLUID DENSITY RATIO=0.65\n";
const std::string rows = "0.0  1.234  5.678  9.012\n0.5\t2.234, -5.678 9.5\n1 NaN nan -nan\n"
                         "# a comment\n\n1.5 +3e0 0 1E1\n";

struct Reading {
  Folder folder;
  std::vector<std::string> warnings;
  SphereTrajectory read(const std::string& content, const SphereTrajectoryOptions& options = {}) {
    return readSphereTrajectory(folder.write("sphere.dat", content), options, warnings);
  }
  std::string errorOf(const std::string& content, const SphereTrajectoryOptions& options = {}) {
    try {
      read(content, options);
    } catch (const std::runtime_error& e) {
      const std::string message = e.what(), path = folder / "sphere.dat";
      EXPECT_EQ(message.compare(0, path.size(), path), 0) << message;
      return message.substr(path.size());
    }
    return "no error";
  }
};

void expectRows(const SphereTrajectory& t) {
  ASSERT_EQ(t.time, (std::vector<double>{0, 0.5, 1, 1.5}));
  EXPECT_DOUBLE_EQ(t.diameter, 0.01111);
  EXPECT_LT((t.centre[0] - Vector(1.234e-3, 5.678e-3, 9.012e-3)).norm(), 1e-15);
  EXPECT_LT((t.centre[1] - Vector(2.234e-3, -5.678e-3, 9.5e-3)).norm(), 1e-15);
  EXPECT_TRUE(t.centre[2].array().isNaN().all());
  EXPECT_LT((t.centre[3] - Vector(3e-3, 0, 10e-3)).norm(), 1e-15);
}

std::string with(const std::string& text, const std::string& from, const std::string& to) {
  std::string result = text;
  const std::size_t p = result.find(from);
  EXPECT_NE(p, result.npos) << from;
  return result.replace(p, from.size(), to);
}

TEST(SphereTrajectoryFile, readsThePublishedLayout) {
  Reading r;
  const SphereTrajectory t = r.read(header + rows);
  expectRows(t);
  EXPECT_EQ(t.title, "run 7");
  EXPECT_DOUBLE_EQ(t.densityRatio, 0.65);
  EXPECT_TRUE(r.warnings.empty()) << r.warnings[0];
}

TEST(SphereTrajectoryFile, readsEveryDialect) {
  const std::string variables = "VARIABLES = \"Time\" \"x\" \"y\" \"z\"", all = header + rows;
  std::string crlf;
  for (const char c : all) crlf += c == '\n' ? "\r\n" : std::string(1, c);
  const std::string dialects[] = {
      crlf,
      "\xEF\xBB\xBF" + all,
      "# made by hand\n\n" + all,
      with(all, "TITLE = \"run 7\"\n", ""),
      with(all, "SOLID/FLUID DENSITY RATIO=0.65\n", ""),
      "SOLID/FLUID DENSITY RATIO = 0.65\ndiameter = 1.111 [cm]\n" + variables + "\ntitle=\"a = b\"\n" + rows,
      "DIAMETER=11110[um], Solid / Fluid Density Ratio=0.65\nVARIABLES=time,X,Y,Z\n" + rows,
      "Sphere diameter=0.01111 m\nvariables = TIME [s], X [mm], Y [mm], Z [mm]\n" + rows,
      "DIAMETER=11.11\nVARIABLES = Time\n x\n y\n z\nTITLE=none\n" + rows,
      with(all, "SOLID", "ZONE T=\"sphere\", I=4\nSTRANDID=1, SOLUTIONTIME=3\nF=POINT\nSOLID"),
      header + "ZONE\n" + rows,
      all.substr(0, all.size() - 1), // no line end after the last row
      "VARIABLES = \"z\" \"Status\" \"t\" \"y\" \"x\"\nDIAMETER=11.11[mm]\n9.012 ok 0 5.678 1.234\n"
      "9.5,lost,0.5,-5.678,2.234\n0 - 1 nan 1\n10 ok 1.5 0 3\n",
      "VARIABLES = \"Time\" \"x[m]\" \"y[cm]\" \"z[um]\"\nDIAMETER=11.11[mm]\n0 .001234 .5678 9012\n"
      "0.5 .002234 -0.5678 9500\n1 0 inf 0\n1.5 0.003 0 1e4\n",
      "VARIABLES = \"Time[ms]\" \"x\" \"y\" \"z\"\nDIAMETER=11.11[mm]\n0 1.234 5.678 9.012\n"
      "500 2.234 -5.678 9.5\n1000 0 nan 0\n1500 3 0 10\n"};
  for (const std::string& dialect : dialects) {
    SCOPED_TRACE(dialect);
    Reading r;
    expectRows(r.read(dialect));
    EXPECT_TRUE(r.warnings.empty()) << r.warnings[0];
  }
  Folder folder;
  std::vector<std::string> warnings;
  expectRows(readSphereTrajectory(folder.writeGzip("sphere.dat.gz", all), {}, warnings));
}

TEST(SphereTrajectoryFile, knowsFramesFromSeconds) {
  const auto file = [](const std::string& time) {
    return "VARIABLES = \"" + time + "\" \"x\" \"y\" \"z\"\nDIAMETER=1\n10 1 2 3\n11 1 2 3\n12 1 2 3\n";
  };
  using Times = std::vector<double>;
  const struct {
    std::string name;
    double framePeriod;
    Times times;
    std::size_t warnings;
  } cases[] = {{"Time", 0, {10, 11, 12}, 1}, // whole numbers: a warning
               {"Time", 0.5, {5, 5.5, 6}, 0},   {"Time[s]", 0.5, {10, 11, 12}, 0},
               {"Time[s]", 0, {10, 11, 12}, 0}, {"t [\xC2\xB5s]", 0.5, {1e-5, 1.1e-5, 1.2e-5}, 0},
               {"Frame", 0.5, {5, 5.5, 6}, 0},  {"Time[frames]", 0.5, {5, 5.5, 6}, 0},
               {"Frame", 0, {10, 11, 12}, 1}};
  for (const auto& c : cases) {
    SCOPED_TRACE(c.name);
    Reading r;
    SphereTrajectoryOptions options;
    options.framePeriod = c.framePeriod;
    const SphereTrajectory t = r.read(file(c.name), options);
    ASSERT_EQ(t.time.size(), 3u);
    for (int i = 0; i < 3; ++i) EXPECT_DOUBLE_EQ(t.time[i], c.times[i]);
    EXPECT_EQ(r.warnings.size(), c.warnings);
    if (!r.warnings.empty()) {
      EXPECT_NE(r.warnings[0].find("FramePeriod"), std::string::npos) << r.warnings[0];
    }
  }
}

TEST(SphereTrajectoryFile, optionsOverruleTheFile) {
  Reading r;
  SphereTrajectoryOptions options;
  options.diameter = 0.02;
  options.timeShift = -0.25;
  options.lengthUnit = LengthUnit::Metre;
  const SphereTrajectory t = r.read(with(header, "DIAMETER=11.11[mm]\n", "") + rows, options);
  EXPECT_EQ(t.diameter, 0.02);
  EXPECT_EQ(t.time[1], 0.25);
  EXPECT_EQ(t.centre[0], Vector(1.234, 5.678, 9.012));
}

TEST(SphereTrajectoryFile, saysWhatIsWrong) {
  const std::string all = header + rows;
  const struct {
    std::string content, line;
    std::vector<std::string> says;
  } cases[] = {
      {"", ": ", {"empty", "VARIABLES"}},
      {std::string("\x01\x00\x02", 3), ": ", {"binary", "expected"}},
      {"\xFF\xFEV", ": ", {"UTF-16", "UTF-8"}},
      {"hello\n" + all, ", line 1: ", {"\"hello\"", "expected a header entry", "#"}},
      {with(all, "DIAMETER=11.11[mm]\n", ""),
       ", line 1: ",
       {"no DIAMETER", "DIAMETER=11.11[mm]", "Diameter"}},
      {with(all, "11.11[mm]", "11.11[inch]"), ", line 3: ", {"\"11.11[inch]\"", "m, cm, mm or um"}},
      {with(all, "11.11[mm]", "-1[mm]"), ", line 3: ", {"\"-1[mm]\"", "greater than 0"}},
      {with(all, "11.11[mm]", "eleven"), ", line 3: ", {"\"eleven\"", "greater than 0"}},
      {with(all, "=0.65", "=light"), ", line 4: ", {"\"light\"", "DENSITY RATIO"}},
      {with(all, "VARIABLES = \"Time\" \"x\" \"y\" \"z\"\n", ""), ", line 1: ", {"no list of VARIABLES"}},
      {with(all, "\"Time\"", "\"Place\""), ", line 2: ", {"no column Time", "VARIABLES"}},
      {with(all, "\"Time\"", "\"Time[min]\""), ", line 2: ", {"unit of the time", "[ms]"}},
      {with(all, "\"y\"", "\"y[inch]\""), ", line 2: ", {"inch", "[mm]"}},
      {with(all, "\"y\"", "\"w\""), ", line 2: ", {"no column y", "VARIABLES"}},
      {header, ", line 4: ", {"no rows", "expected"}},
      {with(all, "9.012", "9.012 1"), ", line 5: ", {"found 5 values", "expected 4", "VARIABLES"}},
      {with(all, "9.012", ""), ", line 5: ", {"found 3 values", "expected 4"}},
      {with(all, "-5.678", "minus"), ", line 6: ", {"\"minus\"", "number"}},
      {with(all, "1.5 ", "0.75 "), ", line 10: ", {"time 0.75 after 1", "increase"}},
      {with(all, "0.5\t", "0\t"), ", line 6: ", {"time 0 after 0", "each only once"}},
      {with(all, "0.5\t", "nan\t"), ", line 6: ", {"time nan", "increase"}},
      {all + header + rows, ", line 11: ", {"header", "Split"}},
      {all + std::string(2 << 20, '1') + "\n", ", line 11: ", {"1 MiB"}},
      {std::string(2 << 20, 'x'), ", line 1: ", {"1 MiB"}}};
  for (const auto& c : cases) {
    SCOPED_TRACE(c.content.substr(0, 400));
    Reading r;
    const std::string message = r.errorOf(c.content);
    EXPECT_EQ(message.compare(0, c.line.size(), c.line), 0) << message;
    for (const std::string& word : c.says) EXPECT_NE(message.find(word), message.npos) << message;
    EXPECT_LT(message.size(), 600u);
  }
  Reading r;
  EXPECT_NE(r.errorOf(std::string("\x1f\x8b\x08\x00garbage", 11)).find("gzip"), std::string::npos);
  r.read("COLOUR=red\n" + all);
  ASSERT_EQ(r.warnings.size(), 1u);
  EXPECT_NE(r.warnings[0].find("line 1: the header entry \"COLOUR=red\" is not used"), std::string::npos);
}

TEST(SphereTrajectoryFile, survivesAnyDamage) {
  const std::string all = header + rows;
  std::mt19937 random(5);
  Reading r;
  for (int i = 0; i < 500; ++i) {
    std::string text = all;
    for (int k = 0; k < 3; ++k) {
      const std::size_t p = random() % text.size();
      if (random() % 3 == 0)
        text.erase(p, random() % 20);
      else
        text[p] = random() % 2 ? "=\"[]\n,. \tZ"[random() % 10] : char(random() % 256);
    }
    const std::string message = r.errorOf(text);
    EXPECT_LT(message.size(), 900u) << message;
  }
}

TEST(SphereTrajectoryFile, writtenReadsBackTheSame) {
  Folder folder;
  std::mt19937 random(3);
  std::uniform_real_distribution<double> place(-0.2, 0.2), step(1e-5, 1e-2);
  SphereTrajectory t;
  t.title = "a \"quoted\" title";
  t.densityRatio = 1190. / 1820.;
  double time = 43.124719773;
  for (int i = 0; i < 500; ++i) {
    t.time.push_back(time += step(random));
    t.centre.push_back(i % 50 == 7 ? Vector(none, none, none)
                                   : Vector(place(random), place(random), place(random)));
  }
  for (const double diameter : {0.01111, 9.53 * 1e-3, 1. / 3, 2.5e-5}) {
    t.diameter = diameter;
    writeSphereTrajectory(folder / "out.dat", t);
    std::vector<std::string> warnings;
    SphereTrajectory read = readSphereTrajectory(folder / "out.dat", {}, warnings);
    EXPECT_TRUE(warnings.empty());
    EXPECT_EQ(read.time, t.time); // all digits
    EXPECT_NEAR(read.diameter, diameter, 1e-14 * diameter);
    EXPECT_EQ(read.densityRatio, t.densityRatio);
    for (std::size_t i = 0; i < t.centre.size(); ++i) {
      EXPECT_EQ(read.centre[i].allFinite(), t.centre[i].allFinite());
      if (t.centre[i].allFinite()) {
        EXPECT_LT((read.centre[i] - t.centre[i]).norm(), 1e-12);
      }
    }
    // from then on nothing changes
    writeSphereTrajectory(folder / "again.dat", read);
    const SphereTrajectory again = readSphereTrajectory(folder / "again.dat", {}, warnings);
    EXPECT_EQ(again.time, read.time);
    EXPECT_EQ(again.diameter, read.diameter);
    EXPECT_EQ(again.centre[3], read.centre[3]);
    EXPECT_EQ(again.title, read.title);
  }
  std::string line;
  t.diameter = 11.11 * 1e-3, t.title.clear();
  writeSphereTrajectory(folder / "out.dat", t);
  std::ifstream written(folder / "out.dat");
  for (const char* expected : {"TITLE = \"Sphere trajectory: time in s, positions in mm\"",
                               "VARIABLES = \"Time\" \"x\" \"y\" \"z\"", "DIAMETER=11.11[mm]"}) {
    std::getline(written, line);
    EXPECT_EQ(line, expected);
  }
}

TEST(SphereTrajectoryFile, writesTheWholeFileOrNone) {
  Folder folder;
  SphereTrajectory t{"", 0.01, 0, {0, 1}, {Vector::Zero(), Vector::Zero()}};
  const std::string path = folder.write("out.dat", "what was there before");
  const auto complaint = [&](const SphereTrajectory& what, const std::string& where) -> std::string {
    try {
      writeSphereTrajectory(where, what);
    } catch (const std::exception& e) {
      return e.what();
    }
    return "";
  };
  SphereTrajectory bad = t;
  bad.time[1] = 0;
  EXPECT_NE(complaint(bad, path).find("increasing"), std::string::npos);
  bad = t, bad.diameter = 0;
  EXPECT_NE(complaint(bad, path).find("diameter"), std::string::npos);
  EXPECT_NE(complaint({"", 0.01, 0, {}, {}}, path).find("at least one"), std::string::npos);
  EXPECT_NE(complaint(t, folder / "none/out.dat").find("none/out.dat: cannot be written"), std::string::npos);
  std::string before;
  std::getline(std::ifstream(path), before);
  EXPECT_EQ(before, "what was there before");
  EXPECT_EQ(complaint(t, path), "");
  std::size_t files = 0;
  for (const auto& entry : std::filesystem::directory_iterator(std::filesystem::path(path).parent_path()))
    files += entry.is_regular_file();
  EXPECT_EQ(files, 1u); // no temporary ones
}

TEST(SphereTrajectoryFile, isToldFromTracks) {
  Folder folder;
  const auto looks = [&](const std::string& content) {
    return looksLikeSphereTrajectory(folder.write("any.dat", content));
  };
  EXPECT_TRUE(looks(header + rows));
  const std::string timed = "VARIABLES = \"Time\" \"x\" \"y\" \"z\"\n";
  EXPECT_TRUE(looks(timed + rows));                           // the diameter is missing
  EXPECT_FALSE(looks(timed + "0 1 2 3\n0 2 3 4\n1 2 3 4\n")); // particles
  EXPECT_FALSE(looks("VARIABLES = \"t\" \"x\" \"y\" \"z\" \"trackID\"\n0 1 2 3 4\n1 1 2 3 4\n"));
  EXPECT_FALSE(looks(Dialect().variables() + Dialect().zone(0, {1, 2, 3})));
  EXPECT_FALSE(looks(""));
  EXPECT_FALSE(looks(std::string(1000, '\0')));
  // tracks with a diameter of something
  const std::string tracks = Dialect().variables() + Dialect().zone(0, {1, 2, 3});
  EXPECT_FALSE(looks("DIAMETER=11.11[mm]\n" + tracks));
  for (const char* note :
       {"DATASETAUXDATA Particle Diameter=\"3\"\n", "PARTICLE_DIAMETER=3\n", "Tracer diameter = 50 um\n"}) {
    EXPECT_FALSE(namesSphereDiameter(note + timed + rows)) << note;
    EXPECT_TRUE(namesSphereDiameter(note + header + rows)) << note;
  }
  // and the track reader does not take it for tracks
  const std::string sphere = folder.write("sphere.dat", header + rows);
  EXPECT_FALSE(looksLikeTracks(sphere));
  try {
    makeTrackFile({sphere});
    FAIL() << "a sphere's trajectory was opened as tracks";
  } catch (const std::runtime_error& e) {
    EXPECT_NE(std::string(e.what()).find("Sphere Trajectory Reader"), std::string::npos) << e.what();
  }
}

// A path with an acceleration that changes, as polynomials of the third degree follow it exactly.
Vector place(double t) {
  return {0.01 + 0.3 * t, 0.2 * t - 4 * t * t, 0.005 + 0.1 * t + 2 * t * t + 50 * t * t * t};
}
Vector speed(double t) { return {0.3, 0.2 - 8 * t, 0.1 + 4 * t + 150 * t * t}; }
Vector acceleration(double t) { return {0, -8, 4 + 300 * t}; }

struct Path {
  std::vector<double> time;
  std::vector<Vector> centre;
  explicit Path(int rows, double noise = 0, double jitter = 0) {
    std::mt19937 random(7);
    std::normal_distribution<double> normal;
    std::uniform_real_distribution<double> uniform(-jitter, jitter);
    for (int i = 0; i < rows; ++i) {
      time.push_back(43 + 1e-3 * (i + uniform(random)));
      centre.push_back(place(time.back() - 43) +
                       noise * Vector(normal(random), normal(random), normal(random)));
    }
  }
  void lose(int begin, int end) {
    for (int i = begin; i < end; ++i) centre[std::size_t(i)] = Vector(none, none, none);
  }
};

TEST(SphereMotion, derivativesOfACubicAreExact) {
  for (const double jitter : {0., 0.2}) {
    const Path path(60, 0, jitter);
    const SphereMotion motion(path.time, path.centre);
    for (std::size_t i = 0; i < path.time.size(); ++i) {
      const SphereState s = motion.at(path.time[i]);
      const double t = path.time[i] - 43;
      EXPECT_EQ(s.status, CentreStatus::Found);
      EXPECT_EQ(s.centre, path.centre[i]);
      EXPECT_LT((s.velocity - speed(t)).norm(), 1e-9);
      EXPECT_LT((s.acceleration - acceleration(t)).norm(), 1e-6);
    }
    for (double t = 0.0013; t < 0.058; t += 0.0007) { // between the rows
      const SphereState s = motion.at(43 + t);
      EXPECT_EQ(s.status, CentreStatus::Found);
      EXPECT_LT((s.centre - place(t)).norm(), 1e-12);
      EXPECT_LT((s.velocity - speed(t)).norm(), 150 * 1.4e-3 * 1.4e-3 / 4);
      EXPECT_LT((s.acceleration - acceleration(t)).norm(), 1e-6);
    }
  }
}

TEST(SphereMotion, goesOnWithoutJumpsBetweenTheRows) {
  const Path path(40, 1e-5);
  const SphereMotion motion(path.time, path.centre);
  for (const double t : path.time) {
    if (t == path.time.front() || t == path.time.back()) continue;
    const SphereState left = motion.at(t - 1e-5), right = motion.at(t + 1e-5);
    EXPECT_LT((right.centre - left.centre - 2e-5 * motion.at(t).velocity).norm(), 1e-7);
    EXPECT_LT((right.velocity - left.velocity).norm(), 0.02);
  }
}

TEST(SphereMotion, bridgesAShortLossAndGivesUpALongOne) {
  Path path(100);
  path.lose(20, 25);
  path.lose(50, 70);
  path.lose(0, 2);
  const SphereMotion motion(path.time, path.centre);
  for (int i = 20; i < 25; ++i) {
    const SphereState s = motion.at(path.time[std::size_t(i)]);
    EXPECT_EQ(s.status, CentreStatus::Predicted);
    EXPECT_LT((s.centre - place(path.time[std::size_t(i)] - 43)).norm(), 1e-12);
    EXPECT_LT((s.velocity - speed(path.time[std::size_t(i)] - 43)).norm(), 1e-8);
  }
  EXPECT_EQ(motion.at(43.0605).status, CentreStatus::Lost);
  EXPECT_EQ(motion.at(43.060).status, CentreStatus::Lost);
  EXPECT_TRUE(std::isnan(motion.at(43.060).centre[0]));
  EXPECT_EQ(motion.at(path.time[0]).status, CentreStatus::Lost); // nothing before it
  EXPECT_EQ(motion.at(42.9).status, CentreStatus::Lost);
  EXPECT_EQ(motion.at(43.2).status, CentreStatus::Lost);
  // rows that are missing altogether are like lost ones
  Path cut(100);
  for (auto [begin, end] : {std::pair(60, 90), std::pair(20, 25)}) {
    cut.time.erase(cut.time.begin() + begin, cut.time.begin() + end);
    cut.centre.erase(cut.centre.begin() + begin, cut.centre.begin() + end);
  }
  const SphereMotion without(cut.time, cut.centre);
  EXPECT_EQ(without.at(43.022).status, CentreStatus::Predicted);
  EXPECT_LT((without.at(43.022).centre - place(0.022)).norm(), 1e-7);
  EXPECT_EQ(without.at(43.075).status, CentreStatus::Lost);
}

TEST(SphereMotion, saysOnlyWhatFewRowsTell) {
  const auto at = [](int rows) {
    const Path path(rows);
    return SphereMotion(path.time, path.centre).rows().at(0);
  };
  EXPECT_TRUE(at(1).velocity.array().isNaN().all());
  EXPECT_EQ(at(1).status, CentreStatus::Found);
  EXPECT_TRUE(at(2).velocity.allFinite());
  EXPECT_TRUE(at(2).acceleration.array().isNaN().all());
  EXPECT_TRUE(at(3).acceleration.allFinite());
  EXPECT_TRUE(at(4).sigma.array().isNaN().all()); // nothing tells the errors of four rows on a cubic
  EXPECT_TRUE(at(6).sigma.allFinite());
  EXPECT_EQ(SphereMotion({}, {}).at(0).status, CentreStatus::Lost);
  EXPECT_THROW(SphereMotion({0}, {Vector::Zero()}, {6, 15}), std::invalid_argument);
  EXPECT_THROW(SphereMotion({0}, {Vector::Zero()}, {3, 3}), std::invalid_argument);
}

TEST(SphereMotion, standardDeviationsAreThoseOfTheNoise) {
  const double noise = 2e-5;
  const Path path(2000, noise);
  const SphereMotion motion(path.time, path.centre);
  double velocity = 0, acceleration2 = 0, velocitySigma = 0, accelerationSigma = 0;
  for (std::size_t i = 20; i < 1980; ++i) {
    const SphereState& s = motion.rows()[i];
    EXPECT_NEAR(s.sigma[0], noise, 0.05 * noise);
    velocity += (s.velocity - speed(path.time[i] - 43)).squaredNorm();
    velocitySigma += s.velocitySigma.squaredNorm();
    acceleration2 += (s.acceleration - acceleration(path.time[i] - 43)).squaredNorm();
    accelerationSigma += s.accelerationSigma.squaredNorm();
  }
  EXPECT_NEAR(velocity / velocitySigma, 1, 0.15);
  EXPECT_NEAR(acceleration2 / accelerationSigma, 1, 0.15);
}

} // namespace
