#include "Interpolation.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <stdexcept>
#include <type_traits>

namespace rimflow {
namespace {

/// Where a coordinate lies along one axis, and the nodes and weights that interpolate there.
struct Place {
  int first = 0; ///< lowest node used
  double weight[4] = {1, 0, 0, 0};
  double beyond; ///< how far outside of the grid, in cells; <= 0 inside

  Place(const Grid& grid, int axis, double x, int points) {
    const int n = grid.n[axis];
    const double s = (x - grid.origin[axis]) / grid.spacing[axis];
    beyond = std::max(-s, s - (n - 1));
    if (n == 1) return;
    const int cell = std::clamp(int(std::floor(s)), 0, n - 2); // a point on the last node: the last cell
    if (points == 2) {
      first = cell;
      weight[0] = 1 - (s - cell), weight[1] = s - cell;
      return;
    }
    first = std::clamp(cell - 1, 0, n - 4);
    const double t = s - first; // Lagrange's weights at 0, 1, 2, 3
    weight[0] = -(t - 1) * (t - 2) * (t - 3) / 6, weight[1] = t * (t - 2) * (t - 3) / 2;
    weight[2] = -t * (t - 1) * (t - 3) / 2, weight[3] = t * (t - 1) * (t - 2) / 6;
  }
};

int pointsAlong(const Grid& grid, int axis, int wanted) {
  return grid.n[axis] < 2 ? 1 : wanted == 4 && grid.n[axis] >= 4 ? 4 : 2;
}

} // namespace

template <class Real>
Sampler<Real>::Sampler(const Grid& grid, const double* positions, std::size_t count, int points)
    : grid_(grid), point_(count), layerStart_(std::size_t(grid.n[2]) + 1, 0) {
  constexpr double Tolerance = 1e-6; // cells: rounding of positions on a face
  for (int a = 0; a < 3; ++a) points_[a] = pointsAlong(grid, a, points);
  for (std::size_t p = 0; p < count; ++p) {
    int first[3];
    for (int a = 0; a < 3; ++a) {
      const Place place(grid, a, positions[3 * p + a], points_[a]);
      if (!(place.beyond <= Tolerance)) throw std::invalid_argument("A particle lies outside of the grid.");
      first[a] = place.first;
      for (int t = 0; t < 4; ++t) point_[p].weight[a][t] = Real(place.weight[t]);
    }
    point_[p].node = grid.index(first[0], first[1], first[2]);
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

// f(x, y, z) with the nodes per axis as constants: the inner loops become a few vector instructions.
namespace {
template <class F>
void withConstants(const int (&points)[3], F&& f) {
  const auto choose = [](int n, auto&& g) {
    if (n == 4) return g(std::integral_constant<int, 4>());
    if (n == 2) return g(std::integral_constant<int, 2>());
    g(std::integral_constant<int, 1>());
  };
  choose(points[0],
         [&](auto x) { choose(points[1], [&](auto y) { choose(points[2], [&](auto z) { f(x, y, z); }); }); });
}

// f(p) for every p from first to last, each far from the one before: sums that are read while they are still
// on their way to the cache make the processor wait.
template <class F>
void forEachSpread(std::size_t first, std::size_t last, F&& f) {
  constexpr std::size_t Streams = 4;
  const std::size_t length = (last - first + Streams - 1) / Streams;
  for (std::size_t i = first; i < first + length; ++i)
    for (std::size_t p = i; p < last; p += length) f(p);
}
} // namespace

template <class Real>
template <int Fields>
void Sampler<Real>::sampleAll(const std::array<const Real*, Fields>& field,
                              const std::array<Real*, Fields>& values) const {
  const std::ptrdiff_t sy = grid_.n[0], sz = std::ptrdiff_t(grid_.n[0]) * grid_.n[1];
  withConstants(points_, [&](auto x, auto y, auto z) {
    constexpr int nx = decltype(x)::value, ny = decltype(y)::value, nz = decltype(z)::value;
#pragma omp parallel for schedule(static)
    for (std::size_t p = 0; p < point_.size(); ++p) {
      const Point& q = point_[p];
      std::array<Row<nx>, Fields> row;
      row.fill(Row<nx>::Zero());
      for (int k = 0; k < nz; ++k)
        for (int j = 0; j < ny; ++j) {
          const std::size_t node = q.node + j * sy + k * sz;
          const Real w = q.weight[1][j] * q.weight[2][k];
          for (int c = 0; c < Fields; ++c) row[c] += w * Eigen::Map<const Row<nx>>(field[c] + node);
        }
      for (int c = 0; c < Fields; ++c)
        values[c][q.given] = (row[c] * Eigen::Map<const Row<nx>>(q.weight[0])).sum();
    }
  });
}

template <class Real>
template <int Fields>
void Sampler<Real>::addAllTransposed(const std::array<const Real*, Fields>& values,
                                     const std::array<Real*, Fields>& field) const {
  const std::ptrdiff_t sy = grid_.n[0], sz = std::ptrdiff_t(grid_.n[0]) * grid_.n[1];
  const int layers = grid_.n[2];
  // Points whose lowest node is in layer k write to the layers k to k + nz - 1. Every nz-th layer at once, so
  // that no two threads meet and every node sums in the same order.
  withConstants(points_, [&](auto x, auto y, auto z) {
    constexpr int nx = decltype(x)::value, ny = decltype(y)::value, nz = decltype(z)::value;
    // Apart from the parallel loop: Clang 14 takes no captures of the outer lambda into it.
    const auto addLayer = [&](int layer) {
      forEachSpread(layerStart_[layer], layerStart_[layer + 1], [&](std::size_t p) {
        const Point& q = point_[p];
        std::array<Row<nx>, Fields> row;
        for (int c = 0; c < Fields; ++c) row[c] = values[c][q.given] * Eigen::Map<const Row<nx>>(q.weight[0]);
        for (int k = 0; k < nz; ++k)
          for (int j = 0; j < ny; ++j) {
            const std::size_t node = q.node + j * sy + k * sz;
            const Real w = q.weight[1][j] * q.weight[2][k];
            for (int c = 0; c < Fields; ++c) Eigen::Map<Row<nx>>(field[c] + node) += w * row[c];
          }
      });
    };
    for (int phase = 0; phase < nz; ++phase) {
#pragma omp parallel for schedule(static)
      for (int layer = phase; layer < layers; layer += nz) addLayer(layer);
    }
  });
}

template <class Real>
void Sampler<Real>::sample(const VectorField& field, VectorField& values) const {
  sampleAll<3>({field[0].data(), field[1].data(), field[2].data()},
               {values[0].data(), values[1].data(), values[2].data()});
}

template <class Real>
void Sampler<Real>::addTransposed(const VectorField& values, VectorField& field) const {
  addAllTransposed<3>({values[0].data(), values[1].data(), values[2].data()},
                      {field[0].data(), field[1].data(), field[2].data()});
}

template <class Real>
std::vector<Real> resample(const Grid& from, const Real* field, const Grid& to) {
  // One axis after the other, each with its own weights.
  std::vector<Real> current(field, field + from.size());
  Grid grid = from;
  for (int axis = 0; axis < 3; ++axis) {
    Grid next = grid;
    next.n[axis] = to.n[axis];
    next.origin[axis] = to.origin[axis];
    next.spacing[axis] = to.spacing[axis];
    const int points = pointsAlong(grid, axis, 4);
    const double low = grid.origin[axis], high = low + (grid.n[axis] - 1) * grid.spacing[axis];
    std::vector<Place> places;
    for (int i = 0; i < next.n[axis]; ++i)
      places.emplace_back(grid, axis, std::clamp(next.origin[axis] + i * next.spacing[axis], low, high),
                          points);
    const std::size_t stride = axis == 0 ? 1 : axis == 1 ? grid.n[0] : std::size_t(grid.n[0]) * grid.n[1];
    std::vector<Real> out(next.size());
#pragma omp parallel for schedule(static)
    for (int k = 0; k < next.n[2]; ++k)
      for (int j = 0; j < next.n[1]; ++j)
        for (int i = 0; i < next.n[0]; ++i) {
          int at[3] = {i, j, k};
          const Place& place = places[at[axis]];
          at[axis] = place.first;
          const Real* f = current.data() + grid.index(at[0], at[1], at[2]);
          double sum = 0;
          for (int t = 0; t < points; ++t) sum += place.weight[t] * double(f[t * stride]);
          out[next.index(i, j, k)] = Real(sum);
        }
    current.swap(out);
    grid = next;
  }
  return current;
}

template class Sampler<float>;
template class Sampler<double>;
template void Sampler<float>::sampleAll<1>(const std::array<const float*, 1>&,
                                           const std::array<float*, 1>&) const;
template void Sampler<double>::sampleAll<1>(const std::array<const double*, 1>&,
                                            const std::array<double*, 1>&) const;
template void Sampler<float>::addAllTransposed<1>(const std::array<const float*, 1>&,
                                                  const std::array<float*, 1>&) const;
template void Sampler<double>::addAllTransposed<1>(const std::array<const double*, 1>&,
                                                   const std::array<double*, 1>&) const;
template std::vector<float> resample<float>(const Grid&, const float*, const Grid&);
template std::vector<double> resample<double>(const Grid&, const double*, const Grid&);

} // namespace rimflow
