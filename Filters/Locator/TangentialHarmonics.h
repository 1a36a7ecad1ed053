#pragma once
#include <Eigen/Geometry>
#include <cmath>
#include <vector>

namespace rimflow {

/// Real tangential vector spherical harmonics of degree 1 to Degree, each of unit mean square over the
/// sphere: grad Y/sqrt(l(l+1)) and n x the same, in this order for each Y. With Y = Q(z) Re or Im (x + iy)^m
/// and Q = d^m P_l/dz^m they are polynomials in the direction n = (x, y, z), so the poles are like any place.
template <int Degree>
struct TangentialHarmonics {
  static constexpr int Size = 2 * Degree * (Degree + 2);
  Eigen::Matrix<double, 3, Size> field;
  Eigen::Matrix<double, Size, 1> divergence; ///< on the unit sphere

  explicit TangentialHarmonics(const Eigen::Vector3d& n) {
    double re[Degree + 1] = {1}, im[Degree + 1] = {0}; // (x + iy)^m
    for (int m = 1; m <= Degree; ++m) {
      re[m] = n.x() * re[m - 1] - n.y() * im[m - 1];
      im[m] = n.x() * im[m - 1] + n.y() * re[m - 1];
    }
    double q[Degree + 1][Degree + 2] = {{1}}; // d^m P_l/dz^m
    for (int l = 1; l <= Degree; ++l) {
      q[l][l] = (2 * l - 1) * q[l - 1][l - 1];
      for (int m = 0; m < l; ++m)
        q[l][m] = ((2 * l - 1) * n.z() * q[l - 1][m] - (l + m - 1) * (l > 1 ? q[l - 2][m] : 0.0)) / (l - m);
    }
    int column = 0;
    for (int l = 1; l <= Degree; ++l)
      for (int m = 0; m <= l; ++m) {
        double norm = (m == 0 ? 1 : 2) * (2 * l + 1);
        for (int k = l - m + 1; k <= l + m; ++k) norm /= k;
        norm = std::sqrt(norm);
        const auto add = [&](double y, double dx, double dy) {
          const Eigen::Vector3d gradient(q[l][m] * dx, q[l][m] * dy, q[l][m + 1] * y);
          const double root = std::sqrt(l * (l + 1.0));
          field.col(column) = norm / root * (gradient - n * n.dot(gradient));
          divergence[column] = -root * norm * q[l][m] * y;
          field.col(column + 1) = n.cross(field.col(column));
          divergence[column + 1] = 0;
          column += 2;
        };
        if (m == 0) {
          add(1, 0, 0);
        } else {
          add(re[m], m * re[m - 1], -m * im[m - 1]);
          add(im[m], m * im[m - 1], m * re[m - 1]);
        }
      }
  }

  /// The degree of each.
  static std::vector<int> degrees() {
    std::vector<int> list;
    for (int l = 1; l <= Degree; ++l) list.insert(list.end(), 2 * (2 * l + 1), l);
    return list;
  }
};

} // namespace rimflow
