#pragma once
#include <Eigen/Geometry>
#include <cmath>

namespace rimflow {

/// A rigid body: a signed distance with a pose and a velocity. Today a sphere; other shapes add their own
/// distance.
struct Body {
  double diameter = 0;                                       ///< m, > 0
  Eigen::Vector3d centre = Eigen::Vector3d::Zero();          ///< m
  Eigen::Vector3d velocity = Eigen::Vector3d::Zero();        ///< of the centre, m/s
  Eigen::Vector3d acceleration = Eigen::Vector3d::Zero();    ///< of the centre, m/s2
  Eigen::Vector3d angularVelocity = Eigen::Vector3d::Zero(); ///< rad/s

  /// Distance from the wall, m; negative inside.
  double signedDistance(const Eigen::Vector3d& x) const { return (x - centre).norm() - 0.5 * diameter; }
  bool contains(const Eigen::Vector3d& x) const { return signedDistance(x) < 0; }

  /// Velocity of the material point at x: V + W x r.
  Eigen::Vector3d velocityAt(const Eigen::Vector3d& x) const {
    return velocity + angularVelocity.cross(x - centre);
  }
  /// Acceleration of the material point at x (constant W): A + W x (W x r).
  Eigen::Vector3d accelerationAt(const Eigen::Vector3d& x) const {
    return acceleration + angularVelocity.cross(angularVelocity.cross(x - centre));
  }
};

} // namespace rimflow
