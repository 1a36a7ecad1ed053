#pragma once
#include <Eigen/Core>
#include <functional>

namespace rimflow {

/// Log of an unnormalised density at a point; called from several threads. -infinity is allowed.
using LogDensity = std::function<double(const Eigen::VectorXd&)>;

struct SamplingOptions {
  int samples = 1024;           ///< per round, >= 64
  double effectiveShare = 0.25; ///< wanted: effective samples over samples
  int maximumRounds = 6;        ///< proposals tried
  double widening = 1.2;        ///< of the proposal's standard deviations against the last estimate, > 0
};

struct PosteriorSamples {
  Eigen::VectorXd mean;
  Eigen::MatrixXd covariance;
  Eigen::MatrixXd points;      ///< one sample per column
  Eigen::VectorXd weights;     ///< normalised, one per sample
  double effectiveSamples = 0; ///< (sum w)^2 / sum w^2
  int rounds = 0;
};

/// Mean and covariance of a density by importance sampling (Kahn & Marshall 1953; adapted round by round, Oh
/// & Berger 1992). The proposal is a mixture of three Gaussians of the same shape with 1, 2 and 4 times the
/// standard deviation (so its tails are heavier than the posterior's); it is moved onto the last round's
/// estimate until it covers the density: the effective share is reached and the mean stays. Points are
/// quasi-random (an additive recurrence, Roberts 2018), so the same data give the same answer on any number
/// of threads. All weights zero: covariance stays the proposal's and effectiveSamples is 0.
PosteriorSamples samplePosterior(const LogDensity& density, const Eigen::VectorXd& mean,
                                 const Eigen::MatrixXd& covariance, const SamplingOptions& options = {});

} // namespace rimflow
