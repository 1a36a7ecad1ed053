#include "TrackPathlines.h"

#include <algorithm>
#include <numeric>
#include <stdexcept>

namespace rimflow {

void PathlineBuilder::add(std::shared_ptr<const TrackSnapshot> given, double time) {
  const TrackSnapshot& snapshot = *given;
  if (snapshot.size() > 0 && snapshot.trackId.empty())
    throw std::runtime_error(
        "Pathlines need the trackID of each particle, and there is no such column. Export the "
        "track IDs too, or choose Particles as OutputMode.");
  const std::int32_t k = std::int32_t(parts.size());
  std::vector<std::uint32_t> rows;
  std::vector<std::int32_t> run;
  rows.reserve(snapshot.size());
  run.reserve(snapshot.size());
  const bool all = selection.keepsAll();
  for (std::size_t r = 0; r < snapshot.size(); ++r) {
    const std::int64_t id = snapshot.trackId[r];
    if (id < 0 || !(all || selection.keeps(id, r))) continue;
    std::int32_t& slot = latest[id];
    if (slot != IdTable::none && runs[std::size_t(slot)].last == k) {
      ++duplicates;
      continue;
    }
    if (slot == IdTable::none || runs[std::size_t(slot)].last < k - 1) {
      slot = std::int32_t(runs.size());
      runs.push_back({id, k, k});
    }
    runs[std::size_t(slot)].last = k;
    rows.push_back(std::uint32_t(r));
    run.push_back(slot);
  }
  if (2 * rows.size() < snapshot.size()) {
    given = std::make_shared<TrackSnapshot>(takeRows(snapshot, rows));
    std::iota(rows.begin(), rows.end(), 0u);
    rows.shrink_to_fit();
    run.shrink_to_fit();
  }
  parts.push_back({std::move(given), std::move(rows), std::move(run), time});
}

Pathlines PathlineBuilder::finish() {
  Pathlines lines;
  lines.duplicates = duplicates;

  // Singles first, then the lines, each in the order of their first points.
  const auto pointsOf = [](const Run& r) { return std::int64_t(r.last - r.first + 1); };
  std::vector<std::int64_t> begin(runs.size());
  lines.offsets.push_back(0);
  for (const bool single : {true, false})
    for (std::size_t r = 0; r < runs.size(); ++r) {
      if ((pointsOf(runs[r]) == 1) != single) continue;
      begin[r] = lines.offsets.back();
      lines.offsets.push_back(begin[r] + pointsOf(runs[r]));
      lines.trackId.push_back(runs[r].id);
      lines.singles += single;
    }
  const std::size_t n = std::size_t(lines.offsets.back());

  // An array is output when every part with particles has it.
  std::vector<const TrackSnapshot*> filled;
  for (const Part& p : parts)
    if (!p.rows.empty()) filled.push_back(p.particles.get());
  const auto place = [&](std::size_t k, std::size_t i) {
    const std::size_t r = std::size_t(parts[k].run[i]);
    return std::size_t(begin[r] + (std::int32_t(k) - runs[r].first));
  };
  const auto scatter = [&](auto& to, std::size_t width, const char* name, const auto& valuesOf) {
    const auto has = [&](const TrackSnapshot* p) { return !valuesOf(*p).empty(); };
    if (!std::all_of(filled.begin(), filled.end(), has)) {
      if (std::any_of(filled.begin(), filled.end(), has)) lines.dropped.push_back(name);
      return;
    }
    to.resize(n * width);
#pragma omp parallel for schedule(dynamic)
    for (int k = 0; k < int(parts.size()); ++k) {
      const Part& part = parts[std::size_t(k)];
      const auto& values = valuesOf(*part.particles);
      for (std::size_t i = 0; i < part.rows.size(); ++i)
        for (std::size_t c = 0, at = width * place(std::size_t(k), i); c < width; ++c)
          to[at + c] = values[part.rows[i] * width + c];
    }
  };
  using Snapshot = TrackSnapshot;
  scatter(
      lines.points.position, 3, "Points", [](const Snapshot& s) -> const auto& { return s.position; });
  scatter(
      lines.points.velocity, 3, "Velocity", [](const Snapshot& s) -> const auto& { return s.velocity; });
  scatter(
      lines.points.acceleration, 3, "Acceleration",
      [](const Snapshot& s) -> const auto& { return s.acceleration; });
  scatter(
      lines.points.intensity, 1, "Intensity", [](const Snapshot& s) -> const auto& { return s.intensity; });
  scatter(
      lines.points.trackId, 1, "TrackId", [](const Snapshot& s) -> const auto& { return s.trackId; });
  std::vector<std::string> names;
  for (const Snapshot* p : filled)
    for (const TrackColumn& c : p->further)
      if (std::find(names.begin(), names.end(), c.name) == names.end()) names.push_back(c.name);
  static const std::vector<double> nothing;
  for (const std::string& name : names) {
    TrackColumn column{name, {}};
    scatter(column.values, 1, name.c_str(), [&](const Snapshot& s) -> const std::vector<double>& {
      const auto found =
          std::find_if(s.further.begin(), s.further.end(), [&](const auto& c) { return c.name == name; });
      return found == s.further.end() ? nothing : found->values;
    });
    if (!column.values.empty()) lines.points.further.push_back(std::move(column));
  }

  lines.time.resize(n);
  for (std::size_t k = 0; k < parts.size(); ++k)
    for (std::size_t i = 0; i < parts[k].rows.size(); ++i) lines.time[place(k, i)] = parts[k].time;
  return lines;
}

} // namespace rimflow
