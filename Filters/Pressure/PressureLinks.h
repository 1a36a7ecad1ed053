#pragma once
#include "PressureProblem.h"
#include "Stencils.h"

#include <array>

namespace rimflow {

/// Calls f(node, {i, j, k}) for every node that holds fluid, in parallel. mask: as in PressureProblem.
template <class F>
void forEachFluidNode(const Grid& grid, const unsigned char* mask, F&& f) {
  forEachRow<float>(grid, 0, [&](int j, int k, auto&) {
    for (int i = 0; i < grid.n[0]; ++i)
      if (const std::size_t node = grid.index(i, j, k); !mask || !mask[node])
        f(node, std::array<int, 3>{i, j, k});
  });
}

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
  double difference(std::size_t node, int axis, int i) const {
    const std::ptrdiff_t s = stride_[axis];
    return difference(node, axis, i > 0 && isFluid(node - s),
                      i + 2 < problem_.grid.n[axis] && isFluid(node + 2 * s));
  }
  /// The same for all links along the axis that start in the row (j, k), where the next node is in the grid.
  /// What stands where a node of the link holds no fluid means nothing.
  void differences(int axis, int j, int k, double* out) const {
    const Grid& g = problem_.grid;
    const std::ptrdiff_t s = stride_[axis];
    const std::size_t row = g.index(0, j, k);
    const int at = axis == 1 ? j : k, count = axis == 0 ? g.n[0] - 1 : g.n[0];
    for (int i = 0; i < count; ++i) {
      const int place = axis == 0 ? i : at;
      out[i] = difference(row + i, axis, place > 0 && isFluid(row + i - s),
                          place + 2 < g.n[axis] && isFluid(row + i + 2 * s));
    }
  }

private:
  /// before, after: whether the nodes beside the link are fluid. Fourth order: the integral of the cubic
  /// through four nodes; next to the mask or a face of the parabola through three.
  double difference(std::size_t node, int axis, bool before, bool after) const {
    const std::ptrdiff_t s = 3 * stride_[axis];
    const double h = problem_.grid.spacing[axis];
    const float* g = problem_.gradient + 3 * node + axis;
    if (order_ == 4) {
      if (before && after) return h / 24 * (13 * (double(g[0]) + g[s]) - g[-s] - g[2 * s]);
      if (after) return h / 12 * (5 * double(g[0]) + 8 * double(g[s]) - g[2 * s]);
      if (before) return h / 12 * (5 * double(g[s]) + 8 * double(g[0]) - g[-s]);
    }
    return h / 2 * (double(g[0]) + g[s]);
  }

  const PressureProblem& problem_;
  int order_;
  std::array<std::ptrdiff_t, 3> stride_;
};

} // namespace rimflow
