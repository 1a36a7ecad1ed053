#pragma once
#include "Body.h"
#include "Grid.h"

#include <vector>

namespace rimflow {

/// Sets the mask, one per node, to 1 at the nodes inside the body. An empty mask stands for fluid everywhere
/// and is filled first.
inline void maskInside(const Grid& grid, const Body& body, std::vector<unsigned char>& mask) {
  if (mask.empty()) mask.assign(grid.size(), 0);
  forEachNodeNear(grid, body.centre.data(), 0.5 * body.diameter, [&](int i, int j, int k) {
    const auto x = grid.position(i, j, k);
    if (body.contains({x[0], x[1], x[2]})) mask[grid.index(i, j, k)] = 1;
  });
}

} // namespace rimflow
