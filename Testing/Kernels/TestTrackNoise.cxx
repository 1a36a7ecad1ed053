// Breaks when the noise of tracks is told wrongly: white or smoothed by the tracker, with ghosts, gaps and
// missing values.
#include "TrackNoise.h"
#include "TrackSynthesis.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <gtest/gtest.h>
#include <map>
#include <omp.h>
#include <random>

using namespace rimflow;

namespace {

const float missing = std::numeric_limits<float>::quiet_NaN();
constexpr double positionNoise = 5e-6, velocityNoise = 0.0025, accelerationNoise = 0.05;

/// About 8000 tracers that swirl all over the box.
TrackSynthesisOptions swirl() {
  TrackSynthesisOptions o;
  o.flow.kind = FlowKind::ABC;
  o.flow.wavelength = 0.03;
  o.bounds = {-0.016, 0.016, -0.016, 0.016, -0.014, 0.014};
  o.density = 2.8e8;
  o.snapshots = 13;
  return o;
}

std::vector<TrackSnapshot> snapshots(const TrackSynthesisOptions& o) {
  TrackSynthesis synthesis;
  synthesis.prepare(o);
  std::vector<TrackSnapshot> out;
  for (int k = 0; k < o.snapshots; ++k) {
    SyntheticSnapshot s = synthesis.snapshot(k);
    out.push_back({s.position, s.velocity, s.acceleration, {}, s.trackId, {}});
  }
  return out;
}

TrackWindow windowOf(const std::vector<TrackSnapshot>& from, std::size_t current = 6, double period = 0.001) {
  TrackWindow w;
  for (std::size_t k = 0; k < from.size(); ++k) {
    w.snapshots.push_back(std::make_shared<TrackSnapshot>(from[k]));
    w.times.push_back(43 + period * k);
  }
  w.current = current;
  return w;
}

/// White noise as a tracker leaves it that fits polynomials over `length` frames; three standard deviations.
TrackNoise addSmoothedNoise(std::vector<TrackSnapshot>& to, int order, int length) {
  const int half = length / 2;
  Eigen::MatrixXd powers(length, order + 1);
  for (int i = 0; i < length; ++i)
    for (int j = 0; j <= order; ++j) powers(i, j) = std::pow(0.001 * (i - half), j);
  Eigen::MatrixXd w = (powers.transpose() * powers).ldlt().solve(powers.transpose()).topRows(3);
  w.row(2) *= 2;
  w *= positionNoise / w.row(0).norm();
  std::mt19937 random(11);
  std::normal_distribution<double> normal(0, 1);
  std::map<std::int64_t, Eigen::MatrixXd> raw;
  for (std::size_t k = 0; k < to.size(); ++k)
    for (std::size_t r = 0; r < to[k].size(); ++r) {
      Eigen::MatrixXd& track = raw[to[k].trackId[r]];
      if (track.size() == 0)
        track = Eigen::MatrixXd::NullaryExpr(to.size() + length, 3, [&] { return normal(random); });
      const Eigen::MatrixXd noise = w * track.middleRows(k, length);
      for (int c = 0; c < 3; ++c) {
        to[k].position[3 * r + c] += float(noise(0, c));
        to[k].velocity[3 * r + c] += float(noise(1, c));
        to[k].acceleration[3 * r + c] += float(noise(2, c));
      }
    }
  return {w.row(0).norm(), w.row(1).norm(), w.row(2).norm()};
}

void expectWithin(double share, const TrackNoise& found, const TrackNoise& truth) {
  EXPECT_NEAR(found.position / truth.position, 1, share);
  EXPECT_NEAR(found.velocity / truth.velocity, 1, share);
  EXPECT_NEAR(found.acceleration / truth.acceleration, 1, share);
}

const TrackNoise white{positionNoise, velocityNoise, accelerationNoise};

TrackSynthesisOptions whiteSwirl() {
  TrackSynthesisOptions o = swirl();
  o.positionNoise = positionNoise;
  o.velocityNoise = velocityNoise;
  o.accelerationNoise = accelerationNoise;
  return o;
}

} // namespace

TEST(TrackNoise, WhiteNoise) {
  const auto s = snapshots(whiteSwirl());
  expectWithin(0.06, measureTrackNoise(windowOf(s)), white);
  // At the first snapshot, and with seven snapshots only.
  expectWithin(0.06, measureTrackNoise(windowOf(s, 0)), white);
  expectWithin(0.08, measureTrackNoise(windowOf({s.begin(), s.begin() + 7}, 3)), white);
}

TEST(TrackNoise, WithGhostsGapsAndMissingVelocities) {
  TrackSynthesisOptions o = whiteSwirl();
  o.dropOut = 0.1;
  o.ghostFraction = 0.05;
  auto s = snapshots(o);
  expectWithin(0.08, measureTrackNoise(windowOf(s)), white);
  for (TrackSnapshot& k : s)
    for (std::size_t r = 0; r < k.size(); ++r)
      if (k.trackId[r] % 3 == 0) k.velocity[3 * r] = k.acceleration[3 * r + 2] = missing;
  expectWithin(0.08, measureTrackNoise(windowOf(s)), white);
}

TEST(TrackNoise, EachComponentCounts) {
  auto s = snapshots(swirl());
  std::mt19937 random(3);
  std::normal_distribution<double> normal(0, 1);
  for (TrackSnapshot& k : s)
    for (std::size_t i = 0; i < k.position.size(); ++i)
      k.position[i] += float((i % 3 == 2 ? 12e-6 : 3e-6) * normal(random));
  EXPECT_NEAR(measureTrackNoise(windowOf(s)).position, std::sqrt((9 + 9 + 144) / 3.0) * 1e-6, 0.5e-6);
}

TEST(TrackNoise, SmoothedByTheTracker) {
  const auto clean = snapshots(swirl());
  for (const auto& [order, length] : {std::pair<int, int>{2, 7}, {2, 11}, {3, 7}, {3, 11}}) {
    auto s = clean;
    const TrackNoise truth = addSmoothedNoise(s, order, length);
    SCOPED_TRACE(std::to_string(order) + " over " + std::to_string(length));
    expectWithin(0.2, measureTrackNoise(windowOf(s)), truth);
  }
}

TEST(TrackNoise, OfEstimatedDerivatives) {
  for (bool smoothed : {false, true}) {
    auto s = snapshots(smoothed ? swirl() : whiteSwirl());
    const auto clean = snapshots(swirl());
    if (smoothed) addSmoothedNoise(s, 2, 9);
    const TrackWindow w = windowOf(s), exact = windowOf(clean);
    TrackSnapshot here = s[6], truth = clean[6];
    const DerivativeGain gain = estimateDerivatives(w, {}, here);
    estimateDerivatives(exact, {}, truth); // so that only noise differs
    const auto spread = [](const std::vector<float>& a, const std::vector<float>& b) {
      std::vector<double> d;
      for (std::size_t i = 0; i < a.size(); ++i)
        if (std::isfinite(a[i])) d.push_back(std::abs(double(a[i]) - b[i]));
      std::nth_element(d.begin(), d.begin() + d.size() / 2, d.end());
      return 1.4826 * d[d.size() / 2];
    };
    const TrackNoise found = measureTrackNoise(w, {}, gain);
    const double share = smoothed ? 0.25 : 0.1;
    SCOPED_TRACE(smoothed ? "smoothed" : "white");
    expectWithin(share, found,
                 {positionNoise, spread(here.velocity, truth.velocity),
                  spread(here.acceleration, truth.acceleration)});
  }
}

TEST(TrackNoise, CleanTracksHaveLittle) {
  auto s = snapshots(swirl());
  for (TrackSnapshot& k : s)
    for (float& x : k.position) x = float(std::round(x * 1e7) * 1e-7); // a file's 1e-4 mm
  const TrackNoise n = measureTrackNoise(windowOf(s));
  EXPECT_GE(n.position, 1e-8);
  EXPECT_LT(n.position, 0.1 * positionNoise);
  EXPECT_GE(n.velocity, 0);
  EXPECT_LT(n.velocity, 0.1 * velocityNoise);
  EXPECT_GE(n.acceleration, 0);
  EXPECT_LT(n.acceleration, 0.1 * accelerationNoise);
  for (TrackSnapshot& k : s) std::fill(k.velocity.begin(), k.velocity.end(), 0.0f);
  EXPECT_EQ(measureTrackNoise(windowOf(s)).velocity, 0);
}

TEST(TrackNoise, ShortTracksAndUnequalTimes) {
  auto s = snapshots(whiteSwirl());
  for (std::size_t k = 0; k < s.size(); ++k) // tracks of five snapshots at most
    for (std::int64_t& id : s[k].trackId) id = 10 * id + (k + id) / 5;
  TrackWindow w = windowOf(s);
  const TrackNoise found = measureTrackNoise(w);
  EXPECT_NEAR(found.position / positionNoise, 1, 0.1);
  EXPECT_NEAR(found.velocity / velocityNoise, 1, 0.1);
  EXPECT_NEAR(found.acceleration / accelerationNoise, 1, 0.1);
  const auto whole = snapshots(whiteSwirl());
  std::vector<TrackSnapshot> some;
  TrackWindow uneven;
  for (int k : {0, 1, 3, 4, 5, 7, 8, 10, 12}) {
    uneven.snapshots.push_back(std::make_shared<TrackSnapshot>(whole[k]));
    uneven.times.push_back(0.001 * k);
  }
  uneven.current = 4;
  expectWithin(0.1, measureTrackNoise(uneven), white);
}

TEST(TrackNoise, WhatCannotBeToldIsNotANumber) {
  auto s = snapshots(whiteSwirl());
  for (TrackSnapshot& k : s) k.velocity.clear(), k.acceleration.clear();
  const TrackNoise positions = measureTrackNoise(windowOf(s));
  EXPECT_NEAR(positions.position, positionNoise, 0.1 * positionNoise);
  EXPECT_TRUE(std::isnan(positions.velocity) && std::isnan(positions.acceleration));
  // One snapshot, without tracks: the neighbours tell of velocities only.
  s = snapshots(whiteSwirl());
  s.resize(1);
  s[0].trackId.clear();
  const TrackNoise alone = measureTrackNoise(windowOf(s, 0));
  EXPECT_TRUE(std::isnan(alone.position));
  EXPECT_NEAR(alone.velocity, velocityNoise, 0.1 * velocityNoise);
  // Nothing at all.
  const TrackNoise empty = measureTrackNoise(windowOf({TrackSnapshot{}, TrackSnapshot{}}, 0));
  EXPECT_TRUE(std::isnan(empty.position) && std::isnan(empty.velocity));
}

TEST(TrackNoise, AFewTracksTellByThemselves) {
  auto s = snapshots(whiteSwirl());
  for (TrackSnapshot& k : s) {
    TrackSnapshot few;
    for (std::size_t r = 0; r < k.size(); ++r) {
      if (k.trackId[r] % 240 != 0) continue;
      few.trackId.push_back(k.trackId[r]);
      for (int c = 0; c < 3; ++c) {
        few.position.push_back(k.position[3 * r + c]);
        few.velocity.push_back(k.velocity[3 * r + c]);
      }
    }
    k = few;
  }
  ASSERT_GT(s[6].size(), 20u);
  ASSERT_LT(s[6].size(), 60u);
  const TrackNoise found = measureTrackNoise(windowOf(s));
  EXPECT_NEAR(found.position / positionNoise, 1, 0.2);
  EXPECT_NEAR(found.velocity / velocityNoise, 1, 0.2);
}

TEST(TrackNoise, NumberOfThreadsDoesNotMatter) {
  const TrackWindow w = windowOf(snapshots(whiteSwirl()));
  omp_set_num_threads(1);
  const TrackNoise one = measureTrackNoise(w);
  omp_set_num_threads(3);
  const TrackNoise three = measureTrackNoise(w);
  EXPECT_EQ(one.position, three.position);
  EXPECT_EQ(one.velocity, three.velocity);
  EXPECT_EQ(one.acceleration, three.acceleration);
}
