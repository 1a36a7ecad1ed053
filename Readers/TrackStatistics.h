#pragma once
#include <cstddef>
#include <cstdint>
#include <unordered_map>
#include <vector>

namespace rimflow {

/// In which snapshots of a series a track appears.
struct TrackSpan {
  std::int32_t first = -1, last = -1; ///< snapshots, from 0; -1 when the track is nowhere
  std::int32_t length = 0;            ///< number of snapshots in which it is, gaps not counted
};

/// The spans of all tracks of a series: 12 bytes per track where the ids are dense.
class TrackStatistics {
public:
  /// Adds a snapshot; snapshots come in the order of time. An id that is there twice counts once; negative
  /// ids are no tracks. Throws std::runtime_error when the ids are so scattered that this would take more
  /// than 512 MiB.
  void add(std::int32_t snapshot, const std::vector<std::int64_t>& trackIds);
  TrackSpan of(std::int64_t trackId) const;

private:
  static constexpr std::int64_t pageSize = 256;
  using Page = std::vector<TrackSpan>;
  std::unordered_map<std::int64_t, Page> pages;
};

} // namespace rimflow
