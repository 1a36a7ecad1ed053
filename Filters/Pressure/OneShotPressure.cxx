#include "OneShotPressure.h"

#include "BoxPoisson.h"
#include "FluidRegions.h"
#include "PressureLinks.h"
#include "Stencils.h"

#include <cmath>
#include <stdexcept>
#include <string>

namespace rimflow {
namespace {

// How much each node is trusted: 0 where there is no fluid, wallWeight at fluid nodes of which one of the 26
// neighbours is none, else 1.
std::vector<float> nodeWeights(const PressureProblem& problem, double wallWeight) {
  const Grid& g = problem.grid;
  std::vector<float> t(g.size(), 1);
  if (!problem.mask) return t;
  forEachRow<float>(g, 0, [&](int j, int k, auto&) {
    for (int i = 0; i < g.n[0]; ++i) {
      const std::size_t p = g.index(i, j, k);
      if (!problem.isFluid(p)) {
        t[p] = 0;
        continue;
      }
      for (int kk = std::max(0, k - 1); kk <= std::min(g.n[2] - 1, k + 1); ++kk)
        for (int jj = std::max(0, j - 1); jj <= std::min(g.n[1] - 1, j + 1); ++jj)
          for (int ii = std::max(0, i - 1); ii <= std::min(g.n[0] - 1, i + 1); ++ii)
            if (!problem.isFluid(g.index(ii, jj, kk))) t[p] = float(wallWeight);
    }
  });
  return t;
}

// A p = sum over neighbours of w t_i t_j (p_i - p_j), t the weights of the nodes: the Laplacian of the graph
// of fluid nodes.
class GraphLaplacian {
public:
  GraphLaplacian(const Grid& grid, std::vector<float> nodeWeights)
      : grid_(grid), t_(std::move(nodeWeights)), neighbours_(grid.size()) {
    for (int a = 0; a < 3; ++a) weight_[a] = 1 / (grid.spacing[a] * grid.spacing[a]);
    forEachRow<double>(grid, 0, [&](int j, int k, auto&) {
      for (int i = 0; i < grid.n[0]; ++i) {
        const std::size_t p = grid.index(i, j, k);
        const int at[3] = {i, j, k};
        for (int a = 0; a < 3; ++a)
          neighbours_[p] += weight_[a] * ((at[a] > 0 ? t_[p - stride(a)] : 0.) +
                                          (at[a] + 1 < grid.n[a] ? t_[p + stride(a)] : 0.));
      }
    });
  }
  std::ptrdiff_t stride(int axis) const {
    return axis == 0 ? 1 : axis == 1 ? grid_.n[0] : std::ptrdiff_t(grid_.n[0]) * grid_.n[1];
  }
  /// Of the link from a node to the next one along the axis.
  double weight(std::size_t node, int axis) const {
    return weight_[axis] * t_[node] * t_[node + stride(axis)];
  }
  /// 1/A_ii of a node that is trusted less than others; 0 of all others.
  double local(std::size_t node) const {
    return t_[node] > 0 && t_[node] < 1 && neighbours_[node] > 0 ? 1 / (t_[node] * neighbours_[node]) : 0;
  }
  /// No fluid, or no fluid around.
  bool isAlone(std::size_t node) const { return t_[node] == 0 || neighbours_[node] == 0; }

  /// q = A p; returns p . q.
  double apply(const std::vector<double>& p, std::vector<double>& q) const {
    const int n = grid_.n[0];
    return sumOverRows<double, 1>(grid_, 1, [&](int j, int k, RowBuffers<double>& rows) {
      const std::size_t start = grid_.index(0, j, k);
      const double *c = p.data() + start, *sum = neighbours_.data() + start;
      const float* t = t_.data() + start;
      double *out = q.data() + start, *tp = rows(0);
      for (int i = 0; i < n; ++i) tp[i] = sum[i] * c[i];
      const auto take = [&](double w, const double* f, const float* weight, int first, int last, int step) {
#pragma omp simd
        for (int i = first; i < last; ++i) tp[i] -= w * (weight[i + step] * f[i + step]);
      };
      take(weight_[0], c, t, 1, n, -1);
      take(weight_[0], c, t, 0, n - 1, 1);
      const std::ptrdiff_t sy = stride(1), sz = stride(2);
      if (j > 0) take(weight_[1], c - sy, t - sy, 0, n, 0);
      if (j + 1 < grid_.n[1]) take(weight_[1], c + sy, t + sy, 0, n, 0);
      if (k > 0) take(weight_[2], c - sz, t - sz, 0, n, 0);
      if (k + 1 < grid_.n[2]) take(weight_[2], c + sz, t + sz, 0, n, 0);
      double product = 0;
#pragma omp simd reduction(+ : product)
      for (int i = 0; i < n; ++i) {
        out[i] = t[i] * tp[i];
        product += out[i] * c[i];
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

// b_i = -sum of w d_ij
std::vector<double> rightHandSide(const PressureProblem& problem, const GraphLaplacian& a, int order) {
  const Grid& g = problem.grid;
  const PressureLinks links(problem, order);
  std::vector<double> b(g.size(), 0);
  forEachRow<double>(g, 0, [&](int j, int k, auto&) {
    for (int i = 0; i < g.n[0]; ++i) {
      const std::size_t p = g.index(i, j, k);
      const int at[3] = {i, j, k};
      if (!links.isFluid(p)) continue;
      for (int axis = 0; axis < 3; ++axis) {
        const std::size_t before = p - links.stride(axis), after = p + links.stride(axis);
        if (at[axis] > 0 && links.isFluid(before))
          b[p] += a.weight(before, axis) * links.difference(before, axis, at[axis] - 1);
        if (at[axis] + 1 < g.n[axis] && links.isFluid(after))
          b[p] -= a.weight(p, axis) * links.difference(p, axis, at[axis]);
      }
    }
  });
  return b;
}

// Vector operations on nodes, summed layer by layer: independent of the number of threads.
template <class F>
double sumOverNodes(const Grid& grid, F&& f) {
  return sumOverRows<double, 1>(grid, 0, [&](int j, int k, auto&) {
    const std::size_t start = grid.index(0, j, k), end = start + grid.n[0];
    double sum = 0;
#pragma omp simd reduction(+ : sum)
    for (std::size_t p = start; p < end; ++p) sum += f(p);
    return std::array<double, 1>{sum};
  })[0];
}

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
  if (!goOn(progress, 0)) {
    out.aborted = true;
    return out;
  }
  const GraphLaplacian a(g, nodeWeights(problem, options.wallWeight));
  // The preconditioner: the exact inverse on the whole box, a good approximation to that on any part of it,
  // so that iterations hardly grow with the grid; and for nodes of less weight, 1 over their diagonal as
  // well.
  const BoxPoisson<float> box(g,
                              {neumannBasis(g.n[0], g.spacing[0]), neumannBasis(g.n[1], g.spacing[1]),
                               neumannBasis(g.n[2], g.spacing[2])},
                              [](double eigenvalue) { return eigenvalue == 0 ? 0 : -1 / eigenvalue; });
  std::vector<double> r = rightHandSide(problem, a, options.order), x(g.size(), 0), p(g.size(), 0),
                      q(g.size());
  std::vector<float> z(g.size());
  const auto squared = [&](const std::vector<double>& v) {
    return sumOverNodes(g, [&](std::size_t i) { return v[i] * v[i]; });
  };
  const double norm = squared(r), target = options.tolerance * options.tolerance * norm;
  double rr = norm, rz = 1;
  // Preconditioned conjugate gradients. Region by region, r has mean 0, so the constants that z brings do no
  // harm.
  for (; rr > target && out.iterations < options.maximumIterations; ++out.iterations) {
    if (!goOn(progress, norm > 0 ? std::min(1., std::log(rr / norm) / std::log(target / norm)) : 1)) {
      out.aborted = true;
      return out;
    }
    const double scale = 1 / std::sqrt(rr); // keeps float far from its limits
#pragma omp parallel for schedule(static)
    for (std::size_t i = 0; i < z.size(); ++i) z[i] = float(scale * r[i]);
    box.solve(z.data());
    const double rzNew = sumOverNodes(g,
                                      [&](std::size_t i) {
                                        z[i] += float(scale * r[i] * a.local(i));
                                        return r[i] * z[i];
                                      }) /
                         scale;
    const double beta = out.iterations == 0 ? 0 : rzNew / rz;
    rz = rzNew;
#pragma omp parallel for schedule(static)
    for (std::size_t i = 0; i < p.size(); ++i) p[i] = a.isAlone(i) ? 0 : z[i] / scale + beta * p[i];
    const double alpha = rz / a.apply(p, q);
    rr = sumOverNodes(g, [&](std::size_t i) {
      x[i] += alpha * p[i];
      r[i] -= alpha * q[i];
      return r[i] * r[i];
    });
  }
  out.residual = norm > 0 ? std::sqrt(rr / norm) : 0;
  FluidRegions regions = fluidRegions(g, problem.mask);
  removeRegionMeans(regions, x);
  out.pressure.assign(x.begin(), x.end());
  out.region = std::move(regions.region);
  out.regions = regions.count;
  return out;
}

} // namespace rimflow
