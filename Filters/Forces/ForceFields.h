#pragma once
#include "Grid.h"

namespace rimflow {

/// The flow around the body on a grid; the pointers must outlive the call.
struct ForceFields {
  Grid grid;
  const float* velocity = nullptr;         ///< three per node, m/s
  const float* acceleration = nullptr;     ///< Du/Dt, three per node, m/s2
  const float* pressure = nullptr;         ///< dynamic, one per node, Pa
  const float* pressureGradient = nullptr; ///< three per node, Pa/m
  const float* pressureError = nullptr;    ///< standard deviation, one per node, Pa; or null
  const unsigned char* mask = nullptr;     ///< one per node, not 0: no fluid; or null
};

} // namespace rimflow
