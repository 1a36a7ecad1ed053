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

/// The column called t or time (`Time[s]`, `t[ms]`, `time [us]`), else the one that counts frames: frame,
/// FrameID, step, snapshot or `Time[frame]`. Upper or lower case. NotKnown: a time in a unit that is not s,
/// ms, us or ns, and nothing that counts frames.
TimeColumn findTimeColumn(const std::vector<std::string>& names);

} // namespace rimflow
