#include "PressureGradient.h"

#include "BoxPoisson.h"
#include "PressureLinks.h"
#include "Stencils.h"

#include <algorithm>
#include <cmath>

namespace rimflow {
namespace {

// Second derivative along an axis of one component of the velocity, from fluid nodes only: central, or next
// to the mask or a face the difference of second order that looks away from it; 0 where fewer than three
// nodes are in a row.
class SecondDifference {
public:
  SecondDifference(const Grid& grid, const float* velocity, const unsigned char* mask)
      : grid_(grid), velocity_(velocity), mask_(mask) {}

  double operator()(std::size_t node, int axis, int i, int component) const {
    const std::ptrdiff_t stride[3] = {1, grid_.n[0], std::ptrdiff_t(grid_.n[0]) * grid_.n[1]};
    const auto fluid = [&](int step) {
      return i + step >= 0 && i + step < grid_.n[axis] && !(mask_ && mask_[node + step * stride[axis]]);
    };
    const auto f = [&](int step) {
      return double(velocity_[3 * (std::ptrdiff_t(node) + step * stride[axis]) + component]);
    };
    const double h2 = grid_.spacing[axis] * grid_.spacing[axis];
    const bool before = fluid(-1), after = fluid(1);
    if (before && after) return (f(-1) - 2 * f(0) + f(1)) / h2;
    if (!before && !after) return 0;
    const int s = after ? 1 : -1;
    if (!fluid(2 * s)) return 0;
    if (!fluid(3 * s)) return (f(0) - 2 * f(s) + f(2 * s)) / h2;
    return (2 * f(0) - 5 * f(s) + 4 * f(2 * s) - f(3 * s)) / h2;
  }

private:
  const Grid& grid_;
  const float* velocity_;
  const unsigned char* mask_;
};

// Calls f(node, {i, j, k}) for every node that holds fluid, in parallel.
template <class F>
void forEachFluidNode(const Grid& grid, const unsigned char* mask, F&& f) {
  forEachRow<float>(grid, 0, [&](int j, int k, auto&) {
    for (int i = 0; i < grid.n[0]; ++i) {
      const std::size_t node = grid.index(i, j, k);
      const int at[3] = {i, j, k};
      if (!mask || !mask[node]) f(node, at);
    }
  });
}

} // namespace

std::vector<float> pressureGradient(const Grid& grid, const float* velocity, const float* acceleration,
                                    const unsigned char* mask, double density, double viscosity) {
  std::vector<float> gradient(3 * grid.size(), 0);
  const SecondDifference second(grid, velocity, mask);
  forEachFluidNode(grid, mask, [&](std::size_t node, const int* at) {
    for (int c = 0; c < 3; ++c) {
      double laplacian = 0;
      if (velocity && viscosity > 0)
        for (int axis = 0; axis < 3; ++axis) laplacian += second(node, axis, at[axis], c);
      gradient[3 * node + c] = float(-density * (acceleration[3 * node + c] - viscosity * laplacian));
    }
  });
  return gradient;
}

std::vector<float> pressureError(const Grid& grid, const float* gradient, const float* pressure,
                                 const unsigned char* mask) {
  // What is left of each link, at the nodes: r = grad p - g, without divergence.
  const PressureProblem problem{grid, gradient, mask};
  const PressureLinks links(problem, 4);
  std::array<std::vector<float>, 3> rest;
  for (auto& r : rest) r.assign(grid.size(), 0);
  forEachFluidNode(grid, mask, [&](std::size_t node, const int* at) {
    for (int axis = 0; axis < 3; ++axis) {
      double sum = 0;
      int count = 0;
      const auto add = [&](std::size_t from, int i) {
        const std::size_t to = from + links.stride(axis);
        sum += pressure[to] - pressure[from] - links.difference(from, axis, i);
        ++count;
      };
      if (at[axis] > 0 && links.isFluid(node - links.stride(axis)))
        add(node - links.stride(axis), at[axis] - 1);
      if (at[axis] + 1 < grid.n[axis] && links.isFluid(node + links.stride(axis))) add(node, at[axis]);
      if (count) rest[axis][node] = float(sum / (count * grid.spacing[axis]));
    }
  });
  // Errors of the gradient that know no direction put, at each wavenumber k, twice as much into the two
  // components across k, which is r, as into the one along k, which is integrated to the pressure:
  // |p(k)|^2 = |r(k)|^2/(2 k^2).
  const std::array<AxisBasis, 3> bases{neumannBasis(grid.n[0], grid.spacing[0]),
                                       neumannBasis(grid.n[1], grid.spacing[1]),
                                       neumannBasis(grid.n[2], grid.spacing[2])};
  const BoxPoisson<float> inverseRoot(
      grid, bases, [](double eigenvalue) { return eigenvalue == 0 ? 0 : 1 / std::sqrt(-eigenvalue); });
  float* fields[3] = {rest[0].data(), rest[1].data(), rest[2].data()};
  inverseRoot.solve(fields, 3);
  // Its mean square over a neighbourhood of a few nodes, of fluid only
  const double reach = 4 * std::max({grid.spacing[0], grid.spacing[1], grid.spacing[2]});
  const BoxPoisson<float> mean(grid, bases,
                               [&](double eigenvalue) { return std::exp(0.5 * reach * reach * eigenvalue); });
  std::vector<float> square(grid.size(), 0), fluid(grid.size(), 0);
  forEachFluidNode(grid, mask, [&](std::size_t node, const int*) {
    for (const auto& r : rest) square[node] += r[node] * r[node] / 2;
    fluid[node] = 1;
  });
  float* means[2] = {square.data(), fluid.data()};
  mean.solve(means, 2);
  std::vector<float> sigma(grid.size(), 0);
  forEachFluidNode(grid, mask, [&](std::size_t node, const int*) {
    sigma[node] = std::sqrt(std::max(0.f, square[node]) / std::max(1e-3f, fluid[node]));
  });
  return sigma;
}

} // namespace rimflow
