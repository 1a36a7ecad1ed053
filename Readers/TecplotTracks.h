#pragma once
#include "MappedFile.h"
#include "Progress.h"
#include "TecplotHeader.h"
#include "TrackColumns.h"
#include "TrackSnapshot.h"
#include "TrackTimeline.h"

#include <cstdint>
#include <limits>
#include <map>
#include <memory>
#include <stdexcept>
#include <string>
#include <vector>

namespace rimflow {

/// One ZONE, which is one snapshot: where it stands and what its header says.
struct TecplotZone {
  std::size_t file = 0;                                   ///< in TecplotTracks::files()
  std::size_t header = 0;                                 ///< byte of the word ZONE
  std::size_t begin = 0, end = 0;                         ///< bytes of the rows
  std::size_t layout = 0;                                 ///< which VARIABLES list
  std::int64_t declaredRows = -1;                         ///< I=; -1 when missing
  double time = std::numeric_limits<double>::quiet_NaN(); ///< SOLUTIONTIME, s
  std::string title;
  std::string problem; ///< why this zone cannot be read; empty when all is well
  std::size_t problemOffset = 0;
};

/// The files are no longer those that were indexed: open() again.
struct TrackIndexOutdated : std::runtime_error {
  using std::runtime_error::runtime_error;
};

/// Shake-The-Box tracks in Tecplot ASCII as DaVis exports them: one file with a zone per snapshot, one file
/// per snapshot, or any mix, plain or gzip-compressed. The files are indexed once; then any snapshot can be
/// read by itself, in any order, and only its own text and arrays are in memory.
///
/// Errors (std::runtime_error, with file, line, what was found, what was expected and what to do):
///  - open(): no such file, empty, binary, another format, no VARIABLES, a grid export (J or K > 1,
///  DATAPACKING=BLOCK,
///    finite elements), a line of more than 1 MiB, gzip data cut or damaged, no room to unpack;
///  - read(), for this snapshot only: a row with too few or too many values, a value that is no number, an id
///  that is
///    no whole number, the file ending in the middle of a row, a damaged zone header, no x, y, z, an unknown
///    unit.
/// Warnings, the data being usable: I= differs from the rows found (the rows decide); particles with a value
/// that is not finite (left out and counted); an id twice in one snapshot (both particles kept); no velocity,
/// no trackID, an incomplete vector; times missing, all equal, negative, or the same twice (the later one
/// given is kept).
class TecplotTracks {
public:
  /// True when the content is that of a track table which open() reads (or of a DaVis .set, for which open()
  /// says how to export it). Looks at the first 64 KiB. Never throws.
  static bool canRead(const std::string& path);

  /// Finds all zones; the files are put in natural order (B2 before B10). `trustRowCounts`: where I= is right
  /// for the first zone, jump to the place where the next zone must begin and look for it there, instead of
  /// looking at all lines; read() finds out if that was wrong. Returns false when aborted (nothing is open
  /// then).
  bool open(std::vector<std::string> files, const Progress& progress = {}, bool trustRowCounts = true);
  void close();
  /// False when a file was changed, replaced or removed since open(), or these are other files.
  bool isOpen(std::vector<std::string> files) const;

  const std::vector<std::string>& files() const { return paths; }
  const std::vector<TecplotZone>& zones() const { return index; }
  /// The columns as read() will use them.
  const TrackColumnPlan& columns(std::size_t zone, LengthUnit unit) const;
  /// Snapshots in the order of time; what the user should know about it is added to `warnings`.
  TrackTimeline timeline(const TrackTimeOptions& options, std::vector<std::string>& warnings) const;

  enum class Content { All, TrackIds };
  /// Reads one snapshot (or its trackIds only). Returns false when aborted. Throws std::runtime_error as
  /// above and TrackIndexOutdated; `snapshot` is empty then. `warnings` are added.
  bool read(std::size_t zone, LengthUnit unit, TrackSnapshot& snapshot, std::vector<std::string>& warnings,
            const Progress& progress = {}, Content content = Content::All) const;

  /// The line of a byte, from 1.
  std::size_t lineOf(std::size_t file, std::size_t offset) const;

private:
  struct Scan;
  void indexFile(std::size_t file, const MappedFile& source, Scan& scan);
  std::size_t layoutOf(const std::vector<std::string>& variables, std::size_t file);
  void checkZone(const TecplotZoneHeader& header, std::size_t file, std::size_t offset) const;
  std::shared_ptr<MappedFile> mapped(std::size_t file, const Progress& progress = {}) const;
  std::string at(std::size_t file, std::size_t offset) const;

  std::vector<std::string> paths;
  std::vector<std::string> notes; ///< warnings about the files as such
  std::vector<FileStamp> stamps;
  std::vector<std::vector<std::string>> layouts;
  std::vector<std::size_t> layoutFile; ///< the first file with this layout
  std::vector<TecplotZone> index;

  mutable std::map<std::size_t, std::shared_ptr<MappedFile>> open_;
  mutable std::vector<std::size_t> lastUsed; ///< files in open_, the most recent one last
  mutable std::vector<std::map<std::size_t, std::size_t>>
      lines; ///< known line numbers, by byte, for each file
  mutable std::map<std::pair<std::size_t, LengthUnit>, TrackColumnPlan> plans;
};

} // namespace rimflow
