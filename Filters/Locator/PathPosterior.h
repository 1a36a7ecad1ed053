#pragma once
#include "CentreEstimate.h"
#include "Progress.h"

namespace rimflow {

/// Centre, velocity and acceleration of a body at one time, from another source than the void (the flow
/// around it, say).
struct MotionEstimate {
  double time = 0;                                        ///< s
  Eigen::Vector3d centre = Eigen::Vector3d::Zero();       ///< m
  Eigen::Vector3d velocity = Eigen::Vector3d::Zero();     ///< m/s
  Eigen::Vector3d acceleration = Eigen::Vector3d::Zero(); ///< m/s2
  /// Of (centre, velocity, acceleration), positive definite.
  Eigen::Matrix<double, 9, 9> covariance = Eigen::Matrix<double, 9, 9>::Identity();
};

struct PathOptions {
  double radius = 0;        ///< of the sphere, m, > 0
  double positionNoise = 0; ///< standard deviation of a particle's position per component, m, > 0
  double jerkIntensity = 0; ///< spectral density of the jerk, m2/s5, >= 0
  double velocityPrior =
      1; ///< standard deviation of the velocity about its mean over the snapshots, m/s, > 0
  double accelerationPrior = 1;       ///< standard deviation of the acceleration, m/s2, > 0
  std::vector<MotionEstimate> motion; ///< what else is known, independent of the particles' places
  int steps = 1500;                   ///< of the Markov chain in its last round, >= 100
};

/// The path at one time, with what is known of it.
struct PathPoint {
  double time = 0;                                ///< s
  Eigen::Vector3d centre, velocity, acceleration; ///< m, m/s, m/s2
  Eigen::Matrix3d centreCovariance, velocityCovariance, accelerationCovariance;
};

struct PathPosterior {
  std::vector<PathPoint> points; ///< one per time asked for
  int intervals = 0;             ///< of the spline
  double effectiveSamples = 0;   ///< of the chain's last round, the least over the spline's coefficients
};

/// The path of the sphere through several snapshots at once: one smooth c(t) that no track may enter.
///
/// A track is a tracer, then it lies outside of the ball in every snapshot, or a ghost (eps), then it may be
/// anywhere. With s_ik the signed distance of track i from the wall in snapshot k, f = 1/(1 + exp(s/w)) and
/// w = 0.627 sigma as in VoidLikelihood.h,
///     log L(c) = sum_i log((1 - eps) prod_k (1 - f_ik) + eps) + a (1 - eps) sum_k N_k(c(t_k)),
/// N_k the tracers that a ball of fluid would hold, counted as often as tracers change: a is the number of
/// tracks over the number of their instances. A tracer that stays at the wall for many snapshots says the
/// same again and again; the product takes it as one constraint, so the posterior does not shrink below what
/// is known.
///
/// c(t) is a cubic spline with the prior of white jerk. The posterior is sampled by elliptical slice sampling
/// (Murray, Adams & MacKay 2010) around a Gaussian that is fitted to it while w falls to the noise: first by
/// Fisher scoring, then to the samples. The same data give the same answer.
///
/// snapshots: found ones with their wall, in the order of time, at least 2 with different times.
/// Throws std::invalid_argument otherwise. When progress aborts, the result has no points.
PathPosterior samplePath(const std::vector<CentreEstimate>& snapshots, const std::vector<double>& times,
                         const PathOptions& options, const Progress& progress = {});

/// Standard deviation per component of a single snapshot, rms over the snapshots, m.
double singleSigma(const std::vector<CentreEstimate>& snapshots);

/// Intervals of the spline that a path of this duration needs: within one, white jerk moves the centre less
/// than a third of `sigma`, the uncertainty of a single snapshot.
int pathIntervals(double duration, double jerkIntensity, double sigma);

/// Standard deviation of a particle's position per component from the third differences of tracks over four
/// equally spaced snapshots (robust: a median), m; 0 when there are fewer than 30 of them.
double positionNoiseFromTracks(const std::vector<CentreEstimate>& snapshots);

} // namespace rimflow
