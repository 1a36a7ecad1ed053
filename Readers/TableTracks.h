#pragma once
#include "TrackTableLayout.h"

#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace rimflow {

/// Names and place of the header of a table: the last line before the first row of numbers, within the first
/// 20 lines, that names x, y and z (it may begin with # or %).
struct TableHeader {
  std::vector<std::string> names;
  std::size_t line = 0;        ///< of the names, from 1
  std::size_t linesBefore = 0; ///< lines that are not blank before the first row of numbers
  std::size_t rows = 0;        ///< byte at which the first row begins
  std::size_t values = 0;      ///< in the first row; 0: there is none
};
/// The names are empty when there are none; nothing at all when there are neither names nor numbers.
std::optional<TableHeader> findTableHeader(std::string_view head);

/// CSV, or values between tabs, semicolons or blanks, with a header. The frame comes from a column called
/// frame (FrameID, step, ...), the time from one called t or time (in s; `time[ms]`); with neither of them
/// every file is one snapshot. Columns of text are left out.
bool isTable(std::string_view head);
TrackTableFormat tableFormat();

/// What a table without names of columns needs.
extern const char* const tableAdvice;

} // namespace rimflow
