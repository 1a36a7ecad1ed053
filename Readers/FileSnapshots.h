#pragma once
#include "TrackFile.h"
#include "TrackTableLayout.h"
#include "TrackTexts.h"

#include <map>
#include <string>
#include <utility>
#include <vector>

namespace rimflow {

/// Tables of which every file is one snapshot; its number is the last one in the file's name. Only the heads
/// are looked at by open(); a damaged row is an error of read(), for this snapshot.
class FileSnapshots : public TrackFile {
public:
  explicit FileSnapshots(TrackTableFormat format) : format(std::move(format)) {}

  bool open(std::vector<std::string> files, const Progress& progress = {},
            bool trustRowCounts = true) override;
  bool isOpen(std::vector<std::string> files) const override { return texts.areStill(std::move(files)); }
  std::size_t snapshotCount() const override { return texts.size(); }
  const std::string& fileOf(std::size_t snapshot) const override { return texts.paths().at(snapshot); }
  const TrackColumnPlan& columns(std::size_t snapshot, LengthUnit unit) const override;
  TrackTimeline timeline(const TrackTimeOptions& options, std::vector<std::string>& warnings) const override;
  bool read(std::size_t snapshot, const TrackUnits& units, TrackSnapshot& particles,
            std::vector<std::string>& warnings, const Progress& progress = {},
            Content content = Content::All) const override;

private:
  TrackTableFormat format;
  TrackTexts texts;
  std::vector<TrackTableLayout> layouts;
  mutable std::map<std::pair<std::size_t, LengthUnit>, TrackColumnPlan> plans;
};

/// Times of files that are one snapshot each, from the numbers in their names.
TrackTimeline timelineOfFiles(const TrackTexts& texts, const TrackTimeOptions& options,
                              std::vector<std::string>& warnings);

} // namespace rimflow
