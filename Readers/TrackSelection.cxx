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
template <std::size_t width, class T>
std::vector<T> take(const std::vector<T>& values, const std::vector<std::uint32_t>& rows) {
  if (values.size() == rows.size() * width) return values; // all of them
  std::vector<T> taken(values.empty() ? 0 : rows.size() * width);
  for (std::size_t i = 0; i < taken.size() / width; ++i)
    for (std::size_t c = 0; c < width; ++c) taken[i * width + c] = values[rows[i] * width + c];
  return taken;
}
} // namespace

TrackSnapshot takeRows(const TrackSnapshot& s, const std::vector<std::uint32_t>& rows) {
  TrackSnapshot taken{take<3>(s.position, rows),  take<3>(s.velocity, rows), take<3>(s.acceleration, rows),
                      take<1>(s.intensity, rows), take<1>(s.trackId, rows),  {}};
  for (const TrackColumn& c : s.further) taken.further.push_back({c.name, take<1>(c.values, rows)});
  return taken;
}

} // namespace rimflow
