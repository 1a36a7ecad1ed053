#pragma once
#include "Grid.h"

#include <array>
#include <cstddef>
#include <vector>

namespace rimflow {

/// One 1-D operator at one node: the sum over t < count of weight[t] f[index[t]].
template <class Real>
struct Taps {
  int count = 0;
  std::array<int, 8> index{};
  std::array<Real, 8> weight{};

  void add(int i, Real w) {
    for (int t = 0; t < count; ++t)
      if (index[t] == i) {
        weight[t] += w;
        return;
      }
    index[count] = i;
    weight[count++] = w;
  }
};

/// Finite differences on a regular grid, one row of nodes along x at a time, so that formulas of several
/// derivatives can be written in one pass with every intermediate in the first-level cache. Each operator has
/// its exact transpose beside it. Fields are one number per node, x fastest; rows out have grid.n[0] numbers.
///   D_j  central difference of order 2 or 4; on the two faces of its axis one-sided of order 2, next to them
///        central of order 2 (one-sided differences of order 4 made the reconstruction three times worse
///        there)
///   L    7-point Laplacian, 0 on the boundary nodes
template <class Real>
class Stencils {
public:
  /// order: 2 or 4, of D; an axis with fewer than 5 nodes has order 2.
  explicit Stencils(const Grid& grid, int order = 2) : grid_(grid) {
    for (int axis = 0; axis < 3; ++axis) {
      const int n = grid.n[axis];
      auto& d = difference_[axis];
      d.resize(n);
      for (int i = 0; i < n; ++i) d[i] = firstDerivative(i, n, n < 5 ? 2 : order, grid.spacing[axis]);
      transposed_[axis].resize(n);
      for (int i = 0; i < n; ++i)
        for (int t = 0; t < d[i].count; ++t) transposed_[axis][d[i].index[t]].add(i, d[i].weight[t]);
      inverseSquare_[axis] = Real(1 / (grid.spacing[axis] * grid.spacing[axis]));
    }
  }
  const Grid& grid() const { return grid_; }
  /// The 1-D operator D along an axis.
  const std::vector<Taps<Real>>& difference(int axis) const { return difference_[axis]; }
  /// 1/h^2 of an axis.
  Real inverseSquare(int axis) const { return inverseSquare_[axis]; }

  bool isInterior(int j, int k) const { return j > 0 && j + 1 < grid_.n[1] && k > 0 && k + 1 < grid_.n[2]; }

  /// out = D_axis f on the row (j, k)
  void derivative(const Real* f, int axis, int j, int k, Real* out) const {
    apply<false>(difference_[axis], f, axis, j, k, Real(1), out);
  }
  /// out += scale D_axis f
  void addDerivative(const Real* f, int axis, int j, int k, Real scale, Real* out) const {
    apply<true>(difference_[axis], f, axis, j, k, scale, out);
  }
  /// out += scale D_axis^T f
  void addDerivativeTransposed(const Real* f, int axis, int j, int k, Real scale, Real* out) const {
    apply<true>(transposed_[axis], f, axis, j, k, scale, out);
  }

  /// out += scale L f
  void addLaplacian(const Real* f, int j, int k, Real scale, Real* out) const {
    if (!isInterior(j, k)) return;
    const int n = grid_.n[0];
    const std::ptrdiff_t sy = n, sz = std::ptrdiff_t(n) * grid_.n[1];
    const Real cx = scale * inverseSquare_[0], cy = scale * inverseSquare_[1], cz = scale * inverseSquare_[2];
    const Real* r = f + grid_.index(0, j, k);
#pragma omp simd
    for (int i = 1; i < n - 1; ++i)
      out[i] += cx * (r[i - 1] + r[i + 1] - 2 * r[i]) + cy * (r[i - sy] + r[i + sy] - 2 * r[i]) +
                cz * (r[i - sz] + r[i + sz] - 2 * r[i]);
  }

  /// out += scale L^T f: what the interior nodes of f hand to this row
  void addLaplacianTransposed(const Real* f, int j, int k, Real scale, Real* out) const {
    const int n = grid_.n[0];
    const Real cx = scale * inverseSquare_[0], cy = scale * inverseSquare_[1], cz = scale * inverseSquare_[2];
    const auto add = [&](int jj, int kk, Real c) {
      if (!isInterior(jj, kk)) return;
      const Real* r = f + grid_.index(0, jj, kk);
#pragma omp simd
      for (int i = 1; i < n - 1; ++i) out[i] += c * r[i];
    };
    add(j, k, -2 * (cx + cy + cz));
    add(j - 1, k, cy), add(j + 1, k, cy), add(j, k - 1, cz), add(j, k + 1, cz);
    if (!isInterior(j, k)) return;
    const Real* r = f + grid_.index(0, j, k);
#pragma omp simd
    for (int i = 1; i < n - 1; ++i) out[i - 1] += cx * r[i];
#pragma omp simd
    for (int i = 1; i < n - 1; ++i) out[i + 1] += cx * r[i];
  }

private:
  static Taps<Real> firstDerivative(int i, int n, int order, double spacing) {
    using Weights = std::vector<double>;
    const auto taps = [&](int first, int direction, const Weights& weights, double divisor) {
      Taps<Real> out;
      for (std::size_t t = 0; t < weights.size(); ++t)
        if (weights[t] != 0) out.add(first + direction * int(t), Real(weights[t] / (divisor * spacing)));
      return out;
    };
    if (i == 0) return taps(0, 1, {-3, 4, -1}, 2);
    if (i == n - 1) return taps(n - 1, -1, {3, -4, 1}, 2);
    if (order == 2 || i == 1 || i == n - 2) return taps(i - 1, 1, {-1, 0, 1}, 2);
    return taps(i - 2, 1, {1, -8, 0, 8, -1}, 12);
  }

  template <bool Accumulate>
  void apply(const std::vector<Taps<Real>>& op, const Real* f, int axis, int j, int k, Real scale,
             Real* out) const {
    const int n = grid_.n[0];
    if (axis == 0) {
      const Real* r = f + grid_.index(0, j, k);
      alongX<Accumulate>(op, r, scale, n, out);
      return;
    }
    const Taps<Real>& taps = op[axis == 1 ? j : k];
    const auto row = [&](int t) {
      return f + (axis == 1 ? grid_.index(0, taps.index[t], k) : grid_.index(0, j, taps.index[t]));
    };
    if (taps.count == 2) {
      const Real *a = row(0), *b = row(1);
      const Real wa = scale * taps.weight[0], wb = scale * taps.weight[1];
#pragma omp simd
      for (int i = 0; i < n; ++i) out[i] = (Accumulate ? out[i] : Real(0)) + wa * a[i] + wb * b[i];
      return;
    }
    if (taps.count == 4) {
      const Real *a = row(0), *b = row(1), *c = row(2), *d = row(3);
      const Real wa = scale * taps.weight[0], wb = scale * taps.weight[1], wc = scale * taps.weight[2],
                 wd = scale * taps.weight[3];
#pragma omp simd
      for (int i = 0; i < n; ++i)
        out[i] = (Accumulate ? out[i] : Real(0)) + wa * a[i] + wb * b[i] + wc * c[i] + wd * d[i];
      return;
    }
    if (!Accumulate)
      for (int i = 0; i < n; ++i) out[i] = 0;
    for (int t = 0; t < taps.count; ++t) {
      const Real* a = row(t);
      const Real w = scale * taps.weight[t];
#pragma omp simd
      for (int i = 0; i < n; ++i) out[i] += w * a[i];
    }
  }

public:
  /// The 1-D operator of axis x on one row: out (+)= scale op r.
  template <bool Accumulate>
  static void alongX(const std::vector<Taps<Real>>& op, const Real* r, Real scale, int n, Real* out) {
    const auto byTaps = [&](int i) {
      Real sum = 0;
      for (int t = 0; t < op[i].count; ++t) sum += op[i].weight[t] * r[op[i].index[t]];
      out[i] = (Accumulate ? out[i] : Real(0)) + scale * sum;
    };
    constexpr int End = 6; // nodes per end whose taps may differ from the interior's
    if (n <= 2 * End) {
      for (int i = 0; i < n; ++i) byTaps(i);
      return;
    }
    for (int i = 0; i < End; ++i) byTaps(i), byTaps(n - 1 - i);
    const Taps<Real>& inner = op[End];
    Real w[4] = {};
    const Real* a[4] = {r, r, r, r};
    for (int t = 0; t < inner.count; ++t) w[t] = scale * inner.weight[t], a[t] = r + (inner.index[t] - End);
    if (inner.count == 2) {
#pragma omp simd
      for (int i = End; i < n - End; ++i)
        out[i] = (Accumulate ? out[i] : Real(0)) + w[0] * a[0][i] + w[1] * a[1][i];
      return;
    }
#pragma omp simd
    for (int i = End; i < n - End; ++i)
      out[i] =
          (Accumulate ? out[i] : Real(0)) + w[0] * a[0][i] + w[1] * a[1][i] + w[2] * a[2][i] + w[3] * a[3][i];
  }

private:
  Grid grid_;
  std::array<std::vector<Taps<Real>>, 3> difference_, transposed_;
  std::array<Real, 3> inverseSquare_;
};

/// Calls f(j, k, rows) for every row of nodes, in parallel. rows(b) is the b-th of `buffers` private rows.
template <class Real>
class RowBuffers {
public:
  RowBuffers(int n, int buffers) : stride_((n + 31) / 32 * 32), data_(std::size_t(stride_) * buffers) {}
  Real* operator()(int b) { return data_.data() + std::size_t(stride_) * b; }

private:
  int stride_;
  std::vector<Real> data_;
};

template <class Real, class F>
void forEachRow(const Grid& grid, int buffers, F&& f) {
#pragma omp parallel
  {
    RowBuffers<Real> rows(grid.n[0], buffers);
#pragma omp for schedule(static)
    for (int k = 0; k < grid.n[2]; ++k)
      for (int j = 0; j < grid.n[1]; ++j) f(j, k, rows);
  }
}

/// As forEachRow, with f returning M numbers that are summed; the order of summation does not depend on the
/// number of threads.
template <class Real, int M, class F>
std::array<double, M> sumOverRows(const Grid& grid, int buffers, F&& f) {
  std::vector<std::array<double, M>> perLayer(grid.n[2]);
#pragma omp parallel
  {
    RowBuffers<Real> rows(grid.n[0], buffers);
#pragma omp for schedule(static)
    for (int k = 0; k < grid.n[2]; ++k) {
      std::array<double, M> sum{};
      for (int j = 0; j < grid.n[1]; ++j) {
        const std::array<double, M> row = f(j, k, rows);
        for (int m = 0; m < M; ++m) sum[m] += row[m];
      }
      perLayer[k] = sum;
    }
  }
  std::array<double, M> total{};
  for (const auto& layer : perLayer)
    for (int m = 0; m < M; ++m) total[m] += layer[m];
  return total;
}

/// The nodes on the faces of the box, in storage order, each with the one interior node that feels it through
/// the Laplacian (none for edges and corners).
struct BoundaryNodes {
  std::vector<std::size_t> node;      ///< indices of the boundary nodes
  std::vector<std::ptrdiff_t> inside; ///< the interior neighbour of each, or -1
  std::vector<double> weight;         ///< 1/h^2 across the face

  explicit BoundaryNodes(const Grid& grid) {
    for (int k = 0; k < grid.n[2]; ++k)
      for (int j = 0; j < grid.n[1]; ++j)
        for (int i = 0; i < grid.n[0]; ++i) {
          int step[3] = {}, faces = 0, axis = 0;
          const int at[3] = {i, j, k};
          for (int a = 0; a < 3; ++a) {
            if (at[a] != 0 && at[a] != grid.n[a] - 1) continue;
            ++faces;
            axis = a;
            step[a] = at[a] == 0 ? 1 : -1;
          }
          if (faces == 0) continue;
          node.push_back(grid.index(i, j, k));
          inside.push_back(faces == 1 ? std::ptrdiff_t(grid.index(i + step[0], j + step[1], k + step[2]))
                                      : -1);
          weight.push_back(1 / (grid.spacing[axis] * grid.spacing[axis]));
        }
  }
  std::size_t size() const { return node.size(); }
};

} // namespace rimflow
