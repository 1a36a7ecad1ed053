#pragma once
#include "FluidNodes.h"
#include "Progress.h"
#include "TangentialHarmonics.h"

#include <vector>

namespace rimflow {

/// d u/d n at the wall, less the body's rotation: a tangential field in vector spherical harmonics.
class WallShear {
public:
  static constexpr int Degree = 4;
  using Harmonics = TangentialHarmonics<Degree>;

  /// No shear.
  WallShear() : coefficients_(Coefficients::Zero()) {}
  /// From a fit to the velocity within `reach` of the wall, m, that has no slip there. wallLayer: thickness
  /// of the boundary layer, m, > 0. The model stands at the implementation. No shear
  /// when progress aborts.
  WallShear(const FluidNodes& fluid, double wallLayer, double reach, const Progress& progress = {});

  /// In a direction from the body's centre, 1/s.
  Eigen::Vector3d at(const Eigen::Vector3d& n) const { return Harmonics(n).field * coefficients_; }
  /// Its divergence on the unit sphere, 1/s.
  double divergence(const Eigen::Vector3d& n) const { return Harmonics(n).divergence.dot(coefficients_); }

private:
  using Coefficients = Eigen::Matrix<double, Harmonics::Size, 1>;
  Coefficients coefficients_;
};

} // namespace rimflow
