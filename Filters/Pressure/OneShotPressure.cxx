#include "OneShotPressure.h"

#include <stdexcept>

namespace rimflow {
PressureSolution oneShotPressure(const PressureProblem&, const OneShotOptions&, const Progress&) {
  throw std::logic_error("not written yet");
}
} // namespace rimflow
