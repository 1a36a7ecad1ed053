#pragma once
#include "TrackDerivatives.h"

#include <limits>

namespace rimflow {

/// Standard deviations per component of the noise of a measurement. NaN: cannot be told.
struct TrackNoise {
  double position = std::numeric_limits<double>::quiet_NaN();     ///< m
  double velocity = std::numeric_limits<double>::quiet_NaN();     ///< m/s
  double acceleration = std::numeric_limits<double>::quiet_NaN(); ///< m/s2
};

/// Snapshots that measureTrackNoise looks at: those of the window nearest to the current one.
inline constexpr std::size_t noiseSnapshots = 13;

/// The noise of positions, and of velocities and accelerations where the snapshots have them.
TrackNoise measureTrackNoise(const TrackWindow& window);

/// The same where velocity and acceleration come from estimateDerivatives with these options, which returned
/// this gain; what the snapshots have is not looked at.
TrackNoise measureTrackNoise(const TrackWindow& window, const TrackDerivativeOptions& derivatives,
                             const DerivativeGain& gain);

} // namespace rimflow
