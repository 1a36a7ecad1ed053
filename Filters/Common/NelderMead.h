#pragma once
#include <Eigen/Core>
#include <algorithm>
#include <utility>
#include <vector>

namespace rimflow {

/// Minimum of f(x) without derivatives (Nelder & Mead 1965) from x with a first simplex of this step along
/// each axis; ends when the simplex's values differ by less than tolerance, or after about so many
/// evaluations.
template <typename Function>
Eigen::VectorXd minimiseNelderMead(const Function& f, const Eigen::VectorXd& x, double step, double tolerance,
                                   int evaluations) {
  using Vertex = std::pair<double, Eigen::VectorXd>;
  const auto vertex = [&](const Eigen::VectorXd& y) { return Vertex(f(y), y); };
  const auto lower = [](const Vertex& a, const Vertex& b) { return a.first < b.first; };
  const int n = int(x.size());
  std::vector<Vertex> simplex{vertex(x)};
  for (int i = 0; i < n; ++i) simplex.push_back(vertex(x + step * Eigen::VectorXd::Unit(n, i)));
  std::sort(simplex.begin(), simplex.end(), lower);
  for (int used = n + 1; used < evaluations && simplex[n].first - simplex[0].first > tolerance; ++used) {
    Eigen::VectorXd mean = Eigen::VectorXd::Zero(n);
    for (int i = 0; i < n; ++i) mean += simplex[i].second / n;
    const auto along = [&](double t) { return vertex(mean + t * (simplex[n].second - mean)); };
    Vertex next = along(-1);
    if (next.first < simplex[0].first) {
      next = std::min(next, along(-2), lower);
      ++used;
    } else if (next.first >= simplex[n - 1].first) {
      next = along(next.first < simplex[n].first ? -0.5 : 0.5);
      ++used;
    }
    if (next.first < simplex[n].first) {
      simplex[n] = next;
    } else {
      for (int i = 1; i <= n; ++i) simplex[i] = vertex(0.5 * (simplex[0].second + simplex[i].second));
      used += n;
    }
    std::sort(simplex.begin(), simplex.end(), lower);
  }
  return simplex[0].second;
}

} // namespace rimflow
