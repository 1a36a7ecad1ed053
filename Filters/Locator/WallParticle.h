#pragma once
#include <Eigen/Core>
#include <cstdint>
#include <limits>

namespace rimflow {

/// A tracer near the wall of a sphere in one snapshot.
struct WallParticle {
  Eigen::Vector3f offset; ///< from the estimated centre, m
  Eigen::Vector3f velocity =
      Eigen::Vector3f::Constant(std::numeric_limits<float>::quiet_NaN()); ///< m/s; NaN: not measured
  std::int64_t track = -1;                                                ///< id of its track; -1: unknown
};

} // namespace rimflow
