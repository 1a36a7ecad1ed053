#pragma once
#include "TrackSnapshot.h"

#include <cstddef>
#include <list>
#include <memory>

namespace rimflow {

/// The snapshots that were read last, up to a limit of memory. What is in use elsewhere stays alive there.
class SnapshotCache {
public:
  using Pointer = std::shared_ptr<const TrackSnapshot>;

  void setLimit(std::size_t bytes) {
    limit = bytes;
    shrink(limit);
  }
  void clear() {
    entries.clear();
    held = 0;
  }
  std::size_t bytes() const { return held; }

  /// Null when it is not there.
  Pointer find(std::size_t key) {
    for (auto e = entries.begin(); e != entries.end(); ++e)
      if (e->key == key) {
        entries.splice(entries.begin(), entries, e);
        return e->snapshot;
      }
    return nullptr;
  }
  void add(std::size_t key, Pointer snapshot) {
    const std::size_t size = snapshot->bytes();
    if (size > limit) return;
    shrink(limit - size);
    entries.push_front({key, std::move(snapshot)});
    held += size;
  }

private:
  struct Entry {
    std::size_t key;
    Pointer snapshot;
  };
  void shrink(std::size_t to) {
    while (held > to) {
      held -= entries.back().snapshot->bytes();
      entries.pop_back();
    }
  }
  std::list<Entry> entries; // the latest first
  std::size_t limit = std::size_t(256) << 20, held = 0;
};

} // namespace rimflow
