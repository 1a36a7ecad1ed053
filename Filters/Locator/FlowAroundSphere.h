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
  double radius = 0;        ///< R of the sphere, m, > 0
  double reach = 0.6;       ///< tracers up to this distance from the wall are used, R, 0.1 to 2
  double centreError = 0.3; ///< the centre may lie this far from the origin of the offsets, R, >= 0
  int minimumParticles = 15; ///< fewer: no evidence
  int samples = 60;          ///< at most so many of them, evenly chosen
};

struct FlowEvidence {
  double logBayesFactor = 0; ///< body over fluid; 0 when there are too few tracers
  Eigen::Vector3d centre = Eigen::Vector3d::Zero(); ///< where the flow would rather see it, m; steps of 0.06 R
  int particles = 0;         ///< around the place
};

/// Whether the velocities around a place are those of the flow around a no-slip sphere, or of fluid
/// everywhere: the ratio of the probabilities of the data, each averaged over its prior (Bayesian linear
/// regression with unknown noise; MacKay 1992).
/// - Body: V + omega x r + a divergence-free flow that vanishes on the wall (vector harmonics up to degree 3,
///   two boundary layers each), averaged over the layers' thickness and over the centre.
/// - Fluid: V + an isotropic divergence-free Gaussian field, averaged over its correlation length.
/// Both are averaged over the signal-to-noise ratio. One snapshot; track ids are not used.
FlowEvidence flowEvidence(const std::vector<WallParticle>& particles, const FlowEvidenceOptions& options);

} // namespace rimflow
