#include "WallFriction.h"
#include "WallFit.h"

namespace rimflow {

namespace {

constexpr int Degree = 4;
using Harmonics = TangentialHarmonics<Degree>;
constexpr int Layers = 3;

/// f(s) = D (1 - exp(-s/D)) and I(s) = 1/(R + s)^2 integral_0^s (R + s') f(s') ds'.
struct Layer {
  double value, integral;
  Layer(double D, double R, double s) {
    const double e = 1 - std::exp(-s / D);
    value = D * e;
    integral = D * (R * s + 0.5 * s * s - D * (R * e + D * e - (1 - e) * s)) / ((R + s) * (R + s));
  }
};

} // namespace

// The flow seen from the body, as in the locator (FlowAroundSphere.h):
//     w_t = sum over layers D of f_D(s) a_D(n),   w_n = - sum of I_D(s) div a_D(n)   (continuity),
// with a_D in tangential harmonics. f_D'(0) = 1, so d u/d n at the wall is the sum of a_D.
std::vector<Eigen::Vector3d> wallShear(const FluidNodes& fluid, double wallLayer,
                                       const std::vector<Eigen::Vector3d>& directions) {
  const Body& body = fluid.body();
  const double h = fluid.spacing(), R = 0.5 * body.diameter;
  const double thickness[Layers] = {wallLayer, 3 * wallLayer, 10 * wallLayer};
  RidgeFit fit(Layers * Harmonics::Size);
  Eigen::Matrix<double, Layers * Harmonics::Size, 1> row;
  for (const WallNode& w : wallNodes(fluid, 0, 2.5 * h)) {
    const Harmonics a(w.normal);
    const Eigen::Vector3d x = body.centre + (R + w.distance) * w.normal;
    const Eigen::Vector3d u = fluid.velocity(w.node) - body.velocityAt(x);
    for (int axis = 0; axis < 3; ++axis) {
      for (int l = 0; l < Layers; ++l) {
        const Layer layer(thickness[l], R, w.distance);
        row.segment<Harmonics::Size>(l * Harmonics::Size) =
            layer.value / h * a.field.row(axis).transpose() -
            layer.integral / h * w.normal[axis] * a.divergence;
      }
      fit.add(row, u[axis] / h);
    }
  }
  Eigen::VectorXd strength(Layers * Harmonics::Size);
  const std::vector<int> degree = Harmonics::degrees();
  for (int c = 0; c < strength.size(); ++c)
    strength[c] = 1e-6 * std::pow(1.0 + degree[c % Harmonics::Size], 2);
  const Eigen::VectorXd coefficient = fit.solve(strength);
  Eigen::Matrix<double, Harmonics::Size, 1> total = Eigen::Matrix<double, Harmonics::Size, 1>::Zero();
  for (int l = 0; l < Layers; ++l) total += coefficient.segment<Harmonics::Size>(l * Harmonics::Size);
  std::vector<Eigen::Vector3d> shear;
  for (const Eigen::Vector3d& n : directions) shear.push_back(Harmonics(n).field * total);
  return shear;
}

} // namespace rimflow
