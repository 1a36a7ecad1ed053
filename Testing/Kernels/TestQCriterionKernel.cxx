// Breaks when Q, vorticity, lambda2 or divergence of a polynomial field are not exact, at a face or at the
// mask.
#include "QCriterionKernel.h"

#include <cmath>
#include <gtest/gtest.h>
#include <limits>
#include <random>
#include <vector>

using namespace rimflow;

namespace {

struct Case {
  Grid grid;
  std::vector<float> velocity, q, vorticity, lambda2, divergence;
  std::vector<unsigned char> mask;

  template <class F>
  explicit Case(F&& u, std::array<int, 3> n = {9, 8, 7}) : grid{{0.1, -0.2, 0.3}, {0.1, 0.2, 0.15}, n} {
    mask.assign(grid.size(), 0);
    for (int k = 0; k < grid.n[2]; ++k)
      for (int j = 0; j < grid.n[1]; ++j)
        for (int i = 0; i < grid.n[0]; ++i)
          for (double c : u(grid.position(i, j, k))) velocity.push_back(float(c));
    q.assign(grid.size(), -1);
    lambda2 = divergence = q;
    vorticity.assign(3 * grid.size(), -1);
  }
  void run(int order, bool useMask = false) {
    ASSERT_TRUE(qCriterion(grid, velocity.data(), useMask ? mask.data() : nullptr, order,
                           {q.data(), vorticity.data(), lambda2.data(), divergence.data()}));
  }
};

// u = (a x y, b y z, c z x): quadratic, so second-order differences are exact everywhere.
std::array<double, 3> quadratic(const std::array<double, 3>& x) {
  return {2 * x[0] * x[1], 3 * x[1] * x[2], -x[2] * x[0]};
}
double exactQ(const std::array<double, 3>& x) {
  const double g[9] = {2 * x[1], 2 * x[0], 0, 0, 3 * x[2], 3 * x[1], -x[2], 0, -x[0]};
  double s = 0;
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j) s -= 0.5 * g[3 * i + j] * g[3 * j + i];
  return s;
}

} // namespace

TEST(QCriterion, ExactForQuadraticFieldsUpToTheFaces) {
  for (int order : {2, 4}) {
    Case c(quadratic);
    c.run(order);
    for (int k = 0; k < c.grid.n[2]; ++k)
      for (int j = 0; j < c.grid.n[1]; ++j)
        for (int i = 0; i < c.grid.n[0]; ++i) {
          const auto x = c.grid.position(i, j, k);
          const std::size_t p = c.grid.index(i, j, k);
          EXPECT_NEAR(c.q[p], exactQ(x), 2e-4);
          EXPECT_NEAR(c.divergence[p], 2 * x[1] + 3 * x[2] - x[0], 1e-4);
          EXPECT_NEAR(c.vorticity[3 * p], -3 * x[1], 1e-4);
          EXPECT_NEAR(c.vorticity[3 * p + 1], x[2], 1e-4);
          EXPECT_NEAR(c.vorticity[3 * p + 2], -2 * x[0], 1e-4);
        }
  }
}

TEST(QCriterion, NeverLooksAcrossTheMask) {
  Case c(quadratic);
  const std::size_t centre = c.grid.index(4, 4, 3);
  c.mask[centre] = 1;
  for (int e = 0; e < 3; ++e) c.velocity[3 * centre + e] = std::numeric_limits<float>::quiet_NaN();
  for (int order : {2, 4}) {
    c.run(order, true);
    EXPECT_EQ(c.q[centre], 0);
    for (int k = 0; k < c.grid.n[2]; ++k)
      for (int j = 0; j < c.grid.n[1]; ++j)
        for (int i = 0; i < c.grid.n[0]; ++i)
          if (c.grid.index(i, j, k) != centre) {
            EXPECT_NEAR(c.q[c.grid.index(i, j, k)], exactQ(c.grid.position(i, j, k)), 2e-4);
          }
  }
}

// Large enough for several blocks of rows and slices, which must fit together.
TEST(QCriterion, ExactAroundASphereOnAGridOfManyBlocks) {
  Case c(quadratic, {21, 150, 40});
  for (int k = 0; k < c.grid.n[2]; ++k)
    for (int j = 0; j < c.grid.n[1]; ++j)
      for (int i = 0; i < c.grid.n[0]; ++i)
        if (std::hypot(i - 10, j - 64, k - 16) < 6.5) {
          c.mask[c.grid.index(i, j, k)] = 1;
          for (int e = 0; e < 3; ++e)
            c.velocity[3 * c.grid.index(i, j, k) + e] = std::numeric_limits<float>::quiet_NaN();
        }
  for (int order : {2, 4}) {
    c.run(order, true);
    double worst = 0;
    for (int k = 0; k < c.grid.n[2]; ++k)
      for (int j = 0; j < c.grid.n[1]; ++j)
        for (int i = 0; i < c.grid.n[0]; ++i) {
          const std::size_t p = c.grid.index(i, j, k);
          const double q = c.mask[p] ? 0 : exactQ(c.grid.position(i, j, k));
          const double error = std::abs(c.q[p] - q);
          worst = error < 1e9 ? std::max(worst, error) : 1e9; // NaN counts
        }
    EXPECT_LT(worst, 0.5); // of 6000
  }
}

TEST(QCriterion, FourthOrderIsExactForQuarticFieldsInside) {
  Case c([](const std::array<double, 3>& x) {
    return std::array<double, 3>{std::pow(x[1], 4), std::pow(x[2], 4), std::pow(x[0], 4)};
  });
  c.run(4);
  const auto x = c.grid.position(4, 4, 3);
  EXPECT_NEAR(c.vorticity[3 * c.grid.index(4, 4, 3)], -4 * std::pow(x[2], 3), 1e-3);
  c.run(2);
  EXPECT_GT(std::abs(c.vorticity[3 * c.grid.index(4, 4, 3)] + 4 * std::pow(x[2], 3)), 1e-2);
}

TEST(QCriterion, SolidRotationAndPureStrain) {
  Case rotation([](const std::array<double, 3>& x) { return std::array<double, 3>{-x[1], x[0], 0}; });
  rotation.run(2);
  const std::size_t p = rotation.grid.index(3, 3, 3);
  EXPECT_NEAR(rotation.q[p], 1, 1e-5);        // |Omega|^2/2 = w^2 with w = 1 rad/s
  EXPECT_NEAR(rotation.lambda2[p], -1, 2e-6); // a vortex: lambda2 < 0
  Case strain([](const std::array<double, 3>& x) { return std::array<double, 3>{x[0], -x[1], 0}; });
  strain.run(2);
  EXPECT_NEAR(strain.q[p], -1, 1e-5);
  EXPECT_GE(strain.lambda2[p], -1e-4);
}

TEST(QCriterion, AThinGridGivesZeroDerivativesNotNaN) {
  const Grid grid{{0, 0, 0}, {1, 1, 1}, {5, 2, 1}};
  std::vector<float> u(3 * grid.size()), q(grid.size());
  for (std::size_t p = 0; p < u.size(); ++p) u[p] = float(p % 7);
  ASSERT_TRUE(qCriterion(grid, u.data(), nullptr, 4, {q.data()}));
  for (float v : q) EXPECT_TRUE(std::isfinite(v));
}

TEST(QCriterion, Aborts) {
  Case c(quadratic);
  EXPECT_FALSE(qCriterion(c.grid, c.velocity.data(), nullptr, 2, {c.q.data()}, [](double) { return false; }));
}
