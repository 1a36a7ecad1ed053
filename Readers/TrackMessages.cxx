#include "TrackMessages.h"

#include "IdTable.h"

#include <algorithm>
#include <functional>
#include <locale>
#include <sstream>

namespace rimflow {

const char* const trackLineTooLong = "a line of more than 1 MiB; expected one row of numbers per line. The "
                                     "line ends are missing, or this is no track table: export it again.";

const char* const davisExportAdvice = "In DaVis, export the tracks as Tecplot ASCII (.dat), with positions, "
                                      "velocities, accelerations and track IDs.";

std::string printable(std::string_view text, std::size_t most) {
  return "\"" + plainText(text, most) + (text.size() > most ? "..." : "") + "\"";
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

std::string rowFault(const TrackRowsResult& r, std::string_view text, std::size_t offset,
                     const TrackColumnPlan& plan, const std::string& columnsKnownFrom) {
  using Fault = TrackRowsResult::Fault;
  const std::string value = printable(tokenAt(text, offset));
  switch (r.fault) {
  case Fault::TooLong:
    return trackLineTooLong;
  case Fault::NotANumber:
  case Fault::NotAnId:
    return "found " + value + " in column " + printable(plan.columns[r.column].label) + "; expected a " +
           (r.fault == Fault::NotAnId ? "whole " : "") + "number. Repair this row or export the file again.";
  case Fault::TooFew:
  case Fault::TooMany: {
    const std::string_view row = lineAt(text, offset);
    const bool decimalComma = r.fault == Fault::TooMany && row.find('.') == row.npos &&
                              row.find(',') != row.npos && row.find_first_of(" \t;") != row.npos;
    return "found " + std::to_string(r.values) + (r.values == 1 ? " value" : " values") + " in the row " +
           printable(row) + "; expected " + std::to_string(plan.columns.size()) + " values per row, " +
           columnsKnownFrom + ". " +
           (decimalComma ? "Commas seem to stand for decimal points: export with points."
                         : "Repair this row or export the file again.");
  }
  case Fault::HeaderInside:
    return "a header stands where a row of numbers was expected: these are several files in one, of which "
           "the columns may differ. Split them, or export again.";
  case Fault::None:
    break;
  }
  return {};
}

std::optional<std::string> duplicateIds(const TrackSnapshot& snapshot) {
  const std::vector<std::int64_t>& ids = snapshot.trackId;
  if (std::adjacent_find(ids.begin(), ids.end(), std::greater_equal<>()) == ids.end()) return {};
  IdTable seen(ids.size());
  std::size_t again = 0;
  std::int64_t example = 0;
  for (const std::int64_t id : ids) {
    if (id < 0) continue; // no track
    std::int32_t& first = seen[id];
    if (first != IdTable::none && again++ == 0) example = id;
    first = 0;
  }
  if (again == 0) return {};
  return std::to_string(again) + " particles of this snapshot have the trackID of another one, such as " +
         std::to_string(example) +
         "; all are kept, and pathlines follow the first. Ids written with too few digits look like "
         "this: export them as whole numbers.";
}

std::string notFiniteWarning(std::int64_t leftOut, std::int64_t rows, const std::string& where) {
  return std::to_string(leftOut) + " of " + std::to_string(rows) + " particles left out of " + where +
         ", the first one here: a position, velocity, acceleration, id or "
         "frame is missing, NaN or infinite. Check the export if these particles matter.";
}

std::string framePeriodWords(double framePeriod) {
  return framePeriod > 0 ? "the frame period of " + shortNumber(framePeriod) + " s"
                         : "1 s, because no FramePeriod is set. Set it to have true times";
}

std::string foreignFormat(std::string_view head) {
  const auto begins = [&](std::string_view magic) { return head.substr(0, magic.size()) == magic; };
  const std::string asAscii = " Export the particles as Tecplot ASCII (.dat).";
  if (head.empty()) return "the file is empty." + asAscii;
  if (head.substr(0, 4096).find("SetIdentifier") != head.npos)
    return std::string("this is DaVis' own .set file, which cannot be read here. ") + davisExportAdvice;
  if (begins("#!TDV") || begins("#!SZPLT")) return "this is a binary Tecplot file." + asAscii;
  if (begins("\x89HDF"))
    return "this is an HDF5 file (flowtracks, for instance), which is not read. Save its particles as CSV "
           "with "
           "a header (trajid, frame, x[m], y[m], z[m]).";
  if (begins("\xFF\xFE") || begins("\xFE\xFF"))
    return "this text is in UTF-16; expected plain text (ASCII, Latin-1 or UTF-8). Save it as UTF-8.";
  if (head.substr(0, 4096).find('\0') != head.npos)
    return "this is a binary file; expected Tecplot ASCII, which is text." + asAscii;
  return {};
}

} // namespace rimflow
