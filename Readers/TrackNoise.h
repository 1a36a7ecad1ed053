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

} // namespace rimflow
