// Breaks when the void likelihood misses the sphere, states a covariance that its errors do not follow,
// depends on the guess, or when its samplers and seeding estimates are wrong.
#include "ImportanceSampling.h"
#include "TracerCloud.h"
#include "VoidLikelihood.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <gtest/gtest.h>

using namespace rimflow;
using Eigen::Vector3d;

namespace {

struct Errors {
  double mean = 0, largest = 0; // in diameters
  double chiSquared = 0;        // per degree of freedom
  double sigma = 0;             // stated, in diameters
};

/// Locates the sphere in independent snapshots, from guesses off by up to 1 mm per axis.
Errors errorsOver(const TracerCloud& cloud, const Vector3d& lower, const Vector3d& upper, int frames = 120) {
  Errors e;
  for (int f = 0; f < frames; ++f) {
    const Vector3d centre = placeBetween(lower, upper, f);
    const auto x = cloud.positions(centre, 1000 + f);
    const ParticleIndex particles(x.data(), x.size() / 3);
    SeedingDensity seeding(particles, 0.25 * cloud.diameter);
    VoidLikelihoodOptions options;
    options.diameter = cloud.diameter;
    const Vector3d off = placeBetween(Vector3d::Constant(-1e-3), Vector3d::Constant(1e-3), f + 100000);
    const VoidEstimate found = locateVoid(particles, seeding, centre + off, options);
    const Vector3d error = found.centre - centre;
    e.mean += error.norm() / cloud.diameter / frames;
    e.largest = std::max(e.largest, error.norm() / cloud.diameter);
    e.chiSquared += error.dot(found.covariance.inverse() * error) / (3 * frames);
    e.sigma += std::sqrt(found.covariance.trace()) / cloud.diameter / frames;
  }
  return e;
}

const Vector3d Middle = Vector3d::Constant(1e-3);

} // namespace

TEST(VoidLikelihood, ReachesTheStatisticalLimitAndKnowsItsError) {
  const Errors e = errorsOver({}, -Middle, Middle);
  EXPECT_LT(e.mean, 0.0045); // measured 0.0034
  EXPECT_LT(e.largest, 0.016);
  EXPECT_GT(e.chiSquared, 0.5);
  EXPECT_LT(e.chiSquared, 1.4);
}

TEST(VoidLikelihood, ThinSeeding) {
  TracerCloud cloud;
  cloud.density = 0.05e9;
  const Errors e = errorsOver(cloud, -Middle, Middle);
  EXPECT_LT(e.mean, 0.04); // measured 0.030
  EXPECT_GT(e.chiSquared, 0.5);
  EXPECT_LT(e.chiSquared, 1.6);
}

TEST(VoidLikelihood, DepletedWake) {
  TracerCloud cloud;
  cloud.seeding = [](const Vector3d& x, const Vector3d& c) {
    const Vector3d r = (x - c) / 5.555e-3;
    return r[1] < 0 && std::hypot(r[0], r[2]) < 0.8 ? 0.2 : 1.;
  };
  const Errors e = errorsOver(cloud, -Middle, Middle);
  EXPECT_LT(e.mean, 0.008); // measured 0.0055
  EXPECT_GT(e.chiSquared, 0.5);
  EXPECT_LT(e.chiSquared, 2);
  EXPECT_GT(e.sigma, 0.005); // wider than in uniform seeding
}

TEST(VoidLikelihood, PartlyOutsideTheVolume) {
  // The centre between R inside and the face itself: up to half of the sphere is cut off.
  const Errors e = errorsOver({}, {-1e-3, -1e-3, 7e-3}, {1e-3, 1e-3, 12.5e-3});
  EXPECT_LT(e.mean, 0.008); // measured 0.0046
  EXPECT_GT(e.chiSquared, 0.5);
  EXPECT_LT(e.chiSquared, 2);
}

TEST(VoidLikelihood, SeedingThatThinsTowardsTheFaces) {
  TracerCloud cloud;
  cloud.seeding = [](const Vector3d& x, const Vector3d&) {
    return std::exp(-0.5 * std::pow(x[2] / 7e-3, 2));
  };
  const Errors e = errorsOver(cloud, {-1e-3, -1e-3, -7e-3}, {1e-3, 1e-3, 7e-3});
  EXPECT_LT(e.mean, 0.008); // measured 0.0046
  EXPECT_GT(e.chiSquared, 0.5);
  EXPECT_LT(e.chiSquared, 2);
}

TEST(VoidLikelihood, TheGuessOnlySelectsTheBasin) {
  const TracerCloud cloud;
  const Vector3d centre(0.4e-3, -0.3e-3, 0.2e-3);
  const auto x = cloud.positions(centre, 5);
  const ParticleIndex particles(x.data(), x.size() / 3);
  VoidLikelihoodOptions options;
  options.diameter = cloud.diameter;
  std::vector<VoidEstimate> found;
  for (const Vector3d& off : {Vector3d(0, 0, 0), Vector3d(3e-3, 0, 0), Vector3d(-2e-3, 2e-3, 2e-3)}) {
    SeedingDensity seeding(particles, 0.25 * cloud.diameter);
    found.push_back(locateVoid(particles, seeding, centre + off, options));
  }
  for (const VoidEstimate& other : found)
    EXPECT_LT((other.centre - found[0].centre).norm(), 0.2 * std::sqrt(found[0].covariance.trace()));
}

TEST(VoidLikelihood, EstimatesGhostsAndCountsThem) {
  TracerCloud cloud;
  cloud.ghosts = 0.1;
  const auto x = cloud.positions(Vector3d::Zero(), 11);
  const ParticleIndex particles(x.data(), x.size() / 3);
  SeedingDensity seeding(particles, 0.25 * cloud.diameter);
  VoidLikelihoodOptions options;
  options.diameter = cloud.diameter;
  const VoidEstimate found = locateVoid(particles, seeding, Vector3d::Zero(), options);
  EXPECT_NEAR(found.ghostRate, 0.1, 0.05);
  EXPECT_NEAR(double(found.particlesInside), 0.1 * found.expectedInside, 15);
  EXPECT_NEAR(found.expectedInside, 0.4e9 * ballVolume(0.5 * cloud.diameter), 40);
  EXPECT_LT(found.centre.norm(), 0.015 * cloud.diameter);
  EXPECT_LT(found.logChance, -50);
}

TEST(VoidLikelihood, CorrectsADiameterThatIsTenPerCentOff) {
  const TracerCloud cloud;
  constexpr int Frames = 12;
  double chiSquared = 0, centreChiSquared = 0, bias = 0;
  for (int f = 0; f < Frames; ++f) {
    const Vector3d centre = placeBetween(-Middle, Middle, f);
    const auto x = cloud.positions(centre, 2000 + f);
    const ParticleIndex particles(x.data(), x.size() / 3);
    SeedingDensity seeding(particles, 0.25 * cloud.diameter);
    VoidLikelihoodOptions options;
    options.diameter = (f % 2 ? 0.9 : 1.1) * cloud.diameter;
    options.diameterSigma = 0.1 * cloud.diameter;
    const VoidEstimate found = locateVoid(particles, seeding, centre, options);
    const double error = found.diameter - cloud.diameter;
    chiSquared += std::pow(error / found.diameterSigma, 2) / Frames;
    bias += error / cloud.diameter / Frames;
    const Vector3d off = found.centre - centre;
    centreChiSquared += off.dot(found.covariance.inverse() * off) / (3 * Frames);
    EXPECT_LT(std::abs(error), 0.02 * cloud.diameter);
    EXPECT_LT(found.diameterSigma, 0.008 * cloud.diameter); // measured 0.0028
  }
  EXPECT_LT(std::abs(bias), 0.003);
  EXPECT_GT(chiSquared, 0.15);
  EXPECT_LT(chiSquared, 2);
  EXPECT_LT(centreChiSquared, 2);
}

TEST(VoidLikelihood, ANeighbourIsNoFluidAndNoPlaceForTheSphere) {
  // Two spheres 0.05 d apart; the other one is known. The guess lies in the middle of the other one.
  TracerCloud cloud;
  Body other;
  other.diameter = 9.53e-3;
  const Vector3d centre(0.4e-3, -3e-3, 0.2e-3);
  other.centre = centre + Vector3d(0, 0.5 * (cloud.diameter + other.diameter) + 0.05 * cloud.diameter, 0);
  cloud.seeding = [&](const Vector3d& x, const Vector3d&) { return other.contains(x) ? 0.005 : 1.; };
  double chiSquared = 0;
  constexpr int Frames = 6;
  for (int f = 0; f < Frames; ++f) {
    const auto x = cloud.positions(centre, 3000 + f);
    const ParticleIndex particles(x.data(), x.size() / 3);
    SeedingDensity seeding(particles, 0.25 * cloud.diameter);
    VoidLikelihoodOptions options;
    options.diameter = cloud.diameter;
    options.others = {other};
    const VoidEstimate found =
        locateVoid(particles, seeding, centre + Vector3d(0, 0.4 * cloud.diameter, 0), options);
    const Vector3d error = found.centre - centre;
    EXPECT_LT(error.norm(), 0.02 * cloud.diameter);
    EXPECT_NEAR(found.expectedInside, cloud.density * ballVolume(0.5 * cloud.diameter), 50);
    chiSquared += error.dot(found.covariance.inverse() * error) / (3 * Frames);
    const VoidEstimate inside = roughVoid(particles, seeding, other.centre, options);
    EXPECT_TRUE(clearOf(options.others, inside.centre, 0.5 * cloud.diameter));
  }
  EXPECT_LT(chiSquared, 2);
}

TEST(VoidLikelihood, RefusesADiameterOfZero) {
  const float x[] = {0, 0, 0};
  const ParticleIndex particles(x, 1);
  SeedingDensity seeding(particles, 1e-3);
  EXPECT_THROW(locateVoid(particles, seeding, Vector3d::Zero(), {}), std::invalid_argument);
}

TEST(ImportanceSampling, MomentsOfACorrelatedGaussianFromAPoorStart) {
  Eigen::Matrix3d covariance;
  covariance << 4, 1.5, 0.2, 1.5, 1, 0.02, 0.2, 0.02, 0.05;
  const Vector3d mean(1, -2, 0.5);
  const Eigen::Matrix3d information = covariance.inverse();
  SamplingOptions options;
  options.samples = 4096;
  const auto p = samplePosterior(
      [&](const Eigen::VectorXd& x) { return -0.5 * (x - mean).dot(information * (x - mean)); },
      Vector3d::Zero(), 9 * Eigen::Matrix3d::Identity(), options);
  EXPECT_LT((p.mean - mean).norm(), 0.05);
  EXPECT_LT((p.covariance - covariance).norm(), 0.1 * covariance.norm());
  EXPECT_GT(p.effectiveSamples, 0.25 * options.samples);
}

TEST(SeedingDensity, FollowsAProfileAndSkipsTheBody) {
  TracerCloud cloud;
  cloud.seeding = [](const Vector3d& x, const Vector3d&) { return 0.5 + x[2] / 0.025; };
  const auto x = cloud.positions(Vector3d::Zero(), 3);
  const ParticleIndex particles(x.data(), x.size() / 3);
  SeedingDensity seeding(particles, 0.25 * cloud.diameter);
  Body body;
  body.diameter = cloud.diameter;
  seeding.exclude({body});
  const double n = cloud.density;
  for (double z : {-8e-3, 0., 8e-3})
    EXPECT_NEAR(seeding.at({0.01, 0.01, z}), n * (0.5 + z / 0.025), 0.15 * n);
  EXPECT_NEAR(seeding.expectedWithin(Vector3d::Zero(), 5e-3), 0.5 * n * ballVolume(5e-3),
              0.1 * n * ballVolume(5e-3));
  EXPECT_EQ(seeding.at({0, 0, 0.02}), 0);
  // d/dz of the integral over the ball is its volume times the slope of n.
  EXPECT_NEAR(seeding.expectedGradient(Vector3d::Zero(), 5e-3)[2], n / 0.025 * ballVolume(5e-3),
              0.4 * n / 0.025 * ballVolume(5e-3));
}

TEST(ParticleIndex, CountsAndLeavesOutWhatIsNotFinite) {
  const TracerCloud cloud;
  auto x = cloud.positions(Vector3d::Zero(), 1);
  for (float bad : {std::nanf(""), INFINITY}) {
    x.push_back(bad);
    x.insert(x.end(), {0.f, 0.f});
  }
  const ParticleIndex particles(x.data(), x.size() / 3);
  EXPECT_EQ(particles.rejected(), 2u);
  const Vector3d at(0.012, -0.01, 0.011);
  std::size_t n = 0;
  for (std::size_t p = 0; p + 2 < x.size() / 3; ++p)
    n += (Eigen::Map<const Eigen::Vector3f>(&x[3 * p]).cast<double>() - at).norm() < 6e-3;
  EXPECT_NEAR(double(particles.countWithin(at, 6e-3)), double(n), 1); // float against double at the rim
}
