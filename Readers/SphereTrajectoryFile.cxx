#include "SphereTrajectoryFile.h"

#include "TableHead.h"
#include "TecplotHeader.h"
#include "TimeColumn.h"
#include "TrackMessages.h"
#include "TrackTableLayout.h"
#include "TrackTexts.h"

#include <algorithm>
#include <cctype>
#include <cerrno>
#include <charconv>
#include <cmath>
#include <cstring>
#include <fast_float/fast_float.h>
#include <fcntl.h>
#include <limits>
#include <optional>
#include <stdexcept>
#include <unistd.h>

namespace rimflow {
namespace {

constexpr double none = std::numeric_limits<double>::quiet_NaN();
const char* const headerExample = "VARIABLES = \"Time\" \"x\" \"y\" \"z\"";
const char* const diameterExample = "DIAMETER=11.11[mm]";

/// What is wrong, and at which byte.
struct Problem {
  std::size_t offset;
  std::string text;
};

std::string upper(std::string_view text) {
  std::string result(text);
  for (char& c : result) c = char(std::toupper(static_cast<unsigned char>(c)));
  return result;
}

std::string_view trimmed(std::string_view s, std::string_view what = " \t\r\n,;") {
  const std::size_t begin = s.find_first_not_of(what), end = s.find_last_not_of(what);
  return begin == s.npos ? std::string_view() : s.substr(begin, end - begin + 1);
}

bool endsWith(std::string_view s, std::string_view tail) {
  return s.size() >= tail.size() && s.substr(s.size() - tail.size()) == tail;
}

/// The text before the first row, with comments turned into blanks, so that bytes stay where they are.
struct Header {
  std::string text;
  std::size_t firstLine = 0; ///< byte of the first line that says something
};

Header headerOf(std::string_view text) {
  Header header;
  bool begun = false;
  for (std::size_t p = 0; p < text.size();) {
    const std::size_t newline = text.substr(p, longestTrackLine + 1).find('\n');
    if (newline == text.npos && text.size() - p > longestTrackLine) throw Problem{p, trackLineTooLong};
    const std::size_t end = newline == text.npos ? text.size() : p + newline + 1;
    std::string line(text.substr(p, end - p));
    if (line.compare(0, 3, "\xEF\xBB\xBF") == 0) std::fill_n(line.begin(), 3, ' '); // byte-order mark
    if (looksLikeRow(line)) break;
    const std::size_t first = line.find_first_not_of(" \t\r\n");
    if (first != line.npos && line[first] == '#')
      std::fill(line.begin(), line.end() - (newline != text.npos), ' ');
    else if (first != line.npos && !begun)
      header.firstLine = p, begun = true;
    header.text += line;
    p = end;
  }
  return header;
}

/// NAME=value; the value goes on to the next entry.
struct Entry {
  enum class Name { Title, Variables, Diameter, DensityRatio, Zone, Other } name;
  std::size_t begin, value, end; // bytes
};

/// The known name that a text before a '=' ends with; where it begins in that text.
std::optional<std::pair<Entry::Name, std::size_t>> nameAtEnd(std::string_view before) {
  using Name = Entry::Name;
  std::string plain; // upper case, without blanks
  std::vector<std::size_t> at;
  for (std::size_t p = 0; p < before.size(); ++p)
    if (before[p] != ' ' && before[p] != '\t' && before[p] != '_') {
      plain += char(std::toupper(static_cast<unsigned char>(before[p])));
      at.push_back(p);
    }
  const std::pair<const char*, Name> names[] = {{"SOLID/FLUIDDENSITYRATIO", Name::DensityRatio},
                                                {"DIAMETER", Name::Diameter},
                                                {"VARIABLES", Name::Variables},
                                                {"TITLE", Name::Title}};
  for (const auto& [word, name] : names) {
    if (!endsWith(plain, word)) continue;
    const std::size_t begin = at[plain.size() - std::strlen(word)];
    const std::string_view ahead = trimmed(before.substr(0, begin), " \t");
    const bool wholeWord = begin == 0 || std::strchr(" \t,;\"]", before[begin - 1]);
    const bool ofSphere = endsWith(upper(ahead), "SPHERE");
    const bool ofAnother =
        !ofSphere && !ahead.empty() && std::isalpha(static_cast<unsigned char>(ahead.back()));
    if (wholeWord && !ofAnother) // not the diameter of the tracers
      return std::pair(name, ofSphere ? ahead.size() - 6 + std::size_t(ahead.data() - before.data()) : begin);
  }
  if (plain == "DENSITYRATIO") return std::pair(Name::DensityRatio, at[0]);
  return {};
}

std::vector<Entry> entriesOf(const std::string& header) {
  std::vector<Entry> entries;
  const auto begin = [&](Entry::Name name, std::size_t at, std::size_t value) {
    if (!entries.empty()) entries.back().end = at;
    entries.push_back({name, at, value, header.size()});
  };
  for (std::size_t line = 0; line < header.size();) {
    const std::size_t end = std::min(header.find('\n', line), header.size());
    const std::string_view text = std::string_view(header).substr(line, end - line);
    const std::size_t word = std::min(text.find_first_not_of(" \t"), text.size());
    const bool zone = upper(text.substr(word, 4)) == "ZONE" &&
                      (text.size() == word + 4 || !std::isalpha(static_cast<unsigned char>(text[word + 4])));
    if (zone) begin(Entry::Name::Zone, line + word, line + word + 4);
    const std::string first = upper(text.substr(word, text.substr(word).find_first_of(" \t=")));
    const bool auxiliary = endsWith(first, "AUXDATA"); // Tecplot's notes, of any name
    if (auxiliary) begin(Entry::Name::Other, line + word, line + word);
    bool quoted = false;
    std::size_t from = 0; // what stands between here and a '=' may be a name
    for (std::size_t p = 0; p < text.size(); ++p) {
      if (text[p] == '"') quoted = !quoted;
      if (text[p] != '=' || quoted || auxiliary) continue;
      if (const auto known = nameAtEnd(text.substr(from, p - from)))
        begin(known->first, line + from + known->second, line + p + 1);
      else if (from == 0 && !zone)
        begin(Entry::Name::Other, line + word, line + p + 1);
      from = p + 1;
    }
    line = end + 1;
  }
  return entries;
}

/// A number greater than 0 with a unit behind it in brackets or without; the unit is empty where there is
/// none.
struct Quantity {
  double value;
  std::string unit;
};
std::optional<Quantity> quantityOf(std::string_view text) {
  text = trimmed(text, " \t\r\n,;\"");
  if (!text.empty() && text.front() == '+') text.remove_prefix(1);
  Quantity q{0, ""};
  const auto r = fast_float::from_chars(text.data(), text.data() + text.size(), q.value);
  if (r.ec != std::errc() || !std::isfinite(q.value) || !(q.value > 0)) return {};
  q.unit = trimmed(text.substr(std::size_t(r.ptr - text.data())), " \t[]()");
  return q;
}

double diameterOf(std::string_view value, std::size_t offset) {
  const auto q = quantityOf(value);
  const auto unit = q ? unitInSI(q->unit.empty() ? "mm" : q->unit, 0) : std::nullopt;
  if (!unit)
    throw Problem{offset, "found " + printable(trimmed(value)) +
                              " as DIAMETER; expected a number greater than 0 with its unit m, cm, mm or um, "
                              "such as " +
                              diameterExample + ". Correct this line."};
  return q->value / (1 / *unit); // 11.11 / 1000 is nearer to 11.11 mm than 11.11 * 0.001
}

double densityRatioOf(std::string_view value, std::size_t offset) {
  const auto q = quantityOf(value);
  if (!q || !q->unit.empty())
    throw Problem{offset,
                  "found " + printable(trimmed(value)) +
                      " as DENSITY RATIO; expected a number greater than 0, the density of the sphere "
                      "over that of the fluid. Correct this line, or remove it."};
  return q->value;
}

/// What the header says of the columns.
struct Columns {
  TrackColumnPlan rows; // for readTrackRows: time, x, y, z as further columns 0 to 3, in the file's units
  double perMetre[3] = {1, 1, 1};
  TimeColumn time;
  bool ofParticles = false; // there are track ids or velocities
  std::string names;
};

Columns columnsOf(std::string_view variables, std::size_t offset, LengthUnit unit) {
  const std::vector<std::string> names = splitColumnNames(variables);
  const TrackColumnPlan plan = planTrackColumns(names, unit);
  if (!plan.error.empty())
    throw Problem{offset, plan.error + ". A sphere's trajectory has " + headerExample + "."};
  Columns columns;
  columns.ofParticles = plan.hasTrackId || plan.hasVelocity;
  columns.time = findTimeColumn(names);
  if (columns.time.index < 0 || columns.time.unit == TimeColumn::Unit::NotKnown)
    throw Problem{offset, (columns.time.index < 0 ? "no column Time or Frame among the VARIABLES "
                                                  : "the unit of the time is not known in the VARIABLES ") +
                              printable(trimmed(variables), 200) + "; expected " + headerExample +
                              ", with the time in [s], [ms], [us] or [frame]. Correct this line."};
  columns.rows.furtherNames = {"time", "x", "y", "z"};
  for (std::size_t c = 0; c < names.size(); ++c) {
    TrackColumnPlan::Column column = plan.columns[c];
    const bool position = column.target == TrackColumnPlan::Target::Position;
    if (position) columns.perMetre[column.index] = 1 / column.scale;
    column.index = position ? column.index + 1 : 0;
    column.target = position || int(c) == columns.time.index ? TrackColumnPlan::Target::Further
                                                             : TrackColumnPlan::Target::Skip;
    column.scale = 1;
    columns.rows.columns.push_back(column);
    columns.names += (c ? " " : "") + column.label;
  }
  return columns;
}

struct Parsed {
  std::string title;
  double diameter = 0, densityRatio = 0;
  std::optional<Columns> columns;
  std::vector<std::size_t> unknown; // bytes of entries that are not used
};

Parsed parseHeader(const Header& header, LengthUnit unit) {
  using Name = Entry::Name;
  Parsed parsed;
  const std::vector<Entry> entries = entriesOf(header.text);
  const std::size_t first = entries.empty() ? header.text.size() : entries.front().begin;
  if (!trimmed(std::string_view(header.text).substr(0, first)).empty())
    throw Problem{header.firstLine, "found " + printable(lineAt(header.text, header.firstLine)) +
                                        "; expected a header entry such as " + headerExample +
                                        ". Remove this line, or begin it with #."};
  bool zone = false;
  for (const Entry& e : entries) {
    const std::string_view value = std::string_view(header.text).substr(e.value, e.end - e.value);
    if (e.name == Name::Title) parsed.title = toUtf8(trimmed(value, " \t\r\n,\""));
    if (e.name == Name::Diameter) parsed.diameter = diameterOf(value, e.begin);
    if (e.name == Name::DensityRatio) parsed.densityRatio = densityRatioOf(value, e.begin);
    if (e.name == Name::Variables) parsed.columns = columnsOf(value, e.begin, unit);
    if (e.name == Name::Other && !zone) parsed.unknown.push_back(e.begin); // a zone has many keys
    zone = zone || e.name == Name::Zone;
  }
  return parsed;
}

/// The file's times in s.
std::vector<double> timesOf(const Columns& columns, const std::vector<double>& raw,
                            const SphereTrajectoryOptions& options, const std::string& path,
                            std::vector<std::string>& warnings) {
  using Unit = TimeColumn::Unit;
  const bool frames =
      columns.time.unit == Unit::Frames || (columns.time.unit == Unit::NotStated && options.framePeriod > 0);
  if (frames && !(options.framePeriod > 0))
    warnings.push_back(path + ": the times are frame numbers, times " +
                       framePeriodWords(options.framePeriod) +
                       "; velocities and accelerations are wrong until then.");
  const auto whole = [](double t) { return t == std::floor(t); };
  if (columns.time.unit == Unit::NotStated && !frames && raw.size() > 2 &&
      std::all_of(raw.begin(), raw.end(), whole))
    warnings.push_back(path + ": all times are whole numbers and have no unit; they are taken for seconds. "
                              "If they count frames, set FramePeriod.");
  std::vector<double> times(raw);
  for (double& t : times)
    t = (frames ? t * (options.framePeriod > 0 ? options.framePeriod : 1) : t / (1 / columns.time.seconds)) +
        options.timeShift;
  return times;
}

/// Byte of the row at this index: rows are lines that are neither blank nor comments.
std::size_t offsetOfRow(std::string_view text, std::size_t p, std::size_t row) {
  for (;; ++p) {
    const std::size_t first = std::min(text.find_first_not_of(" \t\r,;", p), text.size());
    if (first == text.size()) return first;
    if (text[first] != '\n' && text[first] != '#' && row-- == 0) return first;
    p = std::min(text.find('\n', first), text.size() - 1);
  }
}

void checkTimes(const std::vector<double>& times, const std::vector<double>& raw, std::string_view text,
                std::size_t rows) {
  for (std::size_t i = 0; i < times.size(); ++i) {
    if (std::isfinite(times[i]) && (i == 0 || times[i] > times[i - 1])) continue;
    std::string found = "found the time " + shortNumber(raw[i]);
    if (i > 0 && std::isfinite(raw[i])) found += " after " + shortNumber(raw[i - 1]);
    throw Problem{offsetOfRow(text, rows, i),
                  found + "; expected times that increase from row to row" +
                      (i > 0 && raw[i] == raw[i - 1] ? ", each only once" : "") +
                      ", for one sphere. Sort the rows by time, remove doubled ones, or write one file per "
                      "sphere."};
  }
}

SphereTrajectory parse(std::string_view text, const std::string& path, const SphereTrajectoryOptions& options,
                       std::vector<std::string>& warnings, std::vector<Problem>& notes) {
  const std::string advice = " Save the trajectory as text with " + std::string(headerExample) + ".";
  if (text.empty()) throw Problem{text.npos, "the file is empty." + advice};
  if (text.substr(0, 4096).find('\0') != text.npos && text.substr(0, 2) != "\xFF\xFE" &&
      text.substr(0, 2) != "\xFE\xFF")
    throw Problem{text.npos, "this is a binary file; expected a sphere's trajectory as text." + advice};
  if (const std::string problem = foreignFormat(text.substr(0, trackHeadBytes)); !problem.empty())
    throw Problem{text.npos, problem};

  const Header header = headerOf(text);
  const std::size_t rows = header.text.size();
  Parsed parsed = parseHeader(header, options.lengthUnit);
  if (!parsed.columns)
    throw Problem{header.firstLine, "there is no list of VARIABLES above the rows; expected " +
                                        std::string(headerExample) +
                                        ". Add this line for the file's columns."};
  for (const std::size_t at : parsed.unknown)
    notes.push_back(
        {at, "the header entry " + printable(trimmed(lineAt(header.text, at))) + " is not used."});
  SphereTrajectory trajectory;
  trajectory.title = parsed.title;
  trajectory.densityRatio = parsed.densityRatio;
  trajectory.diameter = options.diameter > 0 ? options.diameter : parsed.diameter;
  if (!(trajectory.diameter > 0))
    throw Problem{header.firstLine, "the header has no DIAMETER; expected " + std::string(diameterExample) +
                                        ". Add this line, or set the reader's Diameter."};

  TrackSnapshot values;
  const TrackRowsResult result = readTrackRows(text.substr(rows), parsed.columns->rows, false, values);
  if (result.fault != TrackRowsResult::Fault::None)
    throw Problem{rows + result.offset,
                  rowFault(result, text, rows + result.offset, parsed.columns->rows,
                           "as many as there are VARIABLES (" + printable(parsed.columns->names, 200) + ")")};
  if (result.rows == 0)
    throw Problem{text.size() - 1, "there are no rows of numbers below the header; expected " +
                                       printable(parsed.columns->names, 200) + " in each. Export again."};
  const std::vector<double>& raw = values.further[0].values;
  trajectory.time = timesOf(*parsed.columns, raw, options, path, warnings);
  checkTimes(trajectory.time, raw, text, rows);
  for (std::size_t i = 0; i < raw.size(); ++i) {
    Eigen::Vector3d x;
    for (int a = 0; a < 3; ++a)
      x[a] = values.further[std::size_t(a) + 1].values[i] / parsed.columns->perMetre[a];
    trajectory.centre.push_back(x.allFinite() ? x : Eigen::Vector3d::Constant(none));
  }
  return trajectory;
}

std::string fixed(double x, int decimals) {
  char text[400];
  return {text, std::to_chars(text, text + sizeof text, x, std::chars_format::fixed, decimals).ptr};
}
/// As few digits as read back to the same number.
std::string shortest(double x) {
  char text[64];
  return {text, std::to_chars(text, text + sizeof text, x).ptr};
}

std::string textOf(const SphereTrajectory& t) {
  std::string title = t.title.empty() ? "Sphere trajectory: time in s, positions in mm" : t.title;
  for (char& c : title)
    if (c == '"' || c == '\n' || c == '\r') c = '\'';
  char diameter[64]; // 15 digits: 9.53, although 9.53 mm are 0.009530000000000001 m
  char* const end =
      std::to_chars(diameter, diameter + sizeof diameter, 1e3 * t.diameter, std::chars_format::general, 15)
          .ptr;
  std::string text = "TITLE = \"" + title + "\"\n" + headerExample +
                     "\nDIAMETER=" + std::string(diameter, std::size_t(end - diameter)) + "[mm]\n";
  if (t.densityRatio > 0) text += "SOLID/FLUID DENSITY RATIO=" + shortest(t.densityRatio) + "\n";
  for (std::size_t i = 0; i < t.time.size(); ++i) {
    text += shortest(t.time[i]);
    for (int a = 0; a < 3; ++a)
      text += " " + (t.centre[i].allFinite() ? fixed(1e3 * t.centre[i][a], 9) : std::string("NaN"));
    text += "\n";
  }
  return text;
}

void check(const SphereTrajectory& t) {
  if (!(t.diameter > 0) || !std::isfinite(t.diameter))
    throw std::invalid_argument("the diameter is " + shortNumber(t.diameter) +
                                " m; a sphere trajectory file needs one greater than 0");
  if (t.time.empty() || t.time.size() != t.centre.size())
    throw std::invalid_argument(std::to_string(t.time.size()) + " times and " +
                                std::to_string(t.centre.size()) +
                                " positions; a sphere trajectory file needs at least one of each");
  for (std::size_t i = 0; i < t.time.size(); ++i)
    if (!std::isfinite(t.time[i]) || (i > 0 && !(t.time[i] > t.time[i - 1])))
      throw std::invalid_argument("the time " + shortNumber(t.time[i]) + " s of row " + std::to_string(i) +
                                  " is not after the one before; a sphere trajectory file has increasing "
                                  "times, each once");
}

[[noreturn]] void writingFailed(const std::string& path) {
  throw std::runtime_error(path + ": cannot be written: " + std::strerror(errno) +
                           ". Choose a folder that can be written to and has room.");
}

/// Beside its place, flushed to the disk, then moved into its place.
void writeAtOnce(const std::string& path, const std::string& text) {
  const std::string temporary = path + "." + std::to_string(::getpid()) + ".part";
  const int file = ::open(temporary.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0666);
  if (file < 0) writingFailed(path);
  bool good = true;
  for (std::size_t done = 0; good && done < text.size();) {
    const ssize_t n = ::write(file, text.data() + done, text.size() - done);
    good = n > 0 || (n < 0 && errno == EINTR);
    done += std::size_t(std::max<ssize_t>(n, 0));
  }
  good = good && ::fsync(file) == 0;
  good = ::close(file) == 0 && good;
  if (good && ::rename(temporary.c_str(), path.c_str()) == 0) return;
  const int why = errno;
  ::unlink(temporary.c_str());
  errno = why;
  writingFailed(path);
}

} // namespace

SphereTrajectory readSphereTrajectory(const std::string& path, const SphereTrajectoryOptions& options,
                                      std::vector<std::string>& warnings) {
  TrackTexts texts({path});
  const auto source = texts.first(0);
  try {
    std::vector<Problem> notes;
    SphereTrajectory trajectory = parse(source->text(), path, options, warnings, notes);
    for (const Problem& n : notes) warnings.push_back(texts.at(0, n.offset) + n.text);
    return trajectory;
  } catch (const Problem& p) {
    throw std::runtime_error((p.offset == std::string::npos ? path + ": " : texts.at(0, p.offset)) + p.text);
  }
}

void writeSphereTrajectory(const std::string& path, const SphereTrajectory& trajectory) {
  check(trajectory);
  writeAtOnce(path, textOf(trajectory));
}

bool namesSphereDiameter(std::string_view head) {
  bool diameter = false, tracks = false;
  try {
    const std::string header = headerOf(head).text;
    for (const Entry& e : entriesOf(header)) {
      diameter = diameter || e.name == Entry::Name::Diameter;
      if (e.name != Entry::Name::Variables) continue;
      const std::string_view names = std::string_view(header).substr(e.value, e.end - e.value);
      tracks = planTrackColumns(splitColumnNames(names), LengthUnit::Auto).hasTrackId;
    }
  } catch (const Problem&) {
  }
  return diameter && !tracks;
}

bool looksLikeSphereTrajectory(const std::string& path) {
  try {
    const std::string head = headOfFile(path, trackHeadBytes);
    if (!foreignFormat(head).empty()) return false;
    if (namesSphereDiameter(head)) return true;
    const Header header = headerOf(head);
    const auto columns = parseHeader(header, LengthUnit::Auto).columns;
    if (!columns || columns->ofParticles) return false;
    double before = -std::numeric_limits<double>::infinity();
    const auto lines = linesOfHead(std::string_view(head).substr(header.text.size()), 3);
    for (const HeadLine& line : lines) {
      const auto values = valuesOf(line.text);
      const std::size_t c = std::size_t(columns->time.index);
      double time = none;
      if (c < values.size())
        fast_float::from_chars(values[c].data(), values[c].data() + values[c].size(), time);
      if (!(time > before)) return false;
      before = time;
    }
    return lines.size() > 1;
  } catch (const Problem&) {
    return false;
  } catch (const std::exception&) {
    return false;
  }
}

} // namespace rimflow
