#include "OpenLPTTracks.h"

#include "TableHead.h"
#include "TrackTimeline.h"

#include <algorithm>
#include <cctype>
#include <stdexcept>

namespace rimflow {
namespace {

const std::vector<std::string> columns = {"trackID", "frame", "x", "y", "z"};

std::vector<std::string> namesOf(std::string_view line) {
  std::vector<std::string> names;
  for (const std::string_view value : valuesOf(line)) {
    names.emplace_back();
    for (const char c : value)
      if (c != '"') names.back() += char(std::tolower(static_cast<unsigned char>(c)));
  }
  return names;
}

bool isHeader(const std::vector<std::string>& names) {
  const std::vector<std::string> expected = {"trackid", "frameid", "worldx", "worldy", "worldz"};
  return names.size() >= 5 && std::equal(expected.begin(), expected.end(), names.begin());
}

} // namespace

bool isOpenLPT(std::string_view head) {
  const auto lines = linesOfHead(head, 1);
  return !lines.empty() && isHeader(namesOf(lines[0].text));
}

TrackTableFormat openLPTFormat() {
  const auto layout = [](std::string_view head) {
    if (!isOpenLPT(head))
      throw std::runtime_error(
          "line 1: expected TrackID,FrameID,WorldX,WorldY,WorldZ, as in the other files. "
          "Open files of one format together.");
    const HeadLine line = linesOfHead(head, 1)[0];
    TrackTableLayout l;
    l.columns = columns;
    l.ignored.resize(columns.size(), false);
    const std::vector<std::string> names = namesOf(line.text);
    for (std::size_t c = columns.size(); c < names.size(); ++c) {
      const bool residual = names[c] == "r3d"; // of the triangulation
      l.columns.push_back(residual ? "R3D" : "column " + std::to_string(c + 1));
      l.ignored.push_back(!residual);
    }
    l.frame = 1;
    l.rows = std::min(head.size(), line.begin + line.text.size());
    l.expected = "as many as there are names in line 1";
    return l;
  };
  return {"OpenLPT", layout, true};
}

bool isOpenLPTLine(std::string_view head) {
  if (head.substr(0, 4096).find(',') == head.npos) return false;
  const bool whole = head.size() < trackHeadBytes;
  std::vector<std::string_view> values = valuesOf(head);
  if (!whole && !values.empty()) values.pop_back(); // it may be cut off
  for (std::size_t v = 0; v + 1 < values.size() || (!whole && v < values.size()); ++v)
    if (v % 5 < 2 ? !isInteger(values[v]) : !isNumber(values[v])) return false;
  const bool decimal =
      std::any_of(values.begin(), values.end(), [](std::string_view v) { return !isInteger(v); });
  return values.size() >= 5 && decimal;
}

TrackTableFormat openLPTLineFormat() {
  const auto layout = [](std::string_view) {
    TrackTableLayout l;
    l.columns = columns;
    l.frame = 1;
    l.oneLine = true;
    l.expected = "the trackID, the frame, x, y and z";
    return l;
  };
  return {"OpenLPT", layout, true};
}

} // namespace rimflow
