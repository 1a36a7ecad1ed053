#include "TimeColumn.h"

#include "TrackColumns.h"

#include <algorithm>
#include <cctype>

namespace rimflow {
namespace {

std::string letters(const std::string& text) {
  std::string plain;
  for (const char k : text)
    if (std::isalnum(static_cast<unsigned char>(k)))
      plain += char(std::tolower(static_cast<unsigned char>(k)));
  return plain;
}

bool countsFrames(const std::string& plain) {
  static const char* const words[] = {"frame",      "frames", "frameid",  "frameno", "framenumber",
                                      "frameindex", "step",   "timestep", "steps",   "snapshot"};
  return std::any_of(std::begin(words), std::end(words), [&](const char* w) { return plain == w; });
}

bool isTime(const std::string& plain) {
  return plain == "t" || plain == "time" || plain == "times" || plain == "solutiontime";
}

// 0: not known.
double secondsPer(const std::string& label, const std::string& plain) {
  if (const auto perSecond = unitInSI("m/" + label, 1)) return 1 / *perSecond;
  return plain == "sec" || plain == "seconds" ? 1 : plain == "ns" ? 1e-9 : 0;
}

void setUnit(TimeColumn& column) {
  using Unit = TimeColumn::Unit;
  const std::string plain = letters(column.label);
  if (countsFrames(plain)) {
    column.unit = Unit::Frames;
  } else if (const double seconds = secondsPer(column.label, plain); seconds > 0) {
    column.unit = Unit::Seconds;
    column.seconds = seconds;
  } else {
    column.unit = plain.empty() ? Unit::NotStated : Unit::NotKnown;
  }
}

} // namespace

TimeColumn findTimeColumn(const std::vector<std::string>& names) {
  TimeColumn frames, notKnown;
  for (std::size_t c = 0; c < names.size(); ++c) {
    const std::size_t open = std::min(names[c].find_first_of("[("), names[c].size());
    const std::size_t close = std::min(names[c].find_last_of("])"), names[c].size());
    TimeColumn here;
    here.index = int(c);
    here.label = open < close ? names[c].substr(open + 1, close - open - 1) : "";
    const std::string name = letters(names[c].substr(0, open));
    if (isTime(name)) {
      setUnit(here);
      if (here.unit == TimeColumn::Unit::NotKnown)
        notKnown = here;
      else if (here.unit != TimeColumn::Unit::Frames)
        return here;
      else if (frames.index < 0)
        frames = here;
    }
    if (countsFrames(name) && frames.index < 0) {
      frames = here;
      frames.unit = TimeColumn::Unit::Frames;
    }
  }
  return frames.index >= 0 ? frames : notKnown;
}

} // namespace rimflow
