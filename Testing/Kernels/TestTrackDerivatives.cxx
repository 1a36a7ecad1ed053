// Breaks when a derivative along a track is wrong in the middle, at an end, at a gap, or with unequal times,
// or when a particle gets one that its track cannot tell.
#include "TrackDerivatives.h"

#include <cmath>
#include <functional>
#include <gtest/gtest.h>
#include <limits>
#include <omp.h>
#include <random>
#include <stdexcept>

using namespace rimflow;

namespace {

const float missing = std::numeric_limits<float>::quiet_NaN();

struct Track {
  std::int64_t id;
  std::function<double(double)> x;                          // of time; y = 2 x, z = 1 - x
  std::function<bool(int)> seen = [](int) { return true; }; // in a snapshot
};

TrackWindow windowOf(const std::vector<double>& times, std::size_t current,
                     const std::vector<Track>& tracks) {
  TrackWindow w;
  w.times = times;
  w.current = current;
  for (std::size_t k = 0; k < times.size(); ++k) {
    auto s = std::make_shared<TrackSnapshot>();
    for (const Track& t : tracks) {
      if (!t.seen(int(k))) continue;
      const double x = t.x(times[k]);
      s->trackId.push_back(t.id);
      for (double v : {x, 2 * x, 1 - x}) s->position.push_back(float(v));
    }
    w.snapshots.push_back(s);
  }
  return w;
}

TrackSnapshot derived(const TrackWindow& w, const TrackDerivativeOptions& o = {}) {
  TrackSnapshot s = *w.snapshots[w.current];
  estimateDerivatives(w, o, s);
  return s;
}

void expectDerivatives(const TrackSnapshot& s, std::size_t row, double v, double a, double tolerance) {
  const double factor[3] = {1, 2, -1};
  for (int c = 0; c < 3; ++c) {
    EXPECT_NEAR(s.velocity[3 * row + c], factor[c] * v, tolerance) << "row " << row << " component " << c;
    EXPECT_NEAR(s.acceleration[3 * row + c], factor[c] * a, tolerance) << "row " << row << " component " << c;
  }
}

// Seventeen unequal times that floats hold exactly.
const std::vector<double> unequal{0, 1, 1.5, 2.5, 3.5, 4, 5, 6.5, 7.5, 8, 9, 9.5, 10.5, 12, 13, 13.5, 14.5};
double parabola(double t) { return 1 + 2 * t - 0.5 * t * t; }
double cubic(double t) { return 3 - t + 0.25 * t * t - 0.125 * t * t * t; }

} // namespace

TEST(TrackDerivatives, PolynomialsAreReproducedAtUnequalTimes) {
  const TrackSnapshot two = derived(windowOf(unequal, 8, {{5, parabola}}));
  expectDerivatives(two, 0, 2 - 7.5, -1, 1e-5);
  const TrackSnapshot three = derived(windowOf(unequal, 8, {{5, cubic}}), {3, 9});
  expectDerivatives(three, 0, -1 + 0.5 * 7.5 - 0.375 * 7.5 * 7.5, 0.5 - 0.75 * 7.5, 2e-4);
}

TEST(TrackDerivatives, ALateClockCostsNoDigits) {
  std::vector<double> late = unequal;
  for (double& t : late) t = 43000 + 0.001 * t;
  const TrackSnapshot s =
      derived(windowOf(late, 8, {{5, [](double t) { return parabola(1000 * (t - 43000)); }}}));
  expectDerivatives(s, 0, 1000 * (2 - 7.5), -1e6, 5);
}

TEST(TrackDerivatives, EndsOfTracksHaveAsManyPointsAsTheMiddle) {
  const std::vector<Track> tracks{{1, parabola, [](int k) { return k >= 8; }},
                                  {2, parabola, [](int k) { return k <= 8; }},
                                  {3, parabola, [](int k) { return k >= 6; }}};
  const TrackSnapshot s = derived(windowOf(unequal, 8, tracks));
  for (std::size_t r = 0; r < 3; ++r) expectDerivatives(s, r, 2 - 7.5, -1, 5e-5);
  // A kick beyond the window is not felt, the last point inside it is.
  for (const auto& [at, felt] : {std::pair<int, bool>{0, true}, {16, true}}) {
    TrackWindow w = windowOf(unequal, at, {{1, parabola}});
    auto kicked = std::make_shared<TrackSnapshot>(*w.snapshots[8]);
    kicked->position[0] += 1;
    w.snapshots[8] = kicked;
    EXPECT_EQ(std::abs(derived(w).velocity[0] - (2 - unequal[at])) > 1e-3, felt);
    std::swap(w.snapshots[8], w.snapshots[at == 0 ? 9 : 7]);
    w.snapshots[8] = windowOf(unequal, at, {{1, parabola}}).snapshots[8];
    EXPECT_NEAR(derived(w).velocity[0], 2 - unequal[at], 1e-4);
  }
}

TEST(TrackDerivatives, GapsAreBridgedByPointsFartherOff) {
  const std::vector<Track> tracks{{1, parabola, [](int k) { return k != 7 && k != 10 && k != 11; }},
                                  {2, cubic, [](int k) { return k % 2 == 0; }}};
  const TrackSnapshot s = derived(windowOf(unequal, 8, tracks), {3, 9});
  expectDerivatives(s, 0, 2 - 7.5, -1, 1e-4);
  expectDerivatives(s, 1, -1 + 0.5 * 7.5 - 0.375 * 7.5 * 7.5, 0.5 - 0.75 * 7.5, 1e-3);
}

TEST(TrackDerivatives, ShortTracksTellLess) {
  const std::vector<double> times{0, 1, 2, 3, 4};
  std::vector<Track> tracks;
  for (int n = 1; n <= 5; ++n) tracks.push_back({n, parabola, [n](int k) { return k < n; }});
  const TrackSnapshot s = derived(windowOf(times, 0, tracks));
  EXPECT_TRUE(std::isnan(s.velocity[0]) && std::isnan(s.acceleration[0]));
  EXPECT_NEAR(s.velocity[3], parabola(1) - parabola(0), 1e-6);
  EXPECT_TRUE(std::isnan(s.acceleration[3]));
  EXPECT_NEAR(s.velocity[6], 0.5 * (parabola(2) - parabola(0)), 1e-6); // a straight line
  EXPECT_NEAR(s.acceleration[6], -1, 1e-6);
  EXPECT_NEAR(s.acceleration[9], -1, 1e-6);
  expectDerivatives(s, 4, 2, -1, 1e-5);
  EXPECT_EQ(s.velocity.size(), 15u);
}

TEST(TrackDerivatives, WhoHasNoTrackHasNone) {
  const TrackWindow w = windowOf(unequal, 8, {{-1, parabola}, {4, parabola}, {4, cubic}, {6, parabola}});
  auto broken = std::make_shared<TrackSnapshot>(*w.snapshots[8]);
  broken->position[3 * 3 + 1] = missing;
  TrackWindow v = w;
  v.snapshots[8] = broken;
  const TrackSnapshot s = derived(v);
  expectDerivatives(s, 1, 2 - 7.5, -1, 1e-5); // the first of the two with id 4
  for (std::size_t r : {0, 2, 3})
    for (int c = 0; c < 3; ++c)
      EXPECT_TRUE(std::isnan(s.velocity[3 * r + c]) && std::isnan(s.acceleration[3 * r + c])) << r;
  // A broken place elsewhere is a gap.
  auto gap = std::make_shared<TrackSnapshot>(*w.snapshots[7]);
  gap->position[3 * 3] = missing;
  v = w;
  v.snapshots[7] = gap;
  expectDerivatives(derived(v), 3, 2 - 7.5, -1, 1e-4);
  // No ids at all.
  auto nameless = std::make_shared<TrackSnapshot>(*w.snapshots[8]);
  nameless->trackId.clear();
  v.snapshots[8] = nameless;
  EXPECT_TRUE(std::isnan(derived(v).velocity[3]));
}

TEST(TrackDerivatives, OrderOfRowsDoesNotMatter) {
  std::vector<Track> tracks;
  for (int i = 0; i < 50; ++i)
    tracks.push_back({1000 - 7 * i, [i](double t) { return i * parabola(t); },
                      [i](int k) { return k == 8 || (k + i) % 5 != 0; }});
  TrackWindow w = windowOf(unequal, 8, tracks);
  const TrackSnapshot s = derived(w);
  for (std::size_t k : {3, 9, 12}) { // backwards
    TrackSnapshot back;
    for (std::size_t r = w.snapshots[k]->size(); r-- > 0;) {
      back.trackId.push_back(w.snapshots[k]->trackId[r]);
      for (int c = 0; c < 3; ++c) back.position.push_back(w.snapshots[k]->position[3 * r + c]);
    }
    w.snapshots[k] = std::make_shared<TrackSnapshot>(back);
  }
  EXPECT_EQ(derived(w).velocity, s.velocity);
  for (int i = 0; i < 50; ++i) EXPECT_NEAR(s.velocity[3 * i], i * (2 - 7.5), 2e-3);
}

TEST(TrackDerivatives, NoiseGainAndThreads) {
  std::mt19937 random(7);
  std::normal_distribution<double> noise(0, 1);
  const int n = 30000;
  TrackWindow w;
  w.current = 8;
  for (int k = 0; k < 17; ++k) {
    auto s = std::make_shared<TrackSnapshot>();
    for (int i = 0; i < n; ++i) {
      s->trackId.push_back(i);
      for (int c = 0; c < 3; ++c) s->position.push_back(float(5e-6 * noise(random)));
    }
    w.snapshots.push_back(s);
    w.times.push_back(0.001 * k);
  }
  for (const TrackDerivativeOptions& o : {TrackDerivativeOptions{}, {3, 7}, {5, 11}}) {
    TrackSnapshot s = *w.snapshots[8];
    omp_set_num_threads(1);
    const DerivativeGain gain = estimateDerivatives(w, o, s);
    double v = 0, a = 0;
    for (std::size_t i = 0; i < s.velocity.size(); ++i) {
      v += s.velocity[i] * s.velocity[i] / s.velocity.size();
      a += s.acceleration[i] * s.acceleration[i] / s.velocity.size();
    }
    EXPECT_NEAR(std::sqrt(v) / (5e-6 * gain.velocity), 1, 0.01);
    EXPECT_NEAR(std::sqrt(a) / (5e-6 * gain.acceleration), 1, 0.01);
    const DerivativeGain full = derivativeStencil(w.times, 8, o).gain;
    EXPECT_DOUBLE_EQ(gain.velocity, full.velocity);
    EXPECT_DOUBLE_EQ(gain.acceleration, full.acceleration);
    TrackSnapshot again = *w.snapshots[8];
    omp_set_num_threads(3);
    estimateDerivatives(w, o, again);
    EXPECT_EQ(again.velocity, s.velocity);
    EXPECT_EQ(again.acceleration, s.acceleration);
  }
  // Central quadratic over nine points: 1 / (dt sqrt(sum k^2)), sum k^2 = 60.
  EXPECT_NEAR(derivativeStencil(w.times, 8, {2, 9}).gain.velocity, 1000 / std::sqrt(60.0), 1e-6);
}

TEST(TrackDerivatives, EqualTimesAreOneTime) {
  const TrackSnapshot s = derived(windowOf({0, 1, 1, 2}, 1, {{1, parabola}}));
  EXPECT_TRUE(std::isfinite(s.velocity[0]));
  EXPECT_NEAR(s.acceleration[0], -1, 1e-5);
  EXPECT_TRUE(std::isnan(derived(windowOf({1, 1}, 0, {{1, parabola}})).velocity[0]));
}

TEST(TrackDerivatives, WhatCannotBeIsRefused) {
  TrackWindow w = windowOf(unequal, 8, {{1, parabola}});
  for (const TrackDerivativeOptions& o : {TrackDerivativeOptions{1, 7}, {6, 9}, {3, 8}, {3, 3}, {3, 33}})
    EXPECT_THROW(derived(w, o), std::invalid_argument);
  TrackSnapshot other;
  EXPECT_THROW(estimateDerivatives(w, {}, other), std::invalid_argument);
  w.times.pop_back();
  EXPECT_THROW(derived(w), std::invalid_argument);
  EXPECT_EQ(snapshotsEachSide({3, 7}), 6u);
}
