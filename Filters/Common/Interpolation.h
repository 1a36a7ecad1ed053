#pragma once
#include "Grid.h"

#include <cstdint>
#include <vector>

namespace rimflow {

/// Trilinear sampling P of grid fields at points, and its transpose. Points must lie within the grid (those
/// on its faces included). Both are threaded; results do not depend on the number of threads.
template <class Real>
class TrilinearSampler {
public:
  /// positions: x y z per point, m.
  TrilinearSampler(const Grid& grid, const double* positions, std::size_t count);

  std::size_t size() const { return point_.size(); }
  /// values[p] = (P field)_p, in the order in which the points were given.
  void sample(const Real* field, Real* values) const;
  /// field += P^T values
  void addTransposed(const Real* values, Real* field) const;

private:
  struct Point {
    std::size_t node;    ///< lowest corner of the cell
    std::uint32_t given; ///< place in the order in which the points were given
    Real t[3];           ///< place within the cell, 0 to 1
  };
  Grid grid_;
  std::vector<Point> point_;            ///< sorted by cell
  std::vector<std::size_t> layerStart_; ///< first point of each layer of cells along z
};

extern template class TrilinearSampler<float>;
extern template class TrilinearSampler<double>;

/// The value of a field (component `component` of `components` per node) at x by trilinear interpolation; x
/// is moved to the nearest point of the grid first.
template <class Real>
double interpolate(const Grid& grid, const Real* field, const std::array<double, 3>& x, int components = 1,
                   int component = 0);

/// A field on another grid by trilinear interpolation (the nearest value outside of `from`).
template <class Real>
std::vector<Real> resample(const Grid& from, const Real* field, const Grid& to);

extern template double interpolate<float>(const Grid&, const float*, const std::array<double, 3>&, int, int);
extern template double interpolate<double>(const Grid&, const double*, const std::array<double, 3>&, int,
                                           int);
extern template std::vector<float> resample<float>(const Grid&, const float*, const Grid&);
extern template std::vector<double> resample<double>(const Grid&, const double*, const Grid&);

} // namespace rimflow
