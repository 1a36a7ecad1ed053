#include "VICSharp.h"

#include "LBFGS.h"
#include "MedianTest.h"
#include "VoidDistance.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <numeric>
#include <stdexcept>

namespace rimflow {
namespace {

// Float: half the memory and time of double, and far below the noise of any measurement.
using Model = VICSharpModel<float>;

constexpr std::size_t MinimumParticles = 20;
constexpr double CoarseTolerance = 10; // times that of the finest grid
// In mean particle spacings. A random cloud leaves a given ball of this size empty with probability 2e-11.
constexpr double VoidRadius = 1.8;
constexpr double CalibrationNodes = 6e4; // about 7000 particles

void check(const VICSharpTracks& t, const VICSharpOptions& o) {
  if (t.count == 0 || !t.positions || !t.velocities) throw std::invalid_argument("there are no particles");
  for (int a = 0; a < 3; ++a)
    if (o.grid.n[a] < 5 || !(o.grid.spacing[a] > 0))
      throw std::invalid_argument(
          "the grid needs at least 5 nodes along every axis and a spacing greater than 0");
  if (std::abs(o.grid.spacing[0] / o.grid.spacing[1] - 1) > 1e-6 ||
      std::abs(o.grid.spacing[0] / o.grid.spacing[2] - 1) > 1e-6)
    throw std::invalid_argument("the grid must have the same spacing along all axes");
  const bool valid = o.viscosity >= 0 && o.velocityNoise >= 0 && o.accelerationNoise >= 0 &&
                     o.maximumIterations >= 1 && o.tolerance > 0 && o.padding >= 0 && o.heldOut > 0 &&
                     o.heldOut < 0.5 && o.accelerationWeight >= 0 && o.curvatureWeight >= 0 && o.outliers >= 0;
  if (!valid)
    throw std::invalid_argument("an option is negative, not a number or out of its range: viscosity, noise "
                                "levels, weights and padding must be at least 0, and at least one iteration "
                                "must be allowed");
}

double square(double v) { return v * v; }

bool within(const Grid& g, const double* x) {
  for (int a = 0; a < 3; ++a)
    if (!(x[a] >= g.origin[a] && x[a] <= g.origin[a] + (g.n[a] - 1) * g.spacing[a])) return false;
  return true;
}

/// The grid with `nodes` more nodes on every side.
Grid padded(const Grid& g, int nodes) {
  Grid p = g;
  for (int a = 0; a < 3; ++a) {
    p.n[a] += 2 * nodes;
    p.origin[a] -= nodes * g.spacing[a];
  }
  return p;
}

/// A grid over the same box (or a little more) with spacings `factor` times larger.
Grid coarseGrid(const Grid& fine, double factor) {
  Grid grid = fine;
  for (int a = 0; a < 3; ++a) {
    const double length = (fine.n[a] - 1) * fine.spacing[a];
    grid.spacing[a] = fine.spacing[a] * factor;
    grid.n[a] = std::max(5, int(std::ceil(length / grid.spacing[a] - 1e-6)) + 1);
    grid.origin[a] = fine.origin[a] - 0.5 * ((grid.n[a] - 1) * grid.spacing[a] - length);
  }
  return grid;
}

/// Usable particles within the box of `grid`, with velocities as they are; without those marked as outliers,
/// which are counted.
VICSharpData usable(const VICSharpTracks& t, const Grid& grid, const std::optional<Body>& body,
                    const std::vector<unsigned char>& outlier, std::size_t& outliers) {
  VICSharpData data;
  outliers = 0;
  for (std::size_t p = 0; p < t.count; ++p) {
    const double x[3] = {t.positions[3 * p], t.positions[3 * p + 1], t.positions[3 * p + 2]};
    const float* u = t.velocities + 3 * p;
    if (!within(grid, x) || !std::isfinite(u[0]) || !std::isfinite(u[1]) || !std::isfinite(u[2])) continue;
    if (body && body->contains(Eigen::Vector3d(x[0], x[1], x[2]))) continue;
    if (!outlier.empty() && outlier[p]) {
      ++outliers;
      continue;
    }
    data.position.insert(data.position.end(), x, x + 3);
    data.velocity.insert(data.velocity.end(), u, u + 3);
    if (!t.accelerations) continue;
    const float* a = t.accelerations + 3 * p;
    const bool finite = std::isfinite(a[0]) && std::isfinite(a[1]) && std::isfinite(a[2]);
    for (int i = 0; i < 3; ++i) data.acceleration.push_back(finite ? a[i] : 0);
    data.accelerationWeight.push_back(finite ? 1 : 0);
  }
  if (data.size() < MinimumParticles)
    throw std::invalid_argument("only " + std::to_string(data.size()) + " of " + std::to_string(t.count) +
                                " particles lie in the bounds with finite velocities" +
                                (body ? " and outside of the body" : "") +
                                (outliers ? " and belong among their neighbours" : "") + "; at least " +
                                std::to_string(MinimumParticles) + " are needed");
  return data;
}

double faceDistance(const Grid& g, const double* x) {
  double least = 1e300;
  for (int a = 0; a < 3; ++a)
    least = std::min({least, x[a] - g.origin[a], g.origin[a] + (g.n[a] - 1) * g.spacing[a] - x[a]});
  return least;
}

/// Every m-th particle in the order of cells of about 4 particle spacings, so that those held out are spread
/// as evenly as the particles and the choice depends on no random number.
std::vector<std::size_t> heldOutParticles(const VICSharpData& data, const Grid& grid, double r, double part) {
  const std::size_t n = data.size();
  part = std::min(0.2, std::max(part, 100. / double(n))); // a hundred at least, to judge by
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

double rms(const std::vector<double>& values) {
  double sum = 0;
  for (double v : values) sum += v * v;
  return values.empty() ? 0 : std::sqrt(sum / double(values.size()));
}

/// rms per component from squared lengths
double rmsComponent(const std::vector<double>& squares) {
  return squares.empty()
             ? 0
             : std::sqrt(std::accumulate(squares.begin(), squares.end(), 0.) / (3. * double(squares.size())));
}

/// Progress of one part of the work.
Progress part(const Progress& progress, double from, double to) {
  return [&progress, from, to](double f) { return goOn(progress, from + (to - from) * f); };
}

/// Minimises the cost on one grid after the other.
class Reconstruction {
public:
  Reconstruction(const VICSharpData& data, const VICSharpConstants& constants, const VICSharpOptions& options)
      : data_(data), constants_(constants), options_(options) {}

  bool aborted() const { return aborted_; }
  const Model& model() const { return *model_; }

  /// To another grid, from a solution on any grid or from zero.
  void moveTo(const Grid& grid, const Model::State* start) {
    model_ = std::make_unique<Model>(grid, data_, constants_);
    x_ = start ? model_->unknowns(*start) : std::vector<float>(model_->size(), 0.f);
  }
  /// To the start as it is, and the difference of two other solutions.
  void addDetails(const Model::State& fine, const Model::State& coarse) {
    const std::vector<float> a = model_->unknowns(fine), b = model_->unknowns(coarse);
    for (std::size_t e = 0; e < x_.size(); ++e) x_[e] += a[e] - b[e];
  }
  void restart(double curvatureWeight, const Model::State& start) {
    constants_.curvatureWeight = curvatureWeight;
    model_->setConstants(constants_);
    x_ = model_->unknowns(start);
  }

  /// An iteration must gain the part `tolerance` of the variance of this noise.
  void useNoise(double velocity, double acceleration, double tolerance) {
    gain_ = 3 * square(velocity / constants_.velocityScale);
    if (!data_.acceleration.empty())
      gain_ += 3 * square(constants_.accelerationWeight * acceleration / constants_.accelerationScale);
    gain_ *= tolerance;
  }
  /// Particles that miss by more than so many times this noise count linearly. From a poor start that would
  /// be most of them, and the large scales would come slowly: so only once there is a solution.
  void suppressOutliers(double velocityNoise, double accelerationNoise) {
    constants_.velocityOutlier = options_.outliers * velocityNoise;
    constants_.accelerationOutlier = options_.outliers * accelerationNoise;
    if (model_) model_->setConstants(constants_);
  }

  /// Up to `maximum` iterations, fewer once an iteration gains less than the tolerance allows (mean of five).
  LBFGSResult minimise(int maximum, const Progress& progress) {
    constexpr std::size_t Window = 5;
    LBFGSOptions options;
    options.maximumIterations = maximum;
    options.memory = 2;
    std::vector<double> values;
    const auto goOnWith = [&](const LBFGSState& s, const std::vector<float>&) {
      aborted_ = !goOn(progress, std::min(1., double(s.iteration) / maximum));
      values.push_back(s.value);
      const std::size_t n = values.size();
      return !aborted_ && (n <= Window || values[n - 1 - Window] - values[n - 1] > Window * gain_);
    };
    return LBFGS<float>(options).minimise(
        [&](const std::vector<float>& x, std::vector<float>& g) { return model_->cost(x, g); }, x_, goOnWith);
  }

private:
  const VICSharpData& data_;
  VICSharpConstants constants_;
  const VICSharpOptions& options_;
  std::unique_ptr<Model> model_;
  std::vector<float> x_;
  double gain_ = 0; ///< of J, that an iteration must bring
  bool aborted_ = false;
};

/// Finds bc and the noise on one grid, with some particles held out.
class Calibrator {
public:
  Calibrator(VICSharpData data, std::vector<std::size_t> heldOut, const VICSharpConstants& constants,
             const VICSharpOptions& options)
      : valid_(data.accelerationWeight), data_(withoutWeight(std::move(data), heldOut)),
        heldOut_(std::move(heldOut)), constants_(constants), options_(options),
        reconstruction_(data_, constants, options) {
    for (std::size_t p = 0; p < data_.size(); ++p)
      if (data_.velocityWeight[p] > 0) used_.push_back(p);
  }

  /// Tries bc = first/2, first/4 ... and, unless that helps, 2 first, 4 first ..., all for the same number of
  /// iterations from the same solution. bc is the largest that predicts the particles held out, off the
  /// faces, within 3 % of the best.
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
    reconstruction_.useNoise(best_.velocityNoise, best_.accelerationNoise, options_.tolerance);
    reconstruction_.suppressOutliers(best_.velocityNoise, best_.accelerationNoise);
    huber_ = best_;
    start = reconstruction_.model().state();

    constexpr int Most = 8;
    std::vector<std::pair<double, double>> trials; // log bc, score
    double lowest = 1e300;
    const auto improves = [&](double weight) {
      reconstruction_.restart(weight, start);
      const double from = 0.4 + 0.6 * double(trials.size()) / Most;
      reconstruction_.minimise(25, part(progress, from, from + 0.6 / Most));
      const double value = score();
      trials.emplace_back(std::log(weight), value);
      if (value >= lowest) return false;
      lowest = value;
      best_ = measure(weight);
      return true;
    };
    improves(first);
    for (double factor : {0.5, 2.}) {
      int worse = 0;
      for (double w = factor * first; worse < 2 && w > 1.4e-3 && w < 0.5 && !reconstruction_.aborted();
           w *= factor)
        worse = improves(w) ? 0 : worse + 1;
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

  /// The largest log bc whose score is within 3 % of the lowest: between the last trial that is and the next
  /// one, where a parabola with its vertex at the former says so.
  static double smoothest(std::vector<std::pair<double, double>> trials, double lowest) {
    std::sort(trials.begin(), trials.end());
    std::size_t last = 0;
    for (std::size_t t = 0; t < trials.size(); ++t)
      if (trials[t].second <= 1.03 * lowest) last = t;
    if (last + 1 == trials.size()) return trials[last].first;
    const double room = 1.03 * lowest - trials[last].second,
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
    c.velocityNoise =
        options_.velocityNoise > 0 ? options_.velocityNoise : estimate(pick(u, used_), pick(u, heldOut_));
    c.velocityHeldOut = rmsComponent(pick(u, heldOut_));
    if (!model.hasAccelerationData()) return c;
    const std::vector<double> heldOut = pick(a, accelerated(heldOut_));
    c.accelerationNoise = options_.accelerationNoise > 0 ? options_.accelerationNoise
                                                         : estimate(pick(a, accelerated(used_)), heldOut);
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
      sum += Huber(model.velocityMisfits()[p], options_.outliers * huber_.velocityNoise).value / su2;
      if (model.hasAccelerationData() && valid_[p] > 0)
        sum +=
            Huber(model.accelerationMisfits()[p], options_.outliers * huber_.accelerationNoise).value / sa2;
    }
    return sum / double(judges_.size());
  }

  std::vector<double> valid_; ///< 1 for particles with an acceleration
  VICSharpData data_;
  std::vector<std::size_t> heldOut_, used_;
  std::vector<std::size_t> judges_; ///< those held out that are not near the faces
  VICSharpConstants constants_;
  const VICSharpOptions& options_;
  Reconstruction reconstruction_;
  VICSharpCalibration best_, huber_;
};

/// The part of the data within a grid.
VICSharpData within(const VICSharpData& data, const Grid& grid) {
  VICSharpData out;
  out.meanVelocity = data.meanVelocity;
  for (std::size_t p = 0; p < data.size(); ++p) {
    const double* x = &data.position[3 * p];
    if (!within(grid, x)) continue;
    out.position.insert(out.position.end(), x, x + 3);
    out.velocity.insert(out.velocity.end(), &data.velocity[3 * p], &data.velocity[3 * p] + 3);
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
    for (std::size_t p = 0; p < data.size(); ++p) {
      bool inside = true;
      for (int a = 0; a < 3; ++a) {
        const double s = (data.position[3 * p + a] - g.origin[a]) / g.spacing[a];
        inside = inside && s >= 0 && s <= g.n[a] - 1;
      }
      if (inside)
        energy += square(data.velocity[3 * p]) + square(data.velocity[3 * p + 1]) +
                  square(data.velocity[3 * p + 2]);
    }
    if (energy > most) most = energy, best = g;
  }
  return best;
}

/// The data, the grid and the constants of one reconstruction.
struct Problem {
  double spacing;        ///< r
  std::size_t particles; ///< used
  int margin;            ///< nodes that the model's grid has beyond the output's
  Grid grid;
  VICSharpData data;
  std::size_t outliers; ///< left out of the data
  VICSharpConstants constants;
};

double volume(const Grid& g) {
  double v = 1;
  for (int a = 0; a < 3; ++a) v *= (g.n[a] - 1) * g.spacing[a];
  return v;
}

/// The velocity of the wall as data: one point per cell of its surface (Fibonacci's lattice), no-slip.
/// Accelerations measured within about a spacing of the wall count less, as the boundary layer is thinner
/// than what a grid can carry.
void addWall(const Body& body, double h, const Grid& grid, VICSharpData& d) {
  d.velocityWeight.resize(d.size(), 1);
  for (std::size_t e = 0; e < d.size() && !d.acceleration.empty(); ++e) {
    const double* x = &d.position[3 * e];
    d.accelerationWeight[e] *= 1 - std::exp(-square(body.signedDistance({x[0], x[1], x[2]}) / h));
  }
  const double radius = 0.5 * body.diameter;
  const int count = int(4 * M_PI * square(radius / h));
  for (int e = 0; e < count; ++e) {
    const double z = 1 - (2 * e + 1.) / count, s = std::sqrt(1 - z * z), phi = M_PI * (1 + std::sqrt(5.)) * e;
    const Eigen::Vector3d x = body.centre + radius * Eigen::Vector3d(s * std::cos(phi), s * std::sin(phi), z);
    if (!within(grid, x.data())) continue;
    const Eigen::Vector3d u = body.velocityAt(x);
    d.position.insert(d.position.end(), x.data(), x.data() + 3);
    for (int c = 0; c < 3; ++c) d.velocity.push_back(u[c] - d.meanVelocity[c]);
    d.velocityWeight.push_back(1);
    if (d.acceleration.empty()) continue;
    d.acceleration.insert(d.acceleration.end(), 3, 0);
    d.accelerationWeight.push_back(0);
  }
}

/// Tells the model of the body and of voids. They are walls that make vorticity.
void addWalls(const VICSharpOptions& options, Problem& p) {
  const auto field =
      std::make_shared<std::vector<float>>(voidDistance(p.data.position, p.grid, VoidRadius * p.spacing));
  const std::optional<Body> body = options.body;
  if (field->empty() && !body) return;
  const Grid grid = p.grid;
  p.constants.distance = [field, grid, body](double x, double y, double z) {
    double distance = body ? body->signedDistance({x, y, z}) : 1e30;
    if (field->empty()) return distance;
    const double at[3] = {x, y, z};
    int n[3];
    for (int a = 0; a < 3; ++a)
      n[a] = std::clamp(int(std::lround((at[a] - grid.origin[a]) / grid.spacing[a])), 0, grid.n[a] - 1);
    // Half a spacing inwards, so that no node next to a particle counts as inside.
    return std::min(distance, double((*field)[grid.index(n[0], n[1], n[2])]) + 0.5 * grid.spacing[0]);
  };
  if (body) addWall(*body, options.grid.spacing[0], p.grid, p.data);
}

Problem problem(const VICSharpTracks& tracks, const VICSharpOptions& options) {
  check(tracks, options);
  Problem p;
  // Gone altogether, not only of no weight: nothing is scaled, calibrated or judged by them.
  const auto outlier =
      options.outliers > 0
          ? medianTest(tracks.positions, tracks.velocities, tracks.accelerations, tracks.count).outlier
          : std::vector<unsigned char>();
  const auto among = [&](const Grid& grid) {
    return usable(tracks, grid, options.body, outlier, p.outliers);
  };
  p.spacing = std::cbrt(volume(options.grid) / double(among(options.grid).size()));
  p.margin = int(std::ceil(options.padding * p.spacing / options.grid.spacing[0] - 1e-6));
  p.grid = padded(options.grid, p.margin);
  p.data = among(p.grid);
  std::array<double, 3>& mean = p.data.meanVelocity;
  const std::size_t n = p.data.size();
  for (std::size_t e = 0; e < 3 * n; ++e) mean[e % 3] += p.data.velocity[e] / double(n);
  for (std::size_t e = 0; e < 3 * n; ++e) p.data.velocity[e] -= mean[e % 3];

  VICSharpConstants& k = p.constants;
  k.viscosity = options.viscosity;
  k.particleSpacing = p.spacing;
  double speed = 1e-30;
  for (double m : mean) speed = std::max(speed, std::abs(m));
  const double su = rms(p.data.velocity), sa = rms(p.data.acceleration);
  k.velocityScale = su > 1e-9 * speed ? su : speed; // fluid at rest
  k.accelerationScale = sa > 0 ? sa : square(k.velocityScale) / p.spacing;
  if (sa == 0) p.data.acceleration.clear(), p.data.accelerationWeight.clear();
  k.accelerationWeight = options.accelerationWeight > 0 ? options.accelerationWeight : 0.3;
  if (options.accelerationWeight == 0 && options.velocityNoise > 0 && options.accelerationNoise > 0)
    k.accelerationWeight = std::clamp(options.velocityNoise * k.accelerationScale /
                                          (options.accelerationNoise * k.velocityScale),
                                      0.1, 0.5);
  k.curvatureWeight = options.curvatureWeight > 0 ? options.curvatureWeight : 0.0125;
  p.particles = p.data.size();
  addWalls(options, p);
  return p;
}

/// On a part of the volume, at about half the particle spacing.
std::optional<VICSharpCalibration> calibrate(const Problem& whole, const VICSharpOptions& options,
                                             const Progress& progress) {
  const bool known = options.curvatureWeight > 0 && options.velocityNoise > 0 &&
                     (options.accelerationNoise > 0 || whole.data.acceleration.empty());
  if (known)
    return VICSharpCalibration{options.curvatureWeight, options.velocityNoise, options.accelerationNoise};
  const Grid grid =
      calibrationGrid(coarseGrid(whole.grid, std::max(1., 0.5 * whole.spacing / whole.grid.spacing[0])),
                      whole.data, CalibrationNodes);
  VICSharpData data = within(whole.data, grid);
  const auto heldOut = heldOutParticles(data, grid, whole.spacing, options.heldOut);
  Calibrator calibrator(std::move(data), heldOut, whole.constants, options);
  const VICSharpCalibration found = calibrator.run(grid, coarseGrid(grid, 2), progress);
  if (calibrator.aborted()) return {};
  return found;
}

/// Velocity, vorticity, acceleration and pressure on the output's part of the model's grid.
void writeFields(const Model& model, const Problem& p, VICSharpResult& result) {
  const Grid& to = result.grid;
  const Stencils<float> stencils(p.grid, model.constants().order);
  const int m = p.margin;
  for (auto* field : {&result.velocity, &result.vorticity}) field->resize(3 * to.size());
  if (model.hasAccelerationData()) result.acceleration.resize(3 * to.size());
  if (model.hasAccelerationData()) result.pressure.resize(to.size());
  double meanPressure = 0;
  const auto sums = sumOverRows<float, 2>(to, 0, [&](int j, int k, RowBuffers<float>&) {
    RowBuffers<float> g(p.grid.n[0], 9); // d u_i / d x_j at 3 i + j
    for (int i = 0; i < 3; ++i)
      for (int l = 0; l < 3; ++l)
        stencils.derivative(model.velocity()[i].data(), l, j + m, k + m, g(3 * i + l));
    double divergence = 0, gradient = 0;
    for (int i = 0; i < to.n[0]; ++i) {
      const std::size_t node = p.grid.index(i + m, j + m, k + m), out = to.index(i, j, k);
      const int e = i + m;
      for (int c = 0; c < 3; ++c) {
        const int l = (c + 1) % 3, n = (c + 2) % 3;
        result.velocity[3 * out + c] = float(double(model.velocity()[c][node]) + p.data.meanVelocity[c]);
        result.vorticity[3 * out + c] = g(3 * n + l)[e] - g(3 * l + n)[e];
        if (model.hasAccelerationData()) result.acceleration[3 * out + c] = model.acceleration()[c][node];
      }
      if (model.hasAccelerationData()) result.pressure[out] = model.pressure()[node];
      divergence += square(double(g(0)[e]) + double(g(4)[e]) + double(g(8)[e]));
      for (int c = 0; c < 9; ++c) gradient += square(double(g(c)[e]));
    }
    return std::array<double, 2>{divergence, gradient};
  });
  result.divergenceNorm = sums[1] > 0 ? std::sqrt(sums[0] / sums[1]) : 0;
  for (float value : result.pressure) meanPressure += double(value) / double(to.size());
  for (float& value : result.pressure) value -= float(meanPressure);
}

/// The acceleration within `thickness` of the wall: it falls linearly to the wall's own from where the fields
/// can follow the flow.
void wallLayer(const Body& body, double thickness, VICSharpResult& r) {
  const Grid& g = r.grid;
  std::vector<double> outer; // positions at the edge of the layer
  std::vector<std::size_t> nodes;
  for (int k = 0; k < g.n[2]; ++k)
    for (int j = 0; j < g.n[1]; ++j)
      for (int i = 0; i < g.n[0]; ++i) {
        const auto p = g.position(i, j, k);
        const Eigen::Vector3d x(p[0], p[1], p[2]);
        const double s = body.signedDistance(x);
        if (s <= 0 || s >= thickness) continue;
        const Eigen::Vector3d edge = x + (thickness - s) * (x - body.centre).normalized();
        if (!within(g, edge.data())) continue;
        outer.insert(outer.end(), edge.data(), edge.data() + 3);
        nodes.push_back(g.index(i, j, k));
      }
  const Sampler<float> sampler(g, outer.data(), nodes.size(), 2);
  std::vector<float> component(g.size()), values(nodes.size());
  for (int c = 0; c < 3; ++c) {
    for (std::size_t e = 0; e < g.size(); ++e) component[e] = r.acceleration[3 * e + c];
    sampler.sample(component.data(), values.data());
    for (std::size_t e = 0; e < nodes.size(); ++e) {
      const std::size_t n = nodes[e];
      const auto p = g.position(int(n % g.n[0]), int(n / g.n[0] % g.n[1]), int(n / g.n[0] / g.n[1]));
      const Eigen::Vector3d x(p[0], p[1], p[2]);
      const double wall = body.accelerationAt(x)[c], part = body.signedDistance(x) / thickness;
      r.acceleration[3 * n + c] = float(wall + part * (values[e] - wall));
    }
  }
}

/// Nodes inside the body move with it.
void maskBody(const Body& body, VICSharpResult& r) {
  r.mask.assign(r.grid.size(), 0);
  for (int k = 0; k < r.grid.n[2]; ++k)
    for (int j = 0; j < r.grid.n[1]; ++j)
      for (int i = 0; i < r.grid.n[0]; ++i) {
        const auto x = r.grid.position(i, j, k);
        const Eigen::Vector3d at(x[0], x[1], x[2]);
        if (!body.contains(at)) continue;
        const std::size_t p = r.grid.index(i, j, k);
        r.mask[p] = 1;
        Eigen::Map<Eigen::Vector3f>(r.velocity.data() + 3 * p) = body.velocityAt(at).cast<float>();
        if (!r.acceleration.empty())
          Eigen::Map<Eigen::Vector3f>(r.acceleration.data() + 3 * p) = body.accelerationAt(at).cast<float>();
        Eigen::Map<Eigen::Vector3f>(r.vorticity.data() + 3 * p) = (2 * body.angularVelocity).cast<float>();
      }
}

} // namespace

std::optional<VICSharpCalibration>
calibrateVICSharp(const VICSharpTracks& tracks, const VICSharpOptions& options, const Progress& progress) {
  return calibrate(problem(tracks, options), options, progress);
}

VICSharpResult vicSharp(const VICSharpTracks& tracks, const VICSharpOptions& options,
                        const VICSharpCalibration* calibration, const VICSharpSolution* start,
                        const Progress& progress) {
  Problem p = problem(tracks, options);
  VICSharpResult result;
  result.grid = options.grid;
  result.particlesUsed = p.particles;
  result.outliers = p.outliers;
  result.particleSpacing = p.spacing;
  const auto found = calibration ? *calibration : calibrate(p, options, part(progress, 0, 0.3));
  result.aborted = !found;
  if (result.aborted) return result;
  result.calibration = *found;
  p.constants.curvatureWeight = found->curvatureWeight;

  std::vector<double> factors{1}; // of the spacings, coarse to fine
  while (2 * factors.front() * options.grid.spacing[0] <= 1.3 * p.spacing)
    factors.insert(factors.begin(), 2 * factors.front());
  const std::size_t levels = factors.size();
  if (start && start->size() != levels) start = nullptr;
  Reconstruction reconstruction(p.data, p.constants, options);
  auto solution = std::make_shared<VICSharpSolution>();
  LBFGSResult outcome;
  for (std::size_t level = 0; level < levels; ++level) {
    const bool finest = level + 1 == levels;
    if (level > 0) reconstruction.suppressOutliers(found->velocityNoise, found->accelerationNoise);
    reconstruction.useNoise(found->velocityNoise, found->accelerationNoise,
                            options.tolerance * (finest ? 1 : CoarseTolerance));
    reconstruction.moveTo(finest ? p.grid : coarseGrid(p.grid, factors[level]), level > 0 ? &solution->back()
                                                                                : start   ? &start->front()
                                                                                          : nullptr);
    if (level > 0 && start) reconstruction.addDetails((*start)[level], (*start)[level - 1]);
    outcome = finest ? reconstruction.minimise(options.maximumIterations, part(progress, 0.4, 1))
                     : reconstruction.minimise(1000, part(progress, 0.3, 0.4));
    result.aborted = reconstruction.aborted();
    if (result.aborted) return result;
    solution->push_back(reconstruction.model().state());
  }

  const Model& model = reconstruction.model();
  result.solution = solution;
  result.iterations = outcome.iterations;
  result.stop = outcome.status == LBFGSStatus::MaximumIterations
                    ? "the largest number of iterations was reached"
                    : "an iteration no longer gained anything beside the noise";
  // of the particles, not of points on the wall, each as far as it counts
  const auto overNoise = [&](const std::vector<double>& squares, const std::vector<double>& weights,
                             double noise) {
    double sum = 0, weight = 0;
    for (std::size_t e = 0; e < std::min(squares.size(), p.particles); ++e) {
      const double w = weights.empty() ? 1 : weights[e];
      sum += w * squares[e];
      weight += w;
    }
    return noise > 0 && weight > 0 ? std::sqrt(sum / (3 * weight)) / noise : 0;
  };
  result.velocityMisfit = overNoise(model.velocityMisfits(), p.data.velocityWeight, found->velocityNoise);
  result.accelerationMisfit =
      overNoise(model.accelerationMisfits(), p.data.accelerationWeight, found->accelerationNoise);
  writeFields(model, p, result);
  if (options.body) {
    if (model.hasAccelerationData()) wallLayer(*options.body, 1.5 * options.grid.spacing[0], result);
    maskBody(*options.body, result);
  }
  goOn(progress, 1);
  return result;
}

} // namespace rimflow
