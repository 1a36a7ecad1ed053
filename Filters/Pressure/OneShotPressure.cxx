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

// A p = sum over fluid neighbours of w (p_i - p_j): the Laplacian of the graph of fluid nodes. Fields are 0
// where there is no fluid, so that only the diagonal knows the mask.
class GraphLaplacian {
public:
  explicit GraphLaplacian(const PressureProblem& problem) : grid_(problem.grid), diagonal_(grid_.size()) {
    for (int a = 0; a < 3; ++a) weight_[a] = 1 / (grid_.spacing[a] * grid_.spacing[a]);
    const std::ptrdiff_t stride[3] = {1, grid_.n[0], std::ptrdiff_t(grid_.n[0]) * grid_.n[1]};
    forEachRow<double>(grid_, 0, [&](int j, int k, auto&) {
      for (int i = 0; i < grid_.n[0]; ++i) {
        const std::size_t p = grid_.index(i, j, k);
        const int at[3] = {i, j, k};
        double sum = 0;
        if (problem.isFluid(p))
          for (int a = 0; a < 3; ++a)
            sum += weight_[a] * ((at[a] > 0 && problem.isFluid(p - stride[a])) +
                                 (at[a] + 1 < grid_.n[a] && problem.isFluid(p + stride[a])));
        diagonal_[p] = sum;
      }
    });
  }
  const Grid& grid() const { return grid_; }
  double weight(int axis) const { return weight_[axis]; }
  /// 0: no fluid, or a node without neighbours.
  const std::vector<double>& diagonal() const { return diagonal_; }

  /// q = A p; returns p . q.
  double apply(const std::vector<double>& p, std::vector<double>& q) const {
    const int n = grid_.n[0];
    return sumOverRows<double, 1>(grid_, 1, [&](int j, int k, RowBuffers<double>& rows) {
      const std::size_t start = grid_.index(0, j, k);
      const double* c = p.data() + start;
      double* none = rows(0); // a row of zeros stands for the neighbours beyond a face
      const std::ptrdiff_t sy = n, sz = std::ptrdiff_t(n) * grid_.n[1];
      const double *south = j > 0 ? c - sy : none, *north = j + 1 < grid_.n[1] ? c + sy : none,
                   *below = k > 0 ? c - sz : none, *above = k + 1 < grid_.n[2] ? c + sz : none;
      const double* d = diagonal_.data() + start;
      double* out = q.data() + start;
      const double wx = weight_[0], wy = weight_[1], wz = weight_[2];
#pragma omp simd
      for (int i = 0; i < n; ++i)
        out[i] = d[i] * c[i] - wy * (south[i] + north[i]) - wz * (below[i] + above[i]);
#pragma omp simd
      for (int i = 1; i < n; ++i) out[i] -= wx * c[i - 1];
      double sum = 0;
#pragma omp simd reduction(+ : sum)
      for (int i = 0; i < n; ++i) {
        const double value = out[i] - (i + 1 < n ? wx * c[i + 1] : 0);
        out[i] = d[i] == 0 ? 0 : value;
        sum += out[i] * c[i];
      }
      return std::array<double, 1>{sum};
    })[0];
  }

private:
  Grid grid_;
  std::array<double, 3> weight_;
  std::vector<double> diagonal_;
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
          b[p] += a.weight(axis) * links.difference(before, axis, at[axis] - 1);
        if (at[axis] + 1 < g.n[axis] && links.isFluid(after))
          b[p] -= a.weight(axis) * links.difference(p, axis, at[axis]);
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
  const GraphLaplacian a(problem);
  const double* d = a.diagonal().data();
  // The exact inverse on the whole box, negative definite as the Laplacian is: a good approximation to that
  // on any part of it, so that iterations hardly grow with the grid.
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
    sumOverNodes(g, [&](std::size_t i) { return z[i] = float(scale * r[i]); });
    box.solve(z.data());
    const double rzNew = sumOverNodes(g, [&](std::size_t i) { return r[i] * z[i]; }) / scale;
    const double beta = out.iterations == 0 ? 0 : rzNew / rz;
    rz = rzNew;
    sumOverNodes(g, [&](std::size_t i) { return p[i] = d[i] == 0 ? 0 : z[i] / scale + beta * p[i]; });
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
