#pragma once
#include "Progress.h"
#include "TrackColumns.h"
#include "TrackSnapshot.h"

#include <cstdint>
#include <string_view>

namespace rimflow {

/// Longest line that is looked at, bytes: longer ones are no rows of a track table.
constexpr std::size_t longestTrackLine = std::size_t(1) << 20;

/// What was found in a block of rows.
struct TrackRowsResult {
  enum class Fault { None, TooFew, TooMany, NotANumber, NotAnId, TooLong, HeaderInside };
  Fault fault = Fault::None;
  std::size_t offset = 0;     ///< of the first fault: of the value, or of its row (TooFew, TooMany, TooLong)
  std::size_t values = 0;     ///< values in that row (TooFew, TooMany)
  std::size_t column = 0;     ///< of the value (NotANumber, NotAnId)
  std::int64_t rows = 0;      ///< rows read, kept or not
  std::int64_t notFinite = 0; ///< rows left out, because a position, velocity, acceleration, id or
                              ///< frame is NaN or Inf
  std::size_t firstNotFinite = 0; ///< offset of the first of them
  bool aborted = false;
};

/// Reads rows of numbers in parallel, separated by blanks, tabs, commas or semicolons, one row per line;
/// empty lines and lines that begin with # are skipped. Where the plan has a delimiter, a value may be
/// missing (TableHead.h says what that is) and counts as NaN, and may stand in quotes. The result does not
/// depend on the number of threads. With a fault or when aborted, `snapshot` is empty. `idsOnly`: fill only
/// trackId.
TrackRowsResult readTrackRows(std::string_view text, const TrackColumnPlan& plan, bool idsOnly,
                              TrackSnapshot& snapshot, const Progress& progress = {});

} // namespace rimflow
