#pragma once
#include "TrackTableLayout.h"

#include <string_view>

namespace rimflow {

/// MyPTV's tables, without a header, between tabs; the last column is the frame, lengths are in mm:
///  - `smoothed_trajectories`, 11 columns: id x y z vx vy vz ax ay az frame, per frame. Zero velocity and
///    acceleration of a track too short for smoothing mean that there is none: NaN here;
///  - `trajectories`: id x y z, any columns about the cameras, frame;
///  - `particles`: x y z, any columns about the cameras, frame; no tracks.
/// Id -1 marks particles without a track.
bool isMyPTV(std::string_view head);
TrackTableFormat myPTVFormat();

} // namespace rimflow
