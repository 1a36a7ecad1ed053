#include "ResamplingGrid.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <stdexcept>
#include <string>
#include <vector>

namespace rimflow {
namespace {

std::string millimetres(double metres) {
  char text[32];
  std::snprintf(text, sizeof text, "%.4g mm", 1e3 * metres);
  return text;
}

} // namespace

Grid resamplingGrid(const float* positions, std::size_t count, double spacing,
                    const std::optional<std::array<double, 6>>& bounds) {
  std::array<std::vector<float>, 3> x;
  for (std::size_t p = 0; p < count; ++p) {
    const float* q = positions + 3 * p;
    if (std::isfinite(q[0]) && std::isfinite(q[1]) && std::isfinite(q[2]))
      for (int a = 0; a < 3; ++a) x[a].push_back(q[a]);
  }
  const std::size_t n = x[0].size();
  if (n < 20)
    throw std::invalid_argument("there are " + std::to_string(n) +
                                " particles with finite positions; at least 20 are needed");

  std::array<double, 6> box{};
  for (int a = 0; a < 3; ++a) {
    const auto quantile = [&](double q) {
      const auto at = x[a].begin() + std::ptrdiff_t(std::lround(q * double(n - 1)));
      std::nth_element(x[a].begin(), at, x[a].end());
      return double(*at);
    };
    box[2 * a] = quantile(0.0005);
    box[2 * a + 1] = quantile(0.9995);
  }
  const double volume = (box[1] - box[0]) * (box[3] - box[2]) * (box[5] - box[4]);
  if (!(volume > 0))
    throw std::invalid_argument("the particles lie in a plane or on a line; they must fill a volume");
  if (spacing <= 0) spacing = 0.5 * std::cbrt(volume / double(n));
  if (bounds) box = *bounds;

  Grid grid;
  double nodes = 1;
  for (int a = 0; a < 3; ++a) {
    const double length = box[2 * a + 1] - box[2 * a];
    if (!(length > 0))
      throw std::invalid_argument("the bounds along " + std::string(1, "xyz"[a]) + " run from " +
                                  millimetres(box[2 * a]) + " to " + millimetres(box[2 * a + 1]) +
                                  "; the second must be greater");
    const double cells = std::floor(length / spacing + 1e-6);
    nodes *= cells + 1;
    if (cells < 4 || nodes > std::pow(2, 28))
      throw std::invalid_argument(
          "a spacing of " + millimetres(spacing) + " would put " + std::to_string((long long)(cells + 1)) +
          " nodes on " + millimetres(length) + " along " + std::string(1, "xyz"[a]) +
          (cells < 4 ? "; at least 5 are needed, so choose a smaller one" : "; choose a larger one"));
    grid.n[a] = int(cells) + 1;
    grid.spacing[a] = spacing;
    grid.origin[a] = box[2 * a] + 0.5 * (length - cells * spacing);
  }
  return grid;
}

} // namespace rimflow
