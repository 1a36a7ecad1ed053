#pragma once
#include "IdTable.h"
#include "TrackSelection.h"
#include "TrackSnapshot.h"

#include <cstdint>
#include <memory>
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

/// Builds pathlines from snapshots that are given in the order of time. A track that is not there in a
/// snapshot is broken: what follows is a line of its own. Tracks that ended before the last snapshot are
/// kept. Particles with a negative trackId belong to no line.
class PathlineBuilder {
public:
  explicit PathlineBuilder(const TrackSelection& selection) : selection(selection) {}
  /// Throws std::runtime_error when the particles have no trackId. The snapshot is kept until finish() where
  /// most of its particles are needed, otherwise these are copied.
  void add(std::shared_ptr<const TrackSnapshot> snapshot, double time);
  Pathlines finish();

private:
  struct Run {
    std::int64_t id;
    std::int32_t first, last; // snapshots
  };
  TrackSelection selection;
  IdTable latest;        // the latest run of each track
  std::vector<Run> runs; // in the order of their first points
  struct Part {
    std::shared_ptr<const TrackSnapshot> particles;
    std::vector<std::uint32_t> rows; // of the particles that belong to a run
    std::vector<std::int32_t> run;   // of each of these rows
    double time;
  };
  std::vector<Part> parts;
  std::size_t duplicates = 0;
};

} // namespace rimflow
