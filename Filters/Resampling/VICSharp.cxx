#include "VICSharp.h"

#include "Interpolation.h"
#include "LBFGS.h"
#include "VICSharpModel.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <string>

namespace rimflow {
namespace {

// Float: half the memory and time of double, and far below the noise of any measurement.
using Real = float;
using Model = VICSharpModel<Real>;
using Vector = Model::Vector;

// Held out: every 20th particle, but about 200 where there are few, and at most every 5th.
std::size_t holdOutEvery(std::size_t count) { return std::clamp<std::size_t>(count / 200, 5, 20); }
constexpr double OutlierSigmas = 4;

/// What a warm start needs: the unknowns and the grid they belong to.
struct Solution {
  Grid grid;
  Vector x;
  double velocityScale, accelerationScale;
};

bool sameGrid(const Grid& a, const Grid& b) {
  return a.n == b.n && a.origin == b.origin && a.spacing == b.spacing;
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

/// A grid of another spacing over the same box, a little larger where it does not fit.
Grid coarser(const Grid& g, double spacing) {
  Grid c = g;
  for (int a = 0; a < 3; ++a) {
    const double length = (g.n[a] - 1) * g.spacing[a];
    c.n[a] = std::max(5, int(std::ceil(length / spacing - 1e-9)) + 1);
    c.spacing[a] = spacing;
    c.origin[a] = g.origin[a] + 0.5 * (length - (c.n[a] - 1) * spacing);
  }
  return c;
}

bool within(const Grid& g, const double* x) {
  for (int a = 0; a < 3; ++a)
    if (!(x[a] >= g.origin[a] && x[a] <= g.origin[a] + (g.n[a] - 1) * g.spacing[a])) return false;
  return true;
}

double rms(const std::vector<double>& v) {
  double sum = 0;
  for (double x : v) sum += x * x;
  return v.empty() ? 0 : std::sqrt(sum / double(v.size()));
}

/// The particles to fit, and those held out to see when to stop.
struct Split {
  VICSharpData fit, heldOut;
};

/// Usable particles within the box of `grid`. holdOut: keep some apart.
Split split(const VICSharpTracks& t, const Grid& grid, const std::optional<Body>& body, bool holdOut) {
  Split s;
  const std::size_t every = holdOutEvery(t.count);
  std::size_t used = 0;
  bool accelerations = t.accelerations != nullptr;
  for (std::size_t p = 0; p < t.count; ++p) {
    const double x[3] = {t.positions[3 * p], t.positions[3 * p + 1], t.positions[3 * p + 2]};
    const float* u = t.velocities + 3 * p;
    if (!within(grid, x) || !std::isfinite(u[0]) || !std::isfinite(u[1]) || !std::isfinite(u[2])) continue;
    if (body && body->contains(Eigen::Vector3d(x[0], x[1], x[2]))) continue;
    VICSharpData& to = holdOut && ++used % every == 0 ? s.heldOut : s.fit;
    to.position.insert(to.position.end(), x, x + 3);
    to.velocity.insert(to.velocity.end(), u, u + 3);
    if (!accelerations) continue;
    const float* a = t.accelerations + 3 * p;
    const bool finite = std::isfinite(a[0]) && std::isfinite(a[1]) && std::isfinite(a[2]);
    for (int i = 0; i < 3; ++i) to.acceleration.push_back(finite ? a[i] : 0);
    to.accelerationWeight.push_back(finite ? 1 : 0);
  }
  if (s.fit.size() < 20)
    throw std::invalid_argument(
        "only " + std::to_string(s.fit.size()) +
        " particles with finite velocities lie in the bounds; at least 20 are needed");
  std::array<double, 3>& mean = s.fit.meanVelocity;
  for (std::size_t k = 0; k < s.fit.velocity.size(); ++k)
    mean[k % 3] += s.fit.velocity[k] / double(s.fit.size());
  for (VICSharpData* d : {&s.fit, &s.heldOut})
    for (std::size_t k = 0; k < d->velocity.size(); ++k) d->velocity[k] -= mean[k % 3];
  s.heldOut.meanVelocity = mean;
  return s;
}

/// Differences of a field from data at the sampler's points, three per point.
std::vector<double> residuals(const TrilinearSampler<Real>& sampler, const Model::VectorField& field,
                              const std::vector<double>& data) {
  std::vector<double> r(data.size());
  Vector sampled(sampler.size());
  for (int i = 0; i < 3; ++i) {
    sampler.sample(field[i].data(), sampled.data());
    for (std::size_t p = 0; p < sampler.size(); ++p) r[3 * p + i] = sampled[p] - data[3 * p + i];
  }
  return r;
}

/// Per particle a weight that falls with the fourth power of its misfit beyond OutlierSigmas robust standard
/// deviations.
std::vector<double> outlierWeights(const std::vector<double>& residual) {
  const std::size_t n = residual.size() / 3;
  std::vector<double> size(n), weight(n, 1);
  for (std::size_t p = 0; p < n; ++p)
    size[p] = std::hypot(residual[3 * p], residual[3 * p + 1], residual[3 * p + 2]);
  std::vector<double> sorted = size;
  std::nth_element(sorted.begin(), sorted.begin() + std::ptrdiff_t(n / 2), sorted.end());
  const double limit =
      OutlierSigmas * sorted[n / 2] / 1.538; // the median length of a 3-D normal vector is 1.538 sigma
  for (std::size_t p = 0; p < n; ++p)
    if (size[p] > limit && limit > 0) weight[p] = std::pow(limit / size[p], 4);
  return weight;
}

/// Ghost tracks count less: judged by both their velocity and their acceleration.
void weighOutliers(VICSharpData& data, const Model& model) {
  const TrilinearSampler<Real> sampler(model.grid(), data.position.data(), data.size());
  data.velocityWeight = outlierWeights(residuals(sampler, model.velocity(), data.velocity));
  if (data.acceleration.empty()) return;
  const std::vector<double> byAcceleration =
      outlierWeights(residuals(sampler, model.acceleration(), data.acceleration));
  for (std::size_t p = 0; p < data.size(); ++p) {
    data.velocityWeight[p] *= byAcceleration[p];
    data.accelerationWeight[p] = data.accelerationWeight[p] > 0 ? data.velocityWeight[p] : 0;
  }
}

/// The unknowns of one model as a start for a finer one: c by interpolation, boundary values from the coarse
/// solution.
Vector prolong(Model& coarse, const Vector& x, Model& fine) {
  coarse.forward(x);
  Vector y(fine.size(), 0);
  const Grid &from = coarse.grid(), &to = fine.grid();
  const std::size_t boundary = fine.boundary().size();
  for (std::size_t i = 0; i < 3; ++i) {
    const Vector c = resample(from, x.data() + i * from.size(), to);
    std::copy(c.begin(), c.end(), y.begin() + std::ptrdiff_t(i * to.size()));
    const Vector u = resample(from, coarse.velocity()[i].data(), to);
    for (std::size_t b = 0; b < boundary; ++b)
      y[fine.boundaryVelocityOffset() + i * boundary + b] =
          u[fine.boundary().node[b]] / Real(fine.constants().velocityScale);
    if (!fine.hasAcceleration()) continue;
    const Vector d = resample(from, coarse.rate()[i].data(), to);
    for (std::size_t b = 0; b < boundary; ++b)
      y[fine.boundaryRateOffset() + i * boundary + b] =
          d[fine.boundary().node[b]] / Real(fine.constants().accelerationScale);
  }
  return y;
}

/// Decides after each iteration whether to go on, and keeps the best iterate where that is not the last.
class StoppingRule {
public:
  StoppingRule(Model& model, const VICSharpData& heldOut, const VICSharpOptions& options, double velocityRms,
               double accelerationRms)
      : model_(model), heldOut_(heldOut), options_(options), velocityRms_(velocityRms),
        accelerationRms_(accelerationRms) {
    if (heldOut.size() > 0)
      sampler_ =
          std::make_unique<TrilinearSampler<Real>>(model.grid(), heldOut.position.data(), heldOut.size());
  }

  /// False: stop. The model's fields belong to the iterate or to a trial near it.
  bool goOn(const Vector& x) { return sampler_ ? heldOutStillImproves(x) : misfitAboveNoise(x); }

  const Vector* best() const { return best_.empty() ? nullptr : &best_; }
  const char* reason() const {
    return sampler_ ? "the misfit at the particles held out no longer fell"
                    : "the misfit came down to the noise";
  }
  double velocityMisfit() const { return velocity_; }         ///< at the particles held out, m/s
  double accelerationMisfit() const { return acceleration_; } ///< m/s2

private:
  bool misfitAboveNoise(const Vector&) {
    const auto& t = model_.terms();
    const bool velocity = std::sqrt(t.velocity / 3) * velocityRms_ > options_.velocityNoise;
    const bool acceleration = model_.hasAcceleration() && options_.accelerationNoise > 0 &&
                              std::sqrt(t.acceleration / 3) * accelerationRms_ > options_.accelerationNoise;
    return velocity || acceleration;
  }

  bool heldOutStillImproves(const Vector& x) {
    if (++iteration_ % 2 != 0) return true;
    const double velocity = rms(residuals(*sampler_, model_.velocity(), heldOut_.velocity));
    double acceleration = 0, score = std::pow(velocity / velocityRms_, 2);
    if (model_.hasAcceleration()) {
      acceleration = rms(residuals(*sampler_, model_.acceleration(), heldOut_.acceleration));
      score += std::pow(options_.accelerationWeight * acceleration / accelerationRms_, 2);
    }
    if (score < bestScore_) {
      if (score < 0.998 * bestScore_) sinceBetter_ = 0;
      bestScore_ = score;
      best_ = x;
      velocity_ = velocity;
      acceleration_ = acceleration;
    } else {
      sinceBetter_ += 1;
    }
    return sinceBetter_ < 5;
  }

  Model& model_;
  const VICSharpData& heldOut_;
  const VICSharpOptions& options_;
  double velocityRms_, accelerationRms_;
  std::unique_ptr<TrilinearSampler<Real>> sampler_;
  int iteration_ = 0, sinceBetter_ = 0;
  double bestScore_ = std::numeric_limits<double>::infinity(), velocity_ = 0, acceleration_ = 0;
  Vector best_;
};

/// One component of a field on the padded grid, cropped into component i of three per node.
void crop(const Grid& from, const Real* field, int margin, double shift, int i, const Grid& to,
          std::vector<float>& out) {
  for (int k = 0; k < to.n[2]; ++k)
    for (int j = 0; j < to.n[1]; ++j) {
      const Real* row = field + from.index(margin, j + margin, k + margin);
      float* target = out.data() + 3 * to.index(0, j, k) + i;
      for (int n = 0; n < to.n[0]; ++n) target[3 * n] = float(row[n] + shift);
    }
}

/// Central differences of the velocity: vorticity, and how far the velocity is from divergence free.
void differentiate(Model& model, int margin, VICSharpResult& result) {
  const Grid& g = model.grid();
  const Stencils<Real> stencils(g);
  std::array<Vector, 9> gradient; // d u_i / d x_j at 3 i + j
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j) {
      gradient[3 * i + j].resize(g.size());
      forEachRow<Real>(g, 1, [&](int row, int layer, RowBuffers<Real>&) {
        stencils.derivative(model.velocity()[i].data(), j, row, layer,
                            gradient[3 * i + j].data() + g.index(0, row, layer));
      });
    }
  double divergence = 0, size = 0;
  Vector curl(g.size());
  for (int i = 0; i < 3; ++i) {
    const Vector &plus = gradient[3 * ((i + 2) % 3) + (i + 1) % 3],
                 &minus = gradient[3 * ((i + 1) % 3) + (i + 2) % 3];
    for (std::size_t p = 0; p < g.size(); ++p) curl[p] = plus[p] - minus[p];
    crop(g, curl.data(), margin, 0, i, result.grid, result.vorticity);
  }
  for (int k = margin; k < g.n[2] - margin; ++k)
    for (int j = margin; j < g.n[1] - margin; ++j)
      for (int i = margin; i < g.n[0] - margin; ++i) {
        const std::size_t p = g.index(i, j, k);
        divergence += std::pow(gradient[0][p] + gradient[4][p] + gradient[8][p], 2);
        for (const Vector& d : gradient) size += double(d[p]) * d[p];
      }
  result.divergenceNorm = size > 0 ? std::sqrt(divergence / size) : 0;
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
        Eigen::Map<Eigen::Vector3f>(r.acceleration.data() + 3 * p) = body.accelerationAt(at).cast<float>();
        Eigen::Map<Eigen::Vector3f>(r.vorticity.data() + 3 * p) = (2 * body.angularVelocity).cast<float>();
      }
}

void check(const VICSharpTracks& t, const VICSharpOptions& o) {
  if (t.count == 0 || !t.positions || !t.velocities) throw std::invalid_argument("there are no particles");
  for (int a = 0; a < 3; ++a)
    if (o.grid.n[a] < 5 || !(o.grid.spacing[a] > 0))
      throw std::invalid_argument(
          "the grid needs at least 5 nodes along every axis and a spacing greater than 0");
  if (std::abs(o.grid.spacing[0] / o.grid.spacing[1] - 1) > 1e-6 ||
      std::abs(o.grid.spacing[0] / o.grid.spacing[2] - 1) > 1e-6)
    throw std::invalid_argument("the grid must have the same spacing along all axes");
  if (o.viscosity < 0 || o.maximumIterations < 1 || o.padding < 0)
    throw std::invalid_argument(
        "viscosity and padding must not be negative, and at least one iteration must be allowed");
}

} // namespace

VICSharpResult vicSharp(const VICSharpTracks& tracks, const VICSharpOptions& options,
                        const std::shared_ptr<const void>& warm, const Progress& progress) {
  check(tracks, options);
  VICSharpResult result;
  result.grid = options.grid;
  const double h = options.grid.spacing[0];
  const bool holdOut = options.velocityNoise <= 0;
  const auto boxVolume = [](const Grid& g) {
    return g.spacing[0] * g.spacing[1] * g.spacing[2] * (g.n[0] - 1.) * (g.n[1] - 1.) * (g.n[2] - 1.);
  };
  double spacing = std::cbrt(boxVolume(options.grid) /
                             double(split(tracks, options.grid, options.body, false).fit.size()));
  const int margin = int(std::ceil(options.padding * spacing / h));
  const Grid fine = padded(options.grid, margin);
  Split data = split(tracks, fine, options.body, holdOut);
  result.particlesUsed = data.fit.size() + data.heldOut.size();

  VICSharpConstants constants;
  constants.viscosity = options.viscosity;
  constants.particleSpacing = spacing;
  constants.velocityScale = std::max(rms(data.fit.velocity), 1e-12);
  const double accelerationRms = rms(data.fit.acceleration);
  const bool accelerations = accelerationRms > 0;
  if (!accelerations) data.fit.acceleration.clear(), data.fit.accelerationWeight.clear();
  constants.accelerationScale =
      accelerations ? accelerationRms : std::pow(constants.velocityScale, 2) / spacing;
  constants.accelerationWeight = accelerations ? options.accelerationWeight : 0;
  constants.divergenceWeight = constants.vorticityDivergenceWeight = options.divergenceWeight;
  constants.accelerationDivergenceWeight = accelerations ? options.divergenceWeight : 0;
  constants.navierStokesWeight = accelerations ? options.navierStokesWeight : 0;

  std::vector<Grid> grids{fine};
  const auto* start = static_cast<const Solution*>(warm.get());
  if (!start || !sameGrid(start->grid, fine))
    for (double s = 2 * h; s < 1.3 * spacing; s *= 2) grids.insert(grids.begin(), coarser(fine, s));

  std::unique_ptr<Model> model;
  Vector x;
  for (std::size_t level = 0; level < grids.size(); ++level) {
    const bool finest = level + 1 == grids.size();
    auto next = std::make_unique<Model>(grids[level], data.fit, constants);
    if (model) {
      x = prolong(*model, x, *next);
    } else if (start && sameGrid(start->grid, fine) && start->x.size() == next->size()) {
      x = start->x; // in units of that snapshot's scales
      const Real su = Real(start->velocityScale / constants.velocityScale),
                 sa = Real(start->accelerationScale / constants.accelerationScale);
      for (std::size_t i = 0; i < x.size(); ++i) x[i] *= i < next->boundaryRateOffset() ? su : sa;
      next->forward(x);
      weighOutliers(data.fit, *next);
      next = std::make_unique<Model>(grids[level], data.fit, constants);
    } else {
      x.assign(next->size(), 0);
    }
    model = std::move(next);

    StoppingRule rule(*model, data.heldOut, options, constants.velocityScale, constants.accelerationScale);
    LBFGSOptions limits;
    limits.maximumIterations =
        finest ? options.maximumIterations : std::min(options.maximumIterations, level == 0 ? 30 : 60);
    const int iterations = limits.maximumIterations;
    const auto solved = LBFGS<Real>(limits).minimise(
        [&](const Vector& at, Vector& gradient) { return model->cost(at, gradient); }, x,
        [&](const LBFGSState& state, const Vector& at) {
          result.aborted =
              !goOn(progress, (double(level) + double(state.iteration) / iterations) / double(grids.size()));
          return !result.aborted && rule.goOn(at);
        });
    if (result.aborted) return result;
    result.iterations += solved.iterations;
    result.stop = solved.status == LBFGSStatus::StoppedByCaller ? rule.reason()
                  : solved.status == LBFGSStatus::MaximumIterations
                      ? "the largest number of iterations was reached"
                      : "the minimum was reached";
    if (rule.best()) x = *rule.best();
    if (finest) {
      result.velocityNoise = holdOut ? rule.velocityMisfit() : options.velocityNoise;
      result.accelerationNoise = holdOut ? rule.accelerationMisfit() : options.accelerationNoise;
    } else {
      model->forward(x);
      weighOutliers(data.fit, *model);
    }
  }

  auto solution = std::make_shared<Solution>();
  *solution = {fine, x, constants.velocityScale, constants.accelerationScale};
  result.warm = solution;
  if (!model->hasAcceleration()) { // the same vorticity, with the acceleration that follows from it
    VICSharpData none = data.fit;
    none.acceleration.assign(none.velocity.size(), 0);
    constants.accelerationWeight = 1;
    auto with = std::make_unique<Model>(fine, none, constants);
    x.resize(with->size(), 0);
    model = std::move(with);
  }
  Vector unused(model->size());
  model->cost(x, unused);
  const auto overNoise = [](double misfit, double noise) { return noise > 0 ? misfit / noise : 0; };
  result.velocityMisfit =
      overNoise(std::sqrt(model->terms().velocity / 3) * constants.velocityScale, result.velocityNoise);
  if (accelerations)
    result.accelerationMisfit = overNoise(
        std::sqrt(model->terms().acceleration / 3) * constants.accelerationScale, result.accelerationNoise);
  for (std::vector<float>* field : {&result.velocity, &result.vorticity, &result.acceleration})
    field->assign(3 * result.grid.size(), 0);
  for (int i = 0; i < 3; ++i) {
    crop(fine, model->velocity()[i].data(), margin, data.fit.meanVelocity[i], i, result.grid,
         result.velocity);
    crop(fine, model->acceleration()[i].data(), margin, 0, i, result.grid, result.acceleration);
  }
  differentiate(*model, margin, result);
  if (options.body) maskBody(*options.body, result);
  goOn(progress, 1);
  return result;
}

} // namespace rimflow
