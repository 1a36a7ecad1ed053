#include "BoxPoisson.h"

#include <cmath>
#include <stdexcept>

namespace rimflow {

AxisBasis dirichletBasis(int n, double spacing) {
  const int m = n - 2;
  if (m < 1) throw std::invalid_argument("The Poisson solver needs at least 3 nodes per axis.");
  AxisBasis basis;
  basis.first = 1;
  basis.vectors.resize(m, m);
  basis.values.resize(m);
  const double angle = M_PI / (m + 1), norm = std::sqrt(2. / (m + 1));
  for (int k = 0; k < m; ++k) {
    // -4 sin^2(x/2) keeps the digits that 2 cos x - 2 loses for the longest waves.
    const double half = std::sin(0.5 * angle * (k + 1));
    basis.values[k] = -4 * half * half / (spacing * spacing);
    // The product is reduced to one period first: sin of a large angle would lose digits.
    for (int i = 0; i < m; ++i)
      basis.vectors(i, k) = norm * std::sin(angle * (long(i + 1) * (k + 1) % (2 * (m + 1))));
  }
  return basis;
}

AxisBasis neumannBasis(int n, double spacing) {
  AxisBasis basis;
  basis.vectors.resize(n, n);
  basis.values.resize(n);
  const double angle = M_PI / n;
  for (int k = 0; k < n; ++k) {
    const double half = std::sin(0.5 * angle * k);
    basis.values[k] = -4 * half * half / (spacing * spacing);
    const double norm = std::sqrt((k == 0 ? 1. : 2.) / n);
    for (int i = 0; i < n; ++i)
      basis.vectors(i, k) = norm * std::cos(0.5 * angle * (long(2 * i + 1) * k % (4 * n)));
  }
  return basis;
}

template <class Real>
BoxPoisson<Real>::BoxPoisson(const Grid& grid)
    : BoxPoisson(grid,
                 {dirichletBasis(grid.n[0], grid.spacing[0]), dirichletBasis(grid.n[1], grid.spacing[1]),
                  dirichletBasis(grid.n[2], grid.spacing[2])}) {}

template <class Real>
BoxPoisson<Real>::BoxPoisson(const Grid& grid, const std::array<AxisBasis, 3>& bases) : grid_(grid) {
  for (int a = 0; a < 3; ++a) {
    vectors_[a] = bases[a].vectors.template cast<Real>();
    transposed_[a] = vectors_[a].transpose();
    values_[a] = bases[a].values.template cast<Real>();
    first_[a] = bases[a].first;
    n_[a] = int(bases[a].values.size());
  }
}

template <class Real>
BoxPoisson<Real>::BoxPoisson(const Grid& grid, const std::array<AxisBasis, 3>& bases,
                             const std::function<double(double)>& response)
    : BoxPoisson(grid, bases) {
  response_.reserve(std::size_t(n_[0]) * n_[1] * n_[2]);
  for (int j = 0; j < n_[1]; ++j)
    for (int k = 0; k < n_[2]; ++k)
      for (int i = 0; i < n_[0]; ++i)
        response_.push_back(Real(response(bases[0].values[i] + bases[1].values[j] + bases[2].values[k])));
}

template <class Real>
void BoxPoisson<Real>::solve(Real* const* fields, int count) const {
  using Slab = Eigen::Map<Matrix, 0, Eigen::OuterStride<>>;
  const Eigen::OuterStride<> rowStride(grid_.n[0]), layerStride(Eigen::Index(grid_.n[0]) * grid_.n[1]);
#pragma omp parallel
  {
    Matrix a(n_[0], n_[1]), b(n_[0], n_[2]);
    Eigen::Array<Real, Eigen::Dynamic, 1> inverse(n_[0]);
    // X^T g Y per layer
#pragma omp for collapse(2) schedule(static)
    for (int f = 0; f < count; ++f)
      for (int k = 0; k < n_[2]; ++k) {
        Slab slab(fields[f] + grid_.index(first_[0], first_[1], first_[2] + k), n_[0], n_[1], rowStride);
        a.noalias() = transposed_[0] * slab;
        slab.noalias() = a * vectors_[1];
      }
      // Z (1/lambda) Z^T per row
#pragma omp for collapse(2) schedule(static)
    for (int f = 0; f < count; ++f)
      for (int j = 0; j < n_[1]; ++j) {
        Slab slab(fields[f] + grid_.index(first_[0], first_[1] + j, first_[2]), n_[0], n_[2], layerStride);
        b.noalias() = slab * vectors_[2];
        for (int k = 0; k < n_[2]; ++k) {
          if (!response_.empty()) {
            const Real* r = response_.data() + std::size_t(n_[0]) * (std::size_t(j) * n_[2] + k);
            b.col(k).array() *= Eigen::Map<const Eigen::Array<Real, Eigen::Dynamic, 1>>(r, n_[0]);
            continue;
          }
          inverse = values_[0] + (values_[1][j] + values_[2][k]);
          b.col(k).array() *= (inverse == 0).select(Real(0), inverse.inverse());
        }
        slab.noalias() = b * transposed_[2];
      }
      // X f Y^T per layer
#pragma omp for collapse(2) schedule(static)
    for (int f = 0; f < count; ++f)
      for (int k = 0; k < n_[2]; ++k) {
        Slab slab(fields[f] + grid_.index(first_[0], first_[1], first_[2] + k), n_[0], n_[1], rowStride);
        a.noalias() = vectors_[0] * slab;
        slab.noalias() = a * transposed_[1];
      }
  }
}

template class BoxPoisson<float>;
template class BoxPoisson<double>;

} // namespace rimflow
