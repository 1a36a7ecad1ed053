#include "VICSharpModel.h"

#include <Eigen/Eigenvalues>
#include <algorithm>

namespace rimflow {
namespace {

template <class Real>
void allocate(std::array<std::vector<Real>, 3>& field, std::size_t n) {
  for (auto& component : field) component.assign(n, 0);
}

template <class Real>
std::array<std::vector<Real>, 3> byComponent(const std::vector<double>& interleaved) {
  std::array<std::vector<Real>, 3> out;
  for (int c = 0; c < 3; ++c) {
    out[c].resize(interleaved.size() / 3);
    for (std::size_t p = 0; p < out[c].size(); ++p) out[c][p] = Real(interleaved[3 * p + c]);
  }
  return out;
}

template <class Real>
double squares(const Real* a, int n) {
  double sum = 0;
#pragma omp simd reduction(+ : sum)
  for (int i = 0; i < n; ++i) sum += double(a[i]) * double(a[i]);
  return sum;
}

} // namespace

template <class Real>
VICSharpModel<Real>::VICSharpModel(const Grid& grid, const VICSharpData& data,
                                   const VICSharpConstants& constants)
    : grid_(grid), constants_(constants), stencils_(grid), poisson_(grid), boundary_(grid),
      sampler_(grid, data.position.data(), data.size()), velocityData_(byComponent<Real>(data.velocity)),
      accelerationData_(byComponent<Real>(data.acceleration)),
      velocityWeight_(data.velocityWeight.begin(), data.velocityWeight.end()),
      accelerationWeight_(data.accelerationWeight.begin(), data.accelerationWeight.end()) {
  if (data.acceleration.empty()) constants_.accelerationWeight = 0;
  for (int c = 0; c < 3; ++c) mean_[c] = Real(data.meanVelocity[c]);
  const std::size_t n = grid_.size();
  allocate(w_, n), allocate(u_, n), allocate(wBar_, n), allocate(uBar_, n);
  if (hasAcceleration())
    allocate(q_, n), allocate(d_, n), allocate(a_, n), allocate(aBar_, n), allocate(dBar_, n);
  if (hasPressure()) {
    p_.assign(n, 0);
    pressurePoisson_ = std::make_unique<BoxPoisson<Real>>(
        grid_, std::array<AxisBasis, 3>{normalBasis(0), normalBasis(1), normalBasis(2)});
  }
}

// Eigenvectors of D^T D along an axis; only constants belong to eigenvalue 0
template <class Real>
AxisBasis VICSharpModel<Real>::normalBasis(int axis) const {
  const int n = grid_.n[axis];
  Eigen::MatrixXd d = Eigen::MatrixXd::Zero(n, n);
  const auto& taps = stencils_.difference(axis);
  for (int i = 0; i < n; ++i)
    for (int t = 0; t < taps[i].count; ++t) d(i, taps[i].index[t]) = double(taps[i].weight[t]);
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> solver(d.transpose() * d);
  AxisBasis basis{solver.eigenvectors(), solver.eigenvalues(), 0};
  basis.values[0] = 0;
  return basis;
}

template <class Real>
std::size_t VICSharpModel<Real>::size() const {
  return 3 * grid_.size() + (hasAcceleration() ? 6 : 3) * boundary_.size();
}

// to = sw B^m from; its own transpose. Overwrites uBar_.
template <class Real>
void VICSharpModel<Real>::smooth(const std::array<const Real*, 3>& from, const std::array<Real*, 3>& to) {
  for (int i = 0; i < 3; ++i) {
    const Real* source = from[i];
    for (int pass = 1; pass <= constants_.smoothingPasses; ++pass) {
      const bool last = pass == constants_.smoothingPasses;
      Real* target = last ? to[i] : uBar_[pass % 2].data();
      const Real scale = last ? Real(constants_.vorticityScale()) : Real(1);
      forEachRow<Real>(grid_, 1, [&](int j, int k, RowBuffers<Real>& rows) {
        stencils_.smooth(source, j, k, scale, rows(0), target + grid_.index(0, j, k));
      });
      source = target;
    }
  }
}

// L f = -curl source inside, f = scale b on the boundary
template <class Real>
void VICSharpModel<Real>::solveCurl(const VectorField& source, const Real* b, Real scale,
                                    VectorField& f) const {
  const int n = grid_.n[0];
  forEachRow<Real>(grid_, 1, [&](int j, int k, RowBuffers<Real>& rows) {
    if (!stencils_.isInterior(j, k)) return;
    for (int i = 0; i < 3; ++i) {
      const int l = (i + 1) % 3, m = (i + 2) % 3;
      stencils_.derivative(source[l].data(), m, j, k, rows(0)); // -(D_l s_m - D_m s_l)
      stencils_.addDerivative(source[m].data(), l, j, k, Real(-1), rows(0));
      std::copy(rows(0) + 1, rows(0) + n - 1, f[i].data() + grid_.index(1, j, k));
    }
  });
  const std::size_t count = boundary_.size();
#pragma omp parallel for
  for (int i = 0; i < 3; ++i)
    for (std::size_t e = 0; e < count; ++e) {
      const Real value = scale * b[i * count + e];
      f[i][boundary_.node[e]] = value;
      if (boundary_.inside[e] >= 0) f[i][boundary_.inside[e]] -= Real(boundary_.weight[e]) * value;
    }
  Real* fields[3] = {f[0].data(), f[1].data(), f[2].data()};
  poisson_.solve(fields, 3);
}

// From dJ/df: dJ/d(right-hand side) inside (0 on the boundary) in its place, and dJ/db
template <class Real>
void VICSharpModel<Real>::solveCurlTransposed(VectorField& bar, Real scale, Real* bBar) const {
  Real* fields[3] = {bar[0].data(), bar[1].data(), bar[2].data()};
  poisson_.solve(fields, 3);
  const std::size_t count = boundary_.size();
#pragma omp parallel for
  for (int i = 0; i < 3; ++i)
    for (std::size_t e = 0; e < count; ++e) {
      Real value = bar[i][boundary_.node[e]];
      if (boundary_.inside[e] >= 0) value -= Real(boundary_.weight[e]) * bar[i][boundary_.inside[e]];
      bBar[i * count + e] = scale * value;
      bar[i][boundary_.node[e]] = 0;
    }
}

// out (+)= scale curl^T bar
template <class Real>
void VICSharpModel<Real>::addCurlTransposed(const VectorField& bar, Real scale, VectorField& out,
                                            bool accumulate) const {
  forEachRow<Real>(grid_, 0, [&](int j, int k, RowBuffers<Real>&) {
    for (int i = 0; i < 3; ++i) {
      const int l = (i + 1) % 3, m = (i + 2) % 3;
      Real* row = out[i].data() + grid_.index(0, j, k);
      if (!accumulate) std::fill_n(row, grid_.n[0], Real(0));
      stencils_.addDerivativeTransposed(bar[m].data(), l, j, k, -scale, row); // (curl)_m has -D_l of i
      stencils_.addDerivativeTransposed(bar[l].data(), m, j, k, scale, row);  // (curl)_l has +D_m of i
    }
  });
}

// q_i = w_j Gu_ij - U_j Gw_ij + nu (L w)_i
template <class Real>
void VICSharpModel<Real>::transport() {
  const int n = grid_.n[0];
  const Real nu = Real(constants_.viscosity);
  forEachRow<Real>(grid_, 2, [&](int j, int k, RowBuffers<Real>& rows) {
    const std::size_t first = grid_.index(0, j, k);
    for (int i = 0; i < 3; ++i) {
      Real *q = q_[i].data() + first, *gu = rows(0), *gw = rows(1);
      std::fill_n(q, n, Real(0));
      for (int l = 0; l < 3; ++l) {
        const Real *w = w_[l].data() + first, *u = u_[l].data() + first, mean = mean_[l];
        stencils_.derivative(u_[i].data(), l, j, k, gu);
        stencils_.derivative(w_[i].data(), l, j, k, gw);
#pragma omp simd
        for (int e = 0; e < n; ++e) q[e] += w[e] * gu[e] - (u[e] + mean) * gw[e];
      }
      if (nu != 0) stencils_.addLaplacian(w_[i].data(), j, k, nu, q);
    }
  });
}

// a_i = d_i + U_j Gu_ij
template <class Real>
void VICSharpModel<Real>::materialAcceleration() {
  const int n = grid_.n[0];
  forEachRow<Real>(grid_, 1, [&](int j, int k, RowBuffers<Real>& rows) {
    const std::size_t first = grid_.index(0, j, k);
    for (int i = 0; i < 3; ++i) {
      Real *a = a_[i].data() + first, *gu = rows(0);
      std::copy_n(d_[i].data() + first, n, a);
      for (int l = 0; l < 3; ++l) {
        const Real *u = u_[l].data() + first, mean = mean_[l];
        stencils_.derivative(u_[i].data(), l, j, k, gu);
#pragma omp simd
        for (int e = 0; e < n; ++e) a[e] += (u[e] + mean) * gu[e];
      }
    }
  });
}

template <class Real>
void VICSharpModel<Real>::forward(const Vector& x) {
  const std::size_t n = grid_.size();
  const Real* c = x.data();
  smooth({c, c + n, c + 2 * n}, {w_[0].data(), w_[1].data(), w_[2].data()}); // w = sw B^m c
  solveCurl(w_, x.data() + boundaryVelocityOffset(), Real(constants_.velocityScale), u_);
  if (!hasAcceleration()) return;
  transport();
  solveCurl(q_, x.data() + boundaryRateOffset(), Real(constants_.accelerationScale), d_);
  materialAcceleration();
}

namespace {

/// weight |P f - data|^2, and bar += 2 weight P^T (P f - data)
template <class Real>
double dataMisfit(const TrilinearSampler<Real>& sampler, const std::array<std::vector<Real>, 3>& field,
                  const std::array<std::vector<Real>, 3>& data, const std::vector<Real>& particleWeight,
                  double weight, std::vector<Real>& sampled, std::array<std::vector<Real>, 3>& bar) {
  const std::size_t count = sampler.size();
  sampled.resize(count);
  double misfit = 0;
  for (int i = 0; i < 3; ++i) {
    sampler.sample(field[i].data(), sampled.data());
    double sum = 0;
    for (std::size_t p = 0; p < count; ++p) {
      const Real residual = sampled[p] - data[i][p];
      const Real w = particleWeight.empty() ? Real(1) : particleWeight[p];
      sum += double(w * residual) * double(residual);
      sampled[p] = Real(2 * weight) * w * residual;
    }
    misfit += sum;
    sampler.addTransposed(sampled.data(), bar[i].data());
  }
  return weight * misfit;
}

} // namespace

// |P u - u_p|^2/(Np su^2)
template <class Real>
double VICSharpModel<Real>::velocityMisfit() {
  const double su = constants_.velocityScale;
  return dataMisfit(sampler_, u_, velocityData_, velocityWeight_, 1 / (sampler_.size() * su * su), sampled_,
                    uBar_);
}

// alpha^2 |P a - a_p|^2/(Np sa^2)
template <class Real>
double VICSharpModel<Real>::accelerationMisfit() {
  const double sa = constants_.accelerationScale, alpha = constants_.accelerationWeight;
  return dataMisfit(sampler_, a_, accelerationData_, accelerationWeight_,
                    alpha * alpha / (sampler_.size() * sa * sa), sampled_, aBar_);
}

// weight |div f|^2; bar = 2 weight div f
template <class Real>
double VICSharpModel<Real>::penaliseDivergence(const VectorField& f, double weight, Vector& bar) const {
  bar.resize(grid_.size());
  const int n = grid_.n[0];
  const double sum = sumOverRows<Real, 1>(grid_, 0, [&](int j, int k, RowBuffers<Real>&) {
    Real* row = bar.data() + grid_.index(0, j, k);
    stencils_.derivative(f[0].data(), 0, j, k, row);
    stencils_.addDerivative(f[1].data(), 1, j, k, 1, row);
    stencils_.addDerivative(f[2].data(), 2, j, k, 1, row);
    const double square = squares(row, n);
    for (int e = 0; e < n; ++e) row[e] *= Real(2 * weight);
    return std::array<double, 1>{square};
  })[0];
  return weight * sum;
}

// out_i += D_i^T bar
template <class Real>
void VICSharpModel<Real>::addDivergenceTransposed(const Vector& bar, VectorField& out) const {
  forEachRow<Real>(grid_, 0, [&](int j, int k, RowBuffers<Real>&) {
    for (int i = 0; i < 3; ++i)
      stencils_.addDerivativeTransposed(bar.data(), i, j, k, 1, out[i].data() + grid_.index(0, j, k));
  });
}

// The p that minimises |R|^2, R = a + grad p - nu L u:   sum of D_i^T D_i p = -sum of D_i^T (a_i - nu L u_i)
template <class Real>
void VICSharpModel<Real>::solvePressure() {
  const Real nu = Real(constants_.viscosity);
  const int n = grid_.n[0];
  forEachRow<Real>(grid_, 0, [&](int j, int k, RowBuffers<Real>&) {
    const std::size_t first = grid_.index(0, j, k);
    for (int i = 0; i < 3; ++i) {
      Real* row = aBar_[i].data() + first;
      std::copy_n(a_[i].data() + first, n, row);
      if (nu != 0) stencils_.addLaplacian(u_[i].data(), j, k, -nu, row);
    }
  });
  forEachRow<Real>(grid_, 0, [&](int j, int k, RowBuffers<Real>&) {
    Real* row = p_.data() + grid_.index(0, j, k);
    std::fill_n(row, n, Real(0));
    for (int i = 0; i < 3; ++i) stencils_.addDerivativeTransposed(aBar_[i].data(), i, j, k, Real(-1), row);
  });
  pressurePoisson_->solve(p_.data());
}

// weight |R|^2 with R = a + grad p - nu L u; aBar = 2 weight R, which is dJ/da: p is optimal
template <class Real>
double VICSharpModel<Real>::penaliseMomentum() {
  const double bn = constants_.navierStokesWeight, sa = constants_.accelerationScale;
  const double weight = bn * bn / (grid_.size() * sa * sa);
  const int n = grid_.n[0];
  solvePressure();
  const double sum = sumOverRows<Real, 1>(grid_, 0, [&](int j, int k, RowBuffers<Real>&) {
    const std::size_t first = grid_.index(0, j, k);
    double square = 0;
    for (int i = 0; i < 3; ++i) {
      Real* row = aBar_[i].data() + first;
      stencils_.addDerivative(p_.data(), i, j, k, 1, row);
      square += squares(row, n);
      for (int e = 0; e < n; ++e) row[e] *= Real(2 * weight);
    }
    return std::array<double, 1>{square};
  })[0];
  return weight * sum;
}

// From aBar = dJ/dR its part of uBar
template <class Real>
void VICSharpModel<Real>::momentumTransposed() {
  const Real nu = Real(constants_.viscosity);
  if (nu == 0) return;
  forEachRow<Real>(grid_, 0, [&](int j, int k, RowBuffers<Real>&) {
    for (int i = 0; i < 3; ++i)
      stencils_.addLaplacianTransposed(aBar_[i].data(), j, k, -nu, uBar_[i].data() + grid_.index(0, j, k));
  });
}

// bc^2 <|c|^2>
template <class Real>
double VICSharpModel<Real>::penaliseRoughness(const Real* c, Real* gradient) const {
  const double bc = constants_.roughnessWeight;
  if (bc == 0) return 0;
  const double weight = bc * bc / grid_.size();
  const std::size_t layer = std::size_t(grid_.n[0]) * grid_.n[1];
  std::vector<double> sums(3 * grid_.n[2]);
#pragma omp parallel for
  for (std::size_t k = 0; k < sums.size(); ++k) {
    sums[k] = squares(c + k * layer, int(layer));
    for (std::size_t e = k * layer; e < (k + 1) * layer; ++e) gradient[e] += Real(2 * weight) * c[e];
  }
  double sum = 0;
  for (double s : sums) sum += s;
  return weight * sum;
}

// From dJ/dq and dJ/da, the parts of dJ/du and dJ/dw:
//   uBar_l += aBar_i Gu_il - qBar_i Gw_il,   uBar_i += D_l^T (aBar_i U_l + qBar_i w_l)
//   wBar_l += qBar_i Gu_il,                  wBar_i += D_l^T (-qBar_i U_l) + nu L^T qBar_i
template <class Real>
void VICSharpModel<Real>::transportTransposed() {
  const VectorField& qBar = q_;
  const int n = grid_.n[0];
  const Real nu = Real(constants_.viscosity);
  forEachRow<Real>(grid_, 2, [&](int j, int k, RowBuffers<Real>& rows) {
    const std::size_t first = grid_.index(0, j, k);
    for (int i = 0; i < 3; ++i) {
      const Real *aB = aBar_[i].data() + first, *qB = qBar[i].data() + first;
      Real *gu = rows(0), *gw = rows(1);
      for (int l = 0; l < 3; ++l) {
        Real *uB = uBar_[l].data() + first, *wB = wBar_[l].data() + first;
        stencils_.derivative(u_[i].data(), l, j, k, gu);
        stencils_.derivative(w_[i].data(), l, j, k, gw);
#pragma omp simd
        for (int e = 0; e < n; ++e) {
          uB[e] += aB[e] * gu[e] - qB[e] * gw[e];
          wB[e] += qB[e] * gu[e];
        }
      }
    }
    for (int i = 0; i < 3; ++i) {
      Real *uB = uBar_[i].data() + first, *wB = wBar_[i].data() + first;
      for (int l = 0; l < 3; ++l) {
        const Real mean = mean_[l];
        const auto products = [&](std::size_t at, auto&& use) {
          const Real *aB = aBar_[i].data() + at, *qB = qBar[i].data() + at, *u = u_[l].data() + at,
                     *w = w_[l].data() + at;
#pragma omp simd
          for (int e = 0; e < n; ++e) use(e, aB[e] * (u[e] + mean) + qB[e] * w[e], -qB[e] * (u[e] + mean));
        };
        if (l == 0) {
          Real *toU = rows(0), *toW = rows(1);
          products(first, [&](int e, Real forU, Real forW) { toU[e] = forU, toW[e] = forW; });
          Stencils<Real>::template alongX<true>(stencils_.differenceTransposed(0), toU, 1, n, uB);
          Stencils<Real>::template alongX<true>(stencils_.differenceTransposed(0), toW, 1, n, wB);
          continue;
        }
        const Taps<Real>& taps = stencils_.differenceTransposed(l)[l == 1 ? j : k];
        for (int t = 0; t < taps.count; ++t) {
          const Real weight = taps.weight[t];
          const int at = taps.index[t];
          products(l == 1 ? grid_.index(0, at, k) : grid_.index(0, j, at),
                   [&](int e, Real forU, Real forW) { uB[e] += weight * forU, wB[e] += weight * forW; });
        }
      }
      if (nu != 0) stencils_.addLaplacianTransposed(qBar[i].data(), j, k, nu, wB);
    }
  });
}

template <class Real>
double VICSharpModel<Real>::cost(const Vector& x, Vector& gradient) {
  const double nodes = double(grid_.size()), r = constants_.particleSpacing, sw = constants_.vorticityScale(),
               sa = constants_.accelerationScale;
  const auto square = [](double v) { return v * v; };
  const double divergence = square(constants_.divergenceWeight / sw) / nodes,
               vorticityDivergence = square(constants_.vorticityDivergenceWeight * r / sw) / nodes,
               accelerationDivergence = square(constants_.accelerationDivergenceWeight * r / sa) / nodes,
               alpha = constants_.accelerationWeight;
  Real* const boundaryVelocityGradient = gradient.data() + boundaryVelocityOffset();
  forward(x);
  terms_ = {};

  for (int i = 0; i < 3; ++i) {
    std::fill(uBar_[i].begin(), uBar_[i].end(), Real(0));
    std::fill(wBar_[i].begin(), wBar_[i].end(), Real(0));
  }
  terms_.velocity = velocityMisfit();
  if (divergence > 0) {
    terms_.divergence = penaliseDivergence(u_, divergence, divergenceUBar_);
    addDivergenceTransposed(divergenceUBar_, uBar_);
  }
  if (vorticityDivergence > 0) {
    terms_.vorticityDivergence = penaliseDivergence(w_, vorticityDivergence, divergenceWBar_);
    addDivergenceTransposed(divergenceWBar_, wBar_);
  }
  double weightedAcceleration = 0;
  if (hasAcceleration()) {
    if (hasPressure()) {
      terms_.navierStokes = penaliseMomentum();
      momentumTransposed();
    } else {
      for (auto& component : aBar_) std::fill(component.begin(), component.end(), Real(0));
    }
    weightedAcceleration = accelerationMisfit();
    terms_.acceleration = weightedAcceleration / (alpha * alpha);
    dBar_ = aBar_;
    if (accelerationDivergence > 0) {
      terms_.accelerationDivergence = penaliseDivergence(d_, accelerationDivergence, divergenceDBar_);
      addDivergenceTransposed(divergenceDBar_, dBar_);
    }
    solveCurlTransposed(dBar_, Real(sa), gradient.data() + boundaryRateOffset());
    addCurlTransposed(dBar_, Real(-1), q_, false); // q_ = dJ/dq from here on
    transportTransposed();
  }
  solveCurlTransposed(uBar_, Real(constants_.velocityScale), boundaryVelocityGradient);
  addCurlTransposed(uBar_, Real(-1), wBar_, true);
  const std::size_t n = grid_.size();
  Real* g = gradient.data();
  smooth({wBar_[0].data(), wBar_[1].data(), wBar_[2].data()}, {g, g + n, g + 2 * n}); // B^T = B
  terms_.roughness = penaliseRoughness(x.data(), gradient.data());
  return terms_.velocity + weightedAcceleration + terms_.divergence + terms_.vorticityDivergence +
         terms_.accelerationDivergence + terms_.navierStokes + terms_.roughness;
}

template class VICSharpModel<float>;
template class VICSharpModel<double>;

} // namespace rimflow
