#pragma once
#include "Body.h"
#include "ForceFields.h"

#include <Eigen/Core>
#include <algorithm>
#include <cmath>

namespace rimflow {

/// The fields at the nodes that hold fluid: outside the body, not masked, every number finite.
class FluidNodes {
public:
  FluidNodes(const ForceFields& fields, const Body& body) : fields_(fields), body_(body) {}

  const ForceFields& fields() const { return fields_; }
  const Grid& grid() const { return fields_.grid; }
  const Body& body() const { return body_; }
  /// The largest spacing of the three axes, m.
  double spacing() const { return std::max({grid().spacing[0], grid().spacing[1], grid().spacing[2]}); }
  Eigen::Vector3d position(int i, int j, int k) const {
    const auto x = grid().position(i, j, k);
    return {x[0], x[1], x[2]};
  }
  Eigen::Vector3d velocity(std::size_t node) const { return vector(fields_.velocity, node); }
  Eigen::Vector3d acceleration(std::size_t node) const { return vector(fields_.acceleration, node); }
  Eigen::Vector3d pressureGradient(std::size_t node) const { return vector(fields_.pressureGradient, node); }
  double pressure(std::size_t node) const { return fields_.pressure[node]; }

  /// False for nodes outside the grid, too.
  bool hold(int i, int j, int k) const {
    const Grid& g = grid();
    if (i < 0 || j < 0 || k < 0 || i >= g.n[0] || j >= g.n[1] || k >= g.n[2]) return false;
    const std::size_t node = g.index(i, j, k);
    if (fields_.mask && fields_.mask[node]) return false;
    if (body_.signedDistance(position(i, j, k)) <= 0) return false;
    return std::isfinite(pressure(node)) && velocity(node).allFinite() && acceleration(node).allFinite() &&
           pressureGradient(node).allFinite();
  }

  /// G(a, b) = du_a/dx_b, 1/s, at a node that holds fluid: central differences of fourth order, where there
  /// is no room for them of second order, then one-sided ones; 0 where a node has no neighbour.
  Eigen::Matrix3d velocityGradient(int i, int j, int k) const {
    Eigen::Matrix3d gradient;
    for (int axis = 0; axis < 3; ++axis) {
      const auto holds = [&](int s) {
        return hold(i + (axis == 0) * s, j + (axis == 1) * s, k + (axis == 2) * s);
      };
      const auto u = [&](int s) {
        return velocity(grid().index(i + (axis == 0) * s, j + (axis == 1) * s, k + (axis == 2) * s));
      };
      const double h = grid().spacing[axis];
      const bool before = holds(-1), after = holds(1);
      Eigen::Vector3d d = Eigen::Vector3d::Zero();
      if (before && after)
        d = holds(-2) && holds(2) ? Eigen::Vector3d((u(-2) - u(2) + 8 * (u(1) - u(-1))) / (12 * h))
                                  : Eigen::Vector3d((u(1) - u(-1)) / (2 * h));
      else if (before || after) {
        const int s = after ? 1 : -1;
        d = s * (holds(2 * s) ? Eigen::Vector3d((4 * u(s) - 3 * u(0) - u(2 * s)) / (2 * h))
                              : Eigen::Vector3d((u(s) - u(0)) / h));
      }
      gradient.col(axis) = d;
    }
    return gradient;
  }

private:
  static Eigen::Vector3d vector(const float* f, std::size_t node) {
    return {f[3 * node], f[3 * node + 1], f[3 * node + 2]};
  }

  ForceFields fields_;
  Body body_;
};

} // namespace rimflow
