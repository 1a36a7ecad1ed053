#include "VICSharpModel.h"

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

double square(double v) { return v * v; }

// Measured on a sphere at Re = 100, 14 spacings wide: near and far from it, 0.003 to 0.03 and 1.5 to 3 do
// nearly as well.
constexpr double WallSmoothness = 0.01; // bc^2 at a wall, over bc^2 far from it
constexpr double WallReach = 2;         // of the wall on bc^2, in mean particle spacings
constexpr double SourcePenalty = 1e-3;  // of f^2; keeps sources finite that no particle sees

// The eigenvectors of the second difference with zeros at the ends. Its eigenvalues are those of the compact
// difference of fourth order, (1 + h^2/12 delta)^-1 delta.
AxisBasis pressureBasis(const Grid& grid, int axis, int order) {
  AxisBasis basis = dirichletBasis(grid.n[axis], grid.spacing[axis]);
  if (order == 4)
    basis.values = basis.values.array() / (1 + square(grid.spacing[axis]) / 12 * basis.values.array());
  return basis;
}

// The modes of a line with free ends, the eigenvectors of the squared second difference; the values are -k^2.
AxisBasis freeBasis(const Grid& grid, int axis) {
  const int n = grid.n[axis];
  Eigen::MatrixXd difference = Eigen::MatrixXd::Zero(n - 2, n);
  for (int i = 0; i + 2 < n; ++i) difference.block<1, 3>(i, i) << 1, -2, 1;
  AxisBasis basis = reflectionBasis(difference.transpose() * difference);
  for (double& value : basis.values) value = -std::sqrt(std::max(value, 0.)) / square(grid.spacing[axis]);
  return basis;
}

std::array<AxisBasis, 3> cosines(const Grid& grid) {
  return {neumannBasis(grid.n[0], grid.spacing[0]), neumannBasis(grid.n[1], grid.spacing[1]),
          neumannBasis(grid.n[2], grid.spacing[2])};
}

} // namespace

template <class Real>
VICSharpModel<Real>::VICSharpModel(const Grid& grid, const VICSharpData& data,
                                   const VICSharpConstants& constants)
    : grid_(grid), constants_(constants), stencils_(grid, constants.order),
      poisson_(grid, {pressureBasis(grid, 0, constants.order), pressureBasis(grid, 1, constants.order),
                      pressureBasis(grid, 2, constants.order)}),
      boundary_(grid), sampler_(grid, data.position.data(), data.size(), constants.order),
      velocityData_(byComponent<Real>(data.velocity)),
      accelerationData_(byComponent<Real>(data.acceleration)),
      velocityWeight_(data.velocityWeight.begin(), data.velocityWeight.end()),
      accelerationWeight_(data.accelerationWeight.begin(), data.accelerationWeight.end()) {
  for (int c = 0; c < 3; ++c) {
    mean_[c] = Real(data.meanVelocity[c]);
    areaOverVolume_ += 2 / ((grid.n[c] - 1) * grid.spacing[c]);
  }
  const std::size_t n = grid_.size();
  allocate(potential_, n), allocate(u_, n), allocate(work_, n), allocate(uBar_, n);
  boundaryPressure_.resize(boundary_.size());
  boundaryBar_.resize(boundary_.size());
  if (hasAccelerationData()) {
    allocate(a_, n), allocate(aBar_, n);
    for (auto& component : gradient_) component.assign(n, 0);
    p_.assign(n, 0), pBar_.assign(n, 0);
  }
  for (int a = 0; a < 3; ++a) modes_[a] = freeBasis(grid_, a);
  // A boundary value b enters delta p as b/h^2 at the first node inside; (1 + h^2/12 delta)^-1 spreads it.
  const double decay = -5 + std::sqrt(24.);
  const int inside = std::min({grid.n[0], grid.n[1], grid.n[2]}) - 2;
  if (constants.order == 2) reach_ = {1};
  for (int t = 0; constants.order == 4 && t < std::min(8, inside); ++t)
    reach_.push_back(Real(-12 * std::pow(decay, t + 1)));
  makeFaceLaplacian();
  findInside();
  makePreconditioners();
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
                     near = std::exp(-square(std::max(0., distance) / (WallReach * r))),
                     share = 0.5 - distance / h;
        const std::size_t node = grid_.index(i, j, k);
        smoothness_[node] =
            Real((1 - (1 - WallSmoothness) * near) * (distance < 0 ? constants_.insideSmoothness : 1));
        if (share <= 0 || !hasAccelerationData()) continue;
        inside_.push_back(std::uint32_t(node));
        insideShare_.push_back(Real(std::min(share, 1.)));
      }
}

template <class Real>
typename VICSharpModel<Real>::State VICSharpModel<Real>::state() const {
  State out{grid_, potential_, p_, {}};
  if (inside_.empty()) return out;
  out.source.assign(grid_.size(), 0);
  for (std::size_t e = 0; e < inside_.size(); ++e) out.source[inside_[e]] = Real(sourceScale()) * source_[e];
  return out;
}

template <class Real>
void VICSharpModel<Real>::setWeights(const VICSharpConstants& to) {
  const bool again = to.curvatureWeight != constants_.curvatureWeight ||
                     to.accelerationWeight != constants_.accelerationWeight;
  constants_.curvatureWeight = to.curvatureWeight;
  constants_.accelerationWeight = to.accelerationWeight;
  constants_.velocityOutlier = to.velocityOutlier;
  constants_.accelerationOutlier = to.accelerationOutlier;
  if (again) makePreconditioners();
}

// 2 bc (k r)^4 for one wave of the potential
template <class Real>
double VICSharpModel<Real>::bending(double eigenvalue) const {
  return 2 * constants_.curvatureWeight * square(eigenvalue * square(constants_.particleSpacing));
}

// The Hessian of J for one wave of the potential in an unbounded fluid, times the number of nodes
template <class Real>
double VICSharpModel<Real>::hessian(double eigenvalue) const {
  double longest = 0; // no wave is longer than twice the box
  for (int a = 0; a < 3; ++a) longest = std::max(longest, (grid_.n[a] - 1) * grid_.spacing[a]);
  const double k2 = std::max(-eigenvalue, square(M_PI / longest)) * square(constants_.particleSpacing),
               alpha2 = hasAccelerationData() ? square(constants_.accelerationWeight) : 0,
               friction = k2 * constants_.frictionScale() / constants_.accelerationScale;
  return k2 * (1 + alpha2 * (2 + square(friction))) + square(bending(eigenvalue));
}

// F and Fb = H^-1/2, so that every unknown has the same scale. The Hessian of a boundary pressure is that of
// a wave that falls off as exp(-k z) inwards.
template <class Real>
void VICSharpModel<Real>::makePreconditioners() {
  smooth_ = std::make_unique<BoxPoisson<Real>>(grid_, modes_,
                                               [this](double l) { return 1 / std::sqrt(hessian(l)); });
  if (smoothness_.empty())
    prior_ = smooth_->perMode([this](double l) { return square(bending(l)) / hessian(l); });
  else
    bend_ = std::make_unique<BoxPoisson<Real>>(
        grid_, modes_, [this](double l) { return bending(l) / std::sqrt(hessian(l)); });
  faces_.clear();
  if (!hasAccelerationData()) return;
  const double r = constants_.particleSpacing,
               alpha2 = square(constants_.accelerationWeight * constants_.pressureGradientScale() /
                               constants_.accelerationScale),
               bc2 = square(constants_.curvatureWeight), thickness = r * areaOverVolume_;
  std::vector<std::size_t> place(grid_.size());
  for (std::size_t e = 0; e < boundary_.size(); ++e) place[boundary_.node[e]] = e;
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
      const double nodes = double(grid_.size()) / double(face.grid.size()) * thickness,
                   longest = std::max({face.grid.n[0], face.grid.n[1], face.grid.n[2]}) * grid_.spacing[0];
      const auto pressure = [=](double eigenvalue) {
        const double k2 = std::max(-eigenvalue, square(M_PI / longest)) * r * r;
        return nodes * (0.3 * alpha2 * std::sqrt(k2) + 2 * bc2 * k2 * k2); // 0.3: measured
      };
      face.smooth = std::make_unique<BoxPoisson<Real>>(face.grid, cosines(face.grid),
                                                       [=](double l) { return 1 / std::sqrt(pressure(l)); });
      face.unsmooth = std::make_unique<BoxPoisson<Real>>(face.grid, cosines(face.grid),
                                                         [=](double l) { return std::sqrt(pressure(l)); });
      faces_.push_back(std::move(face));
    }
    ++low[normal], --high[normal];
  }
}

// to = scale (map of each face) from
template <class Real>
void VICSharpModel<Real>::applyFaces(const std::unique_ptr<BoxPoisson<Real>> Face::*map, const Real* from,
                                     Real scale, Real* to) const {
#pragma omp parallel for schedule(dynamic)
  for (std::size_t f = 0; f < faces_.size(); ++f) {
    const Face& face = faces_[f];
    Vector values(face.boundary.size());
    for (std::size_t e = 0; e < values.size(); ++e) values[e] = from[face.boundary[e]];
    (face.*map)->solve(values.data());
    for (std::size_t e = 0; e < values.size(); ++e) to[face.boundary[e]] = scale * values[e];
  }
}

template <class Real>
typename VICSharpModel<Real>::Vector VICSharpModel<Real>::unknowns(const State& state) const {
  const std::size_t n = grid_.size(), count = boundary_.size();
  Vector x(size(), 0);
  const BoxPoisson<Real> unsmooth(grid_, modes_, [this](double l) { return std::sqrt(hessian(l)); });
  for (int i = 0; i < 3; ++i) {
    Vector potential = resample(state.grid, state.potential[i].data(), grid_);
    for (Real& value : potential) value *= Real(1 / potentialScale());
    Real* field = potential.data();
    unsmooth.toModes(&field, 1);
    std::copy(potential.begin(), potential.end(), x.begin() + i * n);
  }
  if (!hasAccelerationData() || state.pressure.empty()) return x;
  const Vector p = resample(state.grid, state.pressure.data(), grid_);
  Vector values(count);
  for (std::size_t e = 0; e < count; ++e) values[e] = p[boundary_.node[e]];
  applyFaces(&Face::unsmooth, values.data(), Real(1 / pressureScale()), x.data() + 3 * n);
  if (inside_.empty() || state.source.empty()) return x;
  const Vector source = resample(state.grid, state.source.data(), grid_);
  for (std::size_t e = 0; e < inside_.size(); ++e)
    x[3 * n + count + e] = source[inside_[e]] / Real(sourceScale());
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

// out = curl f
template <class Real>
void VICSharpModel<Real>::curl(const VectorField& f, VectorField& out) const {
  forEachRow<Real>(grid_, 0, [&](int j, int k, RowBuffers<Real>&) {
    for (int i = 0; i < 3; ++i) {
      const int l = (i + 1) % 3, m = (i + 2) % 3;
      Real* row = out[i].data() + grid_.index(0, j, k);
      std::fill_n(row, grid_.n[0], Real(0));
      stencils_.addDerivative(f[m].data(), l, j, k, 1, row);
      stencils_.addDerivative(f[l].data(), m, j, k, Real(-1), row);
    }
  });
}

// out = curl^T bar
template <class Real>
void VICSharpModel<Real>::curlTransposed(const VectorField& bar, VectorField& out) const {
  forEachRow<Real>(grid_, 0, [&](int j, int k, RowBuffers<Real>&) {
    for (int i = 0; i < 3; ++i) {
      const int l = (i + 1) % 3, m = (i + 2) % 3;
      Real* row = out[i].data() + grid_.index(0, j, k);
      std::fill_n(row, grid_.n[0], Real(0));
      stencils_.addDerivativeTransposed(bar[m].data(), l, j, k, Real(-1), row); // (curl)_m has -D_l of i
      stencils_.addDerivativeTransposed(bar[l].data(), m, j, k, 1, row);        // (curl)_l has +D_m of i
    }
  });
}

// f(node, weight): minus the weight times a boundary value is its part of M p = ... at that node
template <class Real>
template <class F>
void VICSharpModel<Real>::forEachReached(std::size_t e, F&& f) const {
  if (boundary_.inside[e] < 0) return;
  const std::ptrdiff_t step = boundary_.inside[e] - std::ptrdiff_t(boundary_.node[e]);
  for (std::size_t t = 0; t < reach_.size(); ++t)
    f(std::size_t(boundary_.inside[e] + std::ptrdiff_t(t) * step), Real(boundary_.weight[e]) * reach_[t]);
}

// M p = -Gu_ij Gu_ji, within walls and voids (1 - s) (...) + s f; p = b on the boundary
template <class Real>
void VICSharpModel<Real>::solvePressure(const Real* source) {
  const int n = grid_.n[0];
  forEachRow<Real>(grid_, 0, [&](int j, int k, RowBuffers<Real>&) {
    const std::size_t first = grid_.index(0, j, k);
    std::array<Real*, 9> g;
    for (int i = 0; i < 3; ++i)
      for (int l = 0; l < 3; ++l) {
        g[3 * i + l] = gradient_[3 * i + l].data() + first;
        stencils_.derivative(u_[i].data(), l, j, k, g[3 * i + l]);
      }
    Real* p = p_.data() + first;
#pragma omp simd
    for (int e = 0; e < n; ++e)
      p[e] = -(g[0][e] * g[0][e] + g[4][e] * g[4][e] + g[8][e] * g[8][e] +
               2 * (g[1][e] * g[3][e] + g[2][e] * g[6][e] + g[5][e] * g[7][e]));
  });
  const Real scale = Real(sourceScale());
  for (std::size_t e = 0; e < inside_.size(); ++e) {
    Real& p = p_[inside_[e]];
    p += insideShare_[e] * (scale * source[e] - p);
  }
  source_.assign(source, source + inside_.size());
  for (std::size_t e = 0; e < boundary_.size(); ++e) {
    p_[boundary_.node[e]] = boundaryPressure_[e];
    forEachReached(e, [&](std::size_t node, Real weight) { p_[node] -= weight * boundaryPressure_[e]; });
  }
  poisson_.solve(p_.data());
}

// From pBar_ = dJ/dp: boundaryBar_ += dJ/db, sourceBar = dJ/df with its penalty's part, and uBar_
template <class Real>
double VICSharpModel<Real>::solvePressureTransposed(const Real* source, Real* sourceBar) {
  poisson_.solve(pBar_.data());
  for (std::size_t e = 0; e < boundary_.size(); ++e) {
    Real& value = pBar_[boundary_.node[e]];
    forEachReached(e, [&](std::size_t node, Real weight) { value -= weight * pBar_[node]; });
    boundaryBar_[e] += value;
    value = 0;
  }
  const Real scale = Real(sourceScale());
  const double ridge = SourcePenalty / double(grid_.size());
  double sum = 0;
  for (std::size_t e = 0; e < inside_.size(); ++e) {
    Real& bar = pBar_[inside_[e]];
    sum += square(double(source[e]));
    sourceBar[e] = scale * insideShare_[e] * bar + Real(2 * ridge) * source[e];
    bar *= 1 - insideShare_[e];
  }
  for (auto& g : gradient_)
#pragma omp parallel for simd
    for (std::size_t e = 0; e < pBar_.size(); ++e) g[e] *= -2 * pBar_[e];
  forEachRow<Real>(grid_, 0, [&](int j, int k, RowBuffers<Real>&) {
    for (int i = 0; i < 3; ++i)
      for (int l = 0; l < 3; ++l)
        stencils_.addDerivativeTransposed(gradient_[3 * l + i].data(), l, j, k, 1,
                                          uBar_[i].data() + grid_.index(0, j, k));
  });
  return ridge * sum;
}

// a_i = -D_i p + nu (L u)_i
template <class Real>
void VICSharpModel<Real>::materialAcceleration() {
  const int n = grid_.n[0];
  const Real nu = Real(constants_.viscosity);
  forEachRow<Real>(grid_, 0, [&](int j, int k, RowBuffers<Real>&) {
    for (int i = 0; i < 3; ++i) {
      Real* a = a_[i].data() + grid_.index(0, j, k);
      std::fill_n(a, n, Real(0));
      stencils_.addDerivative(p_.data(), i, j, k, Real(-1), a);
      if (nu != 0) stencils_.addLaplacian(u_[i].data(), j, k, nu, a);
    }
  });
}

// From aBar_ = dJ/da: pBar_ and its part of uBar_
template <class Real>
void VICSharpModel<Real>::materialAccelerationTransposed() {
  const Real nu = Real(constants_.viscosity);
  forEachRow<Real>(grid_, 0, [&](int j, int k, RowBuffers<Real>&) {
    const std::size_t first = grid_.index(0, j, k);
    std::fill_n(pBar_.data() + first, grid_.n[0], Real(0));
    for (int i = 0; i < 3; ++i) {
      stencils_.addDerivativeTransposed(aBar_[i].data(), i, j, k, Real(-1), pBar_.data() + first);
      if (nu != 0) stencils_.addLaplacianTransposed(aBar_[i].data(), j, k, nu, uBar_[i].data() + first);
    }
  });
}

template <class Real>
void VICSharpModel<Real>::forward(const Vector& x) {
  const std::size_t n = grid_.size();
  const Real scale = Real(potentialScale());
  for (int i = 0; i < 3; ++i)
#pragma omp parallel for simd
    for (std::size_t e = 0; e < n; ++e) potential_[i][e] = scale * x[i * n + e];
  smooth_->fromModes(pointers(potential_).data(), 3);
  curl(potential_, u_);
  if (!hasAccelerationData()) return;
  applyFaces(&Face::smooth, x.data() + 3 * n, Real(pressureScale()), boundaryPressure_.data());
  solvePressure(x.data() + 3 * n + boundary_.size());
  materialAcceleration();
}

template <class Real>
void VICSharpModel<Real>::accelerationOfSteadiestFlow(const std::array<double, 3>& frame) {
  allocate(a_, grid_.size()), allocate(aBar_, grid_.size());
  p_.assign(grid_.size(), 0);
  const int n = grid_.n[0];
  const Real nu = Real(constants_.viscosity);
  VectorField& c = aBar_; // U_j Gu_ij - nu (L u)_i
  forEachRow<Real>(grid_, 1, [&](int j, int k, RowBuffers<Real>& rows) {
    const std::size_t first = grid_.index(0, j, k);
    for (int i = 0; i < 3; ++i) {
      Real *out = c[i].data() + first, *gradient = rows(0);
      for (int l = 0; l < 3; ++l) {
        const Real* u = u_[l].data() + first;
        stencils_.derivative(u_[i].data(), l, j, k, gradient);
        const Real relative = mean_[l] - Real(frame[l]);
        for (int e = 0; e < n; ++e) out[e] += (u[e] + relative) * gradient[e];
      }
      if (nu != 0) stencils_.addLaplacian(u_[i].data(), j, k, -nu, out);
    }
  });
  forEachRow<Real>(grid_, 0, [&](int j, int k, RowBuffers<Real>&) {
    for (int i = 0; i < 3; ++i)
      stencils_.addDerivativeTransposed(c[i].data(), i, j, k, Real(-1), p_.data() + grid_.index(0, j, k));
  });
  // The normal equations: the sum of D_i^T D_i p = -the sum of D_i^T c_i
  BoxPoisson<Real>(grid_, {normalBasis(0), normalBasis(1), normalBasis(2)}).solve(p_.data());
  materialAcceleration();
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

namespace {

/// The sum over particles of weight Huber(|P f - data|^2), and bar += its adjoint
template <class Real>
double dataMisfit(const Sampler<Real>& sampler, const std::array<std::vector<Real>, 3>& field,
                  const std::array<std::vector<Real>, 3>& data, const std::vector<Real>& particleWeight,
                  double threshold, double weight, std::array<std::vector<Real>, 3>& residual,
                  std::vector<double>& squares, std::array<std::vector<Real>, 3>& bar) {
  const std::size_t count = sampler.size();
  squares.resize(count);
  for (auto& component : residual) component.resize(count);
  sampler.sample(field, residual);
  double sum = 0;
  for (std::size_t p = 0; p < count; ++p) {
    double square = 0;
    for (int i = 0; i < 3; ++i) {
      residual[i][p] -= data[i][p];
      square += double(residual[i][p]) * double(residual[i][p]);
    }
    squares[p] = square;
    const Huber huber(square, threshold);
    const double w = particleWeight.empty() ? 1 : double(particleWeight[p]);
    sum += w * huber.value;
    for (int i = 0; i < 3; ++i) residual[i][p] *= Real(2 * weight * w * huber.slope);
  }
  sampler.addTransposed(residual, bar);
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

// 4 bc^2 <r^8 |L L A|^2>/(su r)^2; gradient = its derivative
template <class Real>
double VICSharpModel<Real>::penaliseCurvature(const Vector& x, Vector& gradient) {
  const std::size_t n = grid_.size();
  const Real twice = Real(2 / double(n));
  const Vector& weight = smoothness_.empty() ? prior_ : smoothness_;
  if (bend_) {
    for (int i = 0; i < 3; ++i) std::copy_n(x.begin() + i * n, n, work_[i].begin());
    bend_->fromModes(pointers(work_).data(), 3);
  }
  double sum = 0;
  for (int i = 0; i < 3; ++i) {
    const Real* f = bend_ ? work_[i].data() : x.data() + i * n;
    Real* out = bend_ ? work_[i].data() : gradient.data() + i * n;
    sum += sumOverRows<Real, 1>(grid_, 0, [&](int j, int k, RowBuffers<Real>&) {
      const std::size_t first = grid_.index(0, j, k);
      double row = 0;
#pragma omp simd reduction(+ : row)
      for (std::size_t e = first; e < first + grid_.n[0]; ++e) {
        const Real weighted = weight[e] * f[e];
        row += double(weighted) * double(f[e]);
        out[e] = twice * weighted;
      }
      return std::array<double, 1>{row};
    })[0];
  }
  if (bend_) {
    bend_->toModes(pointers(work_).data(), 3);
    for (int i = 0; i < 3; ++i) std::copy_n(work_[i].begin(), n, gradient.begin() + i * n);
  }
  return sum / double(n);
}

// bc^2 2 r^5 A/V <|Lt p|^2>/(sg r)^2 on the faces; boundaryBar_ = its adjoint
template <class Real>
double VICSharpModel<Real>::penaliseBoundaryCurvature() {
  std::fill(boundaryBar_.begin(), boundaryBar_.end(), Real(0));
  if (faceLaplacian_.empty()) return 0;
  const double weight = 2 * square(constants_.curvatureWeight / pressureScale()) *
                        std::pow(constants_.particleSpacing, 5) * areaOverVolume_ /
                        double(faceLaplacian_.size());
  const Real* v = boundaryPressure_.data();
  Real* g = boundaryBar_.data();
  double sum = 0;
  for (const FaceLaplacian& s : faceLaplacian_) {
    const std::uint32_t* e = s.neighbour;
    const Real wa = s.weight[0], wb = s.weight[1], twice = 2 * v[s.centre];
    const Real l = wa * (v[e[0]] + v[e[1]] - twice) + wb * (v[e[2]] + v[e[3]] - twice);
    sum += double(l) * double(l);
    const Real f = Real(2 * weight) * l;
    g[e[0]] += f * wa, g[e[1]] += f * wa, g[e[2]] += f * wb, g[e[3]] += f * wb;
    g[s.centre] -= 2 * f * (wa + wb);
  }
  return weight * sum;
}

template <class Real>
double VICSharpModel<Real>::cost(const Vector& x, Vector& gradient) {
  const std::size_t n = grid_.size();
  forward(x);
  for (auto& component : uBar_) std::fill(component.begin(), component.end(), Real(0));
  double sum = velocityMisfit();
  if (hasAccelerationData()) {
    for (auto& component : aBar_) std::fill(component.begin(), component.end(), Real(0));
    sum += accelerationMisfit();
    materialAccelerationTransposed();
    sum += penaliseBoundaryCurvature();
    const std::size_t source = 3 * n + boundary_.size();
    sum += solvePressureTransposed(x.data() + source, gradient.data() + source);
    applyFaces(&Face::smooth, boundaryBar_.data(), Real(pressureScale()), gradient.data() + 3 * n);
  }
  sum += penaliseCurvature(x, gradient);
  curlTransposed(uBar_, work_); // dJ/dA
  smooth_->toModes(pointers(work_).data(), 3);
  const Real scale = Real(potentialScale());
  for (int i = 0; i < 3; ++i)
#pragma omp parallel for simd
    for (std::size_t e = 0; e < n; ++e) gradient[i * n + e] += scale * work_[i][e];
  return sum;
}

template class VICSharpModel<float>;
template class VICSharpModel<double>;

} // namespace rimflow
