#pragma once
#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

namespace rimflow {

/// The unit sphere as a geodesic icosphere: 10 n^2 + 2 points, 20 n^2 triangles of like size.
struct GeodesicSphere {
  std::vector<Eigen::Vector3d> points;
  std::vector<std::array<int, 3>> triangles; ///< counter-clockwise seen from outside
  std::vector<double> area;                  ///< of the sphere that belongs to each point; their sum is 4 pi

  /// Each side of the icosahedron's triangles is divided n times. Throws std::invalid_argument unless n is 1
  /// to 128.
  explicit GeodesicSphere(int n);
};

/// Solid angle of the triangle a b c of unit vectors (Van Oosterom & Strackee 1983).
inline double solidAngle(const Eigen::Vector3d& a, const Eigen::Vector3d& b, const Eigen::Vector3d& c) {
  return 2 * std::atan2(a.dot(b.cross(c)), 1 + a.dot(b) + b.dot(c) + c.dot(a));
}

inline GeodesicSphere::GeodesicSphere(int n) {
  if (n < 1 || n > 128)
    throw std::invalid_argument("the surface's resolution is " + std::to_string(n) + ", it must be 1 to 128");
  const double g = 0.5 * (1 + std::sqrt(5.0)); // golden ratio
  const std::array<Eigen::Vector3d, 12> corner = {{{-1, g, 0},
                                                   {1, g, 0},
                                                   {-1, -g, 0},
                                                   {1, -g, 0},
                                                   {0, -1, g},
                                                   {0, 1, g},
                                                   {0, -1, -g},
                                                   {0, 1, -g},
                                                   {g, 0, -1},
                                                   {g, 0, 1},
                                                   {-g, 0, -1},
                                                   {-g, 0, 1}}};
  const int face[20][3] = {{0, 11, 5}, {0, 5, 1},  {0, 1, 7},   {0, 7, 10}, {0, 10, 11},
                           {1, 5, 9},  {5, 11, 4}, {11, 10, 2}, {10, 7, 6}, {7, 1, 8},
                           {3, 9, 4},  {3, 4, 2},  {3, 2, 6},   {3, 6, 8},  {3, 8, 9},
                           {4, 9, 5},  {2, 4, 11}, {6, 2, 10},  {8, 6, 7},  {9, 8, 1}};
  std::map<std::array<std::pair<int, int>, 3>, int> known; // by corners and their shares, in order
  for (const auto& f : face) {
    const auto point = [&](int i, int j) { // i steps from corner 0 to 1, j from 0 to 2
      const int share[3] = {n - i - j, i, j};
      std::array<std::pair<int, int>, 3> key;
      Eigen::Vector3d x = Eigen::Vector3d::Zero();
      for (int c = 0; c < 3; ++c) {
        key[c] = share[c] > 0 ? std::pair(f[c], share[c]) : std::pair(-1, 0);
        x += share[c] * corner[f[c]];
      }
      std::sort(key.begin(), key.end());
      const auto [at, isNew] = known.try_emplace(key, int(points.size()));
      if (isNew) points.push_back(x.normalized());
      return at->second;
    };
    for (int j = 0; j < n; ++j)
      for (int i = 0; i + j < n; ++i) {
        triangles.push_back({point(i, j), point(i + 1, j), point(i, j + 1)});
        if (i + j + 1 < n) triangles.push_back({point(i + 1, j), point(i + 1, j + 1), point(i, j + 1)});
      }
  }
  area.assign(points.size(), 0);
  for (const auto& t : triangles) {
    const double third = solidAngle(points[t[0]], points[t[1]], points[t[2]]) / 3;
    for (int c : t) area[c] += third;
  }
}

} // namespace rimflow
