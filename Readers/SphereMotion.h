#pragma once
#include "CentreStatus.h"

#include <Eigen/Core>
#include <vector>

namespace rimflow {

struct SphereMotionOptions {
  int order = 3;         ///< of the local polynomial, 2 to 5
  int window = 15;       ///< typical row intervals + 1 that it spans, > order
  double leastSigma = 0; ///< m: residuals smaller than this are no noise
};

/// What is known of the sphere at one time. A vector that is not known is no number.
struct SphereState {
  CentreStatus status = CentreStatus::Lost;
  Eigen::Vector3d centre, velocity, acceleration;          ///< m, m/s, m/s2
  Eigen::Vector3d sigma, velocitySigma, accelerationSigma; ///< standard deviations per component
};

/// The motion of a sphere whose places alone are known, at some times.
///
/// Velocity and acceleration at a row: the derivatives of the polynomial that fits best (least squares,
/// Savitzky & Golay 1964, for any spacing of the times) to the rows within a window around it; near the ends
/// the window moves inwards. With too few rows in it for the order, the order is lowered: two rows tell the
/// velocity, three the acceleration. The centre of a row is its own place; that of a lost row is the
/// polynomial's (Predicted) when there are known rows on both sides within the window, and at least order + 1
/// of them.
///
/// Between two rows: the centre is on the cubic through both with their velocities (Hermite), velocity and
/// acceleration go linearly from one to the other, and the status is the worse one. Where the rows are
/// farther apart than the window, and before the first and after the last row, the sphere is lost.
///
/// Standard deviations come from the residuals of the fits over the whole trajectory, for errors that are
/// independent from row to row: where the rows were smoothed before, they are too small. Rows that hardly
/// scatter at all (leastSigma) tell no standard deviations.
class SphereMotion {
public:
  /// times: s, strictly increasing; centres: m, not numbers where lost. Throws std::invalid_argument for
  /// options out of range.
  SphereMotion(std::vector<double> times, std::vector<Eigen::Vector3d> centres,
               const SphereMotionOptions& options = {});

  const std::vector<double>& times() const { return times_; }
  const std::vector<SphereState>& rows() const { return rows_; }
  SphereState at(double time) const;

private:
  struct Fit;
  Fit fit(std::size_t row) const;
  double typicalInterval(std::size_t row) const;

  std::vector<double> times_;
  std::vector<Eigen::Vector3d> centres_;
  SphereMotionOptions options_;
  std::vector<std::size_t> known_; ///< rows with a place
  std::vector<SphereState> rows_;
};

} // namespace rimflow
