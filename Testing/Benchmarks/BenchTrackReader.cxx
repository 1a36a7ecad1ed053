// The track reader beside pandas' C engine and a plain std::from_chars loop, on text of 51.7 MB that this
// program writes first: 5 snapshots of 100,000 particles, 12 columns, in the page cache. Ours reads DaVis'
// file, with its headers; the peers get the bare rows, which is the easier task. Throughput is in the column
// "bytes_per_second". A file of any size: BenchTrackReader --file=tracks.dat[,tracks2.dat...] prints the
// times to open it and to read its snapshots in random order, and the peak memory. BenchTrackReader --formats
// compares the formats on the same 500,000 particles, with one thread: opening and reading all snapshots.
#include "SideBySide.h"

#include "TecplotTracks.h"
#include "TrackFormat.h"

#include <charconv>
#include <chrono>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <omp.h>
#include <random>
#include <sstream>
#include <sys/resource.h>
#include <unistd.h>

namespace {

namespace fs = std::filesystem;
constexpr int Snapshots = 5, Particles = 100000, Columns = 12, Repetitions = 15;

double seconds(std::chrono::steady_clock::time_point since) {
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - since).count();
}

struct Files {
  fs::path folder;
  std::string tracks, rows;
  double bytes = 0;

  Files() {
    std::string name = (fs::temp_directory_path() / "rimflow-bench-XXXXXX").string();
    if (!mkdtemp(name.data())) std::abort();
    folder = name;
    tracks = (folder / "tracks.dat").string();
    rows = (folder / "rows.txt").string();
    std::ofstream to(tracks, std::ios::binary), bare(rows, std::ios::binary);
    to << "TITLE = \"B00001\"\nVARIABLES = \"x[mm]\" \"y[mm]\" \"z[mm]\" \"I\" \"Vx[m/s]\" \"Vy[m/s]\" "
          "\"Vz[m/s]\" "
          "\"|V|[m/s]\" \"trackID\" \"Ax[m/s^2]\" \"Ay[m/s^2]\" \"Az[m/s^2]\"\n";
    std::mt19937 random(1);
    std::uniform_real_distribution<double> unit(-1, 1);
    for (int k = 0; k < Snapshots; ++k) {
      to << "ZONE T=\"Snapshot " << k << "\"\nSTRANDID=1, SOLUTIONTIME=" << 43 + 0.001 * k
         << "\nI=" << Particles << ", J=1, K=1, ZONETYPE = Ordered\nDATAPACKING = POINT\n";
      std::string text;
      for (int p = 0; p < Particles; ++p) {
        char row[256];
        const auto u = [&] { return unit(random); };
        text.append(row, std::size_t(std::snprintf(
                             row, sizeof row, "%.6f %.6f %.6f %.4f %.6f %.6f %.6f %.6f %d %.5g %.5g %.5g\n",
                             55 * u(), 37 * u(), 12 * u(), 0.5 + 0.5 * u(), 0.4 * u(), 0.4 * u(), 0.4 * u(),
                             0.3 + 0.3 * u(), 20000 * k + p, 60 * u(), 60 * u(), 60 * u())));
      }
      to << text;
      bare << text;
      bytes += double(text.size());
    }
  }
  ~Files() {
    std::error_code ignored;
    fs::remove_all(folder, ignored);
  }
};

void ours(benchmark::State& state, const Files& files, int threads) {
  omp_set_num_threads(threads);
  std::size_t particles = 0;
  for (auto _ : state) {
    rimflow::TecplotTracks tracks;
    tracks.open({files.tracks});
    for (std::size_t z = 0; z < tracks.zones().size(); ++z) {
      rimflow::TrackSnapshot snapshot;
      std::vector<std::string> warnings;
      tracks.read(z, rimflow::LengthUnit::Auto, snapshot, warnings);
      particles += snapshot.size();
    }
  }
  if (particles % (Snapshots * Particles) != 0) state.SkipWithError("particles were lost");
  state.SetBytesProcessed(std::int64_t(files.bytes) * state.iterations());
}

void plainFromChars(benchmark::State& state, const Files& files) {
  for (auto _ : state) {
    std::ifstream in(files.rows, std::ios::binary);
    const std::string text((std::istreambuf_iterator<char>(in)), {});
    std::vector<double> values;
    values.reserve(std::size_t(Columns) * Particles * Snapshots);
    const char *p = text.data(), *end = p + text.size();
    while (p < end) {
      double x = 0;
      p = std::from_chars(p, end, x).ptr + 1;
      values.push_back(x);
    }
    benchmark::DoNotOptimize(values.data());
  }
  state.SetBytesProcessed(std::int64_t(files.bytes) * state.iterations());
}

// Python starts anew each time, so only the reading itself is counted, as Python sees it.
void pandas(benchmark::State& state, const Files& files) {
  const std::string script = (files.folder / "peer.py").string();
  std::ofstream(script) << "import sys, time, pandas\n"
                           "pandas.read_csv(sys.argv[1], sep=' ', header=None, engine='c', nrows=1000)\n"
                           "t = time.perf_counter()\n"
                           "d = pandas.read_csv(sys.argv[1], sep=' ', header=None, engine='c')\n"
                           "print(time.perf_counter() - t, d.shape[0])\n";
  for (auto _ : state) {
    double time = 0;
    int rows = 0;
    for (const char* python : {"/usr/bin/python3", "python3"}) {
      if (rows > 0) break;
      FILE* pipe =
          popen((std::string(python) + " " + script + " " + files.rows + " 2>/dev/null").c_str(), "r");
      if (!pipe || std::fscanf(pipe, "%lf %d", &time, &rows) != 2) rows = 0;
      if (pipe) pclose(pipe);
    }
    if (rows != Snapshots * Particles) {
      state.SkipWithError("no python3 with pandas (Debian: python3-pandas)");
      return;
    }
    state.SetIterationTime(time);
  }
  state.SetBytesProcessed(std::int64_t(files.bytes) * state.iterations());
}

int givenFiles(const std::string& names) {
  std::vector<std::string> files;
  std::stringstream list(names);
  for (std::string name; std::getline(list, name, ',');) files.push_back(name);
  const auto begin = std::chrono::steady_clock::now();
  const auto tracks = rimflow::makeTrackFile(files);
  tracks->open(files);
  std::printf("opened: %zu snapshots in %.3f s\n", tracks->snapshotCount(), seconds(begin));
  std::mt19937 random(1);
  std::vector<std::string> warnings;
  double sum = 0, longest = 0, particles = 0;
  constexpr int Reads = 50;
  for (int i = 0; i < Reads; ++i) {
    const std::size_t s = random() % tracks->snapshotCount();
    const auto start = std::chrono::steady_clock::now();
    rimflow::TrackSnapshot snapshot;
    tracks->read(s, {rimflow::LengthUnit::Auto, 1}, snapshot, warnings);
    if (i == 0) std::printf("first snapshot after %.3f s, %zu particles\n", seconds(begin), snapshot.size());
    sum += seconds(start);
    longest = std::max(longest, seconds(start));
    particles += double(snapshot.size());
  }
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  std::printf("%d snapshots in random order: mean %.3f s, longest %.3f s, %.2f million particles/s; peak "
              "memory %ld MB\n",
              Reads, sum / Reads, longest, particles / sum * 1e-6, usage.ru_maxrss / 1024);
  for (const std::string& w : warnings) std::printf("warning: %s\n", w.c_str());
  return 0;
}

struct Point {
  double x[3], v[3], a[3];
};

// Tracks of 20 snapshots each, written by one function per format: rows in the order of tracks or of frames.
int formats() {
  constexpr int Tracks = 25000, Frames = 20;
  const Files files;
  std::mt19937 random(1);
  std::uniform_real_distribution<double> unit(-1, 1);
  std::vector<Point> points(std::size_t(Tracks) * Frames);
  for (Point& p : points)
    for (int c = 0; c < 3; ++c)
      p.x[c] = 50 * unit(random), p.v[c] = 0.4 * unit(random), p.a[c] = 60 * unit(random);
  const auto at = [&](int track, int frame) -> const Point& {
    return points[std::size_t(track) * Frames + std::size_t(frame)];
  };
  char row[400];
  const auto byTrack = [&](const std::string& name, const std::string& header, auto print) {
    std::string text = header;
    for (int t = 0; t < Tracks; ++t)
      for (int f = 0; f < Frames; ++f) text.append(row, std::size_t(print(t, f, at(t, f))));
    std::ofstream(files.folder / name, std::ios::binary) << text;
    return std::vector<std::string>{(files.folder / name).string()};
  };
  const auto byFrame = [&](const std::string& name, const std::string& header, auto print) {
    std::vector<std::string> names;
    for (int f = 0; f < Frames; ++f) {
      std::string text = header;
      for (int t = 0; t < Tracks; ++t) text.append(row, std::size_t(print(t, f, at(t, f))));
      names.push_back((files.folder / (name + std::to_string(100 + f))).string());
      std::ofstream(names.back(), std::ios::binary) << text;
    }
    return names;
  };
  const auto print = [&](const char* format, auto... values) {
    return std::snprintf(row, sizeof row, format, values...);
  };
  const std::string openLPT = "TrackID,FrameID,WorldX,WorldY,WorldZ";
  const std::pair<const char*, std::vector<std::string>> all[] = {
      {"DaVis, Tecplot ASCII", {files.tracks}},
      {"OpenLPT", byTrack("a.csv", openLPT + "\n",
                          [&](int t, int f, const Point& p) {
                            return print("%d,%d,%.6f,%.6f,%.6f\n", t, f, p.x[0], p.x[1], p.x[2]);
                          })},
      {"OpenLPT, four cameras",
       byTrack("b.csv",
               openLPT + ",cam0_x(col),cam0_y(row),cam1_x(col),cam1_y(row),cam2_x(col),cam2_y(row),cam3_x("
                         "col),cam3_y(row)\n",
               [&](int t, int f, const Point& p) {
                 return print("%d,%d,%.6f,%.6f,%.6f,%.6f,%.6f,%.6f,%.6f,%.6f,%.6f,%.6f,%.6f\n", t, f, p.x[0],
                              p.x[1], p.x[2], p.x[0], p.x[1], p.x[0], p.x[1], p.x[0], p.x[1], p.x[0], p.x[1]);
               })},
      {"OpenLPT, one line", byTrack("c.txt", "",
                                    [&](int t, int f, const Point& p) {
                                      return print("%d,%d,%.6f,%.6f,%.6f,", t, f, p.x[0], p.x[1], p.x[2]);
                                    })},
      {"MyPTV, smoothed",
       byTrack("d", "",
               [&](int t, int f, const Point& p) {
                 return print("%d\t%.3f\t%.3f\t%.3f\t%.6f\t%.6f\t%.6f\t%.9f\t%.9f\t%.9f\t%.3f\n", t, p.x[0],
                              p.x[1], p.x[2], p.v[0], p.v[1], p.v[2], p.a[0], p.a[1], p.a[2], double(f));
               })},
      {"table by time", byTrack("e.csv", "id,t,x,y,z,u,v,w\n",
                                [&](int t, int f, const Point& p) {
                                  return print("%d,%.4f,%.6f,%.6f,%.6f,%.6f,%.6f,%.6f\n", t, 0.001 * f,
                                               p.x[0], p.x[1], p.x[2], p.v[0], p.v[1], p.v[2]);
                                })},
      {"LPT challenge", byFrame("part_", "a\nb\nX Y Z trackID\n",
                                [&](int t, int, const Point& p) {
                                  return print("%.6f %.6f %.6f %d\n", p.x[0], p.x[1], p.x[2], t);
                                })},
      {"OpenPTV", byFrame("ptv_is.", std::to_string(Tracks) + "\n", [&](int t, int f, const Point& p) {
         return print("%4d %4d %10.3f %10.3f %10.3f\n", f ? t : -1, f + 1 < Frames ? t : -2, p.x[0], p.x[1],
                      p.x[2]);
       })}};
  omp_set_num_threads(1);
  std::printf("%-24s %8s %9s %9s %9s %14s\n", "format", "MB", "open, s", "read, s", "MB/s", "Mparticles/s");
  for (const auto& [name, paths] : all) {
    double bytes = 0, opened = 1e9, read = 1e9;
    std::size_t particles = 0;
    for (const std::string& path : paths) bytes += double(fs::file_size(path));
    for (int repetition = 0; repetition < Repetitions; ++repetition) {
      const auto start = std::chrono::steady_clock::now();
      const auto tracks = rimflow::makeTrackFile(paths);
      tracks->open(paths);
      opened = std::min(opened, seconds(start));
      const auto reading = std::chrono::steady_clock::now();
      particles = 0;
      for (std::size_t k = 0; k < tracks->snapshotCount(); ++k) {
        rimflow::TrackSnapshot snapshot;
        std::vector<std::string> warnings;
        tracks->read(k, {rimflow::LengthUnit::Auto, 0.001}, snapshot, warnings);
        particles += snapshot.size();
      }
      read = std::min(read, seconds(reading));
    }
    if (particles != std::size_t(Tracks) * Frames) std::printf("particles were lost: ");
    std::printf("%-24s %8.1f %9.3f %9.3f %9.0f %14.2f\n", name, bytes * 1e-6, opened, read,
                bytes / (opened + read) * 1e-6, double(particles) / (opened + read) * 1e-6);
  }
  return 0;
}

} // namespace

int main(int argc, char** argv) {
  if (argc == 2 && std::strncmp(argv[1], "--file=", 7) == 0) return givenFiles(argv[1] + 7);
  if (argc == 2 && std::strcmp(argv[1], "--formats") == 0) return formats();
  const Files files;
  std::printf("text: %.1f MB\n", files.bytes * 1e-6);
  const auto add = [](const char* name, auto run) {
    return benchmark::RegisterBenchmark(name, run)
        ->Unit(benchmark::kMillisecond)
        ->Iterations(1)
        ->Repetitions(Repetitions);
  };
  add("STB track reader, two threads", [&](benchmark::State& s) { ours(s, files, 2); })->UseRealTime();
  add("STB track reader, one thread", [&](benchmark::State& s) { ours(s, files, 1); })->UseRealTime();
  add("std::from_chars, one thread", [&](benchmark::State& s) { plainFromChars(s, files); })->UseRealTime();
  add("pandas.read_csv, C engine", [&](benchmark::State& s) { pandas(s, files); })->UseManualTime();
  return rimflow::runSideBySide(argc, argv, "STB track reader, two threads");
}
