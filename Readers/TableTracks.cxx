#include "TableTracks.h"

#include "TableHead.h"
#include "TecplotHeader.h"
#include "TimeColumn.h"
#include "TrackMessages.h"

#include <algorithm>
#include <stdexcept>

namespace rimflow {

const char* const tableAdvice =
    "Put the names of the columns above the rows, such as trackID,frame,x[mm],y[mm],z[mm].";

namespace {

constexpr std::size_t linesLookedAt = 20;

std::vector<std::string> namesIn(std::string_view line) {
  while (!line.empty() && (line.front() == '#' || line.front() == '%' || line.front() == ' '))
    line.remove_prefix(1);
  char delimiter = 0;
  for (const char c : {'\t', ';', ','})
    if (!delimiter && line.find(c) != line.npos) delimiter = c;
  if (!delimiter) return splitColumnNames(line);
  std::vector<std::string> names(1);
  bool quoted = false;
  for (const char c : line) {
    if (c == '"')
      quoted = !quoted;
    else if (c == delimiter && !quoted)
      names.emplace_back();
    else
      names.back() += c;
  }
  // A delimiter at the end of the line closes the last name.
  if (names.back().find_first_not_of(" \r") == std::string::npos) names.pop_back();
  return names;
}

bool namesPositions(const std::vector<std::string>& names) {
  return !names.empty() && planTrackColumns(names, LengthUnit::Millimetre).error.empty();
}

// The values of a row, of which some may be missing if there is a delimiter; none if it is no whole row.
std::vector<std::string_view> rowValues(std::string_view line, char delimiter, std::size_t columns) {
  std::vector<std::string_view> values = delimiter ? valuesBetween(line, delimiter) : valuesOf(line);
  if (delimiter && values.size() == columns + 1 && values.back().empty()) values.pop_back();
  if (values.size() != columns) values.clear();
  return values;
}

// A comma or semicolon that makes as many values as there are names, as the first rows tell; else 0.
char delimiterOf(const std::vector<HeadLine>& rows, std::size_t columns) {
  for (const char d : {';', ','})
    for (const HeadLine& row : rows)
      if (!rowValues(row.text, d, columns).empty()) return d;
  return 0;
}

// Columns without a known meaning that hold no numbers (labels, file names) in most of the first rows.
std::vector<bool> textColumns(const std::vector<HeadLine>& rows, char delimiter,
                              const std::vector<std::string>& names, int clock) {
  std::vector<int> numbers(names.size(), 0), texts(names.size(), 0);
  for (const HeadLine& row : rows) {
    const auto values = rowValues(row.text, delimiter, names.size());
    for (std::size_t c = 0; c < values.size(); ++c)
      if (!isMissing(values[c])) ++(isNumber(values[c]) ? numbers : texts)[c];
  }
  std::vector<bool> text(names.size(), false);
  const TrackColumnPlan plan = planTrackColumns(names, LengthUnit::Millimetre);
  for (std::size_t c = 0; c < names.size(); ++c)
    text[c] = plan.columns[c].target == TrackColumnPlan::Target::Further && int(c) != clock &&
              texts[c] > numbers[c];
  return text;
}

} // namespace

std::optional<TableHeader> findTableHeader(std::string_view head) {
  TableHeader header;
  for (const HeadLine& line : linesOfHead(head, linesLookedAt)) {
    const std::vector<std::string_view> values = valuesOf(line.text);
    const bool row = values.size() == header.names.size() &&
                     std::count_if(values.begin(), values.end(), isNumber) >= 3; // it may begin with a label
    if (isNumber(values[0]) || (header.line > 0 && (row || looksLikeRow(line.text)))) {
      header.rows = line.begin;
      header.values = values.size();
      return header;
    }
    ++header.linesBefore;
    if (std::vector<std::string> names = namesIn(line.text); namesPositions(names)) {
      header.names = std::move(names);
      header.line = line.number;
    }
  }
  if (header.names.empty() || head.size() >= trackHeadBytes) return {};
  header.rows = head.size(); // a snapshot without particles
  return header;
}

bool isTable(std::string_view head) {
  const auto header = findTableHeader(head);
  return header && !header->names.empty();
}

TrackTableFormat tableFormat() {
  const auto layout = [](std::string_view head) {
    const auto header = findTableHeader(head);
    if (!header) throw std::runtime_error("line 1: there is no row of numbers. Export the tracks again.");
    if (header->names.empty())
      throw std::runtime_error(std::string("line 1: no names of columns, with x, y and z among them. ") +
                               tableAdvice);
    TrackTableLayout l;
    l.columns = header->names;
    const TimeColumn clock = findTimeColumn(l.columns);
    if (clock.unit == TimeColumn::Unit::NotKnown)
      throw std::runtime_error("line 1: the unit of column " +
                               printable(l.columns[std::size_t(clock.index)]) +
                               " is not known; expected [s], [ms], [us], [ns] or [frame]. Correct it in the "
                               "header.");
    l.frame = clock.index;
    l.secondsPerUnit = clock.unit == TimeColumn::Unit::Frames ? 0 : clock.seconds;
    l.rows = header->rows;
    const std::vector<HeadLine> rows = linesOfHead(head.substr(header->rows), linesLookedAt);
    l.delimiter = delimiterOf(rows, l.columns.size());
    l.ignored = textColumns(rows, l.delimiter, l.columns, clock.index);
    l.expected = "as many as there are names in line " + std::to_string(header->line);
    return l;
  };
  return {"table", layout, false};
}

} // namespace rimflow
