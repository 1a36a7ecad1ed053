#include "TrackStatistics.h"

#include <stdexcept>

namespace rimflow {

void TrackStatistics::add(std::int32_t snapshot, const std::vector<std::int64_t>& trackIds) {
  constexpr std::size_t mostPages = (std::size_t(512) << 20) / (pageSize * sizeof(TrackSpan) + 64);
  Page* page = nullptr;
  std::int64_t pageNumber = -1;
  for (const std::int64_t id : trackIds) {
    if (id < 0) continue;
    if (id / pageSize != pageNumber) {
      pageNumber = id / pageSize;
      page = &pages[pageNumber];
      if (page->empty()) page->resize(pageSize);
      if (pages.size() > mostPages)
        throw std::runtime_error(
            "The track ids are too many and too scattered to find each track's length. Set "
            "MinimumTrackLength to 1 and TrackStatistics off, or open fewer files.");
    }
    TrackSpan& span = (*page)[std::size_t(id % pageSize)];
    if (span.last == snapshot) continue;
    if (span.first < 0) span.first = snapshot;
    span.last = snapshot;
    ++span.length;
  }
}

TrackSpan TrackStatistics::of(std::int64_t trackId) const {
  if (trackId < 0) return {};
  const auto page = pages.find(trackId / pageSize);
  return page == pages.end() ? TrackSpan() : page->second[std::size_t(trackId % pageSize)];
}

} // namespace rimflow
