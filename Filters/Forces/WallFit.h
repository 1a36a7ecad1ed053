#pragma once
#include "FluidNodes.h"
#include "TangentialHarmonics.h"

#include <Eigen/Cholesky>
#include <vector>

namespace rimflow {

/// A node near the wall.
struct WallNode {
  Eigen::Vector3d normal; ///< from the body's centre to the node
  double distance;        ///< from the wall, m
  std::size_t node;
};

/// The nodes that hold fluid between two distances from the wall, m.
inline std::vector<WallNode> wallNodes(const FluidNodes& fluid, double from, double to) {
  std::vector<WallNode> nodes;
  const Body& body = fluid.body();
  forEachNodeNear(fluid.grid(), body.centre.data(), 0.5 * body.diameter + to, [&](int i, int j, int k) {
    const Eigen::Vector3d r = fluid.position(i, j, k) - body.centre;
    const double distance = r.norm() - 0.5 * body.diameter;
    if (distance > from && distance < to && fluid.hold(i, j, k))
      nodes.push_back({r.normalized(), distance, fluid.grid().index(i, j, k)});
  });
  return nodes;
}

/// Linear least squares with a prior: rows are added to the normal equations a few hundred at a time.
class RidgeFit {
public:
  explicit RidgeFit(int unknowns)
      : normal_(Eigen::MatrixXd::Zero(unknowns, unknowns)), right_(Eigen::VectorXd::Zero(unknowns)),
        rows_(unknowns, Block), data_(Block) {}

  /// One row of the matrix (as a column) and its datum.
  template <class Row>
  void add(const Row& row, double datum) {
    rows_.col(filled_) = row;
    data_[filled_++] = datum;
    if (filled_ == Block) flush();
  }
  /// strength: of the prior of each unknown, relative to the mean diagonal of the normal equations.
  Eigen::VectorXd solve(const Eigen::VectorXd& strength) {
    flush();
    const double scale = normal_.trace() / double(normal_.rows());
    normal_.diagonal() += (scale > 0 ? scale : 1) * strength;
    return normal_.selfadjointView<Eigen::Lower>().ldlt().solve(right_);
  }

private:
  static constexpr int Block = 256;
  void flush() {
    if (filled_ == 0) return;
    normal_.selfadjointView<Eigen::Lower>().rankUpdate(rows_.leftCols(filled_));
    right_.noalias() += rows_.leftCols(filled_) * data_.head(filled_);
    filled_ = 0;
  }
  Eigen::MatrixXd normal_;
  Eigen::VectorXd right_;
  Eigen::MatrixXd rows_;
  Eigen::VectorXd data_;
  int filled_ = 0;
};

} // namespace rimflow
