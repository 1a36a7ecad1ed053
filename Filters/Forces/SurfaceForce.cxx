#include "SurfaceForce.h"

#include <stdexcept>

namespace rimflow {
ForceResult surfaceForce(const ForceFields&, const Body&, const ForceOptions&) {
  throw std::logic_error("not written yet");
}
} // namespace rimflow
