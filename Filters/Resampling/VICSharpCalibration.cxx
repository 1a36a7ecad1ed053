#include "VICSharpProblem.h"
#include "VICSharpReconstruction.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>
#include <utility>

namespace rimflow {
namespace {

using Model = VICSharpModel<float>;

constexpr double CalibrationNodes = 6e4; // about 7000 particles
constexpr std::size_t CalibrationParticles = 100;
constexpr double AboutAsGood = 1.015; // of a mean square

double square(double v) { return v * v; }

double faceDistance(const Grid& g, const double* x) {
  double least = 1e300;
  for (int a = 0; a < 3; ++a)
    least = std::min({least, x[a] - g.origin[a], g.origin[a] + (g.n[a] - 1) * g.spacing[a] - x[a]});
  return least;
}

/// Every m-th particle in the order of cells of about 4 particle spacings, so that those held out are spread
/// as evenly as the particles and the choice depends on no random number.
std::vector<std::size_t> heldOutParticles(const VICSharpData& data, const Grid& grid, double r, double part) {
  const std::size_t n = data.particles();
  part = std::max(part, std::min(0.2, 100. / double(n))); // a hundred to judge by, if there are enough
  const int step = int(1 / part + 0.5);
  std::vector<std::array<int, 3>> cell(n);
  for (std::size_t p = 0; p < n; ++p)
    for (int a = 0; a < 3; ++a)
      cell[p][2 - a] = int(std::floor((data.position[3 * p + a] - grid.origin[a]) / (4 * r)));
  std::vector<std::size_t> order(n), out;
  std::iota(order.begin(), order.end(), std::size_t(0));
  std::stable_sort(order.begin(), order.end(),
                   [&](std::size_t a, std::size_t b) { return cell[a] < cell[b]; });
  for (std::size_t e = step / 2; e < n; e += step) out.push_back(order[e]);
  return out;
}

double median(std::vector<double> values) {
  if (values.empty()) return 0;
  const auto middle = values.begin() + values.size() / 2;
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

std::vector<double> pick(const std::vector<double>& values, const std::vector<std::size_t>& which) {
  std::vector<double> out;
  for (std::size_t p : which) out.push_back(values[p]);
  return out;
}

/// rms per component from squared lengths
double rmsComponent(const std::vector<double>& squares) {
  return squares.empty()
             ? 0
             : std::sqrt(std::accumulate(squares.begin(), squares.end(), 0.) / (3. * double(squares.size())));
}

/// Finds bc and the noise on one grid, with some particles held out.
class Calibrator {
public:
  Calibrator(VICSharpData data, std::vector<std::size_t> heldOut, const VICSharpConstants& constants,
             const VICSharpOptions& options)
      : valid_(data.accelerationWeight), data_(withoutWeight(std::move(data), heldOut)),
        heldOut_(std::move(heldOut)), constants_(constants), options_(options),
        reconstruction_(data_, constants, options) {
    for (std::size_t p = 0; p < data_.particles(); ++p)
      if (data_.velocityWeight[p] > 0) used_.push_back(p);
  }

  /// Tries bc = first/2, first/4 ... and, unless that helps, 2 first, 4 first ..., all for the same number of
  /// iterations from the same solution. bc is the largest that predicts the particles held out, off the
  /// faces, about as well as the best.
  VICSharpCalibration run(const Grid& grid, const Grid& coarse, const Progress& progress) {
    const double first = constants_.curvatureWeight;
    for (std::size_t p : heldOut_)
      if (faceDistance(grid, &data_.position[3 * p]) > 1.5 * constants_.particleSpacing) judges_.push_back(p);
    if (judges_.size() < 20) judges_ = heldOut_;
    reconstruction_.moveTo(coarse, nullptr);
    reconstruction_.minimise(60, part(progress, 0, 0.1));
    Model::State start = reconstruction_.model().state();
    if (reconstruction_.aborted()) return best_;
    reconstruction_.moveTo(grid, &start);
    reconstruction_.minimise(options_.curvatureWeight > 0 ? 60 : 40, part(progress, 0.1, 0.4));
    best_ = measure(first);
    if (options_.curvatureWeight > 0 || reconstruction_.aborted()) return best_;
    weighAccelerations(options_, best_.velocityNoise, best_.accelerationNoise, constants_);
    reconstruction_.weighAccelerations(constants_.accelerationWeight);
    reconstruction_.useNoise(best_.velocityNoise, best_.accelerationNoise, options_.tolerance);
    reconstruction_.suppressOutliers(best_.velocityNoise, best_.accelerationNoise);
    noise_ = best_;
    start = reconstruction_.model().state();

    constexpr int Most = 8;
    std::vector<std::pair<double, double>> trials; // log bc, score
    double lowest = 1e300;
    const auto tryWeight = [&](double weight) {
      reconstruction_.restart(weight, start);
      const double from = 0.4 + 0.6 * double(trials.size()) / Most;
      reconstruction_.minimise(25, part(progress, from, from + 0.6 / Most));
      const double value = score();
      trials.emplace_back(std::log(weight), value);
      if (!(value < lowest)) return false;
      lowest = value;
      best_ = measure(weight);
      return true;
    };
    tryWeight(first);
    for (double factor : {0.5, 2.}) {
      int worse = 0;
      for (double w = factor * first; worse < 2 && w > 1.4e-3 && w < 0.5 && !reconstruction_.aborted();
           w *= factor)
        worse = tryWeight(w) ? 0 : worse + 1;
      if (trials.size() > 3) break; // it was better further down: no need to look up
    }
    best_.curvatureWeight = std::exp(smoothest(trials, lowest));
    return best_;
  }
  bool aborted() const { return reconstruction_.aborted(); }

private:
  static VICSharpData withoutWeight(VICSharpData data, const std::vector<std::size_t>& particles) {
    if (data.velocityWeight.empty()) data.velocityWeight.assign(data.size(), 1);
    for (std::size_t p : particles) {
      data.velocityWeight[p] = 0;
      if (!data.acceleration.empty()) data.accelerationWeight[p] = 0;
    }
    return data;
  }

  /// The largest log bc whose score is about as low as the lowest: between the last trial that is and the
  /// next one, where a parabola with its vertex at the former says so.
  static double smoothest(std::vector<std::pair<double, double>> trials, double lowest) {
    std::sort(trials.begin(), trials.end());
    std::size_t last = 0;
    for (std::size_t t = 0; t < trials.size(); ++t)
      if (trials[t].second <= AboutAsGood * lowest) last = t;
    if (last + 1 == trials.size()) return trials[last].first;
    const double room = AboutAsGood * lowest - trials[last].second,
                 rise = trials[last + 1].second - trials[last].second;
    return trials[last].first + std::sqrt(room / rise) * (trials[last + 1].first - trials[last].first);
  }

  VICSharpCalibration measure(double weight) const {
    const auto estimate = [&](const std::vector<double>& used, const std::vector<double>& heldOut) {
      // median of |m|^2 = 2.366 s^2 for three Gaussian components
      return std::sqrt(std::sqrt(median(used) * median(heldOut)) / 2.366);
    };
    const Model& model = reconstruction_.model();
    const std::vector<double>&u = model.velocityMisfits(), &a = model.accelerationMisfits();
    VICSharpCalibration c;
    c.curvatureWeight = weight;
    c.velocityNoise = options_.velocityNoise > 0 ? options_.velocityNoise
                                                 : std::max(estimate(pick(u, used_), pick(u, heldOut_)),
                                                            options_.leastVelocityNoise);
    c.velocityHeldOut = rmsComponent(pick(u, heldOut_));
    if (!model.hasAccelerationData()) return c;
    const std::vector<double> heldOut = pick(a, accelerated(heldOut_));
    c.accelerationNoise =
        options_.accelerationNoise > 0
            ? options_.accelerationNoise
            : std::max(estimate(pick(a, accelerated(used_)), heldOut), options_.leastAccelerationNoise);
    c.accelerationHeldOut = rmsComponent(heldOut);
    return c;
  }

  /// Those of the particles that have an acceleration.
  std::vector<std::size_t> accelerated(const std::vector<std::size_t>& particles) const {
    std::vector<std::size_t> out;
    for (std::size_t p : particles)
      if (valid_[p] > 0) out.push_back(p);
    return out;
  }

  /// Mean of the data terms of J over the particles held out.
  double score() const {
    const Model& model = reconstruction_.model();
    const double su2 = square(constants_.velocityScale),
                 sa2 = square(constants_.accelerationScale / constants_.accelerationWeight);
    double sum = 0;
    for (std::size_t p : judges_) {
      sum += Huber(model.velocityMisfits()[p], options_.outliers * noise_.velocityNoise).value / su2;
      if (model.hasAccelerationData() && valid_[p] > 0)
        sum +=
            Huber(model.accelerationMisfits()[p], options_.outliers * noise_.accelerationNoise).value / sa2;
    }
    return sum / double(judges_.size());
  }

  std::vector<double> valid_; ///< 1 for particles with an acceleration
  VICSharpData data_;
  std::vector<std::size_t> heldOut_, used_;
  std::vector<std::size_t> judges_; ///< those held out that are not near the faces
  VICSharpConstants constants_;
  const VICSharpOptions& options_;
  VICSharpReconstruction reconstruction_;
  VICSharpCalibration best_, noise_;
};

/// The part of the data within a grid.
VICSharpData dataWithin(const VICSharpData& data, const Grid& grid) {
  VICSharpData out;
  out.meanVelocity = data.meanVelocity;
  for (std::size_t p = 0; p < data.size(); ++p) {
    const double* x = &data.position[3 * p];
    if (!within(grid, x)) continue;
    out.position.insert(out.position.end(), x, x + 3);
    out.velocity.insert(out.velocity.end(), &data.velocity[3 * p], &data.velocity[3 * p] + 3);
    out.wallPoints += p >= data.particles();
    if (!data.velocityWeight.empty()) out.velocityWeight.push_back(data.velocityWeight[p]);
    if (data.acceleration.empty()) continue;
    out.acceleration.insert(out.acceleration.end(), &data.acceleration[3 * p], &data.acceleration[3 * p] + 3);
    out.accelerationWeight.push_back(data.accelerationWeight[p]);
  }
  return out;
}

/// The whole grid if it has few nodes, else the liveliest of many parts of it with about that many: the
/// same shape, with the largest sum of squared velocity fluctuations.
Grid calibrationGrid(const Grid& grid, const VICSharpData& data, double nodes) {
  const double scale = std::cbrt(nodes / double(grid.size()));
  if (scale >= 1) return grid;
  Grid part = grid;
  constexpr int Places = 7; // per axis
  int step[3];
  for (int a = 0; a < 3; ++a) {
    part.n[a] = std::max(std::min(grid.n[a], 8), int(scale * grid.n[a]));
    step[a] = grid.n[a] - part.n[a];
  }
  const auto at = [&](int place) {
    Grid g = part;
    for (int a = 0; a < 3; ++a, place /= Places)
      g.origin[a] += place % Places * step[a] / (Places - 1) * grid.spacing[a];
    return g;
  };
  double most = -1;
  Grid best = part;
  for (int place = 0; place < Places * Places * Places; ++place) {
    const Grid g = at(place);
    double energy = 0;
    for (std::size_t p = 0; p < data.particles(); ++p)
      if (within(g, &data.position[3 * p]))
        energy += square(data.velocity[3 * p]) + square(data.velocity[3 * p + 1]) +
                  square(data.velocity[3 * p + 2]);
    if (energy > most) most = energy, best = g;
  }
  return best;
}

} // namespace

std::optional<VICSharpCalibration> calibrateVICSharp(const VICSharpProblem& p, const VICSharpOptions& options,
                                                     const Progress& progress) {
  const bool known = options.curvatureWeight > 0 && options.velocityNoise > 0 &&
                     (options.accelerationNoise > 0 || p.data.acceleration.empty());
  if (known)
    return VICSharpCalibration{options.curvatureWeight, options.velocityNoise, options.accelerationNoise};
  const Grid whole = coarseGrid(
      p.grid, std::max(1., 0.5 * p.spacing / p.grid.spacing[0])); // about half the particle spacing
  if (!goOn(progress, 0)) return {};
  Grid grid = calibrationGrid(whole, p.data, CalibrationNodes);
  if (!goOn(progress, 0)) return {};
  VICSharpData data = dataWithin(p.data, grid);
  if (data.particles() < CalibrationParticles) grid = whole, data = dataWithin(p.data, grid);
  const auto heldOut = heldOutParticles(data, grid, p.spacing, options.heldOut);
  Calibrator calibrator(std::move(data), heldOut, p.constants, options);
  const VICSharpCalibration found = calibrator.run(grid, coarseGrid(grid, 2), progress);
  if (calibrator.aborted()) return {};
  return found;
}

std::optional<VICSharpCalibration>
calibrateVICSharp(const VICSharpTracks& tracks, const VICSharpOptions& options, const Progress& progress) {
  const VICSharpProblem problem = vicSharpProblem(tracks, options, part(progress, 0, 0.1));
  if (problem.aborted) return {};
  return calibrateVICSharp(problem, options, part(progress, 0.1, 1));
}

} // namespace rimflow
