#pragma once
#include <string>
#include <vector>

namespace rimflow {

/// The column of a table that tells when a row was recorded.
struct TimeColumn {
  int index = -1; ///< -1: there is none
  enum class Unit { Seconds, Frames, NotStated, NotKnown } unit = Unit::NotStated;
  double seconds = 1; ///< per unit (Seconds)
  std::string label;  ///< the unit as written
};

/// The column called t or time (`Time[s]`, `t[ms]`, `time [us]`, `Time[frame]`), else the one called frame,
/// FrameID, step or snapshot, which counts frames. Upper or lower case.
TimeColumn findTimeColumn(const std::vector<std::string>& names);

} // namespace rimflow
