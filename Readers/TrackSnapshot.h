#pragma once
#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

namespace rimflow {

/// A column without a meaning of its own here: kept under its name, in the file's unit.
struct TrackColumn {
  std::string name;
  std::vector<double> values;
};

/// The particles of one time step, in SI units and in the file's order. An array is either empty (the file
/// does not have it) or complete.
struct TrackSnapshot {
  std::vector<float> position;       ///< m, xyz for each particle
  std::vector<float> velocity;       ///< m/s, xyz
  std::vector<float> acceleration;   ///< m/s2, xyz
  std::vector<float> intensity;      ///< as in the file
  std::vector<std::int64_t> trackId; ///< negative: this particle belongs to no track
  std::vector<TrackColumn> further;

  std::size_t size() const { return position.size() / 3; }
  /// Memory held, for caches with a limit.
  std::size_t bytes() const {
    std::size_t sum =
        4 * (position.size() + velocity.size() + acceleration.size() + intensity.size()) + 8 * trackId.size();
    for (const TrackColumn& c : further) sum += 8 * c.values.size();
    return sum;
  }
};

} // namespace rimflow
