#include "SphereCapture.h"

#include "FlowAroundSphere.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace rimflow {
namespace {

constexpr double Pi = 3.14159265358979323846;
constexpr double CellsPerRadius = 6;
constexpr double InnerBall =
    0.71; // R minus the farthest node and half a cell's diagonal: 1 - 2 (sqrt(3)/2)/6
constexpr std::size_t MaximumCells = 8000000;

/// Counts on a grid over the seeded box, and sums over boxes and balls of cells.
class CountGrid {
public:
  /// The balls of `bodies` are filled with the seeding density, so that nothing is missing there.
  CountGrid(const ParticleIndex& particles, double cell, const std::vector<Body>& bodies,
            const SeedingDensity& seeding)
      : box_(particles.box()) {
    const Eigen::Vector3d size = box_.size().cwiseMax(1e-9);
    cell = std::max(cell, std::cbrt(size.prod() / MaximumCells));
    for (int a = 0; a < 3; ++a) {
      n[a] = std::max(1, int(std::lround(size[a] / cell)));
      h[a] = size[a] / n[a];
    }
    // rows: sums along x from the row's start; integral: sums over the box from the first corner.
    rows_.assign(std::size_t(n[0] + 1) * n[1] * n[2], 0);
    for (std::size_t p = 0; p < particles.size(); ++p) {
      const Eigen::Vector3d g = (particles.position(p) - box_.lower).cwiseQuotient(h);
      const int i = int(std::floor(g[0])), j = int(std::floor(g[1])), k = int(std::floor(g[2]));
      if (i < 0 || j < 0 || k < 0 || i > n[0] || j > n[1] || k > n[2]) continue; // strays; == n is the face
      ++rows_[row(std::min(j, n[1] - 1), std::min(k, n[2] - 1)) + std::min(i, n[0] - 1) + 1];
    }
    if (!bodies.empty()) fill(bodies, seeding);
    for (int k = 0; k < n[2]; ++k)
      for (int j = 0; j < n[1]; ++j)
        for (int i = 0; i < n[0]; ++i) rows_[row(j, k) + i + 1] += rows_[row(j, k) + i];
    integral_.assign(std::size_t(n[0] + 1) * (n[1] + 1) * (n[2] + 1), 0);
    for (int k = 0; k < n[2]; ++k)
      for (int j = 0; j < n[1]; ++j)
        for (int i = 0; i <= n[0]; ++i)
          integral_[corner(i, j + 1, k + 1)] = rows_[row(j, k) + i] + integral_[corner(i, j, k + 1)] +
                                               integral_[corner(i, j + 1, k)] - integral_[corner(i, j, k)];
  }

  /// Particles and cells in the box of cells around (i, j, k) with half width `half` in cells, within the
  /// grid.
  struct Sum {
    double particles = 0, cells = 0;
  };
  Sum around(int i, int j, int k, const std::array<int, 3>& half) const {
    const int at[3] = {i, j, k};
    int lo[3], hi[3];
    for (int a = 0; a < 3; ++a) {
      lo[a] = std::max(0, at[a] - half[a]);
      hi[a] = std::min(n[a], at[a] + half[a] + 1);
    }
    auto f = [this](int x, int y, int z) { return double(integral_[corner(x, y, z)]); };
    return {f(hi[0], hi[1], hi[2]) - f(lo[0], hi[1], hi[2]) - f(hi[0], lo[1], hi[2]) -
                f(hi[0], hi[1], lo[2]) + f(lo[0], lo[1], hi[2]) + f(lo[0], hi[1], lo[2]) +
                f(hi[0], lo[1], lo[2]) - f(lo[0], lo[1], lo[2]),
            double(hi[0] - lo[0]) * (hi[1] - lo[1]) * (hi[2] - lo[2])};
  }

  /// A ball of cells: rows at (dj, dk) that reach `half` cells to either side.
  struct Row {
    int dj, dk, half;
  };
  std::vector<Row> ball(double radius) const {
    std::vector<Row> rows;
    const int mj = int(radius / h[1]), mk = int(radius / h[2]);
    for (int dk = -mk; dk <= mk; ++dk)
      for (int dj = -mj; dj <= mj; ++dj) {
        const double left = radius * radius - std::pow(dj * h[1], 2) - std::pow(dk * h[2], 2);
        if (left >= 0) rows.push_back({dj, dk, int(std::sqrt(left) / h[0])});
      }
    return rows;
  }
  Sum inBall(const std::vector<Row>& ball, int i, int j, int k) const {
    std::int64_t particles = 0, cells = 0;
    for (const Row& r : ball) {
      const int y = j + r.dj, z = k + r.dk;
      if (y < 0 || y >= n[1] || z < 0 || z >= n[2]) continue;
      const int lo = std::max(0, i - r.half), hi = std::min(n[0], i + r.half + 1);
      const std::uint32_t* sums = rows_.data() + row(y, z);
      particles += sums[hi] - sums[lo];
      cells += hi - lo;
    }
    return {double(particles), double(cells)};
  }

  Eigen::Vector3d centre(std::size_t cell) const {
    const std::size_t i = cell % n[0], j = cell / n[0] % n[1], k = cell / n[0] / n[1];
    return box_.lower + Eigen::Vector3d(i + 0.5, j + 0.5, k + 0.5).cwiseProduct(h);
  }

  std::array<int, 3> n{1, 1, 1};
  Eigen::Vector3d h = Eigen::Vector3d::Ones();

private:
  /// Whole particles: what a cell's share leaves over goes to the next cell.
  void fill(const std::vector<Body>& bodies, const SeedingDensity& seeding) {
    double left = 0;
    for (int k = 0; k < n[2]; ++k)
      for (int j = 0; j < n[1]; ++j)
        for (int i = 0; i < n[0]; ++i) {
          const Eigen::Vector3d x = box_.lower + Eigen::Vector3d(i + 0.5, j + 0.5, k + 0.5).cwiseProduct(h);
          if (std::none_of(bodies.begin(), bodies.end(), [&x](const Body& b) { return b.contains(x); }))
            continue;
          left += seeding.at(x) * h.prod();
          rows_[row(j, k) + i + 1] = std::uint32_t(left);
          left -= std::floor(left);
        }
  }
  std::size_t row(int j, int k) const { return std::size_t(n[0] + 1) * (j + std::size_t(n[1]) * k); }
  std::size_t corner(int i, int j, int k) const {
    return i + std::size_t(n[0] + 1) * (j + std::size_t(n[1] + 1) * k);
  }
  Box box_;
  std::vector<std::uint32_t> rows_, integral_;
};

/// Deviance of k where n are expected; 0 when nothing is missing.
float deficit(double k, double n) { return float(k >= n ? 0 : n - k + (k > 0 ? k * std::log(k / n) : 0)); }

/// Per cell, how strongly particles are missing in the inner ball around it. Empty: aborted.
std::vector<float> deficits(const CountGrid& grid, double radius, const Progress& progress) {
  const auto ball = grid.ball(InnerBall * radius);
  std::array<int, 3> inner, outer; // the surroundings: between cubes of half width 1.2 R and 2.2 R
  for (int a = 0; a < 3; ++a) {
    inner[a] = int(std::lround(1.2 * radius / grid.h[a]));
    outer[a] = int(std::lround(2.2 * radius / grid.h[a]));
  }
  std::vector<float> score(std::size_t(grid.n[0]) * grid.n[1] * grid.n[2]);
  const auto layer = [&](std::size_t piece, const Progress&) {
    const int k = int(piece);
    for (int j = 0; j < grid.n[1]; ++j)
      for (int i = 0; i < grid.n[0]; ++i) {
        const auto within = grid.inBall(ball, i, j, k);
        const auto near = grid.around(i, j, k, inner), far = grid.around(i, j, k, outer);
        const double cells = far.cells - near.cells;
        const double expected = cells > 0 ? within.cells * (far.particles - near.particles) / cells : 0;
        score[i + std::size_t(grid.n[0]) * (j + std::size_t(grid.n[1]) * k)] =
            deficit(within.particles, expected);
      }
  };
  if (!forEachPiece(std::size_t(grid.n[2]), progress, layer)) score.clear();
  return score;
}

/// The cells of highest score whose centres are at least `apart` from each other.
std::vector<Eigen::Vector3d> peaks(const CountGrid& grid, const std::vector<float>& score, double apart,
                                   int count) {
  // Only cells that are the best among their neighbours can be peaks.
  std::vector<std::size_t> order;
  const std::array<int, 3>& n = grid.n;
  for (int k = 0; k < n[2]; ++k)
    for (int j = 0; j < n[1]; ++j)
      for (int i = 0; i < n[0]; ++i) {
        const std::size_t c = i + std::size_t(n[0]) * (j + std::size_t(n[1]) * k);
        if (score[c] <= 0) continue;
        const bool best =
            (i == 0 || score[c] >= score[c - 1]) && (i + 1 == n[0] || score[c] >= score[c + 1]) &&
            (j == 0 || score[c] >= score[c - n[0]]) && (j + 1 == n[1] || score[c] >= score[c + n[0]]) &&
            (k == 0 || score[c] >= score[c - std::size_t(n[0]) * n[1]]) &&
            (k + 1 == n[2] || score[c] >= score[c + std::size_t(n[0]) * n[1]]);
        if (best) order.push_back(c);
      }
  std::stable_sort(order.begin(), order.end(),
                   [&](std::size_t a, std::size_t b) { return score[a] > score[b]; });
  std::vector<Eigen::Vector3d> chosen;
  for (std::size_t c : order) {
    const Eigen::Vector3d x = grid.centre(c);
    if (std::all_of(chosen.begin(), chosen.end(), [&](const auto& y) { return (x - y).norm() >= apart; }))
      chosen.push_back(x);
    if (int(chosen.size()) == count) break;
  }
  return chosen;
}

} // namespace

double boundedFlowEvidence(const ParticleIndex& particles, const float* velocities, const VoidEstimate& place,
                           double alarm, double limit) {
  const double most = -FlowShare * limit;
  if (!velocities || alarm <= limit || alarm - most > limit) return 0;
  FlowEvidenceOptions options;
  options.radius = 0.5 * place.diameter;
  std::vector<WallParticle> around;
  particles.forEachWithin(place.centre, (1 + options.reach) * options.radius,
                          [&](std::uint32_t id, float x, float y, float z) {
                            const float* u = velocities + 3 * std::size_t(id);
                            around.push_back({{x, y, z}, {u[0], u[1], u[2]}, -1});
                          });
  return std::min(most, flowEvidence(around, options).logBayesFactor);
}

bool closedLikeASphere(const ParticleIndex& particles, const std::vector<Body>& others,
                       const VoidEstimate& estimate) {
  constexpr double Evidence = 4;       // nats
  constexpr double LeastGhosts = 0.02; // of the fluid's density: a single ghost proves little
  constexpr double MostGhosts = 0.25;  // more than that is thin fluid, such as in the core of a vortex
  const double radius = 0.5 * estimate.diameter;
  const Eigen::Vector3d& centre = estimate.centre;
  struct Part {
    double particles = 0, volume = 0, share = 0; // share of the part that is fluid, and the volume of that
  };
  const auto part = [&](double inner, double outer, const Eigen::Vector3d* axis) {
    const double cosine = std::cos(Pi / 6);
    Part p;
    particles.forEachWithin(centre, outer * radius, [&](std::uint32_t, float dx, float dy, float dz) {
      const Eigen::Vector3d r(dx, dy, dz);
      const double distance = r.norm();
      p.particles +=
          distance > inner * radius && (!axis || r.dot(*axis) > cosine * distance) &&
          std::none_of(others.begin(), others.end(), [&](const Body& b) { return b.contains(centre + r); });
    });
    int fluid = 0, all = 0;
    for (const Eigen::Vector3d& e : evenDirections()) {
      if (axis && e.dot(*axis) < cosine) continue;
      for (double third : {1 / 6., 0.5, 5 / 6.}) {
        const double r =
            radius * std::cbrt(std::pow(inner, 3) + third * (std::pow(outer, 3) - std::pow(inner, 3)));
        const Eigen::Vector3d x = centre + r * e;
        ++all;
        fluid += particles.box().contains(x) &&
                 std::none_of(others.begin(), others.end(), [&x](const Body& b) { return b.contains(x); });
      }
    }
    const double volume =
        (ballVolume(outer * radius) - ballVolume(inner * radius)) * (axis ? 0.5 * (1 - cosine) : 1);
    p.share = all > 0 ? double(fluid) / all : 0;
    p.volume = volume * p.share;
    return p;
  };
  // The fluid's density from the shell a little off the wall: n(x) is blurred next to a stripe or a wake.
  const Part fluid = part(1.2, 1.6, nullptr), core = part(0, 0.8, nullptr);
  if (fluid.particles == 0 || fluid.volume == 0 || core.volume == 0) return false;
  const double density = fluid.particles / fluid.volume;
  const double emptiness = std::max(LeastGhosts, core.particles / (core.volume * density));
  if (emptiness > MostGhosts) return false;
  // log P(n | fluid) - log P(n | as empty as the ball)
  const auto fluidRatio = [&](const Part& p) {
    return -p.particles * std::log(emptiness) - p.volume * density * (1 - emptiness);
  };
  if (fluidRatio(part(0.8, 0.95, nullptr)) > Evidence) return false;
  if (fluidRatio(part(1.05, 1.2, nullptr)) < -Evidence) return false;
  for (std::size_t d = 0; d < evenDirections().size() / 2; d += 8) { // half of the sphere
    double most = -1e30;
    for (double side : {1., -1.}) {
      const Eigen::Vector3d axis = side * evenDirections()[d];
      const Part cap = part(1, 1.6, &axis);
      if (cap.share > 0.3) most = std::max(most, fluidRatio(cap));
    }
    if (most > -1e30 && most < -Evidence) return false;
  }
  return true;
}

double independentPlaces(double volume, double radius) {
  return std::max(1., 40 * volume / ballVolume(radius));
}

double logFalseAlarm(const VoidEstimate& estimate, double places) {
  return std::min(0., std::log(places) + estimate.logChance);
}

double enclosure(const ParticleIndex& particles, const Eigen::Vector3d& centre, double radius) {
  std::vector<Eigen::Vector3d> directions;
  particles.forEachWithin(centre, 1.6 * radius, [&](std::uint32_t, float dx, float dy, float dz) {
    const Eigen::Vector3d r(dx, dy, dz);
    if (r.squaredNorm() >= radius * radius) directions.push_back(r.normalized());
  });
  // Cones of 25 degrees, wider where they would hold less than five of the particles.
  const double share =
      std::max(0.5 * (1 - std::cos(25 * Pi / 180)), 5. / std::max<std::size_t>(directions.size(), 5));
  const double cosine = 1 - 2 * std::min(share, 0.25);
  int populated = 0, all = 0;
  for (std::size_t d = 0; d < evenDirections().size(); d += 4, ++all)
    populated += std::any_of(directions.begin(), directions.end(),
                             [&](const auto& r) { return r.dot(evenDirections()[d]) > cosine; });
  return double(populated) / all;
}

CaptureResult captureSphere(const ParticleIndex& particles, SeedingDensity& seeding,
                            const VoidLikelihoodOptions& sphere, const CaptureOptions& options,
                            const Progress& progress, const float* velocities) {
  CaptureResult result;
  const double radius = 0.5 * sphere.diameter;
  if (particles.size() < 20) {
    result.reason = "only " + std::to_string(particles.size()) + " particles";
    return result;
  }
  seeding.exclude(sphere.others);
  const CountGrid grid(particles, radius / CellsPerRadius, sphere.others, seeding);
  result.reason = "aborted";
  const std::vector<float> score = deficits(grid, radius, part(progress, 0, 0.5));
  if (score.empty()) return result;
  const double limit = std::log(options.falseAlarm);
  const double places = independentPlaces(particles.box().volume(), radius);
  VoidLikelihoodOptions close = sphere;
  close.searchSide = 0.7 * radius;
  bool notch = false, open = false;
  struct Find {
    double alarm; ///< log false alarm with the flow's evidence
    double flow;  ///< that evidence
    VoidEstimate estimate;
  };
  std::vector<Find> finds;
  auto better = [](const Find& a, const Find& b) { return a.alarm < b.alarm; };
  auto judge = [&](const VoidEstimate& estimate) {
    const double alarm = logFalseAlarm(estimate, places);
    const double flow = boundedFlowEvidence(particles, velocities, estimate, alarm, limit);
    return Find{std::min(0., alarm - flow), flow, estimate};
  };
  const std::vector<Eigen::Vector3d> candidates =
      peaks(grid, score, 0.5 * radius, velocities ? options.flowCandidates : options.candidates);
  double looked = 0;
  for (const Eigen::Vector3d& candidate : candidates) {
    if (!goOn(progress, 0.5 + 0.2 * looked++ / double(candidates.size()))) return result;
    if (!clearOf(sphere.others, candidate, 0.6 * radius)) continue; // shadows of the other spheres
    const VoidEstimate estimate = roughVoid(particles, seeding, candidate, close);
    if (!clearOf(sphere.others, estimate.centre, 0.5 * estimate.diameter)) continue; // no room
    const Find find = judge(estimate);
    if (find.alarm < -3 && enclosure(particles, estimate.centre, radius) < LeastEnclosure)
      notch = true;
    else
      finds.push_back(find);
  }
  std::stable_sort(finds.begin(), finds.end(), better);
  if (!finds.empty()) {
    // In thin seeding the last particles matter: place the best few exactly.
    int placed = 0;
    for (std::size_t f = 0; f < std::min<std::size_t>(finds.size(), 6) && placed < 3; ++f) {
      close.searchSide = 0.2 * radius;
      const double from = 0.7 + 0.05 * double(f);
      const VoidEstimate exact =
          locateVoid(particles, seeding, finds[f].estimate.centre, close, part(progress, from, from + 0.04));
      if (!goOn(progress, from + 0.04)) return result;
      finds[f] = judge(exact);
      if (finds[f].alarm <= limit && !closedLikeASphere(particles, sphere.others, finds[f].estimate)) {
        open = true;
        finds[f].alarm = 0;
        continue;
      }
      ++placed;
      if (finds[f].alarm < 10 * limit) break; // beyond doubt
    }
    if (open && placed == 0)
      finds.resize(std::min<std::size_t>(finds.size(), 6)); // the rest was not looked at
    std::stable_sort(finds.begin(), finds.end(), better);
    const VoidEstimate best = finds.front().estimate;
    result.diameter = best.diameter;
    result.diameterSigma = best.diameterSigma;
    result.centre = best.centre;
    result.particlesInside = best.particlesInside;
    result.expectedInside = best.expectedInside;
    result.logFalseAlarm = finds.front().alarm;
    result.flowEvidence = finds.front().flow;
    for (const auto& other : finds)
      if ((other.estimate.centre - best.centre).norm() > sphere.diameter) {
        result.secondLogFalseAlarm = other.alarm;
        break;
      }
    result.found = result.logFalseAlarm <= limit;
  }
  result.reason.clear();
  if (!result.found) {
    char text[200];
    std::snprintf(
        text, sizeof text,
        "no void of the sphere's size: the emptiest ball holds %zu particles where %.1f are expected%s",
        result.particlesInside, result.expectedInside,
        open    ? " (emptier ones are not closed like a sphere of this diameter)"
        : notch ? " (emptier ones lie at the edge of the seeding)"
                : "");
    result.reason = text;
  }
  goOn(progress, 1);
  return result;
}

} // namespace rimflow
