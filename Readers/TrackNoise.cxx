#include "TrackNoise.h"

namespace rimflow {

TrackNoise measureTrackNoise(const TrackWindow&) { return {}; }

TrackNoise measureTrackNoise(const TrackWindow&, const TrackDerivativeOptions&) { return {}; }

} // namespace rimflow
