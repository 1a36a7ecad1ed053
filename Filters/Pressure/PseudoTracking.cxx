#include "PseudoTracking.h"

#include <stdexcept>

namespace rimflow {
PseudoTrackingResult pseudoTracking(const VelocitySeries&) { throw std::logic_error("not written yet"); }
} // namespace rimflow
