#pragma once
#include "TrackFile.h"

#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace rimflow {

enum class TrackFormat {
  Tecplot,
  OpenLPT,
  OpenLPTLine,
  MyPTV,
  OpenPTVLinks,
  OpenPTVPositions,
  LPTChallenge,
  Table
};

/// The format of a file, told by its first bytes (trackHeadBytes of them) and never by its name; else why it
/// cannot be read and what to do, such as "line 1: found ...; expected ...".
struct TrackFormatGuess {
  std::optional<TrackFormat> format;
  std::string problem;
  bool isTrackTable = false; ///< there are tracks or times or velocities too, not only positions
};
TrackFormatGuess guessTrackFormat(std::string_view head);

/// True when a file looks like tracks in a format that is read here, or like DaVis' own .set, for which
/// openTrackFiles() says how to export it. Never throws.
bool looksLikeTracks(const std::string& path);

/// A reader for these files, nothing of which is open yet. Throws std::runtime_error: no file, not there,
/// empty, binary, a DaVis .set, a format that is not known, files of different formats.
std::unique_ptr<TrackFile> makeTrackFile(const std::vector<std::string>& files);

} // namespace rimflow
