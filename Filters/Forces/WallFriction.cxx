#include "WallFriction.h"
#include "WallFit.h"

namespace rimflow {

namespace {

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
WallShear::WallShear(const FluidNodes& fluid, double wallLayer, double reach, const Progress& progress)
    : WallShear() {
  const Body& body = fluid.body();
  const double h = fluid.spacing(), R = 0.5 * body.diameter;
  const double thickness[Layers] = {0.7 * wallLayer, 2 * wallLayer, 6 * wallLayer};
  RidgeFit fit(Layers * Harmonics::Size);
  const std::vector<WallNode> nodes = wallNodes(fluid, 0, reach);
  for (std::size_t n = 0; n < nodes.size(); ++n) {
    if (n % 512 == 0 && !goOn(progress, double(n) / double(nodes.size()))) return;
    const WallNode& w = nodes[n];
    const Harmonics a(w.normal);
    const Eigen::Vector3d x = body.centre + (R + w.distance) * w.normal;
    const Eigen::Vector3d u = fluid.velocity(w.node) - body.velocityAt(x);
    for (int axis = 0; axis < 3; ++axis) {
      auto row = fit.add(u[axis] / h);
      for (int l = 0; l < Layers; ++l) {
        const Layer layer(thickness[l], R, w.distance);
        row.segment<Harmonics::Size>(l * Harmonics::Size) =
            layer.value / h * a.field.row(axis).transpose() -
            layer.integral / h * w.normal[axis] * a.divergence;
      }
    }
  }
  Eigen::VectorXd strength(Layers * Harmonics::Size);
  const std::vector<int> degree = Harmonics::degrees();
  for (int c = 0; c < strength.size(); ++c)
    strength[c] = 1e-6 * std::pow(1.0 + degree[c % Harmonics::Size], 2);
  const Eigen::VectorXd all = fit.solve(strength);
  for (int l = 0; l < Layers; ++l) coefficients_ += all.segment<Harmonics::Size>(l * Harmonics::Size);
}

} // namespace rimflow
