#pragma once
#include "TrackTableLayout.h"

#include <string_view>

namespace rimflow {

/// Tables of the LPT and Data-Assimilation challenges: three header lines, then rows X Y Z ... trackID in mm;
/// one file per snapshot, with its number in the file's name. Names are used where a header line has them;
/// else the first three columns are the position, and the last one, if it holds whole numbers, the trackID.
bool isLPTChallenge(std::string_view head);
TrackTableFormat lptChallengeFormat();

} // namespace rimflow
