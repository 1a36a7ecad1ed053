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

/// Snapshots that measureTrackNoise looks at before and after the current one, as far as there are any.
inline constexpr std::size_t noiseSnapshotsEachSide = 6;

/// The noise of positions, and of velocities and accelerations where the snapshots have them.
TrackNoise measureTrackNoise(const TrackWindow& window);

/// The same; velocity and acceleration are those of estimateDerivatives with these options, whatever the
/// snapshots have.
TrackNoise measureTrackNoise(const TrackWindow& window, const TrackDerivativeOptions& derivatives);

} // namespace rimflow
