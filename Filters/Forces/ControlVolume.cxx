#include "ControlVolume.h"

namespace rimflow {

namespace {

/// 1 for t <= 0, 0 for t >= 1, with two continuous derivatives; and its slope.
struct SmoothFall {
  double value, slope;
  explicit SmoothFall(double t) {
    t = std::clamp(t, 0.0, 1.0);
    value = 1 - t * t * t * (10 - 15 * t + 6 * t * t);
    slope = -30 * t * t * (1 - t) * (1 - t);
  }
};

/// The layer at the wall, in which the measured rate of change is not used: it ends between these distances.
struct WallZone {
  double begin, end;
  explicit WallZone(double h) : begin(h), end(2 * h) {}
  double share(double distance) const { return SmoothFall((distance - begin) / (end - begin)).value; }
};

/// The integral over the wall zone of the rate of change: `mean` is that of the fluid next to the zone, which
/// goes over into the wall's own within the boundary layer.
Eigen::Vector3d overWallZone(const WallZone& zone, const Body& body, double wallLayer,
                             const Eigen::Vector3d& mean) {
  constexpr int Steps = 200;
  const double ds = zone.end / Steps;
  double volume = 0, layer = 0;
  for (int i = 0; i < Steps; ++i) {
    const double s = (i + 0.5) * ds, r = 0.5 * body.diameter + s;
    const double shell = 4 * M_PI * r * r * ds * zone.share(s);
    volume += shell;
    if (wallLayer > 0) layer += shell * std::exp(-s / wallLayer);
  }
  return volume * mean + layer * (body.acceleration - mean);
}

/// Along one axis: the part of a cell that belongs to a node.
double cellShare(int i, int n) { return i == 0 || i == n - 1 ? 0.5 : 1; }

} // namespace

// Momentum with a weight phi that is 1 at the body and 0 outside, and moves with the body's velocity V: with
// d'/dt = d/dt + V . grad, the rate of change that the body sees, the fluid has
//     rho d'u/dt = div T,   T = sigma - rho u (u - V)^T,   sigma = -p I + mu (grad u + grad u^T),
// and at the wall u - V is tangential, T n = sigma n. Times phi, integrated by parts:
//     F = - int T grad phi dV - int phi rho d'u/dt dV + int phi T n dA over the faces of the grid,
// with d'u/dt = Du/Dt - ((u - V) . grad) u. The last term is there only if the shell is cut by the faces.
// Constants in p and u do not matter; means are subtracted against rounding and missing nodes.
MomentumBalance momentumBalance(const FluidNodes& fluid, double density, double viscosity, double wallLayer,
                                const ControlShell& shell) {
  const Grid& grid = fluid.grid();
  const Body& body = fluid.body();
  const double mu = density * viscosity, width = shell.outer - shell.inner;
  const double cell = grid.spacing[0] * grid.spacing[1] * grid.spacing[2];
  const WallZone zone(fluid.spacing());

  struct Sums {
    Eigen::Vector3d flux = Eigen::Vector3d::Zero(), change = Eigen::Vector3d::Zero(),
                    changeNearby = Eigen::Vector3d::Zero(), gradient = Eigen::Vector3d::Zero(),
                    variance = Eigen::Vector3d::Zero();
    double pressure = 0, weight = 0, missing = 0, nearby = 0, through = 0;
  } sum;
  Eigen::Vector3d velocity = Eigen::Vector3d::Zero();
  bool cut = false;

  forEachNodeNear(grid, body.centre.data(), shell.outer, [&](int i, int j, int k) {
    const Eigen::Vector3d r = fluid.position(i, j, k) - body.centre;
    const double distance = r.norm() - 0.5 * body.diameter;
    if (distance <= 0 || r.norm() >= shell.outer) return;
    const double volume = cell * cellShare(i, grid.n[0]) * cellShare(j, grid.n[1]) * cellShare(k, grid.n[2]);
    const SmoothFall fall((r.norm() - shell.inner) / width);
    const Eigen::Vector3d slope = fall.slope / width * r.normalized();
    if (!fluid.hold(i, j, k)) {
      sum.missing += volume * slope.norm();
      return;
    }
    const std::size_t node = grid.index(i, j, k);
    const Eigen::Vector3d u = fluid.velocity(node), relative = u - body.velocity;
    const Eigen::Matrix3d gradient = fluid.velocityGradient(i, j, k);
    const double p = fluid.pressure(node);

    sum.weight += volume * slope.norm();
    sum.pressure += volume * slope.norm() * p;
    velocity += volume * slope.norm() * u;
    const auto addFlux = [&](const Eigen::Vector3d& area) { // T area
      sum.flux += mu * (gradient + gradient.transpose()) * area - p * area - density * u * relative.dot(area);
      sum.gradient += area;
      sum.through += relative.dot(area);
    };
    addFlux(-volume * slope);
    if (fluid.fields().pressureError)
      sum.variance += (double(fluid.fields().pressureError[node]) * volume * slope).cwiseAbs2();

    const double share = zone.share(distance);
    const Eigen::Vector3d change = fluid.acceleration(node) - gradient * relative;
    sum.change += volume * fall.value * (1 - share) * change;
    if (distance > zone.begin && distance < zone.end + zone.begin) {
      sum.changeNearby += volume * change;
      sum.nearby += volume;
    }

    const int at[3] = {i, j, k};
    for (int a = 0; a < 3; ++a) {
      const int side = at[a] == 0 ? -1 : at[a] == grid.n[a] - 1 ? 1 : 0;
      if (side == 0 || fall.value == 0) continue;
      cut = true;
      addFlux(fall.value * side * volume / (0.5 * grid.spacing[a]) * Eigen::Vector3d::Unit(a));
    }
  });

  MomentumBalance out;
  out.cut = cut;
  if (sum.weight == 0) {
    out.missing = 1;
    return out;
  }
  out.missing = sum.missing / (sum.missing + sum.weight);
  sum.flux += sum.pressure / sum.weight * sum.gradient + density * velocity / sum.weight * sum.through;
  if (sum.nearby > 0) sum.change += overWallZone(zone, body, wallLayer, sum.changeNearby / sum.nearby);
  out.force = sum.flux - density * sum.change;
  out.pressureSigma = sum.variance.cwiseSqrt();
  return out;
}

} // namespace rimflow
