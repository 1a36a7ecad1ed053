// Breaks when several snapshots together place the sphere no better than each alone, when the stated
// uncertainty shrinks although the same tracers are seen again and again, or when ghost tracks push the path
// aside.
#include "PathPosterior.h"
#include "SphereTracker.h"
#include "TrackSynthesis.h"
#include "TrajectorySmoother.h"

#include <Eigen/Cholesky>
#include <gtest/gtest.h>

using namespace rimflow;
using Eigen::Vector3d;

namespace {

constexpr double Step = 1e-3, Diameter = 9.53e-3;
const Vector3d Velocity(0.03, 0.25, -0.02);

struct Scene {
  double density = 0.4e9, noise = 5e-6;
  int snapshots = 20;
  double acceleration = 0; // along the motion, m/s2
  bool moving = true, ids = true, freshTracers = false, ghostTrack = false, velocities = false;

  double time(int k) const { return Step * (k - 0.5 * (snapshots - 1)); }
  Vector3d place(int k) const {
    const double t = time(k);
    return moving ? Vector3d(Velocity * t + 0.5 * acceleration * t * t * Velocity.normalized())
                  : Vector3d::Zero();
  }

  TrackSynthesis tracks(unsigned seed) const {
    TrackSynthesisOptions
        o; // creeping flow around the sphere: tracers pass it, and stay near the wall for long
    o.flow.kind = FlowKind::StokesSphere;
    o.flow.body.diameter = Diameter;
    o.flow.body.velocity = moving ? Velocity : Vector3d::Zero();
    o.flow.body.acceleration = acceleration * Velocity.normalized();
    o.velocityNoise = 2e-3;
    o.flow.referenceTime = 0.5 * (snapshots - 1) * Step;
    o.bounds = {-0.011, 0.011, -0.013, 0.013, -0.011, 0.011};
    o.density = density;
    o.snapshots = snapshots;
    o.framePeriod = Step;
    o.positionNoise = noise;
    o.dropOut = 0.05;
    o.seed = seed;
    TrackSynthesis synthesis;
    synthesis.prepare(o);
    return synthesis;
  }

  std::vector<CentreEstimate> estimates(unsigned seed) const {
    TrackerOptions options;
    options.likelihood.diameter = Diameter;
    SphereTracker tracker(options);
    TrackSynthesis synthesis = tracks(seed);
    std::vector<CentreEstimate> estimates;
    for (int k = 0; k < snapshots; ++k) {
      if (freshTracers && k > 0) synthesis = tracks(seed + 1000 * k);
      SyntheticSnapshot s = synthesis.snapshot(k);
      if (ghostTrack) { // stays just inside the wall for the whole time
        const Vector3d at = place(k) + Vector3d(0, 0, 0.5 * Diameter - 0.3e-3);
        for (int a = 0; a < 3; ++a) s.position.push_back(float(at[a]));
        s.trackId.push_back(1 << 30);
      }
      const SnapshotParticles particles(s.position.data(), s.trackId.size(),
                                        velocities ? s.velocity.data() : nullptr,
                                        ids ? s.trackId.data() : nullptr);
      const LocatedSphere& found = tracker.locate(Step * k, particles);
      estimates.push_back({Step * k, found.found, found.centre, found.covariance, found.wall});
    }
    return estimates;
  }
};

SmootherOptions joint() {
  SmootherOptions options;
  options.radius = 0.5 * Diameter;
  return options;
}

double meanError(const Scene& scene, const std::vector<SmoothedCentre>& points) {
  double sum = 0;
  for (int k = 0; k < scene.snapshots; ++k) sum += (points[k].centre - scene.place(k)).norm() / Diameter;
  return sum / scene.snapshots;
}

} // namespace

TEST(PathPosterior, FreshTracersInEachSnapshotMakeItTruer) {
  Scene scene;
  scene.freshTracers = true;
  scene.ids = false;
  const auto estimates = scene.estimates(50);
  double single = 0;
  for (int k = 0; k < scene.snapshots; ++k)
    single += (estimates[k].centre - scene.place(k)).norm() / Diameter / scene.snapshots;
  const SmoothedTrajectory t = smoothTrajectory(estimates, joint());
  EXPECT_EQ(t.joint, scene.snapshots);
  EXPECT_LT(meanError(scene, t.points), 0.3 * single); // an average of 20 would give 0.22
}

TEST(PathPosterior, ItsErrorFollowsItsUncertaintyThoughTracersStayAtTheWall) {
  Scene scene;
  double velocity = 0, chiSquared = 0;
  constexpr int Cases = 6;
  for (int c = 0; c < Cases; ++c) {
    const auto estimates = scene.estimates(100 + c);
    const SmoothedTrajectory t = smoothTrajectory(estimates, joint());
    EXPECT_NEAR(t.positionNoise, scene.noise, 0.3 * scene.noise);
    const int k = scene.snapshots / 2;
    const Vector3d error = t.points[k].centre - scene.place(k);
    chiSquared += error.dot(t.points[k].centreCovariance.llt().solve(error)) / (3 * Cases);
    velocity += (t.points[k].velocity - Velocity).norm() / Velocity.norm() / Cases;
  }
  EXPECT_GT(chiSquared, 0.2);
  EXPECT_LT(chiSquared, 2.5); // measured 1.5
  EXPECT_LT(velocity, 0.006); // measured 0.003
}

TEST(PathPosterior, TheFlowTellsTheVelocityOfASphereThatSpeedsUp) {
  Scene scene;
  scene.velocities = true;
  scene.acceleration = 3;
  const SmoothedTrajectory t = smoothTrajectory(scene.estimates(4), joint());
  for (const int k : {1, 10, 18}) {
    const Vector3d velocity = Velocity + scene.acceleration * scene.time(k) * Velocity.normalized();
    EXPECT_LT((t.points[k].velocity - velocity).norm(), 0.006 * Velocity.norm()) << k;
    EXPECT_GT(t.points[k].angularVelocitySigma.minCoeff(), 0);
  }
  EXPECT_LT(meanError(scene, t.points), 0.004);
}

TEST(PathPosterior, TheSameTracersAgainSayNothingNew) {
  Scene scene;
  scene.moving = false;
  const auto still = scene.estimates(7);
  const SmoothedTrajectory same = smoothTrajectory(still, joint());
  scene.freshTracers = true;
  scene.ids = false;
  const SmoothedTrajectory fresh = smoothTrajectory(scene.estimates(7), joint());
  const auto sigma = [](const SmoothedTrajectory& t) {
    return std::sqrt(t.points[10].centreCovariance.trace());
  };
  const double single = std::sqrt(still[10].covariance.trace());
  EXPECT_GT(sigma(same), 0.35 * single); // of 20 snapshots: independent ones would give 0.22 and less
  EXPECT_LT(sigma(fresh), 0.25 * single);
}

TEST(PathPosterior, GhostTracksDoNotPushThePathAside) {
  Scene scene;
  scene.ghostTrack = true;
  const SmoothedTrajectory t = smoothTrajectory(scene.estimates(11), joint());
  EXPECT_LT(meanError(scene, t.points), 0.006); // the ghost is 0.031 d inside the wall in all 20 snapshots
}

TEST(PathPosterior, WhatElseIsKnownOfTheMotionCounts) {
  Scene scene;
  scene.density = 0.1e9;
  const auto estimates = scene.estimates(3);
  PathOptions options;
  options.radius = 0.5 * Diameter;
  options.positionNoise = scene.noise;
  MotionEstimate motion;
  motion.time = Step * 0.5 * (scene.snapshots - 1);
  motion.velocity = Velocity;
  motion.covariance.topLeftCorner<6, 6>() *= 1e-12; // 1 um, 1 um/s; 1 m/s2
  options.motion = {motion};
  const PathPosterior p = samplePath(estimates, {motion.time}, options);
  EXPECT_LT(p.points[0].centre.norm(), 4e-6);
  EXPECT_LT((p.points[0].velocity - Velocity).norm(), 1e-5);
}

TEST(PathPosterior, AbruptMotionAndFewSnapshotsKeepTheSmoothersResult) {
  EXPECT_EQ(pathIntervals(0.04, 0, 1e-5), 1);
  EXPECT_GT(pathIntervals(0.04, 1e6, 1e-5), 6);
  Scene scene;
  scene.snapshots = 3;
  EXPECT_EQ(smoothTrajectory(scene.estimates(1), joint()).joint, 0);
}

TEST(PathPosterior, SaysWhatIsWrong) {
  Scene scene;
  scene.snapshots = 4;
  auto estimates = scene.estimates(1);
  PathOptions options;
  EXPECT_THROW(samplePath(estimates, {0}, options), std::invalid_argument); // no radius
  options.radius = 0.5 * Diameter;
  options.positionNoise = 5e-6;
  EXPECT_THROW(samplePath({estimates[0]}, {0}, options), std::invalid_argument);
  estimates[1].wall = nullptr;
  EXPECT_THROW(samplePath(estimates, {0}, options), std::invalid_argument);
}
