#pragma once
// What the kernel tests of the track formats share: ways to read files and messages, and damage.
#include "TrackFiles.h"
#include "TrackFormat.h"

#include <gtest/gtest.h>
#include <random>
#include <string>
#include <vector>

namespace testing_tracks {

using Strings = std::vector<std::string>;

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

inline void expectParts(const std::string& text, const Strings& parts) {
  for (const std::string& part : parts)
    EXPECT_NE(text.find(part), std::string::npos) << part << "\nis not in: " << text;
}

inline std::string joined(const Strings& texts) {
  std::string all;
  for (const std::string& t : texts) all += t + "\n";
  return all;
}

/// A text after some random changes: bytes replaced, left out or put in, pieces repeated.
inline std::string damaged(std::string text, std::mt19937& random, int changes) {
  static const std::string bytes = "0123456789.,;+-eE \t\r\n\"=()ZONEVARIABLESIJK#xyztfid\xB2\xFF[]";
  for (int change = 0; change < changes; ++change) {
    const std::size_t at = random() % text.size();
    switch (random() % 4) {
    case 0:
      text[at] = bytes[random() % bytes.size()];
      break;
    case 1:
      text.erase(at, 1 + random() % 30);
      break;
    case 2:
      text.insert(at, 1 + random() % 3, bytes[random() % bytes.size()]);
      break;
    default:
      text.insert(at, text.substr(random() % text.size(), random() % 150));
    }
    if (text.empty()) text = " ";
  }
  return text;
}

} // namespace testing_tracks
