#include "OpenPTVTracks.h"

#include "FileSnapshots.h"
#include "TableHead.h"
#include "TrackMessages.h"
#include "TrackRows.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace rimflow {
namespace {

const char* const notOpenPTV =
    "line 1: expected the number of particles alone in this line, as in the other files. "
    "Open files of one format together.";

// The count in line 1, and the first row if there is one.
struct Head {
  std::int64_t count = -1;
  std::size_t rows = 0;
  std::vector<std::string_view> row;
};
Head parse(std::string_view text) {
  Head head;
  const auto lines = linesOfHead(text, 2);
  if (lines.empty()) return head;
  const auto first = valuesOf(lines[0].text);
  if (first.size() != 1 || !isInteger(first[0]) || first[0].front() == '-' || first[0].size() > 10)
    return head;
  head.count = std::stoll(std::string(first[0]));
  head.rows = lines[0].begin + lines[0].text.size();
  if (lines.size() > 1) head.row = valuesOf(lines[1].text);
  return head;
}

TrackTableLayout linksLayout() {
  TrackTableLayout l;
  l.columns = {"prev", "next", "px", "py", "pz"}; // as they are: rows must keep their numbers
  l.expected = "prev, next, x, y and z";
  return l;
}

} // namespace

bool isOpenPTVLinks(std::string_view text) {
  const Head head = parse(text);
  return head.count >= 0 && head.row.size() == 5 && isInteger(head.row[0]) && isInteger(head.row[1]) &&
         std::all_of(head.row.begin() + 2, head.row.end(), isNumber);
}

bool isOpenPTVPositions(std::string_view text) {
  const Head head = parse(text);
  return head.count >= 0 && head.row.size() >= 4 && isInteger(head.row[0]) &&
         std::all_of(head.row.begin() + 1, head.row.end(), isNumber) && !isOpenPTVLinks(text);
}

bool isEmptyOpenPTVFrame(std::string_view text) {
  const Head head = parse(text);
  return head.count >= 0 && head.row.empty();
}

TrackTableFormat openPTVPositionsFormat() {
  const auto layout = [](std::string_view text) {
    const Head head = parse(text);
    if (head.count < 0) throw std::runtime_error(notOpenPTV);
    TrackTableLayout l;
    l.columns = {"index", "x", "y", "z"};
    l.ignored = {true, false, false, false};
    while (l.columns.size() < head.row.size()) {
      l.columns.push_back("camera " + std::to_string(l.columns.size() - 3));
      l.ignored.push_back(true);
    }
    l.rows = head.rows;
    l.declaredRows = head.count;
    l.expected = "as many as in line 2";
    l.withoutIds = "OpenPTV's rt_is files have no tracks; open the ptv_is files to have them";
    return l;
  };
  return {"OpenPTV", layout, false};
}

void OpenPTVTracks::readFile(std::size_t file, std::string_view text, Links& before) {
  const auto fail = [&](std::size_t offset, const std::string& what) {
    throw std::runtime_error(texts.at(file, offset) + what);
  };
  const Head head = parse(text.substr(0, trackHeadBytes));
  if (head.count < 0) throw std::runtime_error(texts.paths()[file] + ", " + notOpenPTV);
  TrackColumnPlan plan = rawPlan(linksLayout());
  plan.columns[2].label = "x";
  plan.columns[3].label = "y";
  plan.columns[4].label = "z";
  const std::string_view rows = text.substr(head.rows);
  TrackSnapshot read;
  const TrackRowsResult r = readTrackRows(rows, plan, false, read);
  if (r.fault == TrackRowsResult::Fault::TooFew && rows.find('\n', r.offset) == rows.npos)
    fail(head.rows + r.offset, "the file ends in the middle of a row, after " + std::to_string(r.rows) +
                                   " of " + std::to_string(head.count) +
                                   " rows. Copy or export the file again.");
  if (r.fault != TrackRowsResult::Fault::None)
    fail(head.rows + r.offset, rowFault(r, rows, r.offset, plan, linksLayout().expected));
  if (r.rows != head.count)
    notes.push_back(texts.paths()[file] + ", line 1: announces " + std::to_string(head.count) +
                    " rows, but has " + std::to_string(r.rows) +
                    "; all that are there are read. If the export was interrupted, export again.");

  const std::size_t n = std::size_t(r.rows);
  const auto column = [&](std::size_t c, std::size_t row) { return read.further[c].values[row]; };
  Links links;
  links.number = numberOfFile(texts.paths()[file]);
  links.there = true;
  const bool consecutive = before.there && links.number - 1 == before.number;
  if (before.there && !consecutive)
    notes.push_back(texts.paths()[file] + ", line 1: the frame before " + std::to_string(links.number) +
                    " is not among the files, so all tracks end there. Open all frames together.");
  TrackSnapshot kept;
  std::size_t notFinite = 0, disagree = 0, again = 0;
  for (std::size_t row = 0; row < n; ++row) {
    std::int64_t link[2];
    for (std::size_t c : {0, 1}) {
      const double value = column(c, row);
      if (value != std::floor(value) || std::abs(value) > 1e15)
        throw std::runtime_error(texts.paths()[file] + ", line " + std::to_string(row + 2) + ": found " +
                                 shortNumber(value) + " in column " + (c == 0 ? "prev" : "next") +
                                 "; expected a whole number. Repair this row or export the file again.");
      link[c] = std::int64_t(value);
    }
    links.next.push_back(link[1]);
    std::int64_t id = -1;
    if (consecutive && link[0] >= 0) {
      if (std::size_t(link[0]) >= before.id.size())
        throw std::runtime_error(
            texts.paths()[file] + ", line " + std::to_string(row + 2) + ": found " + std::to_string(link[0]) +
            " in column prev, but frame " + std::to_string(before.number) + " has " +
            std::to_string(before.id.size()) +
            " rows, counted from 0. The files are not of one run, or one is damaged: export "
            "them again.");
      if (before.next[std::size_t(link[0])] == std::int64_t(row))
        id = before.id[std::size_t(link[0])];
      else
        ++disagree;
    }
    if (id < 0) id = tracks++;
    links.id.push_back(id);
    const float x[3] = {float(column(2, row)), float(column(3, row)), float(column(4, row))};
    if (!std::isfinite(x[0]) || !std::isfinite(x[1]) || !std::isfinite(x[2])) {
      again = notFinite++ == 0 ? row : again;
      continue;
    }
    kept.position.insert(kept.position.end(), x, x + 3);
    kept.trackId.push_back(id);
  }
  if (disagree > 0)
    notes.push_back(
        texts.paths()[file] + ", line 1: " + std::to_string(disagree) +
        " particles name one of the frame before that does not name them as its next; their tracks "
        "begin anew. If there are many, the files are not of one run.");
  if (notFinite > 0)
    notes.push_back(texts.paths()[file] + ", line " + std::to_string(again + 2) + ": " +
                    notFiniteWarning(std::int64_t(notFinite), std::int64_t(n), "this snapshot"));
  counts.push_back(kept.size());
  store.add(std::move(kept));
  before = std::move(links);
}

bool OpenPTVTracks::open(std::vector<std::string> files, const Progress& progress, bool) {
  *this = OpenPTVTracks();
  try {
    texts = TrackTexts(std::move(files));
    Links before;
    for (std::size_t f = 0; f < texts.size(); ++f) {
      const auto source = texts.first(f);
      readFile(f, source->text(), before);
      if (!goOn(progress, double(f + 1) / double(texts.size()))) {
        *this = OpenPTVTracks();
        return false;
      }
    }
    return true;
  } catch (...) {
    *this = OpenPTVTracks();
    throw;
  }
}

const TrackColumnPlan& OpenPTVTracks::columns(std::size_t, LengthUnit unit) const {
  const auto found = plans.find(unit);
  if (found != plans.end()) return found->second;
  TrackTableLayout layout;
  layout.columns = {"x", "y", "z", "trackID"};
  return plans.emplace(unit, outputPlan(layout, unit)).first->second;
}

TrackTimeline OpenPTVTracks::timeline(const TrackTimeOptions& options,
                                      std::vector<std::string>& warnings) const {
  warnings.insert(warnings.end(), notes.begin(), notes.end());
  return timelineOfFiles(texts, options, warnings);
}

bool OpenPTVTracks::read(std::size_t snapshot, const TrackUnits& units, TrackSnapshot& particles,
                         std::vector<std::string>&, const Progress& progress, Content content) const {
  particles = {};
  if (!goOn(progress, 0)) return false;
  store.append(snapshot, 0, counts.at(snapshot), content == Content::TrackIds, particles);
  const double scale = columns(snapshot, units.length).columns[0].scale;
  for (float& x : particles.position) x = float(double(x) * scale);
  return true;
}

} // namespace rimflow
