#include "TecplotTracks.h"

#include "TrackMessages.h"
#include "TrackRows.h"

#include <algorithm>
#include <cmath>
#include <cstring>

namespace rimflow {
namespace {

constexpr std::size_t longestHeader = std::size_t(4) << 20;
constexpr std::size_t mostZones = 1000000;
constexpr std::size_t pieceToRelease = std::size_t(32) << 20;

// The first line from `begin` on (which is the start of a line) that is a row of numbers, or the text's end.
std::size_t endOfHeader(std::string_view text, std::size_t begin, bool& tooLong) {
  for (std::size_t p = begin; p < text.size();) {
    if (looksLikeRow(text.substr(p, 64))) return p;
    const std::size_t room = std::min(text.size() - p, longestHeader);
    const void* newline = std::memchr(text.data() + p, '\n', room);
    tooLong = (!newline && room < text.size() - p) || p - begin > longestHeader;
    if (tooLong) return p;
    p = newline ? std::size_t(static_cast<const char*>(newline) - text.data()) + 1 : text.size();
  }
  return text.size();
}

// Walks over lines of rows from a line's start up to the first line that opens a header, or up to `limit`.
struct RowsEnd {
  std::size_t offset = 0; // of that line; text.size() at the end of the text
  bool found = false;     // a header or the end of the text, before the limit
  bool tooLong = false;   // a line at `offset` has no end
  std::int64_t rows = 0;  // lines with numbers
  std::size_t lines = 0;
};
RowsEnd findRowsEnd(const MappedFile& source, std::size_t begin, std::size_t limit) {
  const std::string_view text = source.text();
  RowsEnd r;
  std::size_t p = begin, released = begin;
  while (p < text.size() && p < limit) {
    const char c = text[p];
    if ((c >= '0' && c <= '9') || c == '-')
      ++r.rows;
    else if (beginsTecplotRecord(text.substr(p, 64))) {
      r.offset = p;
      r.found = true;
      return r;
    } else if (looksLikeRow(text.substr(p, 64)))
      ++r.rows;
    const std::size_t room = std::min(text.size() - p, longestTrackLine + 1);
    const void* newline = std::memchr(text.data() + p, '\n', room);
    if (!newline && room > longestTrackLine) {
      r.offset = p;
      r.tooLong = true;
      return r;
    }
    p = newline ? std::size_t(static_cast<const char*>(newline) - text.data()) + 1 : text.size();
    r.lines += newline != nullptr;
    if (p - released > pieceToRelease) {
      source.release(released, p);
      released = p;
    }
  }
  r.offset = p;
  r.found = p >= text.size();
  return r;
}

std::size_t nextLine(std::string_view text, std::size_t offset) {
  const std::size_t room = std::min(text.size() - offset, longestTrackLine);
  const void* newline = std::memchr(text.data() + offset, '\n', room);
  return newline ? std::size_t(static_cast<const char*>(newline) - text.data()) + 1 : text.npos;
}

} // namespace

// What is carried from zone to zone and from file to file while indexing.
struct TecplotTracks::Scan {
  bool trustRowCounts = true;
  double bytesPerRow = 0; // of the zone before; 0: not known
};

bool TecplotTracks::canRead(const std::string& path) {
  try {
    const std::string head = headOfFile(path, 1 << 16);
    const std::string foreign = foreignFormat(head);
    if (!foreign.empty()) return foreign.find(".set") != foreign.npos;
    bool tooLong = false;
    const std::size_t end = endOfHeader(head, 0, tooLong);
    const TecplotHeader header = parseTecplotHeader(std::string_view(head).substr(0, end));
    if (!header.hasVariables) return false;
    for (const TecplotZoneHeader& z : header.zones)
      if (z.j > 1 || z.k > 1 || z.packing == "BLOCK") return false;
    const TrackColumnPlan plan = planTrackColumns(header.variables, LengthUnit::Millimetre);
    return plan.error.empty() && (plan.hasVelocity || plan.hasTrackId);
  } catch (const std::exception&) {
    return false;
  }
}

bool TecplotTracks::isOpen(std::vector<std::string> files) const { return texts.areStill(std::move(files)); }

void TecplotTracks::close() { *this = TecplotTracks(); }

bool TecplotTracks::open(std::vector<std::string> files, const Progress& progress, bool trustRowCounts) {
  close();
  try {
    texts = TrackTexts(std::move(files));
    Scan scan;
    scan.trustRowCounts = trustRowCounts;
    for (std::size_t f = 0; f < texts.size(); ++f) {
      const auto part = [&](double fraction) {
        return goOn(progress, (double(f) + fraction) / double(texts.size()));
      };
      const auto source = texts.first(f, part);
      if (!source || !part(1.0)) {
        close();
        return false;
      }
      indexFile(f, *source, scan);
    }
    const auto healthy = [](const TecplotZone& z) { return z.problem.empty(); };
    if (std::none_of(index.begin(), index.end(), healthy))
      throw std::runtime_error(at(index[0].file, index[0].problemOffset) + index[0].problem);
    return true;
  } catch (...) {
    close();
    throw;
  }
}

std::size_t TecplotTracks::layoutOf(const std::vector<std::string>& variables, std::size_t file) {
  const auto found = std::find(layouts.begin(), layouts.end(), variables);
  const std::size_t layout = std::size_t(found - layouts.begin());
  if (found == layouts.end()) {
    layouts.push_back(variables);
    layoutFile.push_back(file);
  }
  return layout;
}

void TecplotTracks::checkZone(const TecplotZoneHeader& header, std::size_t file, std::size_t offset) const {
  const std::string remedy =
      " Particles are expected, one row each (J=1, K=1, DATAPACKING=POINT): export the tracks "
      "instead of a grid.";
  if (header.j > 1 || header.k > 1)
    throw std::runtime_error(at(file, offset) + "this zone is a grid of J=" + std::to_string(header.j) +
                             ", K=" + std::to_string(header.k) + "." + remedy);
  if (header.packing == "BLOCK" || header.packing.rfind("FE", 0) == 0)
    throw std::runtime_error(at(file, offset) + "this zone is packed as " + printable(header.packing) + "." +
                             remedy);
  if (!header.zoneType.empty() && header.zoneType != "ORDERED")
    throw std::runtime_error(at(file, offset) + "this zone is of type " + printable(header.zoneType) + "." +
                             remedy);
}

void TecplotTracks::indexFile(std::size_t file, const MappedFile& source, Scan& scan) {
  const std::string_view text = source.text();
  if (const std::string foreign = foreignFormat(text.substr(0, 1 << 16)); !foreign.empty())
    throw std::runtime_error(texts.paths()[file] + ": " + foreign);
  constexpr std::size_t none = std::size_t(-1);
  std::size_t layout = none, released = 0;
  const std::size_t zonesBefore = index.size();
  for (std::size_t p = 0; p < text.size();) {
    const std::size_t headerBegin = p;
    bool tooLong = false;
    const std::size_t headerEnd = endOfHeader(text, p, tooLong);
    if (tooLong && layout == none && text.substr(p, longestHeader).find("VARIABLES") == text.npos)
      throw std::runtime_error(texts.paths()[file] +
                               ", line 1: no VARIABLES and no row of numbers in the first 4 MiB. This is "
                               "no Tecplot ASCII file, or its line ends are missing: export it again.");
    if (tooLong) throw std::runtime_error(at(file, headerEnd) + trackLineTooLong);
    const TecplotHeader header = parseTecplotHeader(text.substr(headerBegin, headerEnd - headerBegin));
    if (header.hasVariables) layout = layoutOf(header.variables, file);
    if (layout == none) {
      const bool row = headerEnd < text.size();
      throw std::runtime_error(
          at(file, row ? headerEnd : headerBegin + header.problemOffset) + "found " +
          printable(lineAt(text, row ? headerEnd : headerBegin + header.problemOffset)) +
          (row ? " before any VARIABLES line, so what the columns mean is not known"
               : ", and no VARIABLES line in the whole file") +
          "; expected VARIABLES = \"x[mm]\" \"y[mm]\" ... and a ZONE, as in DaVis' Tecplot ASCII export. "
          "Export the tracks in this format, with the header.");
    }
    std::vector<TecplotZoneHeader> zones = header.zones;
    if (zones.empty() && headerEnd < text.size()) { // rows without the word ZONE
      zones.emplace_back();
      zones.back().end = headerEnd - headerBegin;
      zones.back().problem = header.problem;
      zones.back().problemOffset = header.problemOffset;
    }
    for (const TecplotZoneHeader& z : zones) {
      checkZone(z, file, headerBegin + z.offset);
      TecplotZone zone;
      zone.file = file;
      zone.header = headerBegin + z.offset;
      zone.begin = zone.end = headerBegin + z.end;
      zone.layout = layout;
      zone.declaredRows = z.rows;
      zone.time = z.time;
      zone.title = z.title;
      if (!z.problem.empty()) {
        zone.problem =
            z.problem +
            ". The header or the first row of this snapshot is damaged: repair or export it again.";
        zone.problemOffset = headerBegin + z.problemOffset;
      }
      index.push_back(std::move(zone));
    }
    if (index.size() > mostZones)
      throw std::runtime_error(texts.paths()[file] +
                               ": more than a million snapshots. Open fewer files at a time.");
    if (headerEnd == text.size()) break;

    TecplotZone& zone = index.back();
    const double expected = double(std::max<std::int64_t>(zone.declaredRows, 0)) * scan.bytesPerRow;
    RowsEnd end;
    bool jumped = false;
    if (scan.trustRowCounts && expected > double(1 << 22) &&
        expected * 0.97 < double(text.size() - headerEnd)) {
      const std::size_t from = nextLine(text, headerEnd + std::size_t(0.97 * expected));
      if (from != text.npos) end = findRowsEnd(source, from, headerEnd + std::size_t(1.03 * expected));
      jumped = end.found && double(end.offset - headerEnd) <= 1.03 * expected;
    }
    if (!jumped) {
      end = findRowsEnd(source, headerEnd, text.npos);
      if (end.tooLong) throw std::runtime_error(at(file, end.offset) + trackLineTooLong);
      scan.trustRowCounts = scan.trustRowCounts && zone.declaredRows == end.rows;
      const auto line = texts.knownLines(file).find(headerEnd);
      if (line != texts.knownLines(file).end())
        texts.knownLines(file).emplace(end.offset, line->second + end.lines);
    }
    zone.begin = headerEnd;
    zone.end = end.offset;
    const double rows = jumped ? double(zone.declaredRows) : double(end.rows);
    scan.bytesPerRow = rows > 0 ? double(zone.end - zone.begin) / rows : 0;
    p = end.offset;
    if (p - released > pieceToRelease) {
      source.release(released, p);
      released = p;
    }
  }
  source.release(0, text.size());
  if (index.size() == zonesBefore)
    throw std::runtime_error(texts.paths()[file] +
                             ": the header names the columns, but there is no ZONE and no row of "
                             "numbers. Export the tracks again.");
}

const TrackColumnPlan& TecplotTracks::columns(std::size_t zone, LengthUnit unit) const {
  const std::size_t layout = index.at(zone).layout;
  const auto found = plans.find({layout, unit});
  if (found != plans.end()) return found->second;
  return plans.emplace(std::make_pair(layout, unit), planTrackColumns(layouts[layout], unit)).first->second;
}

TrackTimeline TecplotTracks::timeline(const TrackTimeOptions& options,
                                      std::vector<std::string>& warnings) const {
  std::vector<TrackTimeEntry> entries;
  for (const TecplotZone& z : index)
    entries.push_back({z.time, numberAtEnd(z.title), numberOfFile(texts.paths()[z.file]), z.file});
  const TrackTimeline line = arrangeTimes(entries, options);

  warnings.insert(warnings.end(), texts.notes().begin(), texts.notes().end());
  const auto zoneAt = [&](std::size_t z) { return at(index[z].file, index[z].header); };
  using Source = TrackTimeline::Source;
  const std::string number = line.source == Source::TitleNumber  ? "the number in the zone's title"
                             : line.source == Source::FileNumber ? "the number in the file's name"
                                                                 : "the order of the snapshots";
  const std::string period = framePeriodWords(options.framePeriod);
  if (line.allTimesEqual)
    warnings.push_back(zoneAt(0) + "all " + std::to_string(index.size()) +
                       " snapshots have SOLUTIONTIME=" + shortNumber(index[0].time) +
                       ", so it is not used; the time is " + number + " times " + period + ".");
  else if (line.source == Source::PartlyFile) {
    const auto first =
        std::find_if(index.begin(), index.end(), [](const TecplotZone& z) { return std::isnan(z.time); });
    warnings.push_back(zoneAt(std::size_t(first - index.begin())) + "no number in SOLUTIONTIME here" +
                       (line.withoutTime > 1
                            ? " and in " + std::to_string(line.withoutTime - 1) + " more snapshots"
                            : std::string()) +
                       "; placed between the snapshots that have a time, by their numbers.");
  } else if (line.framePeriodMissing && line.withoutTime > 0)
    warnings.push_back(zoneAt(0) + "no number in SOLUTIONTIME; the time is " + number + " times " + period +
                       ".");
  if (!line.replaced.empty()) {
    const std::size_t z = line.replaced[0], by = line.replacedBy[0];
    warnings.push_back(
        zoneAt(z) + "this snapshot has the same time as the one at " + texts.paths()[index[by].file] +
        ", line " + std::to_string(lineOf(index[by].file, index[by].header)) +
        "; only the later one is used" +
        (line.replaced.size() > 1 ? ", and so for " + std::to_string(line.replaced.size() - 1) + " more"
                                  : std::string()) +
        ". If both are needed, open the files one by one, or correct SOLUTIONTIME.");
  }
  const auto negative =
      std::find_if(index.begin(), index.end(), [](const TecplotZone& z) { return z.time < 0; });
  if (negative != index.end())
    warnings.push_back(zoneAt(std::size_t(negative - index.begin())) +
                       "SOLUTIONTIME=" + shortNumber(negative->time) +
                       " is negative; it is kept. Set TimeShift or ShiftTimeToZero to move all times.");
  return line;
}

bool TecplotTracks::read(std::size_t zoneNumber, const TrackUnits& units, TrackSnapshot& snapshot,
                         std::vector<std::string>& warnings, const Progress& progress,
                         Content content) const {
  snapshot = {};
  const TecplotZone& zone = index.at(zoneNumber);
  texts.checkUnchanged(zone.file);
  const auto source = texts.mapped(zone.file, progress);
  if (!source) return false;
  const std::string_view text = source->text();
  if (!zone.problem.empty()) throw std::runtime_error(at(zone.file, zone.problemOffset) + zone.problem);
  const TrackColumnPlan& plan = columns(zoneNumber, units.length);
  if (!plan.error.empty()) throw std::runtime_error(at(zone.file, zone.header) + plan.error + ".");

  source->willNeed(zone.begin, zone.end);
  const TrackRowsResult r = readTrackRows(text.substr(zone.begin, zone.end - zone.begin), plan,
                                          content == Content::TrackIds, snapshot, progress);
  source->release(zone.begin, zone.end);
  if (r.aborted) return false;

  using Fault = TrackRowsResult::Fault;
  const std::size_t offset = zone.begin + r.offset;
  if (r.fault == Fault::TooFew && zone.end == text.size() && text.find('\n', offset) == text.npos)
    throw std::runtime_error(
        at(zone.file, offset) + "the file ends in the middle of a row, after " + std::to_string(r.values) +
        " of " + std::to_string(plan.columns.size()) + " values" +
        (zone.declaredRows >= 0
             ? " and " + std::to_string(r.rows) + " of " + std::to_string(zone.declaredRows) + " rows"
             : std::string()) +
        ". This snapshot is not whole: copy or export the file again. The other snapshots can be read.");
  if (r.fault == Fault::HeaderInside)
    throw TrackIndexOutdated(at(zone.file, offset) +
                             "a header stands where I=" + std::to_string(zone.declaredRows) + " in " +
                             printable(zone.title) + " announced rows. All lines have to be looked at.");
  if (r.fault != Fault::None)
    throw std::runtime_error(at(zone.file, offset) +
                             rowFault(r, text, offset, plan, "as many as there are VARIABLES"));

  const auto warn = [&](std::size_t where, const std::string& what) {
    warnings.push_back(at(zone.file, where) + what);
  };
  for (const std::string& w : plan.warnings)
    warnings.push_back(texts.paths()[layoutFile[zone.layout]] + ": " + w + ".");
  if (zone.declaredRows >= 0 && zone.declaredRows != r.rows)
    warn(zone.header, "the zone " + printable(zone.title) + " announces I=" +
                          std::to_string(zone.declaredRows) + " rows, but has " + std::to_string(r.rows) +
                          "; all that are there are read. If the export was interrupted, export again.");
  if (r.notFinite > 0)
    warn(zone.begin + r.firstNotFinite, notFiniteWarning(r.notFinite, r.rows, "this snapshot"));
  if (const auto duplicates = duplicateIds(snapshot)) warn(zone.header, *duplicates);
  return true;
}

} // namespace rimflow
