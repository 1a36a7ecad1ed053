#include "OneShotPressure.h"

#include "BoxPoisson.h"
#include "FluidRegions.h"
#include "PressureLinks.h"
#include "Stencils.h"

#include <cmath>
#include <stdexcept>
#include <string>
#include <utility>

namespace rimflow {
namespace {

// How much each node is trusted: 0 where there is no fluid, wallWeight at fluid nodes of which one of the 26
// neighbours is none, else 1.
std::vector<float> nodeWeights(const PressureProblem& problem, double wallWeight) {
  const Grid& g = problem.grid;
  const int n = g.n[0];
  std::vector<float> t(g.size(), 1);
  if (!problem.mask) return t;
  forEachRow<unsigned char>(g, 1, [&](int j, int k, RowBuffers<unsigned char>& rows) {
    unsigned char* near = rows(0); // in this row or one of the eight around it
    std::fill_n(near, n, 0);
    for (int kk = std::max(0, k - 1); kk <= std::min(g.n[2] - 1, k + 1); ++kk)
      for (int jj = std::max(0, j - 1); jj <= std::min(g.n[1] - 1, j + 1); ++jj) {
        const unsigned char* mask = problem.mask + g.index(0, jj, kk);
        for (int i = 0; i < n; ++i) near[i] |= mask[i];
      }
    const std::size_t row = g.index(0, j, k);
    for (int i = 0; i < n; ++i)
      if (problem.mask[row + i])
        t[row + i] = 0;
      else if (near[i] || (i > 0 && near[i - 1]) || (i + 1 < n && near[i + 1]))
        t[row + i] = float(wallWeight);
  });
  return t;
}

// A p = sum over neighbours of w t_i t_j (p_i - p_j), t the weights of the nodes: the Laplacian of the graph
// of fluid nodes. It does not look at p where there is no fluid.
class GraphLaplacian {
public:
  GraphLaplacian(const Grid& grid, std::vector<float> nodeWeights)
      : grid_(grid), t_(std::move(nodeWeights)), neighbours_(grid.size(), 0) {
    for (int a = 0; a < 3; ++a) weight_[a] = 1 / (grid.spacing[a] * grid.spacing[a]);
    forEachRow<double>(grid, 0, [&](int j, int k, auto&) {
      forEachNeighbour(j, k, [&](double w, std::size_t from, std::size_t to, int count) {
        double* sum = neighbours_.data() + to;
        const float* t = t_.data() + from;
#pragma omp simd
        for (int i = 0; i < count; ++i) sum[i] += w * t[i];
      });
    });
  }
  const Grid& grid() const { return grid_; }
  /// 1/h^2 along the axis
  double weight(int axis) const { return weight_[axis]; }
  const std::vector<float>& nodeWeights() const { return t_; }
  double diagonal(std::size_t node) const { return t_[node] * neighbours_[node]; }

  /// Calls f(w, from, to, count): the nodes to, to + 1, ... of the row (j, k) have the neighbours from, from
  /// + 1,
  /// ..., once for each of the six sides.
  template <class F>
  void forEachNeighbour(int j, int k, F&& f) const {
    const int n = grid_.n[0];
    const std::size_t row = grid_.index(0, j, k), sy = n, sz = std::size_t(n) * grid_.n[1];
    f(weight_[0], row, row + 1, n - 1);
    f(weight_[0], row + 1, row, n - 1);
    if (j > 0) f(weight_[1], row - sy, row, n);
    if (j + 1 < grid_.n[1]) f(weight_[1], row + sy, row, n);
    if (k > 0) f(weight_[2], row - sz, row, n);
    if (k + 1 < grid_.n[2]) f(weight_[2], row + sz, row, n);
  }

  /// q = A p; returns p . q.
  double apply(const Eigen::VectorXf& p, Eigen::VectorXd& q) const {
    const int n = grid_.n[0];
    return sumOverRows<double, 1>(grid_, 0, [&](int j, int k, auto&) {
      const std::size_t row = grid_.index(0, j, k);
      double* out = q.data() + row;
#pragma omp simd
      for (int i = 0; i < n; ++i) out[i] = neighbours_[row + i] * p[row + i];
      forEachNeighbour(j, k, [&](double w, std::size_t from, std::size_t to, int count) {
        double* sum = q.data() + to;
        const float *f = p.data() + from, *t = t_.data() + from;
#pragma omp simd
        for (int i = 0; i < count; ++i) sum[i] -= w * (t[i] * double(f[i]));
      });
      double product = 0;
#pragma omp simd reduction(+ : product)
      for (int i = 0; i < n; ++i) {
        out[i] *= t_[row + i];
        product += out[i] * p[row + i];
      }
      return std::array<double, 1>{product};
    })[0];
  }

private:
  Grid grid_;
  std::array<double, 3> weight_;
  std::vector<float> t_;
  std::vector<double> neighbours_; ///< sum of w t_j
};

// b_i = -sum of w t_i t_j d_ij
Eigen::VectorXd rightHandSide(const PressureProblem& problem, const GraphLaplacian& a, int order) {
  const Grid& g = problem.grid;
  const PressureLinks links(problem, order);
  const float* t = a.nodeWeights().data();
  Eigen::VectorXd b = Eigen::VectorXd::Zero(g.size());
  forEachRow<double>(g, 1, [&](int j, int k, RowBuffers<double>& rows) {
    const std::size_t row = g.index(0, j, k);
    double *sum = b.data() + row, *d = rows(0);
    const auto add = [&](int axis, int jj, int kk, double sign, int shift) { // links of the row (jj, kk)
      const int count = axis == 0 ? g.n[0] - 1 : g.n[0];
      const std::size_t from = g.index(0, jj, kk);
      const float *ta = t + from, *tb = ta + links.stride(axis);
      const double w = sign * a.weight(axis);
      links.differences(axis, jj, kk, d);
      for (int i = 0; i < count; ++i)
        if (const double tt = ta[i] * tb[i]; tt > 0) sum[i + shift] += w * tt * d[i];
    };
    add(0, j, k, -1, 0);
    add(0, j, k, 1, 1);
    if (j + 1 < g.n[1]) add(1, j, k, -1, 0);
    if (j > 0) add(1, j - 1, k, 1, 0);
    if (k + 1 < g.n[2]) add(2, j, k, -1, 0);
    if (k > 0) add(2, j, k - 1, 1, 0);
  });
  return b;
}

// The sum of f(segment of nodes), independent of the number of threads
template <class F>
double sumOverSegments(const Grid& grid, F&& f) {
  return sumOverRows<double, 1>(
      grid, 0, [&](int j, int k, auto&) { return std::array<double, 1>{f(grid.index(0, j, k))}; })[0];
}

// The exact inverse on the whole box, a good approximation to that on any part of it, so that iterations
// hardly grow with the grid; and for nodes of less weight, 1 over their diagonal as well.
class BoxAndWall {
public:
  explicit BoxAndWall(const GraphLaplacian& a)
      : box_(a.grid(),
             {neumannBasis(a.grid().n[0], a.grid().spacing[0]),
              neumannBasis(a.grid().n[1], a.grid().spacing[1]),
              neumannBasis(a.grid().n[2], a.grid().spacing[2])},
             [](double eigenvalue) { return eigenvalue == 0 ? 0 : -1 / eigenvalue; }) {
    for (std::size_t p = 0; p < a.grid().size(); ++p)
      if (a.nodeWeights()[p] < 1 && a.diagonal(p) > 0) wall_.push_back({p, 1 / a.diagonal(p)});
  }
  void apply(const Eigen::VectorXd& r, Eigen::VectorXf& z) const {
#pragma omp parallel for schedule(static)
    for (Eigen::Index p = 0; p < z.size(); ++p) z[p] = float(r[p]);
    box_.solve(z.data());
    for (const auto& [p, inverse] : wall_) z[p] += float(inverse * r[p]);
  }

private:
  BoxPoisson<float> box_;
  std::vector<std::pair<std::size_t, double>> wall_;
};

void check(const PressureProblem& problem, const OneShotOptions& options) {
  if (options.order != 2 && options.order != 4)
    throw std::invalid_argument("the order of integration is " + std::to_string(options.order) +
                                "; it must be 2 or 4");
  if (!(options.wallWeight > 0 && options.wallWeight <= 1))
    throw std::invalid_argument("the weight of nodes next to the mask must be greater than 0 and at most 1");
  if (!(options.tolerance > 0)) throw std::invalid_argument("the tolerance must be greater than 0");
  if (options.maximumIterations < 1) throw std::invalid_argument("at least one iteration is needed");
  for (std::size_t p = 0; p < problem.grid.size(); ++p)
    if (problem.isFluid(p)) return;
  throw std::invalid_argument("no node holds fluid: all of the image is masked or empty");
}

} // namespace

PressureSolution oneShotPressure(const PressureProblem& problem, const OneShotOptions& options,
                                 const Progress& progress) {
  check(problem, options);
  const Grid& g = problem.grid;
  PressureSolution out;
  constexpr double Before = 0.15, After = 0.95; // of the iterations
  const auto aborted = [&](double fraction) { return out.aborted = !goOn(progress, fraction); };
  if (aborted(0)) return out;
  const GraphLaplacian a(g, nodeWeights(problem, options.wallWeight));
  if (aborted(Before / 3)) return out;
  const BoxAndWall preconditioner(a);
  if (aborted(2 * Before / 3)) return out;
  const Eigen::Index n = g.n[0];
  const auto dot = [&](const Eigen::VectorXd& u, const auto& v) {
    return sumOverSegments(
        g, [&](std::size_t i) { return u.segment(i, n).dot(v.segment(i, n).template cast<double>()); });
  };
  Eigen::VectorXd r = rightHandSide(problem, a, options.order), q(g.size()),
                  x = Eigen::VectorXd::Zero(g.size());
  Eigen::VectorXf z(g.size()), p = Eigen::VectorXf::Zero(g.size());
  const double norm = std::sqrt(dot(r, r));
  if (norm > 0) r /= norm; // so that float does for z and p
  double rr = norm > 0 ? 1 : 0, rz = 1;
  // Preconditioned conjugate gradients. Region by region, r has mean 0, so the constants that z brings do no
  // harm.
  for (; rr > options.tolerance * options.tolerance && out.iterations < options.maximumIterations;
       ++out.iterations) {
    const double done = std::min(1., 0.5 * std::log(rr) / std::log(options.tolerance));
    if (aborted(Before + (After - Before) * done)) return out;
    preconditioner.apply(r, z);
    if (aborted(Before + (After - Before) * done)) return out;
    const double rzNew = dot(r, z), beta = out.iterations == 0 ? 0 : rzNew / rz;
    rz = rzNew;
    forEachRow<float>(g, 0, [&](int j, int k, auto&) {
      const std::size_t i = g.index(0, j, k);
      p.segment(i, n) = z.segment(i, n) + float(beta) * p.segment(i, n);
    });
    const double alpha = rz / a.apply(p, q);
    rr = sumOverSegments(g, [&](std::size_t i) {
      x.segment(i, n) += alpha * p.segment(i, n).cast<double>();
      r.segment(i, n) -= alpha * q.segment(i, n);
      return r.segment(i, n).squaredNorm();
    });
  }
  out.residual = std::sqrt(rr);
  if (aborted(After)) return out;
  x *= norm;
  FluidRegions regions = fluidRegions(g, problem.mask);
  removeRegionMeans(regions, x.data());
  out.pressure.assign(x.data(), x.data() + x.size());
  out.region = std::move(regions.region);
  out.regions = regions.count;
  return out;
}

} // namespace rimflow
