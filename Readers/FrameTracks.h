#pragma once
#include "IdTable.h"
#include "ParticleStore.h"
#include "TrackFile.h"
#include "TrackTableLayout.h"
#include "TrackTexts.h"

#include <map>
#include <string>
#include <vector>

namespace rimflow {

/// Tables with the frame number (or the time) of each row in a column, such as all those that are written
/// track by track: the rows stand in any order, and those of one snapshot all over the files. open() reads
/// the files once, in blocks, sorts the rows of each block by frame and puts them away in binary (in memory
/// up to 1 GiB, beyond that in a temporary file); after that the text is not needed any more.
///
/// A damaged row is an error of open(), because it may belong to any snapshot; a file that ends in the middle
/// of a row is read up to there, with a warning. Rows that are not finite are left out and counted.
class FrameTracks : public TrackFile {
public:
  struct Options {
    std::size_t blockBytes = std::size_t(16) << 20;
    std::size_t memoryLimit = std::size_t(1) << 30;
  };
  explicit FrameTracks(TrackTableFormat format) : FrameTracks(std::move(format), Options()) {}
  FrameTracks(TrackTableFormat format, const Options& options);

  bool open(std::vector<std::string> files, const Progress& progress = {},
            bool trustRowCounts = true) override;
  bool isOpen(std::vector<std::string> files) const override { return texts.areStill(std::move(files)); }
  std::size_t snapshotCount() const override { return frames.size(); }
  const std::string& fileOf(std::size_t snapshot) const override;
  const TrackColumnPlan& columns(std::size_t snapshot, LengthUnit unit) const override;
  TrackTimeline timeline(const TrackTimeOptions& options, std::vector<std::string>& warnings) const override;
  bool read(std::size_t snapshot, const TrackUnits& units, TrackSnapshot& particles,
            std::vector<std::string>& warnings, const Progress& progress = {},
            Content content = Content::All) const override;
  std::size_t bytesOnDisk() const { return store.bytesOnDisk(); }

private:
  struct Run { // rows of a snapshot that stand together
    std::size_t file, segment, begin, count;
  };
  struct Frame {
    double number; // as in the file
    std::vector<Run> runs;
  };
  struct FileScan;
  bool readFile(std::size_t file, const Progress& progress);
  void putAway(std::size_t file, TrackSnapshot&& rows);
  std::size_t frameOf(double number);
  std::string nameOf(std::size_t snapshot) const;

  TrackTableFormat format;
  Options options;
  TrackTexts texts;
  std::vector<TrackTableLayout> layouts; ///< of each file
  std::vector<std::string> notes;
  std::vector<Frame> frames;
  IdTable frameNumbers;
  std::int64_t firstId = 0, lastId = -1; ///< of the file that is read (-1: none is left), the last so far
  ParticleStore store;
  mutable std::map<LengthUnit, TrackColumnPlan> plans;
};

} // namespace rimflow
