#include "ImportanceSampling.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

namespace rimflow {
namespace {

constexpr double Scale[] = {1, 2, 4};
constexpr double Share[] = {0.6, 0.3, 0.1};

/// Inverse of the normal distribution function (Acklam 2003; relative error below 1.2e-9).
double normalQuantile(double p) {
  constexpr double a[] = {-3.969683028665376e+01, 2.209460984245205e+02,  -2.759285104469687e+02,
                          1.383577518672690e+02,  -3.066479806614716e+01, 2.506628277459239e+00};
  constexpr double b[] = {-5.447609879822406e+01, 1.615858368580409e+02, -1.556989798598866e+02,
                          6.680131188771972e+01, -1.328068155288572e+01};
  constexpr double c[] = {-7.784894002430293e-03, -3.223964580411365e-01, -2.400758277161838e+00,
                          -2.549732539343734e+00, 4.374664141464968e+00,  2.938163982698783e+00};
  constexpr double d[] = {7.784695709041462e-03, 3.224671290700398e-01, 2.445134137142996e+00,
                          3.754408661907416e+00};
  if (p > 0.97575) return -normalQuantile(1 - p);
  if (p < 0.02425) {
    const double q = std::sqrt(-2 * std::log(p));
    return (((((c[0] * q + c[1]) * q + c[2]) * q + c[3]) * q + c[4]) * q + c[5]) /
           ((((d[0] * q + d[1]) * q + d[2]) * q + d[3]) * q + 1);
  }
  const double q = p - 0.5, r = q * q;
  return (((((a[0] * r + a[1]) * r + a[2]) * r + a[3]) * r + a[4]) * r + a[5]) * q /
         (((((b[0] * r + b[1]) * r + b[2]) * r + b[3]) * r + b[4]) * r + 1);
}

/// Quasi-random standard normal points, one per column: fractional parts of 1/2 + s/phi^k, where phi is the
/// positive root of x^(d+1) = x + 1.
Eigen::MatrixXd normalPoints(int dimension, int count) {
  double phi = 2;
  for (int i = 0; i < 60; ++i) phi = std::pow(1 + phi, 1. / (dimension + 1));
  Eigen::MatrixXd points(dimension, count);
  double step = 1;
  for (int k = 0; k < dimension; ++k) {
    step /= phi;
    for (int s = 0; s < count; ++s) {
      const double x = 0.5 + (s + 1) * step;
      points(k, s) = normalQuantile(std::min(std::max(x - std::floor(x), 1e-9), 1 - 1e-9));
    }
  }
  return points;
}

/// Log of the proposal mixture, up to a constant, at squared distance rr in units of its covariance.
double logMixture(double rr, int dimension) {
  double sum = 0;
  for (int m = 0; m < 3; ++m)
    sum += Share[m] * std::pow(Scale[m], -dimension) * std::exp(-0.5 * rr / (Scale[m] * Scale[m]));
  return std::log(std::max(sum, 1e-300));
}

} // namespace

PosteriorSamples samplePosterior(const LogDensity& density, const Eigen::VectorXd& mean,
                                 const Eigen::MatrixXd& covariance, const SamplingOptions& options) {
  const int dimension = int(mean.size()), n = std::max(64, options.samples);
  PosteriorSamples result;
  result.mean = mean;
  result.covariance = covariance;
  Eigen::MatrixXd unit = normalPoints(dimension, n);
  std::vector<double> radius2(n), logWeight(n);
  for (int s = 0; s < n; ++s) {
    // The three widths interleaved, so that each takes points from the whole sequence.
    const int turn = s % 10, m = turn == 5 ? 2 : (turn % 3 == 1 ? 1 : 0);
    unit.col(s) *= Scale[m];
    radius2[s] = unit.col(s).squaredNorm();
  }
  while (result.rounds < options.maximumRounds) {
    ++result.rounds;
    const Eigen::VectorXd centre = result.mean;
    Eigen::MatrixXd shape = result.covariance;
    Eigen::LLT<Eigen::MatrixXd> factor(shape);
    for (int tries = 0; factor.info() != Eigen::Success && tries < 40; ++tries) {
      shape.diagonal().array() += std::pow(4., tries) * 1e-12 * std::max(shape.diagonal().maxCoeff(), 1e-300);
      factor.compute(shape);
    }
    const Eigen::MatrixXd stretched = factor.matrixL() * unit;
    result.points = (options.widening * stretched).colwise() + centre;
#pragma omp parallel for schedule(static) if (n >= 8192) // below that a wake-up costs more than it saves
    for (int s = 0; s < n; ++s)
      logWeight[s] = density(result.points.col(s)) - logMixture(radius2[s], dimension);
    const double top = *std::max_element(logWeight.begin(), logWeight.end());
    if (!(top > -std::numeric_limits<double>::infinity())) {
      result.effectiveSamples = 0;
      result.covariance *= 4; // look farther
      continue;
    }
    result.weights.resize(n);
    for (int s = 0; s < n; ++s) result.weights[s] = std::exp(logWeight[s] - top);
    result.weights /= result.weights.sum();
    result.effectiveSamples = 1 / result.weights.squaredNorm();
    result.mean = result.points * result.weights;
    const Eigen::MatrixXd from = result.points.colwise() - result.mean;
    const Eigen::MatrixXd spread = from * result.weights.asDiagonal() * from.transpose();
    const bool covered = result.effectiveSamples >= options.effectiveShare * n;
    // A handful of effective samples cannot give a shape: keep part of the old one.
    const double trust = std::min(1., result.effectiveSamples / (20. * dimension));
    result.covariance = trust * spread + (1 - trust) * 0.25 * covariance;
    const double moved =
        std::sqrt((result.mean - centre).dot(Eigen::LLT<Eigen::MatrixXd>(shape).solve(result.mean - centre)));
    if (covered && moved < 0.3 && result.rounds > 1) break;
  }
  return result;
}

} // namespace rimflow
