#pragma once
#include "ParticleStore.h"
#include "TrackFile.h"
#include "TrackTableLayout.h"
#include "TrackTexts.h"

#include <map>
#include <string>
#include <string_view>
#include <vector>

namespace rimflow {

/// OpenPTV's `ptv_is.N`, one file per frame N: a line with the number of particles, then rows
/// `prev next x y z` in mm, where prev (next) is the row, from 0, of the same particle in the frame before
/// (after), or negative. open() reads all files and numbers the tracks through. A frame that is missing ends
/// all tracks.
class OpenPTVTracks : public TrackFile {
public:
  bool open(std::vector<std::string> files, const Progress& progress = {},
            bool trustRowCounts = true) override;
  bool isOpen(std::vector<std::string> files) const override { return texts.areStill(std::move(files)); }
  std::size_t snapshotCount() const override { return counts.size(); }
  const std::string& fileOf(std::size_t snapshot) const override { return texts.paths().at(snapshot); }
  const TrackColumnPlan& columns(std::size_t snapshot, LengthUnit unit) const override;
  TrackTimeline timeline(const TrackTimeOptions& options, std::vector<std::string>& warnings) const override;
  bool read(std::size_t snapshot, const TrackUnits& units, TrackSnapshot& particles,
            std::vector<std::string>& warnings, const Progress& progress = {},
            Content content = Content::All) const override;

private:
  struct Links { // of the frame before
    std::vector<std::int64_t> id, next;
    std::int64_t number = -1;
    bool there = false;
  };
  void readFile(std::size_t file, std::string_view text, Links& before);

  TrackTexts texts;
  std::vector<std::size_t> counts; ///< particles of each snapshot
  std::vector<std::string> notes;
  std::int64_t tracks = 0;
  ParticleStore store;
  mutable std::map<LengthUnit, TrackColumnPlan> plans;
};

/// `ptv_is.N`, and `rt_is.N`: a line with the number of particles, then rows `index x y z` and what the
/// cameras saw; positions only.
bool isOpenPTVLinks(std::string_view head);
bool isOpenPTVPositions(std::string_view head);
/// A frame without particles, which may belong to either of them.
bool isEmptyOpenPTVFrame(std::string_view head);
TrackTableFormat openPTVPositionsFormat();

} // namespace rimflow
