#include "WallPressure.h"
#include "WallFit.h"

namespace rimflow {

namespace {

constexpr int Degree = 5;
constexpr int Harmonics = (Degree + 1) * (Degree + 1);
constexpr int Profiles = 4;
using Row = Eigen::Matrix<double, Harmonics, 1>;

/// Real spherical harmonics Y of unit mean square and their gradient on the unit sphere.
struct ScalarHarmonics {
  Row value;
  Eigen::Matrix<double, 3, Harmonics> gradient;

  explicit ScalarHarmonics(const Eigen::Vector3d& n) {
    const TangentialHarmonics<Degree> tangential(n);
    static const std::vector<int> degree = TangentialHarmonics<Degree>::degrees();
    value[0] = 1;
    gradient.col(0).setZero();
    for (int c = 1; c < Harmonics; ++c) { // grad Y = root field, div field = -root Y
      const double root = std::sqrt(degree[2 * (c - 1)] * (degree[2 * (c - 1)] + 1.0));
      value[c] = -tangential.divergence[2 * (c - 1)] / root;
      gradient.col(c) = root * tangential.field.col(2 * (c - 1));
    }
  }
};

/// 1, s, s - D (1 - exp(-s/D)), s^2 (1 - exp(-s/D)) and their slopes: beyond the boundary layer the pressure
/// has another gradient than at the wall. s and D in the same unit.
struct Profile {
  double value[Profiles], slope[Profiles];
  Profile(double s, double D) {
    const double e = std::exp(-s / D);
    const double v[] = {1, s, s - D * (1 - e), s * s * (1 - e)};
    const double d[] = {0, 1, 1 - e, 2 * s * (1 - e) + s * s / D * e};
    std::copy(v, v + Profiles, value);
    std::copy(d, d + Profiles, slope);
  }
};

} // namespace

// p = sum over profiles f_i of f_i(s/h) a_i(n), a_i in spherical harmonics, s the distance from the wall,
// fitted to p and h grad p of the nodes near the wall and to the slope d p/d n at the wall.
std::vector<double> wallPressure(const FluidNodes& fluid, double wallLayer,
                                 const std::vector<Eigen::Vector3d>& slopeDirections,
                                 const std::vector<double>& slope,
                                 const std::vector<Eigen::Vector3d>& directions, const Progress& progress) {
  constexpr std::size_t Piece = 256; // nodes or directions between two questions whether to go on
  const double gradientWeight = 0.3, slopeWeight = 5;
  const double h = fluid.spacing(), R = 0.5 * fluid.body().diameter;
  const std::vector<WallNode> nodes = wallNodes(fluid, 0, 3 * h);
  double mean = 0;
  for (const WallNode& w : nodes) mean += fluid.pressure(w.node) / double(nodes.size());
  RidgeFit fit(Profiles * Harmonics);
  for (std::size_t k = 0; k < nodes.size(); ++k) {
    const WallNode& w = nodes[k];
    if (k % Piece == 0 && !goOn(progress, 0.7 * double(k) / double(nodes.size()))) return {};
    const ScalarHarmonics y(w.normal);
    const Profile f(w.distance / h, wallLayer / h);
    auto row = fit.add(fluid.pressure(w.node) - mean);
    for (int i = 0; i < Profiles; ++i) row.segment<Harmonics>(i * Harmonics) = f.value[i] * y.value;
    const Eigen::Vector3d gradient = gradientWeight * h * fluid.pressureGradient(w.node);
    for (int a = 0; a < 3; ++a) {
      auto across = fit.add(gradient[a]);
      for (int i = 0; i < Profiles; ++i)
        across.segment<Harmonics>(i * Harmonics) =
            gradientWeight * (h / (R + w.distance) * f.value[i] * y.gradient.row(a).transpose() +
                              f.slope[i] * w.normal[a] * y.value);
    }
  }
  const Profile atWall(0, wallLayer / h);
  for (std::size_t k = 0; k < slope.size(); ++k) {
    const ScalarHarmonics y(slopeDirections[k]);
    auto row = fit.add(slopeWeight * h * slope[k]);
    for (int i = 0; i < Profiles; ++i)
      row.segment<Harmonics>(i * Harmonics) = slopeWeight * atWall.slope[i] * y.value;
  }
  Eigen::VectorXd strength(Profiles * Harmonics);
  const std::vector<int> degree = TangentialHarmonics<Degree>::degrees();
  for (int c = 0; c < Harmonics; ++c)
    for (int i = 0; i < Profiles; ++i)
      strength[i * Harmonics + c] = 1e-6 * (1 + i) * (c == 0 ? 1 : std::pow(1.0 + degree[2 * (c - 1)], 2));
  const Eigen::VectorXd coefficients = fit.solve(strength);
  std::vector<double> pressure;
  for (std::size_t k = 0; k < directions.size(); ++k) {
    if (k % Piece == 0 && !goOn(progress, 0.7 + 0.3 * double(k) / double(directions.size()))) return {};
    pressure.push_back(mean + ScalarHarmonics(directions[k]).value.dot(coefficients.head<Harmonics>()));
  }
  return pressure;
}

} // namespace rimflow
