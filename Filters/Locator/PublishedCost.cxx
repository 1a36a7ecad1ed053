#include "PublishedCost.h"

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <stdexcept>
#include <string>
#include <vector>

namespace rimflow {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;
using Function = std::function<double(const Vector3d&)>;

double ballVolume(double radius) { return 4.0 / 3 * M_PI * radius * radius * radius; }

/// How much of a node counts whose signed distance into a region is `depth` grid spacings: 0 to 1.
double part(double depth) { return std::clamp(depth + 0.5, 0.0, 1.0); }

/// Calls use(node, offset from x) for every fluid node of the grid within `radius` of x.
template <class Use>
void forEachNode(const FlowField& flow, const Vector3d& x, double radius, Use&& use) {
  const Grid& g = flow.grid;
  int low[3], high[3];
  for (int i = 0; i < 3; ++i) {
    low[i] = std::max(0, int(std::ceil((x[i] - radius - g.origin[i]) / g.spacing[i])));
    high[i] = std::min(g.n[i] - 1, int(std::floor((x[i] + radius - g.origin[i]) / g.spacing[i])));
  }
  for (int k = low[2]; k <= high[2]; ++k)
    for (int j = low[1]; j <= high[1]; ++j)
      for (int i = low[0]; i <= high[0]; ++i) {
        const std::size_t node = g.index(i, j, k);
        if (flow.mask && flow.mask[node]) continue;
        const auto p = g.position(i, j, k);
        use(node, Vector3d(p[0] - x[0], p[1] - x[1], p[2] - x[2]));
      }
}

/// The 99th percentile of value(node) over the fluid nodes within `radius` of x; 0 when there are none.
double percentile99(const FlowField& flow, const Vector3d& x, double radius,
                    const std::function<double(std::size_t)>& value) {
  std::vector<double> values;
  forEachNode(flow, x, radius, [&](std::size_t node, const Vector3d& r) {
    if (r.squaredNorm() < radius * radius) values.push_back(value(node));
  });
  if (values.empty()) return 0;
  const auto at = values.begin() + std::ptrdiff_t(0.99 * double(values.size() - 1));
  std::nth_element(values.begin(), at, values.end());
  return *at;
}

double meanSpacing(const Grid& g) { return (g.spacing[0] + g.spacing[1] + g.spacing[2]) / 3; }

Vector3d speedOf(const float* velocity, std::size_t node) {
  return {velocity[3 * node], velocity[3 * node + 1], velocity[3 * node + 2]};
}

void require(bool fine, const std::string& what) {
  if (!fine) throw std::invalid_argument(what);
}

/// The options with every "0: from the data" filled in.
PublishedCostOptions complete(const ParticleIndex& particles, const FlowField& flow, const Vector3d& guess,
                              PublishedCostOptions o) {
  require(o.diameter > 0, "the diameter is " + std::to_string(o.diameter) + " m; it must be greater than 0");
  require(o.up.norm() > 0, "the up direction has no length; give one such as (0, 1, 0)");
  require(o.a > 0 && o.b > 0 && o.c > o.b && o.e > 1,
          "the shells' radii must satisfy a > 0, 0 < b < c and e > 1");
  o.up.normalize();
  const double radius = 0.5 * o.diameter;
  if (o.searchSide <= 0) o.searchSide = o.diameter;
  if (o.step <= 0) o.step = meanSpacing(flow.grid);
  if (o.velocityScale <= 0)
    o.velocityScale = percentile99(flow, guess, 2 * radius,
                                   [&](std::size_t n) { return speedOf(flow.velocity, n).norm(); });
  if (o.vortexScale <= 0)
    o.vortexScale =
        percentile99(flow, guess, o.e * radius, [&](std::size_t n) { return std::abs(double(flow.q[n])); });
  require(o.velocityScale > 0 && o.vortexScale > 0,
          "the flow around the guess is at rest or not on the grid, so the criteria cannot be normalised; "
          "give a guess inside the grid");
  if (o.seedingDensity <= 0)
    o.seedingDensity = double(particles.size()) /
                       std::max(particles.box().volume() - ballVolume(radius), ballVolume(radius));
  require(o.seedingDensity > 0, "there are no particles");
  return o;
}

// Weights of f(x - 2h), f(x - h), f(x + h), f(x + 2h); fourth order.
constexpr double Offsets[4] = {-2, -1, 1, 2};
constexpr double First[4] = {1.0 / 12, -8.0 / 12, 8.0 / 12, -1.0 / 12};
constexpr double Second[4] = {-1.0 / 12, 16.0 / 12, 16.0 / 12, -1.0 / 12}; // and -30/12 at x

Vector3d gradient(const Function& f, const Vector3d& x, double h) {
  Vector3d g = Vector3d::Zero();
  for (int i = 0; i < 3; ++i)
    for (int o = 0; o < 4; ++o) g[i] += First[o] * f(x + Offsets[o] * h * Vector3d::Unit(i)) / h;
  return g;
}

Matrix3d hessian(const Function& f, const Vector3d& x, double h) {
  Matrix3d m;
  const double here = f(x);
  for (int i = 0; i < 3; ++i) {
    m(i, i) = -30.0 / 12 * here;
    for (int o = 0; o < 4; ++o) m(i, i) += Second[o] * f(x + Offsets[o] * h * Vector3d::Unit(i));
    for (int j = 0; j < i; ++j) {
      m(i, j) = 0;
      for (int o = 0; o < 4; ++o)
        for (int p = 0; p < 4; ++p)
          m(i, j) += First[o] * First[p] *
                     f(x + h * (Offsets[o] * Vector3d::Unit(i) + Offsets[p] * Vector3d::Unit(j)));
      m(j, i) = m(i, j);
    }
  }
  return m / (h * h);
}

struct Minimum {
  Vector3d x;
  double value = 0, gradientNorm = 0;
  int iterations = 0;
  Convergence convergence = Convergence::Iterations;
};

/// Polak-Ribiere conjugate gradient (restarted when beta < 0) with backtracking line search; the first step
/// is one grid spacing long. inside(x) bounds the search.
Minimum conjugateGradient(const Function& f, const Vector3d& start, const PublishedCostOptions& o,
                          const std::function<bool(const Vector3d&)>& inside) {
  Minimum m{start, f(start)};
  Vector3d g = gradient(f, m.x, o.step), direction = -g;
  double length = o.step;
  for (; m.iterations < o.maximumIterations; ++m.iterations) {
    m.gradientNorm = g.norm();
    if (m.gradientNorm * 0.5 * o.diameter < o.tolerance) {
      m.convergence = Convergence::Gradient;
      return m;
    }
    if (direction.dot(g) >= 0) direction = -g;
    double alpha = length / direction.norm();
    Vector3d next = m.x;
    double value = m.value;
    bool lower = false;
    for (int halvings = 0; halvings < 14 && !lower; ++halvings, alpha *= 0.5) {
      next = m.x + alpha * direction;
      if (!inside(next)) continue;
      value = f(next);
      lower = value < m.value + 1e-4 * alpha * g.dot(direction); // Armijo
    }
    if (!lower) {
      if (direction == -g) {
        m.convergence = Convergence::NoDescent;
        return m;
      }
      direction = -g; // once more, straight downhill
      continue;
    }
    length = std::min(2 * (next - m.x).norm(), o.step);
    m.x = next;
    m.value = value;
    const Vector3d last = g;
    g = gradient(f, m.x, o.step);
    const double beta = std::max(0.0, g.dot(g - last) / last.squaredNorm()); // Polak-Ribiere
    direction = -g + beta * direction;
  }
  m.gradientNorm = g.norm();
  return m;
}

/// Where the fewest particles lie, on a grid of R/4 in the search cube; the middle one of several.
Vector3d emptiestPlace(const ParticleIndex& particles, const Vector3d& guess, const PublishedCostOptions& o) {
  const double radius = 0.5 * o.diameter;
  const int half = std::max(1, int(std::lround(0.5 * o.searchSide / (0.25 * radius))));
  const double spacing = 0.5 * o.searchSide / half;
  std::vector<Vector3d> emptiest;
  std::size_t fewest = std::numeric_limits<std::size_t>::max();
  for (int k = -half; k <= half; ++k)
    for (int j = -half; j <= half; ++j)
      for (int i = -half; i <= half; ++i) {
        const Vector3d x = guess + spacing * Vector3d(i, j, k);
        const std::size_t count = particles.countWithin(x, radius);
        if (count < fewest) emptiest.clear();
        if (count <= fewest) emptiest.push_back(x);
        fewest = std::min(fewest, count);
      }
  Vector3d middle = Vector3d::Zero();
  for (const Vector3d& x : emptiest) middle += x / double(emptiest.size());
  return *std::min_element(emptiest.begin(), emptiest.end(), [&](const Vector3d& p, const Vector3d& q) {
    return (p - middle).squaredNorm() < (q - middle).squaredNorm();
  });
}

} // namespace

Criteria publishedCriteria(const ParticleIndex& particles, const FlowField& flow, const Vector3d& x,
                           const PublishedCostOptions& o) {
  const double radius = 0.5 * o.diameter, h = meanSpacing(flow.grid);
  Criteria c;
  c.density = double(particles.countWithin(x, radius)) / ballVolume(radius) / o.seedingDensity;

  double inner = 0, innerWeight = 0, outer = 0, outerWeight = 0, core = 0, coreWeight = 0, shell = 0,
         shellWeight = 0;
  const double reach = radius * std::max({o.a, o.c, o.e}) + h;
  forEachNode(flow, x, reach, [&](std::size_t node, const Vector3d& r) {
    const double distance = r.norm();
    const auto within = [&](double factor) { return part((factor * radius - distance) / h); };
    const double upper = part(r.dot(o.up) / h), speed = speedOf(flow.velocity, node).dot(o.up),
                 q = flow.q[node];
    const double in = upper * within(o.a), out = upper * (within(o.c) - within(o.b));
    const double ball = within(o.a), around = within(o.e) - within(1);
    inner += in * speed, innerWeight += in;
    outer += out * speed, outerWeight += out;
    core += ball * q, coreWeight += ball;
    shell += around * q, shellWeight += around;
  });
  const auto mean = [](double sum, double weight) { return weight > 0 ? sum / weight : 0; };
  c.velocityIn = mean(inner, innerWeight) / o.velocityScale;
  c.velocityOut = mean(outer, outerWeight) / o.velocityScale;
  c.vortexIn = o.a * o.a * o.a * mean(core, coreWeight) / o.vortexScale; // over the volume of radius R
  c.vortexOut = mean(shell, shellWeight) / o.vortexScale;
  return c;
}

double publishedCost(const Criteria& c, const PublishedCostOptions& o) {
  return o.weightVoid * c.density + o.weightVelocity * (-c.velocityIn + c.velocityOut) +
         o.weightVortex * (c.vortexIn - c.vortexOut);
}

PublishedEstimate minimisePublishedCost(const ParticleIndex& particles, const FlowField& flow,
                                        const Vector3d& guess, const PublishedCostOptions& given) {
  const PublishedCostOptions o = complete(particles, flow, guess, given);
  const auto inside = [&](const Vector3d& x) {
    return (x - guess).cwiseAbs().maxCoeff() <= 0.5 * o.searchSide;
  };
  const auto costWith = [&](double void_, double velocity, double vortex) {
    PublishedCostOptions alone = o;
    alone.weightVoid = void_, alone.weightVelocity = velocity, alone.weightVortex = vortex;
    return [&particles, &flow, alone](const Vector3d& x) {
      return publishedCost(publishedCriteria(particles, flow, x, alone), alone);
    };
  };
  const Function cost = costWith(o.weightVoid, o.weightVelocity, o.weightVortex);
  const Vector3d start = emptiestPlace(particles, guess, o);
  const Minimum m = conjugateGradient(cost, start, o, inside);

  PublishedEstimate e;
  e.centre = m.x;
  e.cost = m.value;
  e.gradientNorm = m.gradientNorm;
  e.iterations = m.iterations;
  e.convergence = m.convergence;
  e.particlesInside = particles.countWithin(m.x, 0.5 * o.diameter);
  const Matrix3d h = hessian(cost, m.x, o.step);
  e.positiveDefinite = h.llt().info() == Eigen::Success;
  if (e.positiveDefinite) e.covariance = h.inverse();
  e.voidMinimiser = conjugateGradient(costWith(1, 0, 0), start, o, inside).x;
  e.velocityMinimiser = conjugateGradient(costWith(0, 1, 0), m.x, o, inside).x;
  e.vortexMinimiser = conjugateGradient(costWith(0, 0, 1), m.x, o, inside).x;
  return e;
}

} // namespace rimflow
