#pragma once
#include "VICSharp.h"

#include <cstddef>

namespace rimflow {

/// The data, the grid and the constants of one reconstruction.
struct VICSharpProblem {
  double spacing; ///< r
  int margin;     ///< nodes that the model's grid has beyond the output's
  Grid grid;
  VICSharpData data;
  std::size_t outliers;  ///< left out of the data
  double localNoise = 0; ///< of the velocity, as neighbours tell it (MedianTest.h), m/s; 0: not known
  VICSharpConstants constants;
  bool aborted = false; ///< then nothing else counts
};

/// Throws std::invalid_argument when there is too little to go on or an option is out of its range.
VICSharpProblem vicSharpProblem(const VICSharpTracks& tracks, const VICSharpOptions& options,
                                const Progress& progress = {});

/// Sets alpha: as the options give it, or from these noise levels, so that each kind of data counts by its
/// own noise, but within 0.1 to 0.5 (0.3 where a level is 0: not known). Unless given, at most sa/sf: where
/// friction on eddies of the size r is many times the acceleration (a sphere seven r wide at Re below about
/// 10), the model's acceleration is the small difference of two large terms, and what it says beyond that is
/// neither true nor to be found in any number of iterations.
void weighAccelerations(const VICSharpOptions& options, double velocityNoise, double accelerationNoise,
                        VICSharpConstants& constants);

/// A grid over the same box (or a little more) with spacings `factor` times larger; along an axis that would
/// have fewer than five nodes, as it is.
Grid coarseGrid(const Grid& fine, double factor);

/// calibrateVICSharp of a problem that is already laid out.
std::optional<VICSharpCalibration>
calibrateVICSharp(const VICSharpProblem& problem, const VICSharpOptions& options, const Progress& progress);

/// Whether a point lies on the grid or within it.
bool within(const Grid& grid, const double* x);

} // namespace rimflow
