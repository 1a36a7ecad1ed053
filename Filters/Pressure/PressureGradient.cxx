#include "PressureGradient.h"

#include <algorithm>
#include <array>
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

} // namespace

std::vector<float> pressureGradient(const Grid& grid, const float* velocity, const float* acceleration,
                                    const unsigned char* mask, double density, double viscosity,
                                    const Progress& progress) {
  std::vector<float> gradient(3 * grid.size(), 0);
  const SecondDifference second(grid, velocity, mask);
  const auto atNode = [&](std::size_t node, const std::array<int, 3>& at) {
    for (int c = 0; c < 3; ++c) {
      double laplacian = 0;
      if (velocity && viscosity > 0)
        for (int axis = 0; axis < 3; ++axis) laplacian += second(node, axis, at[axis], c);
      gradient[3 * node + c] = float(-density * (acceleration[3 * node + c] - viscosity * laplacian));
    }
  };
  const auto row = [&](std::size_t piece, const Progress&) {
    const int j = int(piece) % grid.n[1], k = int(piece) / grid.n[1];
    for (int i = 0; i < grid.n[0]; ++i)
      if (const std::size_t node = grid.index(i, j, k); !mask || !mask[node]) atNode(node, {i, j, k});
  };
  if (!forEachPiece(std::size_t(grid.n[1]) * std::size_t(grid.n[2]), progress, row)) return {};
  return gradient;
}

} // namespace rimflow
