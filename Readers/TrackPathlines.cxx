#include "TrackPathlines.h"

#include <algorithm>

namespace rimflow {
namespace {

const std::vector<double>& valuesOf(const TrackSnapshot& s, const std::string& name) {
  static const std::vector<double> none;
  const auto found =
      std::find_if(s.further.begin(), s.further.end(), [&](const TrackColumn& c) { return c.name == name; });
  return found == s.further.end() ? none : found->values;
}

} // namespace

void PathlineBuilder::addIds(const std::vector<std::int64_t>& trackIds, double time) {
  const std::int32_t k = std::int32_t(parts.size());
  Part part;
  part.time = time;
  part.particles = trackIds.size();
  const bool all = selection.keepsAll();
  for (std::size_t r = 0; r < trackIds.size(); ++r) {
    const std::int64_t id = trackIds[r];
    if (id < 0 || !(all || selection.keeps(id, r))) continue;
    std::int32_t& slot = latest[id];
    if (slot != IdTable::none && runs[std::size_t(slot)].last == k) {
      ++lines.duplicates;
      continue;
    }
    if (slot == IdTable::none || runs[std::size_t(slot)].last < k - 1) {
      slot = std::int32_t(runs.size());
      runs.push_back({id, k, k});
    }
    runs[std::size_t(slot)].last = k;
    part.rows.push_back(std::uint32_t(r));
    part.run.push_back(slot);
  }
  part.rows.shrink_to_fit();
  part.run.shrink_to_fit();
  parts.push_back(std::move(part));
}

// Singles first, then the lines, each in the order of their first points.
void PathlineBuilder::layOut() {
  const auto pointsOf = [](const Run& r) { return std::int64_t(r.last - r.first + 1); };
  begin.resize(runs.size());
  lines.offsets.push_back(0);
  for (const bool single : {true, false})
    for (std::size_t r = 0; r < runs.size(); ++r) {
      if ((pointsOf(runs[r]) == 1) != single) continue;
      begin[r] = lines.offsets.back();
      lines.offsets.push_back(begin[r] + pointsOf(runs[r]));
      lines.trackId.push_back(runs[r].id);
      lines.singles += single;
    }
  lines.time.resize(std::size_t(lines.offsets.back()));
}

bool PathlineBuilder::addParticles(const TrackSnapshot& snapshot) {
  if (placed == 0) layOut();
  const Part& part = parts.at(placed);
  const std::int32_t k = std::int32_t(placed++);
  if (snapshot.trackId.size() != part.particles) return false;
  if (part.rows.empty()) return true;
  std::vector<std::size_t> place(part.rows.size());
  for (std::size_t i = 0; i < place.size(); ++i) {
    const std::size_t r = std::size_t(part.run[i]);
    place[i] = std::size_t(begin[r] + (k - runs[r].first));
    lines.time[place[i]] = part.time;
  }
  // An array is output when every snapshot with such particles has it.
  const bool first = lines.points.position.empty();
  const auto scatter = [&](const auto& from, auto& to, std::size_t width, const std::string& name) {
    const auto dropped = std::find(lines.dropped.begin(), lines.dropped.end(), name);
    if (dropped != lines.dropped.end()) return;
    if (from.empty() != to.empty() && !first) {
      to.clear();
      to.shrink_to_fit();
      lines.dropped.push_back(name);
    }
    if (from.empty() || (to.empty() && !first)) return;
    to.resize(lines.time.size() * width);
    for (std::size_t i = 0; i < place.size(); ++i)
      std::copy_n(&from[part.rows[i] * width], width, &to[place[i] * width]);
  };
  TrackSnapshot& to = lines.points;
  if (first)
    for (const TrackColumn& c : snapshot.further) to.further.push_back({c.name, {}});
  scatter(snapshot.velocity, to.velocity, 3, "Velocity");
  scatter(snapshot.acceleration, to.acceleration, 3, "Acceleration");
  scatter(snapshot.intensity, to.intensity, 1, "Intensity");
  scatter(snapshot.trackId, to.trackId, 1, "TrackId");
  for (TrackColumn& c : to.further) scatter(valuesOf(snapshot, c.name), c.values, 1, c.name);
  for (const TrackColumn& c : snapshot.further)
    if (std::none_of(to.further.begin(), to.further.end(), [&](const auto& t) { return t.name == c.name; })) {
      to.further.push_back({c.name, {}});
      lines.dropped.push_back(c.name);
    }
  scatter(snapshot.position, to.position, 3, "Points");
  return true;
}

Pathlines PathlineBuilder::finish() {
  if (placed == 0) layOut();
  const auto isDropped = [&](const TrackColumn& c) {
    return std::find(lines.dropped.begin(), lines.dropped.end(), c.name) != lines.dropped.end();
  };
  auto& further = lines.points.further;
  further.erase(std::remove_if(further.begin(), further.end(), isDropped), further.end());
  return std::move(lines);
}

} // namespace rimflow
