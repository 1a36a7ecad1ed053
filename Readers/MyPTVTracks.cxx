#include "MyPTVTracks.h"

#include "TableHead.h"

#include <algorithm>
#include <stdexcept>

namespace rimflow {
namespace {

constexpr std::size_t linesLookedAt = 200;
using Values = std::vector<std::string_view>;

// x.000 or x
bool isWhole(std::string_view value) {
  const std::size_t point = std::min(value.find('.'), value.size());
  return isInteger(value.substr(0, point)) && value.substr(point).find_first_not_of(".0") == value.npos;
}

std::vector<Values> rowsOf(std::string_view head) {
  std::vector<Values> rows;
  for (const HeadLine& line : linesOfHead(head, linesLookedAt))
    if (line.text.front() != '#') rows.push_back(valuesOf(line.text));
  return rows;
}

} // namespace

bool isMyPTV(std::string_view head) {
  const auto lines = linesOfHead(head, 1);
  if (lines.empty() || lines[0].text.find('\t') == std::string_view::npos) return false;
  const Values first = valuesOf(lines[0].text);
  return first.size() >= 5 && std::all_of(first.begin(), first.end(), isNumber) && isWhole(first.back());
}

TrackTableFormat myPTVFormat() {
  const auto layout = [](std::string_view head) {
    if (!isMyPTV(head))
      throw std::runtime_error(
          "line 1: expected at least five numbers between tabs, of which the last one is the "
          "frame, as in the other files. Open files of one format together.");
    const std::vector<Values> rows = rowsOf(head);
    const std::size_t n = rows[0].size();
    const auto whole = [&](std::size_t column) {
      return std::all_of(rows.begin(), rows.end(),
                         [&](const Values& row) { return column >= row.size() || isInteger(row[column]); });
    };
    TrackTableLayout l;
    const bool ids = whole(0);
    // With five cameras the raw table has eleven columns too, but those of the cameras count particles.
    const bool smoothed = ids && n == 11 && !(whole(4) && whole(5) && whole(6) && whole(7) && whole(8));
    if (smoothed) {
      l.columns = {"trackID", "x", "y", "z", "Vx", "Vy", "Vz", "Ax", "Ay", "Az", "frame"};
    } else {
      if (ids) l.columns.push_back("trackID");
      l.withoutIds =
          "MyPTV's particles file has no tracks; open trajectories or smoothed_trajectories to have them";
      l.columns.insert(l.columns.end(), {"x", "y", "z"});
      l.ignored.assign(l.columns.size(), false);
      while (l.columns.size() + 1 < n) {
        l.columns.push_back("column " + std::to_string(l.columns.size() + 1));
        l.ignored.push_back(true);
      }
      l.columns.push_back("frame");
    }
    l.frame = int(n) - 1;
    l.perFrame = l.zeroIsNone = smoothed;
    l.expected = "as many as in line 1";
    return l;
  };
  return {"MyPTV", layout, false};
}

} // namespace rimflow
