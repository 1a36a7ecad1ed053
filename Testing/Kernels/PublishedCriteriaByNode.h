#pragma once
#include "PublishedCost.h"

#include <algorithm>
#include <cmath>

namespace rimflow {

/// publishedCriteria as it is defined, node by node in double precision: what the fast one is compared with.
/// `o.up` must have length 1.
inline Criteria publishedCriteriaByNode(const ParticleIndex& particles, const FlowField& flow,
                                        const Eigen::Vector3d& x, const PublishedCostOptions& o) {
  const Grid& g = flow.grid;
  const double radius = 0.5 * o.diameter, volume = 4. / 3 * M_PI * radius * radius * radius,
               h = (g.spacing[0] + g.spacing[1] + g.spacing[2]) / 3,
               reach = radius * std::max({o.a, o.c, o.e}) + h;
  double value[4] = {}, weight[4] = {};
  forEachNodeNear(g, x.data(), reach, [&](int i, int j, int k) {
    const std::size_t node = g.index(i, j, k);
    if (flow.mask && flow.mask[node]) return;
    const auto p = g.position(i, j, k);
    const Eigen::Vector3d r(p[0] - x[0], p[1] - x[1], p[2] - x[2]);
    const auto part = [&](double depth) { return std::clamp(depth / h + 0.5, 0., 1.); };
    const auto within = [&](double factor) { return part(factor * radius - r.norm()); };
    const double upper = part(r.dot(o.up)), q = flow.q[node];
    const float* u = flow.velocity + 3 * node;
    const double rise = u[0] * o.up[0] + u[1] * o.up[1] + u[2] * o.up[2];
    const double share[4] = {upper * within(o.a), upper * (within(o.c) - within(o.b)), within(o.a),
                             within(o.e) - within(1)};
    for (int s = 0; s < 4; ++s) weight[s] += share[s], value[s] += share[s] * (s < 2 ? rise : q);
  });
  const auto mean = [&](int s) { return weight[s] > 0 ? value[s] / weight[s] : 0; };
  return {double(particles.countWithin(x, radius)) / volume / o.seedingDensity, mean(0) / o.velocityScale,
          mean(1) / o.velocityScale, o.a * o.a * o.a * mean(2) / o.vortexScale, mean(3) / o.vortexScale};
}

} // namespace rimflow
