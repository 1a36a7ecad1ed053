#pragma once
#include "CentreEstimate.h"
#include "CentreStatus.h"
#include "Progress.h"

namespace rimflow {

/// Prior knowledge of the motion. The defaults suit spheres that rise or sink in a liquid.
struct SmootherOptions {
  double jerkIntensity =
      -1; ///< spectral density q of the jerk, m2/s5; < 0: the least that the record does not speak against
  double correlatedFraction = -1; ///< part of the single-snapshot variance that is correlated in time, 0 to
                                  ///< 0.95; < 0: the most likely one
  double correlationTime = 0;     ///< T of that part, s; 0: the most likely one
  double velocityPrior = 1; ///< standard deviation of the velocity about its mean over the record, m/s, > 0
  double accelerationPrior = -1; ///< standard deviation of the acceleration about 0 at the beginning, m/s2; <
                                 ///< 0: the largest of 0.01 to 10 that the record does not speak against
  double rejectionChiSquared =
      30; ///< a snapshot farther than this from the path through all others is left out
  double largestRejectedPart = 0.1;  ///< of the snapshots, 0 to 1
  double largestPredictionSigma = 0; ///< m: a snapshot without a find is lost when its smoothed centre is
                                     ///< less certain than this in any direction; 0: no limit
  double radius =
      0; ///< of the sphere, m: snapshots with a wall are then estimated jointly; 0: each by itself
};

struct SmoothedCentre {
  CentreStatus status =
      CentreStatus::Lost; ///< Predicted: bridged from the neighbours; Lost: no find is near enough
  Eigen::Vector3d centre, velocity, acceleration; ///< m, m/s, m/s2; NaN when lost
  Eigen::Matrix3d centreCovariance, velocityCovariance, accelerationCovariance;
  Eigen::Vector3d angularVelocity = Eigen::Vector3d::Zero(); ///< rad/s, from the flow around the sphere
  /// Of it per component, rad/s; -1: not known.
  Eigen::Vector3d angularVelocitySigma = Eigen::Vector3d::Constant(-1);
};

struct SmoothedTrajectory {
  std::vector<SmoothedCentre> points; ///< one per estimate, in the same order
  double jerkIntensity = 0;           ///< q that was used, m2/s5
  double correlatedFraction = 0;      ///< that was used
  double correlationTime = 0;         ///< s, that was used
  double inflation = 1;         ///< factor >= 1 on the single-snapshot covariances, from the innovations
  int rejected = 0;             ///< snapshots left out as inconsistent with all others
  double accelerationPrior = 0; ///< that was used, m/s2
  double positionNoise = 0;     ///< of a particle, m, that the joint estimate used; 0: there was none
  int joint = 0;                ///< points from the joint estimate of several snapshots
  bool aborted = false;         ///< then nothing else counts
};

/// Position, velocity and acceleration over time from single-snapshot estimates: Kalman filter and
/// Rauch-Tung-Striebel smoother (Rauch, Tung & Striebel 1965) for motion under white-noise jerk of intensity
/// q.
///
/// The same few tracers touch the wall in neighbouring snapshots, so the errors of the estimates are
/// correlated in time, and an average over n of them is not sqrt(n) times better. Each estimate is therefore
///     z = centre + b + white,   cov(white) = s (1 - f) C_k,   cov(b) = s f <C>,   b correlated over the time
///     T (Ornstein-Uhlenbeck),
/// and b is estimated along. f and T maximise the likelihood of the innovations with q; q is then the
/// smallest within 6 of the lowest deviance; s is their mean chi-squared, never below 1. The order of the
/// estimates is free; two of the same time are both used.
///
/// With a radius, and walls in the estimates, this path and its q only start the joint posterior
/// (PathPosterior.h) of windows of up to 48 snapshots that overlap by half; each point comes from the window
/// in whose middle it lies. Where the tracers have velocities, the flow around the sphere
/// (FlowAroundSphere.h) adds what it knows of a window's path, and the rotation rate. Where the motion is too
/// abrupt for that (fewer than four snapshots per window), and before the first and after the last find, the
/// smoother's result stays. When progress aborts, the result says so.
SmoothedTrajectory smoothTrajectory(const std::vector<CentreEstimate>& estimates,
                                    const SmootherOptions& options = {}, const Progress& progress = {});

} // namespace rimflow
