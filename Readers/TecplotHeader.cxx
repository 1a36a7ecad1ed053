#include "TecplotHeader.h"

#include "TrackMessages.h"
#include "TrackTimeline.h"

#include <algorithm>
#include <cctype>
#include <charconv>
#include <cmath>
#include <cstring>
#include <fast_float/fast_float.h>

namespace rimflow {
namespace {

bool isSpace(char c) { return c == ' ' || c == '\t' || c == '\r' || c == '\n' || c == '\f' || c == '\v'; }
bool isWordEnd(char c) { return isSpace(c) || c == ',' || c == '=' || c == '(' || c == '"'; }

std::string upper(std::string_view s) {
  std::string result(s);
  for (char& c : result) c = char(std::toupper(static_cast<unsigned char>(c)));
  return result;
}

std::string_view trimmed(std::string_view s) {
  while (!s.empty() && isSpace(s.front())) s.remove_prefix(1);
  while (!s.empty() && isSpace(s.back())) s.remove_suffix(1);
  return s;
}

std::string_view firstWord(std::string_view line) {
  std::size_t begin = 0;
  if (line.substr(0, 3) == "\xEF\xBB\xBF") begin = 3; // byte-order mark, also inside joined files
  while (begin < line.size() && (line[begin] == ' ' || line[begin] == '\t')) ++begin;
  std::size_t end = begin;
  while (end < line.size() && end < begin + 24 && std::isalpha(static_cast<unsigned char>(line[end]))) ++end;
  if (end < line.size() && !isWordEnd(line[end])) return {};
  return line.substr(begin, end - begin);
}

bool isRecord(std::string_view word) {
  static const char* const records[] = {"TITLE",    "VARIABLES",      "ZONE",       "FILETYPE",    "TEXT",
                                        "GEOMETRY", "DATASETAUXDATA", "VARAUXDATA", "CUSTOMLABELS"};
  if (word.size() < 4) return false;
  const std::string w = upper(word);
  return std::any_of(std::begin(records), std::end(records), [&](const char* r) { return w == r; });
}

// Walks over a header block, token by token.
class Scanner {
public:
  explicit Scanner(std::string_view text) : text(text) {}

  bool atEnd() const { return pos >= text.size(); }
  std::size_t position() const { return pos; }
  char peek() const { return text[pos]; }
  void skip(std::size_t n) { pos = std::min(text.size(), pos + n); }

  void skipBlank(bool commas) {
    while (!atEnd()) {
      const bool lineBegins = pos == 0 || text[pos - 1] == '\n';
      if (lineBegins && text.substr(pos, 3) == "\xEF\xBB\xBF")
        pos += 3;
      else if (isSpace(peek()) || (commas && peek() == ','))
        ++pos;
      else
        break;
    }
  }
  void skipLine() {
    const std::size_t end = text.find('\n', pos);
    pos = end == text.npos ? text.size() : end + 1;
  }
  std::string_view word() {
    const std::size_t begin = pos;
    while (!atEnd() && !isWordEnd(peek())) ++pos;
    if (pos == begin && !atEnd()) ++pos; // a lone sign such as '('
    return text.substr(begin, pos - begin);
  }
  /// After '=': a quoted string (a missing closing quote ends with the line), a list in brackets, or a word.
  std::string_view value() {
    skipBlank(false);
    if (atEnd()) return {};
    if (peek() == '"') return quoted();
    if (peek() == '(') {
      const std::size_t begin = pos, end = text.find(')', pos);
      pos = end == text.npos ? text.size() : end + 1;
      return text.substr(begin, pos - begin);
    }
    return word();
  }
  std::string_view quoted() {
    const std::size_t begin = ++pos;
    const std::size_t end = text.find_first_of("\"\n", begin);
    pos = end == text.npos ? text.size() : end + (text[end] == '"');
    return text.substr(begin, (end == text.npos ? text.size() : end) - begin);
  }
  bool takeEquals() {
    const std::size_t back = pos;
    skipBlank(false);
    if (!atEnd() && peek() == '=') {
      ++pos;
      return true;
    }
    pos = back;
    return false;
  }
  std::size_t lineBegin() const {
    const std::size_t n = pos == 0 ? text.npos : text.rfind('\n', pos - 1);
    return n == text.npos ? 0 : n + 1;
  }

  std::string_view text;

private:
  std::size_t pos = 0;
};

// Where the list of names ends: at a line that opens another record, or at the word ZONE.
std::size_t endOfVariables(std::string_view text, std::size_t begin) {
  bool inQuotes = false;
  for (std::size_t p = begin; p < text.size(); ++p) {
    if (text[p] == '"') inQuotes = !inQuotes;
    if (text[p] == '\n') {
      inQuotes = false;
      if (isRecord(firstWord(text.substr(p + 1, 64)))) return p + 1;
    }
    if (!inQuotes && (isSpace(text[p]) || text[p] == ',') && upper(text.substr(p + 1, 4)) == "ZONE" &&
        (p + 5 >= text.size() || isWordEnd(text[p + 5])))
      return p + 1;
  }
  return text.size();
}

std::int64_t integerOr(std::string_view s, std::int64_t fallback) {
  std::int64_t n = 0;
  const auto r = std::from_chars(s.data(), s.data() + s.size(), n);
  return r.ec == std::errc() && r.ptr == s.data() + s.size() && n >= 0 ? n : fallback;
}

double timeOrNaN(std::string_view s) {
  s = trimmed(s);
  if (!s.empty() && s.front() == '+') s.remove_prefix(1);
  double x = 0;
  const auto r = fast_float::from_chars(s.data(), s.data() + s.size(), x);
  const bool whole = r.ec == std::errc() && r.ptr == s.data() + s.size();
  return whole && std::abs(x) <= largestTime ? x : std::numeric_limits<double>::quiet_NaN();
}

void setKey(TecplotZoneHeader& zone, const std::string& key, std::string_view value) {
  if (key == "T") zone.title = trimmed(value);
  if (key == "I") zone.rows = integerOr(value, -1);
  if (key == "J") zone.j = integerOr(value, 1);
  if (key == "K") zone.k = integerOr(value, 1);
  if (key == "SOLUTIONTIME") zone.time = timeOrNaN(value);
  if (key == "F" || key == "DATAPACKING") zone.packing = upper(value);
  if (key == "ZONETYPE") zone.zoneType = upper(value);
}

// Comment lines turned into blanks, so that offsets stay.
std::string withoutComments(std::string_view block) {
  std::string text(block);
  for (std::size_t line = 0; line < text.size();) {
    const std::size_t end = std::min(text.find('\n', line), text.size());
    if (const std::size_t first = text.find_first_not_of(" \t", line); first < end && text[first] == '#')
      std::fill(text.begin() + std::ptrdiff_t(first), text.begin() + std::ptrdiff_t(end), ' ');
    line = end + 1;
  }
  return text;
}

} // namespace

bool beginsTecplotRecord(std::string_view line) { return isRecord(firstWord(line.substr(0, 64))); }

bool looksLikeRow(std::string_view line) {
  std::size_t p = 0;
  while (p < line.size() && (line[p] == ' ' || line[p] == '\t' || line[p] == ',' || line[p] == ';')) ++p;
  if (p == line.size()) return false;
  const char c = line[p];
  if ((c >= '0' && c <= '9') || c == '-' || c == '+' || c == '.') return true;
  const std::string word = upper(firstWord(line.substr(p, 64)));
  if (word != "NAN" && word != "INF" && word != "INFINITY") return false;
  while (p < line.size() && line[p] != '=' && line[p] != '\n') ++p;
  return p == line.size() || line[p] != '=';
}

std::vector<std::string> splitColumnNames(std::string_view list) {
  std::vector<std::string> names;
  bool commas = false, inQuotes = false;
  for (char c : list) {
    if (c == '"' || c == '\n') inQuotes = c == '"' && !inQuotes;
    commas = commas || (c == ',' && !inQuotes);
  }
  for (std::size_t p = 0; p < list.size();) {
    if (isSpace(list[p]) || list[p] == ',') {
      ++p;
    } else if (list[p] == '"') {
      const std::size_t end = std::min(list.find_first_of("\"\n", p + 1), list.size());
      names.emplace_back(trimmed(list.substr(p + 1, end - p - 1)));
      p = end + 1;
    } else {
      std::size_t end = p;
      while (end < list.size() && list[end] != '\n' && list[end] != '"' &&
             (commas ? list[end] != ',' : !isSpace(list[end])))
        ++end;
      const std::string_view name = trimmed(list.substr(p, end - p));
      if (!names.empty() && name.size() > 1 && name.front() == '[' && !commas)
        names.back() += " " + std::string(name);
      else if (!name.empty())
        names.emplace_back(name);
      p = end;
    }
  }
  return names;
}

TecplotHeader parseTecplotHeader(std::string_view original) {
  const std::string cleaned = withoutComments(original);
  const std::string_view block = cleaned;
  TecplotHeader header;
  Scanner scan(block);
  bool titleGoesOn = false; // T=Snapshot 0001, without quotes: the title goes on to the line's end
  std::size_t titleLine = 0;
  for (;;) {
    scan.skipBlank(true);
    if (scan.atEnd()) break;
    const std::size_t begin = scan.position();
    const bool quote = scan.peek() == '"';
    const std::string_view word = quote ? scan.quoted() : scan.word();
    const std::string key = upper(word);
    TecplotZoneHeader* zone = header.zones.empty() ? nullptr : &header.zones.back();
    if (!quote && key == "ZONE") {
      if (zone) zone->end = begin;
      header.zones.emplace_back();
      header.zones.back().offset = begin;
      titleGoesOn = false;
    } else if (!quote && key == "VARIABLES" && scan.takeEquals()) {
      const std::size_t from = scan.position(), to = endOfVariables(block, from);
      header.hasVariables = true;
      header.variables = splitColumnNames(block.substr(from, to - from));
      scan.skip(to - from);
      titleGoesOn = false;
    } else if (!quote && (key == "AUXDATA" || key == "DATASETAUXDATA" || key == "VARAUXDATA")) {
      scan.skipLine();
      titleGoesOn = false;
    } else if (!quote && scan.takeEquals()) {
      const std::size_t valueBegin = scan.position();
      const std::string_view value = scan.value();
      if (zone) setKey(*zone, key, value);
      titleGoesOn = zone && key == "T" &&
                    block.substr(valueBegin, value.data() - block.data() - valueBegin).find('"') ==
                        std::string_view::npos;
      titleLine = scan.lineBegin();
    } else if (titleGoesOn && scan.lineBegin() == titleLine) {
      zone->title += " " + std::string(word);
    } else {
      std::string& problem = zone ? zone->problem : header.problem;
      if (problem.empty()) {
        (zone ? zone->problemOffset : header.problemOffset) = begin;
        problem = "found " + printable(word) +
                  " where a header entry (NAME=value) or a row of numbers was expected";
      }
      scan.skipLine();
    }
  }
  if (!header.zones.empty()) header.zones.back().end = block.size();
  return header;
}

} // namespace rimflow
