#pragma once
#include "Progress.h"
#include "WallParticle.h"

#include <vector>

namespace rimflow {

/// The tracers around the sphere in one snapshot, as seen from a reference path.
struct FlowView {
  double time = 0;                                    ///< s
  Eigen::Vector3d velocity = Eigen::Vector3d::Zero(); ///< of the reference path, m/s
  std::vector<WallParticle> particles; ///< offsets from the reference path at this time; those within
                                       ///< (1 + 1.3 reach) R, and a margin for the path's error, are enough
};

struct FlowFitOptions {
  double radius = 0;            ///< R of the sphere, m, > 0
  double reach = 0.4;           ///< tracers up to this distance from the wall are used, R, 0.1 to 2
  double centrePrior = 0;       ///< standard deviation of the reference path per component, m; 0: 0.2 R
  double velocityPrior = 0;     ///< of its velocity, m/s; 0: the tracers' rms speed relative to it
  double accelerationPrior = 0; ///< of its acceleration, m/s2; 0: the reference path has the right one
  int minimumTracks = 20;       ///< fewer: not enough
  int samples = 800; ///< at most so many velocities, tracks as a whole; a track's are averaged over 0.15 R
};

/// What the velocities around the sphere say of its motion. True path, with dt = t - time:
/// reference + centre + velocity dt + acceleration dt^2/2.
struct FlowFit {
  bool enough = false; ///< false: too few tracks, nothing below counts but their number
  double time = 0;     ///< middle of the views, s
  Eigen::Vector3d centre = Eigen::Vector3d::Zero();          ///< m
  Eigen::Vector3d velocity = Eigen::Vector3d::Zero();        ///< m/s
  Eigen::Vector3d acceleration = Eigen::Vector3d::Zero();    ///< m/s2
  Eigen::Vector3d angularVelocity = Eigen::Vector3d::Zero(); ///< rad/s
  /// Of (centre, velocity, acceleration), SI.
  Eigen::Matrix<double, 9, 9> covariance = Eigen::Matrix<double, 9, 9>::Zero();
  Eigen::Matrix3d angularVelocityCovariance = Eigen::Matrix3d::Zero(); ///< rad2/s2
  int tracks = 0, samples = 0;
  double noise = 0; ///< what the fit leaves of a velocity component next to the wall, m/s
};

/// The sphere's path, velocity and rotation from the velocities around it, over one or several snapshots:
///     u = V(t) + omega x r + w(r),   r = x - c(t),   V = dc/dt,
///     c(t) = reference + centre + velocity dt + acceleration dt^2/2,   dt = t - time.
/// w is divergence-free and vanishes on the wall: vector harmonics up to degree 4, each times three boundary
/// layers d (1 - exp(-s/d)), d = 0.1, 0.3 and 1 R; taken to be steady meanwhile, but
/// for its size and direction, which goes with the reference velocity (the fluid is at rest far away). So V
/// is the no-slip velocity and the path's drift at once, and the centre is where the flow comes to rest on a
/// sphere. Robust against ghosts (Student's t). A track's velocities are averaged over 0.15 R, and each track
/// counts once. The variances of the noise (in four bands of the distance from the wall) and of the layers
/// are the most probable ones (MacKay 1992, "Bayesian interpolation"). Covariance: the posterior's; plus
/// model error, from what the answer changes by when reach and layers are 0.75 and 0.7, or 1.3 and 1.4 times
/// as large; times 1
/// + (60/tracks)2, as few tracks do not determine the variances; never below 0.001 R or U. It does not know a
/// wall that slips. Throws std::invalid_argument when radius or reach is out of range.
/// When progress aborts, there is not enough.
FlowFit fitFlow(const std::vector<FlowView>& views, const FlowFitOptions& options,
                const Progress& progress = {});

struct FlowEvidenceOptions {
  double radius = 0;         ///< R of the sphere, m, > 0
  double reach = 0.6;        ///< tracers up to this distance from the wall are used, R, 0.1 to 2
  double centreError = 0.3;  ///< the centre may lie this far from the origin of the offsets, R, >= 0
  int minimumParticles = 15; ///< fewer: no evidence
  int samples = 60;          ///< at most so many of them, evenly chosen
};

struct FlowEvidence {
  double logBayesFactor = 0; ///< body over fluid; 0 when there are too few tracers
  Eigen::Vector3d centre =
      Eigen::Vector3d::Zero(); ///< where the flow would rather see it, m; steps of 0.06 R
  int particles = 0;           ///< around the place
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
