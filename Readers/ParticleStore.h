#pragma once
#include "TemporaryFile.h"
#include "TrackSnapshot.h"

#include <cstddef>
#include <memory>
#include <vector>

namespace rimflow {

/// Particles put away in segments, of which any rows can be had back. Up to a limit they stay in memory,
/// beyond that they go to a temporary file: 20 bytes for a particle with position and trackId alone.
class ParticleStore {
public:
  explicit ParticleStore(std::size_t memoryLimit = std::size_t(1) << 30) : memoryLimit(memoryLimit) {}

  /// All segments have the same arrays. Returns its number. Throws std::runtime_error when the disk is full.
  std::size_t add(TrackSnapshot&& particles);
  /// Appends rows begin to begin+count of a segment to `to`; `idsOnly`: their trackId alone.
  void append(std::size_t segment, std::size_t begin, std::size_t count, bool idsOnly,
              TrackSnapshot& to) const;
  std::size_t bytesOnDisk() const { return file ? file->size() : 0; }

private:
  struct Segment {
    TrackSnapshot particles; ///< empty when they are on disk: there, one array stands after the other
    std::size_t rows = 0, at = 0;
    bool onDisk = false;
  };
  std::size_t memoryLimit, held = 0;
  std::vector<Segment> segments;
  TrackSnapshot shape; ///< arrays of a segment, without rows but with one value each where they exist
  std::shared_ptr<TemporaryFile> file;
};

} // namespace rimflow
