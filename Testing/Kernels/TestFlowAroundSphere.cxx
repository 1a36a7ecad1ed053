// Breaks when centre, velocity or rotation of a sphere is not found from the flow around it, when their
// covariances are not true (thin layers, several snapshots, correlated errors, few tracks), when ghosts spoil
// them, or when the flow takes fluid for a body, or a body for fluid.
#include "AnalyticFlows.h"
#include "FlowAroundSphere.h"
#include "SphereCapture.h"
#include "TangentialHarmonics.h"
#include "TrackSynthesis.h"

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
using Snapshots = std::vector<FlowView>;

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
  const double outer = 1.6 * R;
  std::uniform_real_distribution<double> uniform(-outer, outer), share(0, 1);
  std::vector<Vector3d> places, errors;
  for (int n = std::poisson_distribution<int>(s.density * std::pow(2 * outer, 3))(random); n > 0; --n) {
    const double x = uniform(random), y = uniform(random), z = uniform(random);
    if (const double r = Vector3d(x, y, z).norm(); r < R || r > outer) continue;
    places.push_back({x, y, z});
    errors.push_back(s.trackNoise * normal(random));
  }
  Snapshots snapshots(s.snapshots);
  for (FlowView& snapshot : snapshots)
    for (std::size_t i = 0; i < places.size(); ++i) {
      Vector3d u = flow(places[i]) + errors[i] + s.velocityNoise * normal(random);
      if (share(random) < s.ghosts) u = 0.3 * Speed * normal(random);
      const Vector3d offset = places[i] - s.centreError + 5e-6 * normal(random);
      snapshot.particles.push_back({offset.cast<float>(), u.cast<float>(), std::int64_t(i)});
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
  double centre = 0, velocity = 0, rotation = 0;                               // mean square errors
  double centreChiSquared = 0, velocityChiSquared = 0, rotationChiSquared = 0; // per degree of freedom
};

double chiSquared(const Vector3d& error, const Matrix3d& covariance) {
  return error.dot(covariance.ldlt().solve(error)) / 3;
}

using MakeFlow = std::function<Flow(const Vector3d&, const Vector3d&, std::mt19937&)>;
Score score(int cases, const MakeFlow& make, const Seeding& seeding, double centreSigma = 0.02 * R) {
  Score score;
  FlowFitOptions options;
  options.radius = R;
  for (int k = 0; k < cases; ++k) {
    std::mt19937 random(k + 1);
    const Vector3d velocity = Speed * normal(random).normalized();
    const Vector3d rotation = 0.3 * Speed / (2 * R) * normal(random);
    Seeding here = seeding;
    here.centreError = centreSigma * normal(random);
    const FlowFit m = fitFlow(seeded(make(velocity, rotation, random), here, random), options);
    if (!m.enough) continue;
    const Vector3d dC = m.centre + here.centreError, dV = m.velocity - velocity,
                   dW = m.angularVelocity - rotation;
    ++score.count;
    score.centre += dC.squaredNorm() / cases;
    score.velocity += dV.squaredNorm() / cases;
    score.rotation += dW.squaredNorm() / cases;
    score.centreChiSquared += chiSquared(dC, m.covariance.topLeftCorner<3, 3>()) / cases;
    score.velocityChiSquared += chiSquared(dV, m.covariance.block<3, 3>(3, 3)) / cases;
    score.rotationChiSquared += chiSquared(dW, m.angularVelocityCovariance) / cases;
  }
  return score;
}

void expectTrueCovariances(const Score& s) {
  for (double c : {s.centreChiSquared, s.velocityChiSquared, s.rotationChiSquared}) {
    EXPECT_GT(c, 0.25);
    EXPECT_LT(c, 2);
  }
}

Flow makeStokes(const Vector3d& v, const Vector3d& w, std::mt19937&) { return stokes(v, w); }

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

TEST(FlowFit, FindsCentreVelocityAndRotationInStokesFlowWithTrueCovariances) {
  const Score s = score(10, makeStokes, {});
  ASSERT_EQ(s.count, 10);
  EXPECT_LT(std::sqrt(s.centre), 0.008 * R); // of 0.035 R
  EXPECT_LT(std::sqrt(s.velocity), 0.005 * Speed);
  EXPECT_LT(std::sqrt(s.rotation), 0.02 * Turn);
  expectTrueCovariances(s);
}

TEST(FlowFit, ThinLayersMakeItLessCertainNotWrong) {
  double before = 0;
  for (double thickness : {0.3, 0.1, 0.05}) {
    SCOPED_TRACE(thickness);
    const Score s = score(8,
                          [&](const Vector3d& v, const Vector3d& w, std::mt19937& random) {
                            return layer(v, w, thickness * R, random);
                          },
                          {});
    EXPECT_LT(std::sqrt(s.velocity), 0.015 * Speed);
    EXPECT_GT(s.velocity, before);
    before = s.velocity;
    expectTrueCovariances(s);
  }
}

TEST(FlowFit, SnapshotsOfTheSameTracksAreNotManyMeasurements) {
  Seeding seeding;
  seeding.density = 2e8;
  seeding.snapshots = 10;
  seeding.trackNoise = 0.004;
  seeding.velocityNoise = 0.002;
  expectTrueCovariances(score(8, makeStokes, seeding));
}

TEST(FlowFit, GhostsAreLeftOut) {
  Seeding seeding;
  seeding.ghosts = 0.03;
  const Score s = score(6, makeStokes, seeding);
  EXPECT_LT(std::sqrt(s.velocity), 0.006 * Speed);
  EXPECT_LT(std::sqrt(s.rotation), 0.03 * Turn);
}

TEST(FlowFit, FewTracksAreNotOverrated) {
  Seeding seeding;
  seeding.density = 4e7;
  const Score s = score(10, makeStokes, seeding);
  EXPECT_GT(s.count, 7);
  expectTrueCovariances(s);
}

// Tracks as a measurement gives them: noise, drop-out, ghosts, a sphere that turns; the reference path is off
// and drifts away.
TEST(FlowFit, CorrectsThePathInThinSynthesizedTracks) {
  TrackSynthesisOptions o;
  o.flow.body.diameter = 2 * R;
  o.flow.body.velocity = {0, Speed, 0};
  o.flow.body.angularVelocity = {0.2 * Turn, 0, -0.1 * Turn};
  o.bounds = {-0.01, 0.01, -0.012, 0.012, -0.01, 0.01};
  o.density = 4e7;
  o.snapshots = 31;
  o.flow.referenceTime = 0.015;
  o.positionNoise = 5e-6;
  o.velocityNoise = 0.01 * Speed;
  o.dropOut = 0.1;
  o.ghostFraction = 0.005;
  TrackSynthesis tracks;
  ASSERT_TRUE(tracks.prepare(o));
  const Vector3d off(0.05 * R, -0.03 * R, 0.04 * R), drift(0.01 * Speed, 0.015 * Speed, -0.01 * Speed);
  Snapshots views(o.snapshots);
  for (int k = 0; k < o.snapshots; ++k) {
    const SyntheticSnapshot s = tracks.snapshot(k);
    views[k].time = tracks.time(k);
    views[k].velocity = o.flow.body.velocity - drift;
    const Vector3d centre = o.flow.bodyAt(tracks.time(k)).centre - off - drift * (tracks.time(k) - 0.015);
    for (std::size_t i = 0; i < s.size(); ++i)
      views[k].particles.push_back({Eigen::Vector3f(s.position.data() + 3 * i) - centre.cast<float>(),
                                    Eigen::Vector3f(s.velocity.data() + 3 * i), s.trackId[i]});
  }
  FlowFitOptions options;
  options.radius = R;
  const FlowFit m = fitFlow(views, options);
  ASSERT_TRUE(m.enough);
  EXPECT_LT((m.centre - off).norm(), 0.015 * R);
  EXPECT_LT((m.velocity - drift).norm(), 0.006 * Speed);
  EXPECT_LT((m.angularVelocity - o.flow.body.angularVelocity).norm(), 0.06 * Turn);
}

TEST(FlowFit, TooFewTracksAreNotEnough) {
  std::mt19937 random(1);
  const Flow flow = stokes({0, Speed, 0}, {0, 0, 0});
  FlowFitOptions options;
  options.radius = R;
  Snapshots snapshots = seeded(flow, {}, random);
  snapshots[0].particles.resize(12);
  for (int k = 0; k < 20; ++k) snapshots.push_back(snapshots[0]); // the same tracks again
  EXPECT_FALSE(fitFlow(snapshots, options).enough);
  EXPECT_FALSE(fitFlow({}, options).enough);
  for (auto& p : snapshots[0].particles) p.velocity.setConstant(std::numeric_limits<float>::quiet_NaN());
  EXPECT_EQ(fitFlow({snapshots[0]}, options).tracks, 0);
}

TEST(FlowFit, RefusesWhatMakesNoSense) {
  EXPECT_THROW(fitFlow({}, {}), std::invalid_argument);
  FlowFitOptions options;
  options.radius = R;
  options.reach = 3;
  EXPECT_THROW(fitFlow({}, options), std::invalid_argument);
  EXPECT_THROW(flowEvidence({}, {}), std::invalid_argument);
}

namespace {

double evidence(const Flow& flow, double density, unsigned seed,
                const Vector3d& centreError = Vector3d::Zero()) {
  std::mt19937 random(seed);
  Seeding seeding;
  seeding.density = density;
  seeding.centreError = centreError;
  FlowEvidenceOptions options;
  options.radius = R;
  return flowEvidence(seeded(flow, seeding, random)[0].particles, options).logBayesFactor;
}

} // namespace

TEST(FlowEvidence, KnowsASphereFromFluidInThinSeeding) {
  const Flow sphere = stokes({0, Speed, 0}, {Turn, 0, 0});
  for (unsigned seed = 1; seed < 6; ++seed) {
    EXPECT_GT(evidence(sphere, 4e7, seed), 15);
    EXPECT_GT(evidence(sphere, 4e7, seed, {0.2 * R, 0, 0}), 15); // a rough centre does
    std::mt19937 random(seed);
    EXPECT_GT(evidence(layer({0, Speed, 0}, {0, 0, 0}, 0.2 * R, random), 6e7, seed), 5);
  }
}

TEST(FlowEvidence, SmoothFlowsAndFluidAtRestAreNoSphere) {
  AnalyticFlow flow;
  for (unsigned seed = 1; seed < 4; ++seed) {
    const Vector3d place(0.003 * seed, 0.001 * seed, -0.002 * seed);
    EXPECT_LT(evidence([](const Vector3d&) { return Vector3d(0, 0, 0); }, 4e7, seed), 3);
    EXPECT_LT(evidence([](const Vector3d&) { return Vector3d(0, Speed, 0); }, 4e7, seed), 3);
    EXPECT_LT(evidence([](const Vector3d& r) { return Vector3d(0.2 * Speed * r.y() / R, 0, 0); }, 4e7, seed),
              -10);
    for (FlowKind kind : {FlowKind::TaylorGreen, FlowKind::ABC})
      for (double wavelength : {0.01, 0.02, 0.04}) {
        flow.kind = kind;
        flow.wavelength = wavelength;
        EXPECT_LT(evidence([&](const Vector3d& r) { return flow.velocity(r + place, 0); }, 4e7, seed), -5);
      }
  }
}

// 15 tracers in the ball's volume: the void alone does not decide.
TEST(FlowEvidence, LetsTheCaptureFindASphereInThinSeedingAndNothingElse) {
  TrackSynthesisOptions o;
  o.flow.body.diameter = 2 * R;
  o.flow.body.velocity = {0, Speed, 0};
  o.bounds = {-0.015, 0.015, -0.02, 0.02, -0.013, 0.013};
  o.density = 2.9e7;
  o.snapshots = 1;
  o.velocityNoise = 0.01 * Speed;
  VoidLikelihoodOptions sphere;
  sphere.diameter = 2 * R;
  int alone = 0, together = 0;
  for (int kind = 0; kind < 2; ++kind)
    for (unsigned seed = 1; seed <= 4; ++seed) {
      o.seed = seed;
      o.flow.kind = kind == 0 ? FlowKind::StokesSphere : FlowKind::ABC;
      TrackSynthesis tracks;
      ASSERT_TRUE(tracks.prepare(o));
      const SyntheticSnapshot s = tracks.snapshot(0);
      const ParticleIndex index(s.position.data(), s.size());
      SeedingDensity seeding(index, 0.5 * R);
      const CaptureResult flow = captureSphere(index, seeding, sphere, {}, {}, s.velocity.data());
      if (kind == 1) {
        EXPECT_FALSE(flow.found);
        continue;
      }
      alone += captureSphere(index, seeding, sphere).found;
      together += flow.found && flow.centre.norm() < 0.5 * R;
    }
  EXPECT_LT(alone, 2);
  EXPECT_GE(together, 3);
}
