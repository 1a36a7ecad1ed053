#include "TableHead.h"

#include "TrackTableLayout.h"

#include <algorithm>
#include <cctype>
#include <fast_float/fast_float.h>
#include <string>

namespace rimflow {

std::vector<HeadLine> linesOfHead(std::string_view head, std::size_t most) {
  std::vector<HeadLine> lines;
  std::size_t number = 1;
  for (std::size_t p = 0; p < head.size() && lines.size() < most; ++number) {
    if (head.substr(p, 3) == "\xEF\xBB\xBF") p += 3; // byte-order mark
    const std::size_t newline = head.find('\n', p);
    if (newline == head.npos && head.size() >= trackHeadBytes) break;
    const std::size_t end = std::min(newline, head.size());
    std::string_view text = head.substr(p, end - p);
    while (!text.empty() && text.back() == '\r') text.remove_suffix(1);
    if (text.find_first_not_of(" \t\r,;") != text.npos) lines.push_back({text, p, number});
    p = end + 1;
  }
  return lines;
}

std::vector<std::string_view> valuesOf(std::string_view line) {
  constexpr std::string_view separators = " \t,;\r\n";
  std::vector<std::string_view> values;
  for (std::size_t p = line.find_first_not_of(separators); p != line.npos;) {
    const std::size_t end = std::min(line.find_first_of(separators, p), line.size());
    values.push_back(line.substr(p, end - p));
    p = line.find_first_not_of(separators, end);
  }
  return values;
}

std::vector<std::string_view> valuesBetween(std::string_view line, char delimiter) {
  std::vector<std::string_view> values;
  bool quoted = false;
  std::size_t begin = 0;
  const auto add = [&](std::size_t end) {
    std::string_view value = line.substr(begin, end - begin);
    const auto padding = [](char c) { return c == ' ' || c == '\t' || c == '\r' || c == '"'; };
    while (!value.empty() && padding(value.front())) value.remove_prefix(1);
    while (!value.empty() && padding(value.back())) value.remove_suffix(1);
    values.push_back(value);
    begin = end + 1;
  };
  for (std::size_t p = 0; p < line.size(); ++p) {
    if (line[p] == '"') quoted = !quoted;
    if (line[p] == delimiter && !quoted) add(p);
  }
  add(line.size());
  return values;
}

bool isMissing(std::string_view value) {
  if (value.size() > 4) return false;
  std::string word(value);
  for (char& c : word) c = char(std::tolower(static_cast<unsigned char>(c)));
  for (const char* w : {"", "nan", "na", "n/a", "none", "null", "-", "?"})
    if (word == w) return true;
  return false;
}

bool isNumber(std::string_view value) {
  if (!value.empty() && value.front() == '+') value.remove_prefix(1);
  double x = 0;
  const auto r = fast_float::from_chars(value.data(), value.data() + value.size(), x);
  return r.ec == std::errc() && r.ptr == value.data() + value.size();
}

bool isInteger(std::string_view value) {
  if (!value.empty() && (value.front() == '-' || value.front() == '+')) value.remove_prefix(1);
  return !value.empty() && value.find_first_not_of("0123456789") == value.npos;
}

} // namespace rimflow
