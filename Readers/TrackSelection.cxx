#include "TrackSelection.h"

#include <algorithm>
#include <functional>
#include <limits>
#include <stdexcept>

namespace rimflow {

void TrackLengths::add(const std::vector<std::int64_t>& trackIds) {
  constexpr std::size_t mostPages = (std::size_t(256) << 20) / (2 * pageSize + 64);
  const std::vector<std::int64_t>* ids = &trackIds;
  std::vector<std::int64_t> sorted;
  if (std::adjacent_find(ids->begin(), ids->end(), std::greater_equal<>()) != ids->end()) {
    sorted = trackIds;
    std::sort(sorted.begin(), sorted.end());
    sorted.erase(std::unique(sorted.begin(), sorted.end()), sorted.end());
    ids = &sorted;
  }
  Page* page = nullptr;
  std::int64_t pageNumber = -1;
  for (const std::int64_t id : *ids) {
    if (id < 0) continue;
    if (id / pageSize != pageNumber) {
      pageNumber = id / pageSize;
      page = &pages[pageNumber];
      if (page->empty()) page->resize(pageSize);
      if (pages.size() > mostPages)
        throw std::runtime_error(
            "The track ids are too many and too scattered to count the tracks' lengths. Set "
            "MinimumTrackLength to 1, or open fewer files.");
    }
    std::uint16_t& count = (*page)[std::size_t(id % pageSize)];
    if (count < std::numeric_limits<std::uint16_t>::max()) ++count;
  }
}

int TrackLengths::of(std::int64_t trackId) const {
  if (trackId < 0) return 0;
  const auto page = pages.find(trackId / pageSize);
  return page == pages.end() ? 0 : page->second[std::size_t(trackId % pageSize)];
}

std::vector<std::uint32_t> selectedRows(const TrackSnapshot& snapshot, const TrackSelection& selection) {
  std::vector<std::uint32_t> rows;
  const bool hasIds = !snapshot.trackId.empty();
  for (std::size_t r = 0; r < snapshot.size(); ++r)
    if (selection.keeps(hasIds ? snapshot.trackId[r] : -1, r)) rows.push_back(std::uint32_t(r));
  return rows;
}

namespace {
template <class T>
std::vector<T> take(const std::vector<T>& values, const std::vector<std::uint32_t>& rows, std::size_t width) {
  std::vector<T> taken;
  if (values.empty()) return taken;
  taken.reserve(rows.size() * width);
  for (const std::uint32_t r : rows)
    for (std::size_t c = 0; c < width; ++c) taken.push_back(values[r * width + c]);
  return taken;
}
} // namespace

TrackSnapshot takeRows(const TrackSnapshot& s, const std::vector<std::uint32_t>& rows) {
  TrackSnapshot taken{take(s.position, rows, 3),  take(s.velocity, rows, 3), take(s.acceleration, rows, 3),
                      take(s.intensity, rows, 1), take(s.trackId, rows, 1),  {}};
  for (const TrackColumn& c : s.further) taken.further.push_back({c.name, take(c.values, rows, 1)});
  return taken;
}

} // namespace rimflow
