#pragma once
#include <cstddef>
#include <cstdint>
#include <limits>
#include <string>
#include <string_view>
#include <vector>

namespace rimflow {

/// What one ZONE record says.
struct TecplotZoneHeader {
  std::string title;
  std::int64_t rows = -1; ///< I=; -1 when missing or not a number
  std::int64_t j = 1, k = 1;
  double time = std::numeric_limits<double>::quiet_NaN(); ///< SOLUTIONTIME, s; NaN when missing or `None`
  std::string packing;                                    ///< DATAPACKING or F, upper case
  std::string zoneType;                                   ///< ZONETYPE, upper case
  std::size_t offset = 0;                                 ///< of the word ZONE in the block
  std::size_t end = 0;                                    ///< one past the record, in the block
  std::string problem;           ///< what could not be understood; empty when all is well
  std::size_t problemOffset = 0; ///< in the block
};

/// All header lines that stand between two blocks of numbers: TITLE, VARIABLES, any number of ZONE records,
/// in any order, on one line or on several.
struct TecplotHeader {
  bool hasVariables = false;
  std::vector<std::string> variables; ///< as written, without the quotes
  std::vector<TecplotZoneHeader> zones;
  std::string problem; ///< as in a zone, for what stands before the first ZONE
  std::size_t problemOffset = 0;
};

TecplotHeader parseTecplotHeader(std::string_view block);

/// Names stand in quotes, or without them between commas, or, without commas, between blanks (a unit in
/// brackets may follow its name after a blank: `x [mm]`).
std::vector<std::string> splitColumnNames(std::string_view list);

/// True when a line begins with a word that opens a header record (TITLE, VARIABLES, ZONE, ...), in upper or
/// lower case.
bool beginsTecplotRecord(std::string_view line);

/// True when a line is a row of numbers, or what is left of one: it begins with a digit, a sign, a point, NaN
/// or Inf.
bool looksLikeRow(std::string_view line);

} // namespace rimflow
