#pragma once
#include "FluidNodes.h"
#include "Progress.h"
#include "WallFriction.h"

#include <functional>
#include <vector>

namespace rimflow {

/// The pressure at the wall, Pa, in the given directions from the body's centre: from the fluid's nodes near
/// the wall, carried to it with their own gradient. slope: d p/d n at the wall where it is known, Pa/m, at
/// slopeDirections. wallLayer: thickness of the boundary layer, m, > 0. The model stands at the
/// implementation.
std::vector<double> wallPressure(const FluidNodes& fluid, double wallLayer,
                                 const std::vector<Eigen::Vector3d>& slopeDirections,
                                 const std::vector<double>& slope,
                                 const std::vector<Eigen::Vector3d>& directions,
                                 const Progress& progress = {});

} // namespace rimflow
