#pragma once
#include "FluidNodes.h"

#include <vector>

namespace rimflow {

/// The pressure at the wall, Pa, in the given directions from the body's centre: from the fluid's nodes near
/// the wall, carried to it with their own gradient. The model stands at the implementation.
std::vector<double> wallPressure(const FluidNodes& fluid, const std::vector<Eigen::Vector3d>& directions);

} // namespace rimflow
