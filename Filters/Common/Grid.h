#pragma once
#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>

namespace rimflow {

/// A regular Cartesian grid of nodes, x fastest (as in vtkImageData).
struct Grid {
  std::array<double, 3> origin{0, 0, 0};  ///< position of node (0, 0, 0), m
  std::array<double, 3> spacing{1, 1, 1}; ///< distance between nodes per axis, m, > 0
  std::array<int, 3> n{0, 0, 0};          ///< nodes per axis

  std::size_t size() const { return std::size_t(n[0]) * n[1] * n[2]; }
  std::size_t index(int i, int j, int k) const { return i + std::size_t(n[0]) * (j + std::size_t(n[1]) * k); }
  std::array<double, 3> position(int i, int j, int k) const {
    return {origin[0] + i * spacing[0], origin[1] + j * spacing[1], origin[2] + k * spacing[2]};
  }
};

/// Calls f(i, j, k) for every node of the grid within `reach` of x along each axis, m: the cube around a
/// ball.
template <class F>
void forEachNodeNear(const Grid& g, const double* x, double reach, F&& f) {
  int low[3], high[3];
  for (int a = 0; a < 3; ++a) {
    low[a] = std::max(0, int(std::ceil((x[a] - reach - g.origin[a]) / g.spacing[a])));
    high[a] = std::min(g.n[a] - 1, int(std::floor((x[a] + reach - g.origin[a]) / g.spacing[a])));
  }
  for (int k = low[2]; k <= high[2]; ++k)
    for (int j = low[1]; j <= high[1]; ++j)
      for (int i = low[0]; i <= high[0]; ++i) f(i, j, k);
}

} // namespace rimflow
