#pragma once
#include "Grid.h"
#include "Progress.h"

#include <vector>

namespace rimflow {

/// Three snapshots of the velocity on one grid; three numbers per node, m/s. previous or next may be null at
/// the ends of a series (one-sided then).
struct VelocitySeries {
  Grid grid;
  const float *previous = nullptr, *present = nullptr, *next = nullptr;
  const unsigned char *previousMask = nullptr, *presentMask = nullptr, *nextMask = nullptr; ///< or null
  double timeBefore = 0, timeAfter = 0; ///< from previous to present and from present to next, s, > 0
};

struct PseudoTrackingResult {
  std::vector<float> acceleration; ///< Du/Dt, three per node, m/s2; 0 where it is not known
  std::vector<unsigned char>
      mask; ///< 1 where it is not known: no fluid, or the path leaves the fluid both ways
};

/// The material acceleration from how the velocity changes along the path of a fluid particle
/// (pseudo-tracking; Liu & Katz 2006, "Instantaneous pressure and material acceleration measurements").
/// Central over three snapshots, of second order in time; where the path leaves the grid or the fluid on one
/// side, and at the ends of a series, one-sided, of first order. Velocities between the nodes come from
/// tricubic interpolation; next to a mask its nodes are moved away from it, and none of the mask is used. An
/// interpolation error e of the velocity costs e/(time between snapshots): keep the path at about a spacing
/// or less, but no shorter than the noise of the velocity allows. Threaded; the result does not depend on the
/// number of threads. Throws std::invalid_argument when both neighbours are missing or a time is not greater
/// than 0. When progress aborts, the result is empty.
PseudoTrackingResult pseudoTracking(const VelocitySeries& series, const Progress& progress = {});

} // namespace rimflow
