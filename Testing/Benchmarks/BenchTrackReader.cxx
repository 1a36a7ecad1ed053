// The track reader beside pandas' C engine and a plain std::from_chars loop, on text of 51.7 MB that this
// program writes first: 5 snapshots of 100,000 particles, 12 columns, in the page cache. Ours reads DaVis'
// file, with its headers; the peers get the bare rows, which is the easier task. Throughput is in the column
// "bytes_per_second". A file of any size: BenchTrackReader --file=tracks.dat[,tracks2.dat...] prints the
// times to open it and to read its snapshots in random order, and the peak memory.
#include "SideBySide.h"

#include "TecplotTracks.h"

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
  rimflow::TecplotTracks tracks;
  const auto begin = std::chrono::steady_clock::now();
  tracks.open(files);
  std::printf("opened: %zu snapshots in %.3f s\n", tracks.zones().size(), seconds(begin));
  std::mt19937 random(1);
  std::vector<std::string> warnings;
  double sum = 0, longest = 0, bytes = 0;
  constexpr int Reads = 50;
  for (int i = 0; i < Reads; ++i) {
    const std::size_t z = random() % tracks.zones().size();
    const auto start = std::chrono::steady_clock::now();
    rimflow::TrackSnapshot snapshot;
    tracks.read(z, rimflow::LengthUnit::Auto, snapshot, warnings);
    if (i == 0) std::printf("first snapshot after %.3f s, %zu particles\n", seconds(begin), snapshot.size());
    sum += seconds(start);
    longest = std::max(longest, seconds(start));
    bytes += double(tracks.zones()[z].end - tracks.zones()[z].begin);
  }
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  std::printf("%d snapshots in random order: mean %.3f s, longest %.3f s, %.0f MB/s; peak memory %ld MB\n",
              Reads, sum / Reads, longest, bytes / sum * 1e-6, usage.ru_maxrss / 1024);
  for (const std::string& w : warnings) std::printf("warning: %s\n", w.c_str());
  return 0;
}

} // namespace

int main(int argc, char** argv) {
  if (argc == 2 && std::strncmp(argv[1], "--file=", 7) == 0) return givenFiles(argv[1] + 7);
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
