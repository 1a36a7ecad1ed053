#include "PressureGradient.h"

#include <stdexcept>

namespace rimflow {
std::vector<float> pressureGradient(const Grid&, const float*, const float*, const unsigned char*, double,
                                    double) {
  throw std::logic_error("not written yet");
}
std::vector<float> pressureError(const Grid&, const float*, const float*, const unsigned char*) {
  throw std::logic_error("not written yet");
}
} // namespace rimflow
