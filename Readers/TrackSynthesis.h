#pragma once
#include "AnalyticFlows.h"
#include "Progress.h"

#include <array>
#include <cstdint>
#include <memory>
#include <vector>

namespace rimflow {

/// Particle tracks as a Shake-The-Box measurement of an analytic flow would give them. SI units.
struct TrackSynthesisOptions {
  AnalyticFlow flow;
  std::array<double, 6> bounds{-0.02, 0.02, -0.03, 0.03, -0.0125, 0.0125}; ///< of the visible volume, m
  double density = 4e8;                                                    ///< tracers per m3 of fluid, >= 0
  int snapshots = 40;                                                      ///< >= 1
  double framePeriod = 0.001;                                              ///< s, > 0
  double startTime = 0;                                                    ///< of snapshot 0, s

  double positionNoise = 0;     ///< standard deviation per component (Gaussian), m, >= 0
  double velocityNoise = 0;     ///< m/s, >= 0
  double accelerationNoise = 0; ///< m/s2, >= 0
  double dropOut = 0;       ///< fraction of the particles missing from each snapshot, independently, 0..0.99
  double ghostFraction = 0; ///< fraction of all rows that belong to ghost tracks, 0..0.99
  int minimumTrackLength = 1; ///< shorter tracks are left out, snapshots; at most `snapshots` counts
  double wakeDepletion = 0;   ///< fraction of the tracers that are not seen in the wake, 0..1
  double wakeLength = 2;      ///< of the cylinder of the sphere's diameter behind its centre, diameters

  std::uint64_t seed = 1;
  std::size_t memoryLimit = std::size_t(256) << 20; ///< about what the stored trajectories may take, bytes
};

/// One snapshot; three floats per particle and vector.
struct SyntheticSnapshot {
  std::vector<float> position, velocity, acceleration;
  std::vector<std::int64_t> trackId; ///< >= 0; the same particle has a new one after a gap
  // What is behind each row, if asked for. A ghost has the flow at its true place.
  std::vector<float> trueVelocity, trueAcceleration, truePressure;
  std::vector<std::int64_t> trueTracerId; ///< the same for all tracks of a tracer; -1 for a ghost
  std::size_t size() const { return trackId.size(); }
};

/// Tracks of ideal tracers, with any snapshot at hand at any time:
/// - tracers are seeded uniformly, outside the wall, at the time of snapshot 0 and so far around the bounds
///   that the volume stays uniformly filled (the flows are divergence-free, so carrying keeps the density);
/// - prepare() carries each one through the whole period (Runge-Kutta, fourth order, steps that follow the
///   flow's time scale at the tracer), notes when it is inside the bounds, and keeps its place at every few
///   snapshots, as many as the memory limit allows;
/// - snapshot() starts from the kept place before it. Noise, drop-out and ghosts are functions of
///   (seed, tracer, snapshot), so that a snapshot is the same whichever was asked for before, bit by bit.
/// A track is a run of snapshots in which the tracer is inside the bounds, not hidden in the wake and not
/// dropped; only the snapshots of the period count. Ghosts: tracks of 4 or 5 snapshots (or as many more as
/// the minimum length and the last snapshot demand) on straight lines anywhere in the bounds, inside the
/// sphere too, at speeds up to half of the flow's, with random accelerations. Noise is added last: it may
/// carry particles next to the wall or to the bounds across.
class TrackSynthesis {
public:
  TrackSynthesis();
  ~TrackSynthesis();
  TrackSynthesis(TrackSynthesis&&) noexcept;
  TrackSynthesis& operator=(TrackSynthesis&&) noexcept;

  /// Throws std::invalid_argument naming the option that is out of range. False when aborted.
  bool prepare(const TrackSynthesisOptions& options, const Progress& progress = {});

  /// Snapshot k, 0 <= k < snapshots. Rows come in a fixed order.
  SyntheticSnapshot snapshot(int k, bool withTruth = false) const;

  double time(int k) const;
  const TrackSynthesisOptions& options() const;
  std::size_t storedBytes() const; ///< taken by trajectories

private:
  struct Implementation;
  std::unique_ptr<Implementation> implementation_;
};

} // namespace rimflow
