#pragma once
#include <algorithm>
#include <benchmark/benchmark.h>
#include <cstdio>
#include <map>
#include <string>
#include <vector>

namespace rimflow {

/// Runs the registered benchmarks, alternately (random interleaving), and prints below Google Benchmark's
/// table how much slower each is than `ours`, as the ratio of the medians of all repetitions.
inline int runSideBySide(int argc, char** argv, const std::string& ours) {
  struct Reporter : benchmark::ConsoleReporter {
    std::map<std::string, std::vector<double>> times; // in the unit of the benchmark
    void ReportRuns(const std::vector<Run>& runs) override {
      for (const Run& run : runs)
        if (run.run_type == Run::RT_Iteration && !run.error_occurred)
          times[run.run_name.function_name].push_back(run.GetAdjustedRealTime());
    }
  };
  std::vector<char*> arguments(argv, argv + argc);
  std::string interleaving = "--benchmark_enable_random_interleaving=true";
  arguments.insert(arguments.begin() + 1, interleaving.data()); // the user's own flags come later and win
  int count = int(arguments.size());
  benchmark::Initialize(&count, arguments.data());
  if (benchmark::ReportUnrecognizedArguments(count, arguments.data())) return 1;
  Reporter reporter;
  benchmark::RunSpecifiedBenchmarks(&reporter);
  const auto median = [](std::vector<double> t) {
    std::nth_element(t.begin(), t.begin() + t.size() / 2, t.end());
    return t[t.size() / 2];
  };
  const auto reference = reporter.times.find(ours);
  std::printf("%-45s %10s %10s %10s %10s\n", "", "median", "fastest", "runs", "times ours");
  for (const auto& [name, times] : reporter.times)
    std::printf("%-45s %10.3f %10.3f %10zu %10.2f\n", name.c_str(), median(times),
                *std::min_element(times.begin(), times.end()), times.size(),
                reference == reporter.times.end() ? 0 : median(times) / median(reference->second));
  return 0;
}

} // namespace rimflow
