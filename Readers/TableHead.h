#pragma once
#include <cstddef>
#include <string_view>
#include <vector>

namespace rimflow {

/// One of the first lines of a file that is not blank.
struct HeadLine {
  std::string_view text; ///< without line end
  std::size_t begin;     ///< byte in the file
  std::size_t number;    ///< from 1
};

/// The first lines in a file's head (of trackHeadBytes, or less when this is the whole file), at most `most`
/// of them, without blank ones. A line that is cut off by the end of the head is left out.
std::vector<HeadLine> linesOfHead(std::string_view head, std::size_t most);

/// The values of a row, separated by blanks, tabs, commas or semicolons.
std::vector<std::string_view> valuesOf(std::string_view line);
/// The values between exactly one delimiter each, without quotes and blanks around them; some may be empty,
/// also the last one, after a delimiter that ends the line.
std::vector<std::string_view> valuesBetween(std::string_view line, char delimiter);
/// Nothing at all, or a word for it: NaN, NA, N/A, None, null, -, ? in any case.
bool isMissing(std::string_view value);
/// A number in any notation that a row may have.
bool isNumber(std::string_view value);
/// Digits only, with a sign or without.
bool isInteger(std::string_view value);

} // namespace rimflow
