#pragma once
#include "PressureProblem.h"
#include "Progress.h"

namespace rimflow {

struct ParallelLineOptions {
  int directions = 642;   ///< at least so many: the next larger 10 n^2 + 2 of a geodesic icosphere, >= 12
  double lineSpacing = 0; ///< between the lines of one direction, m; 0: the smallest grid spacing
  double tolerance =
      1e-4; ///< stop when an iteration changes the boundary's pressure by this part of its rms, > 0
  int maximumIterations = 200; ///< >= 1
};

/// Omni-directional integration along parallel lines (Liu & Katz 2006; Wang, Zhang & Katz 2019) with its
/// iteration of the boundary's pressure.
/// Throws std::invalid_argument when no node holds fluid or an option is out of range.
PressureSolution parallelLinePressure(const PressureProblem& problem, const ParallelLineOptions& options = {},
                                      const Progress& progress = {});

} // namespace rimflow
