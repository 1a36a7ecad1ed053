#pragma once
#include "TrackSnapshot.h"

#include <cstdint>
#include <memory>
#include <unordered_map>
#include <vector>

namespace rimflow {

/// In how many snapshots each track appears, counted over a whole series: two bytes per track where the ids
/// are dense.
class TrackLengths {
public:
  /// Adds one snapshot. An id that is there twice counts once; negative ids are no tracks. Throws
  /// std::runtime_error when the ids are so scattered that counting would take more than 256 MiB.
  void add(const std::vector<std::int64_t>& trackIds);
  /// 0 for an id that was never there; 65535 stands for that or more.
  int of(std::int64_t trackId) const;

private:
  static constexpr std::int64_t pageSize = 256;
  using Page = std::vector<std::uint16_t>;
  std::unordered_map<std::int64_t, Page> pages;
};

/// Which particles are shown. A track is kept or left out as a whole, whatever the snapshot.
struct TrackSelection {
  /// Keep the tracks whose id is a multiple of stride (>= 1): one in `stride`, as ids are numbered through.
  /// Particles without a track (no trackID in the file, or a negative one) are counted off in the file's
  /// order instead.
  std::int64_t stride = 1;
  std::int64_t firstId = -1, lastId = -1; ///< only ids from first to last; a negative end is open
  int minimumLength = 1;                  ///< only tracks that appear in at least so many snapshots
  const TrackLengths* lengths = nullptr;  ///< needed for minimumLength > 1

  bool keepsAll() const { return stride <= 1 && firstId < 0 && lastId < 0 && minimumLength <= 1; }
  /// A row of a snapshot; trackId is negative for a particle without a track.
  bool keeps(std::int64_t trackId, std::size_t row) const {
    const std::int64_t number = trackId < 0 ? std::int64_t(row) : trackId;
    return (stride <= 1 || number % stride == 0) && (firstId < 0 || trackId >= firstId) &&
           (lastId < 0 || (trackId >= 0 && trackId <= lastId)) &&
           (minimumLength <= 1 || (lengths && lengths->of(trackId) >= minimumLength));
  }
};

/// The rows of a snapshot that are kept, in order.
std::vector<std::uint32_t> selectedRows(const TrackSnapshot& snapshot, const TrackSelection& selection);
/// A snapshot with these rows only.
TrackSnapshot takeRows(const TrackSnapshot& snapshot, const std::vector<std::uint32_t>& rows);

} // namespace rimflow
