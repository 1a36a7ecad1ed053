#pragma once
#include "SphereTracker.h"

namespace rimflow {

/// Follows one or several spheres through the same snapshots. Each has its own tracker; what is found of one
/// is no fluid for the others. In each snapshot the largest is looked for first, because its void could hold
/// a smaller one. A sphere that is not yet looked for in a snapshot stands where it is expected, so that no
/// other takes its place. Spheres of equal diameter keep their names by their motion: if in a snapshot two of
/// them are both nearer to where the other was expected, they are exchanged.
class SphereGroup {
public:
  /// diameters: one per sphere, m, > 0; `options.likelihood.diameter` is not used, and a guess is that of the
  /// first sphere. Throws std::invalid_argument.
  SphereGroup(const TrackerOptions& options, const std::vector<double>& diameters);

  /// Looks for every sphere that wants this time. False: aborted.
  bool locate(double time, const SnapshotParticles& particles, const FlowField* flow = nullptr,
              const Progress& progress = {});

  bool wants(double time) const;
  bool knows(double time) const { return trackers_.front().knows(time); }
  /// Times that another look may find, latest first.
  std::vector<double> worthAnotherLook() const;

  std::size_t size() const { return trackers_.size(); }
  const SphereTracker& operator[](std::size_t sphere) const { return trackers_[sphere]; }

private:
  std::vector<Body> others(std::size_t sphere, double time) const;
  void unmix(double time, const std::vector<std::optional<SphereTracker::Guess>>& expected);

  std::vector<double> diameters_;
  std::vector<SphereTracker> trackers_; // as given
  std::vector<std::size_t> order_;      // the largest first
};

} // namespace rimflow
