#pragma once
#include "Progress.h"
#include "TecplotHeader.h"
#include "TrackFile.h"
#include "TrackTexts.h"

#include <cstdint>
#include <limits>
#include <map>
#include <string>
#include <vector>

namespace rimflow {

/// One ZONE, which is one snapshot: where it stands and what its header says.
struct TecplotZone {
  std::size_t file = 0;                                   ///< its number
  std::size_t header = 0;                                 ///< byte of the word ZONE
  std::size_t begin = 0, end = 0;                         ///< bytes of the rows
  std::size_t layout = 0;                                 ///< which VARIABLES list
  std::int64_t declaredRows = -1;                         ///< I=; -1 when missing
  double time = std::numeric_limits<double>::quiet_NaN(); ///< SOLUTIONTIME, s
  std::string title;
  std::string problem; ///< why this zone cannot be read; empty when all is well
  std::size_t problemOffset = 0;
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
class TecplotTracks : public TrackFile {
public:
  /// True when the content is that of a track table which open() reads (or of a DaVis .set, for which open()
  /// says how to export it). Looks at the first 64 KiB. Never throws.
  static bool canRead(const std::string& path);

  /// Finds all zones; the files are put in natural order (B2 before B10). `trustRowCounts`: where I= is right
  /// for the first zone, jump to the place where the next zone must begin and look for it there, instead of
  /// looking at all lines; read() finds out if that was wrong.
  bool open(std::vector<std::string> files, const Progress& progress = {},
            bool trustRowCounts = true) override;
  void close();
  bool isOpen(std::vector<std::string> files) const override;

  const std::vector<TecplotZone>& zones() const { return index; }
  std::size_t snapshotCount() const override { return index.size(); }
  const std::string& fileOf(std::size_t zone) const override { return texts.paths()[index.at(zone).file]; }
  const TrackColumnPlan& columns(std::size_t zone, LengthUnit unit) const override;
  TrackTimeline timeline(const TrackTimeOptions& options, std::vector<std::string>& warnings) const override;
  bool read(std::size_t zone, const TrackUnits& units, TrackSnapshot& snapshot,
            std::vector<std::string>& warnings, const Progress& progress = {},
            Content content = Content::All) const override;

  /// The line of a byte, from 1.
  std::size_t lineOf(std::size_t file, std::size_t offset) const { return texts.lineOf(file, offset); }

private:
  struct Scan;
  void indexFile(std::size_t file, const MappedFile& source, Scan& scan);
  std::size_t layoutOf(const std::vector<std::string>& variables, std::size_t file);
  void checkZone(const TecplotZoneHeader& header, std::size_t file, std::size_t offset) const;
  std::string at(std::size_t file, std::size_t offset) const { return texts.at(file, offset); }

  TrackTexts texts;
  std::vector<std::vector<std::string>> layouts;
  std::vector<std::size_t> layoutFile; ///< the first file with this layout
  std::vector<TecplotZone> index;
  mutable std::map<std::pair<std::size_t, LengthUnit>, TrackColumnPlan> plans;
};

} // namespace rimflow
