#pragma once
#include "WallParticle.h"

#include <memory>
#include <vector>

namespace rimflow {

/// The tracers next to a sphere's wall in one snapshot, and what is known of the seeding there.
struct WallView {
  std::vector<WallParticle>
      particles;               ///< all whose distance from the wall is within `reach`, and more outside
  double reach = 0;            ///< m, > 0
  double ghostRate = 0.005;    ///< density of ghosts in the ball over that of tracers around it, 0 to 1
  double positionNoise = 5e-6; ///< of a particle per component as this snapshot estimates it, m
  /// Gradient (1/m) and Hessian (1/m2) of the number of tracers that a ball of fluid would hold at the
  /// centre, with respect to its centre; 0 in uniform seeding.
  Eigen::Vector3d tilt = Eigen::Vector3d::Zero();
  Eigen::Matrix3d bend = Eigen::Matrix3d::Zero();
};

/// What one snapshot says of the centre by itself.
struct CentreEstimate {
  double time = 0;                                      ///< s
  bool found = false;                                   ///< false: nothing below counts
  Eigen::Vector3d centre = Eigen::Vector3d::Zero();     ///< m
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero(); ///< m2, positive definite
  std::shared_ptr<const WallView> wall; ///< null: not kept, then only centre and covariance count
};

} // namespace rimflow
