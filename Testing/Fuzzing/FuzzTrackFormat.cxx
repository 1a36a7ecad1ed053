// Breaks when any bytes make a parser of track files crash, hang, take more memory than it should, give
// particles that its header excludes, or say something that names no file or cannot be read. An input is one
// file, or up to three between ASCII group separators (0x1D).
#include "FileSnapshots.h"
#include "FrameTracks.h"
#include "FuzzFiles.h"
#include "LPTChallengeTracks.h"
#include "MyPTVTracks.h"
#include "OpenLPTTracks.h"
#include "OpenPTVTracks.h"
#include "TableTracks.h"
#include "TecplotTracks.h"
#include "TrackFormat.h"
#include "TrackPathlines.h"
#include "TrackSelection.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <omp.h>
#include <set>

extern const char* const fuzzedFormat; // the parser: a name in `formats` below

using namespace rimflow;
using fuzz::require;
using fuzz::requireReadable;
using Strings = std::vector<std::string>;

namespace {

using Maker = std::unique_ptr<TrackFile> (*)(const Strings& files, bool small);

// `small`: in small blocks, with the particles on disk, which must make no difference.
template <TrackTableFormat (*format)()>
std::unique_ptr<TrackFile> byFrame(const Strings&, bool small) {
  return std::make_unique<FrameTracks>(format(),
                                       small ? FrameTracks::Options{64, 0} : FrameTracks::Options());
}
template <TrackTableFormat (*format)()>
std::unique_ptr<TrackFile> byFile(const Strings&, bool) {
  return std::make_unique<FileSnapshots>(format());
}

struct Format {
  const char* stem; // of the files' names
  Maker make;
};
const std::map<std::string, Format> formats = {
    {"tecplot",
     {"tracks",
      [](const Strings&, bool) -> std::unique_ptr<TrackFile> { return std::make_unique<TecplotTracks>(); }}},
    {"openlpt", {"tracks", byFrame<openLPTFormat>}},
    {"openlpt_line", {"tracks", byFrame<openLPTLineFormat>}},
    {"myptv", {"tracks", byFrame<myPTVFormat>}},
    {"openptv_links",
     {"ptv_is",
      [](const Strings&, bool) -> std::unique_ptr<TrackFile> { return std::make_unique<OpenPTVTracks>(); }}},
    {"openptv_positions", {"rt_is", byFile<openPTVPositionsFormat>}},
    {"lpt_challenge", {"tracks", byFile<lptChallengeFormat>}},
    {"table_files", {"tracks", byFile<tableFormat>}},
    {"table_frames", {"tracks", byFrame<tableFormat>}},
    {"guessed", {"tracks", [](const Strings& files, bool) { return makeTrackFile(files); }}},
};
const Format& format = formats.at(fuzzedFormat);

void requireErrorNamesFile(const fuzz::Files& folder, const std::exception& e) {
  requireReadable(e.what());
  require(std::string(e.what()).find(folder.place()) != std::string::npos, "an error names its file",
          e.what());
}

// `mayLack`: NaN stands for particles without a velocity.
void requireVectors(const std::vector<float>& values, std::size_t particles, bool column, bool mayLack) {
  require(values.empty() || values.size() == 3 * particles, "an array is empty or complete");
  require(values.empty() || column, "an array has its column");
  for (const float v : values) require(std::isfinite(v) || (mayLack && std::isnan(v)), "vectors are finite");
}

void requireSound(const TrackSnapshot& s, const TrackColumnPlan& plan) {
  const std::size_t n = s.size();
  require(s.position.size() == 3 * n, "positions are complete");
  requireVectors(s.position, n, true, false);
  requireVectors(s.velocity, n, plan.hasVelocity, true);
  requireVectors(s.acceleration, n, plan.hasAcceleration, true);
  require(s.intensity.empty() || s.intensity.size() == n, "an array is empty or complete");
  require(s.trackId.empty() || s.trackId.size() == n, "an array is empty or complete");
  require(n == 0 || s.trackId.empty() != plan.hasTrackId, "track ids are there if their column is");
  require(n == 0 || s.velocity.empty() != plan.hasVelocity, "velocities are there if their columns are");
  for (const TrackColumn& c : s.further)
    require(c.values.size() == n, "further columns are complete", c.name);
}

void requireSound(const TrackColumnPlan& plan) {
  std::set<std::string> names = {"Velocity", "Acceleration", "Intensity", "TrackId", "Time"};
  for (const std::string& name : plan.furtherNames) {
    requireReadable(name);
    require(!name.empty() && names.insert(name).second, "names of arrays are different", name);
  }
  requireReadable(plan.error);
  for (const auto& unit : {plan.lengthUnit, plan.velocityUnit, plan.accelerationUnit}) requireReadable(unit);
}

void requireSound(const TrackTimeline& line, std::size_t snapshots) {
  require(line.times.size() == line.entries.size() && !line.times.empty(), "as many times as snapshots");
  for (std::size_t t = 0; t < line.times.size(); ++t) {
    require(std::isfinite(line.times[t]), "times are finite");
    require(t == 0 || line.times[t] > line.times[t - 1], "times increase");
    require(line.entries[t] < snapshots, "a time belongs to a snapshot");
  }
  require(std::set<std::size_t>(line.entries.begin(), line.entries.end()).size() == line.entries.size(),
          "a snapshot has one time");
}

// What there is, to be compared between ways of reading that must agree. Equal bits, so that NaN is NaN.
struct Contents {
  std::vector<std::vector<float>> vectors;
  std::vector<std::vector<std::int64_t>> ids;
  std::vector<double> times;
  bool opened = false;
  bool operator==(const Contents& o) const {
    const auto same = [](const std::vector<float>& a, const std::vector<float>& b) {
      return std::equal(a.begin(), a.end(), b.begin(), b.end(),
                        [](float x, float y) { return x == y || (std::isnan(x) && std::isnan(y)); });
    };
    return opened == o.opened && ids == o.ids && times == o.times &&
           std::equal(vectors.begin(), vectors.end(), o.vectors.begin(), o.vectors.end(), same);
  }
};

void readSnapshot(const fuzz::Files& folder, const TrackFile& tracks, std::size_t s, const TrackUnits& units,
                  TrackSnapshot& particles) {
  Strings warnings;
  try {
    const TrackColumnPlan& plan = tracks.columns(s, units.length);
    requireSound(plan);
    require(tracks.read(s, units, particles, warnings), "what nobody aborts is read");
    requireSound(particles, plan);
    TrackSnapshot ids;
    require(tracks.read(s, units, ids, warnings, {}, TrackFile::Content::TrackIds),
            "what nobody aborts is read");
    require(ids.trackId.size() >= particles.trackId.size() && ids.position.empty(), "ids alone are all ids");
    TrackSnapshot none;
    tracks.read(s, units, none, warnings, [](double) { return false; });
    require(none.size() == 0, "what is aborted is empty");
  } catch (const std::exception& e) {
    requireErrorNamesFile(folder, e);
    require(particles.position.empty() && particles.trackId.empty(), "a snapshot with an error is empty");
  }
  for (const std::string& w : warnings) requireReadable(w);
}

void requireLines(const std::vector<std::shared_ptr<const TrackSnapshot>>& snapshots) {
  PathlineBuilder builder({});
  double time = 0;
  for (const auto& s : snapshots) builder.addIds(s->trackId, time++);
  for (const auto& s : snapshots) require(builder.addParticles(*s), "particles are those of the ids");
  const Pathlines lines = builder.finish();
  require(lines.offsets.size() == lines.trackId.size() + 1, "every line has its id");
  if (std::all_of(snapshots.begin(), snapshots.end(),
                  [](const auto& s) { return s->trackId.size() == s->size(); }))
    require(std::size_t(lines.offsets.back()) == lines.points.size(), "lines hold all points");
}

Contents readAll(const fuzz::Files& folder, const Strings& files, bool small, bool trustRowCounts) {
  Contents contents;
  std::unique_ptr<TrackFile> tracks;
  try {
    tracks = format.make(files, small);
    require(tracks->open(files, {}, trustRowCounts), "what nobody aborts is opened");
  } catch (const std::exception& e) {
    requireErrorNamesFile(folder, e);
    require(!tracks || tracks->snapshotCount() == 0, "nothing is open after an error");
    return contents;
  }
  contents.opened = true;
  const std::size_t count = tracks->snapshotCount();
  require(count > 0 && tracks->isOpen(files), "what was opened is open");
  Strings warnings;
  for (const TrackTimeOptions& options : {TrackTimeOptions{}, {0.5, 0, true}, {1e-3, -7, false}}) {
    const TrackTimeline line = tracks->timeline(options, warnings);
    requireSound(line, count);
    contents.times.insert(contents.times.end(), line.times.begin(), line.times.end());
  }
  for (const std::string& w : warnings) requireReadable(w);
  std::vector<std::shared_ptr<const TrackSnapshot>> snapshots;
  for (std::size_t s = 0; s < std::min<std::size_t>(count, 20); ++s) {
    require(std::count(files.begin(), files.end(), tracks->fileOf(s)) == 1,
            "a snapshot is in one of the files");
    if (!small)
      for (const TrackUnits& units : {TrackUnits{}, {LengthUnit::Metre, 1e-3}}) {
        TrackSnapshot particles;
        readSnapshot(folder, *tracks, s, units, particles);
      }
    auto particles = std::make_shared<TrackSnapshot>();
    readSnapshot(folder, *tracks, s, {LengthUnit::Auto, 0.5}, *particles);
    contents.vectors.push_back(particles->position);
    contents.vectors.push_back(particles->velocity);
    contents.ids.push_back(particles->trackId);
    snapshots.push_back(std::move(particles));
  }
  requireLines(snapshots);
  return contents;
}

} // namespace

extern "C" int LLVMFuzzerInitialize(int*, char***) {
  omp_set_num_threads(1); // inputs are small
  return 0;
}

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static const fuzz::Files folder(format.stem);
  const Strings files = folder.write({reinterpret_cast<const char*>(data), size});
  for (const std::string& file : files) looksLikeTracks(file);
  const Contents contents = readAll(folder, files, false, true);
  require(contents == readAll(folder, files, true, false), "blocks, disk and row counts make no difference");
  if (contents.opened) {
    const auto tracks = format.make(files, false);
    int left = int(size % 5);
    const bool done = tracks->open(files, [&](double) { return left-- > 0; });
    require(done || tracks->snapshotCount() == 0, "what is aborted is not open");
  }
  return 0;
}
