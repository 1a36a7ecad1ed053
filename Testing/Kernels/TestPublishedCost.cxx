// Breaks when a criterion of the published cost does not take its exact value on a simple flow, when the
// search leaves its cube or misses a symmetric minimum, when a Hessian that is not positive definite goes
// unnoticed, or when the upward direction is not that of the motion where none is given.
#include "PublishedCost.h"
#include "PublishedCriteriaByNode.h"

#include <cmath>
#include <gtest/gtest.h>
#include <random>
#include <vector>

using namespace rimflow;
using Eigen::Vector3d;

namespace {

constexpr double Diameter = 0.01, Radius = Diameter / 2, Speed = 0.3;
const Vector3d Centre(0.001, -0.002, 0.0005);

struct Scene {
  Grid grid{{-0.02, -0.02, -0.02}, {0.0007, 0.0007, 0.0007}, {58, 58, 58}};
  std::vector<float> velocity, q, positions;
  PublishedCostOptions options;

  /// up(r), vortex(r): upward velocity and Q at the offset r from the centre.
  template <class U, class Q>
  Scene(U&& up, Q&& vortex) {
    for (int k = 0; k < grid.n[2]; ++k)
      for (int j = 0; j < grid.n[1]; ++j)
        for (int i = 0; i < grid.n[0]; ++i) {
          const auto p = grid.position(i, j, k);
          const Vector3d r = Vector3d(p[0], p[1], p[2]) - Centre;
          velocity.insert(velocity.end(), {0.f, float(up(r)), 0.f});
          q.push_back(float(vortex(r)));
        }
    std::mt19937 random(3);
    std::uniform_real_distribution<float> anywhere(-0.02f, 0.02f);
    for (int n = 0; n < 40000; ++n) {
      const Vector3d x(anywhere(random), anywhere(random), anywhere(random));
      if ((x - Centre).norm() > Radius)
        for (double c : {x[0], x[1], x[2]}) positions.push_back(float(c));
    }
    options.diameter = Diameter;
  }
  FlowField flow() const { return {grid, velocity.data(), q.data(), nullptr}; }
  ParticleIndex particles() const { return {positions.data(), positions.size() / 3}; }
};

} // namespace

TEST(PublishedCost, CriteriaOfUniformFieldsAreTheirVolumes) {
  Scene s([](const Vector3d&) { return Speed; }, [](const Vector3d&) { return 50; });
  s.options.velocityScale = 2 * Speed;
  s.options.vortexScale = 25;
  s.options.seedingDensity = 40000 / std::pow(0.04, 3);
  const ParticleIndex particles = s.particles();
  const Criteria here = publishedCriteria(particles, s.flow(), Centre, s.options);
  EXPECT_EQ(here.density, 0);
  EXPECT_NEAR(here.velocityIn, 0.5, 1e-6);
  EXPECT_NEAR(here.velocityOut, 0.5, 1e-6);
  EXPECT_NEAR(here.vortexIn, 2 * std::pow(1.1, 3), 1e-5); // over the volume of radius R, as published
  EXPECT_NEAR(here.vortexOut, 2, 1e-6);
  EXPECT_NEAR(publishedCost(here, s.options), 4.415 * 2 * (std::pow(1.1, 3) - 1), 1e-4);
  const Criteria away = publishedCriteria(particles, s.flow(), Centre + Vector3d(0, 0.012, 0), s.options);
  EXPECT_NEAR(away.density, 1, 0.15);
}

TEST(PublishedCost, ShellsAndTheUpperHemisphereLieWhereTheyShould) {
  // moving within 1.1 R above the centre, at rest elsewhere; Q between R and 2.5 R only
  Scene s([](const Vector3d& r) { return r.norm() < 1.1 * Radius && r.y() > 0 ? Speed : 0; },
          [](const Vector3d& r) { return r.norm() > Radius && r.norm() < 2.5 * Radius ? 10 : 0; });
  s.options.velocityScale = Speed;
  s.options.vortexScale = 10;
  s.options.seedingDensity = 1;
  const Criteria up = publishedCriteria(s.particles(), s.flow(), Centre, s.options);
  EXPECT_NEAR(up.velocityIn, 1, 0.08);
  EXPECT_NEAR(up.velocityOut, 0, 0.01);
  EXPECT_NEAR(up.vortexOut, 1, 0.05);
  EXPECT_LT(up.vortexIn, 0.45); // the shell R to 1.1 R
  s.options.up = -Vector3d::UnitY();
  EXPECT_NEAR(publishedCriteria(s.particles(), s.flow(), Centre, s.options).velocityIn, 0, 0.08);
}

TEST(PublishedCost, TheFastSumsAreThoseOfTheDefinition) {
  std::mt19937 random(9);
  std::normal_distribution<double> normal;
  Scene s([&](const Vector3d& r) { return Speed * (std::exp(-r.norm() / Radius) + 0.3 * normal(random)); },
          [&](const Vector3d&) { return 40 * normal(random); });
  std::vector<unsigned char> mask(s.q.size());
  for (unsigned char& m : mask) m = normal(random) > 1.5;
  FlowField flow = s.flow();
  flow.mask = mask.data();
  flow.grid.spacing = {0.0007, 0.00055, 0.0006};
  s.options.velocityScale = Speed;
  s.options.vortexScale = 40;
  s.options.seedingDensity = 40000 / std::pow(0.04, 3);
  s.options.up = Vector3d(0.3, 0.8, -0.5).normalized();
  const ParticleIndex particles = s.particles();
  for (int n = 0; n < 40; ++n) { // some reach out of the grid
    const Vector3d x = 0.008 * Vector3d(normal(random), normal(random), normal(random));
    const Criteria fast = publishedCriteria(particles, flow, x, s.options),
                   exact = publishedCriteriaByNode(particles, flow, x, s.options);
    EXPECT_EQ(fast.density, exact.density);
    EXPECT_NEAR(fast.velocityIn, exact.velocityIn, 2e-5);
    EXPECT_NEAR(fast.velocityOut, exact.velocityOut, 2e-5);
    EXPECT_NEAR(fast.vortexIn, exact.vortexIn, 2e-5);
    EXPECT_NEAR(fast.vortexOut, exact.vortexOut, 2e-5);
  }
}

TEST(PublishedCost, FindsASymmetricSphere) {
  Scene s([](const Vector3d& r) { return Speed * std::exp(-r.squaredNorm() / (2 * Radius * Radius)); },
          [](const Vector3d& r) {
            return r.norm() < Radius ? -100 : 100 * std::exp(-(r.norm() - Radius) / Radius);
          });
  const PublishedEstimate e =
      minimisePublishedCost(s.particles(), s.flow(), Centre + Vector3d(0.002, -0.0015, 0.001), s.options);
  // the velocity criterion looks at the upper hemisphere only, so it pulls downwards even here
  EXPECT_LT((e.centre - Centre).norm(), 0.2 * Diameter);
  EXPECT_LT((e.voidMinimiser - Centre).norm(), 0.12 * Diameter);
  EXPECT_LT((e.vortexMinimiser - Centre).norm(), 0.1 * Diameter);
  EXPECT_TRUE(e.positiveDefinite);
  EXPECT_GT(e.covariance.trace(), 0);
  EXPECT_GT(e.iterations, 0);
}

TEST(PublishedCost, UpIsTheDirectionOfTheMotionWhenNoneIsGiven) {
  Scene s([](const Vector3d&) { return 0; }, [](const Vector3d&) { return 50; });
  const Vector3d motion = Vector3d(0.5, -0.7, 0.5).normalized();
  EXPECT_EQ(directionOfMotion(s.flow(), Centre, Diameter), Vector3d::UnitY()); // at rest
  for (int k = 0; k < s.grid.n[2]; ++k)
    for (int j = 0; j < s.grid.n[1]; ++j)
      for (int i = 0; i < s.grid.n[0]; ++i) { // a slower, slanting wake behind, and potential flow around
        const auto p = s.grid.position(i, j, k);
        const Vector3d r = Vector3d(p[0], p[1], p[2]) - Centre;
        const double b = std::pow(Radius / std::max(r.norm(), Radius), 3), along = motion.dot(r) / r.norm();
        Vector3d u = r.norm() < Radius ? Vector3d(Speed * motion)
                                       : Vector3d(0.5 * Speed * b * (3 * along * r / r.norm() - motion));
        if (r.norm() > Radius && along < -0.8) u = 0.5 * Speed * (motion + Vector3d(0.35, 0.25, 0));
        for (int c = 0; c < 3; ++c) s.velocity[3 * s.grid.index(i, j, k) + c] = float(u[c]);
      }
  for (const Vector3d& off : {Vector3d(0, 0, 0), Vector3d(0.003, 0, -0.002), Vector3d(0, 0.004, 0)})
    EXPECT_GT(directionOfMotion(s.flow(), Centre + off, Diameter).dot(motion), std::cos(8 * M_PI / 180));
  s.options.up = Vector3d::Zero();
  const PublishedEstimate free = minimisePublishedCost(s.particles(), s.flow(), Centre, s.options);
  s.options.up = directionOfMotion(s.flow(), Centre, Diameter);
  const PublishedEstimate given = minimisePublishedCost(s.particles(), s.flow(), Centre, s.options);
  EXPECT_LT((free.centre - given.centre).norm(), 1e-9);
  s.options.up = Vector3d::UnitY();
  const PublishedEstimate vertical = minimisePublishedCost(s.particles(), s.flow(), Centre, s.options);
  EXPECT_GT((vertical.centre - given.centre).norm(), 1e-4 * Diameter);
}

TEST(PublishedCost, StaysInTheSearchCube) {
  Scene s([](const Vector3d& r) { return Speed * r.y() / 0.02; },
          [](const Vector3d& r) { return -1e3 * r.x(); });
  s.options.searchSide = 0.004;
  const Vector3d guess = Centre + Vector3d(0, 0.006, 0);
  const PublishedEstimate e = minimisePublishedCost(s.particles(), s.flow(), guess, s.options);
  EXPECT_LE((e.centre - guess).cwiseAbs().maxCoeff(), 0.002 + 1e-9);
}

TEST(PublishedCost, AFlatCostHasNoCovariance) {
  Scene s([](const Vector3d&) { return Speed; }, [](const Vector3d&) { return 50; });
  s.options.weightVoid = 0;
  const PublishedEstimate e = minimisePublishedCost(s.particles(), s.flow(), Centre, s.options);
  EXPECT_FALSE(e.positiveDefinite);
  EXPECT_EQ(e.covariance.norm(), 0);
}

TEST(PublishedCost, RefusesWhatItCannotUse) {
  Scene s([](const Vector3d&) { return Speed; }, [](const Vector3d&) { return 50; });
  EXPECT_THROW(minimisePublishedCost(s.particles(), s.flow(), Vector3d(1, 1, 1), s.options),
               std::invalid_argument);
  s.options.b = 3;
  EXPECT_THROW(minimisePublishedCost(s.particles(), s.flow(), Centre, s.options), std::invalid_argument);
  s.options = {};
  EXPECT_THROW(minimisePublishedCost(s.particles(), s.flow(), Centre, s.options), std::invalid_argument);
}
