#pragma once
#include "Body.h"
#include "Grid.h"
#include "Progress.h"

#include <array>
#include <memory>
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
  double velocityNoise = 0;     ///< standard deviation per component, m/s; 0: unknown
  double accelerationNoise = 0; ///< standard deviation per component, m/s2; 0: unknown
  int maximumIterations = 100;  ///< on the finest grid, >= 1
  double accelerationWeight =
      0.3; ///< alpha: of the acceleration misfit over the velocity misfit, both over their rms
  double divergenceWeight = 0.1;   ///< bu = bw = bd
  double navierStokesWeight = 0.1; ///< bn
  double padding = 0.5;            ///< computed beyond the faces of the grid, in mean particle spacings, >= 0
  std::optional<Body> body;        ///< particles inside are dropped; nodes inside carry its motion
};

struct VICSharpResult {
  bool aborted = false; ///< then nothing else counts
  Grid grid;
  std::vector<float> velocity, vorticity, acceleration; ///< three per node: m/s, 1/s, m/s2
  std::vector<unsigned char> mask;                      ///< 1 inside the body; empty without one
  int iterations = 0;                                   ///< on all grids
  double velocityMisfit = 0, accelerationMisfit = 0;    ///< rms per component over the noise
  double divergenceNorm = 0;                            ///< rms of div u over rms of |grad u|
  double velocityNoise = 0, accelerationNoise = 0;      ///< given, or the misfit at the particles held out
  std::size_t particlesUsed = 0;
  std::string stop;                 ///< why the iteration ended
  std::shared_ptr<const void> warm; ///< a start for the next snapshot
};

/// The flow on a grid from particle tracks (see VICSharpModel.h for the cost function), coarse to fine: on
/// grids of about the mean particle spacing r, r/2, ... down to the one asked for, starting from zero, or
/// from `warm` on the finest alone.
///
/// With noisy data the error falls with the iterations and then rises again, as the fit begins to follow the
/// noise. So the iteration stops when the misfit has come down to the noise, where that is given. Where it is
/// not, every 20th particle is held out, and the iterate that fits those best is taken: the misfit at
/// particles that the fit has not seen falls and rises with the error. maximumIterations only bounds the
/// time.
///
/// Particles whose velocity or acceleration misfits on the next coarser grid by more than four robust
/// standard deviations count less (ghost tracks). Without accelerations, the acceleration is that of the
/// vorticity equation with du/dt = 0 on the faces. Throws std::invalid_argument when there is too little to
/// go on.
VICSharpResult vicSharp(const VICSharpTracks& tracks, const VICSharpOptions& options,
                        const std::shared_ptr<const void>& warm = {}, const Progress& progress = {});

} // namespace rimflow
