#pragma once
// Files of any track format opened and read, and what is said about them.
#include "TrackFiles.h"
#include "TrackFormat.h"

#include <memory>

namespace testing_tracks {

/// Files that are open, and their warnings.
struct Series {
  std::unique_ptr<rimflow::TrackFile> tracks;
  rimflow::TrackTimeline line;
  Strings warnings;

  explicit Series(const Strings& files, const rimflow::TrackTimeOptions& options = {0.5, 0, false})
      : tracks(rimflow::makeTrackFile(files)) {
    EXPECT_TRUE(tracks->open(files));
    line = tracks->timeline(options, warnings);
  }
  rimflow::TrackSnapshot read(std::size_t s,
                              const rimflow::TrackUnits& units = {rimflow::LengthUnit::Auto, 0.5}) {
    rimflow::TrackSnapshot snapshot;
    EXPECT_TRUE(tracks->read(line.entries.at(s), units, snapshot, warnings));
    rimflow::TrackSnapshot ids;
    Strings again;
    EXPECT_TRUE(
        tracks->read(line.entries.at(s), units, ids, again, {}, rimflow::TrackFile::Content::TrackIds));
    // Ids alone are also those of particles that are left out for their positions.
    if (ids.trackId.size() == snapshot.trackId.size()) {
      EXPECT_EQ(ids.trackId, snapshot.trackId);
    }
    EXPECT_GE(ids.trackId.size(), snapshot.trackId.size());
    return snapshot;
  }
};

/// What makeTrackFile(), open() or reading all snapshots says.
inline std::string errorOf(const Strings& files, double framePeriod = 0.5) {
  rimflow::TrackSnapshot snapshot;
  Strings warnings;
  try {
    const auto tracks = rimflow::makeTrackFile(files);
    tracks->open(files);
    for (std::size_t s = 0; s < tracks->snapshotCount(); ++s)
      tracks->read(s, {rimflow::LengthUnit::Auto, framePeriod}, snapshot, warnings);
  } catch (const std::runtime_error& e) {
    EXPECT_EQ(snapshot.size(), 0u);
    return e.what();
  }
  return "no error";
}

} // namespace testing_tracks
