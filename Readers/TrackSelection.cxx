#include "TrackSelection.h"

namespace rimflow {

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
