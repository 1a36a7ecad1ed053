// Breaks when a velocity gradient, acceleration or pressure does not belong to its velocity field, when fluid
// is created, or when a wall is crossed.
#include "AnalyticFlows.h"

#include <Eigen/Geometry>
#include <gtest/gtest.h>
#include <random>
#include <string>
#include <vector>

using namespace rimflow;
using Eigen::Matrix3d;
using Eigen::Vector3d;

namespace {

constexpr double R = 0.005, Speed = 0.35;
const Vector3d V = Speed * Vector3d(0.2, 0.95, -0.1).normalized();

AnalyticFlow sphere(FlowKind kind) {
  AnalyticFlow flow;
  flow.kind = kind;
  flow.body.diameter = 2 * R;
  flow.body.centre = {0.001, -0.002, 0.003};
  flow.body.velocity = V;
  flow.referenceTime = 0.01;
  flow.viscosity = 2e-5;
  return flow;
}

struct Case {
  std::string name;
  AnalyticFlow flow;
  bool viscous;  ///< the momentum balance holds with the viscous term
  bool momentum; ///< ... and holds at all
};

std::vector<Case> cases() {
  std::vector<Case> all;
  all.push_back({"Stokes", sphere(FlowKind::StokesSphere), false, false});
  AnalyticFlow stokes = sphere(FlowKind::StokesSphere);
  stokes.body.angularVelocity = {20, -10, 30};
  stokes.body.acceleration = {3, -2, 1};
  all.push_back({"Stokes, rotating and accelerating", stokes, false, false});
  all.push_back({"potential", sphere(FlowKind::PotentialSphere), false, true});
  AnalyticFlow potential = sphere(FlowKind::PotentialSphere);
  potential.body.acceleration = {3, -2, 1};
  all.push_back({"potential, accelerating", potential, false, true});
  all.push_back({"Hill", sphere(FlowKind::HillsVortex), false, true});
  for (FlowKind kind : {FlowKind::TaylorGreen, FlowKind::ABC}) {
    AnalyticFlow flow;
    flow.kind = kind;
    flow.amplitude = 0.3;
    flow.wavelength = 0.012;
    flow.viscosity = 2e-4; // so large that a wrong decay shows
    flow.referenceTime = 0.004;
    all.push_back({kind == FlowKind::ABC ? "ABC" : "Taylor-Green", flow, true, true});
  }
  return all;
}

/// Random places outside the wall and off the surface of the vortex, where its gradient jumps.
std::vector<Vector3d> places(const AnalyticFlow& flow, double t) {
  std::mt19937 random(7);
  std::uniform_real_distribution<double> coordinate(-2.5 * R, 2.5 * R);
  std::vector<Vector3d> all;
  const Body body = flow.bodyAt(t);
  while (all.size() < 200) {
    const Vector3d x = body.centre + Vector3d(coordinate(random), coordinate(random), coordinate(random));
    const double s = body.diameter > 0 ? body.signedDistance(x) : 1;
    if (s > 0.02 * R || (!flow.hasWall() && s < -0.02 * R)) all.push_back(x);
  }
  return all;
}

constexpr double Step = 1e-6, TimeStep = 1e-6, Now = 0.013;

/// d f / d x_j by fourth-order central differences.
template <class F>
auto difference(F&& f, const Vector3d& x, int j) -> decltype(f(x)) {
  const Vector3d h = Step * Vector3d::Unit(j);
  return (8 * (f(x + h) - f(x - h)) - (f(x + 2 * h) - f(x - 2 * h))) / (12 * Step);
}

double speedOf(const AnalyticFlow& flow) { return flow.maximumSpeed(Now); }
double lengthOf(const AnalyticFlow& flow) { return flow.isPeriodic() ? flow.wavelength / (2 * M_PI) : R; }

} // namespace

TEST(AnalyticFlows, GradientIsTheDerivativeOfVelocity) {
  for (const Case& c : cases()) {
    SCOPED_TRACE(c.name);
    const double scale = speedOf(c.flow) / lengthOf(c.flow);
    for (const Vector3d& x : places(c.flow, Now)) {
      const Matrix3d G = c.flow.gradient(x, Now);
      for (int j = 0; j < 3; ++j) {
        const Vector3d d =
            difference([&](const Vector3d& y) -> Vector3d { return c.flow.velocity(y, Now); }, x, j);
        EXPECT_LT((d - G.col(j)).norm(), 1e-7 * scale);
      }
      EXPECT_NEAR(G.trace(), 0, 1e-12 * scale); // no fluid is created
    }
  }
}

TEST(AnalyticFlows, AccelerationIsTheMaterialDerivative) {
  for (const Case& c : cases()) {
    SCOPED_TRACE(c.name);
    const double scale = std::pow(speedOf(c.flow), 2) / lengthOf(c.flow);
    double largest = 0;
    for (const Vector3d& x : places(c.flow, Now)) {
      const auto along = [&](double s) -> Vector3d { // velocity seen when carried with u for a time s
        return c.flow.velocity(x + s * c.flow.velocity(x, Now), Now + s);
      };
      const double h = TimeStep;
      const Vector3d d = (8 * (along(h) - along(-h)) - (along(2 * h) - along(-2 * h))) / (12 * h);
      const Vector3d a = c.flow.acceleration(x, Now);
      EXPECT_LT((d - a).norm(), 1e-6 * scale);
      largest = std::max(largest, a.norm());
    }
    EXPECT_GT(largest, 0.05 * scale);
  }
}

TEST(AnalyticFlows, PressureBalancesMomentum) {
  for (const Case& c : cases()) {
    if (!c.momentum) continue;
    SCOPED_TRACE(c.name);
    const AnalyticFlow& flow = c.flow;
    const double scale = flow.density * std::pow(speedOf(flow), 2) / lengthOf(flow);
    for (const Vector3d& x : places(flow, Now)) {
      Vector3d gradient, laplacian = Vector3d::Zero();
      for (int j = 0; j < 3; ++j) {
        gradient[j] = difference([&](const Vector3d& y) { return flow.pressure(y, Now); }, x, j);
        if (c.viscous)
          laplacian +=
              difference([&](const Vector3d& y) -> Vector3d { return flow.gradient(y, Now).col(j); }, x, j);
      }
      const Vector3d expected = -flow.density * (flow.acceleration(x, Now) - flow.viscosity * laplacian);
      EXPECT_LT((gradient - expected).norm(), 1e-6 * scale);
    }
  }
}

TEST(AnalyticFlows, StokesPressureBalancesFriction) {
  const AnalyticFlow flow = cases()[1].flow; // rotation adds none
  const double mu = flow.density * flow.viscosity, scale = mu * Speed / (R * R);
  for (const Vector3d& x : places(flow, Now)) {
    Vector3d gradient, laplacian = Vector3d::Zero();
    for (int j = 0; j < 3; ++j) {
      gradient[j] = difference([&](const Vector3d& y) { return flow.pressure(y, Now); }, x, j);
      laplacian +=
          difference([&](const Vector3d& y) -> Vector3d { return flow.gradient(y, Now).col(j); }, x, j);
    }
    EXPECT_LT((gradient - mu * laplacian).norm(), 1e-5 * scale);
  }
}

TEST(AnalyticFlows, StokesDragIs6PiMuRV) {
  const AnalyticFlow flow = sphere(FlowKind::StokesSphere);
  const Body body = flow.bodyAt(Now);
  const double mu = flow.density * flow.viscosity;
  const int n = 200;
  Vector3d force = Vector3d::Zero();
  for (int i = 0; i < n; ++i)
    for (int j = 0; j < n; ++j) { // equal areas: z and the angle around it are uniform
      const double z = -1 + (i + 0.5) * 2 / n, phi = (j + 0.5) * 2 * M_PI / n, s = std::sqrt(1 - z * z);
      const Vector3d normal(s * std::cos(phi), s * std::sin(phi), z);
      const Vector3d x = body.centre + R * (1 + 1e-12) * normal;
      const Matrix3d G = flow.gradient(x, Now);
      force +=
          4 * M_PI * R * R / (n * n) * (-flow.pressure(x, Now) * normal + mu * (G + G.transpose()) * normal);
    }
  EXPECT_LT((force + 6 * M_PI * mu * R * V).norm(), 1e-4 * 6 * M_PI * mu * R * Speed);
}

TEST(AnalyticFlows, TheWallIsKept) {
  const AnalyticFlow stokes = cases()[1].flow, potential = cases()[3].flow;
  std::mt19937 random(3);
  std::normal_distribution<double> normal;
  for (int i = 0; i < 200; ++i) {
    const Vector3d e = Vector3d(normal(random), normal(random), normal(random)).normalized();
    const Body body = stokes.bodyAt(Now);
    const Vector3d x = body.centre + R * (1 + 1e-9) * e;
    EXPECT_LT((stokes.velocity(x, Now) - body.velocityAt(x)).norm(), 1e-7 * Speed); // no slip
    EXPECT_NEAR((potential.velocity(x, Now) - body.velocity).dot(e), 0, 1e-7 * Speed);
    const Vector3d inside = body.centre + 0.5 * R * e;
    EXPECT_LT((stokes.velocity(inside, Now) - body.velocityAt(inside)).norm(), 1e-12);
    EXPECT_EQ(potential.pressure(inside, Now), 0);
  }
}

TEST(AnalyticFlows, HillsVortexHasNoSeam) {
  const AnalyticFlow flow = sphere(FlowKind::HillsVortex);
  const Body body = flow.bodyAt(Now);
  for (const Vector3d& x : places(flow, Now)) {
    const Vector3d e = (x - body.centre).normalized();
    const Vector3d in = body.centre + R * (1 - 1e-9) * e, out = body.centre + R * (1 + 1e-9) * e;
    EXPECT_LT((flow.velocity(in, Now) - flow.velocity(out, Now)).norm(), 1e-7 * Speed);
    EXPECT_NEAR(flow.pressure(in, Now), flow.pressure(out, Now), 1e-6 * flow.density * Speed * Speed);
  }
  EXPECT_NEAR((flow.velocity(body.centre, Now) - 2.5 * V).norm(), 0, 1e-12); // Batchelor, section 7.2
}

TEST(AnalyticFlows, NothingIsFasterThanTheMaximumSpeed) {
  for (const Case& c : cases()) {
    SCOPED_TRACE(c.name);
    double fastest = 0;
    for (const Vector3d& x : places(c.flow, Now)) fastest = std::max(fastest, c.flow.velocity(x, Now).norm());
    EXPECT_LE(fastest, c.flow.maximumSpeed(Now));
    EXPECT_GT(fastest, 0.3 * c.flow.maximumSpeed(Now));
  }
}

TEST(AnalyticFlows, WithoutABodyTheFluidRests) {
  AnalyticFlow flow;
  flow.body.velocity = V;
  const Vector3d x(0.001, 0, 0);
  for (FlowKind kind : {FlowKind::StokesSphere, FlowKind::PotentialSphere, FlowKind::HillsVortex}) {
    flow.kind = kind;
    EXPECT_EQ(flow.velocity(x, 1).norm(), 0);
    EXPECT_EQ(flow.gradient(x, 1).norm(), 0);
    EXPECT_EQ(flow.acceleration(x, 1).norm(), 0);
    EXPECT_EQ(flow.pressure(x, 1), 0);
  }
}
