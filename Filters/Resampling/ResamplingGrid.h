#pragma once
#include "Grid.h"

#include <array>
#include <cstddef>
#include <optional>

namespace rimflow {

/// A cubic grid for particles. positions: count triples x y z, m; rows that are not finite are left out.
/// bounds: xmin xmax ymin ymax zmin zmax, m; none: the box between the 0.05 % and the 99.95 % quantile of the
/// positions per axis, so that strays do not stretch it. spacing: m; 0: half the mean particle spacing
/// (volume per particle)^(1/3), which is the published choice (0.689 mm at 0.4 particles per mm3). The nodes
/// lie centred in the box, on both faces where the spacing divides it. Throws std::invalid_argument when
/// there are fewer than 20 particles, the box is flat, or the grid would have fewer than 5 nodes along an
/// axis or more than 2^28 in all.
Grid resamplingGrid(const float* positions, std::size_t count, double spacing,
                    const std::optional<std::array<double, 6>>& bounds);

} // namespace rimflow
