#pragma once
#include "WallParticle.h"

#include <vector>

namespace rimflow {

/// The tracers around the sphere in one snapshot, as seen from a reference path.
struct FlowView {
  double time = 0;                                    ///< s
  Eigen::Vector3d velocity = Eigen::Vector3d::Zero(); ///< of the reference path, m/s
  std::vector<WallParticle> particles; ///< offsets from the reference path at this time; those within
                                       ///< (1 + reach) R, and a margin for the path's error, are enough
};

struct FlowFitOptions {
  double radius = 0;        ///< R of the sphere, m, > 0
  double reach = 0.5;       ///< tracers up to this distance from the wall are used, R, 0.1 to 1
  double centrePrior = 0;   ///< standard deviation of the reference path per component, m; 0: 0.2 R
  double velocityPrior = 0; ///< of its velocity, m/s; 0: a fifth of the tracers' rms speed relative to it
  int minimumTracks = 20;   ///< fewer: not enough
  int samples = 1500;       ///< at most so many velocities, tracks as a whole; a track's are averaged over 0.15 R
};

/// What the velocities around the sphere say of its motion. True path: reference + centre + velocity (t - time).
struct FlowFit {
  bool enough = false; ///< false: too few tracks, nothing below counts but their number
  double time = 0;     ///< middle of the views, s
  Eigen::Vector3d centre = Eigen::Vector3d::Zero();          ///< m
  Eigen::Vector3d velocity = Eigen::Vector3d::Zero();        ///< m/s
  Eigen::Vector3d angularVelocity = Eigen::Vector3d::Zero(); ///< rad/s
  Eigen::Matrix<double, 6, 6> covariance = Eigen::Matrix<double, 6, 6>::Zero(); ///< of (centre, velocity), SI
  Eigen::Matrix3d angularVelocityCovariance = Eigen::Matrix3d::Zero();          ///< rad2/s2
  int tracks = 0, samples = 0;
  double noise = 0; ///< what the fit leaves of a velocity component next to the wall, m/s
};

FlowFit fitFlow(const std::vector<FlowView>& views, const FlowFitOptions& options);

struct FlowEvidenceOptions {
  double radius = 0;  ///< R of the sphere, m, > 0
  double reach = 0.6; ///< tracers R to (1 + reach) R from the centre are used, R, 0.1 to 1
  int samples = 150;  ///< at most so many velocities
};

double flowEvidence(const std::vector<WallParticle>& particles, const FlowEvidenceOptions& options);

} // namespace rimflow
