// Breaks when a hole among the particles is missed, misplaced, or seen where there is none.
#include "VoidDistance.h"

#include <cmath>
#include <gtest/gtest.h>
#include <random>

using namespace rimflow;

namespace {

constexpr int N = 41;
const Grid Nodes{{-20, -20, -20}, {1, 1, 1}, {N, N, N}};
constexpr double Spacing = 2; // of the particles

std::vector<double> particles(double hole) {
  std::mt19937 random(3);
  std::uniform_real_distribution<double> place(-20, 20);
  std::vector<double> x;
  for (int p = 0; p < 8000; ++p) {
    const double q[3] = {place(random), place(random), place(random)};
    if (std::hypot(q[0], q[1], q[2]) > hole) x.insert(x.end(), q, q + 3);
  }
  return x;
}

} // namespace

TEST(VoidDistance, ARandomCloudHasNone) {
  EXPECT_TRUE(voidDistance(particles(0), Nodes, 1.8 * Spacing).empty());
}

TEST(VoidDistance, ASphereIsFoundToAPartOfTheParticleSpacing) {
  const double hole = 8;
  const auto distance = voidDistance(particles(hole), Nodes, 1.8 * Spacing);
  ASSERT_EQ(distance.size(), Nodes.size());
  double sum = 0, count = 0;
  for (int k = 0; k < N; ++k)
    for (int j = 0; j < N; ++j)
      for (int i = 0; i < N; ++i) {
        const auto x = Nodes.position(i, j, k);
        const double r = std::hypot(x[0], x[1], x[2]);
        const float d = distance[Nodes.index(i, j, k)];
        if (r < hole - 1) {
          EXPECT_LT(d, 0) << r;
        }
        if (r > hole + Spacing) {
          EXPECT_GT(d, 0) << r;
        }
        if (r < hole - 3 || r > hole + 3) continue;
        sum += std::abs(d - (r - hole));
        ++count;
      }
  EXPECT_LT(sum / count, 0.4 * Spacing);
}
