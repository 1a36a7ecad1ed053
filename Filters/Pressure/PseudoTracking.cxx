#include "PseudoTracking.h"

#include <Eigen/Core>
#include <cmath>
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

// Weights of `points` neighbouring nodes (2: linear, 4: cubic Lagrange) at x, in nodes from the first.
std::array<double, 4> lagrangeWeights(int points, double x) {
  if (points == 1) return {1, 0, 0, 0};
  if (points == 2) return {1 - x, x, 0, 0};
  return {-(x - 1) * (x - 2) * (x - 3) / 6, x * (x - 2) * (x - 3) / 2, -x * (x - 1) * (x - 3) / 2,
          x * (x - 1) * (x - 2) / 6};
}

// The velocity at a place in units of nodes; nothing outside of the grid, or where an interpolation would use
// a node of the mask. points: 2 (trilinear) or 4 (tricubic) per axis. An axis of one node knows no place.
std::optional<Vector3d> velocityAt(const Grid& grid, const Neighbour& snapshot, const Vector3d& place,
                                   int points) {
  int first[3], count[3];
  std::array<double, 4> weight[3];
  for (int a = 0; a < 3; ++a) {
    const int n = grid.n[a];
    count[a] = n == 1 ? 1 : n < points ? 2 : points;
    if (n > 1 && !(place[a] >= 0 && place[a] <= n - 1)) return std::nullopt;
    first[a] = n == 1 ? 0 : std::clamp(int(place[a]) + 1 - count[a] / 2, 0, n - count[a]);
    weight[a] = lagrangeWeights(count[a], place[a] - first[a]);
  }
  Vector3d sum = Vector3d::Zero();
  for (int k = 0; k < count[2]; ++k)
    for (int j = 0; j < count[1]; ++j)
      for (int i = 0; i < count[0]; ++i) {
        const double w = weight[0][i] * weight[1][j] * weight[2][k];
        const std::size_t node = grid.index(first[0] + i, first[1] + j, first[2] + k);
        if (w == 0) continue;
        if (snapshot.mask && snapshot.mask[node]) return std::nullopt;
        sum += w * vectorAt(snapshot.velocity, node);
      }
  return sum;
}

// The velocity in a neighbouring snapshot of the particle that is at a node now: its path is
//     x' = x + t (u(x) + u'(x'))/2,
// which is iterated. Nothing if it leaves the fluid that is known.
std::optional<Vector3d> velocityOnPath(const Grid& grid, const Neighbour& snapshot, const Vector3d& place,
                                       const Vector3d& velocity, int points) {
  constexpr int Iterations = 20;
  constexpr double Close = 1e-5; // nodes
  const Vector3d nodesPerMetre(1 / grid.spacing[0], 1 / grid.spacing[1], 1 / grid.spacing[2]);
  Vector3d there = velocity, last = place;
  for (int iteration = 0; iteration < Iterations; ++iteration) {
    const Vector3d next = place + 0.5 * snapshot.time * (velocity + there).cwiseProduct(nodesPerMetre);
    const auto sampled = velocityAt(grid, snapshot, next, points);
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

PseudoTrackingResult pseudoTracking(const VelocitySeries& series) {
  check(series);
  const Grid& grid = series.grid;
  const Neighbour previous{series.previous, series.previousMask, -series.timeBefore},
      next{series.next, series.nextMask, series.timeAfter};
  PseudoTrackingResult out;
  out.acceleration.assign(3 * grid.size(), 0);
  out.mask.assign(grid.size(), 1);
  // Both sides with the same interpolation, because then most of its error cancels; one side only where no
  // interpolation serves both.
  const auto acceleration = [&](const Vector3d& place, const Vector3d& velocity) {
    std::optional<Vector3d> oneSided;
    for (int points : {4, 2}) {
      const auto on = [&](const Neighbour& snapshot) {
        return snapshot.velocity ? velocityOnPath(grid, snapshot, place, velocity, points) : std::nullopt;
      };
      const auto before = on(previous), after = on(next);
      const auto found = slope(velocity, before, series.timeBefore, after, series.timeAfter);
      if (before && after) return found;
      if (!oneSided) oneSided = found;
    }
    return oneSided;
  };
#pragma omp parallel for collapse(2) schedule(dynamic, 16)
  for (int k = 0; k < grid.n[2]; ++k)
    for (int j = 0; j < grid.n[1]; ++j)
      for (int i = 0; i < grid.n[0]; ++i) {
        const std::size_t node = grid.index(i, j, k);
        if (series.presentMask && series.presentMask[node]) continue;
        const auto a = acceleration(Vector3d(i, j, k), vectorAt(series.present, node));
        if (!a) continue;
        Eigen::Map<Eigen::Vector3f>(out.acceleration.data() + 3 * node) = a->cast<float>();
        out.mask[node] = 0;
      }
  return out;
}

} // namespace rimflow
