// Breaks when the gradient of the VIC# cost is not the exact adjoint of its value, when the velocity has
// sources or a solution is not carried over to another model.
#include "VICSharpModel.h"

#include <algorithm>
#include <cmath>
#include <gtest/gtest.h>
#include <omp.h>
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

VICSharpConstants someConstants() {
  VICSharpConstants k;
  k.particleSpacing = 0.2, k.velocityScale = 1.1, k.accelerationScale = 4.7;
  return k;
}

template <class Real>
std::vector<Real> someUnknowns(const VICSharpModel<Real>& model) {
  std::mt19937 random(2);
  std::normal_distribution<Real> noise;
  std::vector<Real> x(model.size());
  for (Real& v : x) v = noise(random);
  return x;
}

} // namespace

TEST(VICSharpModel, GradientIsTheExactAdjoint) {
  const Grid box{{0.1, -0.2, 0}, {0.1, 0.12, 0.09}, {9, 8, 10}}, small{{0, 0, 0}, {0.1, 0.1, 0.1}, {5, 5, 5}},
      flat{{0, 0, 0}, {0.1, 0.1, 0.1}, {5, 19, 7}};
  struct Case {
    const char* name;
    double alpha, nu, bc;
    int order;
    Grid grid;
    double wall = 0; // radius of a sphere
    bool weights = false;
    double outlier = 0;
  };
  for (const Case& c :
       {Case{"velocity only", 0, 0, 0, 2, box}, Case{"velocity, smooth", 0, 0, .3, 4, box},
        Case{"accelerations, order 2", 1, 0, 0, 2, box}, Case{"viscous", 0.7, 0.01, 0, 4, box},
        Case{"all", 0.7, 0.01, 0.3, 4, box}, Case{"all, with a wall", 0.7, 0.01, 0.3, 4, box, 0.2},
        Case{"a wall that meets the faces", 0.7, 0.01, 0.3, 4, box, 0.45},
        Case{"weights and outliers", 0.7, 0.01, 0.3, 4, box, 0, true, 0.5},
        Case{"smallest grid", 0.7, 0.01, 0.3, 4, small}, Case{"flat grid", 0.7, 0.01, 0.3, 4, flat, 0.3}}) {
    const Grid& grid = c.grid;
    VICSharpData data = someData(grid, 60);
    for (int p = 0; p < 60 && c.weights; ++p) {
      data.velocityWeight.push_back(p % 3);
      data.accelerationWeight.push_back(0.5 * (p % 2));
    }
    VICSharpConstants k;
    k.viscosity = c.nu, k.particleSpacing = 0.2, k.velocityScale = 1.1, k.accelerationScale = 4.7;
    k.accelerationWeight = c.alpha, k.curvatureWeight = c.bc, k.order = c.order;
    k.velocityOutlier = c.outlier, k.accelerationOutlier = 5 * c.outlier;
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
    EXPECT_LT(best, 1e-7) << c.name;
  }
}

TEST(VICSharpModel, TheVelocityHasNoSources) {
  const Grid grid{{0, 0, 0}, {0.1, 0.1, 0.1}, {9, 8, 10}};
  const VICSharpData data = someData(grid, 60);
  const VICSharpConstants k = someConstants();
  VICSharpModel<double> model(grid, data, k);
  std::vector<double> row(grid.n[0]), term(grid.n[0]);
  model.forward(someUnknowns(model));
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
  VICSharpConstants k = someConstants();
  k.viscosity = 0.01;
  k.distance = [](double x, double y, double z) { return std::hypot(x - 0.5, y - 0.4, z - 0.4) - 0.2; };
  VICSharpModel<double> model(grid, data, k);
  model.forward(someUnknowns(model));
  const auto u = model.velocity(), a = model.acceleration();
  k.curvatureWeight = 0.2, k.velocityScale = 0.8;
  VICSharpModel<double> other(grid, data, k);
  other.forward(other.unknowns(model.state()));
  for (int i = 0; i < 3; ++i)
    for (std::size_t e = 0; e < grid.size(); ++e) {
      ASSERT_NEAR(other.velocity()[i][e], u[i][e], 1e-9);
      ASSERT_NEAR(other.acceleration()[i][e], a[i][e], 1e-7);
    }
}

TEST(VICSharpModel, APressureWithoutSourcesIsThatOfTheBoundary) {
  const Grid grid{{0, 0, 0}, {0.1, 0.1, 0.1}, {13, 12, 14}};
  const VICSharpData data = someData(grid, 60);
  const VICSharpConstants k = someConstants();
  VICSharpModel<double> model(grid, data, k);
  VICSharpModel<double>::State state{grid, {}, {}, {}};
  for (auto& component : state.potential) component.assign(grid.size(), 0);
  for (std::size_t e = 0; e < grid.size(); ++e) {
    const auto x = grid.position(int(e % 13), int(e / 13 % 12), int(e / 13 / 12));
    state.pressure.push_back(3 + x[0] - 2 * x[1] + x[1] * x[2]);
  }
  model.forward(model.unknowns(state));
  for (std::size_t e = 0; e < grid.size(); ++e) ASSERT_NEAR(model.pressure()[e], state.pressure[e], 1e-6);
}

TEST(VICSharpModel, DoesNotDependOnTheNumberOfThreads) {
  const Grid grid{{0, 0, 0}, {0.1, 0.1, 0.1}, {21, 18, 15}};
  const VICSharpData data = someData(grid, 300);
  const VICSharpConstants k = someConstants();
  std::vector<float> gradients[3];
  double values[3];
  const int threads[3] = {1, 2, 5};
  for (int t = 0; t < 3; ++t) {
    omp_set_num_threads(threads[t]);
    VICSharpModel<float> model(grid, data, k);
    const std::vector<float> x = someUnknowns(model);
    gradients[t].resize(x.size());
    values[t] = model.cost(x, gradients[t]);
  }
  for (int t : {1, 2}) {
    EXPECT_EQ(values[t], values[0]);
    EXPECT_EQ(gradients[t], gradients[0]);
  }
}
