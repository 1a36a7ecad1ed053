#include "BoxPoisson.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <cstring>
#include <stdexcept>
#include <utility>

namespace rimflow {
namespace {

// Matrix products with few rows to copy: for halves of a line, Eigen's general product spends much of its
// time in rearranging its arguments. A block of the result stays in registers while its sum runs.
constexpr int VectorBytes = EIGEN_MAX_STATIC_ALIGN_BYTES > 16 ? EIGEN_MAX_STATIC_ALIGN_BYTES : 16;
constexpr int BlockVectors = 3, BlockColumns = VectorBytes == 64 ? 8 : 4; // of 32 or 16 registers

template <class Real>
constexpr int Width = VectorBytes / int(sizeof(Real));

template <class Real>
struct View {
  Real* data;
  std::ptrdiff_t stride; // between columns
  operator View<const Real>() const { return {data, stride}; }
  View at(int row, int column) const { return {data + row + column * stride, stride}; }
};

// The rows of a left factor, in whole vectors; an odd number of them, so that columns spread over the cache.
template <class Real>
int paddedRows(int rows) {
  return ((rows + Width<Real> - 1) / Width<Real> | 1) * Width<Real>;
}

// At most `count` elements of a vector
template <class Real, class Vector>
void store(Vector value, Real* to, int count) {
  if (count >= Width<Real>)
    std::memcpy(to, &value, sizeof value);
  else
    for (int i = 0; i < count; ++i) to[i] = value[i];
}

// C = A B for at most `rows` rows of a block; A is read beyond them, to the end of a vector.
template <class Real, int Vectors, int Columns>
void multiplyBlock(View<const Real> a, View<const Real> b, View<Real> c, int rows, int depth) {
  typedef Real Vector __attribute__((vector_size(VectorBytes)));
  Vector sum[Columns][Vectors] = {};
  for (int l = 0; l < depth; ++l) {
    Vector left[Vectors];
#pragma GCC unroll 8
    for (int v = 0; v < Vectors; ++v) std::memcpy(&left[v], a.at(v * Width<Real>, l).data, sizeof(Vector));
#pragma GCC unroll 8
    for (int j = 0; j < Columns; ++j)
#pragma GCC unroll 8
      for (int v = 0; v < Vectors; ++v) sum[j][v] += left[v] * b.data[l + j * b.stride];
  }
#pragma GCC unroll 8
  for (int j = 0; j < Columns; ++j)
#pragma GCC unroll 8
    for (int v = 0; v < Vectors; ++v) {
      const Vector value = sum[j][v];
      store(value, c.at(v * Width<Real>, j).data, rows - v * Width<Real>);
    }
}

template <class Real>
using Multiply = void (*)(View<const Real>, View<const Real>, View<Real>, int, int);

template <class Real, int... I>
Multiply<Real> multiplyBlockOf(int vectors, int columns, std::integer_sequence<int, I...>) {
  static constexpr Multiply<Real> Table[] = {
      &multiplyBlock<Real, I / BlockColumns + 1, I % BlockColumns + 1>...};
  return Table[(vectors - 1) * BlockColumns + columns - 1];
}

// C = A B in blocks of nearly equal size; C has rows x columns.
template <class Real>
void multiply(View<const Real> a, View<const Real> b, View<Real> c, int rows, int columns, int depth) {
  const int vectors = (rows + Width<Real> - 1) / Width<Real>,
            panels = (vectors + BlockVectors - 1) / BlockVectors,
            strips = (columns + BlockColumns - 1) / BlockColumns;
  for (int p = 0; p < panels; ++p)
    for (int s = 0; s < strips; ++s) {
      const int v = vectors * p / panels, i = v * Width<Real>, j = columns * s / strips;
      multiplyBlockOf<Real>(vectors * (p + 1) / panels - v, columns * (s + 1) / strips - j,
                            std::make_integer_sequence<int, BlockVectors * BlockColumns>())(
          a.at(i, 0), b.at(0, j), c.at(i, j), rows - i, depth);
    }
}

// Folds a line: f[i], f[n-1-i] -> f[i] + f[n-1-i], f[i] - f[n-1-i]. Its transpose, which unfolds, is the
// same.
template <class Real>
void foldRow(Real* f, int n) {
#pragma omp simd
  for (int i = 0; i < n / 2; ++i) {
    const Real a = f[i], b = f[n - 1 - i];
    f[i] = a + b;
    f[n - 1 - i] = a - b;
  }
}

// Likewise for columns j and n-1-j of `rows` rows
template <class Real>
void foldColumns(View<const Real> from, View<Real> to, int rows, int j, int n) {
  const Real *a = from.at(0, j).data, *b = from.at(0, n - 1 - j).data;
  Real *sum = to.at(0, j).data, *difference = to.at(0, n - 1 - j).data;
  if (j == n - 1 - j) {
    std::copy_n(a, rows, sum);
    return;
  }
#pragma omp simd
  for (int i = 0; i < rows; ++i) {
    const Real x = a[i], y = b[i];
    sum[i] = x + y;
    difference[i] = x - y;
  }
}

// The orthonormal even (sign 1) or odd (sign -1) functions of two mirrored nodes, as columns
Eigen::MatrixXd mirrorPairs(int n, int sign) {
  const int count = sign > 0 ? (n + 1) / 2 : n / 2;
  Eigen::MatrixXd pairs = Eigen::MatrixXd::Zero(n, count);
  for (int i = 0; i < count; ++i) {
    pairs(i, i) = std::sqrt(0.5);
    pairs(n - 1 - i, i) = sign * std::sqrt(0.5);
    if (i == n - 1 - i) pairs(i, i) = 1;
  }
  return pairs;
}

} // namespace

AxisBasis reflectionBasis(const Eigen::MatrixXd& matrix) {
  const int n = int(matrix.rows()), half = (n + 1) / 2;
  AxisBasis basis{Eigen::MatrixXd(n, n), Eigen::VectorXd(n), 0};
  for (int sign : {1, -1}) {
    const Eigen::MatrixXd pairs = mirrorPairs(n, sign);
    if (pairs.cols() == 0) continue;
    const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> solver(pairs.transpose() * matrix * pairs);
    const int first = sign > 0 ? 0 : half;
    basis.vectors.middleCols(first, pairs.cols()) = pairs * solver.eigenvectors();
    basis.values.segment(first, pairs.cols()) = solver.eigenvalues();
  }
  return basis;
}

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
BoxPoisson<Real>::BoxPoisson(const Grid& grid, const std::array<AxisBasis, 3>& bases)
    : BoxPoisson(grid, bases, [](double eigenvalue) { return eigenvalue == 0 ? 0 : 1 / eigenvalue; }) {}

template <class Real>
BoxPoisson<Real>::Axis::Axis(const AxisBasis& basis)
    : n(int(basis.values.size())), half((n + 1) / 2), values(n) {
  int count[2] = {0, 0};
  const int size[2] = {half, n - half};
  for (int p : {0, 1}) {
    vectors[p] = Matrix::Zero(paddedRows<Real>(size[p]), size[p]);
    transposed[p] = vectors[p];
  }
  for (int k = 0; k < n; ++k) {
    const auto v = basis.vectors.col(k);
    const double odd = (v - v.reverse()).squaredNorm(), even = (v + v.reverse()).squaredNorm();
    const int p = odd < even ? 0 : 1, m = count[p]++;
    if (std::min(odd, even) > 1e-12 || m >= size[p])
      throw std::invalid_argument(
          "The Poisson solver needs eigenvectors that are even or odd on their line.");
    for (int i = 0; i < size[p]; ++i) // differences stand at n-1-i, so from the middle outwards
      vectors[p](i, m) = transposed[p](m, i) = Real(v[p == 0 ? i : size[p] - 1 - i]);
    values[p * half + m] = basis.values[k];
  }
}

template <class Real>
BoxPoisson<Real>::BoxPoisson(const Grid& grid, const std::array<AxisBasis, 3>& bases,
                             const std::function<double(double)>& response) {
  const std::ptrdiff_t stride[3] = {1, grid.n[0], std::ptrdiff_t(grid.n[0]) * grid.n[1]};
  first_ = grid.index(bases[0].first, bases[1].first, bases[2].first);
  nodes_ = grid.size();
  std::array<int, 3> order{0, 1, 2};
  std::stable_partition(order.begin(), order.end(), [&](int a) { return grid.n[a] > 1; });
  for (int a = 0; a < 3; ++a) {
    axes_[a] = Axis(bases[order[a]]);
    axes_[a].stride = stride[order[a]];
  }
  const auto& [x, y, z] = axes_;
  response_.reserve(std::size_t(x.n) * y.n * z.n);
  for (int j = 0; j < y.n; ++j)
    for (int k = 0; k < z.n; ++k)
      for (int i = 0; i < x.n; ++i)
        response_.push_back(Real(response(x.values[i] + y.values[j] + z.values[k])));
}

// Two planes of the size of the largest cut; rows are padded as those of a left factor.
template <class Real>
struct BoxPoisson<Real>::Buffers {
  Matrix a, b;
  explicit Buffers(const std::array<Axis, 3>& axes)
      : a(Matrix::Zero(paddedRows<Real>(axes[0].n), std::max(axes[1].n, axes[2].n))), b(a) {}
};

namespace {

template <class Matrix>
View<typename Matrix::Scalar> view(Matrix& m) {
  return {m.data(), m.rows()};
}

// C = A B where the even rows of B, then the odd ones, belong to the halves of A
template <class Real, class Matrix>
void alongRows(const Matrix (&halves)[2], View<const Real> b, View<Real> c, int columns) {
  int first = 0;
  for (const Matrix& half : halves) {
    const int n = int(half.cols());
    multiply<Real>({half.data(), half.rows()}, b.at(first, 0), c.at(first, 0), n, columns, n);
    first += n;
  }
}

template <class Real>
void scaleColumn(const Real* from, const Real* factor, Real* to, int n) {
#pragma omp simd
  for (int i = 0; i < n; ++i) to[i] = from[i] * factor[i];
}

// C = A B where the even columns of A, then the odd ones, belong to the halves of B
template <class Real, class Matrix>
void alongColumns(View<const Real> a, const Matrix (&halves)[2], View<Real> c, int rows) {
  int first = 0;
  for (const Matrix& half : halves) {
    const int n = int(half.cols());
    multiply<Real>(a.at(0, first), {half.data(), half.rows()}, c.at(0, first), rows, n, n);
    first += n;
  }
}

} // namespace

// X^T g Y of a layer
template <class Real>
void BoxPoisson<Real>::layerToModes(Real* layer, Buffers& buffers) const {
  const Axis &x = axes_[0], &y = axes_[1];
  const View<Real> a = view(buffers.a), b = view(buffers.b), g{layer, y.stride};
  for (int j = 0; j < y.half; ++j) {
    foldColumns<Real>(g, a, x.n, j, y.n);
    foldRow(a.at(0, j).data, x.n);
    if (j < y.n - 1 - j) foldRow(a.at(0, y.n - 1 - j).data, x.n);
  }
  alongRows<Real>(x.transposed, a, b, y.n);
  alongColumns<Real>(b, y.vectors, g, x.n);
}

// X f Y^T of a layer
template <class Real>
void BoxPoisson<Real>::layerToNodes(Real* layer, Buffers& buffers) const {
  const Axis &x = axes_[0], &y = axes_[1];
  const View<Real> a = view(buffers.a), b = view(buffers.b), f{layer, y.stride};
  alongRows<Real>(x.vectors, f, a, y.n);
  alongColumns<Real>(a, y.transposed, b, x.n);
  for (int j = 0; j < y.half; ++j) {
    foldRow(b.at(0, j).data, x.n);
    if (j < y.n - 1 - j) foldRow(b.at(0, y.n - 1 - j).data, x.n);
    foldColumns<Real>(b, f, x.n, j, y.n);
  }
}

// response Z^T of the slice of one mode of y
template <class Real>
void BoxPoisson<Real>::sliceToModes(Real* slice, const Real* response, Buffers& buffers) const {
  const Axis &x = axes_[0], &z = axes_[2];
  const View<Real> a = view(buffers.a), b = view(buffers.b), f{slice, z.stride};
  for (int k = 0; k < z.half; ++k) foldColumns<Real>(f, a, x.n, k, z.n);
  alongColumns<Real>(a, z.vectors, b, x.n);
  for (int k = 0; k < z.n; ++k, response += x.n) scaleColumn(b.at(0, k).data, response, f.at(0, k).data, x.n);
}

// Z response
template <class Real>
void BoxPoisson<Real>::sliceToNodes(Real* slice, const Real* response, Buffers& buffers) const {
  const Axis &x = axes_[0], &z = axes_[2];
  const View<Real> a = view(buffers.a), b = view(buffers.b), f{slice, z.stride};
  for (int k = 0; k < z.n; ++k, response += x.n) scaleColumn(f.at(0, k).data, response, b.at(0, k).data, x.n);
  alongColumns<Real>(b, z.transposed, a, x.n);
  for (int k = 0; k < z.half; ++k) foldColumns<Real>(a, f, x.n, k, z.n);
}

// Z response Z^T
template <class Real>
void BoxPoisson<Real>::respond(Real* slice, const Real* response, Buffers& buffers) const {
  const Axis &x = axes_[0], &z = axes_[2];
  const View<Real> a = view(buffers.a), b = view(buffers.b), f{slice, z.stride};
  for (int k = 0; k < z.half; ++k) foldColumns<Real>(f, a, x.n, k, z.n);
  alongColumns<Real>(a, z.vectors, b, x.n);
  for (int k = 0; k < z.n; ++k, response += x.n) scaleColumn(b.at(0, k).data, response, b.at(0, k).data, x.n);
  alongColumns<Real>(b, z.transposed, a, x.n);
  for (int k = 0; k < z.half; ++k) foldColumns<Real>(a, f, x.n, k, z.n);
}

// Within a parallel region: f(layer) and f(slice, response of its modes) for every x-y layer and x-z slice
template <class Real>
template <class F>
void BoxPoisson<Real>::forEachLayer(Real* const* fields, int count, F&& f) const {
#pragma omp for collapse(2) schedule(static)
  for (int e = 0; e < count; ++e)
    for (int k = 0; k < axes_[2].n; ++k) f(fields[e] + first_ + k * axes_[2].stride);
}

template <class Real>
template <class F>
void BoxPoisson<Real>::forEachSlice(Real* const* fields, int count, F&& f) const {
#pragma omp for collapse(2) schedule(static)
  for (int e = 0; e < count; ++e)
    for (int j = 0; j < axes_[1].n; ++j)
      f(fields[e] + first_ + j * axes_[1].stride,
        response_.data() + std::size_t(j) * axes_[0].n * axes_[2].n);
}

template <class Real>
void BoxPoisson<Real>::solve(Real* const* fields, int count) const {
#pragma omp parallel
  {
    Buffers buffers(axes_);
    forEachLayer(fields, count, [&](Real* layer) { layerToModes(layer, buffers); });
    forEachSlice(fields, count, [&](Real* slice, const Real* r) { respond(slice, r, buffers); });
    forEachLayer(fields, count, [&](Real* layer) { layerToNodes(layer, buffers); });
  }
}

template <class Real>
void BoxPoisson<Real>::fromModes(Real* const* fields, int count) const {
#pragma omp parallel
  {
    Buffers buffers(axes_);
    forEachSlice(fields, count, [&](Real* slice, const Real* r) { sliceToNodes(slice, r, buffers); });
    forEachLayer(fields, count, [&](Real* layer) { layerToNodes(layer, buffers); });
  }
}

template <class Real>
void BoxPoisson<Real>::toModes(Real* const* fields, int count) const {
#pragma omp parallel
  {
    Buffers buffers(axes_);
    forEachLayer(fields, count, [&](Real* layer) { layerToModes(layer, buffers); });
    forEachSlice(fields, count, [&](Real* slice, const Real* r) { sliceToModes(slice, r, buffers); });
  }
}

template <class Real>
std::vector<Real> BoxPoisson<Real>::perMode(const std::function<double(double)>& function) const {
  std::vector<Real> out(nodes_, 0);
  const auto& [x, y, z] = axes_;
  for (int k = 0; k < z.n; ++k)
    for (int j = 0; j < y.n; ++j)
      for (int i = 0; i < x.n; ++i)
        out[first_ + i * x.stride + j * y.stride + k * z.stride] =
            Real(function(x.values[i] + y.values[j] + z.values[k]));
  return out;
}

template class BoxPoisson<float>;
template class BoxPoisson<double>;

} // namespace rimflow
