#include "VICSharpModel.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>

namespace rimflow {
namespace {

template <class Real>
void allocate(std::array<std::vector<Real>, 3>& field, std::size_t n) {
  for (auto& component : field) component.assign(n, 0);
}

template <class Real>
std::array<Real*, 3> pointers(std::array<std::vector<Real>, 3>& field) {
  return {field[0].data(), field[1].data(), field[2].data()};
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

double square(double v) { return v * v; }

// Measured on a sphere at Re = 100, 14 spacings wide: 0.01 to 0.1 do equally well near and far from it.
constexpr double WallSmoothness = 0.03;
constexpr double SourcePenalty = 1e-3;

std::array<AxisBasis, 3> cosines(const Grid& grid) {
  return {neumannBasis(grid.n[0], grid.spacing[0]), neumannBasis(grid.n[1], grid.spacing[1]),
          neumannBasis(grid.n[2], grid.spacing[2])};
}

} // namespace

template <class Real>
VICSharpModel<Real>::VICSharpModel(const Grid& grid, const VICSharpData& data,
                                   const VICSharpConstants& constants)
    : grid_(grid), constants_(constants), stencils_(grid, constants.order), poisson_(grid), boundary_(grid),
      sampler_(grid, data.position.data(), data.size(), constants.order),
      velocityData_(byComponent<Real>(data.velocity)),
      accelerationData_(byComponent<Real>(data.acceleration)),
      velocityWeight_(data.velocityWeight.begin(), data.velocityWeight.end()),
      accelerationWeight_(data.accelerationWeight.begin(), data.accelerationWeight.end()) {
  for (int c = 0; c < 3; ++c) {
    mean_[c] = Real(data.meanVelocity[c]);
    areaOverVolume_ += 2 / ((grid.n[c] - 1) * grid.spacing[c]);
  }
  const std::size_t n = grid_.size();
  allocate(w_, n), allocate(u_, n), allocate(wBar_, n), allocate(uBar_, n);
  uBoundary_.resize(3 * boundary_.size());
  boundaryBar_.resize(3 * boundary_.size());
  scalar_.resize(n);
  if (hasRate()) {
    allocate(q_, n), allocate(d_, n), allocate(a_, n), allocate(aBar_, n), allocate(dBar_, n);
    dBoundary_.resize(3 * boundary_.size());
  }
  if (hasPressure()) {
    p_.assign(n, 0);
    pressurePoisson_ = std::make_unique<BoxPoisson<Real>>(
        grid_, std::array<AxisBasis, 3>{normalBasis(0), normalBasis(1), normalBasis(2)});
  }
  makeFaceLaplacian();
  findInside();
  if (constants_.precondition) makePreconditioners();
}

template <class Real>
void VICSharpModel<Real>::findInside() {
  if (!constants_.distance) return;
  const double h = grid_.spacing[0], r = constants_.particleSpacing;
  smoothness_.resize(grid_.size());
  for (int k = 0; k < grid_.n[2]; ++k)
    for (int j = 0; j < grid_.n[1]; ++j)
      for (int i = 0; i < grid_.n[0]; ++i) {
        const auto x = grid_.position(i, j, k);
        const double distance = constants_.distance(x[0], x[1], x[2]),
                     near = std::exp(-square(std::max(0., distance) / r)), share = 0.5 - distance / h;
        const std::size_t node = grid_.index(i, j, k);
        smoothness_[node] = Real(1 - (1 - WallSmoothness) * near);
        if (share <= 0 || !hasRate()) continue;
        inside_.push_back(std::uint32_t(node));
        insideShare_.push_back(Real(std::min(share, 1.)));
      }
}

// q = (1 - s) q + s f
template <class Real>
void VICSharpModel<Real>::freeInside(const Real* source) {
  const std::size_t count = inside_.size();
  const Real scale = Real(sourceScale());
  for (int i = 0; i < 3; ++i)
    for (std::size_t e = 0; e < count; ++e) {
      Real& q = q_[i][inside_[e]];
      q += insideShare_[e] * (scale * source[i * count + e] - q);
    }
  source_.assign(source, source + 3 * count);
}

// From q_ = dJ/dq: bar = dJ/df with the penalty's part, and q_ becomes the derivative by what q was before
template <class Real>
double VICSharpModel<Real>::freeInsideTransposed(const Real* source, Real* bar) {
  const std::size_t count = inside_.size();
  const Real scale = Real(sourceScale());
  const double ridge = SourcePenalty / double(grid_.size());
  double sum = 0;
  for (int i = 0; i < 3; ++i)
    for (std::size_t e = 0; e < count; ++e) {
      Real& q = q_[i][inside_[e]];
      const Real s = source[i * count + e];
      sum += double(s) * double(s);
      bar[i * count + e] = scale * insideShare_[e] * q + Real(2 * ridge) * s;
      q *= 1 - insideShare_[e];
    }
  return ridge * sum;
}

template <class Real>
typename VICSharpModel<Real>::State VICSharpModel<Real>::state() const {
  State out{grid_, w_, u_, d_, {}, {mean_[0], mean_[1], mean_[2]}};
  for (int i = 0; i < 3 && !inside_.empty(); ++i) {
    out.source[i].assign(grid_.size(), 0);
    for (std::size_t e = 0; e < inside_.size(); ++e)
      out.source[i][inside_[e]] = Real(sourceScale()) * source_[i * inside_.size() + e];
  }
  return out;
}

template <class Real>
void VICSharpModel<Real>::setConstants(const VICSharpConstants& constants) {
  const bool again = constants.precondition && constants.curvatureWeight != constants_.curvatureWeight;
  constants_ = constants;
  if (again) makePreconditioners();
}

// F, Fb, Fe = H^-1/2, with H the Hessian of J for one wave of wavenumber k (times the number of nodes, so
// that every unknown has the same scale): of the vorticity in an unbounded fluid, and of a boundary value
// that falls off as exp(-k z) inwards.
template <class Real>
void VICSharpModel<Real>::makePreconditioners() {
  const VICSharpConstants& k = constants_;
  double advectingSpeed2 = 3 * square(k.velocityScale);
  for (Real m : mean_) advectingSpeed2 += square(m);
  const double r = k.particleSpacing, longest = 0.25, // (k r)^2 of the longest waves that are told apart
      alpha2 = hasAccelerationData() ? square(k.accelerationWeight) : 0,
               advection = alpha2 * advectingSpeed2 / square(r * k.accelerationScale),
               bc2 = square(k.curvatureWeight), bu2 = square(k.divergenceWeight),
               bd2 = square(k.accelerationDivergenceWeight), thickness = r * areaOverVolume_;
  const auto vorticity = [=](double eigenvalue) {
    const double k2 = -eigenvalue * r * r;
    return 0.25 / (k2 + longest) + 0.25 * advection + bc2 * k2 * k2;
  };
  smooth_ = std::make_unique<BoxPoisson<Real>>(grid_, cosines(grid_),
                                               [=](double l) { return 1 / std::sqrt(vorticity(l)); });
  unsmooth_ = std::make_unique<BoxPoisson<Real>>(grid_, cosines(grid_),
                                                 [=](double l) { return std::sqrt(vorticity(l)); });

  std::vector<std::size_t> place(grid_.size());
  for (std::size_t e = 0; e < boundary_.size(); ++e) place[boundary_.node[e]] = e;
  faces_.clear();
  int low[3] = {0, 0, 0}, high[3] = {grid_.n[0] - 1, grid_.n[1] - 1, grid_.n[2] - 1};
  for (int normal = 0; normal < 3; ++normal) {
    for (int side = 0; side < 2; ++side) {
      Face face;
      int from[3] = {low[0], low[1], low[2]}, to[3] = {high[0], high[1], high[2]};
      from[normal] = to[normal] = side == 0 ? 0 : grid_.n[normal] - 1;
      face.grid = grid_;
      for (int a = 0; a < 3; ++a) face.grid.n[a] = to[a] - from[a] + 1;
      for (int z = from[2]; z <= to[2]; ++z)
        for (int y = from[1]; y <= to[1]; ++y)
          for (int x = from[0]; x <= to[0]; ++x) face.boundary.push_back(place[grid_.index(x, y, z)]);
      const double nodes = 0.3 * double(grid_.size()) / double(face.grid.size()) * thickness; // 0.3: measured
      const auto velocity = [=](double eigenvalue) {
        const double k2 = -eigenvalue * r * r, decay = 2 * std::sqrt(k2 + longest);
        return nodes * ((1 + (advection + 4 * bu2) * k2) / decay + 2 * bc2 * k2 * k2);
      };
      const auto rate = [=](double eigenvalue) {
        const double k2 = -eigenvalue * r * r, decay = 2 * std::sqrt(k2 + longest);
        return nodes * ((std::max(alpha2, 0.01) + bd2 * k2) / decay + 2 * bc2 * k2 * k2);
      };
      const auto make = [&](auto response) {
        return std::make_unique<BoxPoisson<Real>>(face.grid, cosines(face.grid), response);
      };
      face.u = make([=](double l) { return 1 / std::sqrt(velocity(l)); });
      face.inverseU = make([=](double l) { return std::sqrt(velocity(l)); });
      face.d = make([=](double l) { return 1 / std::sqrt(rate(l)); });
      face.inverseD = make([=](double l) { return std::sqrt(rate(l)); });
      faces_.push_back(std::move(face));
    }
    ++low[normal], --high[normal];
  }
}

// to = scale (map of each face) from, for three components of boundary values
template <class Real>
void VICSharpModel<Real>::applyFaces(const std::unique_ptr<BoxPoisson<Real>> Face::*map, const Real* from,
                                     Real scale, Real* to) const {
  const std::size_t count = boundary_.size();
  if (faces_.empty()) {
    for (std::size_t e = 0; e < 3 * count; ++e) to[e] = scale * from[e];
    return;
  }
#pragma omp parallel for collapse(2) schedule(dynamic)
  for (std::size_t f = 0; f < 6; ++f)
    for (int i = 0; i < 3; ++i) {
      const Face& face = faces_[f];
      Vector values(face.boundary.size());
      for (std::size_t e = 0; e < values.size(); ++e) values[e] = from[i * count + face.boundary[e]];
      (face.*map)->solve(values.data());
      for (std::size_t e = 0; e < values.size(); ++e) to[i * count + face.boundary[e]] = scale * values[e];
    }
}

template <class Real>
typename VICSharpModel<Real>::Vector VICSharpModel<Real>::unknowns(const State& state) const {
  const std::size_t n = grid_.size(), count = boundary_.size();
  Vector x(size(), 0);
  const auto boundaryOf = [&](const VectorField& field, const std::array<double, 3>& shift, double scale,
                              const std::unique_ptr<BoxPoisson<Real>> Face::*map, Real* to) {
    Vector values(3 * count);
    for (int i = 0; i < 3; ++i) {
      const Vector f = resample(state.grid, field[i].data(), grid_);
      for (std::size_t e = 0; e < count; ++e) values[i * count + e] = f[boundary_.node[e]] + Real(shift[i]);
    }
    applyFaces(map, values.data(), Real(1 / scale), to);
  };
  for (int i = 0; i < 3; ++i) {
    Vector w = resample(state.grid, state.vorticity[i].data(), grid_);
    for (Real& v : w) v *= Real(1 / constants_.vorticityScale());
    if (unsmooth_) unsmooth_->solve(w.data());
    std::copy(w.begin(), w.end(), x.begin() + i * n);
  }
  std::array<double, 3> shift; // both velocities are less their own mean
  for (int i = 0; i < 3; ++i) shift[i] = state.mean[i] - double(mean_[i]);
  boundaryOf(state.velocity, shift, constants_.velocityScale, &Face::inverseU, x.data() + 3 * n);
  if (hasRate() && !state.rate[0].empty())
    boundaryOf(state.rate, {0, 0, 0}, constants_.accelerationScale, &Face::inverseD,
               x.data() + 3 * (n + count));
  if (!inside_.empty() && !state.source[0].empty())
    for (int i = 0; i < 3; ++i) {
      const Vector q = resample(state.grid, state.source[i].data(), grid_);
      for (std::size_t e = 0; e < inside_.size(); ++e)
        x[3 * (n + 2 * count) + i * inside_.size() + e] = q[inside_[e]] / Real(sourceScale());
    }
  return x;
}

template <class Real>
void VICSharpModel<Real>::makeFaceLaplacian() {
  std::vector<std::uint32_t> place(grid_.size());
  for (std::size_t e = 0; e < boundary_.size(); ++e) place[boundary_.node[e]] = std::uint32_t(e);
  const std::ptrdiff_t stride[3] = {1, grid_.n[0], std::ptrdiff_t(grid_.n[0]) * grid_.n[1]};
  for (std::size_t e = 0; e < boundary_.size(); ++e) {
    if (boundary_.inside[e] < 0) continue;
    const std::ptrdiff_t node = std::ptrdiff_t(boundary_.node[e]),
                         normal = std::abs(boundary_.inside[e] - node);
    FaceLaplacian s{std::uint32_t(e), {}, {}};
    int t = 0;
    for (int a = 0; a < 3; ++a) {
      if (stride[a] == normal) continue;
      s.neighbour[2 * t] = place[node - stride[a]];
      s.neighbour[2 * t + 1] = place[node + stride[a]];
      s.weight[t++] = stencils_.inverseSquare(a);
    }
    faceLaplacian_.push_back(s);
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
  AxisBasis basis = reflectionBasis(d.transpose() * d);
  basis.values[0] = 0;
  return basis;
}

// L f = -curl source inside, f = b on the boundary
template <class Real>
void VICSharpModel<Real>::solveCurl(const VectorField& source, const Vector& b, VectorField& f) const {
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
      const Real value = b[i * count + e];
      f[i][boundary_.node[e]] = value;
      if (boundary_.inside[e] >= 0) f[i][boundary_.inside[e]] -= Real(boundary_.weight[e]) * value;
    }
  poisson_.solve(pointers(f).data(), 3);
}

// From dJ/df: dJ/d(right-hand side) inside (0 on the boundary) in its place, and bBar += dJ/db
template <class Real>
void VICSharpModel<Real>::solveCurlTransposed(VectorField& bar, Vector& bBar) const {
  poisson_.solve(pointers(bar).data(), 3);
  const std::size_t count = boundary_.size();
#pragma omp parallel for
  for (int i = 0; i < 3; ++i)
    for (std::size_t e = 0; e < count; ++e) {
      Real value = bar[i][boundary_.node[e]];
      if (boundary_.inside[e] >= 0) value -= Real(boundary_.weight[e]) * bar[i][boundary_.inside[e]];
      bBar[i * count + e] += value;
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
  const Real sw = Real(constants_.vorticityScale());
  for (int i = 0; i < 3; ++i) // w = sw F c
#pragma omp parallel for simd
    for (std::size_t e = 0; e < n; ++e) w_[i][e] = sw * x[i * n + e];
  if (smooth_) smooth_->solve(pointers(w_).data(), 3);
  applyFaces(&Face::u, x.data() + 3 * n, Real(constants_.velocityScale), uBoundary_.data());
  solveCurl(w_, uBoundary_, u_);
  if (!hasRate()) return;
  transport();
  freeInside(x.data() + 3 * (n + 2 * boundary_.size()));
  applyFaces(&Face::d, x.data() + 3 * (n + boundary_.size()), Real(constants_.accelerationScale),
             dBoundary_.data());
  solveCurl(q_, dBoundary_, d_);
  materialAcceleration();
}

namespace {

/// The sum over particles of weight Huber(|P f - data|^2), and bar += its adjoint
template <class Real>
double dataMisfit(const Sampler<Real>& sampler, const std::array<std::vector<Real>, 3>& field,
                  const std::array<std::vector<Real>, 3>& data, const std::vector<Real>& particleWeight,
                  double threshold, double weight, std::array<std::vector<Real>, 3>& residual,
                  std::vector<double>& squares, std::array<std::vector<Real>, 3>& bar) {
  const std::size_t count = sampler.size();
  squares.resize(count);
  for (int i = 0; i < 3; ++i) {
    residual[i].resize(count);
    sampler.sample(field[i].data(), residual[i].data());
    for (std::size_t p = 0; p < count; ++p) residual[i][p] -= data[i][p];
  }
  double sum = 0;
  for (std::size_t p = 0; p < count; ++p) {
    double square = 0;
    for (int i = 0; i < 3; ++i) square += double(residual[i][p]) * double(residual[i][p]);
    squares[p] = square;
    const Huber huber(square, threshold);
    const double w = particleWeight.empty() ? 1 : double(particleWeight[p]);
    sum += w * huber.value;
    for (int i = 0; i < 3; ++i) residual[i][p] *= Real(2 * weight * w * huber.slope);
  }
  for (int i = 0; i < 3; ++i) sampler.addTransposed(residual[i].data(), bar[i].data());
  return weight * sum;
}

} // namespace

// |P u - u_p|^2/(Np su^2)
template <class Real>
double VICSharpModel<Real>::velocityMisfit() {
  return dataMisfit(sampler_, u_, velocityData_, velocityWeight_, constants_.velocityOutlier,
                    1 / (double(sampler_.size()) * square(constants_.velocityScale)), sampled_,
                    velocityMisfits_, uBar_);
}

// alpha^2 |P a - a_p|^2/(Np sa^2)
template <class Real>
double VICSharpModel<Real>::accelerationMisfit() {
  return dataMisfit(sampler_, a_, accelerationData_, accelerationWeight_, constants_.accelerationOutlier,
                    square(constants_.accelerationWeight / constants_.accelerationScale) /
                        double(sampler_.size()),
                    sampled_, accelerationMisfits_, aBar_);
}

// weight |div f|^2; bar_i += 2 weight D_i^T div f
template <class Real>
double VICSharpModel<Real>::penaliseDivergence(const VectorField& f, double weight, VectorField& bar) {
  if (weight == 0) return 0;
  const int n = grid_.n[0];
  const double sum = sumOverRows<Real, 1>(grid_, 0, [&](int j, int k, RowBuffers<Real>&) {
    Real* row = scalar_.data() + grid_.index(0, j, k);
    stencils_.derivative(f[0].data(), 0, j, k, row);
    stencils_.addDerivative(f[1].data(), 1, j, k, 1, row);
    stencils_.addDerivative(f[2].data(), 2, j, k, 1, row);
    return std::array<double, 1>{squares(row, n)};
  })[0];
  forEachRow<Real>(grid_, 0, [&](int j, int k, RowBuffers<Real>&) {
    for (int i = 0; i < 3; ++i)
      stencils_.addDerivativeTransposed(scalar_.data(), i, j, k, Real(2 * weight),
                                        bar[i].data() + grid_.index(0, j, k));
  });
  return weight * sum;
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

// bc^2 r^4 <|L w|^2>/sw^2; its adjoint is added to wBar
template <class Real>
double VICSharpModel<Real>::penaliseCurvature() {
  const double r = constants_.particleSpacing,
               weight = square(constants_.curvatureWeight * r * r / constants_.vorticityScale()) /
                        double(grid_.size());
  if (weight == 0) return 0;
  double sum = 0;
  for (int i = 0; i < 3; ++i) {
    sum += sumOverRows<Real, 1>(grid_, 0, [&](int j, int k, RowBuffers<Real>&) {
      Real* row = scalar_.data() + grid_.index(0, j, k);
      std::fill_n(row, grid_.n[0], Real(0));
      stencils_.addLaplacian(w_[i].data(), j, k, 1, row);
      if (smoothness_.empty()) return std::array<double, 1>{squares(row, grid_.n[0])};
      const Real* part = smoothness_.data() + grid_.index(0, j, k);
      double square = 0;
      for (int e = 0; e < grid_.n[0]; ++e) {
        square += double(row[e]) * double(row[e]) * double(part[e]);
        row[e] *= part[e];
      }
      return std::array<double, 1>{square};
    })[0];
    forEachRow<Real>(grid_, 0, [&](int j, int k, RowBuffers<Real>&) {
      stencils_.addLaplacianTransposed(scalar_.data(), j, k, Real(2 * weight),
                                       wBar_[i].data() + grid_.index(0, j, k));
    });
  }
  return weight * sum;
}

// bc^2 2 r^5 A/V <|Lt b|^2>/scale^2 on the faces; bBar = its adjoint
template <class Real>
double VICSharpModel<Real>::penaliseBoundaryCurvature(const Vector& b, double scale, Vector& bBar) const {
  std::fill(bBar.begin(), bBar.end(), Real(0));
  if (faceLaplacian_.empty() || constants_.curvatureWeight == 0) return 0;
  const double weight = 2 * square(constants_.curvatureWeight / scale) *
                        std::pow(constants_.particleSpacing, 5) * areaOverVolume_ /
                        double(faceLaplacian_.size());
  const std::size_t count = boundary_.size();
  double sums[3] = {};
#pragma omp parallel for
  for (int i = 0; i < 3; ++i) {
    const Real* v = b.data() + i * count;
    Real* g = bBar.data() + i * count;
    for (const FaceLaplacian& s : faceLaplacian_) {
      const std::uint32_t* e = s.neighbour;
      const Real wa = s.weight[0], wb = s.weight[1], twice = 2 * v[s.centre];
      const Real l = wa * (v[e[0]] + v[e[1]] - twice) + wb * (v[e[2]] + v[e[3]] - twice);
      sums[i] += double(l) * double(l);
      const Real f = Real(2 * weight) * l;
      g[e[0]] += f * wa, g[e[1]] += f * wa, g[e[2]] += f * wb, g[e[3]] += f * wb;
      g[s.centre] -= 2 * f * (wa + wb);
    }
  }
  return weight * (sums[0] + sums[1] + sums[2]);
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
  const VICSharpConstants& k = constants_;
  const double nodes = double(grid_.size()), r = k.particleSpacing, sw = k.vorticityScale(),
               sa = k.accelerationScale;
  const std::size_t n = grid_.size(), count = boundary_.size();
  forward(x);
  terms_ = {};
  for (auto* field : {&uBar_, &wBar_})
    for (auto& component : *field) std::fill(component.begin(), component.end(), Real(0));

  terms_.velocity = velocityMisfit();
  terms_.divergence = penaliseDivergence(u_, square(k.divergenceWeight / sw) / nodes, uBar_);
  terms_.vorticityDivergence =
      penaliseDivergence(w_, square(k.vorticityDivergenceWeight * r / sw) / nodes, wBar_);
  terms_.curvature = penaliseCurvature();
  double accelerationTerm = 0;
  if (hasRate()) {
    if (hasPressure()) {
      terms_.navierStokes = penaliseMomentum();
      momentumTransposed();
    } else {
      for (auto& component : aBar_) std::fill(component.begin(), component.end(), Real(0));
    }
    if (hasAccelerationData()) {
      accelerationTerm = accelerationMisfit();
      terms_.acceleration = accelerationTerm / square(k.accelerationWeight);
    }
    dBar_ = aBar_;
    terms_.accelerationDivergence =
        penaliseDivergence(d_, square(k.accelerationDivergenceWeight * r / sa) / nodes, dBar_);
    terms_.curvature += penaliseBoundaryCurvature(dBoundary_, sa, boundaryBar_);
    solveCurlTransposed(dBar_, boundaryBar_);
    applyFaces(&Face::d, boundaryBar_.data(), Real(sa), gradient.data() + 3 * (n + count));
    addCurlTransposed(dBar_, Real(-1), q_, false); // q_ = dJ/dq from here on
    const std::size_t source = 3 * (n + 2 * count);
    terms_.curvature += freeInsideTransposed(x.data() + source, gradient.data() + source);
    transportTransposed();
  }
  terms_.curvature += penaliseBoundaryCurvature(uBoundary_, k.velocityScale, boundaryBar_);
  solveCurlTransposed(uBar_, boundaryBar_);
  applyFaces(&Face::u, boundaryBar_.data(), Real(k.velocityScale), gradient.data() + 3 * n);
  addCurlTransposed(uBar_, Real(-1), wBar_, true);
  if (smooth_) smooth_->solve(pointers(wBar_).data(), 3);
  for (int i = 0; i < 3; ++i)
#pragma omp parallel for simd
    for (std::size_t e = 0; e < n; ++e) gradient[i * n + e] = Real(sw) * wBar_[i][e];
  return terms_.velocity + accelerationTerm + terms_.divergence + terms_.vorticityDivergence +
         terms_.accelerationDivergence + terms_.navierStokes + terms_.curvature;
}

template class VICSharpModel<float>;
template class VICSharpModel<double>;

} // namespace rimflow
