// Breaks when the sphere is not captured without a guess, or when something is captured where there is none.
#include "SphereCapture.h"
#include "TracerCloud.h"

#include <gtest/gtest.h>

using namespace rimflow;
using Eigen::Vector3d;

namespace {

CaptureResult capture(const TracerCloud& cloud, const Vector3d& centre, unsigned seed) {
  const auto x = cloud.positions(centre, seed);
  const ParticleIndex particles(x.data(), x.size() / 3);
  SeedingDensity seeding(particles, 0.25 * cloud.diameter);
  VoidLikelihoodOptions sphere;
  sphere.diameter = cloud.diameter;
  return captureSphere(particles, seeding, sphere);
}

/// Captures that are within 0.15 d of the truth, over places anywhere in the volume, the sphere inside it.
int hits(const TracerCloud& cloud, int frames) {
  int n = 0;
  const Vector3d margin = Vector3d::Constant(0.5 * cloud.diameter);
  for (int f = 0; f < frames; ++f) {
    const Vector3d centre = placeBetween(cloud.lower + margin, cloud.upper - margin, f);
    const CaptureResult r = capture(cloud, centre, f);
    n += r.found && (r.centre - centre).norm() < 0.15 * cloud.diameter;
  }
  return n;
}
int falseFinds(TracerCloud cloud, int frames) {
  cloud.sphere = false;
  int n = 0;
  for (int f = 0; f < frames; ++f) {
    const CaptureResult r = capture(cloud, Vector3d::Zero(), f);
    n += r.found;
    EXPECT_TRUE(r.found || !r.reason.empty());
  }
  return n;
}

double lightSheet(const Vector3d& x, const Vector3d&) { return std::exp(-0.5 * std::pow(x[2] / 6e-3, 2)); }
double roundVolume(const Vector3d& x, const Vector3d&) {
  return std::hypot(x[0], x[1]) < 0.018 ? 1. : 0.; // empty corners of the bounding box, 2.2 R across
}

} // namespace

TEST(SphereCapture, FindsTheSphereAnywhere) { EXPECT_EQ(hits({}, 12), 12); }

TEST(SphereCapture, FindsItInThinSeeding) {
  TracerCloud cloud;
  cloud.density = 0.06e9;
  EXPECT_EQ(hits(cloud, 12), 12);
}

TEST(SphereCapture, FindsItInALightSheetAndAmongGhosts) {
  TracerCloud cloud;
  cloud.seeding = lightSheet;
  EXPECT_EQ(hits(cloud, 8), 8);
  cloud.seeding = nullptr;
  cloud.ghosts = 0.1;
  EXPECT_EQ(hits(cloud, 8), 8);
}

TEST(SphereCapture, FindsItWithItsCentreOnAFace) {
  const TracerCloud cloud;
  for (int f = 0; f < 6; ++f) {
    Vector3d centre(1e-3 * f - 3e-3, 0, 0);
    centre[1] = f % 2 ? cloud.upper[1] : cloud.lower[1];
    const CaptureResult r = capture(cloud, centre, f);
    EXPECT_TRUE(r.found) << r.reason;
    EXPECT_LT((r.centre - centre).norm(), 0.15 * cloud.diameter);
  }
}

TEST(SphereCapture, FindsNothingWhereThereIsNoSphere) {
  TracerCloud cloud;
  EXPECT_EQ(falseFinds(cloud, 15), 0);
  cloud.density = 0.04e9;
  EXPECT_EQ(falseFinds(cloud, 15), 0);
}

TEST(SphereCapture, TakesNeitherThinEdgesNorEmptyCornersForASphere) {
  TracerCloud cloud;
  cloud.seeding = lightSheet;
  EXPECT_EQ(falseFinds(cloud, 15), 0);
  cloud.seeding = roundVolume;
  EXPECT_EQ(falseFinds(cloud, 15), 0);
}

TEST(SphereCapture, ClusteredSeedingIsNoSphere) {
  TracerCloud cloud;
  cloud.lower *= 2;
  cloud.upper *= 2;
  std::vector<Vector3d> clusters;
  for (unsigned s = 0; s < 500; ++s) clusters.push_back(placeBetween(cloud.lower, cloud.upper, s));
  cloud.seeding = [&](const Vector3d& x, const Vector3d&) {
    double n = 0;
    for (const Vector3d& c : clusters) n += std::exp(-0.5 * (x - c).squaredNorm() / 9e-6);
    return std::min(1., 0.6 * n);
  };
  EXPECT_EQ(falseFinds(cloud, 4), 0);
}

TEST(SphereCapture, FindsTheSecondOfTwoThatNearlyTouchAndNoThird) {
  TracerCloud cloud; // 11.11 mm, and one of 9.53 mm at 0.05 d from it
  const Vector3d centre(-5e-3, 0, 0);
  Body small;
  small.diameter = 9.53e-3;
  small.centre = centre + Vector3d(0.5 * (cloud.diameter + small.diameter) + 0.05 * small.diameter, 0, 0);
  cloud.seeding = [&](const Vector3d& x, const Vector3d&) { return small.contains(x) ? 0.005 : 1.; };
  const auto x = cloud.positions(centre, 8);
  const ParticleIndex particles(x.data(), x.size() / 3);
  SeedingDensity seeding(particles, 0.25 * cloud.diameter);
  VoidLikelihoodOptions sphere;
  sphere.diameter = cloud.diameter;
  const CaptureResult first = captureSphere(particles, seeding, sphere);
  ASSERT_TRUE(first.found) << first.reason;
  EXPECT_LT((first.centre - centre).norm(), 0.05 * cloud.diameter);
  Body large;
  large.diameter = cloud.diameter;
  large.centre = first.centre;
  sphere.diameter = small.diameter;
  sphere.others = {large};
  const CaptureResult second = captureSphere(particles, seeding, sphere);
  ASSERT_TRUE(second.found) << second.reason;
  EXPECT_LT((second.centre - small.centre).norm(), 0.05 * small.diameter);
  sphere.others = {large, small};
  EXPECT_FALSE(captureSphere(particles, seeding, sphere).found);
  // The smaller one's void is none for the larger.
  sphere.diameter = cloud.diameter;
  sphere.others = {large};
  EXPECT_FALSE(captureSphere(particles, seeding, sphere).found);
}

TEST(SphereCapture, ADepletedStripeIsNoSphere) {
  TracerCloud cloud;
  cloud.lower = {-0.03, -0.03, -0.0125};
  cloud.upper = {0.03, 0.03, 0.0125};
  cloud.seeding = [](const Vector3d& x, const Vector3d&) { return std::hypot(x[0], x[2]) < 5e-3 ? 0.1 : 1.; };
  EXPECT_EQ(falseFinds(cloud, 4), 0);
}

TEST(SphereCapture, FitsADiameterThatIsNotKnownExactly) {
  const TracerCloud cloud;
  const auto x = cloud.positions(Vector3d::Zero(), 21);
  const ParticleIndex particles(x.data(), x.size() / 3);
  SeedingDensity seeding(particles, 0.25 * cloud.diameter);
  VoidLikelihoodOptions sphere;
  sphere.diameter = 1.05 * cloud.diameter;
  sphere.diameterSigma = 0.05 * cloud.diameter;
  const CaptureResult r = captureSphere(particles, seeding, sphere);
  ASSERT_TRUE(r.found) << r.reason;
  EXPECT_NEAR(r.diameter, cloud.diameter, 0.015 * cloud.diameter);
}

TEST(SphereCapture, SaysSoWhenThereAreHardlyAnyParticles) {
  TracerCloud cloud;
  cloud.density = 1e5;
  const CaptureResult r = capture(cloud, Vector3d::Zero(), 1);
  EXPECT_FALSE(r.found);
  EXPECT_NE(r.reason.find("particles"), std::string::npos);
}
