// Breaks when the velocity or rotation of a sphere is not found from the flow next to its wall, when their
// covariances are not true (thin layers, several snapshots, correlated errors), or when ghosts spoil them.
#include "AnalyticFlows.h"
#include "TangentialHarmonics.h"
#include "TrackSynthesis.h"
#include "WallMotion.h"

#include <Eigen/Cholesky>
#include <cmath>
#include <functional>
#include <gtest/gtest.h>
#include <random>

using namespace rimflow;
using Eigen::Matrix3d;
using Eigen::Vector3d;

namespace {

constexpr double R = 0.005, Speed = 0.3;
using Flow = std::function<Vector3d(const Vector3d&)>; // of the offset from the centre
using Snapshots = std::vector<std::vector<WallParticle>>;

Vector3d normal(std::mt19937& random) {
  std::normal_distribution<double> n;
  const double x = n(random), y = n(random), z = n(random);
  return {x, y, z};
}

struct Seeding {
  double density = 4e8;          // 1/m3
  double velocityNoise = 0.003;  // per velocity, m/s
  double trackNoise = 0;         // per track, m/s
  int snapshots = 1;             // of particles that do not move
  double ghosts = 0;             // share of the velocities
  Vector3d centreError{0, 0, 0}; // estimated centre less the true one, m
};

Snapshots seeded(const Flow& flow, const Seeding& s, std::mt19937& random) {
  const double outer = 1.35 * R;
  std::uniform_real_distribution<double> uniform(-outer, outer), share(0, 1);
  std::vector<Vector3d> places, errors;
  for (int n = std::poisson_distribution<int>(s.density * std::pow(2 * outer, 3))(random); n > 0; --n) {
    const double x = uniform(random), y = uniform(random), z = uniform(random);
    if (const double r = Vector3d(x, y, z).norm(); r < R || r > outer) continue;
    places.push_back({x, y, z});
    errors.push_back(s.trackNoise * normal(random));
  }
  Snapshots snapshots(s.snapshots);
  for (auto& snapshot : snapshots)
    for (std::size_t i = 0; i < places.size(); ++i) {
      Vector3d u = flow(places[i]) + errors[i] + s.velocityNoise * normal(random);
      if (share(random) < s.ghosts) u = 0.3 * Speed * normal(random);
      const Vector3d offset = places[i] - s.centreError + 5e-6 * normal(random);
      snapshot.push_back({offset.cast<float>(), u.cast<float>(), std::int64_t(i)});
    }
  return snapshots;
}

Flow stokes(const Vector3d& velocity, const Vector3d& rotation) {
  AnalyticFlow flow;
  flow.body.diameter = 2 * R;
  flow.body.velocity = velocity;
  flow.body.angularVelocity = rotation;
  return [flow](const Vector3d& r) { return flow.velocity(r, 0); };
}

// A layer of this thickness, with the part of it that is twice as thick: w_t = a(n) d (1 - exp(-s/d)), and
// w_n from continuity. Degrees up to 6, so more than the fit knows.
Flow layer(const Vector3d& velocity, const Vector3d& rotation, double thickness, std::mt19937& random) {
  using Harmonics = TangentialHarmonics<6>;
  using Coefficients = Eigen::Matrix<double, Harmonics::Size, 1>;
  std::normal_distribution<double> n;
  Coefficients thin, thick;
  const std::vector<int> degrees = Harmonics::degrees();
  for (int i = 0; i < Harmonics::Size; ++i) {
    const double size = 0.25 * Speed / (degrees[i] * degrees[i]);
    thin[i] = size * n(random);
    thick[i] = size * n(random);
  }
  return [=](const Vector3d& r) {
    const double length = r.norm(), s = length - R;
    const Vector3d direction = r / length;
    const Harmonics h(direction);
    Vector3d u = velocity + rotation.cross(r);
    for (const auto& [a, d] : {std::make_pair(thin, thickness), std::make_pair(thick, 2 * thickness)}) {
      const double e = std::exp(-s / d);
      const double moment = R * (s - d * (1 - e)) + 0.5 * s * s - d * (d - e * (s + d));
      u += (1 - e) * (h.field * a) - moment / (length * length) * h.divergence.dot(a) * direction;
    }
    return u;
  };
}

// Errors against the stated covariances, over many cases.
struct Score {
  int count = 0;
  double velocity = 0, rotation = 0;                     // mean square errors
  double velocityChiSquared = 0, rotationChiSquared = 0; // per degree of freedom
};

using MakeFlow = std::function<Flow(const Vector3d&, const Vector3d&, std::mt19937&)>;
Score score(int cases, const MakeFlow& make, const Seeding& seeding, const WallMotionOptions& options,
            double centreSigma = 0) {
  Score score;
  for (int k = 0; k < cases; ++k) {
    std::mt19937 random(k + 1);
    const Vector3d velocity = Speed * normal(random).normalized();
    const Vector3d rotation = 0.3 * Speed / (2 * R) * normal(random);
    Seeding here = seeding;
    here.centreError = centreSigma * normal(random);
    const WallMotion m = fitWallMotion(seeded(make(velocity, rotation, random), here, random), options);
    if (!m.enough) continue;
    const Vector3d dV = m.velocity - velocity, dW = m.angularVelocity - rotation;
    ++score.count;
    score.velocity += dV.squaredNorm() / cases;
    score.rotation += dW.squaredNorm() / cases;
    score.velocityChiSquared += dV.dot(m.velocityCovariance.ldlt().solve(dV)) / (3 * cases);
    score.rotationChiSquared += dW.dot(m.angularVelocityCovariance.ldlt().solve(dW)) / (3 * cases);
  }
  return score;
}

void expectTrueCovariances(const Score& s) {
  EXPECT_GT(s.velocityChiSquared, 0.5);
  EXPECT_LT(s.velocityChiSquared, 2);
  EXPECT_GT(s.rotationChiSquared, 0.5);
  EXPECT_LT(s.rotationChiSquared, 2);
}

Flow makeStokes(const Vector3d& v, const Vector3d& w, std::mt19937&) { return stokes(v, w); }

WallMotionOptions options() {
  WallMotionOptions o;
  o.radius = R;
  return o;
}

constexpr double Turn = Speed / (2 * R); // the unit of rotation, V/d

} // namespace

// Orthonormal over the sphere, and the divergence theorem against a linear function: on the unit sphere
// integral of t . grad z + z div t = 0.
TEST(TangentialHarmonics, AreOrthonormalTangentialAndKnowTheirDivergence) {
  using Harmonics = TangentialHarmonics<4>;
  Eigen::MatrixXd gram = Eigen::MatrixXd::Zero(Harmonics::Size, Harmonics::Size);
  Eigen::VectorXd theorem = Eigen::VectorXd::Zero(Harmonics::Size);
  const int n = 64; // the midpoint rule in z, exact enough; equal angles
  for (int i = 0; i < 4 * n; ++i)
    for (int j = 0; j < n; ++j) {
      const double z = -1 + (i + 0.5) / (2 * n), phi = 2 * M_PI * j / n, rho = std::sqrt(1 - z * z);
      const Vector3d direction(rho * std::cos(phi), rho * std::sin(phi), z);
      const Harmonics h(direction);
      EXPECT_LT((direction.transpose() * h.field).norm(), 1e-12);
      gram += h.field.transpose() * h.field / (4 * n * n);
      const Vector3d up = Vector3d::UnitZ() - z * direction;
      theorem += (h.field.transpose() * up + z * h.divergence) / (4 * n * n);
    }
  EXPECT_LT((gram - Eigen::MatrixXd::Identity(Harmonics::Size, Harmonics::Size)).cwiseAbs().maxCoeff(), 1e-3);
  EXPECT_LT(theorem.cwiseAbs().maxCoeff(), 1e-3);
}

TEST(WallMotion, FindsVelocityAndRotationInStokesFlowWithTrueCovariances) {
  const Score s = score(12, makeStokes, {}, options());
  ASSERT_EQ(s.count, 12);
  EXPECT_LT(std::sqrt(s.velocity), 0.005 * Speed);
  EXPECT_LT(std::sqrt(s.rotation), 0.02 * Turn);
  expectTrueCovariances(s);
}

TEST(WallMotion, ThinLayersMakeItLessCertainNotWrong) {
  double before = 0;
  for (double thickness : {0.3, 0.1}) {
    SCOPED_TRACE(thickness);
    const Score s = score(
        8,
        [&](const Vector3d& v, const Vector3d& w, std::mt19937& random) {
          return layer(v, w, thickness * R, random);
        },
        {}, options());
    EXPECT_LT(std::sqrt(s.velocity), 0.015 * Speed);
    EXPECT_GT(s.velocity, before);
    before = s.velocity;
    expectTrueCovariances(s);
  }
}

TEST(WallMotion, SnapshotsOfTheSameTracksAreNotManyMeasurements) {
  Seeding seeding;
  seeding.density = 2e8;
  seeding.snapshots = 10;
  seeding.trackNoise = 0.004;
  seeding.velocityNoise = 0.002;
  expectTrueCovariances(score(8, makeStokes, seeding, options()));
}

TEST(WallMotion, GhostsAreLeftOut) {
  Seeding seeding;
  seeding.ghosts = 0.03;
  const Score s = score(6, makeStokes, seeding, options());
  EXPECT_LT(std::sqrt(s.velocity), 0.006 * Speed);
  EXPECT_LT(std::sqrt(s.rotation), 0.03 * Turn);
}

// Without the centre's covariance the wall would seem to slip.
TEST(WallMotion, TheErrorOfTheCentreIsPartOfTheUncertainty) {
  WallMotionOptions o = options();
  const double sigma = 0.02 * R;
  o.centreCovariance = sigma * sigma * Matrix3d::Identity();
  const Score with = score(8, makeStokes, {}, o, sigma);
  const Score without = score(8, makeStokes, {}, options(), sigma);
  EXPECT_LT(with.velocityChiSquared, 3);
  EXPECT_LT(with.rotationChiSquared, 2);
  EXPECT_GT(without.velocityChiSquared, 2 * with.velocityChiSquared);
  EXPECT_GT(without.velocity, 2 * with.velocity);
}

TEST(WallMotion, APriorOfTheVelocityIsUsed) {
  const Vector3d velocity(0, Speed, 0);
  std::mt19937 random(3);
  Seeding seeding;
  seeding.density = 4e7;
  const Snapshots snapshots = seeded(stokes(velocity, Vector3d::Zero()), seeding, random);
  WallMotionOptions o = options();
  const WallMotion alone = fitWallMotion(snapshots, o);
  const double sigma = 0.002 * Speed;
  o.velocityPrior = GaussianVector{velocity, sigma * sigma * Matrix3d::Identity()};
  const WallMotion with = fitWallMotion(snapshots, o);
  ASSERT_TRUE(alone.enough && with.enough);
  EXPECT_GT(alone.velocityCovariance.trace(), 4 * with.velocityCovariance.trace());
  EXPECT_LE(with.velocityCovariance.trace(), 3 * sigma * sigma);
  EXPECT_LT(with.angularVelocityCovariance.trace(), alone.angularVelocityCovariance.trace());
  EXPECT_LT((with.velocity - velocity).norm(), 3 * sigma);
}

// Tracks as a measurement gives them: noise, drop-out, ghosts, a sphere that turns and moves on.
TEST(WallMotion, WorksOnSynthesizedTracks) {
  TrackSynthesisOptions o;
  o.flow.body.diameter = 2 * R;
  o.flow.body.velocity = {0, Speed, 0};
  o.flow.body.angularVelocity = {0.2 * Turn, 0, -0.1 * Turn};
  o.bounds = {-0.01, 0.01, -0.01, 0.01, -0.01, 0.01};
  o.snapshots = 5;
  o.flow.referenceTime = 0.002;
  o.positionNoise = 5e-6;
  o.velocityNoise = 0.01 * Speed;
  o.dropOut = 0.1;
  o.ghostFraction = 0.005;
  TrackSynthesis tracks;
  ASSERT_TRUE(tracks.prepare(o));
  Snapshots snapshots;
  for (int k = 0; k < o.snapshots; ++k) {
    const SyntheticSnapshot s = tracks.snapshot(k);
    const Eigen::Vector3f centre = o.flow.bodyAt(tracks.time(k)).centre.cast<float>();
    snapshots.emplace_back();
    for (std::size_t i = 0; i < s.size(); ++i)
      snapshots.back().push_back({Eigen::Vector3f(s.position.data() + 3 * i) - centre,
                                  Eigen::Vector3f(s.velocity.data() + 3 * i), s.trackId[i]});
  }
  const WallMotion m = fitWallMotion(snapshots, options());
  ASSERT_TRUE(m.enough);
  EXPECT_GT(m.particles, 2 * m.tracks);
  EXPECT_LT((m.velocity - o.flow.body.velocity).norm(), 0.005 * Speed);
  EXPECT_LT((m.angularVelocity - o.flow.body.angularVelocity).norm(), 0.02 * Turn);
  EXPECT_NEAR(m.residual, o.velocityNoise, 0.3 * o.velocityNoise);
}

TEST(WallMotion, TooFewTracksAreNotEnough) {
  std::mt19937 random(1);
  const Flow flow = stokes({0, Speed, 0}, {0, 0, 0});
  Snapshots snapshots = seeded(flow, {}, random);
  snapshots[0].resize(8);
  for (int k = 0; k < 20; ++k) snapshots.push_back(snapshots[0]); // the same tracks again
  EXPECT_FALSE(fitWallMotion(snapshots, options()).enough);
  EXPECT_FALSE(fitWallMotion({}, options()).enough);
  for (auto& p : snapshots[0]) p.velocity.setConstant(std::numeric_limits<float>::quiet_NaN());
  EXPECT_EQ(fitWallMotion({snapshots[0]}, options()).particles, 0);
}

TEST(WallMotion, RefusesWhatMakesNoSense) {
  EXPECT_THROW(fitWallMotion({}, {}), std::invalid_argument);
  WallMotionOptions o = options();
  o.reach = 2;
  EXPECT_THROW(fitWallMotion({}, o), std::invalid_argument);
}
