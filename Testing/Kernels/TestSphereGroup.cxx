// Breaks when two spheres are mistaken for each other as they pass, when one takes the other's void, or when
// a sphere of another diameter is taken for the one sought.
#include "SphereGroup.h"
#include "TracerCloud.h"

#include <algorithm>
#include <gtest/gtest.h>

using namespace rimflow;
using Eigen::Vector3d;

namespace {

/// Tracers outside of two balls.
std::vector<float> cloud(const Vector3d& a, double diameterA, const Vector3d& b, double diameterB,
                         unsigned seed) {
  TracerCloud around;
  around.diameter = diameterA;
  around.density = 0.3e9;
  around.lower = {-0.02, -0.02, -0.0125};
  around.upper = {0.02, 0.02, 0.0125};
  around.seeding = [&](const Vector3d& x, const Vector3d&) {
    return (x - b).norm() < 0.5 * diameterB ? 0. : 1.;
  };
  return around.positions(a, seed);
}

const Vector3d& centre(const SphereGroup& group, std::size_t sphere, int k) {
  return group[sphere].known().at(1e-3 * k).centre;
}

} // namespace

TEST(SphereGroup, EqualSpheresStayThemselvesWhenTheyPass) {
  constexpr double D = 7.93e-3;
  const auto a = [](int k) { return Vector3d(-0.0044, 0.001 * (k - 8), 0); }; // passes upwards ...
  const auto b = [](int k) {
    return Vector3d(0.0044, -0.001 * (k - 8), 0);
  }; // ... and downwards, 0.11 d apart
  SphereGroup group({}, {D, D});
  for (int k = 0; k < 16; ++k) {
    const auto x = cloud(a(k), D, b(k), D, 300 + k);
    ASSERT_TRUE(group.locate(1e-3 * k, {x.data(), x.size() / 3}));
    ASSERT_TRUE(group[0].known().at(1e-3 * k).found && group[1].known().at(1e-3 * k).found) << k;
  }
  const bool first = (centre(group, 0, 0) - a(0)).norm() < (centre(group, 0, 0) - b(0)).norm();
  double square =
      0; // over 60 sets of tracers: rms 0.011 to 0.019 d; of 1920 centres 1 in 140 is beyond 0.04 d
  for (int k = 0; k < 16; ++k) {
    const double errorA = (centre(group, first ? 0 : 1, k) - a(k)).norm();
    const double errorB = (centre(group, first ? 1 : 0, k) - b(k)).norm();
    EXPECT_LT(std::max(errorA, errorB), 0.04 * D) << k; // the other sphere is 1.1 d away or farther
    square += (errorA * errorA + errorB * errorB) / 32;
  }
  EXPECT_LT(std::sqrt(square), 0.025 * D);
}

TEST(SphereGroup, EachDiameterFindsItsOwnSphere) {
  constexpr double Small = 7.93e-3, Large = 11.11e-3;
  const Vector3d s(-0.010, 0.004, 0.001), l(0.009, -0.005, -0.001);
  SphereGroup group({}, {Small, Large}); // the smaller is named first
  const auto x = cloud(s, Small, l, Large, 5);
  group.locate(0, {x.data(), x.size() / 3});
  ASSERT_TRUE(group[0].known().at(0).found && group[1].known().at(0).found);
  EXPECT_LT((centre(group, 0, 0) - s).norm(), 0.03 * Small);
  EXPECT_LT((centre(group, 1, 0) - l).norm(), 0.03 * Large);
}

TEST(SphereGroup, TheSecondIsLostWhenThereIsOnlyOne) {
  constexpr double D = 9.53e-3;
  const Vector3d at(0.002, -0.003, 0.001);
  SphereGroup group({}, {D, D});
  const auto x = cloud(at, D, Vector3d::Constant(1), D, 6);
  group.locate(0, {x.data(), x.size() / 3});
  EXPECT_TRUE(group[0].known().at(0).found);
  EXPECT_FALSE(group[1].known().at(0).found);
}

TEST(SphereGroup, RefusesAnEmptyList) { EXPECT_THROW(SphereGroup({}, {}), std::invalid_argument); }
