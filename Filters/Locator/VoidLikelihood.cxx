#include "VoidLikelihood.h"

#include "ImportanceSampling.h"

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

namespace rimflow {
namespace {

constexpr double CoarseWidth = 0.1;          // of R: the width of the wall at which the search starts
constexpr double WidthRatio = 1 / 3.;        // from one width to the next
constexpr double LogisticPerNoise = 0.62666; // sqrt(2 pi)/4: w at which the logistic has the normal's slope
constexpr double PriorGhosts = 0.005,
                 GhostBacking = 100; // prior ghost rate, worth so many expected particles
constexpr double NoisePerSpacing[] = {1 / 800., 1 / 400., 1 / 200., 1 / 100., 1 / 50.};
constexpr double NoisePrior[] = {1 / 9., 2 / 9., 3 / 9., 2 / 9., 1 / 9.};

/// g(u) = log((1 - f) + eps f), f = 1/(1 + e^u), by linear interpolation; 0 far outside, log(eps) deep
/// inside.
class WallProfile {
public:
  explicit WallProfile(double eps) : lowest_(float(std::log(eps) - 10)) {
    step_ = (Highest - lowest_) / (Entries - 2);
    for (int k = 0; k < Entries; ++k) {
      const double u = lowest_ + k * double(step_);
      value_[k] = float(u > 0 ? std::log1p(eps * std::exp(-u)) - std::log1p(std::exp(-u))
                              : std::log(eps + std::exp(u)) - std::log1p(std::exp(u)));
    }
  }

  /// Sum of g((|x_i - o| - R)/w) over n particles.
  double sum(const float* x, const float* y, const float* z, int n, const Eigen::Vector3f& o, float radius,
             float width) const {
    const float perWidth = 1 / width, perStep = 1 / step_, lo = lowest_, hi = Highest - step_;
    const float ox = o[0], oy = o[1], oz = o[2];
    const float* value = value_;
    float total = 0;
#pragma omp simd reduction(+ : total)
    for (int i = 0; i < n; ++i) {
      const float dx = x[i] - ox, dy = y[i] - oy, dz = z[i] - oz;
      float u = (std::sqrt(dx * dx + dy * dy + dz * dz) - radius) * perWidth;
      u = u < lo ? lo : u > hi ? hi : u;
      const float t = (u - lo) * perStep;
      const int k = int(t);
      total += value[k] + (t - float(k)) * (value[k + 1] - value[k]);
    }
    return total;
  }
  /// Beyond these distances from the wall, in widths, g is constant.
  double inner() const { return -lowest_; }
  static double outer() { return Highest; }

private:
  static constexpr int Entries = 2048;
  static constexpr float Highest = 16;
  float lowest_, step_;
  float value_[Entries];
};

/// Particles around an origin, as offsets.
struct Offsets {
  std::vector<float> x, y, z;

  void add(float dx, float dy, float dz) {
    x.push_back(dx);
    y.push_back(dy);
    z.push_back(dz);
  }
  int size() const { return int(x.size()); }
  Eigen::Vector3d at(int i) const { return {x[i], y[i], z[i]}; }
};

Offsets gather(const ParticleIndex& particles, const Eigen::Vector3d& origin, double radius) {
  Offsets offsets;
  particles.forEachWithin(origin, radius,
                          [&](std::uint32_t, float dx, float dy, float dz) { offsets.add(dx, dy, dz); });
  return offsets;
}

/// Share of a ball that lies in a box.
double shareInside(const Box& box, const Eigen::Vector3d& centre, double radius) {
  if (((centre.array() - radius) >= box.lower.array()).all() &&
      ((centre.array() + radius) <= box.upper.array()).all())
    return 1;
  int inside = 0, all = 0;
  for (double r : {0.46416, 0.79370, 0.94104}) // radii that halve thirds of the volume: 0.1, 0.5, 0.8333
    for (std::size_t d = 0; d < evenDirections().size(); d += 4, ++all)
      inside += box.contains(centre + r * radius * evenDirections()[d]);
  return double(inside) / all;
}

/// Deviance of finding k where n are expected; 0 when there are more.
double deficit(double k, double n) { return k >= n ? 0 : n - k + (k > 0 ? k * std::log(k / n) : 0); }

/// Where in the search cube a ball misses most particles against the shell around it.
Eigen::Vector3d scan(const ParticleIndex& particles, const Eigen::Vector3d& guess, double radius,
                     double side) {
  const Box& box = particles.box();
  const double inner = 1.25 * radius, outer = 2 * radius; // the shell that tells the density
  const int half = std::max(1, int(std::ceil(0.5 * side / (radius / 3) - 1e-6)));
  const double step = 0.5 * side / half;
  const Offsets around = gather(particles, guess, 0.5 * std::sqrt(3.) * side + outer);
  const int edge = 2 * half + 1, nodes = edge * edge * edge;
  std::vector<double> score(nodes, -1);
  for (int node = 0; node < nodes; ++node) {
    const Eigen::Vector3d o =
        step * Eigen::Vector3d(node % edge - half, node / edge % edge - half, node / edge / edge - half);
    const Eigen::Vector3d at = guess + o;
    if (!box.contains(at)) continue;
    const float ox = float(o[0]), oy = float(o[1]), oz = float(o[2]), r = float(radius);
    const float perWidth = float(1 / (CoarseWidth * radius)), in2 = float(inner * inner),
                out2 = float(outer * outer);
    float within = 0, shell = 0;
    const int n = around.size();
#pragma omp simd reduction(+ : within, shell)
    for (int i = 0; i < n; ++i) {
      const float dx = around.x[i] - ox, dy = around.y[i] - oy, dz = around.z[i] - oz;
      const float rr = dx * dx + dy * dy + dz * dz;
      float u = (r - std::sqrt(rr)) * perWidth; // counted inside with a soft edge, so that there are no ties
      u = u < -1 ? -1 : u > 1 ? 1 : u;
      within += 0.5f + 0.5f * u;
      shell += (rr > in2 && rr < out2) ? 1.f : 0.f;
    }
    const double share = shareInside(box, at, radius), wide = shareInside(box, at, outer);
    const double shellVolume = wide * ballVolume(outer) - share * ballVolume(inner);
    const double density = shellVolume > 0 ? shell / shellVolume : 0;
    score[node] = deficit(within, density * share * ballVolume(radius));
  }
  const int best = int(std::max_element(score.begin(), score.end()) - score.begin());
  if (score[best] < 0) return box.clamp(guess);
  return guess +
         step * Eigen::Vector3d(best % edge - half, best / edge % edge - half, best / edge / edge - half);
}

Body sphere(const Eigen::Vector3d& centre, double diameter) {
  Body body;
  body.diameter = diameter;
  body.centre = centre;
  return body;
}

/// eps from the particles deep inside, drawn towards its prior.
double ghostRate(const ParticleIndex& particles, const SeedingDensity& seeding, const Eigen::Vector3d& centre,
                 const VoidLikelihoodOptions& options) {
  if (options.ghostRate >= 0) return std::min(std::max(options.ghostRate, 1e-6), 0.9);
  const double deep = 0.45 * options.diameter; // clear of the wall
  const double found = double(particles.countWithin(centre, deep)),
               fluid = seeding.expectedWithin(centre, deep);
  return std::min((found + PriorGhosts * GhostBacking) / (fluid + GhostBacking), 0.9);
}

struct Derivatives {
  double value = 0;
  Eigen::Vector3d gradient = Eigen::Vector3d::Zero();
  Eigen::Matrix3d information =
      Eigen::Matrix3d::Zero(); // sum of the squared gradients of the particles' terms
};

/// sum of log((1 - f) + eps f) over particles near the wall and inside, with derivatives, at origin + o.
Derivatives wallTerms(const Offsets& offsets, const Eigen::Vector3d& o, double radius, double width,
                      double eps) {
  Derivatives d;
  for (int i = 0; i < offsets.size(); ++i) {
    const Eigen::Vector3d r = offsets.at(i) - o;
    const double distance = r.norm(), u = (distance - radius) / width;
    if (u > 30) continue;
    const double e = std::exp(-std::abs(u)), f = u > 0 ? e / (1 + e) : 1 / (1 + e);
    const double inside = (1 - f) + eps * f;
    d.value += std::log(inside);
    const Eigen::Vector3d slope = -(1 - eps) * f * (1 - f) / (width * inside) * r / std::max(distance, 1e-12);
    d.gradient += slope;
    d.information += slope * slope.transpose();
  }
  return d;
}

/// Newton steps with the expected information (Fisher scoring) on log L at one width, uphill only.
struct Climb {
  Eigen::Vector3d centre;
  Eigen::Matrix3d covariance;
  int steps = 0;
};
Climb climb(const ParticleIndex& particles, const SeedingDensity& seeding, const Eigen::Vector3d& start,
            const VoidLikelihoodOptions& options, double width, double eps) {
  const double radius = 0.5 * options.diameter, farthest = 0.5 * radius;
  const Offsets offsets = gather(particles, start, radius + farthest + 20 * width);
  Climb result{start, Eigen::Matrix3d::Identity() * width * width, 0};
  auto value = [&](const Eigen::Vector3d& x, Derivatives& d) {
    d = wallTerms(offsets, x - start, radius, width, eps);
    d.gradient += (1 - eps) * seeding.expectedGradient(x, radius);
    return d.value + (1 - eps) * seeding.expectedWithin(x, radius);
  };
  Derivatives here, there;
  double best = value(start, here);
  const double least = 1 / (radius * radius);
  for (; result.steps < 20; ++result.steps) {
    const Eigen::Matrix3d information = here.information + least * Eigen::Matrix3d::Identity();
    result.covariance = information.inverse();
    Eigen::Vector3d step = result.covariance * here.gradient;
    step *= std::min(1., 0.25 * radius / std::max(step.norm(), 1e-12));
    bool climbed = false;
    for (int halvings = 0; halvings < 6 && !climbed; ++halvings, step *= 0.5) {
      const Eigen::Vector3d x = seeding.box().clamp(result.centre + step);
      if ((x - start).norm() > farthest) continue;
      const double v = value(x, there);
      if (v <= best) continue;
      climbed = true;
      best = v;
      step = x - result.centre;
      result.centre = x;
      here = there;
      if (step.norm() < 0.005 * radius) return result;
      break;
    }
    if (!climbed) break;
  }
  return result;
}

void judge(const ParticleIndex& particles, const SeedingDensity& seeding, double diameter,
           VoidEstimate& estimate) {
  estimate.particlesInside = particles.countWithin(estimate.centre, 0.5 * diameter);
  estimate.expectedInside = seeding.cautiouslyExpectedWithin(estimate.centre, 0.5 * diameter);
  estimate.logChance =
      logChanceOfVoid(estimate.particlesInside, estimate.expectedInside) / seeding.dispersion();
}

/// The posterior of the offset from `origin` at wall widths `widths` (averaged with `prior`).
class Posterior {
public:
  Posterior(const ParticleIndex& particles, const SeedingDensity& seeding, const Eigen::Vector3d& origin,
            const Eigen::Matrix3d& covariance, double radius, double eps, std::vector<double> widths,
            std::vector<double> prior)
      : profile_(eps), origin_(origin), box_(seeding.box()), radius_(radius), eps_(eps),
        widths_(std::move(widths)), logPrior_(std::move(prior)) {
    for (double& p : logPrior_) p = std::log(p);
    const double widest = *std::max_element(widths_.begin(), widths_.end());
    reach_ = std::min(radius, 16 * std::sqrt(covariance.trace()));
    const double inner = radius - reach_ - profile_.inner() * widest;
    particles.forEachWithin(origin, radius + reach_ + WallProfile::outer() * widest,
                            [&](std::uint32_t, float dx, float dy, float dz) {
                              if (std::sqrt(dx * dx + dy * dy + dz * dz) > inner)
                                near_.add(dx, dy, dz);
                              else
                                ++inside_; // of every ball within reach: the same factor for all
                            });
    // The integral of n over the ball, to second order in the offset.
    const double step = 0.05 * radius;
    tilt_ = seeding.expectedGradient(origin, radius);
    for (int a = 0; a < 3; ++a) {
      const Eigen::Vector3d e = step * Eigen::Vector3d::Unit(a);
      bend_.col(a) =
          (seeding.expectedGradient(origin + e, radius) - seeding.expectedGradient(origin - e, radius)) /
          (2 * step);
    }
    bend_ = 0.5 * (bend_ + bend_.transpose()).eval();
  }

  /// log of prior x likelihood for one width.
  double logAt(const Eigen::Vector3d& offset, std::size_t width) const {
    return logPrior_[width] + profile_.sum(near_.x.data(), near_.y.data(), near_.z.data(), near_.size(),
                                           offset.cast<float>(), float(radius_), float(widths_[width]));
  }
  double operator()(const Eigen::VectorXd& v) const {
    const Eigen::Vector3d offset = v;
    if (offset.norm() > reach_ || !box_.contains(origin_ + offset))
      return -std::numeric_limits<double>::infinity();
    double top = -std::numeric_limits<double>::infinity(), terms[8];
    for (std::size_t j = 0; j < widths_.size(); ++j) top = std::max(top, terms[j] = logAt(offset, j));
    double sum = 0;
    for (std::size_t j = 0; j < widths_.size(); ++j) sum += std::exp(terms[j] - top);
    return top + std::log(sum) + (1 - eps_) * (tilt_.dot(offset) + 0.5 * offset.dot(bend_ * offset));
  }
  /// Posterior probability of each width, from weighted samples.
  std::vector<double> widthProbabilities(const PosteriorSamples& samples) const {
    std::vector<double> p(widths_.size(), 0);
    for (int s = 0; s < samples.points.cols(); ++s) {
      if (samples.weights[s] < 1e-4 / samples.points.cols()) continue;
      double terms[8], sum = 0, top = -std::numeric_limits<double>::infinity();
      for (std::size_t j = 0; j < widths_.size(); ++j)
        top = std::max(top, terms[j] = logAt(samples.points.col(s), j));
      for (std::size_t j = 0; j < widths_.size(); ++j) sum += terms[j] = std::exp(terms[j] - top);
      for (std::size_t j = 0; j < widths_.size(); ++j) p[j] += samples.weights[s] * terms[j] / sum;
    }
    return p;
  }
  int countInside(const Eigen::Vector3d& offset) const {
    int n = 0;
    for (int i = 0; i < near_.size(); ++i) n += (near_.at(i) - offset).squaredNorm() < radius_ * radius_;
    return n;
  }

private:
  WallProfile profile_;
  Eigen::Vector3d origin_;
  Box box_;
  double radius_, eps_, reach_ = 0;
  std::vector<double> widths_, logPrior_;
  Offsets near_;
  std::size_t inside_ = 0;
  Eigen::Vector3d tilt_ = Eigen::Vector3d::Zero();
  Eigen::Matrix3d bend_ = Eigen::Matrix3d::Zero();
};

/// The middle of the sampled places that have the fewest particles inside.
Eigen::Vector3d fewestInside(const Posterior& posterior, const PosteriorSamples& samples) {
  int fewest = std::numeric_limits<int>::max(), places = 0;
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  for (int s = 0; s < samples.points.cols(); ++s) {
    const Eigen::Vector3d offset = samples.points.col(s);
    const int n = posterior.countInside(offset);
    if (n > fewest) continue;
    if (n < fewest) {
      fewest = n;
      places = 0;
      sum.setZero();
    }
    ++places;
    sum += offset;
  }
  return places > 0 ? Eigen::Vector3d(sum / places) : Eigen::Vector3d::Zero();
}

void check(const VoidLikelihoodOptions& options) {
  if (!(options.diameter > 0))
    throw std::invalid_argument("The sphere's diameter is " + std::to_string(options.diameter) +
                                " m; set the diameter of the sphere, in metres, above 0.");
}

} // namespace

double logChanceOfVoid(std::size_t found, double expected) {
  if (expected <= 0 || double(found) >= expected) return 0;
  // The shell from R to 1.5 R holds 2.4 times what the ball would: a Poisson count whose mean is known from a
  // Poisson count of r is a negative binomial. Sum over k <= found, from the largest term down.
  const double r = std::max(1., 2.375 * expected), n = double(found), ratio = expected / (r + expected);
  const double last = std::lgamma(n + r) - std::lgamma(r) - std::lgamma(n + 1) -
                      r * std::log1p(expected / r) + n * std::log(ratio);
  double term = 1, sum = 1;
  for (double k = n; k > 0 && term > 1e-12 * sum; --k) sum += term *= k / ((k - 1 + r) * ratio);
  return std::min(0., last + std::log(sum));
}

VoidEstimate roughVoid(const ParticleIndex& particles, SeedingDensity& seeding, const Eigen::Vector3d& guess,
                       const VoidLikelihoodOptions& options) {
  check(options);
  VoidEstimate estimate;
  estimate.centre = guess;
  if (particles.size() == 0) return estimate;
  const double radius = 0.5 * options.diameter;
  estimate.centre =
      scan(particles, guess, radius, options.searchSide > 0 ? options.searchSide : options.diameter);
  for (int pass = 0; pass < 2; ++pass) { // the second with the seeding that the first made better
    seeding.exclude({sphere(estimate.centre, options.diameter)});
    estimate.ghostRate = ghostRate(particles, seeding, estimate.centre, options);
    const Climb top =
        climb(particles, seeding, estimate.centre, options, CoarseWidth * radius, estimate.ghostRate);
    const bool stays = (top.centre - estimate.centre).norm() < 0.05 * radius;
    estimate.centre = top.centre;
    estimate.covariance = top.covariance;
    estimate.iterations += top.steps;
    if (stays) break;
  }
  judge(particles, seeding, options.diameter, estimate);
  return estimate;
}

VoidEstimate locateVoid(const ParticleIndex& particles, SeedingDensity& seeding, const Eigen::Vector3d& guess,
                        const VoidLikelihoodOptions& options) {
  VoidEstimate estimate = roughVoid(particles, seeding, guess, options);
  if (particles.size() == 0) return estimate;
  const double radius = 0.5 * options.diameter;
  const double spacing = std::cbrt(1 / std::max(seeding.mean(), 1e-30));
  std::vector<double> widths, prior;
  if (options.positionNoise > 0) {
    widths = {LogisticPerNoise * options.positionNoise};
    prior = {1};
  } else
    for (std::size_t j = 0; j < std::size(NoisePrior); ++j) {
      widths.push_back(LogisticPerNoise * std::min(NoisePerSpacing[j] * spacing, 0.1 * radius));
      prior.push_back(NoisePrior[j]);
    }
  const double finest = widths[widths.size() / 2];

  Eigen::Vector3d origin = estimate.centre, excluded = Eigen::Vector3d::Constant(1e9);
  Eigen::Matrix3d covariance = estimate.covariance;
  // One width of the wall (or several, averaged): the posterior, and the estimate moved onto it.
  auto settle = [&](const std::vector<double>& w, const std::vector<double>& p,
                    const SamplingOptions& sampling) {
    if ((origin - excluded).norm() > 0.02 * radius) {
      seeding.exclude({sphere(origin, options.diameter)});
      excluded = origin;
    }
    estimate.ghostRate = ghostRate(particles, seeding, origin, options);
    const Posterior posterior(particles, seeding, origin, covariance, radius, estimate.ghostRate, w, p);
    const PosteriorSamples samples =
        samplePosterior(std::cref(posterior), Eigen::Vector3d::Zero(), covariance, sampling);
    estimate.voidMinimiser = origin + fewestInside(posterior, samples);
    const std::vector<double> probability = posterior.widthProbabilities(samples);
    estimate.positionNoise = 0;
    for (std::size_t j = 0; j < w.size(); ++j)
      estimate.positionNoise += probability[j] * w[j] / LogisticPerNoise;
    origin += samples.mean;
    covariance = samples.covariance;
    estimate.iterations += samples.rounds;
    estimate.effectiveSamples = samples.effectiveSamples;
  };
  SamplingOptions coarse;
  coarse.samples = std::min(512, options.samples);
  coarse.effectiveShare = 0.1;
  for (double w = CoarseWidth * radius * WidthRatio; w > 1.5 * finest; w *= WidthRatio)
    settle({w}, {1}, coarse);
  SamplingOptions fine;
  fine.samples = options.samples;
  settle(widths, prior, fine);

  estimate.centre = origin;
  estimate.covariance = covariance;
  const Derivatives d = wallTerms(gather(particles, origin, radius + 30 * finest), Eigen::Vector3d::Zero(),
                                  radius, finest, estimate.ghostRate);
  estimate.cost = -d.value;
  estimate.gradientNorm =
      (d.gradient + (1 - estimate.ghostRate) * seeding.expectedGradient(origin, radius)).norm();
  judge(particles, seeding, options.diameter, estimate);
  return estimate;
}

} // namespace rimflow
