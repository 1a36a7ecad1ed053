#pragma once
#include "Grid.h"

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <vector>

namespace rimflow {

/// Trilinear or tricubic (4-point Lagrange per axis) sampling P of grid fields at points, and its transpose.
/// Points must lie within the grid (those on its faces included). Both are threaded; results do not depend on
/// the number of threads.
template <class Real>
class Sampler {
public:
  /// positions: x y z per point, m.
  /// points: 2 (trilinear) or 4 (tricubic) nodes per axis; an axis with fewer than 4 nodes takes 2.
  Sampler(const Grid& grid, const double* positions, std::size_t count, int points = 2);

  std::size_t size() const { return point_.size(); }
  /// values[p] = (P field)_p, in the order in which the points were given.
  void sample(const Real* field, Real* values) const { sampleAll<1>({field}, {values}); }
  /// field += P^T values
  void addTransposed(const Real* values, Real* field) const { addAllTransposed<1>({values}, {field}); }
  /// The same for the three components of a vector field at once, which is faster than one by one.
  using VectorField = std::array<std::vector<Real>, 3>;
  void sample(const VectorField& field, VectorField& values) const;
  void addTransposed(const VectorField& values, VectorField& field) const;

private:
  template <int Nodes>
  using Row = Eigen::Array<Real, Nodes, 1>; ///< along x
  template <int Fields>
  void sampleAll(const std::array<const Real*, Fields>& field, const std::array<Real*, Fields>& values) const;
  template <int Fields>
  void addAllTransposed(const std::array<const Real*, Fields>& values,
                        const std::array<Real*, Fields>& field) const;

  struct Point {
    std::size_t node;    ///< lowest node used
    std::uint32_t given; ///< place in the order in which the points were given
    Real weight[3][4];   ///< per axis, of the nodes used
  };
  int points_[3];
  Grid grid_;
  std::vector<Point> point_;            ///< sorted by lowest node
  std::vector<std::size_t> layerStart_; ///< first point of each layer of nodes along z
};

/// A field on another grid by the same 4-point interpolation per axis (outside of `from` the nearest value).
template <class Real>
std::vector<Real> resample(const Grid& from, const Real* field, const Grid& to);

extern template class Sampler<float>;
extern template class Sampler<double>;
extern template std::vector<float> resample<float>(const Grid&, const float*, const Grid&);
extern template std::vector<double> resample<double>(const Grid&, const double*, const Grid&);

} // namespace rimflow
