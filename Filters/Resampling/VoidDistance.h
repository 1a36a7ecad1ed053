#pragma once
#include "Grid.h"

#include <vector>

namespace rimflow {

/// Where there are no particles, there may be a body that nobody knows of: the signed distance, m, from the
/// union of all balls of `radius` (m, > 0), with their centres on nodes within the particles' box, that hold
/// no particle; < 0 inside, 1e30 farther than two radii outside. One number per node of `grid` (the same
/// spacing along all axes); empty when there is no such ball. positions: x y z per particle, m.
std::vector<float> voidDistance(const std::vector<double>& positions, const Grid& grid, double radius);

} // namespace rimflow
