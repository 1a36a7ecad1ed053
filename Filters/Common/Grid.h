#pragma once
#include <array>
#include <cstddef>

namespace rimflow {

/// A regular Cartesian grid of nodes, x fastest (as in vtkImageData).
struct Grid {
  std::array<double, 3> origin{0, 0, 0};  ///< position of node (0, 0, 0), m
  std::array<double, 3> spacing{1, 1, 1}; ///< distance between nodes per axis, m, > 0
  std::array<int, 3> n{0, 0, 0};          ///< nodes per axis

  std::size_t size() const { return std::size_t(n[0]) * n[1] * n[2]; }
  std::size_t index(int i, int j, int k) const { return i + std::size_t(n[0]) * (j + std::size_t(n[1]) * k); }
  std::array<double, 3> position(int i, int j, int k) const {
    return {origin[0] + i * spacing[0], origin[1] + j * spacing[1], origin[2] + k * spacing[2]};
  }
};

} // namespace rimflow
