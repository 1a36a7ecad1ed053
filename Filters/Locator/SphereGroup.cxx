#include "SphereGroup.h"

#include <algorithm>
#include <functional>
#include <numeric>
#include <set>
#include <stdexcept>

namespace rimflow {
namespace {

constexpr double Precise =
    0.4; // diameters: the side of a prediction's cube below which a sphere holds its place

Body ball(const Eigen::Vector3d& centre, double diameter) {
  Body body;
  body.diameter = diameter;
  body.centre = centre;
  return body;
}

} // namespace

SphereGroup::SphereGroup(const TrackerOptions& options, const std::vector<double>& diameters)
    : diameters_(diameters), order_(diameters.size()) {
  if (diameters.empty()) throw std::invalid_argument("there is no diameter; give one per sphere");
  for (const double diameter : diameters) {
    TrackerOptions own = options;
    own.likelihood.diameter = diameter;
    if (!trackers_.empty()) own.guess.reset();
    trackers_.emplace_back(own);
  }
  std::iota(order_.begin(), order_.end(), 0);
  std::stable_sort(order_.begin(), order_.end(),
                   [&](std::size_t a, std::size_t b) { return diameters[a] > diameters[b]; });
}

bool SphereGroup::wants(double time) const {
  return std::any_of(trackers_.begin(), trackers_.end(),
                     [time](const SphereTracker& t) { return t.wants(time); });
}

std::vector<double> SphereGroup::worthAnotherLook() const {
  std::set<double, std::greater<double>> times;
  for (const SphereTracker& t : trackers_) {
    const std::vector<double> of = t.worthAnotherLook();
    times.insert(of.begin(), of.end());
  }
  return {times.begin(), times.end()};
}

/// Where the other spheres are at this time: as found, else as expected where that is precise.
std::vector<Body> SphereGroup::others(std::size_t sphere, double time) const {
  std::vector<Body> bodies;
  for (std::size_t j = 0; j < trackers_.size(); ++j) {
    if (j == sphere) continue;
    const auto known = trackers_[j].known().find(time);
    const bool looked = known != trackers_[j].known().end();
    if (looked && known->second.found)
      bodies.push_back(ball(known->second.centre, known->second.diameter));
    else if (const auto guess = looked ? std::nullopt : trackers_[j].predict(time);
             guess && guess->side <= Precise * diameters_[j])
      bodies.push_back(ball(guess->centre, diameters_[j]));
  }
  return bodies;
}

bool SphereGroup::locate(double time, const SnapshotParticles& particles, const FlowField* flow,
                         const Progress& progress) {
  std::vector<std::optional<SphereTracker::Guess>> expected;
  for (const SphereTracker& t : trackers_) expected.push_back(t.predict(time));
  for (const std::size_t i : order_) {
    if (!trackers_[i].wants(time)) continue;
    trackers_[i].locate(time, particles, flow, others(i, time), progress);
    if (!trackers_[i].knows(time)) return false;
  }
  unmix(time, expected);
  return true;
}

void SphereGroup::unmix(double time, const std::vector<std::optional<SphereTracker::Guess>>& expected) {
  for (std::size_t i = 0; i < trackers_.size(); ++i)
    for (std::size_t j = i + 1; j < trackers_.size(); ++j) {
      const LocatedSphere &a = trackers_[i].known().at(time), &b = trackers_[j].known().at(time);
      if (diameters_[i] != diameters_[j] || !expected[i] || !expected[j] || !(a.found || b.found)) continue;
      const auto miss = [](const LocatedSphere& s, const SphereTracker::Guess& g) {
        return s.found ? (s.centre - g.centre).squaredNorm() : 0;
      };
      if (miss(a, *expected[j]) + miss(b, *expected[i]) < miss(a, *expected[i]) + miss(b, *expected[j]))
        trackers_[i].exchange(trackers_[j], time);
    }
}

} // namespace rimflow
