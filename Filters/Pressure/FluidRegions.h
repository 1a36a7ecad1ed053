#pragma once
#include "Grid.h"

#include <vector>

namespace rimflow {

/// Which nodes hang together, over the faces of their cells.
struct FluidRegions {
  std::vector<int> region; ///< one per node: 0 for the largest connected part of the fluid, then 1, 2, ...;
                           ///< -1 where there is no fluid
  int count = 0;           ///< connected parts
};

/// mask: one per node, not 0: no fluid; null: fluid everywhere.
FluidRegions fluidRegions(const Grid& grid, const unsigned char* mask);

/// Takes the mean over each region away from a field, one number per node; sets it to 0 where there is no
/// fluid.
void removeRegionMeans(const FluidRegions& regions, double* field);

} // namespace rimflow
