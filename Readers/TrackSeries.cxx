#include "TrackSeries.h"

#include "TrackFormat.h"
#include "TrackMessages.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

namespace rimflow {
namespace {

constexpr std::size_t noiseReach = 6;
constexpr double NaN = std::numeric_limits<double>::quiet_NaN();
const char* const absent = " (Its tracks count as absent there.)";

// Keys of the cache: what was read, and what was completed with estimates.
std::size_t keyAsInFile(std::size_t entry) { return 2 * entry; }
std::size_t keyCompleted(std::size_t snapshot) { return 2 * snapshot + 1; }

// The velocities in the place of the positions: their first derivative is the acceleration. Particles without
// a velocity have no track there.
TrackSnapshot velocitiesAsPositions(const TrackSnapshot& s) {
  TrackSnapshot v;
  v.position = s.velocity;
  v.trackId = s.trackId;
  for (std::size_t p = 0; p < v.size(); ++p)
    for (int a = 0; a < 3; ++a)
      if (!std::isfinite(v.position[3 * p + a])) v.trackId[p] = -1;
  return v;
}

TrackWindow velocitiesAsPositions(const TrackWindow& window) {
  TrackWindow v{{}, window.times, window.current};
  for (const auto& s : window.snapshots)
    v.snapshots.push_back(std::make_shared<TrackSnapshot>(velocitiesAsPositions(*s)));
  return v;
}

} // namespace

void TrackSeries::warn(const std::string& warning) {
  constexpr std::size_t most = 100; // more of them nobody reads
  if (told.size() > most || !told.insert(warning).second) return;
  warnings.push_back(warning + (told.size() > most ? " Further warnings are not shown." : ""));
}

std::vector<std::string> TrackSeries::takeWarnings() {
  std::vector<std::string> taken;
  taken.swap(warnings);
  return taken;
}

void TrackSeries::open(const std::vector<std::string>& files, const Progress& progress, bool trustRowCounts) {
  *this = TrackSeries();
  tracks = makeTrackFile(files);
  if (!tracks->open(files, progress, trustRowCounts)) {
    tracks.reset();
    throw TrackReadAborted();
  }
}

void TrackSeries::use(const Settings& wanted) {
  if (wanted.units != settings.units || wanted.estimate != settings.estimate ||
      wanted.polynomial.order != settings.polynomial.order ||
      wanted.polynomial.window != settings.polynomial.window) {
    cache.clear();
    noiseFound.reset();
  }
  settings = wanted;
  cache.setLimit(settings.cacheBytes);
  std::vector<std::string> found;
  TrackTimeline arranged = tracks->timeline(settings.time, found);
  if (arranged.entries != line.entries) { // snapshots have other numbers now
    cache.clear();
    noiseFound.reset();
    spans.reset();
  }
  line = std::move(arranged);
  for (const std::string& w : found) warn(w);
  const auto [from, to] =
      settings.timeRange.value_or(std::array<double, 2>{line.times.front(), line.times.back()});
  const auto begin = std::lower_bound(line.times.begin(), line.times.end(), from);
  const auto end = std::upper_bound(line.times.begin(), line.times.end(), to);
  if (begin >= end)
    throw std::runtime_error("No snapshot lies in the time range from " + shortNumber(from) + " s to " +
                             shortNumber(to) + " s: the series goes from " + shortNumber(line.times.front()) +
                             " s to " + shortNumber(line.times.back()) +
                             " s. Set TimeRange to times within it, or UseTimeRange off.");
  shown = {std::size_t(begin - line.times.begin()), std::size_t(end - line.times.begin()) - 1};
}

std::size_t TrackSeries::nearest(double time) const {
  const auto begin = line.times.begin() + std::ptrdiff_t(first()),
             end = line.times.begin() + std::ptrdiff_t(last()) + 1;
  const auto after = std::lower_bound(begin, end, time);
  if (after == begin) return first();
  const std::size_t s = std::size_t(after - line.times.begin());
  return after != end && line.times[s] - time <= time - line.times[s - 1] ? s : s - 1;
}

bool TrackSeries::estimated(std::size_t snapshot) const {
  const TrackColumnPlan& plan = tracks->columns(line.entries[snapshot], settings.units.length);
  const bool missing = !plan.hasVelocity || !plan.hasAcceleration;
  return plan.hasTrackId && times().size() > 1 &&
         (settings.estimate == Estimate::Always || (settings.estimate == Estimate::Missing && missing));
}

TrackColumnPlan TrackSeries::columns(std::size_t snapshot) const {
  TrackColumnPlan plan = tracks->columns(line.entries[snapshot], settings.units.length);
  if (estimated(snapshot)) plan.hasVelocity = plan.hasAcceleration = true;
  return plan;
}

TrackSeries::Snapshot TrackSeries::asInFile(std::size_t snapshot, const Progress& progress) {
  const std::size_t entry = line.entries.at(snapshot);
  if (auto found = cache.find(keyAsInFile(entry))) return found;
  auto fresh = std::make_shared<TrackSnapshot>();
  std::vector<std::string> found;
  const bool done = tracks->read(entry, settings.units, *fresh, found, progress);
  for (const std::string& w : found) warn(w);
  if (!done) throw TrackReadAborted();
  cache.add(keyAsInFile(entry), fresh);
  return fresh;
}

TrackWindow TrackSeries::around(std::size_t snapshot, std::size_t reach, const Progress& progress) {
  const std::size_t from = snapshot - std::min(snapshot, reach);
  const std::size_t to = std::min(snapshot + reach, times().size() - 1);
  TrackWindow window;
  for (std::size_t s = from; s <= to; ++s) {
    const double begin = double(s - from) / double(to - from + 1);
    Snapshot there;
    try {
      there = asInFile(s, part(progress, begin, begin + 1 / double(to - from + 1)));
    } catch (const TrackIndexOutdated&) {
      throw;
    } catch (const std::runtime_error& e) {
      if (s == snapshot) throw;
      warn(std::string(e.what()) + absent);
      continue;
    }
    if (s == snapshot) window.current = window.snapshots.size();
    window.snapshots.push_back(std::move(there));
    window.times.push_back(times()[s]);
  }
  return window;
}

TrackSeries::Snapshot TrackSeries::particles(std::size_t snapshot, const Progress& progress) {
  if (!estimated(snapshot)) return asInFile(snapshot, progress);
  if (auto found = cache.find(keyCompleted(snapshot))) return found;
  const TrackWindow window = around(snapshot, snapshotsEachSide(settings.polynomial), part(progress, 0, 0.9));
  const TrackSnapshot& given = *window.snapshots[window.current];
  auto whole = std::make_shared<TrackSnapshot>(given);
  const bool all = settings.estimate == Estimate::Always;
  if (given.velocity.empty() || all) {
    estimateDerivatives(window, settings.polynomial, *whole);
    if (!all && !given.acceleration.empty()) whole->acceleration = given.acceleration;
  } else { // the measured velocity has less noise than a difference of positions
    TrackSnapshot rate = velocitiesAsPositions(given);
    estimateDerivatives(velocitiesAsPositions(window), settings.polynomial, rate);
    whole->acceleration = std::move(rate.velocity);
  }
  if (!goOn(progress, 1)) throw TrackReadAborted();
  cache.add(keyCompleted(snapshot), whole);
  return whole;
}

TrackSeries::Snapshot TrackSeries::particlesIfSound(std::size_t snapshot, const Progress& progress) {
  try {
    return particles(snapshot, progress);
  } catch (const TrackIndexOutdated&) {
    throw;
  } catch (const std::runtime_error& e) {
    warn(std::string(e.what()) + absent);
    return std::make_shared<TrackSnapshot>();
  }
}

std::vector<std::int64_t> TrackSeries::idsOf(std::size_t snapshot, const Progress& progress) {
  if (auto found = cache.find(keyAsInFile(line.entries[snapshot]))) return found->trackId;
  TrackSnapshot ids;
  std::vector<std::string> toldWhenRead;
  try {
    if (!tracks->read(line.entries[snapshot], settings.units, ids, toldWhenRead, progress,
                      TrackFile::Content::TrackIds))
      throw TrackReadAborted();
  } catch (const TrackIndexOutdated&) {
    throw;
  } catch (const std::runtime_error& e) {
    warn(std::string(e.what()) + absent);
  }
  return std::move(ids.trackId);
}

const TrackStatistics& TrackSeries::statistics(const Progress& progress) {
  if (spans) return *spans;
  TrackStatistics found;
  for (std::size_t s = 0; s < times().size(); ++s) {
    const double begin = double(s) / double(times().size());
    if (!goOn(progress, begin)) throw TrackReadAborted();
    found.add(std::int32_t(s), idsOf(s, part(progress, begin, begin + 1 / double(times().size()))));
  }
  spans = std::move(found);
  return *spans;
}

void TrackSeries::addStatistics(TrackSnapshot& particles, const std::vector<double>& time) const {
  const std::size_t n = particles.size();
  std::vector<double> length(n, 1), start(n, NaN), end(n, NaN), age(n, NaN);
  for (std::size_t p = 0; p < particles.trackId.size(); ++p) {
    const TrackSpan span = spans->of(particles.trackId[p]);
    if (span.length == 0) continue;
    length[p] = span.length;
    start[p] = times()[std::size_t(span.first)];
    end[p] = times()[std::size_t(span.last)];
    age[p] = time[time.size() == 1 ? 0 : p] - start[p];
  }
  particles.further.push_back({"TrackLength", std::move(length)});
  particles.further.push_back({"TrackStart", std::move(start)});
  particles.further.push_back({"TrackEnd", std::move(end)});
  particles.further.push_back({"TrackAge", std::move(age)});
}

Pathlines TrackSeries::pathlines(std::size_t from, std::size_t to, const TrackSelection& selection,
                                 const Progress& progress) {
  if (auto lines = pathlines(from, to, selection, true, progress)) return std::move(*lines);
  return std::move(*pathlines(from, to, selection, false, progress)); // some particles are left out
}

// Nothing when the particles are not those whose ids were read alone.
std::optional<Pathlines> TrackSeries::pathlines(std::size_t from, std::size_t to,
                                                const TrackSelection& selection, bool idsAlone,
                                                const Progress& progress) {
  PathlineBuilder builder(selection);
  std::vector<Snapshot> held; // the first ones, as many as the cache may hold
  std::size_t bytes = 0;
  const double step = 0.5 / double(to - from + 1);
  for (std::size_t s = from; s <= to; ++s) {
    const double begin = step * double(s - from);
    if (!goOn(progress, begin)) throw TrackReadAborted();
    const bool hold = bytes <= settings.cacheBytes && held.size() == s - from;
    if (!hold && idsAlone) {
      builder.addIds(idsOf(s, part(progress, begin, begin + step)), times()[s]);
      continue;
    }
    const Snapshot there = particlesIfSound(s, part(progress, begin, begin + step));
    builder.addIds(there->trackId, times()[s]);
    bytes += there->bytes();
    if (hold) held.push_back(there);
  }
  for (std::size_t s = from; s <= to; ++s) {
    const double begin = 0.5 + step * double(s - from);
    if (!goOn(progress, begin)) throw TrackReadAborted();
    const Snapshot there =
        s - from < held.size() ? held[s - from] : particlesIfSound(s, part(progress, begin, begin + step));
    if (!builder.addParticles(*there)) return std::nullopt;
  }
  return builder.finish();
}

// Consecutive snapshots in the middle of the series; where tracks are too few or damaged there, at a quarter
// or at three quarters of it.
TrackNoise TrackSeries::noise(const Progress& progress) {
  if (noiseFound) return *noiseFound;
  const std::size_t n = times().size();
  for (const std::size_t middle : {n / 2, n / 4, 3 * n / 4}) {
    try {
      noiseFound = noiseAround(middle, progress);
      if (std::isfinite(noiseFound->position)) break;
    } catch (const TrackIndexOutdated&) {
      throw;
    } catch (const std::runtime_error&) { // this snapshot is damaged: said when somebody looks at it
    }
  }
  if (!noiseFound) noiseFound = TrackNoise();
  return *noiseFound;
}

TrackNoise TrackSeries::noiseAround(std::size_t middle, const Progress& progress) {
  const TrackWindow window = around(middle, noiseSnapshots / 2, part(progress, 0, 0.5));
  const auto watched = [&](double fraction) {
    if (!goOn(progress, 0.5 + 0.5 * fraction)) throw TrackReadAborted();
    return true;
  };
  watched(0);
  if (!estimated(middle)) return measureTrackNoise(window, watched);
  const TrackSnapshot& given = *window.snapshots[window.current];
  TrackSnapshot positions = given;
  const DerivativeGain gain = estimateDerivatives(window, settings.polynomial, positions);
  watched(0.3);
  if (given.velocity.empty() || settings.estimate == Estimate::Always)
    return measureTrackNoise(window, settings.polynomial, gain, watched);
  TrackNoise noise = measureTrackNoise(window, watched);
  noise.acceleration = noise.velocity * gain.velocity; // as a first derivative of the velocities
  return noise;
}

} // namespace rimflow
