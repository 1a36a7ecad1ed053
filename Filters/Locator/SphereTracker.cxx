#include "SphereTracker.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <vector>

namespace rimflow {
namespace {

using Eigen::Vector3d;

constexpr double FollowedEnclosure =
    0.25; // least enclosure of a sphere that is followed: in a corner of the volume

/// How sure a find must be. Where the sphere is expected it is likely from the start, and it may leave the
/// volume by an edge or a corner, where tracers are on few sides of it only.
struct Doubt {
  double falseAlarm, enclosure;
};

/// Whether a void near a guess is a sphere: unlikely enough by chance, with tracers around it, and closed.
bool isSphere(const VoidEstimate& v, const SnapshotParticles& particles, double searchVolume,
              const Doubt& doubt, const VoidLikelihoodOptions& o) {
  const ParticleIndex& index = particles.index;
  const double radius = 0.5 * v.diameter;
  const double places = independentPlaces(std::min(searchVolume, index.box().volume()), radius);
  const double alarm = logFalseAlarm(v, places), limit = std::log(doubt.falseAlarm);
  return alarm - boundedFlowEvidence(index, particles.velocities, v, alarm, limit) <= limit &&
         enclosure(index, v.centre, radius) >= doubt.enclosure && closedLikeASphere(index, o.others, v);
}

LocatedSphere fromLikelihood(const VoidEstimate& v) {
  LocatedSphere s;
  s.found = true;
  s.text = "found";
  s.centre = v.centre;
  s.covariance = v.covariance;
  s.diameter = v.diameter;
  s.diameterSigma = v.diameterSigma;
  s.ghostRate = v.ghostRate;
  s.positionNoise = v.positionNoise;
  s.cost = v.cost;
  s.gradientNorm = v.gradientNorm;
  s.iterations = v.iterations;
  s.particlesInside = v.particlesInside;
  s.offsetVoid = (v.voidMinimiser - v.centre).norm();
  return s;
}

LocatedSphere fromPublished(const PublishedEstimate& e, double diameter) {
  LocatedSphere s;
  s.found = true;
  s.text = e.convergence == Convergence::Gradient    ? "found"
           : e.convergence == Convergence::NoDescent ? "found; stopped where no step goes downhill"
                                                     : "found; stopped at the largest number of iterations";
  if (!e.positiveDefinite)
    s.text += "; the Hessian is not positive definite, so the covariance is that of a tenth of the diameter";
  s.centre = e.centre;
  s.diameter = diameter;
  s.covariance = e.positiveDefinite
                     ? e.covariance
                     : Eigen::Matrix3d(std::pow(0.1 * diameter, 2) * Eigen::Matrix3d::Identity());
  s.cost = e.cost;
  s.gradientNorm = e.gradientNorm;
  s.iterations = e.iterations;
  s.particlesInside = e.particlesInside;
  s.offsetVoid = (e.voidMinimiser - e.centre).norm();
  s.offsetVelocity = (e.velocityMinimiser - e.centre).norm();
  s.offsetVortex = (e.vortexMinimiser - e.centre).norm();
  return s;
}

/// No slip: the fit u = V + G s over the particles closer than R/10 to the wall, s their distance from it.
void addWallVelocity(LocatedSphere& sphere, const ParticleIndex& index, const float* velocities,
                     double radius) {
  std::vector<Vector3d> u;
  std::vector<double> s;
  index.forEachWithin(sphere.centre, 1.1 * radius, [&](std::uint32_t id, float dx, float dy, float dz) {
    const double distance = std::sqrt(double(dx) * dx + double(dy) * dy + double(dz) * dz) - radius;
    const Vector3d velocity(velocities[3 * id], velocities[3 * id + 1], velocities[3 * id + 2]);
    if (distance < 0 || !velocity.allFinite()) return;
    s.push_back(distance);
    u.push_back(velocity);
  });
  if (u.size() < 10) return;
  const double n = double(u.size());
  double meanS = 0, varianceS = 0;
  Vector3d meanU = Vector3d::Zero(), covariance = Vector3d::Zero();
  for (std::size_t k = 0; k < u.size(); ++k) {
    meanS += s[k] / n;
    meanU += u[k] / n;
  }
  for (std::size_t k = 0; k < u.size(); ++k) {
    varianceS += std::pow(s[k] - meanS, 2) / n;
    covariance += (s[k] - meanS) * (u[k] - meanU) / n;
  }
  if (varianceS <= 0) return;
  const Vector3d slope = covariance / varianceS;
  double residual = 0;
  for (std::size_t k = 0; k < u.size(); ++k)
    residual += (u[k] - meanU - slope * (s[k] - meanS)).squaredNorm() / (3 * (n - 2));
  sphere.wallVelocity = meanU - slope * meanS;
  sphere.wallVelocitySigma = std::sqrt(residual / n * (1 + meanS * meanS / varianceS));
}

/// Gradient and Hessian of the tracers that a ball of fluid would hold, by its centre.
void addSeeding(WallView& wall, const SeedingDensity& seeding, const Vector3d& centre, double radius) {
  const double step = 0.05 * radius;
  wall.tilt = seeding.expectedGradient(centre, radius);
  for (int a = 0; a < 3; ++a) {
    const Vector3d e = step * Vector3d::Unit(a);
    wall.bend.col(a) =
        (seeding.expectedGradient(centre + e, radius) - seeding.expectedGradient(centre - e, radius)) /
        (2 * step);
  }
  wall.bend = 0.5 * (wall.bend + wall.bend.transpose()).eval();
}

/// The tracers next to the wall. The joint estimate needs all that a path may touch; the flow around the
/// sphere is told by those farther out, of which a sample of tracks is enough.
std::shared_ptr<const WallView> wallOf(const LocatedSphere& sphere, const SeedingDensity& seeding,
                                       const SnapshotParticles& particles) {
  constexpr double Outermost = 1.6, FarInstances = 400; // radii; particles in the outer part
  const double radius = 0.5 * sphere.diameter;
  WallView wall;
  wall.ghostRate = sphere.ghostRate;
  wall.positionNoise = sphere.positionNoise;
  wall.reach = std::min(radius, std::max(0.1 * radius, 6 * std::sqrt(sphere.covariance.trace())));
  addSeeding(wall, seeding, sphere.centre, radius);
  const double near = radius + 3 * wall.reach, far = std::max(near, Outermost * radius);
  const double expected =
      seeding.expectedWithin(sphere.centre, far) - seeding.expectedWithin(sphere.centre, radius);
  const std::uint64_t keep = std::uint64_t(std::min(1., FarInstances / std::max(expected, 1.)) * 1024);
  particles.index.forEachWithin(sphere.centre, far, [&](std::uint32_t id, float dx, float dy, float dz) {
    WallParticle p;
    p.offset = {dx, dy, dz};
    const double distance = p.offset.norm();
    if (distance < radius - wall.reach) return;
    if (particles.tracks) p.track = particles.tracks[id];
    // whole tracks or nothing: by their ids, well mixed
    const std::uint64_t number = particles.tracks ? std::uint64_t(p.track) : id;
    if (distance > near && (number * 0x9E3779B97F4A7C15ull >> 54) >= keep) return;
    if (particles.velocities)
      p.velocity = Eigen::Map<const Eigen::Vector3f>(particles.velocities + 3 * std::size_t(id));
    wall.particles.push_back(p);
  });
  return std::make_shared<const WallView>(std::move(wall));
}

} // namespace

SphereTracker::SphereTracker(const TrackerOptions& options) : options_(options) {
  const double d = options.likelihood.diameter;
  if (!(d > 0) || !std::isfinite(d))
    throw std::invalid_argument("the diameter is " + std::to_string(d) + " m; it must be greater than 0");
  options_.published.diameter = d;
  options_.published.searchSide = options.likelihood.searchSide;
}

/// The centre at `time` from the found snapshot nearest in time and the velocity over a base as long as the
/// leap. The cube holds what the prediction may be off: 20 % of the leap and four standard deviations. A
/// narrow one leaves chance fewer places, so that in thin seeding a void counts that a wide search would
/// doubt.
std::optional<SphereTracker::Guess> SphereTracker::predict(double time) const {
  const double diameter = options_.likelihood.diameter;
  const double widest = options_.likelihood.searchSide > 0 ? options_.likelihood.searchSide : diameter;
  const auto nearest = [&](double target, double except) {
    auto best = known_.end();
    for (auto k = known_.begin(); k != known_.end(); ++k)
      if (k->second.found && k->first != except &&
          (best == known_.end() || std::abs(k->first - target) < std::abs(best->first - target)))
        best = k;
    return best;
  };
  const auto from = nearest(time, std::numeric_limits<double>::quiet_NaN());
  if (from == known_.end())
    return options_.guess ? std::optional<Guess>({*options_.guess, widest}) : std::nullopt;
  const double leap = time - from->first;
  const auto base = nearest(from->first - leap, from->first);
  const Vector3d last = from->second.centre;
  const bool wall = from->second.wallVelocitySigma >= 0;
  if (base == known_.end() && !wall) return Guess{last, widest};
  const Vector3d velocity = base == known_.end()
                                ? from->second.wallVelocity
                                : Vector3d((last - base->second.centre) / (from->first - base->first));
  double side = 0.4 * std::abs(leap) * velocity.norm() + 8 * std::sqrt(from->second.covariance.trace());
  if (options_.likelihood.searchSide > 0) side = widest; // the user's word
  return Guess{last + leap * velocity, std::min(std::max(side, 0.2 * diameter), widest)};
}

bool SphereTracker::anyFound() const {
  return std::any_of(known_.begin(), known_.end(), [](const auto& k) { return k.second.found; });
}

std::vector<double> SphereTracker::worthAnotherLook() const {
  if (!anyFound()) return {};
  return {lostBlindly_.rbegin(), lostBlindly_.rend()};
}

bool SphereTracker::wants(double time) const {
  return !knows(time) || (lostBlindly_.count(time) > 0 && anyFound());
}

void SphereTracker::exchange(SphereTracker& other, double time) {
  std::swap(known_.at(time), other.known_.at(time));
}

/// Near the guess, and unless that was done before, everywhere.
LocatedSphere SphereTracker::search(const SnapshotParticles& particles, const std::optional<Guess>& guess,
                                    bool everywhere, const FlowField* flow, const std::vector<Body>& others,
                                    const Progress& progress) const {
  LocatedSphere lost;
  const ParticleIndex& index = particles.index;
  if (index.size() < 20) {
    lost.text = "only " + std::to_string(index.size()) + " particles";
    return lost;
  }
  VoidLikelihoodOptions sphere = options_.likelihood;
  sphere.others = others;
  const double side = sphere.searchSide > 0 ? sphere.searchSide : sphere.diameter;
  SeedingDensity seeding(index, 0.25 * sphere.diameter);

  const auto at = [&](const Guess& g, const Doubt& doubt,
                      const Progress& watch) -> std::optional<LocatedSphere> {
    const Vector3d start = index.box().clamp(g.centre);
    VoidLikelihoodOptions near = sphere;
    near.searchSide = g.side;
    const bool published = options_.method == LocatorMethod::PublishedCost;
    const VoidEstimate v =
        published ? roughVoid(index, seeding, start, near) : locateVoid(index, seeding, start, near, watch);
    if (!goOn(watch, 0.9)) return std::nullopt;
    if (!isSphere(v, particles, g.side * g.side * g.side, doubt, near)) return std::nullopt;
    // Found far outside the cube: then it was not searched among the cube's places alone.
    if (g.side < side && (v.centre - start).cwiseAbs().maxCoeff() > 0.75 * g.side) return std::nullopt;
    LocatedSphere found =
        published
            ? fromPublished(minimisePublishedCost(index, *flow, start, options_.published), sphere.diameter)
            : fromLikelihood(v);
    if (particles.velocities) addWallVelocity(found, index, particles.velocities, 0.5 * found.diameter);
    if (!published) found.wall = wallOf(found, seeding, particles);
    return found;
  };
  const Doubt unexpected{options_.capture.falseAlarm, LeastEnclosure},
      expected{options_.followFalseAlarm, FollowedEnclosure};
  if (guess) {
    const bool follows = anyFound() && index.box().contains(guess->centre);
    if (const auto found = at(*guess, follows ? expected : unexpected, part(progress, 0, 0.2))) return *found;
  }
  if (!everywhere || !goOn(progress, 0.2)) return lost;
  const CaptureResult capture =
      captureSphere(index, seeding, sphere, options_.capture, part(progress, 0.2, 0.8), particles.velocities);
  if (!capture.found) {
    lost.text = capture.reason;
    return lost;
  }
  // Where the flow had to help, other voids are near.
  const double near = capture.flowEvidence > 0 ? std::min(side, 0.4 * sphere.diameter) : side;
  if (const auto found = at({capture.centre, near}, unexpected, part(progress, 0.8, 1))) return *found;
  lost.text = "a void was captured, but it is no sphere of this diameter when looked at closely";
  return lost;
}

const LocatedSphere& SphereTracker::locate(double time, const SnapshotParticles& particles,
                                           const FlowField* flow, const std::vector<Body>& others,
                                           const Progress& progress) {
  if (!wants(time)) return known_.at(time);
  const bool again = knows(time);
  if (options_.method == LocatorMethod::PublishedCost && !flow)
    throw std::invalid_argument(
        "the published cost needs the flow on a grid with the arrays Velocity and QCriterion");
  bool aborted = false;
  const Progress watched = [&](double fraction) {
    aborted = aborted || !goOn(progress, fraction);
    return !aborted;
  };
  const LocatedSphere sphere = search(particles, predict(time), !again, flow, others, watched);
  if (aborted) {
    aborted_ = LocatedSphere();
    aborted_.text = "aborted";
    return aborted_;
  }
  if (!sphere.found && !again && !anyFound())
    lostBlindly_.insert(time);
  else
    lostBlindly_.erase(time);
  if (!sphere.found && again) return known_.at(time); // with the reason that the whole search gave
  return known_[time] = sphere;
}

} // namespace rimflow
