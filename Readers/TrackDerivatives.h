#pragma once
#include "TrackSnapshot.h"

#include <cstddef>
#include <cstdint>
#include <limits>
#include <memory>
#include <vector>

namespace rimflow {

/// The defaults erred least on tracks of 4 to 40 snapshots around a sphere, at 19 and 38 frames per diameter
/// of travel, with 2 to 15 um of noise. Motion that turns within some 40 frames, seen with little noise,
/// wants order 3 with 7 to 11 points.
struct TrackDerivativeOptions {
  int order = 2;  ///< of the polynomial in time, 2 to 5
  int window = 9; ///< points that it is fitted to, odd, > order, at most 31
};

/// Snapshots in the order of time around one of them.
struct TrackWindow {
  std::vector<std::shared_ptr<const TrackSnapshot>> snapshots; ///< none null
  std::vector<double> times;                                   ///< s, one for each snapshot
  std::size_t current = 0;
};

/// Snapshots to give before and after the current one, as far as the recording has them: window - 1, so that
/// a track that begins or ends at the current snapshot still has its full number of points.
inline std::size_t snapshotsEachSide(const TrackDerivativeOptions& options) {
  return std::size_t(options.window - 1);
}

/// Standard deviation of a derivative over that of the positions, for noise that is white in time. NaN: the
/// derivative does not exist.
struct DerivativeGain {
  double velocity = 0;     ///< 1/s
  double acceleration = 0; ///< 1/s2
};

/// The derivatives as weighted sums of positions: velocity = sum_i velocity[i] x(snapshot[i]).
struct DerivativeStencil {
  std::vector<std::int32_t> snapshot; ///< places among the times, in the order of time
  std::vector<double> velocity;       ///< 1/s; empty: there is none
  std::vector<double> acceleration;   ///< 1/s2; empty: there is none
  DerivativeGain gain{std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::quiet_NaN()};
};

/// What estimateDerivatives does with a track that was seen at all of these times (s), at times[current].
DerivativeStencil derivativeStencil(const std::vector<double>& times, std::size_t current,
                                    const TrackDerivativeOptions& options);

/// Fills velocity (m/s) and acceleration (m/s2) of `particles`, a copy of the current snapshot with the same
/// rows: the first and second derivative, at the current time, of a polynomial that fits the track's
/// positions best (least squares, real times). It is fitted to the `window` points of the track nearest in
/// time to the current one, out of window - 1 snapshots before and after: the middle of a track has as many
/// points on both sides, its ends have as many points on one side only, and gaps are bridged by points
/// farther off. Snapshots beyond that are not looked at.
///
/// A track with fewer points there takes the highest order p with 2 p + 1 points, so that its noise still
/// averages out, but at least order 2 for the acceleration: three points give one, two only a velocity (then
/// the acceleration is NaN), one neither. A particle with a negative id, with a position that is not finite,
/// or with the id of one before it in the snapshot has NaN for both; in the other snapshots such particles
/// are passed over. Without ids, all have NaN.
///
/// Returns the median gain over the particles with a velocity (NaN: there is none), and over those with an
/// acceleration. Independent of the number of threads. Throws std::invalid_argument when an option is out of
/// range or the window is not as described.
DerivativeGain estimateDerivatives(const TrackWindow& window, const TrackDerivativeOptions& options,
                                   TrackSnapshot& particles);

/// For each snapshot of the window the row that continues each row of the current snapshot, -1 for none. Rows
/// of the same track: same id >= 0, finite positions, the first one of that id in its snapshot. Only
/// snapshots `first` to `last` (both included) are looked at; element s - first is of snapshot s.
std::vector<std::vector<std::int32_t>> rowsOfTracks(const TrackWindow& window, std::size_t first,
                                                    std::size_t last);

} // namespace rimflow
