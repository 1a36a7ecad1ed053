#include "TrackSynthesis.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <sstream>
#include <stdexcept>
#include <string>

namespace rimflow {
namespace {

using Eigen::Vector3d;
using Image = std::array<int, 3>; // which copy of a periodic seed box a tracer has moved into

constexpr double StepFraction = 0.1; // Runge-Kutta step in units of the flow's time scale
constexpr int ShortestGhost = 4;     // snapshots

/// Random numbers without a history: each is a function of the indices that lead to it, so that any snapshot
/// can be asked for first. at(i) is the i-th jump of SplitMix64 (Steele, Lea & Flood 2014).
class RandomTree {
public:
  explicit RandomTree(std::uint64_t state) : state_(state) {}

  RandomTree at(std::uint64_t index) const {
    std::uint64_t z = state_ + (index + 1) * 0x9e3779b97f4a7c15u;
    z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9u;
    z = (z ^ (z >> 27)) * 0x94d049bb133111ebu;
    return RandomTree(z ^ (z >> 31));
  }
  /// In (0, 1).
  double uniform(std::uint64_t index) const { return (double(at(index).state_ >> 11) + 0.5) * 0x1p-53; }
  /// Three independent standard normal numbers (Box & Muller 1958); uses indices 4 n to 4 n + 3.
  Vector3d normal(std::uint64_t n) const {
    const double r = std::sqrt(-2 * std::log(uniform(4 * n))),
                 s = std::sqrt(-2 * std::log(uniform(4 * n + 1)));
    const double a = 2 * M_PI * uniform(4 * n + 2), b = 2 * M_PI * uniform(4 * n + 3);
    return {r * std::cos(a), r * std::sin(a), s * std::cos(b)};
  }

private:
  std::uint64_t state_;
};
enum Branch { SeedPlace, NoiseBranch, DropOutBranch, WakeBranch, GhostBranch };

struct Box {
  Vector3d low, high;

  double volume() const { return (high - low).prod(); }
  void extend(const Vector3d& x) {
    low = low.cwiseMin(x);
    high = high.cwiseMax(x);
  }
  double distanceTo(const Vector3d& x) const { return (low - x).cwiseMax(x - high).cwiseMax(0.).norm(); }
};

/// x itself, or the nearest place on the wall when x is inside.
Vector3d outsideWall(const AnalyticFlow& flow, const Vector3d& x, double t) {
  if (!flow.hasWall()) return x;
  const Body body = flow.bodyAt(t);
  const Vector3d r = x - body.centre;
  const double wall = 0.5 * body.diameter * (1 + 1e-12);
  return r.squaredNorm() < wall * wall ? Vector3d(body.centre + wall * r.normalized()) : x;
}

/// Where the tracer that is at x at time t is at time `end`, later or earlier.
Vector3d carry(const AnalyticFlow& flow, Vector3d x, double t, double end) {
  for (bool arrived = t == end; !arrived;) {
    const double steps = std::ceil(std::abs(end - t) / (StepFraction * flow.timeScale(x, t)));
    arrived = !(steps > 1);
    const double next = arrived ? end : t + (end - t) / steps, h = next - t, middle = t + 0.5 * h;
    const Vector3d k1 = flow.fluidVelocity(x, t), k2 = flow.fluidVelocity(x + 0.5 * h * k1, middle),
                   k3 = flow.fluidVelocity(x + 0.5 * h * k2, middle),
                   k4 = flow.fluidVelocity(x + h * k3, next);
    x = outsideWall(flow, x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4), next);
    t = next;
  }
  return x;
}

/// A run of snapshots in which a tracer is inside the bounds and not hidden.
struct Interval {
  int first, last;
};

/// Tracers that were prepared together.
struct Chunk {
  std::vector<std::int64_t> tracer;
  std::vector<Vector3d> places;           // at every kept snapshot, tracer after tracer
  std::vector<Interval> intervals;        // tracer after tracer
  std::vector<std::uint32_t> endInterval; // per tracer
};
constexpr std::int64_t ChunkSize = 2048;

void append(std::vector<float>& to, const Vector3d& v) {
  for (int c = 0; c < 3; ++c) to.push_back(float(v[c]));
}
template <class T>
void append(std::vector<T>& to, const std::vector<T>& from) {
  to.insert(to.end(), from.begin(), from.end());
}

void check(const TrackSynthesisOptions& o) {
  const auto refuse = [](const std::string& what, double found) {
    std::ostringstream message;
    message << what << " (found " << found << ").";
    throw std::invalid_argument(message.str());
  };
  const auto need = [&](bool ok, const char* what, double found) {
    if (!ok) refuse(what, found);
  };
  for (int c = 0; c < 3; ++c)
    need(o.bounds[2 * c] < o.bounds[2 * c + 1] && std::isfinite(o.bounds[2 * c + 1] - o.bounds[2 * c]),
         "The upper bounds must lie above the lower ones: their distance is to be > 0 m",
         o.bounds[2 * c + 1] - o.bounds[2 * c]);
  need(o.density >= 0 && std::isfinite(o.density), "The tracer density must be >= 0 per m3", o.density);
  need(o.snapshots >= 1, "The number of snapshots must be at least 1", o.snapshots);
  need(o.framePeriod > 0 && std::isfinite(o.framePeriod), "The frame period must be > 0 s", o.framePeriod);
  need(std::isfinite(o.startTime), "The start time must be a number, s", o.startTime);
  need(o.positionNoise >= 0, "The position noise must be >= 0 m", o.positionNoise);
  need(o.velocityNoise >= 0, "The velocity noise must be >= 0 m/s", o.velocityNoise);
  need(o.accelerationNoise >= 0, "The acceleration noise must be >= 0 m/s2", o.accelerationNoise);
  need(o.dropOut >= 0 && o.dropOut <= 0.99, "The drop-out must be a fraction from 0 to 0.99", o.dropOut);
  need(o.ghostFraction >= 0 && o.ghostFraction <= 0.99, "The ghost fraction must be from 0 to 0.99",
       o.ghostFraction);
  need(o.wakeDepletion >= 0 && o.wakeDepletion <= 1, "The wake depletion must be a fraction from 0 to 1",
       o.wakeDepletion);
  need(o.wakeLength >= 0, "The wake length must be >= 0 diameters", o.wakeLength);
  const AnalyticFlow& flow = o.flow;
  need(flow.body.diameter >= 0, "The diameter must be >= 0 m", flow.body.diameter);
  need(flow.viscosity >= 0, "The viscosity must be >= 0 m2/s", flow.viscosity);
  need(flow.density > 0, "The fluid density must be > 0 kg/m3", flow.density);
  need(!flow.isPeriodic() || flow.wavelength > 0, "The wavelength must be > 0 m", flow.wavelength);
  need(flow.kind != FlowKind::HillsVortex || flow.body.acceleration.isZero(0),
       "Hill's vortex moves at constant velocity: set the acceleration to 0 m/s2, or choose a sphere",
       flow.body.acceleration.norm());
  need(flow.body.centre.allFinite() && flow.body.velocity.allFinite() && flow.body.acceleration.allFinite() &&
           flow.body.angularVelocity.allFinite() && std::isfinite(flow.body.diameter),
       "The sphere's centre, velocity, acceleration and rotation must be numbers; its diameter",
       flow.body.diameter);
  need(flow.kind == FlowKind::StokesSphere || flow.isPeriodic() || flow.body.angularVelocity.isZero(0),
       "Only the Stokes flow follows a rotating sphere: set the angular velocity to 0 rad/s, or choose it",
       flow.body.angularVelocity.norm());
}

} // namespace

struct TrackSynthesis::Implementation {
  TrackSynthesisOptions options;
  RandomTree random{0};
  Box bounds, seedBox;
  std::array<double, 3> period{}; // of the seed box per axis, m; 0: not periodic
  std::int64_t seeds = 0;
  int keepEvery = 1; // a place is kept of snapshots 0, keepEvery, 2 keepEvery ...
  int kept = 1, minimumLength = 1;
  double ghostRows = 0; // per snapshot, expected
  std::vector<Chunk> chunks;

  double time(int k) const { return options.startTime + k * options.framePeriod; }

  // --- seeding
  // -----------------------------------------------------------------------------------------------

  /// Everything that is inside the bounds at some time of the period lies in the seed box at its beginning.
  void chooseSeedBox() {
    const AnalyticFlow& flow = options.flow;
    const double start = time(0), end = time(options.snapshots - 1);
    seedBox = bounds;
    period.fill(0);
    if (flow.isPeriodic()) {
      const double travel = flow.maximumSpeed(start) * (end - start);
      for (int c = 0; c < 3; ++c) {
        if (flow.kind == FlowKind::TaylorGreen && c == 2) continue; // nothing moves along z
        const double extent = bounds.high[c] - bounds.low[c];
        const double wrapped = std::ceil(extent / flow.wavelength) * flow.wavelength;
        if (extent + 2 * travel > wrapped) {
          period[c] = wrapped;
          seedBox.high[c] = bounds.low[c] + wrapped;
        } else {
          seedBox.low[c] -= travel;
          seedBox.high[c] += travel;
        }
      }
      return;
    }
    // What was inside the bounds at a time t is bounded at the start by what their faces have become, and by
    // the sphere: carry points of the faces back.
    constexpr int Times = 8, Points = 12;
    for (int i = 1; i <= Times; ++i) {
      const double t = start + i * (end - start) / Times;
      const Body body = flow.bodyAt(t);
      for (int face = 0; face < 6; ++face)
        for (int p = 0; p <= Points; ++p)
          for (int q = 0; q <= Points; ++q) {
            const int c = face / 2;
            Vector3d f;
            f[c] = face % 2;
            f[(c + 1) % 3] = double(p) / Points;
            f[(c + 2) % 3] = double(q) / Points;
            const Vector3d x = bounds.low + f.cwiseProduct(bounds.high - bounds.low);
            if (!(flow.hasWall() && body.contains(x))) seedBox.extend(carry(flow, x, t, start));
          }
    }
    const Body first = flow.bodyAt(start);
    const double R = 0.5 * first.diameter;
    for (int k = 0; k < options.snapshots && R > 0; ++k)
      if (bounds.distanceTo(flow.bodyAt(time(k)).centre) < 2 * R) {
        seedBox.extend(first.centre - Vector3d::Constant(1.1 * R));
        seedBox.extend(first.centre + Vector3d::Constant(1.1 * R));
        break;
      }
    // Between the points carried, the faces may have moved a little farther.
    seedBox.low -= 0.1 * (bounds.low - seedBox.low);
    seedBox.high += 0.1 * (seedBox.high - bounds.high);
  }

  Vector3d seedPlace(std::int64_t tracer) const {
    const RandomTree r = random.at(SeedPlace).at(tracer);
    return seedBox.low +
           Vector3d(r.uniform(0), r.uniform(1), r.uniform(2)).cwiseProduct(seedBox.high - seedBox.low);
  }

  // --- what is seen
  // ------------------------------------------------------------------------------------------

  /// Brings x back into a periodic seed box, and says by how many periods.
  Image wrap(Vector3d& x) const {
    Image image{};
    for (int c = 0; c < 3; ++c)
      if (period[c] > 0) {
        image[c] = int(std::floor((x[c] - seedBox.low[c]) / period[c]));
        x[c] -= image[c] * period[c];
      }
    return image;
  }
  /// At least so far does a (wrapped) place lie within the bounds (> 0), or outside of them (< 0).
  double depth(const Vector3d& x) const {
    double least = std::numeric_limits<double>::infinity();
    for (int c = 0; c < 3; ++c) {
      double d = std::min(x[c] - bounds.low[c], bounds.high[c] - x[c]);
      if (d < 0 && period[c] > 0) d = std::max(d, x[c] - (bounds.low[c] + period[c])); // the next copy
      least = std::min(least, d);
    }
    return least;
  }
  bool isDepleted(std::int64_t tracer) const {
    return options.wakeDepletion > 0 && random.at(WakeBranch).at(tracer).uniform(0) < options.wakeDepletion;
  }
  /// The wake: a cylinder of the sphere's diameter, from its centre backwards.
  bool isInWake(const Vector3d& x, double t) const {
    const Body body = options.flow.bodyAt(t);
    if (body.diameter <= 0 || body.velocity.isZero(0)) return false;
    const Vector3d r = x - body.centre, e = -body.velocity.normalized();
    const double along = r.dot(e), R = 0.5 * body.diameter;
    return along > 0 && along < options.wakeLength * body.diameter && (r - along * e).squaredNorm() < R * R;
  }
  bool isDropped(const RandomTree& dropOut, int k) const { return dropOut.uniform(k) < options.dropOut; }

  // --- trajectories
  // ------------------------------------------------------------------------------------------

  /// Place at snapshot k from the last kept place before it.
  Vector3d placeAt(const Vector3d& keptPlace, int k) const {
    return carry(options.flow, keptPlace, time(k - k % keepEvery), time(k));
  }

  /// Carries one tracer through the period; leaves it out when it is never seen for long enough.
  void prepareTracer(std::int64_t tracer, Chunk& chunk) const {
    const AnalyticFlow& flow = options.flow;
    Vector3d place = seedPlace(tracer);
    if (flow.hasWall() && flow.bodyAt(time(0)).contains(place)) return;
    const bool depleted = isDepleted(tracer);
    const std::size_t firstPlace = chunk.places.size(), firstInterval = chunk.intervals.size();
    Interval open{0, -2};
    Image openImage{};
    const auto close = [&] {
      if (open.last - open.first + 1 >= minimumLength) chunk.intervals.push_back(open);
      open = {0, -2};
    };
    const auto see = [&](int first, int last, const Image& image) {
      if (open.last + 1 != first || image != openImage) {
        close();
        open.first = first;
        openImage = image;
      }
      open.last = last;
    };
    for (int c = 0; c < kept; ++c) {
      const int first = c * keepEvery, last = std::min(first + keepEvery, options.snapshots) - 1;
      const double begin = time(first), end = time(std::min(last + 1, options.snapshots - 1));
      chunk.places.push_back(place);
      const Vector3d next = carry(flow, place, begin, end);
      Vector3d here = place, there = next;
      const Image image = wrap(here);
      wrap(there);
      // Nothing moves farther than this, so the way between two deep places stays inside.
      const double way = (end - begin) * std::max(flow.maximumSpeed(begin), flow.maximumSpeed(end));
      const double sum = depth(here) + depth(there);
      if (sum > way && !depleted)
        see(first, last, image);
      else if (!(-sum > way))
        for (int k = first; k <= last; ++k) {
          Vector3d x = placeAt(place, k);
          const Image copy = wrap(x);
          if (depth(x) >= 0 && !(depleted && isInWake(x, time(k)))) see(k, k, copy);
        }
      place = next;
    }
    close();
    if (chunk.intervals.size() == firstInterval)
      chunk.places.resize(firstPlace);
    else {
      chunk.tracer.push_back(tracer);
      chunk.endInterval.push_back(std::uint32_t(chunk.intervals.size()));
    }
  }

  // --- rows
  // --------------------------------------------------------------------------------------------------

  void addRow(SyntheticSnapshot& to, bool withTruth, int k, std::int64_t id, std::int64_t tracer,
              const RandomTree& noise, const Vector3d& x, const Vector3d& u, const Vector3d& a) const {
    const auto noisy = [&](const Vector3d& v, double sigma, int n) -> Vector3d {
      return sigma > 0 ? v + sigma * noise.normal(n) : v;
    };
    append(to.position, noisy(x, options.positionNoise, 0));
    append(to.velocity, noisy(u, options.velocityNoise, 1));
    append(to.acceleration, noisy(a, options.accelerationNoise, 2));
    to.trackId.push_back(id);
    if (!withTruth) return;
    const bool ghost = tracer < 0;
    append(to.trueVelocity, ghost ? options.flow.velocity(x, time(k)) : u);
    append(to.trueAcceleration, ghost ? options.flow.acceleration(x, time(k)) : a);
    to.truePressure.push_back(float(options.flow.pressure(x, time(k))));
    to.trueTracerId.push_back(tracer);
  }

  void addTracers(SyntheticSnapshot& to, bool withTruth, int k, const Chunk& chunk) const {
    std::size_t interval = 0;
    for (std::size_t i = 0; i < chunk.tracer.size(); ++i) {
      const Interval* seen = nullptr;
      for (; interval < chunk.endInterval[i]; ++interval)
        if (chunk.intervals[interval].first <= k && k <= chunk.intervals[interval].last)
          seen = &chunk.intervals[interval];
      if (!seen) continue;
      const std::int64_t tracer = chunk.tracer[i];
      Interval run = *seen;
      if (options.dropOut > 0) {
        const RandomTree dropOut = random.at(DropOutBranch).at(tracer);
        if (isDropped(dropOut, k)) continue;
        run = {k, k};
        while (run.first > seen->first && !isDropped(dropOut, run.first - 1)) --run.first;
        while (run.last < seen->last && run.last - run.first + 1 < minimumLength &&
               !isDropped(dropOut, run.last + 1))
          ++run.last;
        if (run.last - run.first + 1 < minimumLength) continue;
      }
      const Vector3d there = placeAt(chunk.places[i * kept + k / keepEvery], k);
      Vector3d x = there;
      wrap(x);
      addRow(to, withTruth, k, tracer * options.snapshots + run.first, tracer,
             random.at(NoiseBranch).at(tracer).at(k), x, options.flow.velocity(x, time(k)),
             options.flow.acceleration(x, time(k)));
    }
  }

  /// The chance that a tracer inside the bounds is in a track at snapshot k.
  double seenFraction(int k) const {
    const double p = 1 - options.dropOut;
    const int before = k, after = options.snapshots - 1 - k;
    double tooShort = 0; // m of those before k belong to its track, and at most n of those after it
    for (int m = 0; m <= std::min(before, minimumLength - 2); ++m) {
      const int n = minimumLength - 2 - m;
      tooShort += std::pow(p, m) * (m < before ? 1 - p : 1) * (n < after ? 1 - std::pow(p, n + 1) : 1);
    }
    return p * (1 - tooShort);
  }

  /// Ghost rows stand in a fixed ratio to the rows to be expected.
  void countGhosts() {
    ghostRows = 0;
    if (options.ghostFraction <= 0) return;
    const int samples = std::min(options.snapshots, 64);
    for (int s = 0; s < samples; ++s) {
      const int k = int(std::int64_t(s) * options.snapshots / samples);
      double fluid = bounds.volume();
      const Body body = options.flow.bodyAt(time(k));
      if (options.flow.hasWall() && depth(body.centre) > 0) fluid -= M_PI / 6 * std::pow(body.diameter, 3);
      ghostRows += options.density * fluid * seenFraction(k) / samples;
    }
    ghostRows *= options.ghostFraction / (1 - options.ghostFraction);
  }

  /// Each slot holds one ghost track after another.
  void addGhosts(SyntheticSnapshot& to, bool withTruth, int k) const {
    const auto slots = std::int64_t(std::ceil(ghostRows));
    const int shortest = std::max(ShortestGhost, minimumLength);
    const AnalyticFlow& flow = options.flow;
    const double speed = flow.typicalSpeed(time(k));
    const double size = flow.isPeriodic() ? flow.wavelength / 2 : flow.body.diameter;
    const double strength = size > 0 ? 0.15 * speed * speed / size : 0;
    for (std::int64_t slot = 0; slot < slots; ++slot) {
      const RandomTree r = random.at(GhostBranch).at(slot);
      int first = 0, last = 0;
      for (;; first = last + 1) {
        last = first + shortest - 1 + (r.at(first).uniform(0) < 0.5);
        if (options.snapshots - 1 - last < shortest) last = options.snapshots - 1;
        if (k <= last) break;
      }
      const RandomTree ghost = r.at(first);
      if (ghost.uniform(1) * slots > ghostRows) continue;
      const Vector3d f(ghost.uniform(2), ghost.uniform(3), ghost.uniform(4));
      const Vector3d start = bounds.low + f.cwiseProduct(bounds.high - bounds.low);
      Vector3d u = 0.5 * speed * ghost.uniform(5) * ghost.at(6).normal(0).normalized();
      const double duration = (last - first) * options.framePeriod;
      for (int c = 0; c < 3; ++c) { // it stays inside: turn round, or stop where even that leads out
        const auto leaves = [&] {
          const double end = start[c] + duration * u[c];
          return end < bounds.low[c] || end > bounds.high[c];
        };
        if (leaves()) u[c] = -u[c];
        if (leaves()) u[c] = 0;
      }
      const Vector3d x = start + (k - first) * options.framePeriod * u;
      addRow(to, withTruth, k, (seeds + slot) * options.snapshots + first, -1, ghost.at(7).at(k), x, u,
             strength * ghost.at(8).at(k).normal(0));
    }
  }
};

TrackSynthesis::TrackSynthesis() : implementation_(std::make_unique<Implementation>()) {}
TrackSynthesis::~TrackSynthesis() = default;
TrackSynthesis::TrackSynthesis(TrackSynthesis&&) noexcept = default;
TrackSynthesis& TrackSynthesis::operator=(TrackSynthesis&&) noexcept = default;

bool TrackSynthesis::prepare(const TrackSynthesisOptions& options, const Progress& progress) {
  check(options);
  auto next = std::make_unique<Implementation>();
  next->options = options;
  next->random = RandomTree(options.seed).at(0);
  for (int c = 0; c < 3; ++c) {
    next->bounds.low[c] = options.bounds[2 * c];
    next->bounds.high[c] = options.bounds[2 * c + 1];
  }
  next->minimumLength = std::max(1, std::min(options.minimumTrackLength, options.snapshots));
  next->chooseSeedBox();
  const double seeds = options.density * next->seedBox.volume();
  if (seeds > 1e9) {
    std::ostringstream message;
    message << "These bounds, density and period need " << seeds
            << " tracers, more than 1e9: choose smaller ones.";
    throw std::invalid_argument(message.str());
  }
  next->seeds = std::llround(seeds);
  const double bytesPerSnapshot = double(next->seeds) * sizeof(Vector3d);
  next->keepEvery = std::min<double>(
      options.snapshots,
      std::max(8., std::ceil(bytesPerSnapshot * options.snapshots / double(options.memoryLimit))));
  next->kept = (options.snapshots + next->keepEvery - 1) / next->keepEvery;
  next->countGhosts();

  const std::int64_t count = (next->seeds + ChunkSize - 1) / ChunkSize;
  next->chunks.resize(count);
  const bool all = forEachPiece(std::size_t(count), progress, [&](std::size_t c, const Progress&) {
    Chunk chunk;
    const std::int64_t first = std::int64_t(c) * ChunkSize;
    for (std::int64_t i = first; i < std::min(next->seeds, first + ChunkSize); ++i)
      next->prepareTracer(i, chunk);
    chunk.places.shrink_to_fit();
    chunk.intervals.shrink_to_fit();
    next->chunks[c] = std::move(chunk);
  });
  if (!all) return false;
  implementation_ = std::move(next);
  return true;
}

SyntheticSnapshot TrackSynthesis::snapshot(int k, bool withTruth) const {
  const Implementation& all = *implementation_;
  if (k < 0 || k >= all.options.snapshots)
    throw std::out_of_range("There is no snapshot " + std::to_string(k) + ": choose from 0 to " +
                            std::to_string(all.options.snapshots - 1) + ".");
  const auto count = std::int64_t(all.chunks.size());
  std::vector<SyntheticSnapshot> parts(count + 1);
#pragma omp parallel for schedule(dynamic)
  for (std::int64_t c = 0; c < count; ++c) all.addTracers(parts[c], withTruth, k, all.chunks[c]);
  all.addGhosts(parts[count], withTruth, k);

  SyntheticSnapshot rows;
  for (SyntheticSnapshot& part : parts) {
    append(rows.position, part.position);
    append(rows.velocity, part.velocity);
    append(rows.acceleration, part.acceleration);
    append(rows.trackId, part.trackId);
    append(rows.trueVelocity, part.trueVelocity);
    append(rows.trueAcceleration, part.trueAcceleration);
    append(rows.truePressure, part.truePressure);
    append(rows.trueTracerId, part.trueTracerId);
  }
  return rows;
}

double TrackSynthesis::time(int k) const { return implementation_->time(k); }
const TrackSynthesisOptions& TrackSynthesis::options() const { return implementation_->options; }

std::size_t TrackSynthesis::storedBytes() const {
  std::size_t bytes = 0;
  for (const Chunk& chunk : implementation_->chunks)
    bytes += chunk.places.capacity() * sizeof(Vector3d) + chunk.intervals.capacity() * sizeof(Interval) +
             chunk.tracer.capacity() * sizeof(std::int64_t) +
             chunk.endInterval.capacity() * sizeof(std::uint32_t);
  return bytes;
}

} // namespace rimflow
