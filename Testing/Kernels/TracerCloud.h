#pragma once
#include <Eigen/Core>
#include <functional>
#include <random>
#include <vector>

/// Three random numbers, drawn in the order z, y, x on every compiler; that of a call's arguments is up to
/// it.
template <class Distribution>
Eigen::Vector3d threeOf(Distribution& distribution, std::mt19937& random) {
  Eigen::Vector3d out;
  for (int a = 2; a >= 0; --a) out[a] = distribution(random);
  return out;
}

/// Random tracers around a sphere that is or is not there: the process that the void likelihood assumes.
struct TracerCloud {
  double density = 0.4e9; ///< 1/m3
  double diameter = 11.11e-3;
  double noise = 5e-6;   ///< of a position, m
  double ghosts = 0.005; ///< density inside over density outside
  Eigen::Vector3d lower{-0.018, -0.018, -0.0125}, upper{0.018, 0.018, 0.0125};
  /// Seeding at x for a sphere at c, relative to `density`, 0 to 1.
  std::function<double(const Eigen::Vector3d& x, const Eigen::Vector3d& c)> seeding;
  bool sphere = true;

  std::vector<float> positions(const Eigen::Vector3d& centre, unsigned seed) const {
    std::mt19937 random(seed);
    std::uniform_real_distribution<double> uniform(0, 1);
    std::normal_distribution<double> normal(0, 1);
    const Eigen::Vector3d size = upper - lower;
    const int n = std::poisson_distribution<int>(density * size.prod())(random);
    std::vector<float> out;
    for (int i = 0; i < n; ++i) {
      Eigen::Vector3d x = lower + size.cwiseProduct(threeOf(uniform, random));
      double share = seeding ? seeding(x, centre) : 1;
      if (sphere && (x - centre).norm() < 0.5 * diameter) share = ghosts;
      if (uniform(random) > share) continue;
      x += noise * threeOf(normal, random);
      for (int a = 0; a < 3; ++a) out.push_back(float(x[a]));
    }
    return out;
  }
};

/// A place between two corners, from a seed.
inline Eigen::Vector3d placeBetween(const Eigen::Vector3d& lower, const Eigen::Vector3d& upper,
                                    unsigned seed) {
  std::mt19937 random(seed * 7919 + 1);
  std::uniform_real_distribution<double> uniform(0, 1);
  return lower + (upper - lower).cwiseProduct(threeOf(uniform, random));
}
