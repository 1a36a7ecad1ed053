#include "Interpolation.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <stdexcept>

namespace rimflow {
namespace {

/// The cell of coordinate x along one axis and the place in it; a point on the last node belongs to the last
/// cell.
struct Cell {
  int index;
  double t;
  Cell(const Grid& grid, int axis, double x) {
    const double s = (x - grid.origin[axis]) / grid.spacing[axis];
    index = std::clamp(int(std::floor(s)), 0, std::max(0, grid.n[axis] - 2));
    t = s - index;
  }
};

} // namespace

template <class Real>
TrilinearSampler<Real>::TrilinearSampler(const Grid& grid, const double* positions, std::size_t count)
    : grid_(grid), point_(count), layerStart_(std::size_t(std::max(1, grid.n[2])), 0) {
  constexpr double Tolerance = 1e-6; // of a cell: rounding of positions on a face
  for (std::size_t p = 0; p < count; ++p) {
    int cell[3];
    for (int a = 0; a < 3; ++a) {
      const Cell c(grid, a, positions[3 * p + a]);
      if (!(c.t >= -Tolerance && c.t <= 1 + Tolerance))
        throw std::invalid_argument("A particle lies outside of the grid.");
      cell[a] = c.index;
      point_[p].t[a] = Real(c.t);
    }
    point_[p].node = grid.index(cell[0], cell[1], cell[2]);
    point_[p].given = std::uint32_t(p);
  }
  std::stable_sort(point_.begin(), point_.end(),
                   [](const Point& a, const Point& b) { return a.node < b.node; });
  const std::size_t layer = std::size_t(grid.n[0]) * grid.n[1];
  for (std::size_t k = 0; k < layerStart_.size(); ++k)
    layerStart_[k] =
        std::size_t(std::lower_bound(point_.begin(), point_.end(), k * layer,
                                     [](const Point& a, std::size_t node) { return a.node < node; }) -
                    point_.begin());
}

template <class Real>
void TrilinearSampler<Real>::sample(const Real* field, Real* values) const {
  const std::ptrdiff_t sy = grid_.n[0], sz = std::ptrdiff_t(grid_.n[0]) * grid_.n[1];
#pragma omp parallel for schedule(static)
  for (std::size_t p = 0; p < point_.size(); ++p) {
    const Point& q = point_[p];
    const Real* f = field + q.node;
    const Real x = q.t[0], y = q.t[1], z = q.t[2];
    const auto alongX = [&](std::ptrdiff_t at) { return f[at] + x * (f[at + 1] - f[at]); };
    const auto alongY = [&](std::ptrdiff_t at) {
      const Real a = alongX(at);
      return a + y * (alongX(at + sy) - a);
    };
    const Real a = alongY(0);
    values[q.given] = a + z * (alongY(sz) - a);
  }
}

template <class Real>
void TrilinearSampler<Real>::addTransposed(const Real* values, Real* field) const {
  const std::ptrdiff_t sy = grid_.n[0], sz = std::ptrdiff_t(grid_.n[0]) * grid_.n[1];
  const int layers = int(layerStart_.size()) - 1;
  // A layer of cells writes to its two layers of nodes: the even layers of cells first, then the odd ones, so
  // that no two threads meet and every node sums in the same order.
  for (int parity = 0; parity < 2; ++parity) {
#pragma omp parallel for schedule(static)
    for (int k = parity; k < layers; k += 2)
      for (std::size_t p = layerStart_[k]; p < layerStart_[k + 1]; ++p) {
        const Point& q = point_[p];
        Real* f = field + q.node;
        const Real v = values[q.given], x = q.t[0], y = q.t[1], z = q.t[2];
        const auto alongX = [&](std::ptrdiff_t at, Real w) {
          f[at] += w * (1 - x);
          f[at + 1] += w * x;
        };
        alongX(0, v * (1 - y) * (1 - z));
        alongX(sy, v * y * (1 - z));
        alongX(sz, v * (1 - y) * z);
        alongX(sy + sz, v * y * z);
      }
  }
}

template <class Real>
double interpolate(const Grid& grid, const Real* field, const std::array<double, 3>& x, int components,
                   int component) {
  int cell[3];
  double t[3];
  for (int a = 0; a < 3; ++a) {
    const Cell c(grid, a, x[a]);
    cell[a] = c.index;
    t[a] = std::clamp(c.t, 0., 1.);
  }
  double sum = 0;
  for (int corner = 0; corner < 8; ++corner) {
    double w = 1;
    int at[3];
    for (int a = 0; a < 3; ++a) {
      const int up = corner >> a & 1;
      w *= up ? t[a] : 1 - t[a];
      at[a] = std::min(cell[a] + up, grid.n[a] - 1);
    }
    if (w > 0) sum += w * double(field[components * grid.index(at[0], at[1], at[2]) + component]);
  }
  return sum;
}

template <class Real>
std::vector<Real> resample(const Grid& from, const Real* field, const Grid& to) {
  // Separable: one axis after the other, each with its own cells.
  std::vector<Real> current(field, field + from.size());
  Grid grid = from;
  for (int axis = 0; axis < 3; ++axis) {
    Grid next = grid;
    next.n[axis] = to.n[axis];
    next.origin[axis] = to.origin[axis];
    next.spacing[axis] = to.spacing[axis];
    std::vector<Cell> cells;
    for (int i = 0; i < next.n[axis]; ++i) {
      cells.emplace_back(grid, axis, next.origin[axis] + i * next.spacing[axis]);
      cells.back().t = std::clamp(cells.back().t, 0., 1.);
    }
    const std::ptrdiff_t stride = axis == 0   ? 1
                                  : axis == 1 ? grid.n[0]
                                              : std::ptrdiff_t(grid.n[0]) * grid.n[1];
    const std::ptrdiff_t up = grid.n[axis] > 1 ? stride : 0;
    std::vector<Real> out(next.size());
#pragma omp parallel for schedule(static)
    for (int k = 0; k < next.n[2]; ++k)
      for (int j = 0; j < next.n[1]; ++j)
        for (int i = 0; i < next.n[0]; ++i) {
          int at[3] = {i, j, k};
          const Cell& c = cells[at[axis]];
          at[axis] = c.index;
          const Real* f = current.data() + grid.index(at[0], at[1], at[2]);
          out[next.index(i, j, k)] = Real(f[0] + c.t * (f[up] - f[0]));
        }
    current.swap(out);
    grid = next;
  }
  return current;
}

template class TrilinearSampler<float>;
template class TrilinearSampler<double>;
template double interpolate<float>(const Grid&, const float*, const std::array<double, 3>&, int, int);
template double interpolate<double>(const Grid&, const double*, const std::array<double, 3>&, int, int);
template std::vector<float> resample<float>(const Grid&, const float*, const Grid&);
template std::vector<double> resample<double>(const Grid&, const double*, const Grid&);

} // namespace rimflow
