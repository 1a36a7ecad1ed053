#pragma once
#include <cstddef>
#include <cstdint>
#include <limits>
#include <string>
#include <vector>

namespace rimflow {

/// No time or frame number is larger than this, s: sums and products of those that are not stay finite.
constexpr double largestTime = 1e30;

/// What a file says about the time of one snapshot.
struct TrackTimeEntry {
  double time = std::numeric_limits<double>::quiet_NaN(); ///< s; NaN when the file has none
  std::int64_t titleNumber = -1;                          ///< 12 of "Snapshot 0012"; -1 when there is none
  std::int64_t fileNumber = -1;                           ///< 3 of B00003.dat; -1 when there is none
  std::size_t file = 0;                                   ///< which file it stands in
};

struct TrackTimeOptions {
  double framePeriod = 0;   ///< s, >= 0, where the file gives no time; 0: not known, 1 s is taken
  double shift = 0;         ///< s, added to all times
  bool shiftToZero = false; ///< make the first time 0 (before the shift)
};

struct TrackTimeline {
  std::vector<double> times;        ///< s, strictly increasing
  std::vector<std::size_t> entries; ///< the snapshot at each time

  enum class Source { File, PartlyFile, TitleNumber, FileNumber, Order };
  Source source = Source::File;
  bool allTimesEqual = false;                    ///< the file's times say nothing and were not used
  bool framePeriodMissing = false;               ///< 1 s was taken
  std::size_t withoutTime = 0;                   ///< entries whose time had to be found
  std::vector<std::size_t> replaced, replacedBy; ///< entries left out, because a later one has the same time
};

/// Puts snapshots in the order of time.
///
/// Where every entry has a time, it is kept as it is. Where none has one (or all have the same), the time is
/// a number times framePeriod: the titles' number if all have one and no two are equal; else the files'
/// number if every file holds one snapshot and no two are equal; else the order, from 0. Where only some have
/// a time, the others are placed between them by these numbers (beyond them by framePeriod, or by the nearest
/// two times). Of snapshots with the same time the last one given is kept.
TrackTimeline arrangeTimes(const std::vector<TrackTimeEntry>& entries, const TrackTimeOptions& options);

/// The integer at the end of a title, 12 for "Snapshot 0012"; -1 when there is none (also for "t = 0.12").
std::int64_t numberAtEnd(const std::string& title);
/// The last integer in a file's name without folder and extensions, 3 for "run7/B00003.dat"; -1 for none.
std::int64_t numberOfFile(const std::string& path);
/// B2.dat before B10.dat.
bool naturallyBefore(const std::string& a, const std::string& b);

} // namespace rimflow
