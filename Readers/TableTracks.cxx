#include "TableTracks.h"

#include "TableHead.h"
#include "TecplotHeader.h"
#include "TrackMessages.h"

#include <algorithm>
#include <cctype>
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

struct Clock {
  int column = -1;
  double secondsPerUnit = 0;
  std::string problem; // the unit is not known
};

// The column of times, else that of frame numbers.
Clock findClock(const std::vector<std::string>& names) {
  Clock clock;
  for (std::size_t c = 0; c < names.size(); ++c) {
    const std::size_t bracket = std::min(names[c].find_first_of("[("), names[c].size());
    std::string name, unit;
    for (const char k : names[c].substr(0, bracket))
      if (std::isalnum(static_cast<unsigned char>(k)))
        name += char(std::tolower(static_cast<unsigned char>(k)));
    for (const char k : names[c].substr(bracket))
      if (std::isalpha(static_cast<unsigned char>(k)))
        unit += char(std::tolower(static_cast<unsigned char>(k)));
    const auto is = [&](std::initializer_list<const char*> any) {
      return std::any_of(any.begin(), any.end(), [&](const char* n) { return name == n; });
    };
    const bool time = is({"t", "time", "times", "solutiontime"});
    const bool frames = unit == "frame" || unit == "frames" || unit == "step" || unit == "steps";
    const double seconds = unit.empty() || unit == "s" || unit == "sec" || unit == "seconds" ? 1
                           : unit == "ms"                                                    ? 1e-3
                           : unit == "us"                                                    ? 1e-6
                           : unit == "ns"                                                    ? 1e-9
                                                                                             : 0;
    if (time && seconds > 0 && clock.secondsPerUnit == 0)
      clock = {int(c), seconds, {}};
    else if (((time && frames) || is({"frame", "frameid", "frameno", "framenumber", "frameindex", "step",
                                      "timestep", "snapshot"})) &&
             clock.column < 0)
      clock = {int(c), 0, {}};
    else if (time && !frames && seconds == 0 && clock.column < 0)
      clock.problem = "line 1: the unit of column " + printable(names[c]) +
                      " is not known; expected [s], [ms], [us], [ns] or [frame]. Correct it in the header.";
  }
  return clock;
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
    const Clock clock = findClock(l.columns);
    if (clock.column < 0 && !clock.problem.empty()) throw std::runtime_error(clock.problem);
    l.frame = clock.column;
    l.secondsPerUnit = clock.secondsPerUnit;
    l.rows = header->rows;
    const std::vector<HeadLine> rows = linesOfHead(head.substr(header->rows), linesLookedAt);
    l.delimiter = delimiterOf(rows, l.columns.size());
    l.ignored = textColumns(rows, l.delimiter, l.columns, clock.column);
    l.expected = "as many as there are names in line " + std::to_string(header->line);
    return l;
  };
  return {"table", layout, false};
}

} // namespace rimflow
