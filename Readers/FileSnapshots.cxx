#include "FileSnapshots.h"

#include "TrackMessages.h"
#include "TrackRows.h"

#include <stdexcept>

namespace rimflow {

TrackTimeline timelineOfFiles(const TrackTexts& texts, const TrackTimeOptions& options,
                              std::vector<std::string>& warnings) {
  std::vector<TrackTimeEntry> entries(texts.size());
  for (std::size_t f = 0; f < texts.size(); ++f) {
    entries[f].fileNumber = numberOfFile(texts.paths()[f]);
    entries[f].file = f;
  }
  const TrackTimeline line = arrangeTimes(entries, options);
  warnings.insert(warnings.end(), texts.notes().begin(), texts.notes().end());
  if (line.framePeriodMissing)
    warnings.push_back(texts.paths()[0] + ": the time is " +
                       (line.source == TrackTimeline::Source::FileNumber ? "the number in the file's name"
                                                                         : "the order of the files") +
                       " times " + framePeriodWords(0) + ".");
  return line;
}

bool FileSnapshots::open(std::vector<std::string> files, const Progress& progress, bool) {
  *this = FileSnapshots(format);
  try {
    texts = TrackTexts(std::move(files));
    bool anyRow = false;
    for (std::size_t f = 0; f < texts.size(); ++f) {
      const auto part = [&](double fraction) {
        return goOn(progress, (double(f) + fraction) / double(texts.size()));
      };
      const auto source = texts.first(f, part);
      if (!source || !part(1.0)) {
        *this = FileSnapshots(format);
        return false;
      }
      try {
        layouts.push_back(format.layout(source->text().substr(0, trackHeadBytes)));
      } catch (const std::runtime_error& e) {
        throw std::runtime_error(texts.paths()[f] + ", " + e.what());
      }
      const TrackTableLayout& layout = layouts.back();
      anyRow = anyRow || layout.declaredRows >= 0 || layout.rows < source->text().size();
    }
    if (!anyRow)
      throw std::runtime_error(
          texts.paths()[0] +
          ", line 1: there is no row of numbers after the header. Export the tracks again.");
    return true;
  } catch (...) {
    *this = FileSnapshots(format);
    throw;
  }
}

const TrackColumnPlan& FileSnapshots::columns(std::size_t snapshot, LengthUnit unit) const {
  const auto found = plans.find({snapshot, unit});
  if (found != plans.end()) return found->second;
  return plans.emplace(std::make_pair(snapshot, unit), outputPlan(layouts.at(snapshot), unit)).first->second;
}

TrackTimeline FileSnapshots::timeline(const TrackTimeOptions& options,
                                      std::vector<std::string>& warnings) const {
  return timelineOfFiles(texts, options, warnings);
}

bool FileSnapshots::read(std::size_t file, const TrackUnits& units, TrackSnapshot& particles,
                         std::vector<std::string>& warnings, const Progress& progress,
                         Content content) const {
  using Fault = TrackRowsResult::Fault;
  particles = {};
  texts.checkUnchanged(file);
  const auto source = texts.mapped(file, progress);
  if (!source) return false;
  const TrackTableLayout& layout = layouts.at(file);
  const TrackColumnPlan& plan = columns(file, units.length);
  if (!plan.error.empty()) throw std::runtime_error(texts.paths()[file] + ", line 1: " + plan.error + ".");
  const std::string_view rows = source->text().substr(layout.rows);
  source->willNeed(layout.rows, source->text().size());
  const TrackRowsResult r = readTrackRows(rows, plan, content == Content::TrackIds, particles, progress);
  source->release(layout.rows, source->text().size());
  if (r.aborted) return false;
  if (r.fault == Fault::TooFew && rows.find('\n', r.offset) == rows.npos)
    throw std::runtime_error(texts.at(file, layout.rows + r.offset) +
                             "the file ends in the middle of a row, after " + std::to_string(r.values) +
                             " of " + std::to_string(plan.columns.size()) +
                             " values. This snapshot is not whole: copy or export the file again. The other "
                             "snapshots can be read.");
  if (r.fault != Fault::None)
    throw std::runtime_error(texts.at(file, layout.rows + r.offset) +
                             rowFault(r, rows, r.offset, plan, layout.expected));

  for (const std::string& w : layout.warnings) warnings.push_back(texts.paths()[0] + ": " + w);
  for (const std::string& w : plan.warnings) warnings.push_back(texts.paths()[0] + ": " + w + ".");
  if (layout.declaredRows >= 0 && layout.declaredRows != r.rows)
    warnings.push_back(texts.paths()[file] + ", line 1: announces " + std::to_string(layout.declaredRows) +
                       " rows, but has " + std::to_string(r.rows) +
                       "; all that are there are read. If the export was interrupted, export again.");
  if (r.notFinite > 0)
    warnings.push_back(texts.at(file, layout.rows + r.firstNotFinite) +
                       notFiniteWarning(r.notFinite, r.rows, "this snapshot"));
  if (const auto duplicates = duplicateIds(particles))
    warnings.push_back(texts.paths()[file] + ", line 1: " + *duplicates);
  return true;
}

} // namespace rimflow
