// The published cost on the paper's typical case: a sphere of 11.11 mm among 90,000 particles, the flow on
// 160 x 109 x 36 nodes. "criteria" is one evaluation as a caller gets it, "criteriaByNode" the same as it is
// defined; "search" is a whole snapshot.
#include "PublishedCost.h"
#include "PublishedCriteriaByNode.h"
#include "SideBySide.h"

#include <random>

using namespace rimflow;
using Eigen::Vector3d;

namespace {

constexpr double Diameter = 11.11e-3, Speed = 0.35;
const Vector3d Centre(0.004, -0.007, 0.002);

/// Potential flow around the rising sphere, at rest inside; Q as in a vortex ring's place.
struct Scene {
  Grid grid{{-0.055, -0.0375, -0.0124}, {0.689e-3, 0.689e-3, 0.689e-3}, {160, 109, 36}};
  std::vector<float> velocity, q, positions;
  PublishedCostOptions options;

  Scene() {
    for (int k = 0; k < grid.n[2]; ++k)
      for (int j = 0; j < grid.n[1]; ++j)
        for (int i = 0; i < grid.n[0]; ++i) {
          const auto p = grid.position(i, j, k);
          const Vector3d r = Vector3d(p[0], p[1], p[2]) - Centre, e = r.normalized();
          const double x = 0.5 * Diameter / r.norm();
          const Vector3d u = x < 1 ? Vector3d(0.5 * Speed * x * x * x * (3 * e.y() * e - Vector3d::UnitY()))
                                   : Vector3d(0, Speed, 0);
          for (int a = 0; a < 3; ++a) velocity.push_back(float(u[a]));
          q.push_back(float(x < 1 ? 1e3 * x * x * (1.5 * e.y() * e.y() - 0.4) : -200));
        }
    std::mt19937 random(1);
    std::uniform_real_distribution<double> uniform(-0.5, 0.5);
    while (positions.size() < 3 * 90000) {
      const Vector3d x(0.110 * uniform(random), 0.075 * uniform(random), 0.025 * uniform(random));
      if ((x - Centre).norm() < 0.5 * Diameter) continue;
      for (int a = 0; a < 3; ++a) positions.push_back(float(x[a]));
    }
    options.diameter = Diameter;
  }
  FlowField flow() const { return {grid, velocity.data(), q.data(), nullptr}; }
};

const Scene& scene() {
  static const Scene s;
  return s;
}

const ParticleIndex& index() {
  static const ParticleIndex all(scene().positions.data(), scene().positions.size() / 3);
  return all;
}

template <class Evaluate>
void evaluate(benchmark::State& state, Evaluate&& criteria) {
  PublishedCostOptions options = scene().options;
  options.velocityScale = Speed, options.vortexScale = 1e3, options.seedingDensity = 4e8;
  const ParticleIndex& all = index();
  for (auto _ : state)
    benchmark::DoNotOptimize(criteria(all, scene().flow(), Centre + Vector3d(4e-4, 3e-4, -2e-4), options));
}

void criteria(benchmark::State& state) { evaluate(state, publishedCriteria); }
void criteriaByNode(benchmark::State& state) { evaluate(state, publishedCriteriaByNode); }

void search(benchmark::State& state) {
  const ParticleIndex& all = index();
  for (auto _ : state)
    benchmark::DoNotOptimize(
        minimisePublishedCost(all, scene().flow(), Centre + Vector3d(1e-3, -2e-3, 1e-3), scene().options));
}

} // namespace

BENCHMARK(criteria)->Unit(benchmark::kMillisecond)->UseRealTime();
BENCHMARK(criteriaByNode)->Unit(benchmark::kMillisecond)->UseRealTime();
BENCHMARK(search)->Unit(benchmark::kMillisecond)->UseRealTime();

int main(int argc, char** argv) { return rimflow::runSideBySide(argc, argv, "criteria"); }
