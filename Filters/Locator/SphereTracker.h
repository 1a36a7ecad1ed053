#pragma once
#include "CentreEstimate.h"
#include "PublishedCost.h"
#include "SphereCapture.h"

#include <limits>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <vector>

namespace rimflow {

enum class LocatorMethod { VoidLikelihood, PublishedCost };

struct TrackerOptions {
  LocatorMethod method = LocatorMethod::VoidLikelihood;
  VoidLikelihoodOptions likelihood; ///< its diameter is the sphere's
  PublishedCostOptions published;   ///< its diameter and searchSide are taken from `likelihood`
  CaptureOptions capture;
  double followFalseAlarm = 1e-2; ///< as capture.falseAlarm, where the sphere is expected: there it is likely
  std::optional<Eigen::Vector3d> guess; ///< of the centre in the first snapshot, m; none: capture
};

/// One snapshot as the tracker wants it. The arrays must outlive it.
struct SnapshotParticles {
  /// positions: x y z per particle, m. velocities: three per particle, m/s, or null. tracks: the id of each
  /// particle's track, or null.
  SnapshotParticles(const float* positions, std::size_t count, const float* velocities_ = nullptr,
                    const std::int64_t* tracks_ = nullptr)
      : index(positions, count), velocities(velocities_), tracks(tracks_) {}

  ParticleIndex index;
  const float* velocities;
  const std::int64_t* tracks;
};

/// What one snapshot says of the sphere by itself. Offsets are distances from the centre of the place that a
/// single criterion would choose, m; -1: not computed (the method or the flow is missing).
struct LocatedSphere {
  bool found = false;
  std::string text;                                 ///< why it was not found, or what to know about the find
  Eigen::Vector3d centre = Eigen::Vector3d::Zero(); ///< m
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero(); ///< m2; positive definite when found
  double diameter = 0, diameterSigma = 0;               ///< given, or fitted, m
  double ghostRate = 0.005, positionNoise = 5e-6;       ///< as this snapshot estimates them; the noise in m
  double cost = 0, gradientNorm = 0;                    ///< of -log L, or of J; the gradient in 1/m
  int iterations = 0;
  std::size_t particlesInside = 0;
  double offsetVoid = -1, offsetVelocity = -1, offsetVortex = -1;
  /// Velocity of the wall from the particles next to it (no slip), m/s; wallVelocitySigma < 0: too few of
  /// them.
  Eigen::Vector3d wallVelocity = Eigen::Vector3d::Zero();
  double wallVelocitySigma = -1;
  /// For the joint estimate of several snapshots; null when lost, and with the published cost.
  std::shared_ptr<const WallView> wall;
};

/// Follows a sphere through snapshots that come in any order. A snapshot's result is decided by its own
/// particles; what was found at other times only says where to look first. Where nothing is there, the whole
/// volume is searched.
class SphereTracker {
public:
  /// Throws std::invalid_argument when the diameter is not greater than 0.
  explicit SphereTracker(const TrackerOptions& options);

  /// The sphere at `time`; kept, so that asking again costs nothing. flow: needed by the published cost.
  /// others: where other spheres are at this time. When progress aborts, the result says so and is not kept.
  /// A time that was lost before anything had been found is looked at once more when asked for again: then
  /// other times say where to look.
  const LocatedSphere& locate(double time, const SnapshotParticles& particles,
                              const FlowField* flow = nullptr, const std::vector<Body>& others = {},
                              const Progress& progress = {});

  /// Where to look first, in a cube of this side.
  struct Guess {
    Eigen::Vector3d centre;
    double side;
  };
  /// From what was found at other times, or the user's guess; none: there is neither.
  std::optional<Guess> predict(double time) const;

  /// Whether locate() would look at the particles.
  bool wants(double time) const;
  bool knows(double time) const { return known_.count(time) > 0; }
  /// The times that another look may find, latest first: so each find says where to look in the next.
  std::vector<double> worthAnotherLook() const;
  /// Everything found so far, by time.
  const std::map<double, LocatedSphere>& known() const { return known_; }
  /// Takes the other's result at a time that both know, and gives its own: two equal spheres were mistaken
  /// for each other.
  void exchange(SphereTracker& other, double time);

private:
  bool anyFound() const;
  LocatedSphere search(const SnapshotParticles& particles, const std::optional<Guess>& guess, bool everywhere,
                       const FlowField* flow, const std::vector<Body>& others,
                       const Progress& progress) const;

  TrackerOptions options_;
  std::map<double, LocatedSphere> known_;
  std::set<double> lostBlindly_; // lost when nothing had been found
  LocatedSphere aborted_;
};

} // namespace rimflow
