#include "ParticleIndex.h"

#include <algorithm>
#include <array>
#include <functional>
#include <queue>

namespace rimflow {
namespace {

constexpr double StrayShare = 5e-4; // of the particles, per side of the box
constexpr double PerCell = 8;

/// The (k+1)-th smallest value of one component under `less`, among finite positions.
template <class Less>
float extreme(const std::vector<std::array<float, 3>>& points, int axis, std::size_t k, Less less) {
  std::priority_queue<float, std::vector<float>, Less> kept(less); // the worst of the best k+1 on top
  for (const auto& p : points) {
    if (kept.size() <= k)
      kept.push(p[axis]);
    else if (less(p[axis], kept.top())) {
      kept.pop();
      kept.push(p[axis]);
    }
  }
  return kept.top();
}

} // namespace

ParticleIndex::ParticleIndex(const float* positions, std::size_t count) {
  std::vector<std::array<float, 3>> points;
  std::vector<std::uint32_t> ids;
  points.reserve(count);
  ids.reserve(count);
  for (std::size_t p = 0; p < count; ++p) {
    const float* x = positions + 3 * p;
    if (!std::isfinite(x[0]) || !std::isfinite(x[1]) || !std::isfinite(x[2])) continue;
    points.push_back({x[0], x[1], x[2]});
    ids.push_back(std::uint32_t(p));
  }
  rejected_ = count - points.size();
  if (points.empty()) {
    first_.assign(2, 0);
    return;
  }

  const std::size_t strays = std::size_t(StrayShare * points.size());
  for (int side = 0; side < 6; ++side) {
    const int a = side / 2;
    if (side % 2 == 0)
      box_.lower[a] = extreme(points, a, strays, std::less<float>());
    else
      box_.upper[a] = extreme(points, a, strays, std::greater<float>());
  }

  const Eigen::Vector3d size = box_.size();
  const double largest = std::max(size.maxCoeff(), 1e-9);
  const double volume = size.cwiseMax(1e-3 * largest).prod(); // a sheet has no volume
  cell_ = std::max(std::cbrt(PerCell * volume / points.size()), largest / 1000);
  for (int a = 0; a < 3; ++a) n_[a] = std::max(1, int(std::ceil(size[a] / cell_)));

  const std::ptrdiff_t n = std::ptrdiff_t(points.size());
  std::vector<std::uint32_t> cell(n);
  for (std::ptrdiff_t p = 0; p < n; ++p) {
    int c[3];
    for (int a = 0; a < 3; ++a) c[a] = cellOf(a, points[p][a] - box_.lower[a]);
    cell[p] = std::uint32_t(c[0] + n_[0] * (c[1] + std::size_t(n_[1]) * c[2]));
  }
  first_.assign(std::size_t(n_[0]) * n_[1] * n_[2] + 1, 0);
  for (std::uint32_t c : cell) ++first_[c + 1];
  for (std::size_t c = 1; c < first_.size(); ++c) first_[c] += first_[c - 1];
  std::vector<std::uint32_t> next(first_.begin(), first_.end() - 1);
  x_.resize(n);
  y_.resize(n);
  z_.resize(n);
  id_.resize(n);
  for (std::ptrdiff_t p = 0; p < n; ++p) {
    const std::uint32_t to = next[cell[p]]++;
    x_[to] = float(points[p][0] - box_.lower[0]);
    y_[to] = float(points[p][1] - box_.lower[1]);
    z_[to] = float(points[p][2] - box_.lower[2]);
    id_[to] = ids[p];
  }
}

std::size_t ParticleIndex::countWithin(const Eigen::Vector3d& x, double r) const {
  std::size_t n = 0;
  forEachWithin(x, r, [&n](std::uint32_t, float, float, float) { ++n; });
  return n;
}

} // namespace rimflow
