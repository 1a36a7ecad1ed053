#pragma once
#include "Grid.h"

#include <Eigen/Core>
#include <array>
#include <cstddef>
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

/// The eigenvectors of a symmetric matrix that is the same read backwards, A(i, j) = A(n-1-i, n-1-j): each
/// even or odd about the middle of the line, all even ones first. Eigenvalues ascend within each kind.
AxisBasis reflectionBasis(const Eigen::MatrixXd& matrix);

/// Solves L f = g on a box of nodes by fast diagonalisation (Lynch, Rice & Thomas 1964): with L the sum of
/// three 1-D operators with eigenvectors X, Y, Z, f = X Y Z (1/(lx + ly + lz)) X^T Y^T Z^T g. The transforms
/// are dense matrix products: exact for every size, and faster than an FFT for the sizes of one experiment.
/// Every eigenvector must be even or odd about the middle of its line (std::invalid_argument otherwise): even
/// ones need only the sums f[i] + f[n-1-i], odd ones the differences, which halves the work.
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

  /// The two halves of solve: from the coefficients of the modes, of which there are as many as nodes, f = X
  /// Y Z response(L) c, and the transpose, c = response(L) X^T Y^T Z^T f.
  void fromModes(Real* const* fields, int count) const;
  void toModes(Real* const* fields, int count) const;
  /// A function of the eigenvalue of each mode, where fromModes has its coefficient; 0 on other nodes.
  std::vector<Real> perMode(const std::function<double(double eigenvalue)>& function) const;

private:
  using Matrix = Eigen::Matrix<Real, Eigen::Dynamic, Eigen::Dynamic>;
  /// One axis. Folded, a line holds f[i] + f[n-1-i] in its first half and f[i] - f[n-1-i] at n-1-i.
  struct Axis {
    int n = 0, half = 0;              ///< nodes; even modes, which come before the odd ones
    std::ptrdiff_t stride = 1;        ///< between nodes
    Matrix vectors[2], transposed[2]; ///< even, odd: from modes to folded nodes, and back
    Eigen::VectorXd values;
    Axis() = default;
    explicit Axis(const AxisBasis& basis);
  };
  struct Buffers;
  void layerToModes(Real* layer, Buffers& buffers) const;
  void layerToNodes(Real* layer, Buffers& buffers) const;
  void sliceToModes(Real* slice, const Real* response, Buffers& buffers) const;
  void sliceToNodes(Real* slice, const Real* response, Buffers& buffers) const;
  void respond(Real* slice, const Real* response, Buffers& buffers) const;
  template <class F>
  void forEachLayer(Real* const* fields, int count, F&& f) const;
  template <class F>
  void forEachSlice(Real* const* fields, int count, F&& f) const;

  std::array<Axis, 3> axes_; ///< those of one node last
  std::size_t first_ = 0;    ///< the first node that the bases act on
  std::size_t nodes_ = 0;    ///< of the grid
  std::vector<Real> response_;
};

extern template class BoxPoisson<float>;
extern template class BoxPoisson<double>;

} // namespace rimflow
