#include "PublishedCost.h"

#include <Eigen/Eigenvalues>
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
inline float part(float depth) {
  const float share = depth + 0.5f;
  return share < 0 ? 0 : share > 1 ? 1 : share; // std::clamp is not vectorised
}

/// Calls use(node, offset from x) for every fluid node of the grid within `radius` of x.
template <class Use>
void forEachNode(const FlowField& flow, const Vector3d& x, double radius, Use&& use) {
  const Grid& g = flow.grid;
  forEachNodeNear(g, x.data(), radius, [&](int i, int j, int k) {
    const std::size_t node = g.index(i, j, k);
    if (flow.mask && flow.mask[node]) return;
    const auto p = g.position(i, j, k);
    use(node, Vector3d(p[0] - x[0], p[1] - x[1], p[2] - x[2]));
  });
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
  require(o.up.allFinite(), "the up direction is no direction; give one such as (0, 1, 0), or (0, 0, 0)");
  require(o.a > 0 && o.b > 0 && o.c > o.b && o.e > 1,
          "the shells' radii must satisfy a > 0, 0 < b < c and e > 1");
  o.up = o.up.norm() > 0 ? o.up.normalized() : directionOfMotion(flow, guess, o.diameter);
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

/// publishedCriteria at many places: what it needs of the flow is laid out in rows once, which the processor
/// then goes through several nodes at a time. Sums along a row are floats, sums of rows doubles.
class CriteriaSums {
public:
  /// For candidates within `margin` of `middle` along each axis.
  CriteriaSums(const FlowField& flow, const Vector3d& middle, double margin, const PublishedCostOptions& o)
      : h_(meanSpacing(flow.grid)), reach_(0.5 * o.diameter * std::max({o.a, o.c, o.e}) + h_), options_(o) {
    const Grid& g = flow.grid;
    for (int a = 0; a < 3; ++a) {
      const double far = margin + reach_;
      const int low = std::max(0, int(std::ceil((middle[a] - far - g.origin[a]) / g.spacing[a])));
      const int high = std::min(g.n[a] - 1, int(std::floor((middle[a] + far - g.origin[a]) / g.spacing[a])));
      grid_.n[a] = std::max(0, high - low + 1);
      grid_.origin[a] = g.origin[a] + low * g.spacing[a];
      grid_.spacing[a] = g.spacing[a];
      low_[a] = low;
    }
    rise_.resize(grid_.size()), q_.resize(grid_.size()), fluid_.resize(grid_.size());
    for (int k = 0; k < grid_.n[2]; ++k)
      for (int j = 0; j < grid_.n[1]; ++j)
        for (int i = 0; i < grid_.n[0]; ++i) {
          const std::size_t to = grid_.index(i, j, k), from = g.index(low_[0] + i, low_[1] + j, low_[2] + k);
          if (flow.mask && flow.mask[from]) continue; // stays 0, and counts for 0
          rise_[to] = float(speedOf(flow.velocity, from).dot(o.up));
          q_[to] = flow.q[from];
          fluid_[to] = 1;
        }
  }

  /// The criteria of the flow at x; the density is left at 0.
  Criteria at(const Vector3d& x) const {
    Sum in, out, core, shell;
    const Range rows = range(1, x[1], reach_), layers = range(2, x[2], reach_);
    for (int k = layers.first; k <= layers.last; ++k)
      for (int j = rows.first; j <= rows.last; ++j) addRow(x, j, k, in, out, core, shell);
    const PublishedCostOptions& o = options_;
    Criteria c;
    c.velocityIn = in.mean() / o.velocityScale;
    c.velocityOut = out.mean() / o.velocityScale;
    c.vortexIn = o.a * o.a * o.a * core.mean() / o.vortexScale; // over the volume of radius R
    c.vortexOut = shell.mean() / o.vortexScale;
    return c;
  }

private:
  struct Sum {
    double value = 0, weight = 0;
    double mean() const { return weight > 0 ? value / weight : 0; }
  };
  struct Range {
    int first = 0, last = -1;
  };

  /// The nodes within `reach` of x along an axis.
  Range range(int axis, double x, double reach) const {
    const double from = x - grid_.origin[axis], h = grid_.spacing[axis];
    return {std::max(0, int(std::ceil((from - reach) / h))),
            std::min(grid_.n[axis] - 1, int(std::floor((from + reach) / h)))};
  }

  void addRow(const Vector3d& x, int j, int k, Sum& in, Sum& out, Sum& core, Sum& shell) const {
    const PublishedCostOptions& o = options_;
    const double y = grid_.origin[1] + j * grid_.spacing[1] - x[1],
                 z = grid_.origin[2] + k * grid_.spacing[2] - x[2];
    const double aside = y * y + z * z, left = reach_ * reach_ - aside;
    if (left <= 0) return;
    const Range nodes = range(0, x[0], std::sqrt(left));
    const std::size_t first = grid_.index(0, j, k);
    const float *rise = rise_.data() + first, *q = q_.data() + first, *fluid = fluid_.data() + first;
    // lengths in units of the spacing
    const float start = float((grid_.origin[0] - x[0]) / h_), step = float(grid_.spacing[0] / h_);
    const float aside2 = float(aside / (h_ * h_)), radius = float(0.5 * o.diameter / h_);
    const float a = float(o.a) * radius, b = float(o.b) * radius, c = float(o.c) * radius,
                e = float(o.e) * radius;
    const float up = float(o.up[0]), upAside = float((o.up[1] * y + o.up[2] * z) / h_);
    float s0 = 0, s1 = 0, s2 = 0, s3 = 0, s4 = 0, s5 = 0, s6 = 0, s7 = 0;
#pragma omp simd reduction(+ : s0, s1, s2, s3, s4, s5, s6, s7)
    for (int i = nodes.first; i <= nodes.last; ++i) {
      const float along = start + float(i) * step, distance = std::sqrt(along * along + aside2);
      const float upper = fluid[i] * part(up * along + upAside);
      const float ball = part(a - distance);
      const float inner = upper * ball, outer = upper * (part(c - distance) - part(b - distance));
      const float centre = fluid[i] * ball,
                  around = fluid[i] * (part(e - distance) - part(radius - distance));
      s0 += inner, s1 += inner * rise[i];
      s2 += outer, s3 += outer * rise[i];
      s4 += centre, s5 += centre * q[i];
      s6 += around, s7 += around * q[i];
    }
    in.weight += double(s0), in.value += double(s1);
    out.weight += double(s2), out.value += double(s3);
    core.weight += double(s4), core.value += double(s5);
    shell.weight += double(s6), shell.value += double(s7);
  }

  double h_, reach_;
  PublishedCostOptions options_;
  Grid grid_; // the part of the flow's grid that is needed
  int low_[3];
  std::vector<float> rise_, q_, fluid_; // u.up, Q, and 1 where a node counts
};

double densityCriterion(const ParticleIndex& particles, const Vector3d& x, const PublishedCostOptions& o) {
  const double radius = 0.5 * o.diameter;
  return double(particles.countWithin(x, radius)) / ballVolume(radius) / o.seedingDensity;
}

} // namespace

Criteria publishedCriteria(const ParticleIndex& particles, const FlowField& flow, const Vector3d& x,
                           const PublishedCostOptions& o) {
  Criteria c = CriteriaSums(flow, x, 0, o).at(x);
  c.density = densityCriterion(particles, x, o);
  return c;
}

Vector3d directionOfMotion(const FlowField& flow, const Vector3d& centre, double diameter) {
  Vector3d sum = Vector3d::Zero();
  forEachNode(flow, centre, diameter, [&](std::size_t node, const Vector3d& r) {
    const Vector3d u = speedOf(flow.velocity, node);
    if (r.norm() < diameter && u.allFinite()) sum += u.squaredNorm() * u;
  });
  return sum.norm() > 0 ? sum.normalized() : Vector3d::UnitY();
}

double publishedCost(const Criteria& c, const PublishedCostOptions& o) {
  return o.weightVoid * c.density + o.weightVelocity * (-c.velocityIn + c.velocityOut) +
         o.weightVortex * (c.vortexIn - c.vortexOut);
}

PublishedEstimate minimisePublishedCost(const ParticleIndex& particles, const FlowField& flow,
                                        const Vector3d& guess, const PublishedCostOptions& given) {
  const PublishedCostOptions o = complete(particles, flow, guess, given);
  const CriteriaSums sums(flow, guess, 0.5 * o.searchSide + 2 * o.step, o);
  const auto inside = [&](const Vector3d& x) {
    return (x - guess).cwiseAbs().maxCoeff() <= 0.5 * o.searchSide;
  };
  const auto costWith = [&](double void_, double velocity, double vortex) {
    PublishedCostOptions alone = o;
    alone.weightVoid = void_, alone.weightVelocity = velocity, alone.weightVortex = vortex;
    return [&particles, &sums, alone](const Vector3d& x) {
      Criteria c; // only what counts
      if (alone.weightVelocity != 0 || alone.weightVortex != 0) c = sums.at(x);
      if (alone.weightVoid != 0) c.density = densityCriterion(particles, x, alone);
      return publishedCost(c, alone);
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
  // J is a sum of floats: a curvature that changes it by less than 1e-4 over one step is none.
  e.positiveDefinite = Eigen::SelfAdjointEigenSolver<Matrix3d>(h).eigenvalues()[0] * o.step * o.step > 1e-4;
  if (e.positiveDefinite) e.covariance = h.inverse();
  e.voidMinimiser = conjugateGradient(costWith(1, 0, 0), start, o, inside).x;
  e.velocityMinimiser = conjugateGradient(costWith(0, 1, 0), m.x, o, inside).x;
  e.vortexMinimiser = conjugateGradient(costWith(0, 0, 1), m.x, o, inside).x;
  return e;
}

} // namespace rimflow
