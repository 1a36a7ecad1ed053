#include "SurfaceForce.h"
#include "ControlVolume.h"
#include "GeodesicSphere.h"
#include "WallFriction.h"
#include "WallPressure.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <limits>
#include <optional>
#include <stdexcept>
#include <utility>

namespace rimflow {

namespace {

using Vec = Eigen::Vector3d;

void require(bool condition, const std::string& message) {
  if (!condition) throw std::invalid_argument(message);
}

bool isCovariance(const Eigen::Matrix3d& c) {
  return c.allFinite() && c.isApprox(c.transpose(), 1e-6) && (c.diagonal().array() >= 0).all();
}

void check(const ForceFields& f, const Body& body, const ForceOptions& o) {
  require(f.velocity && f.acceleration && f.pressure && f.pressureGradient,
          "velocity, acceleration, pressure and pressure gradient are needed");
  for (int a = 0; a < 3; ++a)
    require(f.grid.n[a] >= 2 && f.grid.spacing[a] > 0, "the grid needs two nodes and a spacing per axis");
  require(std::isfinite(body.diameter) && body.diameter > 0, "the body's diameter must be greater than 0");
  require(body.centre.allFinite() && body.velocity.allFinite() && body.acceleration.allFinite() &&
              body.angularVelocity.allFinite(),
          "the body's motion must be finite");
  require(std::isfinite(o.density) && o.density > 0, "the density must be greater than 0");
  require(std::isfinite(o.viscosity) && o.viscosity >= 0, "the viscosity must not be negative");
  require(std::isfinite(o.bodyDensity) && o.bodyDensity >= 0, "the body's density must not be negative");
  require(o.gravity.allFinite(), "gravity must be finite");
  require(std::isfinite(o.controlVolumeRadius) && o.controlVolumeRadius >= 0,
          "the control volume's radius must not be negative");
  require(isCovariance(o.centreCovariance) && isCovariance(o.velocityCovariance) &&
              isCovariance(o.accelerationCovariance),
          "a covariance must be symmetric and finite");
}

/// Distance of the body's centre from the nearest face of the grid, m; negative outside.
double distanceFromFaces(const Grid& g, const Vec& x) {
  double least = std::numeric_limits<double>::infinity();
  for (int a = 0; a < 3; ++a) {
    const double end = g.origin[a] + (g.n[a] - 1) * g.spacing[a];
    least = std::min({least, x[a] - g.origin[a], end - x[a]});
  }
  return least;
}

/// Thickness of the boundary layer, d/sqrt(Re), m; 0 without viscosity.
double boundaryLayer(const Body& body, double speed, double viscosity) {
  return viscosity > 0 ? std::sqrt(body.diameter * viscosity / std::max(speed, 1e-300)) : 0;
}

/// Speed of the fluid as seen from the body: the root mean square near it, or the body's own speed where that
/// is larger.
double relativeSpeed(const FluidNodes& fluid) {
  const Body& body = fluid.body();
  double sum = 0, count = 0;
  const double reach = 0.5 * body.diameter + 3 * fluid.spacing();
  forEachNodeNear(fluid.grid(), body.centre.data(), reach, [&](int i, int j, int k) {
    const double distance = body.signedDistance(fluid.position(i, j, k));
    if (distance < fluid.spacing() || distance > 3 * fluid.spacing() || !fluid.hold(i, j, k)) return;
    sum += (fluid.velocity(fluid.grid().index(i, j, k)) - body.velocity).squaredNorm();
    count += 1;
  });
  return std::max(body.velocity.norm(), count > 0 ? std::sqrt(sum / count) : 0);
}

/// The shell of the momentum balance: from two spacings off the wall out to the radius asked for, or as far
/// as the grid allows, up to 2 d. It reaches at least five spacings beyond the wall,
/// even if the faces cut it then.
ControlShell controlShell(const FluidNodes& fluid, double radius) {
  const double R = 0.5 * fluid.body().diameter, h = fluid.spacing();
  const double room = distanceFromFaces(fluid.grid(), fluid.body().centre);
  ControlShell shell;
  shell.outer = radius > 0 ? radius : std::min(4 * R, room);
  shell.outer = std::max(shell.outer, R + 5 * h);
  shell.inner = R + std::min(2 * h, 0.25 * (shell.outer - R));
  return shell;
}

/// What depends on where the body is.
struct Forces {
  std::vector<double> pressure; ///< at each point, Pa
  std::vector<Vec> shear;       ///< at each point, Pa
  Vec pressureForce = Vec::Zero(), friction = Vec::Zero();
  MomentumBalance balance;
};

class Surface {
public:
  Surface(const ForceFields& fields, const Body& body, const ForceOptions& options, const Progress& progress)
      : fields_(fields), options_(options), sphere_(options.surfaceResolution) {
    const FluidNodes fluid(fields, body);
    const double h = fluid.spacing(), R = 0.5 * body.diameter;
    const double layer = boundaryLayer(body, relativeSpeed(fluid), options.viscosity);
    layer_ = layer;
    coarseness_ = layer > 0 ? h / layer : 0;
    wallLayer_ = std::clamp(layer, 0.25 * h, 0.3 * R);
    frictionReach_ = std::max(2 * h, std::min(layer, R));
    shell_ = controlShell(fluid, options.controlVolumeRadius);
    wholeBodyInside_ = distanceFromFaces(fields.grid, body.centre) > R;
    const double points = double(sphere_.points.size());
    for (const Vec& n : sphere_.points) {
      if (seen_.size() % 256 == 0 && !goOn(progress, double(seen_.size()) / points)) return;
      seen_.push_back(sees(fluid, body.centre + R * n));
    }
    for (const Vec& n : GeodesicSphere(5).points)
      if (sees(fluid, body.centre + R * n)) slopeDirections_.push_back(n);
  }

  const GeodesicSphere& sphere() const { return sphere_; }
  const std::vector<unsigned char>& seen() const { return seen_; }
  const ControlShell& shell() const { return shell_; }
  bool wholeBodyInside() const { return wholeBodyInside_; }
  /// The spacing over the thickness of the boundary layer; 0 without viscosity.
  double coarseness() const { return coarseness_; }

  /// The force of friction alone. When aborted, it means nothing.
  Vec friction(const Body& body, const Progress& progress) const {
    const WallShear shear = wallShear(FluidNodes(fields_, body), part(progress, 0, 0.8));
    return integral(shearAtPoints(shear, part(progress, 0.8, 1)), body);
  }

  /// No pressure: aborted.
  Forces forces(const Body& body, const Progress& progress) const {
    const FluidNodes fluid(fields_, body);
    const double mu = viscosity(), R = 0.5 * body.diameter;
    Forces f;
    if (!goOn(progress, 0)) return {};
    const WallShear shear = wallShear(fluid, part(progress, 0, 0.2));
    // at the wall rho A = -grad p + mu lap u, and n . lap u = -div(d u/d n) for a fluid that sticks
    if (!goOn(progress, 0.2)) return {};
    std::vector<double> slope;
    if (mu > 0)
      for (const Vec& n : slopeDirections_)
        slope.push_back(-mu * shear.divergence(n) / R -
                        options_.density * n.dot(body.accelerationAt(body.centre + R * n)));
    f.pressure =
        wallPressure(fluid, wallLayer_, slopeDirections_, slope, sphere_.points, part(progress, 0.2, 0.7));
    if (f.pressure.empty()) return {};
    carryOver(f.pressure);
    f.shear = shearAtPoints(shear, part(progress, 0.7, 0.8));
    if (f.shear.empty()) return {};
    f.friction = integral(f.shear, body);
    for (std::size_t i = 0; i < sphere_.points.size(); ++i)
      f.pressureForce -= f.pressure[i] * R * R * sphere_.area[i] * sphere_.points[i];
    if (wholeBodyInside_)
      f.balance = momentumBalance(fluid, options_.density, options_.viscosity, layer_, shell_);
    return f;
  }

private:
  double viscosity() const { return options_.density * options_.viscosity; } // dynamic, Pa s

  WallShear wallShear(const FluidNodes& fluid, const Progress& progress) const {
    return viscosity() > 0 ? WallShear(fluid, wallLayer_, frictionReach_, progress) : WallShear();
  }

  /// Friction at each point, Pa; none: aborted.
  std::vector<Vec> shearAtPoints(const WallShear& shear, const Progress& progress) const {
    std::vector<Vec> out;
    const double points = double(sphere_.points.size());
    for (const Vec& n : sphere_.points) {
      if (out.size() % 256 == 0 && !goOn(progress, double(out.size()) / points)) return {};
      out.push_back(viscosity() * shear.at(n));
    }
    carryOver(out);
    if (!goOn(progress, 1)) return {};
    return out;
  }

  Vec integral(const std::vector<Vec>& traction, const Body& body) const {
    const double R = 0.5 * body.diameter;
    Vec sum = Vec::Zero();
    for (std::size_t i = 0; i < traction.size(); ++i) sum += R * R * sphere_.area[i] * traction[i];
    return sum;
  }

  /// Whether a node within two and a half spacings holds fluid.
  static bool sees(const FluidNodes& fluid, const Vec& x) {
    const double reach = 2.5 * fluid.spacing();
    bool found = false;
    forEachNodeNear(fluid.grid(), x.data(), reach, [&](int i, int j, int k) {
      found = found || ((fluid.position(i, j, k) - x).norm() < reach && fluid.hold(i, j, k));
    });
    return found;
  }

  /// Points that are not seen get the mean of their neighbours, from the edge of what is seen inwards.
  template <class T>
  void carryOver(std::vector<T>& values) const {
    std::vector<unsigned char> known = seen_;
    while (std::find(known.begin(), known.end(), 0) != known.end()) {
      std::vector<T> sum(values.size(), T(0 * values[0]));
      std::vector<int> count(values.size());
      for (const auto& t : sphere_.triangles)
        for (int a : t)
          for (int b : t)
            if (!known[a] && known[b]) sum[a] += values[b], ++count[a];
      bool any = false;
      for (std::size_t i = 0; i < values.size(); ++i)
        if (count[i] > 0) values[i] = sum[i] / count[i], known[i] = 1, any = true;
      if (!any) return;
    }
  }

  ForceFields fields_;
  ForceOptions options_;
  GeodesicSphere sphere_;
  std::vector<unsigned char> seen_;
  std::vector<Vec> slopeDirections_;
  ControlShell shell_;
  double layer_ = 0, coarseness_ = 0, wallLayer_ = 0, frictionReach_ = 0;
  bool wholeBodyInside_ = false;
};

/// Independent deviations of a force by one standard deviation of each source of error.
struct Deviations {
  std::vector<Vec> list;

  Vec sigma() const {
    Vec sum = Vec::Zero();
    for (const Vec& d : list) sum += d.cwiseAbs2();
    return sum.cwiseSqrt();
  }
  double along(const Vec& e) const {
    double sum = 0;
    for (const Vec& d : list) sum += std::pow(d.dot(e), 2);
    return std::sqrt(sum);
  }
  /// Of each of the two components across e, on average.
  double across(const Vec& e) const {
    double sum = 0;
    for (const Vec& d : list) sum += (d - d.dot(e) * e).squaredNorm();
    return e.isZero() ? 0 : std::sqrt(0.5 * sum);
  }
  void addComponents(const Vec& sigma) {
    for (int a = 0; a < 3; ++a) list.push_back(sigma[a] * Vec::Unit(a));
  }
};

/// Standard deviation of the pressure at x: the mean of the nodes' that are near.
double pressureSigmaAt(const FluidNodes& fluid, const Vec& x) {
  double sum = 0, count = 0;
  const double reach = 2.5 * fluid.spacing();
  forEachNodeNear(fluid.grid(), x.data(), reach, [&](int i, int j, int k) {
    if ((fluid.position(i, j, k) - x).norm() > reach || !fluid.hold(i, j, k)) return;
    sum += fluid.fields().pressureError[fluid.grid().index(i, j, k)];
    count += 1;
  });
  return count > 0 ? sum / count : 0;
}

void addNote(std::string& note, const std::string& more) { note += (note.empty() ? "" : "; ") + more; }

std::string percent(double share) { return std::to_string(int(std::lround(100 * share))) + " %"; }

/// One standard deviation along each axis of a covariance.
std::vector<Vec> axesOf(const Eigen::Matrix3d& covariance) {
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> axes(covariance);
  std::vector<Vec> out;
  for (int a = 0; a < 3; ++a)
    if (axes.eigenvalues()[a] > 0)
      out.push_back(std::sqrt(axes.eigenvalues()[a]) * axes.eigenvectors().col(a));
  return out;
}

/// The forces on the body, and on it displaced; the friction on it at another velocity.
struct Variations {
  Forces forces;
  std::vector<Forces> displaced;
  std::vector<Vec> frictionAtOtherVelocity;
};

/// Displacements and changes of velocity are of one standard deviation. Nothing: aborted.
std::optional<Variations> variations(const Surface& surface, const Body& body, const ForceOptions& options,
                                     const Progress& progress) {
  const std::vector<Vec> centre = axesOf(options.centreCovariance),
                         velocity = axesOf(options.velocityCovariance);
  Variations all;
  all.displaced.resize(centre.size());
  all.frictionAtOtherVelocity.resize(velocity.size());
  const std::size_t pieces = 1 + centre.size() + velocity.size();
  const bool done = forEachPiece(pieces, progress, [&](std::size_t b, const Progress& watch) {
    Body other = body;
    if (b == 0) {
      all.forces = surface.forces(body, watch);
    } else if (b <= centre.size()) {
      other.centre += centre[b - 1];
      all.displaced[b - 1] = surface.forces(other, watch);
    } else {
      const std::size_t axis = b - 1 - centre.size();
      other.velocity += velocity[axis];
      all.frictionAtOtherVelocity[axis] = surface.friction(other, watch);
    }
  });
  return done ? std::optional(std::move(all)) : std::nullopt;
}

/// What each force is uncertain by.
struct Uncertainty {
  Deviations pressure, friction, both, balance;

  Uncertainty(const Variations& all, double coarseness) {
    const Forces& forces = all.forces;
    const auto add = [&](const Vec& ofPressure, const Vec& ofFriction, const Vec& ofBalance) {
      pressure.list.push_back(ofPressure);
      friction.list.push_back(ofFriction);
      both.list.push_back(ofPressure + ofFriction);
      balance.list.push_back(ofBalance);
    };
    for (const Forces& d : all.displaced)
      add(d.pressureForce - forces.pressureForce, d.friction - forces.friction,
          d.balance.force - forces.balance.force);
    // With another velocity of the wall the fields would be others, too: the flow follows the wall as far as
    // the nearest particles. Parts of the change of friction in the fields as they are that are left then,
    // and the models' errors: measured, Documentation/methods-forces.md, Uncertainty.
    constexpr double ToFriction = 0.7, ToBalance = 0.25;
    for (const Vec& other : all.frictionAtOtherVelocity) {
      const Vec change = other - forces.friction;
      add(Vec::Zero(), ToFriction * change, ToBalance * change);
    }
    constexpr double PressureModel = 0.04, BalanceModel = 0.02, Coarsest = 4; // then the fit's layer is h/4
    const double frictionModel = std::hypot(0.06, 0.06 * std::pow(std::min(coarseness, Coarsest), 2));
    add(PressureModel * forces.pressureForce, Vec::Zero(), Vec::Zero());
    add(Vec::Zero(), frictionModel * forces.friction, BalanceModel * forces.balance.force);
    constexpr double CellsOfOneError = 8; // the pressure's error is alike over two spacings
    balance.list.push_back(forces.balance.zoneSigma);
    balance.addComponents(std::sqrt(CellsOfOneError) * forces.balance.pressureSigma);
  }
};

/// Points, pressure, traction and torque. Returns the variance of the pressure force by the pressure's error.
/// When aborted, there are no points.
Vec fillSurface(const FluidNodes& fluid, const GeodesicSphere& sphere, const Forces& forces, ForceResult& out,
                const Progress& progress) {
  const Body& body = fluid.body();
  const double R = 0.5 * body.diameter;
  out.pressure = forces.pressure;
  out.triangles = sphere.triangles;
  out.normals = sphere.points;
  out.pressureSigma.assign(sphere.points.size(), 0);
  Vec variance = Vec::Zero();
  constexpr double Patches = 36; // of independent error: as many as the wall pressure has harmonics
  for (std::size_t i = 0; i < sphere.points.size(); ++i) {
    if (i % 256 == 0 && !goOn(progress, double(i) / double(sphere.points.size()))) {
      out.points.clear();
      return variance;
    }
    const Vec n = sphere.points[i];
    const double area = R * R * sphere.area[i];
    out.points.push_back(body.centre + R * n);
    out.area.push_back(area);
    out.traction.push_back(-forces.pressure[i] * n + forces.shear[i]);
    out.torque += area * (R * n).cross(out.traction.back());
    if (!fluid.fields().pressureError) continue;
    out.pressureSigma[i] = pressureSigmaAt(fluid, out.points.back());
    variance += 4 * M_PI * R * R / Patches * area * std::pow(out.pressureSigma[i], 2) * n.cwiseAbs2();
  }
  return variance;
}

void setControlVolume(const Surface& surface, const MomentumBalance& balance, const Vec& sigma,
                      ForceResult& out) {
  if (!surface.wholeBodyInside()) {
    addNote(out.note, "the body reaches beyond the grid: no control volume");
  } else if (balance.missing == 1) {
    addNote(out.note, "no fluid in the control volume");
  } else {
    out.controlVolume = {balance.force, sigma, true};
    out.controlVolumeRadius = surface.shell().outer;
    if (balance.cut) addNote(out.note, "the control volume is cut by the grid's faces");
    if (balance.missing > 0.001)
      addNote(out.note, percent(balance.missing) + " of the control volume hold no fluid");
  }
}

Force inertia(const Body& body, const ForceOptions& options) {
  if (options.bodyDensity <= 0) return {};
  const double volume = M_PI / 6 * std::pow(body.diameter, 3), mass = options.bodyDensity * volume;
  return {mass * body.acceleration - (options.bodyDensity - options.density) * volume * options.gravity,
          mass * options.accelerationCovariance.diagonal().cwiseSqrt(), true};
}

/// Drag against the motion, lift across it, and their coefficients.
void setDragAndLift(const Body& body, double density, const Uncertainty& uncertainty, ForceResult& out) {
  const double speed = body.velocity.norm(), R = 0.5 * body.diameter;
  if (speed == 0)
    addNote(out.note, "the body rests: there is no direction of drag and there are no coefficients");
  const Vec e = speed > 0 ? Vec(body.velocity / speed) : Vec(Vec::Zero());
  const double scale =
      speed > 0 ? 0.5 * density * speed * speed * M_PI * R * R : std::numeric_limits<double>::quiet_NaN();
  const Vec total = out.pressureForce.value + out.friction.value;
  out.drag = -total.dot(e);
  out.dragSigma = uncertainty.both.along(e);
  out.lift = total + out.drag * e;
  out.liftSigma = uncertainty.both.across(e);
  out.dragCoefficient = out.drag / scale;
  out.liftCoefficient = out.lift.norm() / scale;
  out.controlVolumeDragCoefficient = std::numeric_limits<double>::quiet_NaN();
  if (!out.controlVolume.known) return;
  out.controlVolumeDrag = -out.controlVolume.value.dot(e);
  out.controlVolumeDragSigma = uncertainty.balance.along(e);
  out.controlVolumeLiftSigma = uncertainty.balance.across(e);
  out.controlVolumeLift = out.controlVolume.value + out.controlVolumeDrag * e;
  out.controlVolumeDragCoefficient = out.controlVolumeDrag / scale;
}

} // namespace

ForceResult surfaceForce(const ForceFields& fields, const Body& body, const ForceOptions& options,
                         const Progress& progress) {
  check(fields, body, options);
  require(distanceFromFaces(fields.grid, body.centre) > -0.5 * body.diameter,
          "the body lies outside the grid");
  const Surface surface(fields, body, options, part(progress, 0, 0.1));
  const GeodesicSphere& sphere = surface.sphere();
  ForceResult out;
  if (surface.seen().size() < sphere.points.size()) return out; // aborted
  out.seen = surface.seen();
  for (std::size_t i = 0; i < sphere.points.size(); ++i)
    if (out.seen[i]) out.coverage += sphere.area[i] / (4 * M_PI);
  require(out.coverage > 0, "no node with fluid is near the body");
  if (out.coverage > 1 - 1e-9) out.coverage = 1;
  if (out.coverage < 1)
    addNote(out.note, "only " + percent(out.coverage) + " of the surface is seen, the rest is carried over");

  if (surface.coarseness() > 1)
    addNote(out.note, "the spacing is " + percent(surface.coarseness()) +
                          " of the boundary layer's thickness d/sqrt(Re): friction comes out too large");

  const std::optional<Variations> all = variations(surface, body, options, part(progress, 0.1, 0.8));
  if (!all) return {};
  const Forces& forces = all->forces;
  Uncertainty uncertainty(*all, surface.coarseness());
  const Vec pressureVariance =
      fillSurface(FluidNodes(fields, body), sphere, forces, out, part(progress, 0.8, 1));
  if (out.points.empty()) return {};
  uncertainty.pressure.addComponents(pressureVariance.cwiseSqrt());
  uncertainty.both.addComponents(pressureVariance.cwiseSqrt());
  out.pressureForce = {forces.pressureForce, uncertainty.pressure.sigma(), true};
  out.friction = {forces.friction, uncertainty.friction.sigma(), true};
  setControlVolume(surface, forces.balance, uncertainty.balance.sigma(), out);
  out.inertia = inertia(body, options);
  setDragAndLift(body, options.density, uncertainty, out);
  return out;
}

} // namespace rimflow
