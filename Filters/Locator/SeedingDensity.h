#pragma once
#include "Body.h"
#include "ParticleIndex.h"

#include <array>
#include <vector>

namespace rimflow {

/// The smooth number density n(x) of tracers in the fluid, estimated from one snapshot. Counts on cells of
/// about `cell` are compared with the product of the seeding's profiles along x, y and z (a light sheet's,
/// say); the ratio is blurred, numerator and denominator apart, so that bodies and the faces of the seeded
/// box do not dilute it; where few particles back it, it is drawn towards wider blurs and at last towards 1.
/// n is 0 outside the seeded box.
class SeedingDensity {
public:
  /// particles must outlive this object. cell: m, > 0, about half a sphere's radius; enlarged where a cell
  /// would hold less than one particle on average.
  SeedingDensity(const ParticleIndex& particles, double cell);

  /// Takes the balls of these bodies out of the fluid (their particles and their volume); replaces an earlier
  /// set.
  void exclude(const std::vector<Body>& bodies);

  const Box& box() const { return box_; }
  double mean() const { return mean_; }                                          ///< 1/m3, over the fluid
  double at(const Eigen::Vector3d& x) const { return interpolate(density_, x); } ///< n(x), 1/m3
  double expectedWithin(const Eigen::Vector3d& centre, ///< integral of n over a ball: particles it would hold
                        double radius) const;
  /// The same of the smaller of n and the product of its profiles, for judging voids: the emptiest of many
  /// places is often one where n came out too high by chance.
  double cautiouslyExpectedWithin(const Eigen::Vector3d& centre, double radius) const;
  /// Gradient of expectedWithin with respect to the centre: the surface integral of n times the normal, 1/m.
  Eigen::Vector3d expectedGradient(const Eigen::Vector3d& centre, double radius) const;
  /// Derivative of expectedWithin with respect to the radius: the surface integral of n, 1/m.
  double expectedPerRadius(const Eigen::Vector3d& centre, double radius) const;

  /// Variance of counts over their Poisson variance in blocks of about three cells, against their
  /// neighbours; robust (a median), >= 1. Well above 1 the seeding is clustered and voids come by chance.
  double dispersion() const { return dispersion_; }

private:
  std::size_t cellIndex(int i, int j, int k) const {
    return i + std::size_t(n_[0]) * (j + std::size_t(n_[1]) * k);
  }
  /// use(c, {i, j, k}) for every cell.
  template <class Use>
  void forEachCell(Use&& use) const {
    int at[3];
    std::size_t c = 0;
    for (at[2] = 0; at[2] < n_[2]; ++at[2])
      for (at[1] = 0; at[1] < n_[1]; ++at[1])
        for (at[0] = 0; at[0] < n_[0]; ++at[0]) use(c++, at);
  }
  int cellOf(int axis, double x) const {
    const int c = int(std::floor((x - box_.lower[axis]) / h_[axis]));
    return c < 0 ? 0 : c >= n_[axis] ? n_[axis] - 1 : c;
  }
  std::vector<double> profiles(const std::vector<double>& count, const std::vector<double>& volume) const;
  void estimate(std::vector<double> count, const std::vector<double>& volume);
  void measureDispersion();
  double interpolate(const std::vector<double>& values, const Eigen::Vector3d& x) const; // 0 outside the box
  double integrate(const std::vector<double>& values, const Eigen::Vector3d& centre, double radius) const;

  const ParticleIndex* particles_;
  Box box_;
  std::array<int, 3> n_{1, 1, 1};
  Eigen::Vector3d h_ = Eigen::Vector3d::Ones();
  std::vector<double> count_;    // particles per cell, nothing excluded
  std::vector<double> density_;  // per cell
  std::vector<double> cautious_; // per cell, at most the product of the profiles
  double mean_ = 0, dispersion_ = 1;
};

/// Volume of a ball of radius r.
constexpr double ballVolume(double r) { return 4.18879020478639098 * r * r * r; }

/// Directions spread evenly over the unit sphere (Fibonacci lattice); each stands for the same solid angle.
const std::vector<Eigen::Vector3d>& evenDirections();

} // namespace rimflow
