#include "VICSharpProblem.h"

#include "MedianTest.h"
#include "VoidDistance.h"

#include <algorithm>
#include <cmath>
#include <memory>
#include <stdexcept>

namespace rimflow {
namespace {

constexpr std::size_t MinimumParticles = 20;
constexpr double InsideSmoothness = 0.01; // measured: Stokes flow, and a sphere at Re = 100
constexpr double MostWallPoints = 4e6;
constexpr double MostNodes = 1 << 28;
// Smaller fluctuations than this are rounding, and would not fit into the range of a float: m/s, m/s2
constexpr double LeastVelocity = 1e-12, LeastAcceleration = 1e-12;
// In mean particle spacings. A random cloud leaves a given ball of this size empty with probability 2e-11.
constexpr double VoidRadius = 1.8;

void check(const VICSharpTracks& t, const VICSharpOptions& o) {
  if (t.count == 0 || !t.positions || !t.velocities) throw std::invalid_argument("there are no particles");
  for (int a = 0; a < 3; ++a)
    if (o.grid.n[a] < 5 || !(o.grid.spacing[a] > 0))
      throw std::invalid_argument(
          "the grid needs at least 5 nodes along every axis and a spacing greater than 0");
  if (std::abs(o.grid.spacing[0] / o.grid.spacing[1] - 1) > 1e-6 ||
      std::abs(o.grid.spacing[0] / o.grid.spacing[2] - 1) > 1e-6)
    throw std::invalid_argument("the grid must have the same spacing along all axes");
  bool valid = o.maximumIterations >= 1 && o.tolerance > 0 && o.heldOut > 0 && o.heldOut < 0.5;
  for (double v :
       {o.viscosity, o.velocityNoise, o.accelerationNoise, o.leastVelocityNoise, o.leastAccelerationNoise,
        o.tolerance, o.padding, o.accelerationWeight, o.curvatureWeight, o.outliers})
    valid = valid && v >= 0 && std::isfinite(v);
  if (!valid)
    throw std::invalid_argument(
        "an option is negative, infinite, not a number or out of its range: viscosity, noise "
        "levels, weights and padding must be at least 0, and at least one iteration "
        "must be allowed");
}

double square(double v) { return v * v; }

/// The grid with `nodes` more nodes on every side.
Grid padded(const Grid& g, int nodes) {
  Grid p = g;
  for (int a = 0; a < 3; ++a) {
    p.n[a] += 2 * nodes;
    p.origin[a] -= nodes * g.spacing[a];
  }
  return p;
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

double rms(const std::vector<double>& values) {
  double sum = 0;
  for (double v : values) sum += v * v;
  return values.empty() ? 0 : std::sqrt(sum / double(values.size()));
}

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
  const double cells = 4 * M_PI * square(radius / h);
  if (!(cells < MostWallPoints))
    throw std::invalid_argument("the body is " + std::to_string(body.diameter / h) +
                                " grid spacings wide; a body of at most a thousand is expected");
  const int count = int(cells);
  for (int e = 0; e < count; ++e) {
    const double z = 1 - (2 * e + 1.) / count, s = std::sqrt(1 - z * z), phi = M_PI * (1 + std::sqrt(5.)) * e;
    const Eigen::Vector3d x = body.centre + radius * Eigen::Vector3d(s * std::cos(phi), s * std::sin(phi), z);
    if (!within(grid, x.data())) continue;
    const Eigen::Vector3d u = body.velocityAt(x);
    d.position.insert(d.position.end(), x.data(), x.data() + 3);
    for (int c = 0; c < 3; ++c) d.velocity.push_back(u[c] - d.meanVelocity[c]);
    d.velocityWeight.push_back(1);
    ++d.wallPoints;
    if (d.acceleration.empty()) continue;
    d.acceleration.insert(d.acceleration.end(), 3, 0);
    d.accelerationWeight.push_back(0);
  }
}

/// Tells the model of the body and of voids. They are walls that make vorticity.
void addWalls(const VICSharpOptions& options, VICSharpProblem& p) {
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
  if (!body) return;
  p.constants.insideSmoothness = InsideSmoothness;
  addWall(*body, options.grid.spacing[0], p.grid, p.data);
}

} // namespace

bool within(const Grid& g, const double* x) {
  for (int a = 0; a < 3; ++a)
    if (!(x[a] >= g.origin[a] && x[a] <= g.origin[a] + (g.n[a] - 1) * g.spacing[a])) return false;
  return true;
}

Grid coarseGrid(const Grid& fine, double factor) {
  Grid grid = fine;
  for (int a = 0; a < 3; ++a) {
    const double length = (fine.n[a] - 1) * fine.spacing[a];
    if (length < 4 * factor * fine.spacing[a]) continue; // five nodes at least
    grid.spacing[a] = fine.spacing[a] * factor;
    grid.n[a] = int(std::ceil(length / grid.spacing[a] - 1e-6)) + 1;
    grid.origin[a] = fine.origin[a] - 0.5 * ((grid.n[a] - 1) * grid.spacing[a] - length);
  }
  return grid;
}

void weighAccelerations(const VICSharpOptions& options, double velocityNoise, double accelerationNoise,
                        VICSharpConstants& k) {
  if (options.accelerationWeight > 0) {
    k.accelerationWeight = options.accelerationWeight;
    return;
  }
  const bool known = velocityNoise > 0 && accelerationNoise > 0;
  const double most = k.accelerationScale / std::max(k.frictionScale(), k.accelerationScale),
               ratio = velocityNoise * k.accelerationScale / (accelerationNoise * k.velocityScale);
  k.accelerationWeight = std::min(known ? std::clamp(ratio, 0.1, 0.5) : 0.3, most);
}

VICSharpProblem vicSharpProblem(const VICSharpTracks& tracks, const VICSharpOptions& options,
                                const Progress& progress) {
  check(tracks, options);
  VICSharpProblem p;
  Watched watch(progress);
  const Progress test = [&watch](double fraction) { return watch(0.8 * fraction); };
  // Gone altogether, not only of no weight: nothing is scaled, calibrated or judged by them.
  MedianTestResult tested;
  if (options.outliers > 0)
    tested = medianTest(tracks.positions, tracks.velocities, tracks.accelerations, tracks.count, {}, test);
  if ((p.aborted = !watch(0.8))) return p;
  const std::vector<unsigned char>& outlier = tested.outlier;
  p.localNoise = tested.velocityNoise;
  const auto among = [&](const Grid& grid) {
    return usable(tracks, grid, options.body, outlier, p.outliers);
  };
  p.spacing = std::cbrt(volume(options.grid) / double(among(options.grid).size()));
  p.margin = int(std::min(1e4, std::ceil(options.padding * p.spacing / options.grid.spacing[0] - 1e-6)));
  p.grid = padded(options.grid, p.margin);
  if (double(p.grid.n[0]) * p.grid.n[1] * p.grid.n[2] > MostNodes)
    throw std::invalid_argument(
        "with padding of " + std::to_string(options.padding) + " particle spacings, each " +
        std::to_string(p.spacing / options.grid.spacing[0]) + " nodes wide, the grid has " +
        std::to_string(p.grid.n[0]) + " x " + std::to_string(p.grid.n[1]) + " x " +
        std::to_string(p.grid.n[2]) +
        " nodes, more than 2^28: choose a larger spacing, closer to that of the particles");
  p.data = among(p.grid);
  std::array<double, 3>& mean = p.data.meanVelocity;
  const std::size_t n = p.data.size();
  for (std::size_t e = 0; e < 3 * n; ++e) mean[e % 3] += p.data.velocity[e] / double(n);
  for (std::size_t e = 0; e < 3 * n; ++e) p.data.velocity[e] -= mean[e % 3];

  VICSharpConstants& k = p.constants;
  k.viscosity = options.viscosity;
  k.particleSpacing = p.spacing;
  double speed = LeastVelocity;
  for (double m : mean) speed = std::max(speed, std::abs(m));
  const double su = rms(p.data.velocity), accelerated = rms(p.data.accelerationWeight), // of 0 and 1
      sa = accelerated > 0 ? rms(p.data.acceleration) / accelerated : 0;
  k.velocityScale = su > 1e-9 * speed ? su : speed; // fluid at rest
  k.accelerationScale = sa > LeastAcceleration ? sa : square(k.velocityScale) / p.spacing;
  if (sa <= LeastAcceleration) p.data.acceleration.clear(), p.data.accelerationWeight.clear();
  weighAccelerations(options, options.velocityNoise, options.accelerationNoise, k);
  k.curvatureWeight = options.curvatureWeight > 0 ? options.curvatureWeight : 0.0125;
  if ((p.aborted = !watch(0.9))) return p;
  addWalls(options, p);
  return p;
}

} // namespace rimflow
