#pragma once
#include "WallParticle.h"

#include <vector>

namespace rimflow {

/// What one snapshot knows of the sphere's wall.
struct WallView {
  double time = 0;                                      ///< s
  Eigen::Vector3d centre = Eigen::Vector3d::Zero();     ///< estimate from this snapshot alone, m
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero(); ///< of it, m2, positive definite
  std::vector<WallParticle> particles; ///< all whose distance from the wall lies within `reach`
  double reach = 0;                    ///< m, > 0
  double ghostRate = 0.005;            ///< density of ghosts in the ball over that of tracers around it, 0 to 1
  /// Gradient (1/m) and Hessian (1/m2) of the number of tracers that a ball of fluid at the centre would hold,
  /// with respect to its centre; 0 in uniform seeding.
  Eigen::Vector3d tilt = Eigen::Vector3d::Zero();
  Eigen::Matrix3d bend = Eigen::Matrix3d::Zero();
};

struct PathOptions {
  double radius = 0;            ///< of the sphere, m, > 0
  double positionNoise = 0;     ///< standard deviation of a particle's position per component, m; 0: from tracks
  double jerkIntensity = 0;     ///< spectral density of the jerk, m2/s5, >= 0
  double velocityPrior = 1;     ///< standard deviation of the velocity about the straight line, m/s, > 0
  double accelerationPrior = 1; ///< standard deviation of the acceleration, m/s2, > 0
  int steps = 1500;             ///< of the Markov chain in its last round
};

/// The path at one time, with what is known of it.
struct PathPoint {
  Eigen::Vector3d centre, velocity, acceleration;                                       ///< m, m/s, m/s2
  Eigen::Matrix3d centreCovariance, velocityCovariance, accelerationCovariance;
};

struct PathPosterior {
  std::vector<PathPoint> points;  ///< one per time asked for
  double positionNoise = 0;       ///< that was used, m
  int intervals = 0;              ///< of the spline
  double effectiveSamples = 0;    ///< of the chain's last round, the least over the spline's coefficients
};

/// The path of the sphere through several snapshots at once: one smooth c(t) that no track may enter.
///
/// A track is a tracer, then it lies outside of the ball in every snapshot, or a ghost (eps), then it may be
/// anywhere. With s_ik the signed distance of track i from the wall in snapshot k, f = 1/(1 + exp(s/w)) and
/// w = 0.627 sigma as in VoidLikelihood.h,
///     log L(c) = sum_i log((1 - eps) prod_k (1 - f_ik) + eps) + a sum_k (1 - eps) N_k(c(t_k)),
/// N the tracers that the ball would hold (counted only as often as tracers change: a is the number of tracks
/// over the number of their instances). A tracer that stays at the wall for many snapshots says the same again
/// and again; the product takes it as one constraint, so that the posterior does not shrink below what is known.
///
/// c(t) is a cubic spline with the prior of white jerk; the posterior is sampled by elliptical slice sampling
/// (Murray, Adams & MacKay 2010) around a Gaussian that is fitted to the samples as w falls to the noise.
/// The same data give the same answer. views: in the order of time, at least 2 with different times.
PathPosterior samplePath(const std::vector<WallView>& views, const std::vector<double>& times, const PathOptions& options);

/// Standard deviation of a particle's position per component from the third differences of the tracks, m; 0 when
/// there are fewer than 30 of them. The snapshots need to be equally spaced for the most part.
double positionNoiseFromTracks(const std::vector<WallView>& views);

} // namespace rimflow
