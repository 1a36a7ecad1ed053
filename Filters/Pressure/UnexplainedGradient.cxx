#include "UnexplainedGradient.h"

#include "PressureLinks.h"
#include "Stencils.h"

#include <cmath>

namespace rimflow {

std::vector<float> unexplainedGradient(const PressureProblem& problem, const float* pressure, int order) {
  const Grid& g = problem.grid;
  const PressureLinks links(problem, order);
  std::vector<float> unexplained(g.size(), 0);
  const auto squared = [&](std::size_t node, int axis, int i) {
    const std::size_t next = node + std::size_t(links.stride(axis));
    const double difference = double(pressure[next]) - double(pressure[node]);
    return std::pow((difference - links.difference(node, axis, i)) / g.spacing[axis], 2);
  };
  forEachRow<float>(g, 0, [&](int j, int k, auto&) {
    for (int i = 0; i < g.n[0]; ++i) {
      const std::size_t node = g.index(i, j, k);
      if (!links.isFluid(node)) continue;
      const int at[3] = {i, j, k};
      double sum = 0;
      int count = 0;
      for (int axis = 0; axis < 3; ++axis) {
        const std::size_t stride = std::size_t(links.stride(axis));
        if (at[axis] > 0 && links.isFluid(node - stride))
          sum += squared(node - stride, axis, at[axis] - 1), ++count;
        if (at[axis] + 1 < g.n[axis] && links.isFluid(node + stride))
          sum += squared(node, axis, at[axis]), ++count;
      }
      if (count > 0) unexplained[node] = float(std::sqrt(sum / count));
    }
  });
  return unexplained;
}

} // namespace rimflow
