#include "SphereMotion.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <string>

namespace rimflow {
namespace {

const Eigen::Vector3d unknown = Eigen::Vector3d::Constant(std::numeric_limits<double>::quiet_NaN());
constexpr double rounding = 1e-6; // of a row interval, by which times may be off

} // namespace

/// The polynomial around one row: x(t) = sum c_k ((t - t_row)/scale)^k.
struct SphereMotion::Fit {
  std::size_t points = 0; ///< rows that it goes through or near
  int order = -1;
  double scale = 1;             ///< s
  Eigen::MatrixX3d coefficient; ///< m, one row per power
  Eigen::VectorXd variance;     ///< of a coefficient over that of a place
  bool bothSides = false;       ///< there are known rows before and after

  /// The derivative of this order at the row, and its standard deviation over that of a place.
  Eigen::Vector3d derivative(int d) const {
    if (d > order) return unknown;
    return coefficient.row(d).transpose() * (d == 2 ? 2 : 1) / std::pow(scale, d);
  }
  double sigma(int d) const {
    if (d > order) return unknown[0];
    return std::sqrt(variance[d]) * (d == 2 ? 2 : 1) / std::pow(scale, d);
  }
};

SphereMotion::SphereMotion(std::vector<double> times, std::vector<Eigen::Vector3d> centres,
                           const SphereMotionOptions& options)
    : times_(std::move(times)), centres_(std::move(centres)), options_(options), rows_(times_.size()) {
  if (options.order < 2 || options.order > 5 || options.window <= options.order)
    throw std::invalid_argument("the polynomial's order is " + std::to_string(options.order) +
                                " and its window " + std::to_string(options.window) +
                                " rows; the order must be 2 to 5 and the window greater than the order");
  for (std::size_t i = 0; i < times_.size(); ++i)
    if (centres_[i].allFinite()) known_.push_back(i);

  // The variance of a place: residuals of n rows from a polynomial with leverage h have the variance
  // (1 - h) sigma^2.
  Eigen::Vector3d variance = Eigen::Vector3d::Zero();
  std::size_t counted = 0;
  std::vector<double> factor[3];
  for (int d = 0; d < 3; ++d) factor[d].assign(times_.size(), unknown[0]);
  for (std::size_t i = 0; i < times_.size(); ++i) {
    SphereState& state = rows_[i];
    state.centre = state.velocity = state.acceleration = unknown;
    state.sigma = state.velocitySigma = state.accelerationSigma = unknown;
    const Fit f = fit(i);
    const bool found = centres_[i].allFinite();
    if (!found && !(f.bothSides && f.points > std::size_t(options_.order))) continue;
    state.status = found ? CentreStatus::Found : CentreStatus::Predicted;
    state.centre = found ? centres_[i] : f.derivative(0);
    state.velocity = f.derivative(1);
    state.acceleration = f.derivative(2);
    for (int d = 0; d < 3; ++d) factor[d][i] = d == 0 && found ? 1 : f.sigma(d);
    if (found && f.points > std::size_t(f.order) + 1 && f.variance[0] < 0.999) {
      variance += (centres_[i] - f.derivative(0)).cwiseAbs2() / (1 - f.variance[0]);
      ++counted;
    }
  }
  if (counted == 0) return;
  const Eigen::Vector3d sigma = (variance / double(counted)).cwiseSqrt();
  if (sigma.norm() < options.leastSigma) return;
  for (std::size_t i = 0; i < times_.size(); ++i) {
    rows_[i].sigma = factor[0][i] * sigma;
    rows_[i].velocitySigma = factor[1][i] * sigma;
    rows_[i].accelerationSigma = factor[2][i] * sigma;
  }
}

double SphereMotion::typicalInterval(std::size_t row) const {
  const std::size_t reach = std::size_t(options_.window);
  const std::size_t begin = row > reach ? row - reach : 0, end = std::min(row + reach, times_.size() - 1);
  std::vector<double> intervals;
  for (std::size_t i = begin; i < end; ++i) intervals.push_back(times_[i + 1] - times_[i]);
  if (intervals.empty()) return 0;
  const auto middle = intervals.begin() + std::ptrdiff_t(intervals.size() / 2);
  std::nth_element(intervals.begin(), middle, intervals.end());
  return *middle;
}

SphereMotion::Fit SphereMotion::fit(std::size_t row) const {
  Fit f;
  if (known_.empty()) return f;
  const double interval = typicalInterval(row), width = (options_.window - 1) * interval;
  const double first = times_[known_.front()], last = times_[known_.back()], t = times_[row];
  const double low = std::max(std::min(t - 0.5 * width, last - width), first);
  const auto at = [&](double time) {
    return std::lower_bound(known_.begin(), known_.end(), time,
                            [&](std::size_t k, double x) { return times_[k] < x; });
  };
  const std::vector<std::size_t> in(at(low - rounding * interval), at(low + width + rounding * interval));
  f.points = in.size();
  if (in.empty()) return f;
  f.bothSides = in.front() < row && in.back() > row;
  f.order = std::min(options_.order, int(in.size()) - 1);
  f.scale = in.size() > 1 ? 0.5 * (times_[in.back()] - times_[in.front()]) : 1;
  Eigen::MatrixXd powers(in.size(), f.order + 1);
  Eigen::MatrixX3d places(in.size(), 3);
  const Eigen::Vector3d origin = centres_[in.front()]; // differences keep their digits
  for (std::size_t i = 0; i < in.size(); ++i) {
    powers(Eigen::Index(i), 0) = 1;
    for (int k = 1; k <= f.order; ++k)
      powers(Eigen::Index(i), k) = powers(Eigen::Index(i), k - 1) * (times_[in[i]] - t) / f.scale;
    places.row(Eigen::Index(i)) = (centres_[in[i]] - origin).transpose();
  }
  const Eigen::HouseholderQR<Eigen::MatrixXd> qr(powers);
  f.coefficient = qr.solve(places);
  f.coefficient.row(0) += origin.transpose();
  const Eigen::Index n = f.order + 1;
  const Eigen::MatrixXd inverse = // of R, where (X^T X)^-1 = R^-1 R^-T
      qr.matrixQR().topRows(n).triangularView<Eigen::Upper>().solve(Eigen::MatrixXd::Identity(n, n));
  f.variance = inverse.rowwise().squaredNorm();
  return f;
}

SphereState SphereMotion::at(double time) const {
  SphereState lost;
  lost.centre = lost.velocity = lost.acceleration = unknown;
  lost.sigma = lost.velocitySigma = lost.accelerationSigma = unknown;
  if (times_.empty()) return lost;
  const auto after = std::lower_bound(times_.begin(), times_.end(), time);
  const std::size_t next = std::min(std::size_t(after - times_.begin()), times_.size() - 1);
  const std::size_t before = next > 0 ? next - 1 : 0;
  const double interval = typicalInterval(next);
  // Where the times of two files differ by their rounding, it is the row's own time.
  for (const std::size_t row : {next, before})
    if (std::abs(times_[row] - time) <= 1e-3 * interval || times_[row] == time) {
      SphereState state = rows_[row];
      if (state.velocity.allFinite()) state.centre += (time - times_[row]) * state.velocity;
      return state;
    }
  const SphereState &a = rows_[before], &b = rows_[next];
  const double h = times_[next] - times_[before];
  const bool between = time > times_[before] && time < times_[next];
  if (!between || a.status == CentreStatus::Lost || b.status == CentreStatus::Lost ||
      h > (options_.window - 1 + rounding) * interval)
    return lost;
  SphereState state;
  const double s = (time - times_[before]) / h;
  const auto linear = [s](const Eigen::Vector3d& p, const Eigen::Vector3d& q) -> Eigen::Vector3d {
    return (1 - s) * p + s * q;
  };
  state.status = h > 1.5 * interval ? CentreStatus::Predicted : std::max(a.status, b.status);
  // Hermite's cubic: h00 x_a + h10 h v_a + h01 x_b + h11 h v_b
  state.centre = (1 + 2 * s) * (1 - s) * (1 - s) * a.centre + s * (1 - s) * (1 - s) * h * a.velocity +
                 s * s * (3 - 2 * s) * b.centre + s * s * (s - 1) * h * b.velocity;
  state.velocity = linear(a.velocity, b.velocity);
  state.acceleration = linear(a.acceleration, b.acceleration);
  state.sigma = a.sigma.cwiseMax(b.sigma);
  state.velocitySigma = a.velocitySigma.cwiseMax(b.velocitySigma);
  state.accelerationSigma = a.accelerationSigma.cwiseMax(b.accelerationSigma);
  return state;
}

} // namespace rimflow
