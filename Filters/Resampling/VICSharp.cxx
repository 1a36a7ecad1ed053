#include "VICSharp.h"

#include "VICSharpProblem.h"
#include "VICSharpReconstruction.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <vector>

namespace rimflow {
namespace {

using Model = VICSharpModel<float>;

constexpr double CoarseTolerance = 10; // times that of the finest grid

double square(double v) { return v * v; }

/// Velocity, vorticity, acceleration and pressure on the output's part of the model's grid.
void writeFields(const Model& model, const VICSharpProblem& p, VICSharpResult& result) {
  const Grid& to = result.grid;
  const Stencils<float> stencils(p.grid, model.constants().order);
  const int m = p.margin;
  for (auto* field : {&result.velocity, &result.vorticity, &result.acceleration})
    field->resize(3 * to.size());
  result.pressure.resize(to.size());
  Grid rows = to; // of the output, with room for a line of the model's grid
  rows.n[0] = p.grid.n[0];
  double meanPressure = 0;
  const auto sums =
      sumOverRows<float, 2>(rows, 9, [&](int j, int k, RowBuffers<float>& g) { // d u_i / d x_j at 3 i + j
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
            result.acceleration[3 * out + c] = model.acceleration()[c][node];
          }
          result.pressure[out] = model.pressure()[node];
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
/// can follow the flow. (One spacing: with 1.5 the acceleration within 1.5 spacings was a quarter to a third
/// less true at Re = 100 and 250, and the pressure on the sphere twice as wrong.)
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
        Eigen::Map<Eigen::Vector3f>(r.acceleration.data() + 3 * p) = body.accelerationAt(at).cast<float>();
        Eigen::Map<Eigen::Vector3f>(r.vorticity.data() + 3 * p) = (2 * body.angularVelocity).cast<float>();
      }
}

} // namespace

VICSharpResult vicSharp(const VICSharpTracks& tracks, const VICSharpOptions& options,
                        const VICSharpCalibration* calibration, const Progress& progress) {
  VICSharpResult result;
  VICSharpProblem p = vicSharpProblem(tracks, options, part(progress, 0, 0.1));
  if ((result.aborted = p.aborted)) return result;
  result.grid = options.grid;
  result.particlesUsed = p.data.particles();
  result.outliers = p.outliers;
  result.particleSpacing = p.spacing;
  result.localNoise = p.localNoise;
  auto found =
      calibration ? std::optional(*calibration) : calibrateVICSharp(p, options, part(progress, 0.1, 0.3));
  result.aborted = !found;
  if (result.aborted) return result;
  if (options.velocityNoise > 0) found->velocityNoise = options.velocityNoise;
  if (options.accelerationNoise > 0) found->accelerationNoise = options.accelerationNoise;
  result.calibration = *found;
  p.constants.curvatureWeight = found->curvatureWeight;
  weighAccelerations(options, found->velocityNoise, found->accelerationNoise, p.constants);

  std::vector<double> factors{1}; // of the spacings, coarse to fine
  while (2 * factors.front() * options.grid.spacing[0] <= 1.3 * p.spacing)
    factors.insert(factors.begin(), 2 * factors.front());
  VICSharpReconstruction reconstruction(p.data, p.constants, options);
  std::optional<Model::State> coarser;
  LBFGSResult outcome;
  for (std::size_t level = 0; level < factors.size(); ++level) {
    const bool finest = level + 1 == factors.size();
    const double from = 0.3 + 0.1 * double(level) / double(factors.size());
    if (coarser) reconstruction.suppressOutliers(found->velocityNoise, found->accelerationNoise);
    reconstruction.useNoise(found->velocityNoise, found->accelerationNoise,
                            options.tolerance * (finest ? 1 : CoarseTolerance));
    reconstruction.moveTo(finest ? p.grid : coarseGrid(p.grid, factors[level]),
                          coarser ? &*coarser : nullptr);
    outcome = finest
                  ? reconstruction.minimise(options.maximumIterations, part(progress, 0.4, 1))
                  : reconstruction.minimise(1000, part(progress, from, from + 0.1 / double(factors.size())));
    result.aborted = reconstruction.aborted();
    if (result.aborted) return result;
    if (!finest) coarser = reconstruction.model().state();
  }

  if (!reconstruction.model().hasAccelerationData()) {
    const Eigen::Vector3d frame = options.body ? options.body->velocity : Eigen::Vector3d::Zero();
    reconstruction.model().accelerationOfSteadiestFlow({frame[0], frame[1], frame[2]});
  }
  const Model& model = reconstruction.model();
  result.iterations = outcome.iterations;
  result.stop = outcome.status == LBFGSStatus::MaximumIterations
                    ? "the largest number of iterations was reached"
                    : "an iteration no longer gained anything beside the noise";
  // of the particles, not of points on the wall, each as far as it counts
  const auto overNoise = [&](const std::vector<double>& squares, const std::vector<double>& weights,
                             double noise) {
    double sum = 0, weight = 0;
    for (std::size_t e = 0; e < std::min(squares.size(), p.data.particles()); ++e) {
      const double w = weights.empty() ? 1 : weights[e];
      sum += w * squares[e];
      weight += w;
    }
    return noise > 0 && weight > 0 ? std::sqrt(sum / (3 * weight)) / noise : 0;
  };
  result.velocityMisfit = overNoise(model.velocityMisfits(), p.data.velocityWeight, found->velocityNoise);
  result.explainedVariance =
      1 - square(result.velocityMisfit * found->velocityNoise / p.constants.velocityScale);
  result.accelerationMisfit =
      overNoise(model.accelerationMisfits(), p.data.accelerationWeight, found->accelerationNoise);
  if ((result.aborted = !goOn(progress, 1))) return result;
  writeFields(model, p, result);
  if (options.body) {
    if ((result.aborted = !goOn(progress, 1))) return result;
    wallLayer(*options.body, options.grid.spacing[0], result);
    maskBody(*options.body, result);
  }
  return result;
}

} // namespace rimflow
