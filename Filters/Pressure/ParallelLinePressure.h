#pragma once
#include "PressureProblem.h"
#include "Progress.h"

#include <array>
#include <vector>

namespace rimflow {

struct ParallelLineOptions {
  int directions =
      642; ///< at least so many: the next larger 10 n^2 + 2 of a geodesic icosphere, 12 to 163842
  double lineSpacing = 0; ///< between the lines of one direction, m; 0: the smallest grid spacing
  int order = 4;          ///< of the integration from node to node: 4, or 2 (trapezoid)
  /// Stop when an iteration changes the boundary's pressure by this part of its rms, > 0. The published 1e-4
  /// is too soon where two chambers are joined by a hole; each factor of 10 costs about two iterations.
  double tolerance = 1e-6;
  int maximumIterations = 200; ///< >= 1
};

/// Omni-directional integration along parallel lines (Liu & Katz 2006; Wang, Zhang & Katz 2019) with its
/// iteration of the boundary's pressure, sped up by Anderson's method. The pressure of a node is the mean
/// over all the lines through it, in every direction e, of
///     p(x) = p(x_b) + integral from x_b to x of grad p . e ds,
/// x_b being where the line enters the fluid: on a face of the grid or at the mask. A line goes from node to
/// node through the cells that it crosses, and ends where it meets the mask, so regions with a large error of
/// the acceleration are left out by masking them.
/// On a grid of one node along an axis the directions lie in its plane, evenly spread.
/// The result does not depend on the number of threads. `residual` is the last change of the boundary's
/// pressure, relative to its rms. With few directions a part of the fluid that hangs on the rest by a neck of
/// one node may be missed by all of the lines: it then has a constant of its own.
/// Throws std::invalid_argument when no node holds fluid or an option is out of range.
PressureSolution parallelLinePressure(const PressureProblem& problem, const ParallelLineOptions& options = {},
                                      const Progress& progress = {});

/// One of each pair of opposite directions of a geodesic icosphere with at least `directions` vertices (10
/// n^2 + 2 of them), tilted off the axes; unit vectors.
std::vector<std::array<double, 3>> icosphereDirections(int directions);

} // namespace rimflow
