// Breaks when the solution of the Poisson equation on a box is inexact, not its own adjoint, changes nodes
// that are not its own, or depends on the number of threads.
#include "BoxPoisson.h"

#include <cmath>
#include <gtest/gtest.h>
#include <omp.h>
#include <random>

using namespace rimflow;

namespace {

enum class Kind { Dirichlet, Neumann, Reflection };
using Bases = std::array<AxisBasis, 3>;

/// D^T D of central differences, one-sided at the ends: the same read backwards, with eigenvalues of either
/// parity that nearly coincide.
Eigen::MatrixXd squaredDifference(int n, double spacing) {
  Eigen::MatrixXd d = Eigen::MatrixXd::Zero(n, n);
  for (int i = 0; i < n; ++i) {
    const int low = std::max(i - 1, 0), high = std::min(i + 1, n - 1);
    if (low == high) continue;
    d(i, high) += 1 / ((high - low) * spacing);
    d(i, low) -= 1 / ((high - low) * spacing);
  }
  return d.transpose() * d;
}

/// The operator that a basis is meant for, written down directly.
Eigen::MatrixXd directOperator(Kind kind, int n, double h) {
  if (kind == Kind::Reflection) return squaredDifference(n, h);
  const int m = kind == Kind::Dirichlet ? n - 2 : n;
  Eigen::MatrixXd l = Eigen::MatrixXd::Zero(m, m);
  for (int i = 0; i < m; ++i)
    for (int neighbour : {i - 1, i + 1}) {
      const bool outside = neighbour < 0 || neighbour >= m;
      if (!outside) l(i, neighbour) += 1 / (h * h);
      if (!outside || kind == Kind::Dirichlet) l(i, i) -= 1 / (h * h);
    }
  return l;
}

AxisBasis basisOf(Kind kind, int n, double h) {
  if (kind == Kind::Dirichlet) return dirichletBasis(n, h);
  if (kind == Kind::Neumann) return neumannBasis(n, h);
  return reflectionBasis(squaredDifference(n, h));
}

Bases basesOf(Kind kind, const Grid& grid) {
  return {basisOf(kind, grid.n[0], grid.spacing[0]), basisOf(kind, grid.n[1], grid.spacing[1]),
          basisOf(kind, grid.n[2], grid.spacing[2])};
}

template <class Real>
std::vector<Real> noise(const Grid& grid, unsigned seed) {
  std::mt19937 random(seed);
  std::normal_distribution<double> normal;
  std::vector<Real> f(grid.size());
  for (Real& v : f) v = Real(normal(random));
  return f;
}

/// L f on the nodes of the bases, 0 elsewhere.
template <class Real>
std::vector<double> apply(Kind kind, const Grid& grid, const std::vector<Real>& f) {
  std::vector<double> out(f.size(), 0);
  const int first = kind == Kind::Dirichlet ? 1 : 0;
  Eigen::MatrixXd l[3];
  for (int a = 0; a < 3; ++a) l[a] = directOperator(kind, grid.n[a], grid.spacing[a]);
  for (int k = 0; k < l[2].rows(); ++k)
    for (int j = 0; j < l[1].rows(); ++j)
      for (int i = 0; i < l[0].rows(); ++i) {
        const auto at = [&](int x, int y, int z) {
          return double(f[grid.index(x + first, y + first, z + first)]);
        };
        double sum = 0;
        for (int e = 0; e < l[0].rows(); ++e) sum += l[0](i, e) * at(e, j, k);
        for (int e = 0; e < l[1].rows(); ++e) sum += l[1](j, e) * at(i, e, k);
        for (int e = 0; e < l[2].rows(); ++e) sum += l[2](k, e) * at(i, j, e);
        out[grid.index(i + first, j + first, k + first)] = sum;
      }
  return out;
}

std::vector<Grid> grids() {
  std::vector<Grid> out;
  for (const std::array<int, 3>& n :
       {std::array<int, 3>{3, 3, 3}, {4, 3, 5}, {5, 6, 4}, {20, 37, 8}, {35, 18, 19}, {53, 5, 50}})
    out.push_back({{0, 0, 0}, {1, 0.9, 1.2}, n});
  return out;
}

double dot(const std::vector<double>& a, const std::vector<double>& b) {
  double sum = 0;
  for (std::size_t e = 0; e < a.size(); ++e) sum += a[e] * b[e];
  return sum;
}

const Kind Kinds[] = {Kind::Dirichlet, Kind::Neumann, Kind::Reflection};

/// The largest error of (L - 1)^-1 (L - 1) f, or of (L + 1)^-1 (L + 1) f where L >= 0.
template <class Real>
double worstError(Kind kind, const Grid& grid) {
  const double shift = kind == Kind::Reflection ? 1 : -1;
  const BoxPoisson<Real> solver(grid, basesOf(kind, grid), [=](double l) { return 1 / (l + shift); });
  const std::vector<Real> f = noise<Real>(grid, 1);
  const std::vector<double> l = apply(kind, grid, f);
  std::vector<Real> g(f);
  for (std::size_t e = 0; e < g.size(); ++e) g[e] = Real(l[e] + shift * double(f[e]));
  const std::vector<Real> before = g;
  solver.solve(g.data());
  double worst = 0;
  for (int k = 0; k < grid.n[2]; ++k)
    for (int j = 0; j < grid.n[1]; ++j)
      for (int i = 0; i < grid.n[0]; ++i) {
        const bool face =
            i == 0 || j == 0 || k == 0 || i == grid.n[0] - 1 || j == grid.n[1] - 1 || k == grid.n[2] - 1;
        const std::size_t e = grid.index(i, j, k);
        const Real expected = kind == Kind::Dirichlet && face ? before[e] : f[e];
        worst = std::max(worst, std::abs(double(g[e]) - double(expected)));
      }
  return worst;
}

} // namespace

TEST(BoxPoisson, InvertsTheOperatorWrittenDownDirectly) {
  for (const Grid& grid : grids())
    for (Kind kind : Kinds) {
      SCOPED_TRACE(testing::Message()
                   << "kind " << int(kind) << ", " << grid.n[0] << " x " << grid.n[1] << " x " << grid.n[2]);
      EXPECT_LT(worstError<double>(kind, grid), 4e-14);
      EXPECT_LT(worstError<float>(kind, grid), 1.5e-5);
    }
}

TEST(BoxPoisson, SolvesWithGivenFaceValues) {
  const Grid grid{{0, 0, 0}, {1, 0.9, 1.2}, {12, 9, 14}};
  const std::vector<double> f = noise<double>(grid, 2);
  std::vector<double> g = apply(Kind::Dirichlet, grid, f);
  BoxPoisson<double>(grid).solve(g.data());
  double worst = 0;
  for (int k = 1; k < grid.n[2] - 1; ++k)
    for (int j = 1; j < grid.n[1] - 1; ++j)
      for (int i = 1; i < grid.n[0] - 1; ++i)
        worst = std::max(worst, std::abs(g[grid.index(i, j, k)] - f[grid.index(i, j, k)]));
  EXPECT_LT(worst, 1e-13);
}

// The constant has eigenvalue 0: the solution is the one whose mean is 0.
TEST(BoxPoisson, LeavesOutTheMeanWhereItIsFree) {
  const Grid grid{{0, 0, 0}, {1, 1, 1}, {9, 6, 7}};
  std::vector<double> f = noise<double>(grid, 3), g = apply(Kind::Neumann, grid, f);
  BoxPoisson<double>(grid, basesOf(Kind::Neumann, grid)).solve(g.data());
  double mean = 0, worst = 0;
  for (double v : f) mean += v / double(f.size());
  for (std::size_t e = 0; e < f.size(); ++e) worst = std::max(worst, std::abs(g[e] - (f[e] - mean)));
  EXPECT_LT(worst, 1e-13);
}

TEST(BoxPoisson, ResponseOneLeavesEveryFieldAlone) {
  for (const std::array<int, 3>& n :
       {std::array<int, 3>{1, 17, 6}, {12, 1, 9}, {9, 20, 1}, {1, 1, 5}, {1, 1, 1}}) {
    const Grid grid{{0, 0, 0}, {1, 1, 1}, n};
    const std::vector<double> f = noise<double>(grid, 4);
    std::vector<double> g(f);
    BoxPoisson<double>(grid, basesOf(Kind::Neumann, grid), [](double) { return 1; }).solve(g.data());
    for (std::size_t e = 0; e < f.size(); ++e) ASSERT_NEAR(g[e], f[e], 2e-14);
  }
}

// The faces of a box: the same plane along any two axes
TEST(BoxPoisson, ThePlaneOfAFaceMayLieAnyWay) {
  const auto response = [](double l) { return 1 / (0.1 - l); };
  std::vector<double> fields[3];
  const std::array<int, 3> sizes[] = {{1, 17, 6}, {17, 1, 6}, {17, 6, 1}};
  for (int a = 0; a < 3; ++a) {
    const Grid grid{{0, 0, 0}, {1, 1, 1}, sizes[a]};
    fields[a] = noise<double>(grid, 5);
    BoxPoisson<double>(grid, basesOf(Kind::Neumann, grid), response).solve(fields[a].data());
  }
  for (std::size_t e = 0; e < fields[0].size(); ++e) {
    ASSERT_NEAR(fields[0][e], fields[2][e], 1e-13);
    ASSERT_NEAR(fields[1][e], fields[2][e], 1e-13);
  }
}

TEST(BoxPoisson, IsItsOwnAdjoint) {
  for (const Grid& grid : grids())
    for (Kind kind : {Kind::Neumann, Kind::Reflection}) {
      const BoxPoisson<double> solver(grid, basesOf(kind, grid), [](double l) { return 1 / (1 + l * l); });
      const std::vector<double> a = noise<double>(grid, 6), b = noise<double>(grid, 7);
      std::vector<double> sa(a), sb(b);
      double* fields[] = {sa.data(), sb.data()};
      solver.solve(fields, 2);
      EXPECT_NEAR(dot(sa, b), dot(a, sb), 1e-14 * std::sqrt(dot(a, a) * dot(b, b)));
    }
}

TEST(BoxPoisson, DoesNotDependOnTheNumberOfThreads) {
  const Grid grid{{0, 0, 0}, {1, 1, 1}, {35, 18, 19}};
  const BoxPoisson<float> solver(grid);
  const int before = omp_get_max_threads();
  std::vector<float> results[2];
  for (int t : {0, 1}) {
    results[t] = noise<float>(grid, 8);
    omp_set_num_threads(t == 0 ? 1 : 5);
    solver.solve(results[t].data());
  }
  omp_set_num_threads(before);
  EXPECT_EQ(results[0], results[1]);
}

TEST(BoxPoisson, EveryReflectionVectorIsEvenOrOdd) {
  for (int n : {1, 2, 3, 8, 41}) {
    const Eigen::MatrixXd matrix = squaredDifference(n, 1);
    const AxisBasis basis = reflectionBasis(matrix);
    const Eigen::MatrixXd& v = basis.vectors;
    EXPECT_LT((matrix * v - v * basis.values.asDiagonal()).norm(), 1e-13 * n);
    EXPECT_LT((v.transpose() * v - Eigen::MatrixXd::Identity(n, n)).norm(), 1e-13 * n);
    for (int k = 0; k < n; ++k)
      EXPECT_EQ((v.col(k).reverse() - (k < (n + 1) / 2 ? 1 : -1) * v.col(k)).norm(), 0);
  }
}

TEST(BoxPoisson, RefusesVectorsWithoutParity) {
  const Grid grid{{0, 0, 0}, {1, 1, 1}, {4, 4, 4}};
  Bases bases = basesOf(Kind::Neumann, grid);
  bases[1].vectors = Eigen::MatrixXd::Identity(4, 4);
  EXPECT_THROW(BoxPoisson<double>(grid, bases), std::invalid_argument);
}
