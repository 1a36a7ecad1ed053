#pragma once
#include "PressureProblem.h"

#include <array>

namespace rimflow {

/// Pressure differences between neighbouring fluid nodes, from their gradients.
class PressureLinks {
public:
  PressureLinks(const PressureProblem& problem, int order) : problem_(problem), order_(order) {
    const auto& n = problem.grid.n;
    stride_ = {1, std::ptrdiff_t(n[0]), std::ptrdiff_t(n[0]) * n[1]};
  }
  std::ptrdiff_t stride(int axis) const { return stride_[axis]; }
  bool isFluid(std::size_t node) const { return problem_.isFluid(node); }

  /// From `node` to the next one along the axis, both of them fluid; i is the node's index on the axis.
  /// Fourth order: the integral of the cubic through four nodes; next to the mask or a face of the parabola
  /// through three.
  double difference(std::size_t node, int axis, int i) const {
    const std::ptrdiff_t s = stride_[axis];
    const double h = problem_.grid.spacing[axis];
    const float* g = problem_.gradient + axis;
    const auto at = [&](std::ptrdiff_t step) { return double(g[3 * (std::ptrdiff_t(node) + step * s)]); };
    if (order_ == 4) {
      const bool before = i > 0 && isFluid(node - s);
      const bool after = i + 2 < problem_.grid.n[axis] && isFluid(node + 2 * s);
      if (before && after) return h / 24 * (13 * (at(0) + at(1)) - at(-1) - at(2));
      if (after) return h / 12 * (5 * at(0) + 8 * at(1) - at(2));
      if (before) return h / 12 * (5 * at(1) + 8 * at(0) - at(-1));
    }
    return h / 2 * (at(0) + at(1));
  }

private:
  const PressureProblem& problem_;
  int order_;
  std::array<std::ptrdiff_t, 3> stride_;
};

} // namespace rimflow
