// Breaks when synthetic tracers leave their streamlines, enter the sphere or thin out, when noise, drop-out
// or ghosts have not the statistics asked for, or when a snapshot depends on what was asked for before.
#include "TrackSynthesis.h"

#include <algorithm>
#include <cmath>
#include <gtest/gtest.h>
#include <map>
#include <omp.h>
#include <set>
#include <string>

using namespace rimflow;
using Eigen::Vector3d;

namespace {

constexpr double R = 0.005, Speed = 0.35;

/// A sphere that crosses a box of 30 x 40 x 25 mm, by two diameters.
TrackSynthesisOptions crossing(FlowKind kind = FlowKind::StokesSphere) {
  TrackSynthesisOptions o;
  o.flow.kind = kind;
  o.flow.body.diameter = 2 * R;
  o.flow.body.centre = {0.001, 0, -0.001};
  o.flow.body.velocity = Speed * Vector3d(0.1, 1, -0.05).normalized();
  o.bounds = {-0.015, 0.015, -0.02, 0.02, -0.0125, 0.0125};
  o.density = 4e8;
  o.snapshots = 60;
  o.framePeriod = 0.001;
  o.startTime = 2;
  o.flow.referenceTime = o.startTime + 0.5 * (o.snapshots - 1) * o.framePeriod;
  o.flow.amplitude = 0.2;
  o.flow.wavelength = 0.02;
  return o;
}

TrackSynthesis prepared(const TrackSynthesisOptions& o) {
  TrackSynthesis tracks;
  EXPECT_TRUE(tracks.prepare(o));
  return tracks;
}

Vector3d vector(const std::vector<float>& v, std::size_t i) { return {v[3 * i], v[3 * i + 1], v[3 * i + 2]}; }

bool same(const SyntheticSnapshot& a, const SyntheticSnapshot& b) {
  return a.position == b.position && a.velocity == b.velocity && a.acceleration == b.acceleration &&
         a.trackId == b.trackId && a.trueVelocity == b.trueVelocity &&
         a.trueAcceleration == b.trueAcceleration && a.truePressure == b.truePressure &&
         a.trueTracerId == b.trueTracerId;
}

TrackSynthesisOptions withEverything() {
  TrackSynthesisOptions o = crossing();
  o.density = 5e7;
  o.positionNoise = 5e-6;
  o.velocityNoise = 3e-3;
  o.accelerationNoise = 0.1;
  o.dropOut = 0.1;
  o.ghostFraction = 0.05;
  o.minimumTrackLength = 4;
  o.wakeDepletion = 0.5;
  return o;
}

/// The rows of each track: (snapshot, row).
using Tracks = std::map<std::int64_t, std::vector<std::pair<int, std::size_t>>>;
Tracks collect(const std::vector<SyntheticSnapshot>& all) {
  Tracks tracks;
  for (std::size_t k = 0; k < all.size(); ++k)
    for (std::size_t i = 0; i < all[k].size(); ++i) tracks[all[k].trackId[i]].push_back({int(k), i});
  return tracks;
}
std::vector<SyntheticSnapshot> play(const TrackSynthesis& tracks) {
  std::vector<SyntheticSnapshot> all;
  for (int k = 0; k < tracks.options().snapshots; ++k) all.push_back(tracks.snapshot(k, true));
  return all;
}

} // namespace

TEST(TrackSynthesis, ASnapshotIsTheSameInAnyOrderAndWithAnyNumberOfThreads) {
  const TrackSynthesisOptions o = withEverything();
  const auto forwards = play(prepared(o));
  const int threads = omp_get_max_threads();
  omp_set_num_threads(threads == 1 ? 3 : 1);
  const TrackSynthesis again = prepared(o);
  for (int k : {59, 0, 31, 30, 7}) EXPECT_TRUE(same(again.snapshot(k, true), forwards[k])) << k;
  omp_set_num_threads(threads);
  TrackSynthesisOptions other = o;
  other.seed = 2;
  EXPECT_FALSE(same(prepared(other).snapshot(30, true), forwards[30]));
}

TEST(TrackSynthesis, MemoryIsBoundedAndTheTracksStayTheSame) {
  for (FlowKind kind :
       {FlowKind::StokesSphere, FlowKind::HillsVortex, FlowKind::TaylorGreen, FlowKind::ABC}) {
    TrackSynthesisOptions o = crossing(kind);
    o.density = 5e7;
    o.snapshots = 200;
    o.framePeriod = 0.0005;
    const TrackSynthesis plenty = prepared(o);
    o.memoryLimit = plenty.storedBytes() / 4;
    const TrackSynthesis little = prepared(o);
    EXPECT_LT(little.storedBytes(), 1.3 * o.memoryLimit);
    const SyntheticSnapshot a = plenty.snapshot(199), b = little.snapshot(199);
    ASSERT_EQ(a.trackId, b.trackId);
    double largest = 0;
    for (std::size_t i = 0; i < a.position.size(); ++i)
      largest = std::max(largest, double(std::abs(a.position[i] - b.position[i])));
    EXPECT_LT(largest, 1e-7) << int(kind); // metres: other Runge-Kutta steps, the same path
  }
}

// In the frame of the sphere the flow is steady, so its stream function stays what it was for each tracer:
// psi/V = rho^2 (1 - 3R/(2r) + R^3/(2r^3))/2 for Stokes, rho^2 (1 - R^3/r^3)/2 for potential flow.
TEST(TrackSynthesis, TracersFollowTheStreamlines) {
  for (FlowKind kind : {FlowKind::StokesSphere, FlowKind::PotentialSphere}) {
    const TrackSynthesisOptions o = crossing(kind);
    const TrackSynthesis tracks = prepared(o);
    const auto streamFunction = [&](const Vector3d& x, double t) {
      const Body body = o.flow.bodyAt(t);
      const Vector3d r = x - body.centre;
      const double a = R / r.norm(), a3 = a * a * a;
      const double rho2 = r.squaredNorm() - std::pow(r.dot(body.velocity.normalized()), 2);
      return 0.5 * rho2 * (kind == FlowKind::StokesSphere ? 1 - 1.5 * a + 0.5 * a3 : 1 - a3);
    };
    std::map<std::int64_t, double> first;
    double largest = 0, passedBy = 0;
    for (int k = 0; k < o.snapshots; ++k) {
      const SyntheticSnapshot s = tracks.snapshot(k, true);
      for (std::size_t i = 0; i < s.size(); ++i) {
        const Vector3d x = vector(s.position, i);
        const double psi = streamFunction(x, tracks.time(k));
        const auto known = first.emplace(s.trueTracerId[i], psi);
        largest = std::max(largest, std::abs(psi - known.first->second));
        passedBy += o.flow.bodyAt(tracks.time(k)).signedDistance(x) < 0.2 * R;
      }
    }
    EXPECT_LT(largest, 2e-6 * R * R);
    EXPECT_GT(passedBy, 1000);
  }
}

TEST(TrackSynthesis, TracksMoveWithTheirVelocityAndAcceleration) {
  for (FlowKind kind :
       {FlowKind::StokesSphere, FlowKind::HillsVortex, FlowKind::TaylorGreen, FlowKind::ABC}) {
    SCOPED_TRACE(int(kind));
    TrackSynthesisOptions o = crossing(kind);
    o.framePeriod = 1e-4;
    o.density = 1e8;
    o.snapshots = 5;
    o.flow.referenceTime = o.startTime;
    o.flow.body.acceleration = kind == FlowKind::StokesSphere ? Vector3d(5, 2, 1) : Vector3d(0, 0, 0);
    const auto all = play(prepared(o));
    std::map<std::int64_t, std::size_t> before, after;
    for (std::size_t i = 0; i < all[1].size(); ++i) before[all[1].trackId[i]] = i;
    for (std::size_t i = 0; i < all[3].size(); ++i) after[all[3].trackId[i]] = i;
    const double u = o.flow.maximumSpeed(o.startTime), a = u * u / (o.flow.isPeriodic() ? 0.003 : R);
    double worstVelocity = 0, worstAcceleration = 0;
    int count = 0;
    for (std::size_t i = 0; i < all[2].size(); ++i) {
      const auto b = before.find(all[2].trackId[i]), c = after.find(all[2].trackId[i]);
      if (b == before.end() || c == after.end()) continue;
      // A tracer that crosses the seam of Hill's vortex has a jump in its acceleration's slope.
      const Vector3d dx = vector(all[3].position, c->second) - vector(all[1].position, b->second);
      const Vector3d du = vector(all[3].velocity, c->second) - vector(all[1].velocity, b->second);
      worstVelocity = std::max(worstVelocity, (dx / (2 * o.framePeriod) - vector(all[2].velocity, i)).norm());
      worstAcceleration =
          std::max(worstAcceleration, (du / (2 * o.framePeriod) - vector(all[2].acceleration, i)).norm());
      ++count;
    }
    EXPECT_GT(count, 2000);
    EXPECT_LT(worstVelocity, 1e-3 * u);
    EXPECT_LT(worstAcceleration, 5e-3 * a);
  }
}

TEST(TrackSynthesis, NoTracerEntersTheSphere) {
  for (FlowKind kind : {FlowKind::StokesSphere, FlowKind::PotentialSphere}) {
    TrackSynthesisOptions o = crossing(kind);
    o.density = 1e9;
    const TrackSynthesis tracks = prepared(o);
    for (int k : {0, 20, 40, 59}) {
      const SyntheticSnapshot s = tracks.snapshot(k);
      const Body body = o.flow.bodyAt(tracks.time(k));
      double nearest = 1;
      for (std::size_t i = 0; i < s.size(); ++i)
        nearest = std::min(nearest, body.signedDistance(vector(s.position, i)));
      EXPECT_GT(nearest, -3e-9); // metres: the rounding of a float
      if (k == 20) {
        EXPECT_LT(nearest, 0.02 * R);
      }
    }
  }
}

TEST(TrackSynthesis, TheDensityStaysUniform) {
  for (FlowKind kind : {FlowKind::StokesSphere, FlowKind::PotentialSphere, FlowKind::HillsVortex,
                        FlowKind::TaylorGreen, FlowKind::ABC})
    for (double wavelength : {0.02, 0.2}) { // shorter than the box: wrapped; longer: padded
      TrackSynthesisOptions o = crossing(kind);
      if (!o.flow.isPeriodic() && wavelength > 0.1) continue;
      SCOPED_TRACE(std::to_string(int(kind)) + " " + std::to_string(wavelength));
      o.flow.wavelength = wavelength;
      o.density = 1e9;
      const TrackSynthesis tracks = prepared(o);
      for (int k : {0, 30, 59}) {
        const SyntheticSnapshot s = tracks.snapshot(k);
        const Body body = o.flow.bodyAt(tracks.time(k));
        constexpr int Bins = 8;
        std::vector<double> count(Bins * Bins * Bins, 0), volume(count.size(), 0);
        const auto bin = [&](const Vector3d& x) {
          int b[3];
          for (int c = 0; c < 3; ++c)
            b[c] = std::clamp(int(Bins * (x[c] - o.bounds[2 * c]) / (o.bounds[2 * c + 1] - o.bounds[2 * c])),
                              0, Bins - 1);
          return b[0] + Bins * (b[1] + Bins * b[2]);
        };
        for (std::size_t i = 0; i < s.size(); ++i) ++count[bin(vector(s.position, i))];
        constexpr int Fine = 8 * Bins; // the fluid's share of each bin, by sampling
        for (int n = 0; n < Fine * Fine * Fine; ++n) {
          const int f[3] = {n % Fine, n / Fine % Fine, n / (Fine * Fine)};
          Vector3d x;
          for (int c = 0; c < 3; ++c)
            x[c] = o.bounds[2 * c] + (o.bounds[2 * c + 1] - o.bounds[2 * c]) * (f[c] + 0.5) / Fine;
          if (!(o.flow.hasWall() && body.contains(x))) volume[bin(x)] += 3e-5 / (double(Fine) * Fine * Fine);
        }
        for (int face = 0; face < 6; ++face) { // 1 mm next to a face: tracers come in through them all
          const int c = face / 2;
          double n = 0;
          for (std::size_t i = 0; i < s.size(); ++i)
            n += std::abs(s.position[3 * i + c] - o.bounds[face]) < 0.001;
          const double expected = o.density * 3e-5 * 0.001 / (o.bounds[2 * c + 1] - o.bounds[2 * c]);
          EXPECT_NEAR(n / expected, 1, 5 / std::sqrt(expected)) << "face " << face;
        }
        double chi2 = 0, bins = 0;
        for (std::size_t b = 0; b < count.size(); ++b) {
          const double expected = o.density * volume[b];
          if (expected < 20) continue;
          chi2 += std::pow(count[b] - expected, 2) / expected;
          ++bins;
        }
        EXPECT_GT(bins, 490);
        EXPECT_NEAR(chi2 / bins, 1, 5 * std::sqrt(2 / bins)) << "snapshot " << k;
      }
    }
}

TEST(TrackSynthesis, NoiseHasTheStandardDeviationsAskedFor) {
  TrackSynthesisOptions o = crossing();
  o.snapshots = 2;
  o.density = 1e9;
  const auto clean = play(prepared(o));
  o.positionNoise = 5e-6;
  o.velocityNoise = 3e-3;
  o.accelerationNoise = 0.2;
  const auto noisy = play(prepared(o));
  ASSERT_EQ(clean[0].trackId, noisy[0].trackId);
  const auto statistics = [](const std::vector<float>& a, const std::vector<float>& b, double sigma) {
    double mean = 0, square = 0, fourth = 0;
    for (std::size_t i = 0; i < a.size(); ++i) {
      const double d = (double(b[i]) - a[i]) / sigma;
      mean += d / a.size();
      square += d * d / a.size();
      fourth += d * d * d * d / a.size();
    }
    const double n = a.size();
    EXPECT_NEAR(mean, 0, 5 / std::sqrt(n));
    EXPECT_NEAR(square, 1, 5 * std::sqrt(2 / n));
    EXPECT_NEAR(fourth, 3, 5 * std::sqrt(96 / n)); // Gaussian
  };
  statistics(clean[0].position, noisy[0].position, o.positionNoise);
  statistics(clean[0].velocity, noisy[0].velocity, o.velocityNoise);
  statistics(clean[0].acceleration, noisy[0].acceleration, o.accelerationNoise);
  EXPECT_EQ(noisy[0].trueVelocity, clean[0].velocity);
  EXPECT_EQ(noisy[0].trueAcceleration, clean[0].acceleration);
  // Independent from snapshot to snapshot, and from component to component.
  std::map<std::int64_t, std::size_t> second;
  for (std::size_t i = 0; i < noisy[1].size(); ++i) second[noisy[1].trackId[i]] = i;
  double inTime = 0, across = 0, n = 0;
  for (std::size_t i = 0; i < noisy[0].size(); ++i) {
    const auto j = second.find(noisy[0].trackId[i]);
    if (j == second.end()) continue;
    const Vector3d d = vector(noisy[0].velocity, i) - vector(noisy[0].trueVelocity, i);
    inTime += d.dot(vector(noisy[1].velocity, j->second) - vector(noisy[1].trueVelocity, j->second));
    across += d[0] * d[1] + d[1] * d[2] + d[2] * d[0];
    n += 3;
  }
  EXPECT_NEAR(inTime / (n * std::pow(o.velocityNoise, 2)), 0, 5 / std::sqrt(n));
  EXPECT_NEAR(across / (n * std::pow(o.velocityNoise, 2)), 0, 5 / std::sqrt(n));
}

TEST(TrackSynthesis, ADropOutEndsTheTrack) {
  TrackSynthesisOptions o = crossing();
  o.snapshots = 20;
  const auto full = play(prepared(o));
  o.dropOut = 0.1;
  const auto thinned = play(prepared(o));
  for (int k : {0, 10, 19}) {
    const double n = double(full[k].size());
    EXPECT_NEAR(thinned[k].size() / n, 0.9, 5 * std::sqrt(0.09 / n)) << k;
  }
  std::map<std::int64_t, std::int64_t> tracerOf;
  int afterGaps = 0;
  std::set<std::int64_t> tracers;
  for (const auto& [id, rows] : collect(thinned)) {
    EXPECT_GE(id, 0);
    EXPECT_EQ(rows.back().first - rows.front().first + 1, int(rows.size())); // no gap, no double row
    const std::int64_t tracer = thinned[rows[0].first].trueTracerId[rows[0].second];
    for (const auto& [k, i] : rows) EXPECT_EQ(thinned[k].trueTracerId[i], tracer);
    afterGaps += !tracers.insert(tracer).second;
  }
  EXPECT_GT(afterGaps, 1000);
  // A minimum length takes out exactly the tracks that are shorter.
  o.minimumTrackLength = 4;
  Tracks expected = collect(thinned);
  for (auto i = expected.begin(); i != expected.end();)
    i = i->second.size() < 4 ? expected.erase(i) : std::next(i);
  const Tracks found = collect(play(prepared(o)));
  ASSERT_EQ(found.size(), expected.size());
  for (const auto& [id, rows] : found) {
    ASSERT_TRUE(expected.count(id));
    EXPECT_EQ(rows.size(), expected[id].size());
  }
}

TEST(TrackSynthesis, Ghosts) {
  TrackSynthesisOptions o = crossing();
  o.dropOut = 0.1;
  o.minimumTrackLength = 4;
  o.ghostFraction = 0.05;
  o.snapshots = 41;
  o.flow.referenceTime = o.startTime + 0.02;
  const TrackSynthesis tracks = prepared(o);
  const auto all = play(tracks);
  double ghosts = 0, rows = 0, inside = 0;
  for (std::size_t k = 0; k < all.size(); ++k) {
    rows += double(all[k].size());
    for (std::size_t i = 0; i < all[k].size(); ++i)
      if (all[k].trueTracerId[i] < 0) {
        ++ghosts;
        const Vector3d x = vector(all[k].position, i);
        inside += o.flow.bodyAt(tracks.time(int(k))).contains(x);
        for (int c = 0; c < 3; ++c) {
          EXPECT_GE(x[c], o.bounds[2 * c] - 1e-8);
          EXPECT_LE(x[c], o.bounds[2 * c + 1] + 1e-8);
        }
      }
  }
  EXPECT_NEAR(ghosts / rows, 0.05, 0.001);
  EXPECT_NEAR(inside / ghosts, 4. / 3 * M_PI * R * R * R / 3e-5, 0.004); // anywhere: by volume
  for (const auto& [id, points] : collect(all)) {
    const auto [k0, i0] = points.front();
    if (all[k0].trueTracerId[i0] >= 0) continue;
    EXPECT_GE(points.size(), 4u);
    EXPECT_LE(points.size(), points.back().first == 40 ? 8u : 5u);
    const Vector3d u = vector(all[k0].velocity, i0);
    EXPECT_LE(u.norm(), 0.5 * Speed * (1 + 1e-6));
    for (const auto& [k, i] : points) {
      const Vector3d straight = vector(all[k0].position, i0) + (k - k0) * o.framePeriod * u;
      EXPECT_LT((vector(all[k].position, i) - straight).norm(), 1e-8);
    }
  }
}

TEST(TrackSynthesis, ADepletedWake) {
  TrackSynthesisOptions o = crossing();
  o.density = 1e9;
  const TrackSynthesis full = prepared(o);
  o.wakeDepletion = 0.4;
  const TrackSynthesis depleted = prepared(o);
  const auto count = [&](const TrackSynthesis& tracks, double& wake, double& rest) {
    const SyntheticSnapshot s = tracks.snapshot(45);
    const Body body = o.flow.bodyAt(tracks.time(45));
    const Vector3d back = -body.velocity.normalized();
    wake = rest = 0;
    for (std::size_t i = 0; i < s.size(); ++i) {
      const Vector3d r = vector(s.position, i) - body.centre;
      const double along = r.dot(back);
      const bool in = along > 0 && along < 4 * R && (r - along * back).norm() < R;
      ++(in ? wake : rest);
    }
  };
  double wakeBefore, restBefore, wake, rest;
  count(full, wakeBefore, restBefore);
  count(depleted, wake, rest);
  EXPECT_EQ(rest, restBefore);
  EXPECT_NEAR(wake / wakeBefore, 0.6, 5 * std::sqrt(0.24 / wakeBefore));
}

TEST(TrackSynthesis, ATrackDoesNotJumpToAnotherCopyOfAPeriodicFlow) {
  TrackSynthesisOptions o = crossing(FlowKind::ABC);
  o.bounds = {0, 0.02, 0, 0.02, 0, 0.02}; // exactly one period: who leaves comes in on the other side
  o.flow.wavelength = 0.02;
  o.density = 1e8;
  const auto all = play(prepared(o));
  const double furthest = o.flow.maximumSpeed(o.startTime) * o.framePeriod * 1.01;
  int endings = 0;
  for (const auto& [id, points] : collect(all)) {
    endings += points.back().first < 59;
    for (std::size_t p = 1; p < points.size(); ++p)
      EXPECT_LT((vector(all[points[p].first].position, points[p].second) -
                 vector(all[points[p - 1].first].position, points[p - 1].second))
                    .norm(),
                furthest);
  }
  EXPECT_GT(endings, 100);
}

TEST(TrackSynthesis, EdgeCases) {
  TrackSynthesisOptions o = crossing();
  o.snapshots = 1;
  o.minimumTrackLength = 4; // at most the number of snapshots counts
  EXPECT_NEAR(prepared(o).snapshot(0).size(), o.density * (3e-5 - 4. / 3 * M_PI * R * R * R), 600);
  o.density = 0;
  EXPECT_EQ(prepared(o).snapshot(0).size(), 0u);
  o = crossing();
  o.flow.body.diameter = 0; // no sphere: the fluid rests, tracks last
  const TrackSynthesis rest = prepared(o);
  EXPECT_EQ(rest.snapshot(0).position, rest.snapshot(59).position);
  EXPECT_EQ(rest.snapshot(0).size(), 12000u);
  EXPECT_THROW(rest.snapshot(60), std::out_of_range);
  EXPECT_THROW(rest.snapshot(-1), std::out_of_range);
  o = crossing();
  EXPECT_FALSE(TrackSynthesis().prepare(o, [](double) { return false; }));
}

TEST(TrackSynthesis, RefusesWhatMakesNoSense) {
  const auto message = [](auto change) {
    TrackSynthesisOptions o = crossing();
    change(o);
    try {
      TrackSynthesis().prepare(o);
    } catch (const std::invalid_argument& e) {
      return std::string(e.what());
    }
    return std::string();
  };
  using O = TrackSynthesisOptions;
  EXPECT_NE(message([](O& o) { o.bounds[1] = o.bounds[0]; }).find("bounds"), std::string::npos);
  EXPECT_NE(message([](O& o) { o.framePeriod = 0; }).find("frame period"), std::string::npos);
  EXPECT_NE(message([](O& o) { o.density = std::nan(""); }).find("density"), std::string::npos);
  EXPECT_NE(message([](O& o) { o.density = 1e16; }).find("1e9"), std::string::npos);
  EXPECT_NE(message([](O& o) { o.dropOut = 1; }).find("drop-out"), std::string::npos);
  EXPECT_NE(message([](O& o) { o.snapshots = 0; }).find("snapshots"), std::string::npos);
  EXPECT_NE(message([](O& o) {
              o.flow.kind = FlowKind::HillsVortex;
              o.flow.body.acceleration = {1, 0, 0};
            }).find("constant velocity"),
            std::string::npos);
  EXPECT_NE(message([](O& o) {
              o.flow.kind = FlowKind::PotentialSphere;
              o.flow.body.angularVelocity = {1, 0, 0};
            }).find("rotating"),
            std::string::npos);
}
