#include "QCriterionKernel.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <array>
#include <atomic>
#include <omp.h>
#include <vector>

// Memory bandwidth is the limit, so each node's velocity is read about once: rows are split by component into
// a cache that stays in the processor, and everything else works on those. Almost all rows need one stencil
// for all their nodes; only where a mask is near does each node get its own.

namespace rimflow {
namespace {

constexpr int Reach = 2; // nodes to either side that a stencil may use

/// The velocity of one grid row, split by component and padded by Reach; masked and outside nodes are 0.
struct Row {
  std::vector<float> component[3];
  std::vector<unsigned char> valid;
  bool allValid = false; // but for the padding

  explicit Row(int n) : valid(n + 2 * Reach, 0) {
    for (auto& c : component) c.assign(n + 2 * Reach, 0.f);
  }

  void load(const Grid& grid, const float* velocity, const unsigned char* mask, int j, int k) {
    const int n = grid.n[0];
    const std::size_t first = grid.index(0, j, k);
    const float* from = velocity + 3 * first;
    float *u = component[0].data() + Reach, *v = component[1].data() + Reach,
          *w = component[2].data() + Reach;
#pragma omp simd
    for (int i = 0; i < n; ++i) {
      u[i] = from[3 * i];
      v[i] = from[3 * i + 1];
      w[i] = from[3 * i + 2];
    }
    const unsigned char* masked = mask ? mask + first : nullptr;
    unsigned char any = 0;
    if (masked)
      for (int i = 0; i < n; ++i) any |= masked[i];
    allValid = any == 0;
    std::fill_n(valid.begin() + Reach, n, 1);
    if (allValid) return;
    for (int i = 0; i < n; ++i)
      if (masked[i]) {
        valid[Reach + i] = 0;
        u[i] = v[i] = w[i] = 0; // it may hold NaN, and 0 x NaN is NaN
      }
  }
};

/// The rows around those at work (firstRow to firstRow + height - 1 of a few slices), each loaded when it is
/// first asked for.
class RowCache {
public:
  RowCache(const Grid& grid, const float* velocity, const unsigned char* mask, int height)
      : grid_(grid), velocity_(velocity), mask_(mask), height_(height), nothing_(grid.n[0]),
        rows_(Slices * (height + 2 * Reach), nothing_), slice_(rows_.size(), -1) {}

  void startAt(int firstRow) {
    firstRow_ = firstRow;
    std::fill(slice_.begin(), slice_.end(), -1);
  }

  bool exists(int j, int k) const { return j >= 0 && j < grid_.n[1] && k >= 0 && k < grid_.n[2]; }

  /// Row j of slice k; outside the grid, one without valid nodes.
  const Row& operator()(int j, int k) {
    if (!exists(j, k)) return nothing_;
    const std::size_t place = k % Slices * (height_ + 2 * Reach) + (j - firstRow_ + Reach);
    if (slice_[place] != k) {
      rows_[place].load(grid_, velocity_, mask_, j, k);
      slice_[place] = k;
    }
    return rows_[place];
  }

  static constexpr int Slices = 2 * Reach + 1;

private:
  const Grid& grid_;
  const float* velocity_;
  const unsigned char* mask_;
  int height_, firstRow_ = 0;
  Row nothing_;
  std::vector<Row> rows_;
  std::vector<int> slice_; // that each place holds, -1: none
};

using Stencil = std::array<float, 2 * Reach + 1>; // weights of the nodes at -2..2 for d/dx at unit spacing

/// The best stencil that the valid nodes at -2, -1, 1 and 2 allow.
Stencil stencil(bool m2, bool m1, bool p1, bool p2, int order) {
  if (order == 4 && m2 && m1 && p1 && p2) return {1 / 12.f, -8 / 12.f, 0, 8 / 12.f, -1 / 12.f};
  if (m1 && p1) return {0, -.5f, 0, .5f, 0};
  if (p1 && p2) return {0, 0, -1.5f, 2, -.5f};
  if (m1 && m2) return {.5f, -2, 1.5f, 0, 0};
  if (p1) return {0, 0, -1, 1, 0};
  if (m1) return {0, -1, 1, 0, 0};
  return {};
}

/// What a stencil is applied to: the rows (or the row, shifted) at -2..2.
template <class T>
using Neighbours = std::array<const T*, 2 * Reach + 1>;

/// What is differentiated, and where the result goes: three components.
using Sources = std::array<Neighbours<float>, 3>;
using Targets = std::array<float*, 3>;

/// out_i = sum over o of s_o v_o[i] / h for first <= i < last: the same stencil for all. Its zeros are
/// skipped.
void differentiate(const Stencil& s, const Sources& v, float inverseSpacing, int first, int last,
                   const Targets& out) {
  float w[5];
  int offset[5], taps = 0;
  for (int o = 0; o < 5; ++o)
    if (s[o] != 0) {
      w[taps] = s[o] * inverseSpacing;
      offset[taps++] = o;
    }
  for (int c = 0; c < 3; ++c) {
    const float* a[5];
    for (int t = 0; t < taps; ++t) a[t] = v[c][offset[t]];
    float* to = out[c];
    switch (taps) {
    case 2:
#pragma omp simd
      for (int i = first; i < last; ++i) to[i] = w[0] * a[0][i] + w[1] * a[1][i];
      break;
    case 3:
#pragma omp simd
      for (int i = first; i < last; ++i) to[i] = w[0] * a[0][i] + w[1] * a[1][i] + w[2] * a[2][i];
      break;
    case 4:
#pragma omp simd
      for (int i = first; i < last; ++i)
        to[i] = w[0] * a[0][i] + w[1] * a[1][i] + w[2] * a[2][i] + w[3] * a[3][i];
      break;
    default: // no neighbour at all
      std::fill(to + first, to + last, 0.f);
    }
  }
}

/// The same with a stencil for each node, chosen by the valid nodes around it.
void differentiate(const Neighbours<unsigned char>& valid, int order, const Sources& v, float inverseSpacing,
                   int n, const Targets& out) {
  for (int i = 0; i < n; ++i) {
    Stencil s{};
    if (valid[2][i]) s = stencil(valid[0][i], valid[1][i], valid[3][i], valid[4][i], order);
    for (int c = 0; c < 3; ++c) {
      float sum = 0;
      for (int o = 0; o < 5; ++o) sum += s[o] * v[c][o][i];
      out[c][i] = inverseSpacing * sum;
    }
  }
}

/// Double, because the closed form loses half of the digits where two eigenvalues agree, as in solid
/// rotation.
float middleEigenvalue(const Eigen::Matrix3d& gradient) {
  const Eigen::Matrix3d s = 0.5 * (gradient + gradient.transpose());
  const Eigen::Matrix3d o = 0.5 * (gradient - gradient.transpose());
  Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver;
  solver.computeDirect(s * s + o * o, Eigen::EigenvaluesOnly);
  return float(solver.eigenvalues()[1]);
}

/// Everything that one thread needs for the rows it works on.
class RowWorker {
public:
  RowWorker(const Grid& grid, const float* velocity, const unsigned char* mask, int order, int height)
      : grid_(grid), order_(order), rows_(grid, velocity, mask, height) {
    for (auto& g : gradient_) g.assign(grid.n[0], 0.f);
  }

  void startAt(int firstRow) { rows_.startAt(firstRow); }

  void run(int j, int k, const QCriterionOutputs& out) {
    alongRow(rows_(j, k));
    acrossRows(1, j, k);
    acrossRows(2, j, k);
    write(grid_.index(0, j, k), out);
  }

private:
  void alongRow(const Row& row) {
    const int n = grid_.n[0];
    Sources v;
    Neighbours<unsigned char> valid;
    for (int o = -Reach; o <= Reach; ++o) {
      for (int c = 0; c < 3; ++c) v[c][o + Reach] = row.component[c].data() + Reach + o;
      valid[o + Reach] = row.valid.data() + Reach + o;
    }
    if (!row.allValid) return differentiate(valid, order_, v, inverseSpacing(0), n, targets(0));
    const auto part = [&](int first, int last) {
      const auto is = [&](int o) { return first + o >= 0 && first + o < n; };
      differentiate(stencil(is(-2), is(-1), is(1), is(2), order_), v, inverseSpacing(0), first, last,
                    targets(0));
    };
    const int edge = std::min(order_ / 2, (n + 1) / 2); // nodes at either end that lack a neighbour
    for (int i = 0; i < edge; ++i) {
      part(i, i + 1);
      part(n - 1 - i, n - i);
    }
    if (edge < n - edge) part(edge, n - edge);
  }

  /// axis 1: d/dy, across rows of one slice; axis 2: d/dz, across slices.
  void acrossRows(int axis, int j, int k) {
    const int dj = axis == 1, dk = axis == 2;
    const auto is = [&](int o) { return rows_.exists(j + o * dj, k + o * dk); };
    const auto at = [&](int o) -> const Row& { return rows_(j + o * dj, k + o * dk); };
    const Stencil s = stencil(is(-2), is(-1), is(1), is(2), order_);
    bool same = at(0).allValid; // one stencil serves all nodes when no row that it uses is masked
    for (int o = -Reach; o <= Reach; ++o) same = same && (s[o + Reach] == 0 || at(o).allValid);
    Sources v{};
    Neighbours<unsigned char> valid{};
    for (int o = -Reach; o <= Reach; ++o) {
      if (same && s[o + Reach] == 0) continue; // not used, so not loaded
      for (int c = 0; c < 3; ++c) v[c][o + Reach] = at(o).component[c].data() + Reach;
      valid[o + Reach] = at(o).valid.data() + Reach;
    }
    if (same)
      differentiate(s, v, inverseSpacing(axis), 0, grid_.n[0], targets(axis));
    else
      differentiate(valid, order_, v, inverseSpacing(axis), grid_.n[0], targets(axis));
  }

  /// d u_c / d x_axis for c = 0, 1, 2
  Targets targets(int axis) {
    return {gradient_[axis].data(), gradient_[3 + axis].data(), gradient_[6 + axis].data()};
  }
  float inverseSpacing(int axis) const { return float(1 / grid_.spacing[axis]); }

  void write(std::size_t first, const QCriterionOutputs& out) const {
    const int n = grid_.n[0];
    const float* g[9];
    for (int e = 0; e < 9; ++e) g[e] = gradient_[e].data(); // g[3 i + j] = d u_i / d x_j
    if (out.q) {
      // Q = (|Omega|^2 - |S|^2)/2 = -(d_j u_i d_i u_j)/2
      float* q = out.q + first;
#pragma omp simd
      for (int i = 0; i < n; ++i)
        q[i] = -0.5f * (g[0][i] * g[0][i] + g[4][i] * g[4][i] + g[8][i] * g[8][i]) - g[1][i] * g[3][i] -
               g[2][i] * g[6][i] - g[5][i] * g[7][i];
    }
    if (out.vorticity) {
      float* w = out.vorticity + 3 * first;
      for (int i = 0; i < n; ++i) {
        w[3 * i] = g[7][i] - g[5][i];
        w[3 * i + 1] = g[2][i] - g[6][i];
        w[3 * i + 2] = g[3][i] - g[1][i];
      }
    }
    if (out.divergence) {
      float* d = out.divergence + first;
      for (int i = 0; i < n; ++i) d[i] = g[0][i] + g[4][i] + g[8][i];
    }
    if (out.lambda2)
      for (int i = 0; i < n; ++i) {
        Eigen::Matrix3d gradient;
        gradient << g[0][i], g[1][i], g[2][i], g[3][i], g[4][i], g[5][i], g[6][i], g[7][i], g[8][i];
        out.lambda2[first + i] = middleEigenvalue(gradient);
      }
  }

  const Grid& grid_;
  int order_;
  RowCache rows_;
  std::array<std::vector<float>, 9> gradient_;
};

} // namespace

bool qCriterion(const Grid& grid, const float* velocity, const unsigned char* mask, int order,
                const QCriterionOutputs& out, const Progress& progress) {
  if (!goOn(progress, 0)) return false;
  // Blocks of rows by a few slices, so that a thread's rows fit into its cache (256 KiB).
  const int rowBytes = 13 * (grid.n[0] + 2 * Reach);
  const int height = std::clamp((256 << 10) / (RowCache::Slices * rowBytes) - 2 * Reach, 4, 64);
  const int blocks = (grid.n[1] + height - 1) / height;
  const int depth = std::clamp(grid.n[2] * blocks / (4 * omp_get_max_threads()), 4, 16);
  const int layers = (grid.n[2] + depth - 1) / depth;
  std::atomic<bool> aborted{false};
  std::atomic<int> done{0};
#pragma omp parallel
  {
    RowWorker worker(grid, velocity, mask, order, height);
#pragma omp for schedule(dynamic)
    for (int piece = 0; piece < layers * blocks; ++piece) {
      if (aborted) continue;
      const int firstRow = piece % blocks * height, firstSlice = piece / blocks * depth;
      worker.startAt(firstRow);
      for (int k = firstSlice; k < std::min(firstSlice + depth, grid.n[2]); ++k)
        for (int j = firstRow; j < std::min(firstRow + height, grid.n[1]); ++j) worker.run(j, k, out);
      ++done;
      if (omp_get_thread_num() == 0 && !goOn(progress, double(done) / (layers * blocks))) aborted = true;
    }
  }
  return !aborted;
}

} // namespace rimflow
