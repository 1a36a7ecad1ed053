#pragma once
#include "TrackSnapshot.h"
#include "TrackStatistics.h"

#include <cstdint>
#include <vector>

namespace rimflow {

/// Which particles are shown. A track is kept or left out as a whole, whatever the snapshot.
struct TrackSelection {
  /// Keep the tracks whose id is a multiple of stride (>= 1): one in `stride`, as ids are numbered through.
  /// Particles without a track (no trackID in the file, or a negative one) are counted off in the file's
  /// order instead.
  std::int64_t stride = 1;
  std::int64_t firstId = -1, lastId = -1;  ///< only ids from first to last; a negative end is open
  int minimumLength = 1;                   ///< only tracks that appear in at least so many snapshots
  const TrackStatistics* tracks = nullptr; ///< needed for minimumLength > 1

  bool keepsAll() const { return stride <= 1 && firstId < 0 && lastId < 0 && minimumLength <= 1; }
  /// A row of a snapshot; trackId is negative for a particle without a track.
  bool keeps(std::int64_t trackId, std::size_t row) const {
    const std::int64_t number = trackId < 0 ? std::int64_t(row) : trackId;
    return (stride <= 1 || number % stride == 0) && (firstId < 0 || trackId >= firstId) &&
           (lastId < 0 || (trackId >= 0 && trackId <= lastId)) &&
           (minimumLength <= 1 || (tracks && tracks->of(trackId).length >= minimumLength));
  }
};

/// The rows of a snapshot that are kept, in order.
std::vector<std::uint32_t> selectedRows(const TrackSnapshot& snapshot, const TrackSelection& selection);
/// A snapshot with these rows only.
TrackSnapshot takeRows(const TrackSnapshot& snapshot, const std::vector<std::uint32_t>& rows);

} // namespace rimflow
