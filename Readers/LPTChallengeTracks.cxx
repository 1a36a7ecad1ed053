#include "LPTChallengeTracks.h"

#include "TableHead.h"
#include "TableTracks.h"

#include <algorithm>
#include <stdexcept>

namespace rimflow {
namespace {

constexpr std::size_t headerLines = 3;

// Whether the last column holds whole numbers, as far as the head goes.
bool endsWithIds(std::string_view head, const TableHeader& header) {
  const auto rows = linesOfHead(head.substr(header.rows), 200);
  return header.values > 3 && std::all_of(rows.begin(), rows.end(), [](const HeadLine& row) {
           return isInteger(valuesOf(row.text).back());
         });
}

} // namespace

bool isLPTChallenge(std::string_view head) {
  const auto header = findTableHeader(head);
  if (!header || header->linesBefore != headerLines || (header->names.empty() && header->values < 3))
    return false;
  return header->names.empty() || tableFormat().layout(head).frame < 0;
}

TrackTableFormat lptChallengeFormat() {
  const auto layout = [](std::string_view head) {
    const auto header = findTableHeader(head);
    if (!header || (header->names.empty() && header->values < 3))
      throw std::runtime_error(
          "line 4: expected rows X Y Z ... trackID after three header lines. Export the tracks "
          "again.");
    if (!header->names.empty()) return tableFormat().layout(head);
    TrackTableLayout l;
    l.columns = {"x", "y", "z"};
    while (l.columns.size() < header->values)
      l.columns.push_back("column " + std::to_string(l.columns.size() + 1));
    const bool ids = endsWithIds(head, *header);
    if (ids) l.columns.back() = "trackID";
    l.rows = header->rows;
    l.expected = "as many as in the first row";
    l.warnings.push_back(
        std::string("the header names no columns: the first three are taken for x, y and z") +
        (ids ? ", the last one for the trackID. " : ". ") + tableAdvice);
    return l;
  };
  return {"LPT challenge", layout, false};
}

} // namespace rimflow
