#include "PathPosterior.h"

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <random>
#include <stdexcept>
#include <string>
#include <unordered_map>

namespace rimflow {
namespace {

using Eigen::Matrix3d;
using Eigen::Matrix3Xd;
using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;

constexpr double Pi = 3.14159265358979323846;
constexpr double LogisticPerNoise = 0.62666; // sqrt(2 pi)/4: w at which the logistic has the normal's slope
constexpr double GhostLength = 5; // snapshots that a ghost's track lasts: longer ones are less likely
constexpr int LongestStay = 8;    // snapshots: longer ones would blur when a tracer was where
constexpr double Caution = 0.2;   // weight of single-snapshot estimates in the start: they share tracers
constexpr double Horizon = 7;     // standard deviations from the present shape that count

/// Uniform cubic B-splines over [first, last].
class Splines {
public:
  Splines(double first, double last, int intervals)
      : first_(first), step_((last - first) / intervals), intervals_(intervals) {}

  int size() const { return intervals_ + 3; }
  double step() const { return step_; }
  /// Where spline j has its middle: coefficients that are linear in it give a straight line.
  double knot(int j) const { return first_ + (j - 1) * step_; }

  /// All splines at a time, or their derivative (0 to 3). Beyond the ends the polynomials go on.
  VectorXd at(double time, int derivative = 0) const {
    const double x = (time - first_) / step_;
    const int i = std::min(std::max(int(std::floor(x)), 0), intervals_ - 1);
    const double u = x - i, v = 1 - u;
    VectorXd row = VectorXd::Zero(size());
    auto four = row.segment<4>(i);
    switch (derivative) {
    case 0:
      four << v * v * v, 3 * u * u * (u - 2) + 4, 3 * v * v * (v - 2) + 4, u * u * u;
      break;
    case 1:
      four << -3 * v * v, 3 * u * (3 * u - 4), -3 * v * (3 * v - 4), 3 * u * u;
      break;
    case 2:
      four << 6 * v, 6 * (3 * u - 2), 6 * (3 * v - 2), 6 * u;
      break;
    default:
      four << -6, 18, -18, 6;
    }
    return row / (6 * std::pow(step_, derivative));
  }

private:
  double first_, step_;
  int intervals_;
};

/// log(1 - f) = -log(1 + exp(-u)) by linear interpolation; 0 above, Lowest below.
class TracerLog {
public:
  static constexpr float Lowest = -30, Highest = 10;

  TracerLog() {
    for (int k = 0; k < Entries; ++k) value_[k] = float(-std::log1p(std::exp(-double(Lowest + k * Step))));
    value_[Entries - 1] = value_[Entries - 2] = 0;
  }
  float operator()(float u) const {
    u = u < Lowest ? Lowest : u > Highest ? Highest : u;
    const float t = (u - Lowest) * (1 / Step);
    const int k = int(t);
    return value_[k] + (t - float(k)) * (value_[k + 1] - value_[k]);
  }

private:
  static constexpr float Step = 1 / 32.f;
  static constexpr int Entries = int((Highest - Lowest) / Step) + 2;
  float value_[Entries];
};
const TracerLog& tracerLog() {
  static const TracerLog table;
  return table;
}

/// Successive instances of a track at about the same place relative to the sphere, as one: at the mean of
/// their places, seen in the middle one of their snapshots. A tracer that stays at the wall is thus one
/// measurement of less noise, and not many that each say that it is hardly likely to be so near.
struct Stay {
  Eigen::Vector3f first, sum;
  std::size_t from, to; // snapshots
  int instances, track;

  Eigen::Vector3f place() const { return sum / float(instances); }
  std::size_t snapshot() const { return (from + to) / 2; }
  /// Independent measurements that they are worth: a tracker's noise is correlated along a track.
  double independent() const { return 0.5 * (1 + instances); }
};

/// log L of paths near a reference path, at one width of the wall.
class PathLikelihood {
public:
  /// reference: centre per snapshot; reach: how far a path may be from it, m. noiseWidth: the part of the
  /// width that comes from the noise, m.
  PathLikelihood(const std::vector<CentreEstimate>& snapshots, const std::vector<Vector3d>& reference,
                 const std::vector<double>& reach, double radius, double width, double noiseWidth)
      : snapshots_(snapshots), reference_(reference), reach_(reach), radius_(radius) {
    std::vector<Stay> stays = collect(width);
    std::stable_sort(stays.begin(), stays.end(),
                     [](const Stay& a, const Stay& b) { return a.snapshot() < b.snapshot(); });
    for (const Stay& stay : stays) {
      while (first_.size() <= stay.snapshot()) first_.push_back(x_.size());
      const Eigen::Vector3f r = stay.place();
      x_.push_back(r[0]), y_.push_back(r[1]), z_.push_back(r[2]), track_.push_back(stay.track);
      const double own = width * width - noiseWidth * noiseWidth * (1 - 1 / stay.independent());
      perWidth_.push_back(float(1 / std::sqrt(own)));
    }
    while (first_.size() <= snapshots.size()) first_.push_back(x_.size());
  }

  /// offsets: of the path from the reference, one column per snapshot.
  double operator()(const Matrix3Xd& offsets) {
    sum_ = base_;
    double fluid = 0;
    for (std::size_t k = 0; k < reach_.size(); ++k) {
      const Vector3d o = offsets.col(Eigen::Index(k));
      if (o.norm() > reach_[k]) return -std::numeric_limits<double>::infinity();
      addStays(k, o.cast<float>());
      const Vector3d r = reference_[k] + o - snapshots_[k].centre;
      fluid += (snapshots_[k].wall->tilt + 0.5 * (snapshots_[k].wall->bend * r)).dot(r);
    }
    double total = looks_ * (1 - ghosts_) * fluid;
    for (std::size_t t = 0; t < sum_.size();
         ++t) { // log((1 - eps) e^s + eps), to first order where it is small
      const double s = sum_[t], ghost = ghostTrack_[t];
      total += s > -1e-3 ? (1 - ghost) * s : std::log((1 - ghost) * std::exp(s) + ghost);
    }
    return total;
  }

  /// Gradient with respect to the spline's coefficients (axis after axis), and the sum of the tracks' squared
  /// gradients (Fisher's information). basis: of the splines, one row per snapshot.
  void derivatives(const Matrix3Xd& offsets, const MatrixXd& basis, VectorXd& gradient,
                   MatrixXd& information) {
    (*this)(offsets); // fills sum_
    const Eigen::Index m = basis.cols();
    gradient.setZero(3 * m);
    information.setZero(3 * m, 3 * m);
    std::vector<VectorXd> slope(base_.size());
    const auto add = [&](VectorXd& to, const Vector3d& g, std::size_t k) {
      for (int a = 0; a < 3; ++a) to.segment(a * m, m) += g[a] * basis.row(Eigen::Index(k)).transpose();
    };
    for (std::size_t k = 0; k < reach_.size(); ++k) {
      const Vector3d o = offsets.col(Eigen::Index(k)), r = reference_[k] + o - snapshots_[k].centre;
      add(gradient, looks_ * (1 - ghosts_) * (snapshots_[k].wall->tilt + snapshots_[k].wall->bend * r), k);
      for (std::size_t i = first_[k]; i < first_[k + 1]; ++i) {
        const Vector3d from = Vector3d(x_[i], y_[i], z_[i]) - o;
        const double distance = std::max(from.norm(), 1e-12), u = (distance - radius_) * perWidth_[i];
        if (u > TracerLog::Highest || u < TracerLog::Lowest) continue;
        const double e = std::exp(-std::abs(u)), f = u > 0 ? e / (1 + e) : 1 / (1 + e);
        VectorXd& of = slope[track_[i]];
        if (of.size() == 0) of.setZero(3 * m);
        add(of, -f * perWidth_[i] * from / distance, k);
      }
    }
    for (std::size_t t = 0; t < slope.size(); ++t) {
      if (slope[t].size() == 0) continue;
      const double ghost = ghostTrack_[t], tracer = (1 - ghost) * std::exp(double(sum_[t]));
      slope[t] *= tracer / std::max(tracer + ghost, 1e-300);
      gradient += slope[t];
      information += slope[t] * slope[t].transpose();
    }
  }

private:
  /// The stays near the wall; also base_, ghostTrack_ and looks_.
  std::vector<Stay> collect(double width) {
    const double still = 0.04 * radius_; // moves that are one stay: the wall's sagitta over it is R/5000
    std::unordered_map<std::int64_t, int> number;
    std::vector<int> instances, latest; // per track; the latest stay
    std::vector<Stay> stays;
    std::size_t all = 0;
    double ghosts = 0;
    for (std::size_t k = 0; k < snapshots_.size(); ++k) {
      const WallView& wall = *snapshots_[k].wall;
      ghosts += wall.ghostRate / double(snapshots_.size());
      const Eigen::Vector3f moved = (reference_[k] - snapshots_[k].centre).cast<float>();
      for (const WallParticle& p : wall.particles) {
        const Eigen::Vector3f r = p.offset - moved;
        const double s = r.norm() - radius_;
        if (s > reach_[k] + TracerLog::Highest * width) continue; // outside of every path
        const int next = int(base_.size());
        const int track = p.track < 0 ? next : number.try_emplace(p.track, next).first->second;
        if (track == next) base_.push_back(0), instances.push_back(0), latest.push_back(-1);
        ++instances[track];
        ++all;
        Stay* stay = latest[track] < 0 ? nullptr : &stays[latest[track]];
        if (s < -reach_[k] + TracerLog::Lowest * width) {
          base_[track] = TracerLog::Lowest; // inside for every path
        } else if (stay && stay->to + 1 == k && stay->instances < LongestStay &&
                   (r - stay->first).norm() < still) {
          stay->sum += r, stay->to = k, ++stay->instances;
        } else {
          latest[track] = int(stays.size());
          stays.push_back({r, r, k, k, 1, track});
        }
      }
    }
    ghosts_ = ghosts;
    for (const int n : instances)
      ghostTrack_.push_back(std::pow(std::max(ghosts, 1e-6), std::ceil(n / GhostLength)));
    looks_ = all == 0 ? 1 : double(base_.size()) / double(all);
    return stays;
  }

  /// Adds log(1 - f) of snapshot k's stays to their tracks' sums.
  void addStays(std::size_t k, const Eigen::Vector3f& o) {
    const float radius = float(radius_), ox = o[0], oy = o[1], oz = o[2];
    const TracerLog& value = tracerLog();
    const std::size_t from = first_[k];
    const int n = int(first_[k + 1] - from);
    if (int(term_.size()) < n) term_.resize(n);
    float* term = term_.data();
    const float *x = x_.data() + from, *y = y_.data() + from, *z = z_.data() + from,
                *perWidth = perWidth_.data() + from;
#pragma omp simd
    for (int i = 0; i < n; ++i) {
      const float dx = x[i] - ox, dy = y[i] - oy, dz = z[i] - oz;
      term[i] = value((std::sqrt(dx * dx + dy * dy + dz * dz) - radius) * perWidth[i]);
    }
    const int* track = track_.data() + from;
    for (int i = 0; i < n; ++i) sum_[track[i]] += term[i];
  }

  const std::vector<CentreEstimate>& snapshots_;
  const std::vector<Vector3d>& reference_;
  const std::vector<double>& reach_;
  double radius_, ghosts_ = 0, looks_ = 1;
  std::vector<std::size_t> first_;          // per snapshot, of its stays; one more at the end
  std::vector<float> x_, y_, z_, perWidth_; // of stays: relative to the reference; 1 over the wall's width
  std::vector<int> track_;                  // of each stay
  std::vector<float> base_, sum_;           // per track: from instances deep inside, and from all
  std::vector<double> ghostTrack_;          // per track: eps, once per length of a ghost's track
  std::vector<float> term_;
};

/// A Gaussian over the spline's coefficients, axis after axis: covariance = factor factor^T.
struct Gaussian {
  VectorXd mean;
  MatrixXd factor;
};

Gaussian gaussian(const VectorXd& mean, MatrixXd covariance) {
  covariance = 0.5 * (covariance + covariance.transpose()).eval();
  Eigen::LLT<MatrixXd> factor(covariance);
  for (int tries = 0; factor.info() != Eigen::Success && tries < 40; ++tries) { // rounding
    covariance.diagonal() *= 1 + 1e-10 * std::pow(4., tries);
    factor.compute(covariance);
  }
  return {mean, factor.matrixL()};
}

/// Samples one per column.
MatrixXd covarianceOf(const MatrixXd& samples) {
  const MatrixXd from = samples.colwise() - samples.rowwise().mean();
  return from * from.transpose() / double(samples.cols() - 1);
}

/// Independent samples that a chain is worth, the least over its rows (batch means).
double effectiveSamples(const MatrixXd& samples, const MatrixXd& covariance) {
  const Eigen::Index batch = std::max<Eigen::Index>(1, Eigen::Index(std::sqrt(double(samples.cols()))));
  const Eigen::Index batches = samples.cols() / batch;
  const VectorXd mean = samples.rowwise().mean();
  double least = double(samples.cols());
  for (Eigen::Index i = 0; i < samples.rows(); ++i) {
    double between = 0;
    for (Eigen::Index b = 0; b < batches; ++b)
      between += std::pow(samples.row(i).segment(b * batch, batch).mean() - mean[i], 2) / double(batches);
    if (between > 0) least = std::min(least, double(batches) * covariance(i, i) / between);
  }
  return least;
}

class PathSampler {
public:
  PathSampler(const std::vector<CentreEstimate>& snapshots, const PathOptions& options,
              const Splines& splines)
      : snapshots_(snapshots), options_(options), splines_(splines), m_(splines.size()),
        noiseWidth_(LogisticPerNoise * options.positionNoise), basis_(Eigen::Index(snapshots.size()), m_),
        reference_(snapshots.size()), reach_(snapshots.size()) {
    for (Eigen::Index k = 0; k < basis_.rows(); ++k)
      basis_.row(k) = splines.at(snapshots[k].time).transpose();
    setPrior();
    startFromEstimates();
  }

  /// Uphill at one width by Fisher scoring; the Gaussian that this leaves is about right. False: aborted.
  bool climb(double width, const Progress& progress) {
    look();
    PathLikelihood likelihood(snapshots_, reference_, reach_, options_.radius, width, noiseWidth_);
    VectorXd at = shape_.mean, gradient;
    MatrixXd information, covariance;
    double here = likelihood(offsets(at)) + logPrior(at);
    for (int step = 0; step < 30; ++step) {
      if (!goOn(progress, step / 30.)) return false;
      likelihood.derivatives(offsets(at), basis_, gradient, information);
      gradient -= precision_ * (at - priorMean_);
      const Eigen::LLT<MatrixXd> newton(information + precision_);
      covariance = newton.solve(MatrixXd::Identity(3 * m_, 3 * m_));
      VectorXd move = newton.solve(gradient);
      const double decrement = gradient.dot(move);
      bool climbed = false;
      for (int halvings = 0; halvings < 8 && !climbed; ++halvings, move *= 0.5) {
        const double there = likelihood(offsets(at + move)) + logPrior(at + move);
        climbed = there > here;
        if (climbed) at += move, here = there;
      }
      if (!climbed || decrement < 1e-3) break;
    }
    shape_ = gaussian(at, 2 * covariance);
    return true;
  }

  /// Elliptical slice sampling at one width; the shape is then fitted to the samples. False: aborted.
  bool sample(double width, int steps, const Progress& progress) {
    look();
    PathLikelihood likelihood(snapshots_, reference_, reach_, options_.radius, width, noiseWidth_);
    VectorXd z = VectorXd::Zero(3 * m_), theta = shape_.mean;            // theta = mean + factor z
    const auto logRatio = [&](const VectorXd& t, const VectorXd& unit) { // of the target over the shape
      return likelihood(offsets(t)) + logPrior(t) + 0.5 * unit.squaredNorm();
    };
    double here = logRatio(theta, z);
    samples_.resize(3 * m_, steps);
    for (int s = -steps / 5; s < steps; ++s) {
      if (!goOn(progress, std::max(0., double(s) / steps))) return false;
      const VectorXd nu = VectorXd::NullaryExpr(3 * m_, [this] { return normal_(random_); });
      const double level = here + std::log(std::max(uniform_(random_), 1e-300));
      double angle = 2 * Pi * uniform_(random_), low = angle - 2 * Pi, high = angle;
      for (int shrink = 0; shrink < 60; ++shrink) {
        const VectorXd unit = z * std::cos(angle) + nu * std::sin(angle),
                       t = shape_.mean + shape_.factor * unit;
        const double there = logRatio(t, unit);
        if (there > level) {
          z = unit, theta = t, here = there;
          break;
        }
        (angle < 0 ? low : high) = angle;
        angle = low + (high - low) * uniform_(random_);
      }
      if (s >= 0) samples_.col(s) = theta;
    }
    const MatrixXd covariance = covarianceOf(samples_);
    effective_ = effectiveSamples(samples_, covariance);
    // A handful of independent samples cannot give a shape: keep part of the old one.
    const double trust = std::min(1., effective_ / (3. * 3 * m_));
    const MatrixXd old = shape_.factor * shape_.factor.transpose();
    shape_ = gaussian(samples_.rowwise().mean(), 1.3 * (trust * covariance + (1 - trust) * old));
    return true;
  }

  PathPoint at(double time) const {
    PathPoint p;
    p.time = time;
    const auto moments = [&](int derivative, Vector3d& value, Matrix3d& covariance) {
      const VectorXd row = splines_.at(time, derivative);
      Matrix3Xd values(3, samples_.cols());
      for (int a = 0; a < 3; ++a) values.row(a) = row.transpose() * samples_.middleRows(a * m_, m_);
      value = values.rowwise().mean();
      covariance = covarianceOf(values);
    };
    moments(0, p.centre, p.centreCovariance);
    moments(1, p.velocity, p.velocityCovariance);
    moments(2, p.acceleration, p.accelerationCovariance);
    return p;
  }
  double effective() const { return effective_; }

private:
  /// White jerk per interval; acceleration and velocity in the middle; what else is known.
  void setPrior() {
    const double first = snapshots_.front().time, last = snapshots_.back().time,
                 middle = 0.5 * (first + last);
    const Vector3d velocity = (snapshots_.back().centre - snapshots_.front().centre) / (last - first);
    precision_.setZero(3 * m_, 3 * m_);
    VectorXd pull = VectorXd::Zero(3 * m_);
    const auto addRow = [&](const VectorXd& row, double sigma, const Vector3d& value) {
      for (int a = 0; a < 3; ++a) {
        precision_.block(a * m_, a * m_, m_, m_) += row * row.transpose() / (sigma * sigma);
        pull.segment(a * m_, m_) += row * value[a] / (sigma * sigma);
      }
    };
    const double jerk = std::sqrt(std::max(options_.jerkIntensity, 1e-12) / splines_.step());
    for (int i = 0; i + 3 < m_; ++i)
      addRow(splines_.at(splines_.knot(i + 1) + 0.5 * splines_.step(), 3), jerk, Vector3d::Zero());
    addRow(splines_.at(middle, 2), options_.accelerationPrior, Vector3d::Zero());
    addRow(splines_.at(middle, 1), options_.velocityPrior, velocity);
    addRow(splines_.at(middle), 1,
           0.5 * (snapshots_.back().centre + snapshots_.front().centre)); // within a metre
    for (const MotionEstimate& e : options_.motion) {
      MatrixXd rows = MatrixXd::Zero(9, 3 * m_);
      Eigen::Matrix<double, 9, 1> value;
      value << e.centre, e.velocity, e.acceleration;
      for (int a = 0; a < 3; ++a)
        for (int derivative = 0; derivative < 3; ++derivative)
          rows.row(3 * derivative + a).segment(a * m_, m_) = splines_.at(e.time, derivative).transpose();
      const MatrixXd weighted = e.covariance.llt().solve(rows);
      precision_ += rows.transpose() * weighted;
      pull += weighted.transpose() * value;
    }
    priorMean_ = precision_.llt().solve(pull);
  }

  void startFromEstimates() {
    MatrixXd information = precision_;
    VectorXd pull = precision_ * priorMean_;
    for (Eigen::Index k = 0; k < basis_.rows(); ++k) {
      const Matrix3d weight = Caution * snapshots_[k].covariance.inverse();
      const MatrixXd square = basis_.row(k).transpose() * basis_.row(k);
      const Vector3d value = weight * snapshots_[k].centre;
      for (int a = 0; a < 3; ++a) {
        for (int b = 0; b < 3; ++b) information.block(a * m_, b * m_, m_, m_) += weight(a, b) * square;
        pull.segment(a * m_, m_) += value[a] * basis_.row(k).transpose();
      }
    }
    const Eigen::LLT<MatrixXd> solver(information);
    shape_ = gaussian(solver.solve(pull), solver.solve(MatrixXd::Identity(3 * m_, 3 * m_)));
  }

  /// The reference path and what paths around it count, from the present shape.
  void look() {
    for (Eigen::Index k = 0; k < basis_.rows(); ++k) {
      double variance = 0;
      for (int a = 0; a < 3; ++a) {
        reference_[k][a] = basis_.row(k).dot(shape_.mean.segment(a * m_, m_));
        variance += (basis_.row(k) * shape_.factor.middleRows(a * m_, m_)).squaredNorm();
      }
      reach_[k] = std::min(Horizon * std::sqrt(variance), snapshots_[k].wall->reach);
    }
    lookedFrom_ = shape_.mean;
  }

  Matrix3Xd offsets(const VectorXd& theta) const {
    Matrix3Xd o(3, basis_.rows());
    const VectorXd from = theta - lookedFrom_;
    for (int a = 0; a < 3; ++a) o.row(a) = (basis_ * from.segment(a * m_, m_)).transpose();
    return o;
  }
  double logPrior(const VectorXd& theta) const {
    const VectorXd from = theta - priorMean_;
    return -0.5 * from.dot(precision_ * from);
  }

  const std::vector<CentreEstimate>& snapshots_;
  const PathOptions& options_;
  const Splines& splines_;
  int m_;
  double noiseWidth_;
  MatrixXd basis_, precision_;
  VectorXd priorMean_, lookedFrom_;
  Gaussian shape_;
  std::vector<Vector3d> reference_;
  std::vector<double> reach_;
  MatrixXd samples_;
  double effective_ = 0;
  std::mt19937_64 random_{20251122};
  std::normal_distribution<double> normal_{0, 1};
  std::uniform_real_distribution<double> uniform_{0, 1};
};

void check(const std::vector<CentreEstimate>& snapshots, const PathOptions& o) {
  if (!(o.radius > 0) || !(o.positionNoise > 0))
    throw std::invalid_argument("the radius is " + std::to_string(o.radius) + " m and the position noise " +
                                std::to_string(o.positionNoise) + " m; both must be greater than 0");
  if (snapshots.size() < 2 || !(snapshots.back().time > snapshots.front().time))
    throw std::invalid_argument(
        "a path needs at least two snapshots at different times, in the order of time");
  for (const CentreEstimate& s : snapshots)
    if (!s.found || !s.wall)
      throw std::invalid_argument("a snapshot of the path was not found or has no wall");
}

} // namespace

double singleSigma(const std::vector<CentreEstimate>& snapshots) {
  double variance = 0;
  for (const CentreEstimate& s : snapshots) variance += s.covariance.trace() / (3 * double(snapshots.size()));
  return std::sqrt(variance);
}

int pathIntervals(double duration, double jerkIntensity, double sigma) {
  if (jerkIntensity <= 0) return 1;
  // sqrt(q dt^5 / 20) = sigma/3
  const double step = std::pow(20 * sigma * sigma / (9 * jerkIntensity), 0.2);
  return std::max(1, int(std::ceil(std::min(duration / step, 1e6))));
}

double positionNoiseFromTracks(const std::vector<CentreEstimate>& snapshots) {
  struct Instance {
    std::size_t snapshot;
    Vector3d place;
  };
  std::unordered_map<std::int64_t, std::vector<Instance>> tracks;
  for (std::size_t k = 0; k < snapshots.size(); ++k)
    if (snapshots[k].wall)
      for (const WallParticle& p : snapshots[k].wall->particles)
        if (p.track >= 0) tracks[p.track].push_back({k, snapshots[k].centre + p.offset.cast<double>()});
  std::vector<double> differences;
  for (const auto& [id, at] : tracks)
    for (std::size_t i = 3; i < at.size(); ++i) {
      const double step = (snapshots[at[i].snapshot].time - snapshots[at[i - 3].snapshot].time) / 3;
      bool even = at[i].snapshot - at[i - 3].snapshot == 3;
      for (int j = 0; j < 3 && even; ++j)
        even = std::abs(snapshots[at[i - j].snapshot].time - snapshots[at[i - j - 1].snapshot].time - step) <
               0.01 * step;
      if (!even) continue;
      const Vector3d third = at[i].place - 3 * at[i - 1].place + 3 * at[i - 2].place - at[i - 3].place;
      for (int a = 0; a < 3; ++a) differences.push_back(std::abs(third[a]));
    }
  if (differences.size() < 90) return 0;
  const auto middle = differences.begin() + std::ptrdiff_t(differences.size() / 2);
  std::nth_element(differences.begin(), middle, differences.end());
  return *middle / (0.6745 * std::sqrt(20.)); // 1 + 9 + 9 + 1
}

PathPosterior samplePath(const std::vector<CentreEstimate>& snapshots, const std::vector<double>& times,
                         const PathOptions& options, const Progress& progress) {
  check(snapshots, options);
  PathPosterior result;
  const double first = snapshots.front().time, last = snapshots.back().time, sigma = singleSigma(snapshots);
  result.intervals = pathIntervals(last - first, options.jerkIntensity, sigma);
  const Splines splines(first, last, result.intervals);
  PathSampler sampler(snapshots, options, splines);
  const double finest = LogisticPerNoise * options.positionNoise, coarsest = std::max(0.5 * sigma, finest);
  std::vector<double> widths; // of the wall, in the rounds before the last
  for (double w = coarsest; w > 2 * finest; w /= 3) widths.push_back(w);
  widths.insert(widths.end(), 2, finest);
  const double thirds = double(widths.size()) + 3; // of the steps of the last round
  if (!sampler.climb(coarsest, part(progress, 0, 0.05))) return result;
  for (std::size_t round = 0; round < widths.size(); ++round)
    if (!sampler.sample(
            widths[round], options.steps / 3,
            part(progress, 0.05 + 0.95 * double(round) / thirds, 0.05 + 0.95 * double(round + 1) / thirds)))
      return result;
  if (!sampler.sample(finest, options.steps, part(progress, 0.05 + 0.95 * double(widths.size()) / thirds, 1)))
    return result;
  result.effectiveSamples = sampler.effective();
  for (const double time : times) result.points.push_back(sampler.at(time));
  return result;
}

} // namespace rimflow
