// Breaks when ghosts stay in, true particles are thrown out (in noise, in steep gradients, where the fluid
// rests), or a ghost spoils its neighbours.
#include "AnalyticFlows.h"
#include "MedianTest.h"
#include "TrackSynthesis.h"

#include <cmath>
#include <gtest/gtest.h>
#include <limits>
#include <omp.h>
#include <random>

using namespace rimflow;

namespace {

struct Cloud {
  std::vector<float> x, u, a;
  std::vector<char> ghost;
  std::size_t size() const { return ghost.size(); }
  MedianTestResult test() const { return medianTest(x.data(), u.data(), a.data(), size()); }
};

/// ABC flow, eight particle distances per wavelength; noise relative to the rms per component.
Cloud turbulent(std::size_t count, double velocityNoise, double accelerationNoise, unsigned seed) {
  AnalyticFlow flow;
  flow.kind = FlowKind::ABC;
  flow.viscosity = 0;
  const double side = flow.wavelength / 8 * std::cbrt(double(count));
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> unit(0, 1);
  std::normal_distribution<double> normal;
  Cloud c;
  double u2 = 0, a2 = 0;
  for (std::size_t p = 0; p < count; ++p) {
    const Eigen::Vector3d x(side * unit(random), side * unit(random), side * unit(random));
    const Eigen::Vector3d u = flow.velocity(x, 0), a = flow.acceleration(x, 0);
    u2 += u.squaredNorm() / (3. * double(count));
    a2 += a.squaredNorm() / (3. * double(count));
    for (int i = 0; i < 3; ++i) {
      c.x.push_back(float(x[i]));
      c.u.push_back(float(u[i]));
      c.a.push_back(float(a[i]));
    }
    c.ghost.push_back(0);
  }
  for (float& v : c.u) v += float(velocityNoise * std::sqrt(u2) * normal(random));
  for (float& v : c.a) v += float(accelerationNoise * std::sqrt(a2) * normal(random));
  return c;
}

/// Some particles get random velocities (per component up to `speed`) and accelerations (rms per component).
Cloud withGhosts(Cloud c, double part, double speed, double acceleration, unsigned seed) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> unit(0, 1);
  std::normal_distribution<double> normal;
  for (std::size_t p = 0; p < c.size(); ++p) {
    if (unit(random) > part) continue;
    c.ghost[p] = 1;
    for (int i = 0; i < 3; ++i) {
      c.u[3 * p + i] = float(speed * (2 * unit(random) - 1));
      c.a[3 * p + i] = float(acceleration * normal(random));
    }
  }
  return c;
}

struct Rates {
  int ghosts = 0, found = 0, particles = 0, wrong = 0;
  double detected() const { return double(found) / std::max(1, ghosts); }
  double lost() const { return double(wrong) / std::max(1, particles); }
};

Rates rates(const Cloud& c, const MedianTestResult& r) {
  Rates k;
  for (std::size_t p = 0; p < c.size(); ++p) {
    ++(c.ghost[p] ? k.ghosts : k.particles);
    if (r.outlier[p]) ++(c.ghost[p] ? k.found : k.wrong);
  }
  return k;
}

} // namespace

TEST(MedianTest, FindsGhostsAndLeavesTheRest) {
  for (double noise : {0., 0.05}) {
    const Cloud plain = turbulent(12000, noise, 4 * noise, 1);
    EXPECT_LT(rates(plain, plain.test()).lost(), 0.002) << "noise " << noise;
    for (double part : {0.01, 0.05, 0.1}) {
      const Cloud c = withGhosts(plain, part, 0.5, 15, 2);
      const Rates k = rates(c, c.test());
      ASSERT_GT(k.ghosts, 80);
      EXPECT_GT(k.detected(), 0.95) << part << " ghosts, noise " << noise;
      EXPECT_LT(k.lost(), 0.002) << part << " ghosts, noise " << noise;
    }
  }
}

TEST(MedianTest, KnowsTheNoise) {
  const Cloud noisy = turbulent(12000, 0.2, 0.4, 3), ghosts = withGhosts(noisy, 0.05, 0.5, 15, 4);
  AnalyticFlow flow;
  double u2 = 0;
  const Cloud clean = turbulent(12000, 0, 0, 3);
  for (float u : clean.u) u2 += double(u) * u / double(clean.u.size());
  // a lower quartile, and the curvature of the flow on top
  EXPECT_NEAR(noisy.test().velocityNoise, 0.2 * std::sqrt(u2), 0.03 * std::sqrt(u2));
  EXPECT_NEAR(ghosts.test().velocityNoise, noisy.test().velocityNoise, 0.1 * noisy.test().velocityNoise);
}

TEST(MedianTest, OneKindOfDataIsEnough) {
  Cloud c = turbulent(6000, 0.03, 0.1, 5);
  const std::size_t fast = 1000, jerky = 2000;
  c.u[3 * fast] += 0.3f;
  c.a[3 * jerky + 1] += 15;
  const MedianTestResult both = c.test(), velocity = medianTest(c.x.data(), c.u.data(), nullptr, c.size());
  EXPECT_EQ(both.outlier[fast], 1);
  EXPECT_EQ(both.outlier[jerky], 2);
  EXPECT_EQ(velocity.outlier[fast], 1);
  EXPECT_EQ(velocity.outlier[jerky], 0);
  EXPECT_EQ(both.count, 2u);
}

TEST(MedianTest, GhostsSideBySideHideNeitherEachOtherNorTheirNeighbours) {
  Cloud c = turbulent(6000, 0.03, 0.1, 6);
  std::size_t pairs = 0;
  for (std::size_t p = 0; p + 1 < c.size(); p += 200, ++pairs)
    for (std::size_t q : {p, p + 1}) {
      c.ghost[q] = 1;
      for (int i = 0; i < 3; ++i) {
        c.x[3 * q + i] = c.x[3 * p + i] + (q == p ? 0 : 5e-4f);
        c.u[3 * q + i] = i == 0 ? 0.6f : 0; // alike
      }
    }
  const Rates k = rates(c, c.test());
  ASSERT_EQ(k.ghosts, int(2 * pairs));
  EXPECT_GT(k.detected(), 0.9); // where two pairs meet, four alike pass for the flow
  EXPECT_LT(k.lost(), 0.002);
}

TEST(MedianTest, TheLayerAtASphereStays) {
  TrackSynthesisOptions o;
  o.flow.kind = FlowKind::StokesSphere;
  o.flow.body.diameter = 9.5e-3;
  o.flow.body.velocity = Eigen::Vector3d(0, 0.25, 0);
  o.snapshots = 5;
  o.ghostFraction = 0.01;
  for (double noise : {0., 0.0025}) {
    o.velocityNoise = noise;
    o.accelerationNoise = 20 * noise;
    TrackSynthesis tracks;
    ASSERT_TRUE(tracks.prepare(o));
    const SyntheticSnapshot s = tracks.snapshot(2, true);
    const MedianTestResult r =
        medianTest(s.position.data(), s.velocity.data(), s.acceleration.data(), s.size());
    const Body body = o.flow.bodyAt(tracks.time(2));
    int near = 0, lost = 0, ghosts = 0, found = 0;
    for (std::size_t p = 0; p < s.size(); ++p) {
      const double d = body.signedDistance(
          Eigen::Vector3d(s.position[3 * p], s.position[3 * p + 1], s.position[3 * p + 2]));
      if (s.trueTracerId[p] < 0)
        ++ghosts, found += r.outlier[p] != 0;
      else if (d < 0.25 * body.diameter)
        ++near, lost += r.outlier[p] != 0;
    }
    ASSERT_GT(near, 400);
    ASSERT_GT(ghosts, 100);
    EXPECT_LE(lost, 0.01 * near) << "noise " << noise;
    EXPECT_GT(found, 0.9 * ghosts) << "noise " << noise; // some are like the flow
  }
}

TEST(MedianTest, FluidAtRestIsNoOutlier) {
  Cloud c = turbulent(4000, 0, 0, 7);
  for (std::size_t e = 0; e < c.u.size(); ++e) c.u[e] = c.a[e] = 0; // as a file with few digits has it
  EXPECT_EQ(c.test().count, 0u);
  c.u[300] = 0.1f;
  EXPECT_EQ(c.test().count, 1u);
  for (std::size_t e = 0; e < c.u.size(); ++e) c.u[e] = e % 3 == 1 ? 1.f : 0.f;
  for (std::size_t e = 0; e < c.u.size(); e += 31) c.u[e] += 1e-4f; // the last digit
  EXPECT_EQ(c.test().count, 0u);
}

TEST(MedianTest, WildValuesHideNothing) {
  Cloud c = turbulent(6000, 0.03, 0.1, 11);
  const std::size_t ghost = 500;
  c.u[3 * ghost] += 0.4f;
  for (float wild : {1e4f, 1e30f}) {
    c.u[3 * 1000 + 2] = wild; // as some programs mark what they do not know
    const MedianTestResult r = c.test();
    EXPECT_EQ(r.count, 2u) << wild;
    EXPECT_EQ(r.outlier[1000], 1) << wild;
    EXPECT_EQ(r.outlier[ghost], 1) << wild;
  }
}

TEST(MedianTest, TheNumberOfThreadsDoesNotMatter) {
  const Cloud c = withGhosts(turbulent(6000, 0.05, 0.2, 8), 0.05, 0.3, 5, 9);
  const int threads = omp_get_max_threads();
  omp_set_num_threads(1);
  const MedianTestResult one = c.test();
  omp_set_num_threads(3);
  const MedianTestResult three = c.test();
  omp_set_num_threads(threads);
  EXPECT_EQ(one.outlier, three.outlier);
  EXPECT_EQ(one.velocityNoise, three.velocityNoise);
}

TEST(MedianTest, TakesWhatIsNotFiniteOrTooLittle) {
  Cloud c = turbulent(3000, 0.05, 0.2, 10);
  const float nan = std::numeric_limits<float>::quiet_NaN();
  for (std::size_t p = 0; p < 300; p += 3) c.x[3 * p] = c.u[3 * p + 4] = c.a[3 * p + 8] = nan;
  for (int i = 0; i < 3; ++i) c.x[3000 + i] = c.x[3003 + i]; // two at one place
  const MedianTestResult r = c.test();
  for (std::size_t p = 0; p < 300; p += 3) {
    EXPECT_EQ(r.outlier[p], 0);     // position
    EXPECT_EQ(r.outlier[p + 1], 0); // velocity
  }
  EXPECT_LE(r.count, 2u); // of those at one place, one is elsewhere
  EXPECT_EQ(medianTest(c.x.data(), c.u.data(), c.a.data(), 5).count, 0u);
  EXPECT_EQ(medianTest(nullptr, nullptr, nullptr, 0).count, 0u);
  EXPECT_THROW(medianTest(c.x.data(), c.u.data(), nullptr, 100, {4, 2.5}), std::invalid_argument);
  EXPECT_THROW(medianTest(c.x.data(), c.u.data(), nullptr, 100, {14, 0}), std::invalid_argument);
}
