#pragma once
#include "PressureProblem.h"
#include "Progress.h"

namespace rimflow {

struct OneShotOptions {
  int order = 4;               ///< of the integration from node to node: 4, or 2 (trapezoid)
  double tolerance = 1e-6;     ///< stop when the residual is this part of the right-hand side, > 0
  double wallWeight = 0.3;     ///< of nodes next to the mask, > 0 to 1: gradients are least certain there
  int maximumIterations = 500; ///< >= 1
};

/// The limit of omni-directional integration along infinitely many lines in one solve (Zigunov & Charonko
/// 2024, "One-shot omnidirectional pressure integration"): the pressure that minimises
///     sum over neighbouring fluid nodes of w_ij (p_j - p_i - d_ij)^2,
/// with d_ij the integral of the gradient from node to node and w_ij = t_i t_j/h^2 along the link's axis; t
/// is wallWeight at nodes next to the mask (by face, edge or corner) and 1 elsewhere, so that gradients which
/// a reconstruction gets wrong in the boundary layer do not spoil the pressure far from it. Conjugate
/// gradients, preconditioned with the solution for the whole box in cosines. double inside; the result does
/// not depend on the number of threads. Throws std::invalid_argument when no node holds fluid or an option is
/// out of range.
PressureSolution oneShotPressure(const PressureProblem& problem, const OneShotOptions& options = {},
                                 const Progress& progress = {});

} // namespace rimflow
