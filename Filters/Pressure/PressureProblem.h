#pragma once
#include "Grid.h"

#include <vector>

namespace rimflow {

/// What the pressure is integrated from. The pointers must outlive the call; every gradient at a node that
/// holds fluid must be finite.
struct PressureProblem {
  Grid grid;
  const float* gradient = nullptr; ///< of the pressure, three per node, Pa/m
  const unsigned char* mask =
      nullptr; ///< one per node, not 0: no fluid or no data there; null: fluid everywhere

  bool isFluid(std::size_t node) const { return !mask || !mask[node]; }
};

struct PressureSolution {
  bool aborted = false;        ///< then nothing else counts
  std::vector<float> pressure; ///< one per node, Pa; mean 0 over each region; 0 where there is no fluid
  std::vector<int> region; ///< one per node: which connected part of the fluid, the largest is 0; -1: none
  int regions = 0;         ///< connected parts of the fluid (over faces)
  int iterations = 0;
  double residual = 0; ///< what is left of the equation at the end, relative to its right-hand side
};

} // namespace rimflow
