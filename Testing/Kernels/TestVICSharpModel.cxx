// Breaks when the gradient of the VIC# cost is not the exact adjoint of its value, or the cost differs from
// the reference.
#include "VICSharpModel.h"

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
    double alpha, nu, bu, bw, bd, bn, bc;
    int order;
    bool precondition;
    double wall = 0; // radius of a sphere
  };
  for (const Case& c : {Case{"velocity only", 0, 0, 0, 0, 0, 0, 0, 2, false},
                        Case{"velocity, smooth", 0, 0.01, .6, .5, 0, 0, .3, 4, true},
                        Case{"accelerations", 1, 0, 0, 0, 0, 0, 0, 2, true},
                        Case{"viscous", 0.7, 0.01, 0, 0, 0, 0, 0, 4, false},
                        Case{"Navier-Stokes without accelerations", 0, 0.01, .6, .5, .4, .8, .1, 4, true},
                        Case{"all, order 2", 0.7, 0.01, 0.6, 0.5, 0.4, 0.8, 0.3, 2, true},
                        Case{"all, order 4", 0.7, 0.01, 0.6, 0.5, 0.4, 0.8, 0.3, 4, true},
                        Case{"all, with a wall", 0.7, 0.01, 0.6, 0.5, 0.4, 0.8, 0.3, 4, true, 0.2}}) {
    VICSharpConstants k;
    k.viscosity = c.nu, k.particleSpacing = 0.2, k.velocityScale = 1.1, k.accelerationScale = 4.7;
    k.accelerationWeight = c.alpha, k.divergenceWeight = c.bu, k.vorticityDivergenceWeight = c.bw;
    k.accelerationDivergenceWeight = c.bd, k.navierStokesWeight = c.bn, k.curvatureWeight = c.bc;
    k.order = c.order, k.precondition = c.precondition;
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
