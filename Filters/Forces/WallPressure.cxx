#include "WallPressure.h"
#include "WallFit.h"

namespace rimflow {

namespace {

constexpr int Degree = 6;
constexpr double Weight = 0.3; // of the gradients
constexpr int Harmonics = (Degree + 1) * (Degree + 1);
using Row = Eigen::Matrix<double, Harmonics, 1>;

/// Real spherical harmonics Y of unit mean square and their gradient on the unit sphere.
struct ScalarHarmonics {
  Row value;
  Eigen::Matrix<double, 3, Harmonics> gradient;

  explicit ScalarHarmonics(const Eigen::Vector3d& n) {
    const TangentialHarmonics<Degree> tangential(n);
    const std::vector<int> degree = TangentialHarmonics<Degree>::degrees();
    value[0] = 1;
    gradient.col(0).setZero();
    for (int c = 1; c < Harmonics; ++c) { // grad Y = root field, div field = -root Y
      const double root = std::sqrt(degree[2 * (c - 1)] * (degree[2 * (c - 1)] + 1.0));
      value[c] = -tangential.divergence[2 * (c - 1)] / root;
      gradient.col(c) = root * tangential.field.col(2 * (c - 1));
    }
  }
};

} // namespace

// p = sum over harmonics of (a + b t + c t^2) Y, t = s/h, s the distance from the wall, fitted to p and
// w h grad p of the nodes within two spacings.
std::vector<double> wallPressure(const FluidNodes& fluid, const std::vector<Eigen::Vector3d>& directions) {
  const double h = fluid.spacing(), R = 0.5 * fluid.body().diameter;
  std::vector<WallNode> nodes = wallNodes(fluid, 0, 2 * h);
  double mean = 0;
  for (const WallNode& w : nodes) mean += fluid.pressure(w.node) / double(nodes.size());
  RidgeFit fit(3 * Harmonics);
  Eigen::Matrix<double, 3 * Harmonics, 1> row;
  for (const WallNode& w : nodes) {
    const ScalarHarmonics y(w.normal);
    const double t = w.distance / h;
    row << y.value, t * y.value, t * t * y.value;
    fit.add(row, fluid.pressure(w.node) - mean);
    const Eigen::Vector3d gradient = Weight * h * fluid.pressureGradient(w.node);
    for (int a = 0; a < 3; ++a) {
      const Row along = Weight * h / (R + w.distance) * y.gradient.row(a).transpose();
      const Row across = Weight * w.normal[a] * y.value;
      row << along, t * along + across, t * t * along + 2 * t * across;
      fit.add(row, gradient[a]);
    }
  }
  Eigen::VectorXd strength(3 * Harmonics);
  const std::vector<int> degree = TangentialHarmonics<Degree>::degrees();
  for (int c = 0; c < Harmonics; ++c) {
    const double rough = c == 0 ? 1 : std::pow(1.0 + degree[2 * (c - 1)], 2);
    strength[c] = 1e-6 * rough;
    strength[Harmonics + c] = 2e-6 * rough;
    strength[2 * Harmonics + c] = 3e-6 * rough;
  }
  const Eigen::VectorXd coefficient = fit.solve(strength);
  std::vector<double> pressure;
  for (const Eigen::Vector3d& n : directions)
    pressure.push_back(mean + ScalarHarmonics(n).value.dot(coefficient.head<Harmonics>()));
  return pressure;
}

} // namespace rimflow
