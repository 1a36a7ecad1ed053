#pragma once
#include "Body.h"
#include "Grid.h"
#include "Progress.h"
#include "VICSharpModel.h"

#include <array>
#include <optional>
#include <string>
#include <vector>

namespace rimflow {

/// The particles of one snapshot. Rows with a position or velocity that is not finite are left out; so is an
/// acceleration.
struct VICSharpTracks {
  const float* positions = nullptr;     ///< x y z per particle, m
  const float* velocities = nullptr;    ///< three per particle, m/s
  const float* accelerations = nullptr; ///< material acceleration, three per particle, m/s2; or null
  std::size_t count = 0;
};

struct VICSharpOptions {
  Grid grid;                    ///< where the result is wanted; the same spacing along all axes
  double viscosity = 1.1e-6;    ///< nu, m2/s, >= 0
  double velocityNoise = 0;     ///< standard deviation per component, m/s; 0: estimated
  double accelerationNoise = 0; ///< standard deviation per component, m/s2; 0: estimated
  /// Of the noise as it was measured along the tracks, >= 0: estimates are not taken lower. They may be
  /// higher, by what the grid cannot resolve.
  double leastVelocityNoise = 0, leastAccelerationNoise = 0;
  int maximumIterations = 300; ///< on the finest grid, >= 1
  double tolerance = 0.002; ///< stop when an iteration gains less than this part of the noise variance, > 0
  double padding = 1;       ///< computed beyond the faces of the grid, in mean particle spacings, >= 0
  double accelerationWeight = 0; ///< alpha, >= 0; 0: from the noise levels and the friction
  double curvatureWeight = 0;    ///< bc, >= 0; 0: found with particles held out
  double heldOut = 0.1;          ///< part of the particles held out while bc is sought, 0 < and < 0.5
  double outliers = 5; ///< misses by more than so many standard deviations count linearly, >= 0; 0: never,
                       ///< and no particle is left out by the median test (MedianTest.h)
  std::optional<Body> body; ///< particles inside are dropped; nodes inside carry its motion
};

/// What the data say about themselves.
struct VICSharpCalibration {
  double curvatureWeight = 0;                          ///< bc, given or found
  double velocityNoise = 0, accelerationNoise = 0;     ///< per component, given or estimated: m/s, m/s2
  double velocityHeldOut = 0, accelerationHeldOut = 0; ///< rms misfit of particles held out: m/s, m/s2
};

struct VICSharpResult {
  bool aborted = false; ///< then nothing else counts
  Grid grid;
  std::vector<float> velocity, vorticity, acceleration; ///< three per node: m/s, 1/s, m/s2
  std::vector<float> pressure;                          ///< over density, mean 0: m2/s2
  std::vector<unsigned char> mask;                      ///< 1 inside the body; empty without one
  VICSharpCalibration calibration;
  int iterations = 0;                                ///< on the finest grid
  double velocityMisfit = 0, accelerationMisfit = 0; ///< rms per component over the noise
  /// 1 - mean square misfit of the velocities over their variance, over all particles used
  double explainedVariance = 0;
  double localNoise = 0;     ///< of the velocity, as neighbours tell it (MedianTest.h), m/s; 0: not known
  double divergenceNorm = 0; ///< rms of div u over rms of |grad u|
  std::size_t particlesUsed = 0;
  std::size_t outliers = 0;   ///< left out, because they do not belong among their neighbours
  double particleSpacing = 0; ///< r, m
  std::string stop;           ///< why the iteration ended
};

/// Finds bc, the weight of smoothness, and the noise levels where they are not given, on a part of the
/// volume: every n-th particle is held out, and of the bc tried (powers of two around a guess) the largest
/// one counts that predicts those about as well as the best. The noise is the geometric mean of the misfits
/// of particles used and held out (generalised cross-validation: with n data and f degrees of freedom these
/// are s^2 (1 - f/n) and s^2/(1 - f/n)). Empty when aborted. Throws as vicSharp.
std::optional<VICSharpCalibration> calibrateVICSharp(const VICSharpTracks& tracks,
                                                     const VICSharpOptions& options,
                                                     const Progress& progress = {});

/// The flow on a grid from particle tracks: the minimum of VICSharpModel's cost, on grids of about the mean
/// particle spacing r, r/2, ... down to the one asked for; the first starts from rest. Iterations go on until
/// they gain less than `tolerance` of the noise variance. The result depends on nothing but the arguments,
/// not even on the number of threads. calibration: that of another snapshot of the same experiment, or null
/// for one of its own; noise levels in the options go before it. Without accelerations, the acceleration is
/// that of the pressure for which the flow, seen from the body if there is one, is as steady as it can be.
/// Throws std::invalid_argument when there is too little to go on.
VICSharpResult vicSharp(const VICSharpTracks& tracks, const VICSharpOptions& options,
                        const VICSharpCalibration* calibration = nullptr, const Progress& progress = {});

} // namespace rimflow
