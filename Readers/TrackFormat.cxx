#include "TrackFormat.h"

#include "FileSnapshots.h"
#include "FrameTracks.h"
#include "LPTChallengeTracks.h"
#include "MyPTVTracks.h"
#include "OpenLPTTracks.h"
#include "OpenPTVTracks.h"
#include "SphereTrajectoryFile.h"
#include "TableHead.h"
#include "TableTracks.h"
#include "TecplotHeader.h"
#include "TecplotTracks.h"
#include "TrackMessages.h"

#include <algorithm>
#include <filesystem>
#include <stdexcept>

namespace rimflow {
namespace {

namespace fs = std::filesystem;

std::string nameOf(TrackFormat format) {
  switch (format) {
  case TrackFormat::Tecplot:
    return "Tecplot ASCII";
  case TrackFormat::OpenLPT:
  case TrackFormat::OpenLPTLine:
    return "OpenLPT";
  case TrackFormat::MyPTV:
    return "MyPTV";
  case TrackFormat::OpenPTVLinks:
    return "OpenPTV, ptv_is";
  case TrackFormat::OpenPTVPositions:
    return "OpenPTV, rt_is";
  case TrackFormat::LPTChallenge:
    return "LPT challenge";
  case TrackFormat::Table:
    return "table with a header";
  }
  return {};
}

// DaVis keeps the particles of X.set in a folder X.
bool belongsToSet(const fs::path& path) {
  std::error_code ignored;
  const fs::path folder = fs::is_directory(path, ignored) ? path : path.parent_path();
  const bool part = folder == path || path.extension() == ".bin";
  return part && (fs::exists(fs::path(folder.string() + ".set"), ignored) ||
                  fs::exists(folder / "tracks.bin", ignored));
}

bool anyTecplotRecord(std::string_view head) {
  const auto lines = linesOfHead(head, 50);
  const auto isRow = [](const HeadLine& l) { return looksLikeRow(l.text); };
  const auto end = std::find_if(lines.begin(), lines.end(), isRow);
  return std::any_of(lines.begin(), end, [](const HeadLine& l) { return beginsTecplotRecord(l.text); });
}

std::string notKnown(std::string_view head) {
  const auto lines = linesOfHead(head, 1);
  if (lines.empty())
    return "line 1: a line of more than " + std::to_string(trackHeadBytes >> 10) +
           " KiB that is no list of numbers; expected a track table. Export the tracks again.";
  const HeadLine& line = lines[0];
  const bool row = looksLikeRow(line.text);
  return "line " + std::to_string(line.number) + ": found " + printable(line.text) +
         (row ? ", and nothing says what the columns mean. " + std::string(tableAdvice)
              : "; expected tracks as Tecplot ASCII (DaVis), OpenLPT, MyPTV, OpenPTV, or a table whose "
                "header names "
                "x, y and z. Export the tracks in one of these formats, with the header.");
}

} // namespace

TrackFormatGuess guessTrackFormat(std::string_view head) try {
  TrackFormatGuess guess;
  guess.isTrackTable = true;
  if (guess.problem = foreignFormat(head); !guess.problem.empty()) return guess;
  if (anyTecplotRecord(head))
    guess.format = TrackFormat::Tecplot;
  else if (isOpenPTVLinks(head) || isEmptyOpenPTVFrame(head))
    guess.format = TrackFormat::OpenPTVLinks;
  else if (isOpenPTVPositions(head))
    guess.format = TrackFormat::OpenPTVPositions;
  else if (isOpenLPT(head))
    guess.format = TrackFormat::OpenLPT;
  else if (isMyPTV(head))
    guess.format = TrackFormat::MyPTV;
  else if (isOpenLPTLine(head))
    guess.format = TrackFormat::OpenLPTLine;
  else if (isLPTChallenge(head))
    guess.format = TrackFormat::LPTChallenge;
  else if (isTable(head))
    guess.format = TrackFormat::Table;
  else
    guess.problem = notKnown(head);
  if (guess.format == TrackFormat::Table || guess.format == TrackFormat::LPTChallenge) {
    const TrackTableLayout layout =
        (guess.format == TrackFormat::Table ? tableFormat() : lptChallengeFormat()).layout(head);
    const TrackColumnPlan plan = outputPlan(layout, LengthUnit::Millimetre);
    guess.isTrackTable = plan.hasTrackId || plan.hasVelocity || layout.frame >= 0;
  }
  return guess;
} catch (const std::runtime_error& e) { // a header that cannot be used
  TrackFormatGuess guess;
  guess.problem = e.what();
  return guess;
}

bool looksLikeTracks(const std::string& path) {
  try {
    if (belongsToSet(path)) return true;
    const std::string head = headOfFile(path, trackHeadBytes);
    if (namesSphereDiameter(head)) return false;
    const TrackFormatGuess guess = guessTrackFormat(head);
    if (guess.format == TrackFormat::Tecplot) return TecplotTracks::canRead(path);
    return (guess.format && guess.isTrackTable) || guess.problem.find(".set file") != std::string::npos;
  } catch (const std::exception&) {
    return false;
  }
}

std::unique_ptr<TrackFile> makeTrackFile(const std::vector<std::string>& files) {
  if (files.empty()) throw std::runtime_error("No file name was given. Set FileNames.");
  std::optional<TrackFormat> format;
  std::string first;
  bool byFrame = false;
  for (const std::string& path : files) {
    if (belongsToSet(path))
      throw std::runtime_error(path + ": this belongs to DaVis' own .set, which cannot be read here. " +
                               davisExportAdvice);
    const std::string head = headOfFile(path, trackHeadBytes);
    if (namesSphereDiameter(head))
      throw std::runtime_error(path + ": this is the trajectory of a sphere (it has a DIAMETER), not a table "
                                      "of tracks. Open it with the Sphere Trajectory Reader.");
    TrackFormatGuess guess = guessTrackFormat(head);
    if (!guess.format)
      throw std::runtime_error(path + (guess.problem.rfind("line", 0) == 0 ? ", " : ": ") + guess.problem);
    const bool emptyFrame = isEmptyOpenPTVFrame(head);
    if (emptyFrame && (path.find("rt_is") != path.npos)) guess.format = TrackFormat::OpenPTVPositions;
    if (!format) {
      format = guess.format;
      first = path;
      byFrame = *format == TrackFormat::Table && tableFormat().layout(head).frame >= 0;
    } else if (*format != *guess.format)
      throw std::runtime_error(path + ", line 1: this is " + nameOf(*guess.format) + ", but " + first +
                               " is " + nameOf(*format) + ". Open files of one format together.");
  }
  switch (*format) {
  case TrackFormat::Tecplot:
    return std::make_unique<TecplotTracks>();
  case TrackFormat::OpenLPT:
    return std::make_unique<FrameTracks>(openLPTFormat());
  case TrackFormat::OpenLPTLine:
    return std::make_unique<FrameTracks>(openLPTLineFormat());
  case TrackFormat::MyPTV:
    return std::make_unique<FrameTracks>(myPTVFormat());
  case TrackFormat::OpenPTVLinks:
    return std::make_unique<OpenPTVTracks>();
  case TrackFormat::OpenPTVPositions:
    return std::make_unique<FileSnapshots>(openPTVPositionsFormat());
  case TrackFormat::LPTChallenge:
    return std::make_unique<FileSnapshots>(lptChallengeFormat());
  case TrackFormat::Table:
    if (byFrame) return std::make_unique<FrameTracks>(tableFormat());
    return std::make_unique<FileSnapshots>(tableFormat());
  }
  return nullptr;
}

} // namespace rimflow
