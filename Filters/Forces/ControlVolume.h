#pragma once
#include "FluidNodes.h"

namespace rimflow {

/// The shell in which the weight of the momentum balance falls from 1 to 0, m from the body's centre.
struct ControlShell {
  double inner = 0, outer = 0;
};

struct MomentumBalance {
  Eigen::Vector3d force = Eigen::Vector3d::Zero();         ///< of the fluid on the body, N
  Eigen::Vector3d pressureSigma = Eigen::Vector3d::Zero(); ///< from the error of the pressure, N
  Eigen::Vector3d zoneSigma = Eigen::Vector3d::Zero();     ///< by which the second balance moves the first, N
  double missing = 0; ///< share of the shell without data, 0 to 1: nodes that hold no fluid
  bool cut = false;   ///< the shell reaches beyond the grid
};

/// The force on the body from the momentum of the fluid around it. density: kg/m3; viscosity: kinematic,
/// m2/s. wallLayer: thickness of the boundary layer, m. The formula stands at the implementation.
MomentumBalance momentumBalance(const FluidNodes& fluid, double density, double viscosity, double wallLayer,
                                const ControlShell& shell);

} // namespace rimflow
