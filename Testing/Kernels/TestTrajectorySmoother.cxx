// Breaks when the smoothed path is not better than its estimates, its covariances are not true (also when the
// estimates' errors are correlated in time), gaps are not bridged, or one wrong estimate spoils the path.
#include "TrajectorySmoother.h"

#include <Eigen/Cholesky>
#include <cmath>
#include <gtest/gtest.h>
#include <random>

using namespace rimflow;
using Eigen::Matrix3d;
using Eigen::Vector3d;

namespace {

constexpr double Sigma = 30e-6, Step = 1e-3;

// A sphere that rises at 0.35 m/s and sways.
Vector3d path(double t) { return {2e-3 * std::sin(20 * t), 0.35 * t, 1e-3 * std::cos(15 * t)}; }
Vector3d pathVelocity(double t) { return {40e-3 * std::cos(20 * t), 0.35, -15e-3 * std::sin(15 * t)}; }

// correlation: of the error from one snapshot to the next.
std::vector<CentreEstimate> estimates(int n, unsigned seed, double correlation = 0) {
  std::mt19937 random(seed);
  std::normal_distribution<double> normal;
  std::vector<CentreEstimate> list;
  Vector3d error = Vector3d::Zero();
  for (int k = 0; k < n; ++k) {
    const Vector3d fresh = Sigma * Vector3d(normal(random), normal(random), normal(random));
    error = k == 0 ? fresh : Vector3d(correlation * error + std::sqrt(1 - correlation * correlation) * fresh);
    list.push_back({43.12 + k * Step, true, path(k * Step) + error, Sigma * Sigma * Matrix3d::Identity(), nullptr});
  }
  return list;
}

struct Score {
  double error = 0, chiSquared = 0, velocityError = 0, velocityChiSquared = 0;
};
Score score(const SmoothedTrajectory& t) {
  Score s;
  const double n = double(t.points.size());
  for (std::size_t k = 0; k < t.points.size(); ++k) {
    const SmoothedCentre& p = t.points[k];
    const Vector3d e = p.centre - path(k * Step), v = p.velocity - pathVelocity(k * Step);
    s.error += e.norm() / n;
    s.velocityError += v.norm() / n;
    s.chiSquared += e.dot(p.centreCovariance.llt().solve(e)) / (3 * n);
    s.velocityChiSquared += v.dot(p.velocityCovariance.llt().solve(v)) / (3 * n);
  }
  return s;
}
Score meanScore(int records, int n, double correlation) {
  Score mean;
  for (int r = 0; r < records; ++r) {
    const Score s = score(smoothTrajectory(estimates(n, 100 + r, correlation)));
    mean.error += s.error / records;
    mean.velocityError += s.velocityError / records;
    mean.chiSquared += s.chiSquared / records;
    mean.velocityChiSquared += s.velocityChiSquared / records;
  }
  return mean;
}

} // namespace

TEST(TrajectorySmoother, IsBetterThanTheEstimatesAndKnowsByHowMuch) {
  const Score s = meanScore(30, 40, 0);
  EXPECT_LT(s.error, 0.6 * 1.6 * Sigma); // 1.6 sigma: mean length of the estimates' error
  EXPECT_GT(s.chiSquared, 0.5);
  EXPECT_LT(s.chiSquared, 2);
  EXPECT_LT(s.velocityError, 0.02 * 0.35);
  EXPECT_GT(s.velocityChiSquared, 0.3);
  EXPECT_LT(s.velocityChiSquared, 2);
}

TEST(TrajectorySmoother, DoesNotClaimToAverageCorrelatedErrorsAway) {
  const Score s = meanScore(30, 40, 0.85);
  EXPECT_GT(s.chiSquared, 0.4);
  EXPECT_LT(s.chiSquared, 2.5);
}

TEST(TrajectorySmoother, BridgesGapsWithAGrowingCovariance) {
  auto list = estimates(40, 1);
  for (int k : {0, 1, 15, 16, 17, 18, 39}) list[k].found = false;
  const SmoothedTrajectory t = smoothTrajectory(list);
  for (int k = 0; k < 40; ++k) {
    EXPECT_EQ(t.points[k].status, list[k].found ? CentreStatus::Found : CentreStatus::Predicted);
    EXPECT_LT((t.points[k].centre - path(k * Step)).norm(), 4 * Sigma);
  }
  EXPECT_GT(t.points[16].centreCovariance.trace(), t.points[12].centreCovariance.trace());
  EXPECT_GT(t.points[0].centreCovariance.trace(), t.points[5].centreCovariance.trace());
}

TEST(TrajectorySmoother, FarFromAnyFindThereIsNoPrediction) {
  auto list = estimates(60, 1);
  for (int k = 30; k < 60; ++k) list[k].found = false;
  list[10].found = false;
  SmootherOptions options;
  options.largestPredictionSigma = 5 * Sigma;
  const SmoothedTrajectory t = smoothTrajectory(list, options);
  EXPECT_EQ(t.points[10].status, CentreStatus::Predicted);
  EXPECT_EQ(t.points[30].status, CentreStatus::Predicted);
  EXPECT_EQ(t.points[59].status, CentreStatus::Lost);
  EXPECT_TRUE(t.points[59].centre.hasNaN());
  EXPECT_EQ(smoothTrajectory(list).points[59].status, CentreStatus::Predicted); // no limit
}

TEST(TrajectorySmoother, OneWrongEstimateIsLeftOut) {
  auto list = estimates(40, 2);
  list[20].centre.x() += 2e-3;
  const SmoothedTrajectory t = smoothTrajectory(list);
  EXPECT_EQ(t.rejected, 1);
  EXPECT_EQ(t.points[20].status, CentreStatus::Predicted);
  EXPECT_LT((t.points[20].centre - path(20 * Step)).norm(), 3 * Sigma);
}

TEST(TrajectorySmoother, TheOrderOfTheEstimatesIsFree) {
  const auto list = estimates(12, 3);
  const std::vector<CentreEstimate> reversed(list.rbegin(), list.rend());
  const SmoothedTrajectory a = smoothTrajectory(list), b = smoothTrajectory(reversed);
  for (int k = 0; k < 12; ++k) EXPECT_LT((a.points[k].centre - b.points[11 - k].centre).norm(), 1e-12);
}

TEST(TrajectorySmoother, FewEstimates) {
  EXPECT_TRUE(smoothTrajectory({}).points.empty());
  auto list = estimates(3, 4);
  for (auto& e : list) e.found = false;
  for (const auto& p : smoothTrajectory(list).points) {
    EXPECT_EQ(p.status, CentreStatus::Lost);
    EXPECT_TRUE(std::isnan(p.centre.x()));
  }
  const SmoothedTrajectory one = smoothTrajectory(estimates(1, 5));
  EXPECT_LT((one.points[0].centre - path(0)).norm(), 5 * Sigma);
  EXPECT_NEAR(std::sqrt(one.points[0].velocityCovariance(1, 1)), 1, 0.1); // the prior: nothing is known
  const SmoothedTrajectory two = smoothTrajectory(estimates(2, 5));
  EXPECT_LT(std::sqrt(two.points[0].velocityCovariance(1, 1)), 3 * Sigma / Step);
}

TEST(TrajectorySmoother, RefusesWhatIsNoEstimate) {
  auto list = estimates(4, 6);
  list[2].covariance.setZero();
  EXPECT_THROW(smoothTrajectory(list), std::invalid_argument);
  list = estimates(4, 6);
  list[1].centre.x() = std::nan("");
  EXPECT_THROW(smoothTrajectory(list), std::invalid_argument);
}
