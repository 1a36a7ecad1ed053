// Fails when the pressure from a known gradient is less accurate than it can be, when the iterations grow
// with the grid, when regions or nodes without fluid have no defined answer, or when its error is not
// estimated.
#include "FluidRegions.h"
#include "OneShotPressure.h"
#include "PressureCases.h"
#include "PressureError.h"
#include "PressureGradient.h"

#include <gtest/gtest.h>
#include <omp.h>

using namespace rimflow;

namespace {

TEST(OneShotPressure, TaylorGreenAndABC) {
  for (PressureField field : {PressureField::TaylorGreen, PressureField::ABC})
    for (std::array<int, 3> nodes : {std::array<int, 3>{64, 64, 64}, {160, 109, 36}}) {
      const PressureCase clean = pressureCase({field, nodes, 16, GradientNoise::None}),
                         noisy = pressureCase({field, nodes, 16, GradientNoise::White});
      const PressureErrors errors = pressureErrors(clean, oneShotPressure(clean.problem()).pressure);
      EXPECT_LT(errors.all, 5e-5);
      EXPECT_LT(errors.wall, 5e-5);
      EXPECT_LT(pressureErrors(noisy, oneShotPressure(noisy.problem()).pressure).all, 2.5e-3);
    }
}

TEST(OneShotPressure, CorrelatedNoiseIsNoWorseThanWithTrapezoids) {
  const PressureCase test =
      pressureCase({PressureField::TaylorGreen, {64, 64, 64}, 16, GradientNoise::Correlated});
  OneShotOptions trapezoid;
  trapezoid.order = 2;
  EXPECT_LT(pressureErrors(test, oneShotPressure(test.problem()).pressure).all,
            1.01 * pressureErrors(test, oneShotPressure(test.problem(), trapezoid).pressure).all);
}

TEST(OneShotPressure, IterationsDoNotGrowWithTheGrid) {
  const auto iterations = [](int n, double mask) {
    return oneShotPressure(
               pressureCase({PressureField::TaylorGreen, {n, n, n}, mask, GradientNoise::White}).problem())
        .iterations;
  };
  EXPECT_LE(iterations(32, 0), 2); // the preconditioner is the inverse
  EXPECT_LE(iterations(48, 12), 20);
  EXPECT_LE(iterations(96, 24), iterations(48, 12) + 3);
}

TEST(OneShotPressure, AnisotropicGridAndOrders) {
  Grid g{{0, 0, 0}, {0.5, 1, 2}, {40, 20, 10}};
  std::vector<float> gradient(3 * g.size());
  std::vector<double> exact(g.size());
  for (int k = 0; k < g.n[2]; ++k)
    for (int j = 0; j < g.n[1]; ++j)
      for (int i = 0; i < g.n[0]; ++i) {
        const auto x = g.position(i, j, k);
        const std::size_t p = g.index(i, j, k);
        exact[p] = x[0] * x[0] * x[0] + x[1] * x[2];
        gradient[3 * p] = float(3 * x[0] * x[0]), gradient[3 * p + 1] = float(x[2]),
                     gradient[3 * p + 2] = float(x[1]);
      }
  double mean = 0, range = 8000;
  for (double e : exact) mean += e / double(g.size());
  const PressureSolution r = oneShotPressure({g, gradient.data(), nullptr});
  EXPECT_EQ(r.regions, 1);
  for (std::size_t p = 0; p < exact.size(); ++p)
    ASSERT_NEAR(r.pressure[p], exact[p] - mean, 2e-6 * range) << "at node " << p;
}

// A wall of two layers cuts the box in two; beside it a single node without neighbours and an empty one.
TEST(OneShotPressure, RegionsHaveTheirOwnConstants) {
  PressureCase test = pressureCase({PressureField::TaylorGreen, {48, 32, 24}, 0});
  const Grid& g = test.grid;
  const auto mask = [&](int i, int j, int k, int value) { test.mask[g.index(i, j, k)] = value; };
  for (int k = 0; k < g.n[2]; ++k)
    for (int j = 0; j < g.n[1]; ++j) mask(30, j, k, 1), mask(31, j, k, 1);
  for (int d : {-1, 1}) mask(10 + d, 10, 10, 1), mask(10, 10 + d, 10, 1), mask(10, 10, 10 + d, 1);
  for (int c = 0; c < 3; ++c)
    for (std::size_t p = 0; p < g.size(); ++p)
      if (test.mask[p]) test.gradient[3 * p + c] = std::nanf("");
  const PressureSolution r = oneShotPressure(test.problem());
  ASSERT_EQ(r.regions, 3);
  EXPECT_EQ(r.region[g.index(0, 0, 0)], 0); // the largest
  EXPECT_EQ(r.region[g.index(47, 0, 0)], 1);
  EXPECT_EQ(r.region[g.index(10, 10, 10)], 2);
  EXPECT_EQ(r.region[g.index(30, 0, 0)], -1);
  EXPECT_EQ(r.pressure[g.index(30, 0, 0)], 0);
  EXPECT_EQ(r.pressure[g.index(10, 10, 10)], 0);
  for (int region : {0, 1}) {
    double n = 0, exact = 0, sum = 0, worst = 0;
    for (std::size_t p = 0; p < g.size(); ++p)
      if (r.region[p] == region) n += 1, exact += test.exact[p], sum += r.pressure[p];
    EXPECT_NEAR(sum / n, 0, 1e-6);
    for (std::size_t p = 0; p < g.size(); ++p)
      if (r.region[p] == region)
        worst = std::max(worst, std::abs(r.pressure[p] - (test.exact[p] - exact / n)));
    EXPECT_LT(worst, 2e-3);
  }
}

TEST(OneShotPressure, SameResultForAnyNumberOfThreads) {
  const PressureCase test = pressureCase({PressureField::ABC, {40, 30, 20}, 10, GradientNoise::White});
  const int threads = omp_get_max_threads();
  omp_set_num_threads(1);
  const auto one = oneShotPressure(test.problem()).pressure;
  omp_set_num_threads(3);
  EXPECT_EQ(oneShotPressure(test.problem()).pressure, one);
  omp_set_num_threads(threads);
}

// What a reconstruction does: errors next to the wall that have no curl along it, but are not those of noise.
TEST(OneShotPressure, WrongGradientsAtTheWallStayThere) {
  PressureCase test = pressureCase({PressureField::TaylorGreen, {48, 48, 48}, 16});
  const Grid& g = test.grid;
  const double c = 23.5;
  for (int k = 0; k < 48; ++k)
    for (int j = 0; j < 48; ++j)
      for (int i = 0; i < 48; ++i) {
        const double x = i - c, y = j - c, z = k - c, r = std::sqrt(x * x + y * y + z * z);
        if (r < 9) test.gradient[3 * g.index(i, j, k)] += float(0.2 * y / r);
      }
  OneShotOptions even;
  even.wallWeight = 1;
  EXPECT_LT(pressureErrors(test, oneShotPressure(test.problem()).pressure).all,
            0.5 * pressureErrors(test, oneShotPressure(test.problem(), even).pressure).all);
}

TEST(OneShotPressure, RefusesWhatCannotBeSolvedAndStopsWhenAsked) {
  PressureCase test = pressureCase({PressureField::TaylorGreen, {8, 8, 8}, 0});
  OneShotOptions options;
  options.order = 3;
  EXPECT_THROW(oneShotPressure(test.problem(), options), std::invalid_argument);
  options = {};
  options.tolerance = 0;
  EXPECT_THROW(oneShotPressure(test.problem(), options), std::invalid_argument);
  options = {};
  options.wallWeight = 0;
  EXPECT_THROW(oneShotPressure(test.problem(), options), std::invalid_argument);
  EXPECT_TRUE(oneShotPressure(test.problem(), {}, [](double) { return false; }).aborted);
  test.mask.assign(test.grid.size(), 1);
  EXPECT_THROW(oneShotPressure(test.problem()), std::invalid_argument);
}

TEST(OneShotPressure, NothingToIntegrate) {
  const Grid line{{0, 0, 0}, {1, 1, 1}, {5, 1, 1}};
  const std::vector<float> zero(15, 0), one(15, 1);
  for (float p : oneShotPressure({line, zero.data(), nullptr}).pressure) EXPECT_EQ(p, 0);
  const auto p = oneShotPressure({line, one.data(), nullptr}).pressure;
  for (int i = 0; i < 5; ++i) EXPECT_NEAR(p[i], i - 2, 1e-5);
}

TEST(PressureError, IsThatOfTheNoise) {
  for (GradientNoise noise : {GradientNoise::White, GradientNoise::Correlated}) {
    const PressureCase test = pressureCase({PressureField::TaylorGreen, {64, 64, 64}, 16, noise});
    const auto pressure = oneShotPressure(test.problem()).pressure;
    const auto sigma = pressureError(test.problem(), pressure.data());
    double square = 0, fluid = 0;
    for (std::size_t p = 0; p < sigma.size(); ++p)
      if (!test.mask[p]) square += sigma[p] * sigma[p], fluid += 1;
    const double predicted = std::sqrt(square / fluid), found = pressureErrors(test, pressure).all;
    EXPECT_GT(predicted, 0.75 * found);
    EXPECT_LT(predicted, 1.33 * found);
  }
}

TEST(PressureError, IsLargerWhereTheNoiseIs) {
  PressureCase test = pressureCase({PressureField::TaylorGreen, {96, 32, 32}, 0, GradientNoise::White});
  const PressureCase clean = pressureCase({PressureField::TaylorGreen, {96, 32, 32}, 0});
  const Grid& g = test.grid;
  for (std::size_t p = 0; p < g.size(); ++p)
    if (p % 96 < 48)
      for (int c = 0; c < 3; ++c) test.gradient[3 * p + c] = clean.gradient[3 * p + c];
  const auto pressure = oneShotPressure(test.problem()).pressure;
  const auto sigma = pressureError(test.problem(), pressure.data());
  EXPECT_GT(sigma[g.index(80, 16, 16)], 3 * sigma[g.index(16, 16, 16)]);
}

// Solid-body rotation has centripetal acceleration only; a parabolic profile needs the viscous part.
TEST(PressureGradient, EulerAndViscousPart) {
  const Grid g{{0, 0, 0}, {0.1, 0.1, 0.1}, {9, 9, 9}};
  std::vector<float> u(3 * g.size(), 0), a(3 * g.size(), 0);
  std::vector<unsigned char> mask(g.size(), 0);
  for (int k = 0; k < 9; ++k)
    for (int j = 0; j < 9; ++j)
      for (int i = 0; i < 9; ++i) {
        const std::size_t p = g.index(i, j, k);
        u[3 * p] = float(0.01 * j * j - 0.02 * k * k); // lap u = 2 - 4
        a[3 * p + 1] = 3;
        mask[p] = i == 4 && j == 4 && k == 4;
        if (mask[p]) u[3 * p] = 1e6f; // never looked at
      }
  const auto gradient = pressureGradient(g, u.data(), a.data(), mask.data(), 2, 0.5);
  for (std::size_t p = 0; p < g.size(); ++p) {
    if (mask[p]) {
      EXPECT_EQ(gradient[3 * p], 0);
      continue;
    }
    EXPECT_NEAR(gradient[3 * p], -2 * (0 - 0.5 * -2), 1e-3);
    EXPECT_NEAR(gradient[3 * p + 1], -6, 1e-5);
  }
  for (float v : pressureGradient(g, nullptr, a.data(), nullptr, 1, 0.5)) EXPECT_TRUE(v == 0 || v == -3);
}

} // namespace
