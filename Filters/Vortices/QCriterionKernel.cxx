#include "QCriterionKernel.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <array>
#include <atomic>
#include <omp.h>
#include <vector>

namespace rimflow {
namespace {

constexpr int Reach = 2; // nodes to either side that a stencil may use

/// The velocity of one grid row, split by component and padded by Reach; masked and outside nodes are 0.
struct Row {
  std::vector<float> component[3];
  std::vector<unsigned char> valid;

  explicit Row(int n) : valid(n + 2 * Reach, 0) {
    for (auto& c : component) c.assign(n + 2 * Reach, 0.f);
  }

  void load(const Grid& grid, const float* velocity, const unsigned char* mask, int j, int k) {
    const int n = grid.n[0];
    if (j < 0 || j >= grid.n[1] || k < 0 || k >= grid.n[2]) {
      std::fill(valid.begin(), valid.end(), 0);
      for (auto& c : component) std::fill(c.begin(), c.end(), 0.f);
      return;
    }
    const std::size_t first = grid.index(0, j, k);
    const float* u = velocity + 3 * first;
    for (int c = 0; c < 3; ++c) {
      float* to = component[c].data() + Reach;
      for (int i = 0; i < n; ++i) to[i] = u[3 * i + c];
    }
    if (!mask) {
      std::fill_n(valid.begin() + Reach, n, 1);
      return;
    }
    for (int i = 0; i < n; ++i) {
      const bool fluid = !mask[first + i];
      valid[Reach + i] = fluid;
      if (!fluid)
        for (auto& c : component) c[Reach + i] = 0.f; // it may hold NaN, and 0 x NaN is NaN
    }
  }
};

/// Weights of the nodes at -2..2 for a first derivative at unit spacing, per node of a row.
struct Weights {
  std::vector<float> w[5];
  explicit Weights(int n) {
    for (auto& v : w) v.assign(n, 0.f);
  }

  /// The best stencil that the valid nodes v[0..4] (at -2..2) allow.
  static std::array<float, 5> stencil(bool m2, bool m1, bool p1, bool p2, int order) {
    if (order == 4 && m2 && m1 && p1 && p2) return {1 / 12.f, -8 / 12.f, 0, 8 / 12.f, -1 / 12.f};
    if (m1 && p1) return {0, -.5f, 0, .5f, 0};
    if (p1 && p2) return {0, 0, -1.5f, 2, -.5f};
    if (m1 && m2) return {.5f, -2, 1.5f, 0, 0};
    if (p1) return {0, 0, -1, 1, 0};
    if (m1) return {0, -1, 1, 0, 0};
    return {};
  }

  /// valid: the flags of the five rows (or shifted rows) at -2..2, padding removed.
  void set(const std::array<const unsigned char*, 5>& valid, int n, int order) {
    for (int i = 0; i < n; ++i) {
      std::array<float, 5> s{};
      if (valid[2][i]) s = stencil(valid[0][i], valid[1][i], valid[3][i], valid[4][i], order);
      for (int o = 0; o < 5; ++o) w[o][i] = s[o];
    }
  }
};

/// out_i = sum over o of w_o[i] v_o[i] / h
void differentiate(const Weights& weights, const std::array<const float*, 5>& v, float inverseSpacing, int n,
                   float* out) {
  const float *w0 = weights.w[0].data(), *w1 = weights.w[1].data(), *w2 = weights.w[2].data(),
              *w3 = weights.w[3].data(), *w4 = weights.w[4].data();
  const float *v0 = v[0], *v1 = v[1], *v2 = v[2], *v3 = v[3], *v4 = v[4];
#pragma omp simd
  for (int i = 0; i < n; ++i)
    out[i] = inverseSpacing * (w0[i] * v0[i] + w1[i] * v1[i] + w2[i] * v2[i] + w3[i] * v3[i] + w4[i] * v4[i]);
}

/// In double: the closed-form eigenvalues lose half the digits.
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
  RowWorker(const Grid& grid, const float* velocity, const unsigned char* mask, int order)
      : grid_(grid), velocity_(velocity), mask_(mask),
        order_(order), weights_{Weights(grid.n[0]), Weights(grid.n[0]), Weights(grid.n[0])} {
    for (int o = 0; o < 9; ++o) rows_.emplace_back(grid.n[0]);
    for (auto& g : gradient_) g.assign(grid.n[0], 0.f);
  }

  void run(int j, int k, const QCriterionOutputs& out) {
    for (int o = -Reach; o <= Reach; ++o) {
      row(0, o).load(grid_, velocity_, mask_, j + o, k);
      if (o != 0) row(1, o).load(grid_, velocity_, mask_, j, k + o);
    }
    const int n = grid_.n[0];
    for (int axis = 0; axis < 3; ++axis) {
      std::array<const unsigned char*, 5> valid;
      for (int o = -Reach; o <= Reach; ++o) valid[o + Reach] = flags(axis, o);
      weights_[axis].set(valid, n, order_);
      for (int c = 0; c < 3; ++c) {
        std::array<const float*, 5> v;
        for (int o = -Reach; o <= Reach; ++o) v[o + Reach] = values(axis, o, c);
        differentiate(weights_[axis], v, float(1 / grid_.spacing[axis]), n, gradient_[3 * c + axis].data());
      }
    }
    write(grid_.index(0, j, k), out);
  }

private:
  /// direction 0: neighbours in y (and the row itself), 1: neighbours in z.
  Row& row(int direction, int o) {
    return o == 0 || direction == 0 ? rows_[o + Reach] : rows_[5 + (o < 0 ? o + Reach : o + Reach - 1)];
  }
  const unsigned char* flags(int axis, int o) {
    return axis == 0 ? row(0, 0).valid.data() + Reach + o : row(axis - 1, o).valid.data() + Reach;
  }
  const float* values(int axis, int o, int c) {
    return axis == 0 ? row(0, 0).component[c].data() + Reach + o
                     : row(axis - 1, o).component[c].data() + Reach;
  }

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
  const float* velocity_;
  const unsigned char* mask_;
  int order_;
  std::vector<Row> rows_; // y - 2 .. y + 2, then z - 2, z - 1, z + 1, z + 2
  std::array<Weights, 3> weights_;
  std::array<std::vector<float>, 9> gradient_;
};

} // namespace

bool qCriterion(const Grid& grid, const float* velocity, const unsigned char* mask, int order,
                const QCriterionOutputs& out, const Progress& progress) {
  const int slices = grid.n[2];
  std::atomic<bool> aborted{false};
  std::atomic<int> done{0};
#pragma omp parallel
  {
    RowWorker worker(grid, velocity, mask, order);
#pragma omp for schedule(dynamic)
    for (int k = 0; k < slices; ++k) {
      if (aborted) continue;
      for (int j = 0; j < grid.n[1]; ++j) worker.run(j, k, out);
      ++done;
      if (omp_get_thread_num() == 0 && !goOn(progress, double(done) / slices)) aborted = true;
    }
  }
  return !aborted;
}

} // namespace rimflow
