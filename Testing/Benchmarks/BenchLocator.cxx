// The locator on the paper's typical case: 110 x 75 x 25 mm, 0.4 particles per mm3, a sphere of 11.11 mm.
// "track" is what each snapshot costs once the sphere is known: index, seeding density and likelihood;
// "capture" finds it without a guess.
#include "SphereCapture.h"

#include <benchmark/benchmark.h>
#include <random>

using namespace rimflow;

namespace {

constexpr double Diameter = 11.11e-3;
const Eigen::Vector3d Centre(0.004, -0.007, 0.002);

const std::vector<float>& particles() {
  static std::vector<float> positions;
  if (!positions.empty()) return positions;
  std::mt19937 random(1);
  std::uniform_real_distribution<double> uniform(-0.5, 0.5);
  std::normal_distribution<double> noise(0, 5e-6);
  while (positions.size() < 3 * 90000) {
    const Eigen::Vector3d x(0.110 * uniform(random), 0.075 * uniform(random), 0.025 * uniform(random));
    if ((x - Centre).norm() < 0.5 * Diameter && uniform(random) > -0.495) continue; // 0.5 % ghosts
    for (int a = 0; a < 3; ++a) positions.push_back(float(x[a] + noise(random)));
  }
  return positions;
}

VoidLikelihoodOptions sphere() {
  VoidLikelihoodOptions options;
  options.diameter = Diameter;
  return options;
}

void index(benchmark::State& state) {
  for (auto _ : state)
    benchmark::DoNotOptimize(ParticleIndex(particles().data(), particles().size() / 3).size());
}

void seedingDensity(benchmark::State& state) {
  const ParticleIndex all(particles().data(), particles().size() / 3);
  for (auto _ : state) benchmark::DoNotOptimize(SeedingDensity(all, 0.25 * Diameter).mean());
}

void track(benchmark::State& state) {
  for (auto _ : state) {
    const ParticleIndex all(particles().data(), particles().size() / 3);
    SeedingDensity seeding(all, 0.25 * Diameter);
    const VoidEstimate found =
        locateVoid(all, seeding, Centre + Eigen::Vector3d(5e-4, -5e-4, 3e-4), sphere());
    state.counters["error_um"] = 1e6 * (found.centre - Centre).norm();
  }
}

void capture(benchmark::State& state) {
  for (auto _ : state) {
    const ParticleIndex all(particles().data(), particles().size() / 3);
    SeedingDensity seeding(all, 0.25 * Diameter);
    const CaptureResult found = captureSphere(all, seeding, sphere());
    state.counters["error_um"] = 1e6 * (found.centre - Centre).norm();
  }
}

} // namespace

BENCHMARK(index)->Unit(benchmark::kMillisecond)->UseRealTime();
BENCHMARK(seedingDensity)->Unit(benchmark::kMillisecond)->UseRealTime();
BENCHMARK(track)->Unit(benchmark::kMillisecond)->UseRealTime();
BENCHMARK(capture)->Unit(benchmark::kMillisecond)->UseRealTime();
BENCHMARK_MAIN();
