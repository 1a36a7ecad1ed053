#pragma once
#include "TrackTableLayout.h"

#include <string_view>

namespace rimflow {

/// OpenLPT's CSV: `TrackID,FrameID,WorldX,WorldY,WorldZ,...`, one row per track point, positions in mm. What
/// the cameras saw is left out. TrackID counts from 0 in each file of a run.
bool isOpenLPT(std::string_view head);
TrackTableFormat openLPTFormat();

/// The older OpenLPT .txt: numbers `id,frame,x,y,z,` one after the other, usually all in one line.
bool isOpenLPTLine(std::string_view head);
TrackTableFormat openLPTLineFormat();

} // namespace rimflow
