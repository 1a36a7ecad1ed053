#pragma once
#include "TrackColumns.h"

#include <cstddef>
#include <cstdint>
#include <functional>
#include <string>
#include <string_view>
#include <vector>

namespace rimflow {

/// How the rows of one file of a track table are to be read.
struct TrackTableLayout {
  std::vector<std::string> columns; ///< names, with units if there are any, as planTrackColumns takes them
  std::vector<bool> ignored;        ///< columns that nobody needs; may be shorter than `columns`
  int frame = -1;                   ///< column of the frame number, or of the time; -1: one snapshot per file
  double secondsPerUnit = 0;        ///< of a column of times; 0: it counts frames
  bool perFrame = false;   ///< velocities are lengths per frame, accelerations lengths per frame squared
  bool zeroIsNone = false; ///< a particle with zero velocity and acceleration has none
  char delimiter = 0;      ///< a comma or semicolon between values of which some may be missing
  bool oneLine = false;    ///< rows are not lines, but groups of as many values as there are columns
  std::size_t rows = 0;    ///< byte at which the rows begin
  std::int64_t declaredRows = -1; ///< -1: the file does not say
  std::string expected;           ///< why so many values per row: "as many as there are names in line 1"
  std::string withoutIds;         ///< said where there are no track ids; empty: that they should be exported
  std::vector<std::string> warnings; ///< without the file
};

/// A format of tables: what to call it, and how to find the layout of a file from its first bytes. `layout`
/// throws std::runtime_error, without the file's name: "line 1: no column x ...".
struct TrackTableFormat {
  std::string name;
  std::function<TrackTableLayout(std::string_view head)> layout;
  bool idsRestart = false; ///< every file counts its tracks from 0
};

/// Bytes from a file's beginning that must suffice to recognise it.
constexpr std::size_t trackHeadBytes = 1 << 16;

/// What read() puts out: the columns in SI for a length unit chosen by the user.
TrackColumnPlan outputPlan(const TrackTableLayout& layout, LengthUnit unit);

/// For reading the rows as they are, without units; the frame column is the last of the further ones.
TrackColumnPlan rawPlan(const TrackTableLayout& layout);

} // namespace rimflow
