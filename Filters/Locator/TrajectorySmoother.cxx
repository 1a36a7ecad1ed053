#include "TrajectorySmoother.h"

#include "FlowAroundSphere.h"
#include "PathPosterior.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numeric>
#include <stdexcept>
#include <string>

namespace rimflow {
namespace {

// The state: centre, velocity, acceleration, and the correlated part b of the estimates' error; three of
// each.
using State = Eigen::Matrix<double, 12, 1>;
using StateMatrix = Eigen::Matrix<double, 12, 12>;
enum Part { Centre = 0, Velocity = 3, Acceleration = 6, Correlated = 9 };

constexpr double FreeAcceleration = 10; // m/s2: standard deviation where nothing is known

struct Parameters {
  double jerkIntensity = 1, correlatedFraction = 0, correlationTime = 1, inflation = 1,
         accelerationPrior = FreeAcceleration;
};

constexpr std::size_t WindowSnapshots = 48; // of the joint estimate at most
constexpr std::size_t LeastSnapshots = 4;   // at least
constexpr int WindowIntervals = 6;          // of a window's spline at most

/// F(dt): constant acceleration, and b decays as exp(-dt/T).
StateMatrix transition(double dt, const Parameters& p) {
  StateMatrix f = StateMatrix::Identity();
  for (int i = 0; i < 3; ++i) {
    f(Centre + i, Velocity + i) = f(Velocity + i, Acceleration + i) = dt;
    f(Centre + i, Acceleration + i) = 0.5 * dt * dt;
    f(Correlated + i, Correlated + i) = std::exp(-dt / p.correlationTime);
  }
  return f;
}

/// Q(dt): white jerk of spectral density q, integrated; and what keeps b stationary.
StateMatrix processNoise(double dt, const Parameters& p, const Eigen::Matrix3d& stationary) {
  const double q = p.jerkIntensity, d2 = dt * dt, d3 = d2 * dt, d4 = d2 * d2, d5 = d4 * dt;
  StateMatrix noise = StateMatrix::Zero();
  for (int i = 0; i < 3; ++i) {
    noise(Centre + i, Centre + i) = q * d5 / 20;
    noise(Velocity + i, Velocity + i) = q * d3 / 3;
    noise(Acceleration + i, Acceleration + i) = q * dt;
    noise(Centre + i, Velocity + i) = noise(Velocity + i, Centre + i) = q * d4 / 8;
    noise(Centre + i, Acceleration + i) = noise(Acceleration + i, Centre + i) = q * d3 / 6;
    noise(Velocity + i, Acceleration + i) = noise(Acceleration + i, Velocity + i) = q * d2 / 2;
  }
  noise.block<3, 3>(Correlated, Correlated) = (1 - std::exp(-2 * dt / p.correlationTime)) * stationary;
  return noise;
}

struct Gaussian {
  State mean;
  StateMatrix covariance;
};

/// Ends the search for parameters when progress says stop.
struct Stopped {};

/// The estimates in the order of time, and how they are filtered and smoothed for given parameters.
class Smoother {
public:
  Smoother(const std::vector<CentreEstimate>& estimates, const SmootherOptions& options,
           const Progress& progress)
      : options_(options), progress_(progress), sorted_(estimates) {
    std::stable_sort(sorted_.begin(), sorted_.end(),
                     [](const CentreEstimate& a, const CentreEstimate& b) { return a.time < b.time; });
    used_.resize(sorted_.size());
    for (std::size_t k = 0; k < sorted_.size(); ++k) used_[k] = sorted_[k].found;
    refresh();
  }

  int count() const { return count_; }
  const std::vector<CentreEstimate>& sorted() const { return sorted_; }
  const std::vector<bool>& used() const { return used_; }
  double duration() const { return sorted_.back().time - sorted_.front().time; }
  double shortestStep() const {
    double step = std::numeric_limits<double>::infinity();
    for (std::size_t k = 1; k < sorted_.size(); ++k)
      if (sorted_[k].time > sorted_[k - 1].time) step = std::min(step, sorted_[k].time - sorted_[k - 1].time);
    return std::isfinite(step) ? step : 1;
  }

  /// Twice the negative logarithm of the likelihood of the innovations; chiSquared: their sum of squares.
  /// Throws Stopped.
  double filter(const Parameters& p, double* chiSquared = nullptr) {
    // How often it will be called is not known beforehand: some thousand times is much.
    constexpr double Many = 1000;
    ++calls_;
    if (!goOn(progress_, calls_ / (calls_ + Many))) throw Stopped();
    filtered_.resize(sorted_.size());
    predicted_.resize(sorted_.size());
    transitions_.resize(sorted_.size());
    double deviance = 0, chi = 0;
    Gaussian now = prior(p);
    for (std::size_t k = 0; k < sorted_.size(); ++k) {
      if (k > 0) {
        const double dt = sorted_[k].time - sorted_[k - 1].time;
        transitions_[k] = transition(dt, p);
        now.mean = transitions_[k] * now.mean;
        now.covariance = transitions_[k] * now.covariance * transitions_[k].transpose() +
                         processNoise(dt, p, correlatedCovariance(p));
      }
      predicted_[k] = now;
      if (used_[k]) {
        const Innovation i = innovation(now, sorted_[k], p);
        const double square = i.difference.dot(i.solver.solve(i.difference));
        deviance += square + 2 * i.solver.matrixL().toDenseMatrix().diagonal().array().log().sum();
        chi += square;
        const Eigen::Matrix<double, 12, 3> gain = i.solver.solve(i.cross.transpose()).transpose();
        now.mean += gain * i.difference;
        now.covariance -= gain * i.cross.transpose();
        now.covariance = 0.5 * (now.covariance + now.covariance.transpose()).eval();
      }
      filtered_[k] = now;
    }
    if (chiSquared) *chiSquared = chi;
    return deviance;
  }

  /// Backwards through what filter() left.
  std::vector<Gaussian> smooth(const Parameters& p) {
    filter(p);
    std::vector<Gaussian> smoothed = filtered_;
    for (std::size_t k = sorted_.size() - 1; k-- > 0;) {
      const StateMatrix back = predicted_[k + 1]
                                   .covariance.ldlt()
                                   .solve(transitions_[k + 1] * filtered_[k].covariance)
                                   .transpose();
      smoothed[k].mean += back * (smoothed[k + 1].mean - predicted_[k + 1].mean);
      smoothed[k].covariance +=
          back * (smoothed[k + 1].covariance - predicted_[k + 1].covariance) * back.transpose();
    }
    return smoothed;
  }

  /// Leaves out the estimate that is farthest from the path through all others, if it is too far. False:
  /// none.
  bool rejectWorst(const Parameters& p) {
    const std::vector<Gaussian> smoothed = smooth(p);
    double worst = options_.rejectionChiSquared;
    std::size_t which = sorted_.size();
    for (std::size_t k = 0; k < sorted_.size(); ++k) {
      if (!used_[k]) continue;
      // The residual z - H x has the covariance R - H P H^T: from it the distance to the path without
      // estimate k.
      const Innovation i = innovation(smoothed[k], sorted_[k], p);
      const Eigen::Matrix3d white = whiteCovariance(sorted_[k], p);
      const Eigen::Matrix3d residual = 2 * white - i.solver.reconstructedMatrix(); // R - (S - R)
      const Eigen::LLT<Eigen::Matrix3d> solver(residual);
      if (solver.info() != Eigen::Success)
        continue; // the path follows this estimate: nothing to compare with
      const double square = i.difference.dot(solver.solve(i.difference));
      if (square > worst) {
        worst = square;
        which = k;
      }
    }
    if (which == sorted_.size()) return false;
    used_[which] = false;
    refresh();
    return true;
  }

private:
  struct Innovation {
    Eigen::Vector3d difference;         // z - H x
    Eigen::Matrix<double, 12, 3> cross; // P H^T
    Eigen::LLT<Eigen::Matrix3d> solver; // of H P H^T + R
  };

  Innovation innovation(const Gaussian& g, const CentreEstimate& e, const Parameters& p) const {
    Innovation i;
    i.difference = e.centre - g.mean.segment<3>(Centre) - g.mean.segment<3>(Correlated);
    i.cross = g.covariance.middleCols<3>(Centre) + g.covariance.middleCols<3>(Correlated);
    i.solver.compute(i.cross.middleRows<3>(Centre) + i.cross.middleRows<3>(Correlated) +
                     whiteCovariance(e, p));
    return i;
  }
  static Eigen::Matrix3d whiteCovariance(const CentreEstimate& e, const Parameters& p) {
    return p.inflation * (1 - p.correlatedFraction) * e.covariance;
  }
  Eigen::Matrix3d correlatedCovariance(const Parameters& p) const {
    return p.inflation * p.correlatedFraction * meanCovariance_ + 1e-24 * Eigen::Matrix3d::Identity();
  }

  /// Before the first estimate: somewhere on the record, at its mean velocity, give or take the priors.
  Gaussian prior(const Parameters& p) const {
    Gaussian g{State::Zero(), StateMatrix::Zero()};
    const double lead =
        sorted_.front().time - firstUsed_->time; // <= 0: the first snapshots may have no estimate
    const double spread = 1 + std::abs(lead) * options_.velocityPrior;
    g.mean.segment<3>(Centre) = firstUsed_->centre + lead * meanVelocity_;
    g.mean.segment<3>(Velocity) = meanVelocity_;
    g.covariance.diagonal().segment<3>(Centre).setConstant(spread * spread);
    g.covariance.diagonal().segment<3>(Velocity).setConstant(std::pow(options_.velocityPrior, 2));
    g.covariance.diagonal().segment<3>(Acceleration).setConstant(std::pow(p.accelerationPrior, 2));
    g.covariance.block<3, 3>(Correlated, Correlated) = correlatedCovariance(p);
    return g;
  }

  void refresh() {
    count_ = int(std::count(used_.begin(), used_.end(), true));
    if (count_ == 0) return;
    const auto first = std::find(used_.begin(), used_.end(), true) - used_.begin();
    const auto last = used_.rend() - std::find(used_.rbegin(), used_.rend(), true) - 1;
    firstUsed_ = &sorted_[first];
    const double dt = sorted_[last].time - sorted_[first].time;
    meanVelocity_ = dt > 0 ? Eigen::Vector3d((sorted_[last].centre - sorted_[first].centre) / dt)
                           : Eigen::Vector3d::Zero();
    meanCovariance_.setZero();
    for (std::size_t k = 0; k < sorted_.size(); ++k)
      if (used_[k]) meanCovariance_ += sorted_[k].covariance / count_;
  }

  const SmootherOptions& options_;
  const Progress& progress_;
  double calls_ = 0; // of filter()
  std::vector<CentreEstimate> sorted_;
  std::vector<bool> used_;
  std::vector<Gaussian> predicted_, filtered_;
  std::vector<StateMatrix> transitions_;
  const CentreEstimate* firstUsed_ = nullptr;
  Eigen::Vector3d meanVelocity_ = Eigen::Vector3d::Zero();
  Eigen::Matrix3d meanCovariance_ = Eigen::Matrix3d::Zero();
  int count_ = 0;
};

/// The jerk intensity of largest likelihood: a scan over decades, then golden-section search.
double likelyJerk(Smoother& smoother, Parameters p, double& best) {
  const auto deviance = [&](double logarithm) {
    p.jerkIntensity = std::pow(10, logarithm);
    return smoother.filter(p);
  };
  double at = -6;
  best = std::numeric_limits<double>::infinity();
  for (double l = -6; l <= 8; l += 1) {
    const double value = deviance(l);
    if (value < best) {
      best = value;
      at = l;
    }
  }
  constexpr double golden = 0.6180339887498949;
  double low = at - 1, high = at + 1, a = high - golden * (high - low), b = low + golden * (high - low);
  double fa = deviance(a), fb = deviance(b);
  while (high - low > 0.05) {
    if (fa < fb) {
      high = b, b = a, fb = fa;
      fa = deviance(a = high - golden * (high - low));
    } else {
      low = a, a = b, fa = fb;
      fb = deviance(b = low + golden * (high - low));
    }
  }
  best = std::min({best, fa, fb});
  return std::pow(10, 0.5 * (low + high));
}

/// The largest standard deviation of the acceleration that is hardly less likely than the most likely one: a
/// looser prior only adds noise to the velocity.
double freestAcceleration(Smoother& smoother, Parameters p) {
  constexpr double Sigmas[] = {FreeAcceleration, 3, 1, 0.3, 0.1, 0.03, 0.01};
  std::vector<double> deviances;
  for (const double sigma : Sigmas) {
    p.accelerationPrior = sigma;
    deviances.push_back(smoother.filter(p));
  }
  const double lowest = *std::min_element(deviances.begin(), deviances.end());
  std::size_t k = 0;
  while (deviances[k] > lowest + 1) ++k;
  return Sigmas[k];
}

/// The smallest jerk intensity that the record does not speak against (by 4.5 standard deviations): single
/// estimates have long tails, and in thin seeding their wandering is soon taken for motion.
double leastJerk(Smoother& smoother, Parameters p, double lowestDeviance) {
  constexpr double Doubt = 20;
  double least = p.jerkIntensity;
  while (least > 1e-7) {
    p.jerkIntensity = 0.1 * least;
    if (smoother.filter(p) > lowestDeviance + Doubt) break;
    least = p.jerkIntensity;
  }
  return least;
}

/// q, f, T of largest likelihood but for the jerk, and the inflation s.
Parameters likelyParameters(Smoother& smoother, const SmootherOptions& options) {
  const double step = smoother.shortestStep();
  Parameters chosen;
  chosen.correlationTime = step;
  double lowest = std::numeric_limits<double>::infinity();
  const bool few = smoother.count() < 5; // too few to tell correlation from motion
  std::vector<double> fractions{0, 0.3, 0.6, 0.8, 0.95};
  if (options.correlatedFraction >= 0)
    fractions = {std::min(options.correlatedFraction, 0.95)};
  else if (few)
    fractions = {0};
  std::vector<double> times{2 * step};
  while (2.5 * times.back() <= smoother.duration()) times.push_back(2.5 * times.back());
  if (options.correlationTime > 0) times = {options.correlationTime};
  for (const double fraction : fractions)
    for (const double time : times) {
      Parameters p;
      p.correlatedFraction = fraction;
      p.correlationTime = time;
      double deviance;
      if (options.jerkIntensity >= 0) {
        p.jerkIntensity = options.jerkIntensity;
        deviance = smoother.filter(p);
      } else {
        p.jerkIntensity = likelyJerk(smoother, p, deviance);
      }
      if (deviance < lowest) {
        lowest = deviance;
        chosen = p;
      }
      if (fraction == 0) break; // T does not matter
    }
  if (options.jerkIntensity < 0) chosen.jerkIntensity = leastJerk(smoother, chosen, lowest);
  if (options.accelerationPrior >= 0)
    chosen.accelerationPrior = std::max(options.accelerationPrior, 1e-6);
  else
    chosen.accelerationPrior = freestAcceleration(smoother, chosen);
  double chiSquared = 0;
  smoother.filter(chosen, &chiSquared);
  if (!few) chosen.inflation = std::max(1.0, chiSquared / (3.0 * smoother.count()));
  return chosen;
}

void check(const std::vector<CentreEstimate>& estimates) {
  for (std::size_t k = 0; k < estimates.size(); ++k) {
    const CentreEstimate& e = estimates[k];
    const std::string which = "estimate " + std::to_string(k) + " of " + std::to_string(estimates.size());
    if (!std::isfinite(e.time)) throw std::invalid_argument(which + " has no finite time");
    if (e.found && !e.centre.allFinite())
      throw std::invalid_argument(which + " is marked as found, but its centre is not finite");
    if (e.found && (!e.covariance.allFinite() || e.covariance.llt().info() != Eigen::Success))
      throw std::invalid_argument(which + " has a covariance that is not positive definite");
  }
}

/// What the flow around the sphere knows in a window, seen from the smoothed path `reference` (one point per
/// view).
FlowFit flowAlong(const std::vector<CentreEstimate>& views, const std::vector<SmoothedCentre>& reference,
                  double radius, double accelerationPrior, const Progress& progress) {
  std::vector<FlowView> flow;
  for (std::size_t k = 0; k < views.size(); ++k) {
    const Eigen::Vector3f moved = (views[k].centre - reference[k].centre).cast<float>();
    FlowView view{views[k].time, reference[k].velocity, {}};
    for (const WallParticle& p : views[k].wall->particles)
      if (p.velocity.allFinite()) {
        view.particles.push_back(p);
        view.particles.back().offset += moved;
      }
    flow.push_back(std::move(view));
  }
  FlowFitOptions options;
  options.radius = radius;
  options.accelerationPrior = accelerationPrior;
  return fitFlow(flow, options, progress);
}

/// Corrects the reference path by what a fit found.
void moveBy(const FlowFit& fit, std::vector<SmoothedCentre>& reference,
            const std::vector<CentreEstimate>& views) {
  for (std::size_t k = 0; k < views.size(); ++k) {
    const double dt = views[k].time - fit.time;
    reference[k].centre += fit.centre + dt * (fit.velocity + 0.5 * dt * fit.acceleration);
    reference[k].velocity += fit.velocity + dt * fit.acceleration;
    reference[k].acceleration += fit.acceleration;
  }
}

/// The fit as an estimate of the motion at the view nearest to its time.
MotionEstimate motionFrom(const FlowFit& fit, const std::vector<CentreEstimate>& views,
                          const std::vector<SmoothedCentre>& reference) {
  std::size_t k = 0;
  for (std::size_t i = 1; i < views.size(); ++i)
    if (std::abs(views[i].time - fit.time) < std::abs(views[k].time - fit.time)) k = i;
  const double dt = views[k].time - fit.time;
  Eigen::Matrix<double, 9, 9> shift = Eigen::Matrix<double, 9, 9>::Identity();
  shift.block<3, 3>(0, 3) = shift.block<3, 3>(3, 6) = dt * Eigen::Matrix3d::Identity();
  shift.block<3, 3>(0, 6) = 0.5 * dt * dt * Eigen::Matrix3d::Identity();
  Eigen::Matrix<double, 9, 1> motion;
  motion << fit.centre, fit.velocity, fit.acceleration;
  motion = (shift * motion).eval();
  return {views[k].time, reference[k].centre + motion.head<3>(), reference[k].velocity + motion.segment<3>(3),
          reference[k].acceleration + motion.tail<3>(), shift * fit.covariance * shift.transpose()};
}

/// The joint estimate of the snapshots that were found, in windows; `points` in the order of
/// smoother.sorted(). Sets result.aborted.
void refine(const Smoother& smoother, const Parameters& p, const SmootherOptions& options,
            std::vector<SmoothedCentre>& points, SmoothedTrajectory& result, const Progress& progress) {
  std::vector<CentreEstimate> views;
  std::vector<SmoothedCentre> reference; // the points of the views
  std::vector<double> noises;
  for (std::size_t k = 0; k < points.size(); ++k) {
    const CentreEstimate& e = smoother.sorted()[k];
    if (!smoother.used()[k] || !e.wall || (!views.empty() && e.time <= views.back().time)) continue;
    views.push_back(e);
    reference.push_back(points[k]);
    noises.push_back(e.wall->positionNoise);
  }
  if (views.size() < LeastSnapshots) return;
  PathOptions path;
  path.radius = options.radius;
  path.jerkIntensity = p.jerkIntensity;
  path.velocityPrior = options.velocityPrior;
  path.accelerationPrior = p.accelerationPrior;
  path.positionNoise = positionNoiseFromTracks(views);
  if (path.positionNoise <= 0) {
    std::nth_element(noises.begin(), noises.begin() + std::ptrdiff_t(noises.size() / 2), noises.end());
    path.positionNoise = noises[noises.size() / 2];
  }
  path.positionNoise = std::max(path.positionNoise, 1e-5 * options.radius);

  const double step = (views.back().time - views.front().time) / double(views.size() - 1);
  std::size_t length = std::min(WindowSnapshots, views.size());
  while (length >= LeastSnapshots &&
         pathIntervals(double(length - 1) * step, p.jerkIntensity, singleSigma(views)) > WindowIntervals)
    length /= 2;
  if (length < LeastSnapshots) return;

  std::vector<std::size_t> starts;
  for (std::size_t first = 0; first + length < views.size(); first += length / 2) starts.push_back(first);
  starts.push_back(views.size() - length);
  const auto middle = [&](std::size_t w) {
    return 0.5 * (views[starts[w]].time + views[starts[w] + length - 1].time);
  };
  std::vector<std::vector<std::size_t>> mine(starts.size()); // the points of each window
  for (std::size_t k = 0; k < points.size(); ++k) {
    const double time = smoother.sorted()[k].time;
    if (time < views.front().time || time > views.back().time) continue;
    std::size_t nearest = 0;
    for (std::size_t w = 1; w < starts.size(); ++w)
      if (std::abs(middle(w) - time) < std::abs(middle(nearest) - time)) nearest = w;
    mine[nearest].push_back(k);
  }
  result.aborted = !forEachPiece(starts.size(), progress, [&](std::size_t w, const Progress& watch) {
    const auto begin = std::ptrdiff_t(starts[w]), end = std::ptrdiff_t(starts[w] + length);
    const std::vector<CentreEstimate> window(views.begin() + begin, views.begin() + end);
    std::vector<SmoothedCentre> smoothed(reference.begin() + begin, reference.begin() + end);
    FlowFit flow = flowAlong(window, smoothed, options.radius, p.accelerationPrior, part(watch, 0, 0.2));
    if (flow.enough) { // again from a better path: the flow's growth and turning follow it
      moveBy(flow, smoothed, window);
      flow = flowAlong(window, smoothed, options.radius, p.accelerationPrior, part(watch, 0.2, 0.4));
    }
    PathOptions own = path;
    if (flow.enough) own.motion.push_back(motionFrom(flow, window, smoothed));
    std::vector<double> times;
    for (const std::size_t k : mine[w]) times.push_back(smoother.sorted()[k].time);
    const PathPosterior posterior = samplePath(window, times, own, part(watch, 0.4, 1));
    if (posterior.points.empty()) return;
    for (std::size_t i = 0; i < mine[w].size(); ++i) {
      const PathPoint& q = posterior.points[i];
      SmoothedCentre& point = points[mine[w][i]];
      point.centre = q.centre, point.velocity = q.velocity, point.acceleration = q.acceleration;
      point.centreCovariance = q.centreCovariance;
      point.velocityCovariance = q.velocityCovariance;
      point.accelerationCovariance = q.accelerationCovariance;
      if (!flow.enough) continue;
      point.angularVelocity = flow.angularVelocity;
      point.angularVelocitySigma = flow.angularVelocityCovariance.diagonal().cwiseSqrt();
    }
  });
  for (const auto& of : mine) result.joint += int(of.size());
  result.positionNoise = path.positionNoise;
}

/// Whether the standard deviation exceeds the limit in any direction; a limit of 0 is none.
bool tooUncertain(const Eigen::Matrix3d& covariance, double limit) {
  if (limit <= 0) return false;
  return Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>(covariance).eigenvalues()[2] > limit * limit;
}

} // namespace

SmoothedTrajectory smoothTrajectory(const std::vector<CentreEstimate>& estimates,
                                    const SmootherOptions& options, const Progress& progress) try {
  check(estimates);
  SmoothedTrajectory result;
  const Eigen::Vector3d nan = Eigen::Vector3d::Constant(std::numeric_limits<double>::quiet_NaN());
  const Eigen::Matrix3d nans = Eigen::Matrix3d::Constant(std::numeric_limits<double>::quiet_NaN());
  result.points.assign(estimates.size(), {CentreStatus::Lost, nan, nan, nan, nans, nans, nans, nan, nan});
  if (estimates.empty()) return result;
  const double share = options.radius > 0 ? 0.2 : 1; // of the parameters
  const Progress search = part(progress, 0, share);
  Smoother smoother(estimates, options, search);
  if (smoother.count() == 0) return result;

  Parameters p = likelyParameters(smoother, options);
  const int allowed = int(options.largestRejectedPart * smoother.count());
  while (result.rejected < allowed && smoother.rejectWorst(p)) {
    ++result.rejected;
    p = likelyParameters(smoother, options);
  }
  result.jerkIntensity = p.jerkIntensity;
  result.correlatedFraction = p.correlatedFraction;
  result.correlationTime = p.correlationTime;
  result.inflation = p.inflation;
  result.accelerationPrior = p.accelerationPrior;

  std::vector<std::size_t> order(estimates.size());
  std::iota(order.begin(), order.end(), 0);
  std::stable_sort(order.begin(), order.end(),
                   [&](std::size_t a, std::size_t b) { return estimates[a].time < estimates[b].time; });
  // What the record says of the acceleration holds between its finds; before and after them it may be
  // anything.
  Parameters outside = p;
  outside.accelerationPrior = std::max(p.accelerationPrior, FreeAcceleration);
  const std::vector<Gaussian> within = smoother.smooth(p), beyond = smoother.smooth(outside);
  const auto& used = smoother.used();
  const std::size_t firstFound = std::size_t(std::find(used.begin(), used.end(), true) - used.begin());
  const std::size_t lastFound = std::size_t(used.rend() - std::find(used.rbegin(), used.rend(), true)) - 1;
  std::vector<SmoothedCentre> points;
  for (std::size_t k = 0; k < order.size(); ++k) {
    const Gaussian& g = k < firstFound || k > lastFound ? beyond[k] : within[k];
    points.push_back({used[k] ? CentreStatus::Found : CentreStatus::Predicted, g.mean.segment<3>(Centre),
                      g.mean.segment<3>(Velocity), g.mean.segment<3>(Acceleration),
                      g.covariance.block<3, 3>(Centre, Centre), g.covariance.block<3, 3>(Velocity, Velocity),
                      g.covariance.block<3, 3>(Acceleration, Acceleration), Eigen::Vector3d::Zero(),
                      Eigen::Vector3d::Constant(-1)});
  }
  if (options.radius > 0) refine(smoother, p, options, points, result, part(progress, share, 1));
  if (result.aborted) return result;
  for (std::size_t k = 0; k < order.size(); ++k)
    if (points[k].status == CentreStatus::Found ||
        !tooUncertain(points[k].centreCovariance, options.largestPredictionSigma))
      result.points[order[k]] = points[k];
  return result;
} catch (const Stopped&) {
  SmoothedTrajectory result;
  result.aborted = true;
  return result;
}

} // namespace rimflow
