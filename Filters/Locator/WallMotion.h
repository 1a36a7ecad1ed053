#pragma once
#include "WallParticle.h"

#include <optional>
#include <vector>

namespace rimflow {

/// What is known of a vector beforehand.
struct GaussianVector {
  Eigen::Vector3d mean = Eigen::Vector3d::Zero();
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero(); ///< positive semidefinite
};

struct WallMotionOptions {
  double radius = 0;        ///< R of the sphere, m, > 0
  double reach = 0.3;       ///< particles up to this distance from the wall are used, R, 0.05 to 1
  int minimumTracks = 12;   ///< fewer distinct tracks: not enough; at least 4 count
  double velocityNoise = 0; ///< of a particle, standard deviation per component, m/s, >= 0: the least that is
                            ///< believed; how much it is comes from the residuals
  std::optional<GaussianVector> velocityPrior; ///< of the sphere's velocity, m/s, if known from elsewhere
  /// Of the centre from which the offsets are taken, m2, positive semidefinite; common to all snapshots.
  Eigen::Matrix3d centreCovariance = Eigen::Matrix3d::Zero();
};

struct WallMotion {
  bool enough = false; ///< false: too few tracks near the wall, nothing below counts but the numbers of them
  Eigen::Vector3d velocity = Eigen::Vector3d::Zero();                  ///< V of the sphere, m/s
  Eigen::Matrix3d velocityCovariance = Eigen::Matrix3d::Zero();        ///< m2/s2
  Eigen::Vector3d angularVelocity = Eigen::Vector3d::Zero();           ///< omega, rad/s
  Eigen::Matrix3d angularVelocityCovariance = Eigen::Matrix3d::Zero(); ///< rad2/s2
  /// The true centre less the given one, m, as far as the flow next to the wall tells; 0 without a
  /// centreCovariance. Better than nothing, but not to be trusted: see methods-locator.md.
  Eigen::Vector3d centreCorrection = Eigen::Vector3d::Zero();
  int particles = 0, tracks = 0; ///< that were used; a particle of unknown track counts as a track
  double residual = 0;           ///< root mean square of what the fit leaves of a velocity component, m/s
};

/// The sphere's velocity and rotation from the particles next to its wall (no slip), from one snapshot or
/// from neighbouring ones in which the motion hardly changes (the answer is their mean; the flow relative to
/// the sphere is taken to be steady meanwhile).
///
/// With r from the centre, n = r/|r|, s = |r| - R the distance from the wall, the velocity is
///     u = V + omega x r + w(n, s) + noise,   w_t = f0(s) a(n) + sum over k of fk(s) bk(n),
///     w_n = -1/(R + s)^2 integral of (R + s') div w_t ds'                   (continuity, 1/R div per
///     radian).
/// a and bk are tangential vector fields on the sphere, in vector spherical harmonics up to degree 4; f0 = s,
/// the fk the leading modes of a slope that walks randomly away from its wall value. Their coefficients are
/// Gaussian with variances that fall as degree^-4; so is the error of the centre, which shifts every s.
/// Noise: white per velocity, and per track a constant and a part that grows with s, so that many snapshots
/// of the same tracks are not taken for many measurements. The scales of all five are the most probable ones
/// given the data (evidence; MacKay 1992, "Bayesian interpolation"). The answer is the posterior of V and
/// omega.
///
/// Particles more than 5 standard deviations off (ghosts) are left out. A velocity that is not finite is
/// skipped. Throws std::invalid_argument when an option is out of range.
WallMotion fitWallMotion(const std::vector<std::vector<WallParticle>>& snapshots,
                         const WallMotionOptions& options);

} // namespace rimflow
