#pragma once
#include "Progress.h"
#include "TrackColumns.h"
#include "TrackSnapshot.h"
#include "TrackTimeline.h"

#include <cstddef>
#include <stdexcept>
#include <string>
#include <vector>

namespace rimflow {

/// The files are no longer those that were indexed: open() again.
struct TrackIndexOutdated : std::runtime_error {
  using std::runtime_error::runtime_error;
};

/// What the numbers in a file mean, as far as the file does not say.
struct TrackUnits {
  TrackUnits(LengthUnit length = LengthUnit::Auto, double framePeriod = 0)
      : length(length), framePeriod(framePeriod) {}
  bool operator==(const TrackUnits& o) const { return length == o.length && framePeriod == o.framePeriod; }
  bool operator!=(const TrackUnits& o) const { return !(*this == o); }

  LengthUnit length;
  double framePeriod; ///< s, >= 0; 0: not known. Only velocities per frame need it.
};

/// Track files of one format, opened together: snapshots in the order in which they were found, each of which
/// can be read by itself. Particles come in SI units whatever the format.
///
/// Errors are std::runtime_error with file, line, what was found, what was expected and what to do; those of
/// read() concern this snapshot only. Warnings: the data can be used.
class TrackFile {
public:
  virtual ~TrackFile() = default;

  /// Finds all snapshots. Returns false when aborted (nothing is open then). `trustRowCounts` false: look at
  /// every line, whatever the headers announce.
  virtual bool open(std::vector<std::string> files, const Progress& progress = {},
                    bool trustRowCounts = true) = 0;
  /// False when a file was changed, replaced or removed since open(), or these are other files.
  virtual bool isOpen(std::vector<std::string> files) const = 0;

  virtual std::size_t snapshotCount() const = 0;
  /// The file in which a snapshot is, or begins.
  virtual const std::string& fileOf(std::size_t snapshot) const = 0;
  /// The columns as read() will use them.
  virtual const TrackColumnPlan& columns(std::size_t snapshot, LengthUnit unit) const = 0;
  /// Snapshots in the order of time; what the user should know about it is added to `warnings`.
  virtual TrackTimeline timeline(const TrackTimeOptions& options,
                                 std::vector<std::string>& warnings) const = 0;

  enum class Content { All, TrackIds };
  /// Reads one snapshot (or its trackIds only). Returns false when aborted. Throws std::runtime_error and
  /// TrackIndexOutdated; `snapshot` is empty then. `warnings` are added.
  virtual bool read(std::size_t snapshot, const TrackUnits& units, TrackSnapshot& particles,
                    std::vector<std::string>& warnings, const Progress& progress = {},
                    Content content = Content::All) const = 0;
};

} // namespace rimflow
