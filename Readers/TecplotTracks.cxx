#include "TecplotTracks.h"

#include "IdTable.h"
#include "TrackRows.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <set>
#include <sstream>

namespace rimflow {
namespace {

constexpr std::size_t longestHeader = std::size_t(4) << 20;
constexpr std::size_t mostZones = 1000000;
constexpr std::size_t pieceToRelease = std::size_t(32) << 20;
constexpr std::size_t mostPlainFilesOpen = 8;
constexpr std::size_t mostTemporaryBytes = std::size_t(4) << 30; // of unpacked files, when there are several

std::string printable(std::string_view text, std::size_t most = 40) {
  std::string result(text.substr(0, most));
  for (char& c : result)
    if (static_cast<unsigned char>(c) < 0x20 || c == 0x7f) c = '?';
  return "\"" + toUtf8(result) + (text.size() > most ? "..." : "") + "\"";
}

std::string shortNumber(double x) {
  std::ostringstream s;
  s.imbue(std::locale::classic());
  s.precision(12);
  s << x;
  return s.str();
}

std::string_view lineAt(std::string_view text, std::size_t begin) {
  const std::string_view rest = text.substr(begin, 4096);
  return rest.substr(0, rest.find_first_of("\r\n"));
}

std::string_view tokenAt(std::string_view text, std::size_t begin) {
  const std::string_view rest = text.substr(begin, 128);
  return rest.substr(0, rest.find_first_of(" \t,;\r\n"));
}

// Why a file is no Tecplot ASCII file, from its first bytes; empty when it may be one.
std::string foreignFormat(std::string_view head) {
  const auto begins = [&](std::string_view magic) { return head.substr(0, magic.size()) == magic; };
  const std::string asAscii = " Export the particles as Tecplot ASCII (.dat).";
  if (head.empty()) return "the file is empty." + asAscii;
  if (head.substr(0, 4096).find("SetIdentifier") != head.npos)
    return "this is DaVis' own .set file, which cannot be read here. In DaVis, export the tracks as Tecplot "
           "ASCII "
           "(.dat), with positions, velocities, accelerations and track IDs.";
  if (begins("#!TDV") || begins("#!SZPLT")) return "this is a binary Tecplot file." + asAscii;
  if (begins("\xFF\xFE") || begins("\xFE\xFF"))
    return "this text is in UTF-16; expected plain text (ASCII, Latin-1 or UTF-8). Save it as UTF-8.";
  if (head.substr(0, 4096).find('\0') != head.npos)
    return "this is a binary file; expected Tecplot ASCII, which is text." + asAscii;
  return {};
}

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

const char* const lineTooLong = "a line of more than 1 MiB; expected one row of numbers per line. The line "
                                "ends are missing, or this is no "
                                "Tecplot ASCII file: export it again.";

} // namespace

// What is carried from zone to zone and from file to file while indexing.
struct TecplotTracks::Scan {
  bool trustRowCounts = true;
  double bytesPerRow = 0; // of the zone before; 0: not known
};

std::string TecplotTracks::at(std::size_t file, std::size_t offset) const {
  return paths[file] + ", line " + std::to_string(lineOf(file, offset)) + ": ";
}

std::size_t TecplotTracks::lineOf(std::size_t file, std::size_t offset) const {
  const auto source = mapped(file);
  const std::string_view text = source->text();
  offset = std::min(offset, text.size());
  auto& known = lines[file];
  known.emplace(0, 1);
  const auto before = std::prev(known.upper_bound(offset));
  std::size_t p = before->first, line = before->second;
  while (p < offset) {
    const std::size_t end = std::min(offset, p + pieceToRelease);
    line +=
        std::size_t(std::count(text.begin() + std::ptrdiff_t(p), text.begin() + std::ptrdiff_t(end), '\n'));
    if (offset - before->first > pieceToRelease) source->release(p, end);
    p = end;
  }
  known.emplace(offset, line);
  return line;
}

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

namespace {
std::vector<std::string> inNaturalOrder(std::vector<std::string> files) {
  std::stable_sort(files.begin(), files.end(), naturallyBefore);
  return files;
}
} // namespace

bool TecplotTracks::isOpen(std::vector<std::string> files) const {
  files = inNaturalOrder(std::move(files));
  files.erase(std::unique(files.begin(), files.end()), files.end());
  if (files.empty() || files != paths) return false;
  try {
    for (std::size_t f = 0; f < files.size(); ++f)
      if (stampOf(files[f]) != stamps[f]) return false;
  } catch (const std::exception&) {
    return false;
  }
  return true;
}

void TecplotTracks::close() { *this = TecplotTracks(); }

bool TecplotTracks::open(std::vector<std::string> files, const Progress& progress, bool trustRowCounts) {
  close();
  if (files.empty()) throw std::runtime_error("No file name was given. Set FileNames.");
  try {
    paths = inNaturalOrder(std::move(files));
    for (std::size_t f = 1; f < paths.size(); ++f)
      if (paths[f] == paths[f - 1]) notes.push_back(paths[f] + ": given more than once; read once.");
    paths.erase(std::unique(paths.begin(), paths.end()), paths.end());
    stamps.resize(paths.size());
    lines.resize(paths.size());
    Scan scan;
    scan.trustRowCounts = trustRowCounts;
    for (std::size_t f = 0; f < paths.size(); ++f) {
      stamps[f] = stampOf(paths[f]);
      const auto part = [&](double fraction) {
        return goOn(progress, (double(f) + fraction) / double(paths.size()));
      };
      const auto source = mapped(f, part);
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

std::shared_ptr<MappedFile> TecplotTracks::mapped(std::size_t file, const Progress& progress) const {
  if (const auto found = open_.find(file); found != open_.end()) {
    lastUsed.erase(std::find(lastUsed.begin(), lastUsed.end(), file));
    lastUsed.push_back(file);
    return found->second;
  }
  auto source = MappedFile::open(paths[file], progress);
  if (!source) return nullptr;
  if (source->stamp() != stamps[file])
    throw TrackIndexOutdated(paths[file] + ": the file has changed since it was opened.");
  std::size_t temporary = source->temporaryBytes(), plain = source->temporaryBytes() == 0;
  for (auto f = lastUsed.rbegin(); f != lastUsed.rend(); ++f) {
    temporary += open_[*f]->temporaryBytes();
    plain += open_[*f]->temporaryBytes() == 0;
    if (temporary > mostTemporaryBytes || plain > mostPlainFilesOpen) open_.erase(*f);
  }
  lastUsed.erase(
      std::remove_if(lastUsed.begin(), lastUsed.end(), [&](std::size_t f) { return !open_.count(f); }),
      lastUsed.end());
  open_[file] = source;
  lastUsed.push_back(file);
  return source;
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
    throw std::runtime_error(paths[file] + ": " + foreign);
  constexpr std::size_t none = std::size_t(-1);
  std::size_t layout = none, released = 0;
  const std::size_t zonesBefore = index.size();
  for (std::size_t p = 0; p < text.size();) {
    const std::size_t headerBegin = p;
    bool tooLong = false;
    const std::size_t headerEnd = endOfHeader(text, p, tooLong);
    if (tooLong && layout == none && text.substr(p, longestHeader).find("VARIABLES") == text.npos)
      throw std::runtime_error(paths[file] +
                               ", line 1: no VARIABLES and no row of numbers in the first 4 MiB. This is "
                               "no Tecplot ASCII file, or its line ends are missing: export it again.");
    if (tooLong) throw std::runtime_error(at(file, headerEnd) + lineTooLong);
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
      throw std::runtime_error(paths[file] + ": more than a million snapshots. Open fewer files at a time.");
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
      if (end.tooLong) throw std::runtime_error(at(file, end.offset) + lineTooLong);
      scan.trustRowCounts = scan.trustRowCounts && zone.declaredRows == end.rows;
      const auto line = lines[file].find(headerEnd);
      if (line != lines[file].end()) lines[file].emplace(end.offset, line->second + end.lines);
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
    throw std::runtime_error(paths[file] +
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
    entries.push_back({z.time, numberAtEnd(z.title), numberOfFile(paths[z.file]), z.file});
  const TrackTimeline line = arrangeTimes(entries, options);

  warnings.insert(warnings.end(), notes.begin(), notes.end());
  const auto zoneAt = [&](std::size_t z) { return at(index[z].file, index[z].header); };
  using Source = TrackTimeline::Source;
  const std::string number = line.source == Source::TitleNumber  ? "the number in the zone's title"
                             : line.source == Source::FileNumber ? "the number in the file's name"
                                                                 : "the order of the snapshots";
  const std::string period = options.framePeriod > 0
                                 ? "the frame period of " + shortNumber(options.framePeriod) + " s"
                                 : "1 s, because no FramePeriod is set. Set it to have true times";
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
        zoneAt(z) + "this snapshot has the same time as the one at " + paths[index[by].file] + ", line " +
        std::to_string(lineOf(index[by].file, index[by].header)) + "; only the later one is used" +
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

bool TecplotTracks::read(std::size_t zoneNumber, LengthUnit unit, TrackSnapshot& snapshot,
                         std::vector<std::string>& warnings, const Progress& progress,
                         Content content) const {
  snapshot = {};
  const TecplotZone& zone = index.at(zoneNumber);
  if (stampOf(paths[zone.file]) != stamps[zone.file])
    throw TrackIndexOutdated(paths[zone.file] + ": the file has changed since it was opened.");
  const auto source = mapped(zone.file, progress);
  if (!source) return false;
  const std::string_view text = source->text();
  if (!zone.problem.empty()) throw std::runtime_error(at(zone.file, zone.problemOffset) + zone.problem);
  const TrackColumnPlan& plan = columns(zoneNumber, unit);
  if (!plan.error.empty()) throw std::runtime_error(at(zone.file, zone.header) + plan.error + ".");

  source->willNeed(zone.begin, zone.end);
  const TrackRowsResult r = readTrackRows(text.substr(zone.begin, zone.end - zone.begin), plan,
                                          content == Content::TrackIds, snapshot, progress);
  source->release(zone.begin, zone.end);
  if (r.aborted) return false;

  using Fault = TrackRowsResult::Fault;
  const std::size_t offset = zone.begin + r.offset;
  const std::string expected =
      std::to_string(plan.columns.size()) + " values per row, as many as there are VARIABLES";
  const auto column = [&] { return printable(plan.columns[r.column].label); };
  switch (r.fault) {
  case Fault::None:
    break;
  case Fault::TooFew:
    if (zone.end == text.size() && text.find('\n', offset) == text.npos)
      throw std::runtime_error(
          at(zone.file, offset) + "the file ends in the middle of a row, after " + std::to_string(r.values) +
          " of " + std::to_string(plan.columns.size()) + " values" +
          (zone.declaredRows >= 0
               ? " and " + std::to_string(r.rows) + " of " + std::to_string(zone.declaredRows) + " rows"
               : std::string()) +
          ". This snapshot is not whole: copy or export the file again. The other snapshots can "
          "be read.");
    [[fallthrough]];
  case Fault::TooMany: {
    const std::string_view row = lineAt(text, offset);
    bool decimalComma = r.fault == Fault::TooMany && row.find('.') == row.npos;
    decimalComma = decimalComma && row.find(',') != row.npos && row.find_first_of(" \t;") != row.npos;
    throw std::runtime_error(at(zone.file, offset) + "found " + std::to_string(r.values) +
                             (r.values == 1 ? " value" : " values") + " in the row " + printable(row) +
                             "; expected " + expected + ". " +
                             (decimalComma ? "Commas seem to stand for decimal points: export with points."
                                           : "Repair this row or export the file again."));
  }
  case Fault::NotANumber:
    throw std::runtime_error(at(zone.file, offset) + "found " + printable(tokenAt(text, offset)) +
                             " in column " + column() +
                             "; expected a number. Repair this row or export the file again.");
  case Fault::NotAnId:
    throw std::runtime_error(at(zone.file, offset) + "found " + printable(tokenAt(text, offset)) +
                             " in column " + column() +
                             "; expected a whole number. Repair this row or export the file again.");
  case Fault::TooLong:
    throw std::runtime_error(at(zone.file, offset) + lineTooLong);
  case Fault::HeaderInside:
    throw TrackIndexOutdated(at(zone.file, offset) +
                             "a header stands where I=" + std::to_string(zone.declaredRows) + " in " +
                             printable(zone.title) + " announced rows. All lines have to be looked at.");
  }

  const auto warn = [&](std::size_t where, const std::string& what) {
    warnings.push_back(at(zone.file, where) + what);
  };
  for (const std::string& w : plan.warnings)
    warnings.push_back(paths[layoutFile[zone.layout]] + ": " + w + ".");
  if (zone.declaredRows >= 0 && zone.declaredRows != r.rows)
    warn(zone.header, "the zone " + printable(zone.title) + " announces I=" +
                          std::to_string(zone.declaredRows) + " rows, but has " + std::to_string(r.rows) +
                          "; all that are there are read. If the export was interrupted, export again.");
  if (r.notFinite > 0)
    warn(zone.begin + r.firstNotFinite, std::to_string(r.notFinite) + " of " + std::to_string(r.rows) +
                                            " particles left out of this snapshot, the first one here: a "
                                            "position, velocity, acceleration or id is "
                                            "NaN or infinite. Check the export if these particles matter.");
  const std::vector<std::int64_t>& ids = snapshot.trackId;
  if (std::adjacent_find(ids.begin(), ids.end(), std::greater_equal<>()) != ids.end()) {
    IdTable seen(ids.size());
    std::size_t again = 0;
    std::int64_t example = 0;
    for (const std::int64_t id : ids) {
      if (id < 0) continue; // no track
      std::int32_t& first = seen[id];
      if (first != IdTable::none && again++ == 0) example = id;
      first = 0;
    }
    if (again > 0)
      warn(zone.header,
           std::to_string(again) + " particles of this snapshot have the trackID of another one, such as " +
               std::to_string(example) +
               "; all are kept, and pathlines follow the first. Ids written with too few digits look like "
               "this: export them as whole numbers.");
  }
  return true;
}

} // namespace rimflow
