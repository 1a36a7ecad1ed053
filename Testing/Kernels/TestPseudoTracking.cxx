// Breaks when pseudo-tracking is not of second order in time, uses a masked node, misses what the ends of a
// series or a moving mask leave known, or accepts a series without neighbours.
#include "AnalyticFlows.h"
#include "PseudoTracking.h"

#include <cmath>
#include <gtest/gtest.h>
#include <limits>
#include <omp.h>

using namespace rimflow;
using Eigen::Vector3d;

namespace {

AnalyticFlow vortices(FlowKind kind) {
  AnalyticFlow flow;
  flow.kind = kind;
  flow.viscosity = 1e-4; // it decays visibly
  return flow;
}

Grid gridOf(int nodes, double length) {
  const double h = length / (nodes - 1);
  return {{0.001, -0.002, 0.0005}, {h, h, h}, {nodes, nodes, nodes}};
}

/// Three snapshots of a flow, with a mask where its body is; NaN there, which would spread if it were used.
struct Snapshots {
  Grid grid;
  double before, after;
  std::vector<float> velocity[3];
  std::vector<unsigned char> mask[3];

  Snapshots(const AnalyticFlow& flow, const Grid& g, double timeBefore, double timeAfter)
      : grid(g), before(timeBefore), after(timeAfter) {
    const double time[3] = {-before, 0, after};
    for (int s = 0; s < 3; ++s) {
      velocity[s].resize(3 * g.size());
      mask[s].resize(g.size());
      for (int k = 0; k < g.n[2]; ++k)
        for (int j = 0; j < g.n[1]; ++j)
          for (int i = 0; i < g.n[0]; ++i) {
            const auto x = g.position(i, j, k);
            const Vector3d at(x[0], x[1], x[2]), u = flow.velocity(at, time[s]);
            const std::size_t node = g.index(i, j, k);
            mask[s][node] = flow.hasWall() && flow.bodyAt(time[s]).contains(at);
            for (int c = 0; c < 3; ++c)
              velocity[s][3 * node + c] = mask[s][node] ? std::numeric_limits<float>::quiet_NaN() : u[c];
          }
    }
  }
  VelocitySeries series() const {
    VelocitySeries out;
    out.grid = grid;
    out.previous = velocity[0].data(), out.present = velocity[1].data(), out.next = velocity[2].data();
    out.previousMask = mask[0].data(), out.presentMask = mask[1].data(), out.nextMask = mask[2].data();
    out.timeBefore = before, out.timeAfter = after;
    return out;
  }
};

/// rms error of the acceleration at the known nodes `margin` from the faces, relative to the rms of the
/// exact one.
double error(const AnalyticFlow& flow, const Grid& g, const PseudoTrackingResult& found, int margin) {
  double error = 0, square = 0;
  for (int k = margin; k < g.n[2] - margin; ++k)
    for (int j = margin; j < g.n[1] - margin; ++j)
      for (int i = margin; i < g.n[0] - margin; ++i) {
        const std::size_t node = g.index(i, j, k);
        if (found.mask[node]) continue;
        const auto x = g.position(i, j, k);
        const Vector3d exact = flow.acceleration({x[0], x[1], x[2]}, 0);
        error += (Eigen::Map<const Eigen::Vector3f>(&found.acceleration[3 * node]).cast<double>() - exact)
                     .squaredNorm();
        square += exact.squaredNorm();
      }
  return std::sqrt(error / square);
}

std::size_t unknown(const PseudoTrackingResult& found) {
  return std::count(found.mask.begin(), found.mask.end(), 1);
}

} // namespace

TEST(PseudoTracking, IsOfSecondOrderInTime) {
  for (FlowKind kind : {FlowKind::TaylorGreen, FlowKind::ABC}) {
    const AnalyticFlow flow = vortices(kind);
    const Grid grid = gridOf(41, 0.02);
    double errors[2];
    for (int level = 0; level < 2; ++level) {
      const double step = level == 0 ? 8e-3 : 4e-3;
      errors[level] = error(flow, grid, pseudoTracking(Snapshots(flow, grid, step, step).series()), 4);
    }
    EXPECT_LT(errors[1], 0.02);
    EXPECT_GT(errors[0] / errors[1], 3.3);
  }
}

TEST(PseudoTracking, UnequalTimeStepsAreOfSecondOrderToo) {
  const AnalyticFlow flow = vortices(FlowKind::ABC);
  const Grid grid = gridOf(41, 0.02);
  double errors[2];
  for (int level = 0; level < 2; ++level) {
    const double step = level == 0 ? 8e-3 : 4e-3;
    errors[level] = error(flow, grid, pseudoTracking(Snapshots(flow, grid, step, 0.6 * step).series()), 4);
  }
  EXPECT_GT(errors[0] / errors[1], 3.3);
}

// Trilinear sampling alone leaves an error of (path/h) h^2 u''/dt, several times this.
TEST(PseudoTracking, InterpolationCostsLittle) {
  const AnalyticFlow flow = vortices(FlowKind::ABC);
  const Grid grid = gridOf(25, 0.02); // 24 spacings per period
  EXPECT_LT(error(flow, grid, pseudoTracking(Snapshots(flow, grid, 1e-3, 1e-3).series()), 2), 3e-3);
}

TEST(PseudoTracking, TheEndsOfASeriesAreOneSided) {
  const AnalyticFlow flow = vortices(FlowKind::ABC);
  const Grid grid = gridOf(41, 0.02);
  for (bool first : {true, false}) {
    double errors[2];
    for (int level = 0; level < 2; ++level) {
      const double step = level == 0 ? 2e-3 : 1e-3;
      const Snapshots snapshots(flow, grid, step, step);
      VelocitySeries series = snapshots.series();
      if (first)
        series.previous = nullptr;
      else
        series.next = nullptr;
      const PseudoTrackingResult found = pseudoTracking(series);
      errors[level] = error(flow, grid, found, 4);
    }
    EXPECT_LT(errors[1], 0.05);
    EXPECT_GT(errors[0] / errors[1], 1.8); // first order
  }
}

// Where the path leaves by a face in one direction, it comes from within in the other.
TEST(PseudoTracking, TheFacesAreOneSided) {
  const AnalyticFlow flow = vortices(FlowKind::ABC);
  const Grid grid = gridOf(41, 0.02);
  const PseudoTrackingResult found = pseudoTracking(Snapshots(flow, grid, 1e-3, 1e-3).series());
  EXPECT_LT(unknown(found), grid.size() / 200); // on the edges, where it leaves both ways
  EXPECT_LT(error(flow, grid, found, 0), 0.03);
}

// The sphere moves almost half a spacing per step: what it uncovers has no past, what it covers no future.
TEST(PseudoTracking, AMovingMaskIsNeverMixedIn) {
  AnalyticFlow flow;
  flow.kind = FlowKind::StokesSphere;
  flow.body.diameter = 0.008;
  flow.body.velocity = Vector3d(0.1, 0.02, -0.05);
  const Grid grid{{-0.01, -0.01, -0.01}, {5e-4, 5e-4, 5e-4}, {41, 41, 41}};
  const Snapshots snapshots(flow, grid, 2e-3, 2e-3);
  const PseudoTrackingResult found = pseudoTracking(snapshots.series());
  std::size_t fluid = 0, unknownFluid = 0;
  for (std::size_t node = 0; node < grid.size(); ++node) {
    if (snapshots.mask[1][node]) {
      EXPECT_EQ(found.mask[node], 1);
      continue;
    }
    ++fluid;
    unknownFluid += found.mask[node];
    for (int c = 0; c < 3; ++c) ASSERT_TRUE(std::isfinite(found.acceleration[3 * node + c]));
    for (int c = 0; c < 3; ++c) EXPECT_TRUE(!found.mask[node] || found.acceleration[3 * node + c] == 0);
  }
  EXPECT_LT(unknownFluid, fluid / 50);
  EXPECT_LT(error(flow, grid, found, 2), 0.01); // 0.07 with trilinear interpolation next to the wall
}

TEST(PseudoTracking, AUniformFlowHasNoAcceleration) {
  const Grid grid{{0, 0, 0}, {1e-3, 2e-3, 5e-4}, {9, 1, 7}}; // one node along y
  std::vector<float> u(3 * grid.size());
  for (std::size_t node = 0; node < grid.size(); ++node)
    u[3 * node] = 0.3f, u[3 * node + 1] = 0.5f, u[3 * node + 2] = -0.1f;
  VelocitySeries series;
  series.grid = grid;
  series.previous = series.present = series.next = u.data();
  series.timeBefore = series.timeAfter = 1e-3;
  const PseudoTrackingResult found = pseudoTracking(series);
  for (float a : found.acceleration) EXPECT_NEAR(a, 0, 1e-4);
  EXPECT_EQ(unknown(found), 2u); // two corners, which the flow only touches
}

TEST(PseudoTracking, DoesNotDependOnTheNumberOfThreads) {
  const AnalyticFlow flow = vortices(FlowKind::ABC);
  const Snapshots snapshots(flow, gridOf(17, 0.02), 1e-3, 1e-3);
  const int before = omp_get_max_threads();
  omp_set_num_threads(1);
  const auto one = pseudoTracking(snapshots.series());
  omp_set_num_threads(5);
  EXPECT_EQ(pseudoTracking(snapshots.series()).acceleration, one.acceleration);
  omp_set_num_threads(before);
}

TEST(PseudoTracking, RefusesWhatItCannotUse) {
  const Snapshots snapshots(vortices(FlowKind::ABC), gridOf(5, 0.02), 1e-3, 1e-3);
  VelocitySeries series = snapshots.series();
  series.timeAfter = 0;
  EXPECT_THROW(pseudoTracking(series), std::invalid_argument);
  series.next = nullptr;
  EXPECT_NO_THROW(pseudoTracking(series)); // that time is not used
  series.previous = nullptr;
  EXPECT_THROW(pseudoTracking(series), std::invalid_argument);
}
