#pragma once
#include "Grid.h"
#include "Progress.h"

namespace rimflow {

/// What to compute from the velocity gradient; null pointers are left out.
struct QCriterionOutputs {
  float* q = nullptr;         ///< Q = (|Omega|^2 - |S|^2)/2, 1/s2, one per node
  float* vorticity = nullptr; ///< curl u, 1/s, three per node
  float* lambda2 = nullptr; ///< middle eigenvalue of S^2 + Omega^2, 1/s2, one per node (Jeong & Hussain 1995)
  float* divergence = nullptr; ///< div u, 1/s, one per node
};

/// Q-criterion and its kin on a regular grid ("Vortex Criterion", eqs. for Q, S and Omega of Jose et al.
/// 2025). velocity: three floats per node, m/s. mask: one byte per node, non-zero where there is no fluid, or
/// null. order: 2 or 4, the order of the central differences; one-sided (second order) at the faces of the
/// grid and at the mask, never across it; first order or zero where a single node has no room for more.
/// Masked nodes get 0. Returns false when aborted (outputs are then incomplete).
bool qCriterion(const Grid& grid, const float* velocity, const unsigned char* mask, int order,
                const QCriterionOutputs& out, const Progress& progress = {});

} // namespace rimflow
