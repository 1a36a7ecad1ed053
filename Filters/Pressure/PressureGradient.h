#pragma once
#include "Grid.h"
#include "Progress.h"

#include <vector>

namespace rimflow {

/// The gradient of the dynamic pressure, -rho (Du/Dt - nu lap u), three per node, Pa/m; 0 where the mask is
/// not 0. velocity: three per node, m/s, or null for an inviscid fluid. acceleration: Du/Dt, m/s2. mask: one
/// per node or null. density: kg/m3. viscosity: kinematic, m2/s. Empty when progress aborts.
std::vector<float> pressureGradient(const Grid& grid, const float* velocity, const float* acceleration,
                                    const unsigned char* mask, double density, double viscosity,
                                    const Progress& progress = {});

} // namespace rimflow
