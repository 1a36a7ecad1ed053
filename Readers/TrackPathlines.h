#pragma once
#include "IdTable.h"
#include "TrackSelection.h"
#include "TrackSnapshot.h"

#include <cstdint>
#include <string>
#include <vector>

namespace rimflow {

/// Points along tracks: line l is points offsets[l] to offsets[l+1], in the order of time. The first
/// `singles` lines have one point only; all others have at least two.
struct Pathlines {
  TrackSnapshot points;     ///< with the arrays that all snapshots have
  std::vector<double> time; ///< s, of each point
  std::vector<std::int64_t> offsets;
  std::vector<std::int64_t> trackId; ///< of each line
  std::size_t singles = 0;
  std::size_t duplicates = 0; ///< particles left out, because their track had one in that snapshot already
  std::vector<std::string> dropped; ///< arrays that only some of the snapshots have
};

/// Builds pathlines in two passes over the snapshots, which come in the order of time in both: the first one
/// looks at the ids alone, so that the second can put every particle into its place. Only the lines
/// themselves, 8 bytes for each of their points, and one snapshot are in memory. A track that is not there
/// in a snapshot is broken: what follows is a line of its own. Tracks that ended before the last snapshot are
/// kept. Particles with a negative trackId, and snapshots without trackIds, belong to no line.
class PathlineBuilder {
public:
  explicit PathlineBuilder(const TrackSelection& selection) : selection(selection) {}
  /// First pass: the trackIds of all particles of the next snapshot.
  void addIds(const std::vector<std::int64_t>& trackIds, double time);
  /// Second pass, one call for each one of the first. Returns false when the particles are not those whose
  /// ids were given (particles that are not finite have an id, but are left out when they are read): then
  /// begin again, with the ids of what will be given.
  [[nodiscard]] bool addParticles(const TrackSnapshot& snapshot);
  /// The lines, once all snapshots have been given twice.
  Pathlines finish();

private:
  struct Run {
    std::int64_t id;
    std::int32_t first, last; // snapshots
  };
  struct Part {
    std::vector<std::uint32_t> rows; // of the particles that belong to a run
    std::vector<std::int32_t> run;   // of each of these rows
    double time;
    std::size_t particles; // with an id, kept or not
  };
  void layOut();
  TrackSelection selection;
  IdTable latest;        // the latest run of each track
  std::vector<Run> runs; // in the order of their first points
  std::vector<Part> parts;
  std::vector<std::int64_t> begin; // the first point of each run
  std::size_t placed = 0;          // parts whose particles are in their places
  Pathlines lines;
};

} // namespace rimflow
