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
constexpr double Overlap = 0.05;     // of R, that two spheres may seem to overlap
constexpr double NoisePerSpacing[] = {1 / 600., 1 / 300., 1 / 150., 1 / 75., 1 / 37.};
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

/// Share of a ball that lies in the box and in none of the other spheres.
double shareOfFluid(const Box& box, const std::vector<Body>& others, const Eigen::Vector3d& centre,
                    double radius) {
  const auto inOther = [&others](const Eigen::Vector3d& x) {
    return std::any_of(others.begin(), others.end(), [&x](const Body& other) { return other.contains(x); });
  };
  const bool alone = std::none_of(others.begin(), others.end(),
                                  [&](const Body& other) { return other.signedDistance(centre) < radius; });
  if (alone && ((centre.array() - radius) >= box.lower.array()).all() &&
      ((centre.array() + radius) <= box.upper.array()).all())
    return 1;
  int inside = 0, all = 0;
  for (double r : {0.46416, 0.79370, 0.94104}) // radii that halve thirds of the volume: 0.1, 0.5, 0.8333
    for (std::size_t d = 0; d < evenDirections().size(); d += 4, ++all) {
      const Eigen::Vector3d x = centre + r * radius * evenDirections()[d];
      inside += box.contains(x) && (alone || !inOther(x));
    }
  return double(inside) / all;
}

/// The nearest place in the box where the ball overlaps no other sphere, by turns; not always there.
Eigen::Vector3d moveClear(const Box& box, const std::vector<Body>& others, Eigen::Vector3d x, double radius) {
  x = box.clamp(x);
  for (int turn = 0; turn < 10 && !clearOf(others, x, radius); ++turn) {
    for (const Body& other : others) {
      const double missing = (1 - 0.9 * Overlap) * radius - other.signedDistance(x);
      if (missing <= 0) continue;
      Eigen::Vector3d away = x - other.centre;
      if (away.norm() < 1e-6 * radius) away = 0.5 * (box.lower + box.upper) - other.centre;
      if (away.norm() < 1e-6 * radius) away = Eigen::Vector3d::UnitX();
      x += missing * away.normalized();
    }
    x = box.clamp(x);
  }
  return x;
}

/// Deviance of finding k where n are expected; 0 when there are more.
double deficit(double k, double n) { return k >= n ? 0 : n - k + (k > 0 ? k * std::log(k / n) : 0); }

/// Where in the search cube a ball misses most particles against the shell around it.
Eigen::Vector3d scan(const ParticleIndex& particles, const std::vector<Body>& others,
                     const Eigen::Vector3d& guess, double radius, double side) {
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
    if (!box.contains(at) || !clearOf(others, at, radius)) continue;
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
    const double share = shareOfFluid(box, {}, at, radius), wide = shareOfFluid(box, others, at, outer);
    const double clear = others.empty() ? share : shareOfFluid(box, others, at, inner);
    const double shellVolume = wide * ballVolume(outer) - clear * ballVolume(inner);
    const double density = shellVolume > 0 ? shell / shellVolume : 0;
    score[node] = deficit(within, density * share * ballVolume(radius));
  }
  const int best = int(std::max_element(score.begin(), score.end()) - score.begin());
  if (score[best] < 0) return moveClear(box, others, guess, radius);
  return guess +
         step * Eigen::Vector3d(best % edge - half, best / edge % edge - half, best / edge / edge - half);
}

/// Takes the ball sought and the other spheres out of the fluid.
void excludeBall(SeedingDensity& seeding, const Eigen::Vector3d& centre, double diameter,
                 const std::vector<Body>& others) {
  std::vector<Body> bodies = others;
  bodies.emplace_back();
  bodies.back().diameter = diameter;
  bodies.back().centre = centre;
  seeding.exclude(bodies);
}

/// eps from the particles deep inside, drawn towards its prior.
double ghostRate(const ParticleIndex& particles, const SeedingDensity& seeding, const Eigen::Vector3d& centre,
                 double radius, const VoidLikelihoodOptions& options) {
  if (options.ghostRate >= 0) return std::min(std::max(options.ghostRate, 1e-6), 0.9);
  const double deep = 0.9 * radius; // clear of the wall
  const double found = double(particles.countWithin(centre, deep)),
               fluid = seeding.expectedWithin(centre, deep);
  return std::min((found + PriorGhosts * GhostBacking) / (fluid + GhostBacking), 0.9);
}

/// By the centre and the radius.
struct Derivatives {
  double value = 0;
  Eigen::Vector4d gradient = Eigen::Vector4d::Zero();
  Eigen::Matrix4d information =
      Eigen::Matrix4d::Zero(); // sum of the squared gradients of the particles' terms
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
    Eigen::Vector4d slope;
    slope << r / std::max(distance, 1e-12), 1;
    slope *= -(1 - eps) * f * (1 - f) / (width * inside);
    d.gradient += slope;
    d.information += slope * slope.transpose();
  }
  return d;
}

/// Newton steps with the expected information (Fisher scoring) on log L at one width, uphill only. The radius
/// moves only if it is not known exactly.
struct Climb {
  Eigen::Vector3d centre;
  double radius;
  Eigen::Matrix4d covariance; // of centre and radius
  int steps = 0;
};
Climb climb(const ParticleIndex& particles, const SeedingDensity& seeding, const Climb& start,
            const VoidLikelihoodOptions& options, double width, double eps) {
  const double farthest = 0.5 * start.radius, known = 0.5 * options.diameter;
  const double sigma = 0.5 * options.diameterSigma;
  const Offsets offsets = gather(particles, start.centre, start.radius + 1.5 * farthest + 20 * width);
  Climb result = start;
  result.steps = 0;
  auto value = [&](const Climb& at, Derivatives& d) {
    d = wallTerms(offsets, at.centre - start.centre, at.radius, width, eps);
    d.gradient.head<3>() += (1 - eps) * seeding.expectedGradient(at.centre, at.radius);
    double prior = 0;
    if (sigma > 0) {
      d.gradient[3] +=
          (1 - eps) * seeding.expectedPerRadius(at.centre, at.radius) - (at.radius - known) / (sigma * sigma);
      prior = -0.5 * std::pow((at.radius - known) / sigma, 2);
    }
    return d.value + (1 - eps) * seeding.expectedWithin(at.centre, at.radius) + prior;
  };
  Derivatives here, there;
  double best = value(result, here);
  const double least = 1 / (known * known);
  for (; result.steps < 20; ++result.steps) {
    Eigen::Matrix4d information = here.information + least * Eigen::Matrix4d::Identity();
    if (sigma > 0)
      information(3, 3) += 1 / (sigma * sigma);
    else { // known exactly
      information.col(3).setZero();
      information.row(3).setZero();
      information(3, 3) = 1;
      here.gradient[3] = 0;
    }
    result.covariance = information.inverse();
    Eigen::Vector4d step = result.covariance * here.gradient;
    step *= std::min(1., 0.25 * known / std::max(step.norm(), 1e-12));
    bool climbed = false;
    for (int halvings = 0; halvings < 6 && !climbed; ++halvings, step *= 0.5) {
      Climb next = result;
      next.radius += step[3];
      next.centre = moveClear(seeding.box(), options.others, result.centre + step.head<3>(), next.radius);
      if ((next.centre - start.centre).norm() > farthest ||
          std::abs(next.radius - start.radius) > 0.5 * farthest ||
          !clearOf(options.others, next.centre, next.radius))
        continue;
      const double v = value(next, there);
      if (v <= best) continue;
      climbed = true;
      best = v;
      const double moved = (next.centre - result.centre).norm() + std::abs(next.radius - result.radius);
      result = next;
      here = there;
      if (moved < 0.005 * known) return result;
      break;
    }
    if (!climbed) break;
  }
  return result;
}

void judge(const ParticleIndex& particles, const SeedingDensity& seeding, VoidEstimate& estimate) {
  const double diameter = estimate.diameter;
  estimate.particlesInside = particles.countWithin(estimate.centre, 0.5 * diameter);
  estimate.expectedInside = seeding.cautiouslyExpectedWithin(estimate.centre, 0.5 * diameter);
  estimate.logChance =
      logChanceOfVoid(estimate.particlesInside, estimate.expectedInside) / seeding.dispersion();
}

/// The integral of n over balls near one, to second order: n(x) hardly bends over the posterior's width.
class NearbyIntegral {
public:
  NearbyIntegral(const SeedingDensity& seeding, const Eigen::Vector3d& origin, double radius, bool grows)
      : radius_(radius) {
    const double step = 0.05 * radius;
    tilt_ = seeding.expectedGradient(origin, radius);
    for (int a = 0; a < 3; ++a) {
      const Eigen::Vector3d e = step * Eigen::Vector3d::Unit(a);
      bend_.col(a) =
          (seeding.expectedGradient(origin + e, radius) - seeding.expectedGradient(origin - e, radius)) /
          (2 * step);
    }
    bend_ = 0.5 * (bend_ + bend_.transpose()).eval();
    if (!grows) return;
    // The surface integral of n over 4 pi r2, the mean density on the wall, is taken as linear in r.
    const auto onWall = [&](double r) { return seeding.expectedPerRadius(origin, r) / (4 * Pi * r * r); };
    wall_ = onWall(radius);
    wallSlope_ = (onWall(radius + step) - onWall(radius - step)) / (2 * step);
    tiltSlope_ =
        (seeding.expectedGradient(origin, radius + step) - seeding.expectedGradient(origin, radius - step)) /
        (2 * step);
  }
  /// Against the ball at the origin.
  double operator()(const Eigen::Vector3d& offset, double growth) const {
    double integral = tilt_.dot(offset) + 0.5 * offset.dot(bend_ * offset);
    if (growth != 0) {
      const double r = radius_ + growth;
      const double shell = ballVolume(r) - ballVolume(radius_);
      const double moment = Pi * (std::pow(r, 4) - std::pow(radius_, 4)) - radius_ * shell;
      integral += wall_ * shell + wallSlope_ * moment + growth * tiltSlope_.dot(offset);
    }
    return integral;
  }

private:
  static constexpr double Pi = 3.14159265358979323846;
  double radius_, wall_ = 0, wallSlope_ = 0;
  Eigen::Vector3d tilt_, tiltSlope_ = Eigen::Vector3d::Zero();
  Eigen::Matrix3d bend_;
};

/// The posterior of the offset from a ball (centre and, if it is not known exactly, radius) at wall widths
/// `widths` (averaged with `prior`).
class Posterior {
public:
  Posterior(const ParticleIndex& particles, const SeedingDensity& seeding, const Climb& ball, double eps,
            const VoidLikelihoodOptions& options, std::vector<double> widths, std::vector<double> prior)
      : profile_(eps), integral_(seeding, ball.centre, ball.radius, options.diameterSigma > 0),
        options_(options), origin_(ball.centre), box_(seeding.box()), radius_(ball.radius), eps_(eps),
        widths_(std::move(widths)), logPrior_(std::move(prior)) {
    for (double& p : logPrior_) p = std::log(p);
    const double widest = *std::max_element(widths_.begin(), widths_.end());
    reach_ = std::min(radius_, 16 * std::sqrt(ball.covariance.topLeftCorner<3, 3>().trace()));
    if (options.diameterSigma > 0) growth_ = std::min(0.25 * radius_, 16 * std::sqrt(ball.covariance(3, 3)));
    const double inner = radius_ - growth_ - reach_ - profile_.inner() * widest;
    // Particles deep inside every ball within reach give the same factor for all.
    particles.forEachWithin(origin_, radius_ + growth_ + reach_ + WallProfile::outer() * widest,
                            [&](std::uint32_t, float dx, float dy, float dz) {
                              if (std::sqrt(dx * dx + dy * dy + dz * dz) > inner) near_.add(dx, dy, dz);
                            });
  }

  /// log of prior x likelihood for one width, less the integral of n. v: offset and, if sought, growth of the
  /// radius.
  double logAt(const Eigen::VectorXd& v, std::size_t width) const {
    return logPrior_[width] + profile_.sum(near_.x.data(), near_.y.data(), near_.z.data(), near_.size(),
                                           v.head<3>().cast<float>(), float(radius_ + growth(v)),
                                           float(widths_[width]));
  }
  double operator()(const Eigen::VectorXd& v) const {
    const Eigen::Vector3d offset = v.head<3>();
    const double grown = growth(v);
    if (offset.norm() > reach_ || std::abs(grown) > growth_ || !box_.contains(origin_ + offset) ||
        !clearOf(options_.others, origin_ + offset, radius_ + grown))
      return -std::numeric_limits<double>::infinity();
    double top = -std::numeric_limits<double>::infinity(), terms[8];
    for (std::size_t j = 0; j < widths_.size(); ++j) top = std::max(top, terms[j] = logAt(v, j));
    double sum = 0;
    for (std::size_t j = 0; j < widths_.size(); ++j) sum += std::exp(terms[j] - top);
    double log = top + std::log(sum) + (1 - eps_) * integral_(offset, grown);
    if (options_.diameterSigma > 0)
      log -= 0.5 * std::pow((2 * (radius_ + grown) - options_.diameter) / options_.diameterSigma, 2);
    return log;
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
  static double growth(const Eigen::VectorXd& v) { return v.size() > 3 ? v[3] : 0; }

  WallProfile profile_;
  NearbyIntegral integral_;
  const VoidLikelihoodOptions& options_;
  Eigen::Vector3d origin_;
  Box box_;
  double radius_, eps_, reach_ = 0, growth_ = 0;
  std::vector<double> widths_, logPrior_;
  Offsets near_;
};

/// The middle of the sampled places that have the fewest particles inside.
Eigen::Vector3d fewestInside(const Posterior& posterior, const PosteriorSamples& samples) {
  int fewest = std::numeric_limits<int>::max(), places = 0;
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  for (int s = 0; s < samples.points.cols(); ++s) {
    const Eigen::Vector3d offset = samples.points.col(s).head<3>();
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

/// Newton steps from the emptiest place of the search cube.
Climb rough(const ParticleIndex& particles, SeedingDensity& seeding, const Eigen::Vector3d& guess,
            const VoidLikelihoodOptions& options, VoidEstimate& estimate) {
  const double radius = 0.5 * options.diameter;
  Climb ball{scan(particles, options.others, guess, radius,
                  options.searchSide > 0 ? options.searchSide : options.diameter),
             radius, Eigen::Matrix4d::Identity() * std::pow(CoarseWidth * radius, 2)};
  // More than once, each time with the seeding that the last one made better.
  const int passes = options.diameterSigma > 0 ? 4 : 2;
  for (int pass = 0; pass < passes; ++pass) {
    excludeBall(seeding, ball.centre, 2 * ball.radius, options.others);
    estimate.ghostRate = ghostRate(particles, seeding, ball.centre, ball.radius, options);
    const Climb top = climb(particles, seeding, ball, options, CoarseWidth * radius, estimate.ghostRate);
    const double moved = (top.centre - ball.centre).norm() + 3 * std::abs(top.radius - ball.radius);
    ball = top;
    estimate.iterations += top.steps;
    if (moved < 0.05 * radius) break;
  }
  estimate.centre = ball.centre;
  estimate.covariance = ball.covariance.topLeftCorner<3, 3>();
  estimate.diameter = 2 * ball.radius;
  estimate.diameterSigma = options.diameterSigma > 0 ? 2 * std::sqrt(ball.covariance(3, 3)) : 0;
  return ball;
}

void check(const VoidLikelihoodOptions& options) {
  if (!(options.diameter > 0))
    throw std::invalid_argument("The sphere's diameter is " + std::to_string(options.diameter) +
                                " m; set the diameter of the sphere, in metres, above 0.");
  if (!(options.diameterSigma >= 0))
    throw std::invalid_argument("The diameter's standard deviation is " +
                                std::to_string(options.diameterSigma) + " m; set it to 0 or above.");
}

} // namespace

bool clearOf(const std::vector<Body>& others, const Eigen::Vector3d& centre, double radius) {
  return std::all_of(others.begin(), others.end(), [&](const Body& other) {
    return other.signedDistance(centre) >= (1 - Overlap) * radius;
  });
}

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
  estimate.diameter = options.diameter;
  if (particles.size() == 0) return estimate;
  rough(particles, seeding, guess, options, estimate);
  judge(particles, seeding, estimate);
  return estimate;
}

VoidEstimate locateVoid(const ParticleIndex& particles, SeedingDensity& seeding, const Eigen::Vector3d& guess,
                        const VoidLikelihoodOptions& options, const Progress& progress) {
  check(options);
  VoidEstimate estimate;
  estimate.centre = guess;
  estimate.diameter = options.diameter;
  if (particles.size() == 0) return estimate;
  const double radius = 0.5 * options.diameter;
  Climb ball = rough(particles, seeding, guess, options, estimate);
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

  const int unknowns = options.diameterSigma > 0 ? 4 : 3;
  Climb excluded = ball;
  excluded.centre.setConstant(1e9);
  // One width of the wall (or several, averaged): the posterior, and the estimate moved onto it.
  auto settle = [&](const std::vector<double>& w, const std::vector<double>& p,
                    const SamplingOptions& sampling) {
    if ((ball.centre - excluded.centre).norm() + 3 * std::abs(ball.radius - excluded.radius) >
        0.02 * radius) {
      excludeBall(seeding, ball.centre, 2 * ball.radius, options.others);
      excluded = ball;
    }
    estimate.ghostRate = ghostRate(particles, seeding, ball.centre, ball.radius, options);
    const Posterior posterior(particles, seeding, ball, estimate.ghostRate, options, w, p);
    const PosteriorSamples samples =
        samplePosterior(std::cref(posterior), Eigen::VectorXd::Zero(unknowns),
                        ball.covariance.topLeftCorner(unknowns, unknowns), sampling);
    estimate.voidMinimiser = ball.centre + fewestInside(posterior, samples);
    const std::vector<double> probability = posterior.widthProbabilities(samples);
    estimate.positionNoise = 0;
    for (std::size_t j = 0; j < w.size(); ++j)
      estimate.positionNoise += probability[j] * w[j] / LogisticPerNoise;
    ball.centre += samples.mean.head<3>();
    if (unknowns > 3) ball.radius += samples.mean[3];
    ball.covariance.topLeftCorner(unknowns, unknowns) = samples.covariance;
    estimate.iterations += samples.rounds;
    estimate.effectiveSamples = samples.effectiveSamples;
  };
  SamplingOptions coarse;
  coarse.samples = std::min(512, options.samples);
  coarse.effectiveShare = 0.1;
  const double coarsest = CoarseWidth * radius * WidthRatio;
  for (double w = coarsest; w > 1.5 * finest; w *= WidthRatio) {
    if (!goOn(progress, 0.2 + 0.6 * std::log(w / coarsest) / std::log(finest / coarsest))) return estimate;
    settle({w}, {1}, coarse);
  }
  if (!goOn(progress, 0.8)) return estimate;
  SamplingOptions fine;
  fine.samples = options.samples;
  settle(widths, prior, fine);

  estimate.centre = ball.centre;
  estimate.covariance = ball.covariance.topLeftCorner<3, 3>();
  estimate.diameter = 2 * ball.radius;
  estimate.diameterSigma = unknowns > 3 ? 2 * std::sqrt(ball.covariance(3, 3)) : 0;
  const Derivatives d = wallTerms(gather(particles, ball.centre, ball.radius + 30 * finest),
                                  Eigen::Vector3d::Zero(), ball.radius, finest, estimate.ghostRate);
  estimate.cost = -d.value;
  estimate.gradientNorm =
      (d.gradient.head<3>() + (1 - estimate.ghostRate) * seeding.expectedGradient(ball.centre, ball.radius))
          .norm();
  judge(particles, seeding, estimate);
  return estimate;
}

} // namespace rimflow
