#pragma once
#include "PressureProblem.h"
#include "Progress.h"

#include <vector>

namespace rimflow {

// What a pressure does not explain of its gradient: a conservative gradient has no curl, a measured one has.

/// How far each node's gradient is from that of the pressure, per component, Pa/m: the rms of
/// (p_j - p_i - d_ij)/h over the links to its neighbours, with d_ij as PressureLinks integrates it. 0 where
/// there is no fluid. order: 4 or 2.
std::vector<float> unexplainedGradient(const PressureProblem& problem, const float* pressure, int order);

/// Standard deviation of the integrated pressure, one per node, Pa, as far as its gradient's curl tells. 0
/// where there is no fluid. The formula stands at the implementation. Empty when progress aborts.
std::vector<float> pressureError(const PressureProblem& problem, const float* pressure,
                                 const Progress& progress = {});

} // namespace rimflow
