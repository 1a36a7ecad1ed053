#pragma once
#include "Grid.h"

#include <Eigen/Core>
#include <array>
#include <functional>
#include <vector>

namespace rimflow {

/// Eigenvectors (columns, orthonormal) and eigenvalues of a symmetric 1-D operator on `nodes` nodes of a grid
/// line, of which the first acts on node `first`.
struct AxisBasis {
  Eigen::MatrixXd vectors;
  Eigen::VectorXd values;
  int first = 0;
};

/// The second difference (f[i-1] - 2 f[i] + f[i+1])/h^2 on the n - 2 interior nodes of a line of n nodes with
/// zero end values: sines, eigenvalues (2 cos(pi k/(n-1)) - 2)/h^2.
AxisBasis dirichletBasis(int n, double spacing);

/// The second difference on all n nodes with zero slope half a spacing beyond the ends: cosines (DCT-II),
/// eigenvalues (2 cos(pi k/n) - 2)/h^2.
AxisBasis neumannBasis(int n, double spacing);

/// Solves L f = g on a box of nodes by fast diagonalisation (Lynch, Rice & Thomas 1964): with L the sum of
/// three 1-D operators with eigenvectors X, Y, Z, f = X Y Z (1/(lx + ly + lz)) X^T Y^T Z^T g. The transforms
/// are dense matrix products: exact for every size, and faster than an FFT for the sizes of one experiment.
/// The solution operator is symmetric, hence its own adjoint. Real: float or double. Threaded with OpenMP;
/// the result does not depend on the number of threads.
template <class Real>
class BoxPoisson {
public:
  /// 7-point Laplacian with f given on all faces.
  explicit BoxPoisson(const Grid& grid);
  BoxPoisson(const Grid& grid, const std::array<AxisBasis, 3>& bases);
  /// f = response(L) g instead of 1/L g.
  BoxPoisson(const Grid& grid, const std::array<AxisBasis, 3>& bases,
             const std::function<double(double eigenvalue)>& response);

  /// In: the right-hand side on the nodes that the bases act on. Out: the solution there. Other nodes (with
  /// Dirichlet conditions: the faces) are left alone and count as zero. count fields at once.
  void solve(Real* const* fields, int count) const;
  void solve(Real* field) const { solve(&field, 1); }

private:
  using Matrix = Eigen::Matrix<Real, Eigen::Dynamic, Eigen::Dynamic>;
  Grid grid_;
  std::array<Matrix, 3> vectors_, transposed_;
  std::array<Eigen::Array<Real, Eigen::Dynamic, 1>, 3> values_;
  std::array<int, 3> first_, n_;
  std::vector<Real> response_;
};

extern template class BoxPoisson<float>;
extern template class BoxPoisson<double>;

} // namespace rimflow
