#include "VoidDistance.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace rimflow {
namespace {

double square(double v) { return v * v; }

} // namespace

std::vector<float> voidDistance(const std::vector<double>& positions, const Grid& grid, double radius) {
  std::array<double, 6> box{1e300, -1e300, 1e300, -1e300, 1e300, -1e300};
  for (std::size_t e = 0; e < positions.size(); ++e) {
    const double x = positions[e];
    box[2 * (e % 3)] = std::min(box[2 * (e % 3)], x);
    box[2 * (e % 3) + 1] = std::max(box[2 * (e % 3) + 1], x);
  }
  /// f(node, distance) for all nodes within `reach` of x
  const auto around = [&](const double* x, double reach, auto&& f) {
    forEachNodeNear(grid, x, reach, [&](int i, int j, int k) {
      const auto y = grid.position(i, j, k);
      const double distance = std::sqrt(square(y[0] - x[0]) + square(y[1] - x[1]) + square(y[2] - x[2]));
      if (distance <= reach) f(grid.index(i, j, k), distance);
    });
  };
  std::vector<bool> taken(grid.size(), false);
  for (std::size_t p = 0; p < positions.size() / 3; ++p)
    around(&positions[3 * p], radius, [&](std::size_t node, double) { taken[node] = true; });
  constexpr float Far = 1e30f;
  std::vector<float> out(grid.size(), Far);
  bool any = false;
  for (int k = 0; k < grid.n[2]; ++k)
    for (int j = 0; j < grid.n[1]; ++j)
      for (int i = 0; i < grid.n[0]; ++i) {
        const auto x = grid.position(i, j, k);
        bool centre = !taken[grid.index(i, j, k)];
        for (int a = 0; a < 3; ++a) centre = centre && x[a] > box[2 * a] && x[a] < box[2 * a + 1];
        if (!centre) continue;
        any = true;
        around(x.data(), 3 * radius, [&](std::size_t node, double distance) {
          out[node] = std::min(out[node], float(distance - radius));
        });
      }
  if (!any) out.clear();
  return out;
}

} // namespace rimflow
