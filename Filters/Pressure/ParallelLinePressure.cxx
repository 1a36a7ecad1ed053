#include "ParallelLinePressure.h"

#include <stdexcept>

namespace rimflow {
PressureSolution parallelLinePressure(const PressureProblem&, const ParallelLineOptions&, const Progress&) {
  throw std::logic_error("not written yet");
}
} // namespace rimflow
