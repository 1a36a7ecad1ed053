#include "PseudoTracking.h"

#include <Eigen/Core>
#include <algorithm>
#include <optional>
#include <stdexcept>
#include <string>

namespace rimflow {
namespace {

using Eigen::Vector3d;

Vector3d vectorAt(const float* field, std::size_t node) {
  return Eigen::Map<const Eigen::Vector3f>(field + 3 * node).cast<double>();
}

// One snapshot beside the present one; time < 0: before it.
struct Neighbour {
  const float* velocity;
  const unsigned char* mask;
  double time; // from the present one, s
};

// Moves of a block by a node per axis, the shortest first: a place in the middle cell of a block may
// as well lie in the first or the last of another.
const std::vector<std::array<int, 3>>& shiftsByLength() {
  static const auto shifts = [] {
    std::vector<std::array<int, 3>> all;
    for (int z = -1; z <= 1; ++z)
      for (int y = -1; y <= 1; ++y)
        for (int x = -1; x <= 1; ++x)
          if (x != 0 || y != 0 || z != 0) all.push_back({x, y, z});
    std::stable_sort(all.begin(), all.end(), [](const auto& a, const auto& b) {
      return a[0] * a[0] + a[1] * a[1] + a[2] * a[2] < b[0] * b[0] + b[1] * b[1] + b[2] * b[2];
    });
    return all;
  }();
  return shifts;
}

// Weights of neighbouring nodes (2: linear, 4: cubic Lagrange) at x, in nodes from the first.
std::array<double, 4> lagrangeWeights(int nodes, double x) {
  if (nodes == 1) return {1, 0, 0, 0};
  if (nodes == 2) return {1 - x, x, 0, 0};
  return {-(x - 1) * (x - 2) * (x - 3) / 6, x * (x - 2) * (x - 3) / 2, -x * (x - 1) * (x - 3) / 2,
          x * (x - 1) * (x - 2) / 6};
}

// A block of nodes that an interpolation uses.
struct Block {
  int first[3], count[3];
};

bool isKnown(const Grid& grid, const Neighbour& snapshot, const Block& b) {
  if (!snapshot.mask) return true;
  for (int k = 0; k < b.count[2]; ++k)
    for (int j = 0; j < b.count[1]; ++j)
      for (int i = 0; i < b.count[0]; ++i)
        if (snapshot.mask[grid.index(b.first[0] + i, b.first[1] + j, b.first[2] + k)]) return false;
  return true;
}

// The block of 4 nodes per axis about a place (in nodes): centred if all of it is fluid, else moved away from
// the wall, but never so far that the place lies outside of it. An axis with fewer than 4 nodes takes 2; one
// of a single node knows no place.
std::optional<Block> blockAbout(const Grid& grid, const Neighbour& snapshot, const Vector3d& place) {
  Block centred;
  for (int a = 0; a < 3; ++a) {
    const int n = grid.n[a];
    centred.count[a] = n == 1 ? 1 : n < 4 ? 2 : 4;
    if (n > 1 && !(place[a] >= 0 && place[a] <= n - 1)) return std::nullopt;
    centred.first[a] =
        n == 1 ? 0 : std::clamp(int(place[a]) + 1 - centred.count[a] / 2, 0, n - centred.count[a]);
  }
  if (isKnown(grid, snapshot, centred)) return centred;
  for (const auto& shift : shiftsByLength()) {
    Block b = centred;
    bool inside = true;
    for (int a = 0; a < 3; ++a) {
      b.first[a] += shift[a];
      const double at = place[a] - b.first[a];
      inside = inside && b.first[a] >= 0 && b.first[a] + b.count[a] <= grid.n[a] &&
               (grid.n[a] == 1 || (at >= 0 && at <= b.count[a] - 1));
    }
    if (inside && isKnown(grid, snapshot, b)) return b;
  }
  return std::nullopt;
}

// The velocity at a place in units of nodes, by interpolation from nodes of the fluid; nothing where there
// are too few of them.
std::optional<Vector3d> velocityAt(const Grid& grid, const Neighbour& snapshot, const Vector3d& place) {
  const auto block = blockAbout(grid, snapshot, place);
  if (!block) return std::nullopt;
  std::array<double, 4> weight[3];
  for (int a = 0; a < 3; ++a) weight[a] = lagrangeWeights(block->count[a], place[a] - block->first[a]);
  Vector3d sum = Vector3d::Zero();
  for (int k = 0; k < block->count[2]; ++k)
    for (int j = 0; j < block->count[1]; ++j)
      for (int i = 0; i < block->count[0]; ++i)
        sum += weight[0][i] * weight[1][j] * weight[2][k] *
               vectorAt(snapshot.velocity,
                        grid.index(block->first[0] + i, block->first[1] + j, block->first[2] + k));
  return sum;
}

// The velocity in a neighbouring snapshot of the particle that is at a node now: its path is
//     x' = x + t (u(x) + u'(x'))/2,
// which is iterated. Nothing if it leaves the fluid that is known.
std::optional<Vector3d> velocityOnPath(const Grid& grid, const Neighbour& snapshot, const Vector3d& place,
                                       const Vector3d& velocity) {
  constexpr int Iterations = 20;
  constexpr double Close = 1e-5; // nodes
  const Vector3d nodesPerMetre(1 / grid.spacing[0], 1 / grid.spacing[1], 1 / grid.spacing[2]);
  Vector3d there = velocity, last = place;
  for (int iteration = 0; iteration < Iterations; ++iteration) {
    const Vector3d next = place + 0.5 * snapshot.time * (velocity + there).cwiseProduct(nodesPerMetre);
    const auto sampled = velocityAt(grid, snapshot, next);
    if (!sampled) return std::nullopt;
    there = *sampled;
    if ((next - last).cwiseAbs().maxCoeff() < Close) break;
    last = next;
  }
  return there;
}

// Du/Dt from the velocity now, before and after: the slope of the parabola through three, or of the line
// through two.
std::optional<Vector3d> slope(const Vector3d& velocity, const std::optional<Vector3d>& before,
                              double timeBefore, const std::optional<Vector3d>& after, double timeAfter) {
  if (!before && !after) return std::nullopt;
  if (!before) return (*after - velocity) / timeAfter;
  if (!after) return (velocity - *before) / timeBefore;
  return (timeBefore / timeAfter * (*after - velocity) + timeAfter / timeBefore * (velocity - *before)) /
         (timeBefore + timeAfter);
}

void check(const VelocitySeries& series) {
  if (!series.present) throw std::invalid_argument("pseudo-tracking needs the velocity of the present");
  if (!series.previous && !series.next)
    throw std::invalid_argument("pseudo-tracking needs the snapshot before or after the present one");
  if (series.previous && !(series.timeBefore > 0))
    throw std::invalid_argument("the time from the previous snapshot is " +
                                std::to_string(series.timeBefore) + " s; it must be greater than 0");
  if (series.next && !(series.timeAfter > 0))
    throw std::invalid_argument("the time to the next snapshot is " + std::to_string(series.timeAfter) +
                                " s; it must be greater than 0");
}

} // namespace

PseudoTrackingResult pseudoTracking(const VelocitySeries& series, const Progress& progress) {
  check(series);
  const Grid& grid = series.grid;
  const Neighbour previous{series.previous, series.previousMask, -series.timeBefore},
      next{series.next, series.nextMask, series.timeAfter};
  PseudoTrackingResult out;
  out.acceleration.assign(3 * grid.size(), 0);
  out.mask.assign(grid.size(), 1);
  const auto acceleration = [&](const Vector3d& place, const Vector3d& velocity) {
    const auto on = [&](const Neighbour& snapshot) {
      return snapshot.velocity ? velocityOnPath(grid, snapshot, place, velocity) : std::nullopt;
    };
    return slope(velocity, on(previous), series.timeBefore, on(next), series.timeAfter);
  };
  const auto row = [&](std::size_t piece, const Progress&) {
    const int j = int(piece) % grid.n[1], k = int(piece) / grid.n[1];
    for (int i = 0; i < grid.n[0]; ++i) {
      const std::size_t node = grid.index(i, j, k);
      if (series.presentMask && series.presentMask[node]) continue;
      const auto a = acceleration(Vector3d(i, j, k), vectorAt(series.present, node));
      if (!a) continue;
      Eigen::Map<Eigen::Vector3f>(out.acceleration.data() + 3 * node) = a->cast<float>();
      out.mask[node] = 0;
    }
  };
  if (!forEachPiece(std::size_t(grid.n[1]) * std::size_t(grid.n[2]), progress, row)) return {};
  return out;
}

} // namespace rimflow
