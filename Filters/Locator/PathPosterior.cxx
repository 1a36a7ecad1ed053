#include "PathPosterior.h"

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <random>
#include <stdexcept>
#include <unordered_map>

namespace rimflow {
namespace {

using Eigen::Matrix3d;
using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;

constexpr double LogisticPerNoise = 0.62666; // sqrt(2 pi)/4, as in VoidLikelihood
constexpr double DeepInside = -30;           // log(1 - f) of an instance that no tracer can have

/// Uniform cubic B-splines over [first, last].
class Splines {
public:
  Splines(double first, double last, int intervals)
      : first_(first), step_((last - first) / intervals), intervals_(intervals) {}

  int size() const { return intervals_ + 3; }
  double step() const { return step_; }
  /// Values of all splines at a time, or of their derivative (0 to 2). Beyond the ends the polynomials go on.
  VectorXd at(double time, int derivative = 0) const {
    const double x = (time - first_) / step_;
    const int i = std::min(std::max(int(std::floor(x)), 0), intervals_ - 1);
    const double u = x - i;
    VectorXd row = VectorXd::Zero(size());
    if (derivative == 0)
      row.segment<4>(i) << std::pow(1 - u, 3) / 6, (3 * u * u * u - 6 * u * u + 4) / 6,
          (-3 * u * u * u + 3 * u * u + 3 * u + 1) / 6, u * u * u / 6;
    else if (derivative == 1)
      row.segment<4>(i) << -0.5 * (1 - u) * (1 - u), 0.5 * (3 * u * u - 4 * u), 0.5 * (-3 * u * u + 2 * u + 1), 0.5 * u * u;
    else
      row.segment<4>(i) << 1 - u, 3 * u - 2, 1 - 3 * u, u;
    return row / std::pow(step_, derivative);
  }
  /// The third derivative in interval i.
  VectorXd jerk(int i) const {
    VectorXd row = VectorXd::Zero(size());
    row.segment<4>(i) << -1, 3, -3, 1;
    return row / std::pow(step_, 3);
  }

private:
  double first_, step_;
  int intervals_;
};

/// Intervals short enough that white jerk within one moves the centre less than a third of its uncertainty.
int intervalsFor(double duration, double jerkIntensity, double sigma) {
  if (jerkIntensity <= 0) return 1;
  const double step = std::pow(20 * sigma * sigma / (9 * jerkIntensity), 0.2);
  return std::max(1, int(std::ceil(duration / step)));
}

/// log(1 - f) = -log(1 + exp(-u)) by linear interpolation; 0 above, DeepInside below.
class TracerLog {
public:
  TracerLog() {
    for (int k = 0; k <= Entries; ++k) value_[k] = float(-std::log1p(std::exp(-(DeepInside + k * Step))));
  }
  float operator()(float u) const {
    u = u < float(DeepInside) ? float(DeepInside) : u > Highest - 1e-3f ? Highest - 1e-3f : u;
    const float t = (u - float(DeepInside)) / Step;
    const int k = int(t);
    return value_[k] + (t - float(k)) * (value_[k + 1] - value_[k]);
  }
  static constexpr float Highest = 14;

private:
  static constexpr float Step = 1 / 32.f;
  static constexpr int Entries = int((Highest - DeepInside) / Step) + 1;
  float value_[Entries + 1];
};
const TracerLog& tracerLog() {
  static const TracerLog table;
  return table;
}

/// log L of a path near a reference path, at one width of the wall.
class PathLikelihood {
public:
  /// reference: centre per view; reach: how far the path may be from it.
  PathLikelihood(const std::vector<WallView>& views, const std::vector<Vector3d>& reference, const std::vector<double>& reach,
                 double radius, double width)
      : views_(views), reference_(reference), reach_(reach), radius_(radius), width_(width) {
    std::unordered_map<std::int64_t, int> number;
    first_.push_back(0);
    std::size_t instances = 0;
    double ghosts = 0;
    for (std::size_t k = 0; k < views.size(); ++k) {
      const WallView& view = views[k];
      const Eigen::Vector3f moved = (reference[k] - view.centre).cast<float>();
      for (const WallParticle& p : view.particles) {
        const Eigen::Vector3f r = p.offset - moved;
        const double s = r.norm() - radius;
        if (s > reach[k] + TracerLog::Highest * width) continue;
        const auto known = p.track < 0 ? number.end() : number.find(p.track);
        const int track = known != number.end() ? known->second : int(base_.size());
        if (known == number.end()) {
          base_.push_back(0);
          if (p.track >= 0) number.emplace(p.track, track);
        }
        if (s < -reach[k] + DeepInside * width) {
          base_[track] = float(DeepInside);
          continue;
        }
        ++instances;
        x_.push_back(r[0]), y_.push_back(r[1]), z_.push_back(r[2]), track_.push_back(track);
      }
      first_.push_back(x_.size());
      ghosts += view.ghostRate / double(views.size());
    }
    ghosts_ = ghosts;
    looks_ = instances > 0 ? std::min(1., double(base_.size()) / double(instances)) : 1;
  }

  /// offsets: of the path from the reference, one column per view.
  double operator()(const Eigen::Matrix3Xd& offsets) {
    sum_ = base_;
    double total = 0;
    for (std::size_t k = 0; k + 1 < first_.size(); ++k) {
      const Vector3d o = offsets.col(Eigen::Index(k));
      if (o.norm() > reach_[k]) return -std::numeric_limits<double>::infinity();
      addView(k, o.cast<float>());
      const Vector3d fromEstimate = reference_[k] + o - views_[k].centre;
      total += looks_ * (1 - ghosts_) * (views_[k].tilt + 0.5 * (views_[k].bend * fromEstimate)).dot(fromEstimate);
    }
    const double tracer = 1 - ghosts_;
    for (const float s : sum_) // log((1 - eps) e^s + eps)
      total += s > -1e-3f ? tracer * double(s) : std::log(tracer * std::exp(double(s)) + ghosts_);
    return total;
  }

  /// Gradient with respect to the spline's coefficients (axis after axis) and the sum of the tracks' squared
  /// gradients. basis: of the splines, one row per view.
  void derivatives(const Eigen::Matrix3Xd& offsets, const MatrixXd& basis, VectorXd& gradient, MatrixXd& information) {
    (*this)(offsets); // fills sum_
    const Eigen::Index m = basis.cols();
    gradient.setZero(3 * m), information.setZero(3 * m, 3 * m);
    std::vector<VectorXd> slope(base_.size());
    for (std::size_t k = 0; k + 1 < first_.size(); ++k) {
      const Vector3d o = offsets.col(Eigen::Index(k)), fromEstimate = reference_[k] + o - views_[k].centre;
      const Vector3d fluid = looks_ * (1 - ghosts_) * (views_[k].tilt + views_[k].bend * fromEstimate);
      for (int a = 0; a < 3; ++a) gradient.segment(a * m, m) += fluid[a] * basis.row(Eigen::Index(k)).transpose();
      for (std::size_t i = first_[k]; i < first_[k + 1]; ++i) {
        const Vector3d r = Vector3d(x_[i], y_[i], z_[i]) - o;
        const double distance = std::max(r.norm(), 1e-12), u = (distance - radius_) / width_;
        if (u > TracerLog::Highest || u < DeepInside) continue;
        const double e = std::exp(-std::abs(u)), f = u > 0 ? e / (1 + e) : 1 / (1 + e);
        VectorXd& track = slope[track_[i]];
        if (track.size() == 0) track.setZero(3 * m);
        for (int a = 0; a < 3; ++a) track.segment(a * m, m) -= f / width_ * r[a] / distance * basis.row(Eigen::Index(k)).transpose();
      }
    }
    for (std::size_t t = 0; t < slope.size(); ++t) {
      if (slope[t].size() == 0) continue;
      const double tracer = (1 - ghosts_) * std::exp(double(sum_[t]));
      slope[t] *= tracer / (tracer + ghosts_);
      gradient += slope[t];
      information += slope[t] * slope[t].transpose();
    }
  }

  std::size_t instances() const { return x_.size(); }
  std::size_t tracks() const { return base_.size(); }

private:
  void addView(std::size_t k, const Eigen::Vector3f& o) {
    const float radius = float(radius_), perWidth = float(1 / width_), ox = o[0], oy = o[1], oz = o[2];
    const TracerLog& value = tracerLog();
    const std::size_t from = first_[k], to = first_[k + 1];
    if (term_.size() < to - from) term_.resize(to - from);
    float* term = term_.data();
    const float *x = x_.data() + from, *y = y_.data() + from, *z = z_.data() + from;
    const int n = int(to - from);
#pragma omp simd
    for (int i = 0; i < n; ++i) {
      const float dx = x[i] - ox, dy = y[i] - oy, dz = z[i] - oz;
      term[i] = value((std::sqrt(dx * dx + dy * dy + dz * dz) - radius) * perWidth);
    }
    for (int i = 0; i < n; ++i) sum_[track_[from + i]] += term[i];
  }

  const std::vector<WallView>& views_;
  const std::vector<Vector3d>& reference_;
  const std::vector<double>& reach_;
  double radius_, width_, ghosts_ = 0, looks_ = 1;
  std::vector<std::size_t> first_;   // per view, of its instances
  std::vector<float> x_, y_, z_;     // relative to the reference
  std::vector<int> track_;           // of each instance
  std::vector<float> base_, sum_, term_;
};

/// A Gaussian over the spline's coefficients, axis after axis.
struct Gaussian {
  VectorXd mean;
  MatrixXd factor; // L of covariance = L L^T
};

Gaussian gaussianFrom(const VectorXd& mean, MatrixXd covariance) {
  covariance = 0.5 * (covariance + covariance.transpose()).eval();
  Eigen::LLT<MatrixXd> factor(covariance);
  for (int tries = 0; factor.info() != Eigen::Success && tries < 40; ++tries) {
    covariance.diagonal() *= 1 + 1e-10 * std::pow(4., tries);
    factor.compute(covariance);
  }
  return {mean, factor.matrixL()};
}

/// Precision of the prior for one axis: white jerk, and the acceleration and velocity in the middle.
MatrixXd priorPrecision(const Splines& splines, int intervals, double middle, const PathOptions& o) {
  MatrixXd precision = MatrixXd::Zero(splines.size(), splines.size());
  const auto add = [&](const VectorXd& row, double sigma) { precision += row * row.transpose() / (sigma * sigma); };
  const double jerk = std::sqrt(std::max(o.jerkIntensity, 1e-12) / splines.step());
  for (int i = 0; i < intervals; ++i) add(splines.jerk(i), jerk);
  add(splines.at(middle, 2), o.accelerationPrior);
  add(splines.at(middle, 1), o.velocityPrior);
  return precision;
}

} // namespace

double positionNoiseFromTracks(const std::vector<WallView>& views) {
  std::unordered_map<std::int64_t, std::vector<std::pair<std::size_t, Vector3d>>> tracks;
  for (std::size_t k = 0; k < views.size(); ++k)
    for (const WallParticle& p : views[k].particles)
      if (p.track >= 0) tracks[p.track].emplace_back(k, views[k].centre + p.offset.cast<double>());
  std::vector<double> differences;
  for (const auto& [id, places] : tracks)
    for (std::size_t i = 3; i < places.size(); ++i) {
      if (places[i].first - places[i - 3].first != 3) continue; // with a gap
      const double step = (views[places[i].first].time - views[places[i - 3].first].time) / 3;
      bool even = true;
      for (int j = 0; j < 3; ++j)
        even = even && std::abs(views[places[i - j].first].time - views[places[i - j - 1].first].time - step) < 0.01 * step;
      if (!even) continue;
      const Vector3d d = places[i].second - 3 * places[i - 1].second + 3 * places[i - 2].second - places[i - 3].second;
      for (int a = 0; a < 3; ++a) differences.push_back(std::abs(d[a]));
    }
  if (differences.size() < 90) return 0;
  std::nth_element(differences.begin(), differences.begin() + std::ptrdiff_t(differences.size() / 2), differences.end());
  return differences[differences.size() / 2] / (0.6745 * std::sqrt(20.));
}

PathPosterior samplePath(const std::vector<WallView>& views, const std::vector<double>& times, const PathOptions& options) {
  if (!(options.radius > 0)) throw std::invalid_argument("the radius must be greater than 0");
  if (views.size() < 2 || !(views.back().time > views.front().time))
    throw std::invalid_argument("a path needs two snapshots at different times at least");
  PathPosterior result;
  result.positionNoise = options.positionNoise > 0 ? options.positionNoise : positionNoiseFromTracks(views);
  if (result.positionNoise <= 0) result.positionNoise = 1e-3 * options.radius;

  const double first = views.front().time, last = views.back().time, middle = 0.5 * (first + last);
  double variance = 0;
  for (const WallView& v : views) variance += v.covariance.trace() / (3 * double(views.size()));
  result.intervals = intervalsFor(last - first, options.jerkIntensity, std::sqrt(variance));
  const Splines splines(first, last, result.intervals);
  const int m = splines.size();
  const auto K = Eigen::Index(views.size());

  MatrixXd basis(K, m);
  for (Eigen::Index k = 0; k < K; ++k) basis.row(k) = splines.at(views[k].time).transpose();
  const MatrixXd prior1 = priorPrecision(splines, result.intervals, middle, options);
  MatrixXd prior = MatrixXd::Zero(3 * m, 3 * m);
  for (int a = 0; a < 3; ++a) prior.block(a * m, a * m, m, m) = prior1;
  // The prior is about the mean motion: a straight line; its coefficients reproduce it exactly.
  const Vector3d meanVelocity = (views.back().centre - views.front().centre) / (last - first);
  VectorXd priorMean(3 * m);
  for (int a = 0; a < 3; ++a)
    for (int j = 0; j < m; ++j)
      priorMean[a * m + j] = views.front().centre[a] + meanVelocity[a] * (j - 1) * splines.step();

  // Gaussian start: the single-snapshot estimates, as independent as their tracks are.
  MatrixXd information = prior;
  VectorXd pull = prior * priorMean;
  const double caution = 0.2; // the same tracers in many snapshots
  for (Eigen::Index k = 0; k < K; ++k) {
    const Matrix3d weight = caution * views[k].covariance.inverse();
    for (int a = 0; a < 3; ++a)
      for (int b = 0; b < 3; ++b) {
        information.block(a * m, b * m, m, m) += weight(a, b) * basis.row(k).transpose() * basis.row(k);
        pull.segment(a * m, m) += weight(a, b) * views[k].centre[b] * basis.row(k).transpose();
      }
  }
  const Eigen::LLT<MatrixXd> solver(information);
  Gaussian shape = gaussianFrom(solver.solve(pull), solver.solve(MatrixXd::Identity(3 * m, 3 * m)));

  std::mt19937_64 random(20221);
  std::normal_distribution<double> normal(0, 1);
  std::uniform_real_distribution<double> uniform(0, 1);
  const double finest = LogisticPerNoise * result.positionNoise;
  std::vector<double> widths;
  for (double w = std::max(0.5 * std::sqrt(variance), finest); w > 2 * finest; w /= 3) widths.push_back(w);
  widths.push_back(finest), widths.push_back(finest);
  if (widths.size() < 3) widths.push_back(finest);

  const int dimension = 3 * m;
  const auto offsetsOf = [&](const VectorXd& fromMean) {
    Eigen::Matrix3Xd offsets(3, K);
    for (int a = 0; a < 3; ++a) offsets.row(a) = (basis * fromMean.segment(a * m, m)).transpose();
    return offsets;
  };
  const auto logPrior = [&](const VectorXd& t) { return -0.5 * (t - priorMean).dot(prior * (t - priorMean)); };
  std::vector<Vector3d> reference(views.size());
  std::vector<double> reach(views.size());
  const auto look = [&](double sigmas) { // where the shape is now
    for (Eigen::Index k = 0; k < K; ++k) {
      double spread = 0;
      for (int a = 0; a < 3; ++a) {
        reference[k][a] = basis.row(k).dot(shape.mean.segment(a * m, m));
        spread += (basis.row(k) * shape.factor.middleRows(a * m, m)).squaredNorm();
      }
      reach[k] = std::min(sigmas * std::sqrt(spread), views[k].reach);
    }
  };

  // Uphill at the first width (Fisher scoring): a Gaussian that is about right.
  {
    look(8);
    PathLikelihood likelihood(views, reference, reach, options.radius, widths[0]);
    VectorXd at = shape.mean, gradient;
    MatrixXd fisher, covariance = MatrixXd::Identity(dimension, dimension);
    double here = likelihood(offsetsOf(at - shape.mean)) + logPrior(at);
    for (int step = 0; step < 30; ++step) {
      likelihood.derivatives(offsetsOf(at - shape.mean), basis, gradient, fisher);
      gradient -= prior * (at - priorMean);
      const Eigen::LLT<MatrixXd> newton(fisher + prior);
      VectorXd move = newton.solve(gradient);
      covariance = newton.solve(MatrixXd::Identity(dimension, dimension));
      bool climbed = false;
      const double decrement = gradient.dot(move);
      for (int halvings = 0; halvings < 8 && !climbed; ++halvings, move *= 0.5) {
        const double there = likelihood(offsetsOf(at + move - shape.mean)) + logPrior(at + move);
        if (there <= here) continue;
        climbed = true, at += move, here = there;
        break;
      }
      if (!climbed || decrement < 1e-3) break;
    }
    if (getenv("VERBOSE")) { double sp=0; MatrixXd f=covariance.llt().matrixL(); for (int a=0;a<3;++a) sp+=(basis.row(K/2)*f.middleRows(a*m,m)).squaredNorm(); printf("fisher sigma %.2f um, here %.2f, shape mean moved %.2f um\n",1e6*std::sqrt(sp),here, 1e6*offsetsOf(at-shape.mean).colwise().norm().mean()); }
    shape = gaussianFrom(at, 2 * covariance);
  }

  VectorXd theta = shape.mean;
  MatrixXd samples;
  for (std::size_t round = 0; round < widths.size(); ++round) {
    const bool final = round + 1 == widths.size();
    look(7);
    PathLikelihood likelihood(views, reference, reach, options.radius, widths[round]);
    const auto logRatio = [&](const VectorXd& t, const VectorXd& z) { // log of (target over shape)
      return likelihood(offsetsOf(t - shape.mean)) + logPrior(t) + 0.5 * z.squaredNorm();
    };
    // Elliptical slice sampling of z, theta = mean + L z.
    VectorXd z = shape.factor.triangularView<Eigen::Lower>().solve(theta - shape.mean);
    double here = logRatio(theta, z);
    const int steps = final ? options.steps : options.steps / 3, warm = steps / 5;
    samples.resize(dimension, steps);
    int evaluations = 0;
    for (int s = -warm; s < steps; ++s) {
      VectorXd nu(dimension);
      for (int i = 0; i < dimension; ++i) nu[i] = normal(random);
      const double level = here + std::log(std::max(uniform(random), 1e-300));
      double angle = 2 * M_PI * uniform(random), low = angle - 2 * M_PI, high = angle;
      for (int shrink = 0; shrink < 60; ++shrink) {
        ++evaluations;
        const VectorXd proposed = z * std::cos(angle) + nu * std::sin(angle);
        const VectorXd t = shape.mean + shape.factor * proposed;
        const double there = logRatio(t, proposed);
        if (there > level) {
          z = proposed, theta = t, here = there;
          break;
        }
        (angle < 0 ? low : high) = angle;
        angle = low + (high - low) * uniform(random);
      }
      if (s >= 0) samples.col(s) = theta;
    }
    const VectorXd mean = samples.rowwise().mean();
    const MatrixXd from = samples.colwise() - mean;
    const MatrixXd covariance = from * from.transpose() / double(steps - 1);
    // batch means: how many independent samples the chain was worth
    const int batch = std::max(1, int(std::sqrt(double(steps)))), batches = steps / batch;
    double least = steps;
    for (int i = 0; i < dimension; ++i) {
      double between = 0;
      for (int b = 0; b < batches; ++b) between += std::pow(from.row(i).segment(b * batch, batch).mean(), 2) / batches;
      if (between > 0) least = std::min(least, covariance(i, i) / between * batches);
    }
    result.effectiveSamples = least;
    if (getenv("VERBOSE")) { MatrixXd f=gaussianFrom(mean,covariance).factor; double sp=0; for (int a=0;a<3;++a) sp+=(basis.row(K/2)*f.middleRows(a*m,m)).squaredNorm(); printf("round %zu w %.2f um sigma mid %.2f um eff %.0f evals/step %.1f here %.1f instances %zu tracks %zu\n",round,1e6*widths[round],1e6*std::sqrt(sp),least,double(evaluations)/(steps+warm),here, likelihood.instances(), likelihood.tracks()); }
    const double trust = std::min(1., least / (3. * dimension));
    const MatrixXd old = shape.factor * shape.factor.transpose();
    shape = gaussianFrom(mean, 1.3 * (trust * covariance + (1 - trust) * old));
  }

  const VectorXd mean = samples.rowwise().mean();
  const MatrixXd from = samples.colwise() - mean;
  for (const double time : times) {
    PathPoint p;
    const auto fill = [&](int derivative, Vector3d& value, Matrix3d& covariance) {
      const VectorXd row = splines.at(time, derivative);
      Eigen::Matrix3Xd spread(3, from.cols());
      for (int a = 0; a < 3; ++a) {
        value[a] = row.dot(mean.segment(a * m, m));
        spread.row(a) = row.transpose() * from.middleRows(a * m, m);
      }
      covariance = spread * spread.transpose() / double(from.cols() - 1);
    };
    fill(0, p.centre, p.centreCovariance);
    fill(1, p.velocity, p.velocityCovariance);
    fill(2, p.acceleration, p.accelerationCovariance);
    result.points.push_back(p);
  }
  return result;
}

} // namespace rimflow
