#include "PressureError.h"

#include "BoxPoisson.h"
#include "PressureLinks.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace rimflow {
namespace {

// Calls f(axis, (p_j - p_i - d_ij)/h) for every link of a fluid node, once for each of its fluid neighbours.
template <class F>
void forEachRest(const PressureProblem& problem, const PressureLinks& links, const float* pressure,
                 std::size_t node, const std::array<int, 3>& at, F&& f) {
  for (int axis = 0; axis < 3; ++axis) {
    const std::size_t stride = std::size_t(links.stride(axis));
    const auto rest = [&](std::size_t from, int i) {
      const double difference = double(pressure[from + stride]) - double(pressure[from]);
      f(axis, (difference - links.difference(from, axis, i)) / problem.grid.spacing[axis]);
    };
    if (at[axis] > 0 && problem.isFluid(node - stride)) rest(node - stride, at[axis] - 1);
    if (at[axis] + 1 < problem.grid.n[axis] && problem.isFluid(node + stride)) rest(node, at[axis]);
  }
}

} // namespace

std::vector<float> unexplainedGradient(const PressureProblem& problem, const float* pressure, int order) {
  const PressureLinks links(problem, order);
  std::vector<float> unexplained(problem.grid.size(), 0);
  forEachFluidNode(problem.grid, problem.mask, [&](std::size_t node, const std::array<int, 3>& at) {
    double sum = 0;
    int count = 0;
    forEachRest(problem, links, pressure, node, at, [&](int, double r) { sum += r * r, ++count; });
    if (count > 0) unexplained[node] = float(std::sqrt(sum / count));
  });
  return unexplained;
}

// r = grad p - g has no divergence. Errors of the gradient that know no direction put, at each wavenumber k,
// twice as much into the two components across k, which is r, as into the one along k, which is integrated to
// the pressure: |p(k)|^2 = |r(k)|^2/(2 k^2). The mean square is taken over a neighbourhood of a few nodes.
std::vector<float> pressureError(const PressureProblem& problem, const float* pressure,
                                 const Progress& progress) {
  const Grid& g = problem.grid;
  const PressureLinks links(problem, 4);
  std::array<std::vector<float>, 3> rest;
  for (auto& r : rest) r.assign(g.size(), 0);
  forEachFluidNode(problem.grid, problem.mask, [&](std::size_t node, const std::array<int, 3>& at) {
    double sum[3] = {};
    int count[3] = {};
    forEachRest(problem, links, pressure, node, at,
                [&](int axis, double r) { sum[axis] += r, ++count[axis]; });
    for (int a = 0; a < 3; ++a)
      if (count[a] > 0) rest[a][node] = float(sum[a] / count[a]);
  });
  if (!goOn(progress, 0.3)) return {};
  const std::array<AxisBasis, 3> bases{neumannBasis(g.n[0], g.spacing[0]), neumannBasis(g.n[1], g.spacing[1]),
                                       neumannBasis(g.n[2], g.spacing[2])};
  const BoxPoisson<float> inverseRoot(
      g, bases, [](double eigenvalue) { return eigenvalue == 0 ? 0 : 1 / std::sqrt(-eigenvalue); });
  if (!goOn(progress, 0.4)) return {};
  float* fields[3] = {rest[0].data(), rest[1].data(), rest[2].data()};
  inverseRoot.solve(fields, 3);
  if (!goOn(progress, 0.6)) return {};

  const double reach = 4 * *std::max_element(g.spacing.begin(), g.spacing.end());
  const BoxPoisson<float> mean(g, bases,
                               [&](double eigenvalue) { return std::exp(0.5 * reach * reach * eigenvalue); });
  std::vector<float> square(g.size(), 0), fluid(g.size(), 0), sigma(g.size(), 0);
  forEachFluidNode(problem.grid, problem.mask, [&](std::size_t node, const auto&) {
    for (const auto& r : rest) square[node] += r[node] * r[node] / 2;
    fluid[node] = 1;
  });
  if (!goOn(progress, 0.7)) return {};
  float* means[2] = {square.data(), fluid.data()};
  mean.solve(means, 2);
  forEachFluidNode(problem.grid, problem.mask, [&](std::size_t node, const auto&) {
    sigma[node] = std::sqrt(std::max(0.f, square[node]) / std::max(1e-3f, fluid[node]));
  });
  return sigma;
}

} // namespace rimflow
