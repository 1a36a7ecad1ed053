#pragma once
#include "FluidNodes.h"

#include <vector>

namespace rimflow {

/// d u/d n at the wall, 1/s, less the body's rotation, in the given directions from the body's centre: from a
/// fit to the velocity near the wall that has no slip there. It is tangential. wallLayer: thickness of the
/// boundary layer, m, > 0. The model stands at the implementation.
std::vector<Eigen::Vector3d> wallShear(const FluidNodes& fluid, double wallLayer,
                                       const std::vector<Eigen::Vector3d>& directions);

} // namespace rimflow
