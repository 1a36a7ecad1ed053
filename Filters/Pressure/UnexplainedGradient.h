#pragma once
#include "PressureProblem.h"

#include <vector>

namespace rimflow {

/// How far each node's gradient is from that of the pressure, per component, Pa/m: the rms of
/// (p_j - p_i - d_ij)/h over the links to its neighbours, with d_ij as PressureLinks integrates it. A
/// measured gradient with errors has a curl, which no pressure has. 0 where there is no fluid. order: 4 or 2.
std::vector<float> unexplainedGradient(const PressureProblem& problem, const float* pressure, int order);

} // namespace rimflow
