// Breaks when the gradient of the VIC# cost is not the exact adjoint of its value, or the cost differs from
// the reference; when the velocity has sources or a solution is not carried over to another model.
#include "VICSharpModel.h"

#include <algorithm>
#include <cmath>
#include <gtest/gtest.h>
#include <random>

using namespace rimflow;

namespace {

VICSharpData someData(const Grid& grid, int count) {
  std::mt19937 random(1);
  std::uniform_real_distribution<double> place(0.02, 0.98);
  std::normal_distribution<double> noise;
  VICSharpData data;
  for (int p = 0; p < count; ++p)
    for (int a = 0; a < 3; ++a) {
      data.position.push_back(grid.origin[a] + place(random) * (grid.n[a] - 1) * grid.spacing[a]);
      data.velocity.push_back(noise(random));
      data.acceleration.push_back(5 * noise(random));
    }
  data.meanVelocity = {1, 0.2, -0.1};
  return data;
}

} // namespace

TEST(VICSharpModel, GradientIsTheExactAdjoint) {
  const Grid grid{{0.1, -0.2, 0}, {0.1, 0.12, 0.09}, {9, 8, 10}};
  VICSharpData data = someData(grid, 60);
  struct Case {
    const char* name;
    double alpha, nu, bc;
    int order;
    double wall = 0; // radius of a sphere
  };
  for (const Case& c : {Case{"velocity only", 0, 0, 0, 2}, Case{"velocity, smooth", 0, 0, .3, 4},
                        Case{"accelerations, order 2", 1, 0, 0, 2}, Case{"viscous", 0.7, 0.01, 0, 4},
                        Case{"all", 0.7, 0.01, 0.3, 4}, Case{"all, with a wall", 0.7, 0.01, 0.3, 4, 0.2}}) {
    VICSharpConstants k;
    k.viscosity = c.nu, k.particleSpacing = 0.2, k.velocityScale = 1.1, k.accelerationScale = 4.7;
    k.accelerationWeight = c.alpha, k.curvatureWeight = c.bc, k.order = c.order;
    if (c.wall > 0)
      k.distance = [&](double x, double y, double z) {
        return std::hypot(x - 0.5, y - 0.2, z - 0.4) - c.wall;
      };
    VICSharpModel<double> model(grid, data, k);
    std::mt19937 random(2);
    std::normal_distribution<double> noise;
    std::vector<double> x(model.size()), direction(model.size()), g(model.size()), unused(model.size());
    for (double& v : x) v = noise(random);
    for (double& v : direction) v = noise(random);
    model.cost(x, g);
    double slope = 0;
    for (std::size_t i = 0; i < x.size(); ++i) slope += g[i] * direction[i];
    double best = 1;
    for (double step : {1e-3, 1e-4, 1e-5}) {
      auto moved = [&](double t) {
        auto y = x;
        for (std::size_t i = 0; i < x.size(); ++i) y[i] += t * direction[i];
        return model.cost(y, unused);
      };
      best = std::min(best, std::abs((moved(step) - moved(-step)) / (2 * step) / slope - 1));
    }
    EXPECT_LT(best, 1e-8) << c.name;
  }
}

TEST(VICSharpModel, TheVelocityHasNoSources) {
  const Grid grid{{0, 0, 0}, {0.1, 0.1, 0.1}, {9, 8, 10}};
  const VICSharpData data = someData(grid, 60);
  VICSharpConstants k;
  k.particleSpacing = 0.2, k.velocityScale = 1.1, k.accelerationScale = 4.7;
  VICSharpModel<double> model(grid, data, k);
  std::mt19937 random(2);
  std::normal_distribution<double> noise;
  std::vector<double> x(model.size()), row(grid.n[0]), term(grid.n[0]);
  for (double& v : x) v = noise(random);
  model.forward(x);
  const Stencils<double> stencils(grid, k.order);
  double divergence = 0, gradient = 0;
  for (int z = 0; z < grid.n[2]; ++z)
    for (int y = 0; y < grid.n[1]; ++y) {
      std::fill(row.begin(), row.end(), 0.);
      for (int i = 0; i < 3; ++i) {
        stencils.derivative(model.velocity()[i].data(), i, y, z, term.data());
        for (int e = 0; e < grid.n[0]; ++e) row[e] += term[e], gradient += term[e] * term[e];
      }
      for (double d : row) divergence += d * d;
    }
  EXPECT_LT(std::sqrt(divergence / gradient), 1e-12); // at the faces, too
}

TEST(VICSharpModel, ASolutionIsCarriedOver) {
  const Grid grid{{0, 0, 0}, {0.1, 0.1, 0.1}, {9, 8, 10}};
  VICSharpData data = someData(grid, 60);
  VICSharpConstants k;
  k.viscosity = 0.01, k.particleSpacing = 0.2, k.velocityScale = 1.1, k.accelerationScale = 4.7;
  k.distance = [](double x, double y, double z) { return std::hypot(x - 0.5, y - 0.4, z - 0.4) - 0.2; };
  VICSharpModel<double> model(grid, data, k);
  std::mt19937 random(2);
  std::normal_distribution<double> noise;
  std::vector<double> x(model.size());
  for (double& v : x) v = noise(random);
  model.forward(x);
  const auto u = model.velocity(), a = model.acceleration();
  data.meanVelocity = {0.4, 0.1, -0.3};
  k.curvatureWeight = 0.2, k.velocityScale = 0.8;
  VICSharpModel<double> other(grid, data, k);
  other.forward(other.unknowns(model.state()));
  const double shift[3] = {0.6, 0.1, 0.2}; // 1, 0.2, -0.1 less the new mean
  for (int i = 0; i < 3; ++i)
    for (std::size_t e = 0; e < grid.size(); ++e) {
      ASSERT_NEAR(other.velocity()[i][e], u[i][e] + shift[i], 1e-9);
      ASSERT_NEAR(other.acceleration()[i][e], a[i][e], 1e-7);
    }
}
