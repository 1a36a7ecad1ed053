#pragma once
#include "SnapshotCache.h"
#include "TrackDerivatives.h"
#include "TrackFile.h"
#include "TrackNoise.h"
#include "TrackPathlines.h"
#include "TrackSelection.h"
#include "TrackStatistics.h"

#include <array>
#include <cstddef>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <vector>

namespace rimflow {

/// The progress callback said stop.
struct TrackReadAborted {};

/// Track files of any format as one series in time. Every snapshot can be had at any time, with what the
/// files do not hold: velocities and accelerations from the positions along each track, the level of the
/// noise, and the span of each track. Snapshots are numbered from 0 in the order of time.
///
/// All functions that read throw what TrackFile throws, and TrackReadAborted. Snapshots near the one that is
/// asked for and cannot be read count as absent, with a warning.
class TrackSeries {
public:
  enum class Estimate {
    Missing, ///< velocities and accelerations that the files lack
    Always,  ///< in place of the files' own
    Never
  };
  struct Settings {
    TrackUnits units;
    TrackTimeOptions time;
    std::optional<std::array<double, 2>> timeRange; ///< s; only these snapshots are shown
    Estimate estimate = Estimate::Missing;
    TrackDerivativeOptions polynomial;
    std::size_t cacheBytes = std::size_t(256) << 20;
  };
  using Snapshot = SnapshotCache::Pointer;

  void open(const std::vector<std::string>& files, const Progress& progress = {}, bool trustRowCounts = true);
  bool isOpen(const std::vector<std::string>& files) const { return tracks && tracks->isOpen(files); }
  /// Puts the snapshots in order. To be called after open(), and when settings have changed. Throws
  /// std::runtime_error when no snapshot lies in the time range.
  void use(const Settings& settings);

  /// Of all snapshots, in s, strictly increasing.
  const std::vector<double>& times() const { return line.times; }
  /// The snapshots in the time range: first to last, both included.
  std::size_t first() const { return shown[0]; }
  std::size_t last() const { return shown[1]; }
  /// The one in the time range that is nearest to a time.
  std::size_t nearest(double time) const;
  const std::string& fileOf(std::size_t snapshot) const { return tracks->fileOf(line.entries[snapshot]); }

  /// What particles() has.
  TrackColumnPlan columns(std::size_t snapshot) const;
  Snapshot particles(std::size_t snapshot, const Progress& progress = {});
  /// Lines along the tracks that are selected, over snapshots `from` to `to`, both included. Only the lines
  /// are held in memory, and the cache.
  Pathlines pathlines(std::size_t from, std::size_t to, const TrackSelection& selection,
                      const Progress& progress = {});

  /// The span of each track in the whole series: goes through all files, the first time.
  const TrackStatistics& statistics(const Progress& progress = {});
  /// Adds `TrackLength` (snapshots), `TrackStart`, `TrackEnd` and `TrackAge` (s) of each particle; NaN
  /// (length 1) for those without a track. `times`: of each particle; or one for all of them.
  void addStatistics(TrackSnapshot& particles, const std::vector<double>& times) const;
  /// From consecutive snapshots in the middle of the series, so that it is the same whatever is looked at.
  TrackNoise noise(const Progress& progress = {});

  /// What the user should know; each is given once for a set of files.
  std::vector<std::string> takeWarnings();

private:
  bool estimated(std::size_t snapshot) const;
  Snapshot asInFile(std::size_t snapshot, const Progress& progress);
  Snapshot particlesIfSound(std::size_t snapshot, const Progress& progress);
  std::vector<std::int64_t> idsOf(std::size_t snapshot, const Progress& progress);
  std::optional<Pathlines> pathlines(std::size_t from, std::size_t to, const TrackSelection& selection,
                                     bool idsAlone, const Progress& progress);
  TrackNoise noiseAround(std::size_t middle, const Progress& progress);
  TrackWindow around(std::size_t snapshot, std::size_t reach, const Progress& progress);
  void warn(const std::string& warning);

  Settings settings;
  std::unique_ptr<TrackFile> tracks;
  TrackTimeline line;
  std::array<std::size_t, 2> shown{};
  SnapshotCache cache; // as in the files, and with velocities estimated
  std::optional<TrackStatistics> spans;
  std::optional<TrackNoise> noiseFound;
  std::set<std::string> told;
  std::vector<std::string> warnings;
};

} // namespace rimflow
