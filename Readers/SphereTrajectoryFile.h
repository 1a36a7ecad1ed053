#pragma once
#include "TrackColumns.h"

#include <Eigen/Core>
#include <string>
#include <string_view>
#include <vector>

namespace rimflow {

/// Where a sphere was at which time. A row whose centre is NaN says that it was lost then.
struct SphereTrajectory {
  std::string title;
  double diameter = 0;                 ///< m; 0: not known
  double densityRatio = 0;             ///< of the solid over the fluid; 0: not known
  std::vector<double> time;            ///< s, strictly increasing
  std::vector<Eigen::Vector3d> centre; ///< m; not numbers where the sphere was lost
};

/// What the file does not say.
struct SphereTrajectoryOptions {
  double framePeriod = 0; ///< s, >= 0. A time column without a unit: 0: it is in s; else it counts frames. A
                          ///< column of frames: 0: not known, 1 s is taken, with a warning
  double timeShift = 0;   ///< s, added to all times
  double diameter = 0;    ///< m, >= 0, instead of the file's; 0: as in the file
  LengthUnit lengthUnit = LengthUnit::Auto; ///< of the positions; Auto: the file's, mm where it has none
};

/// Reads a trajectory file, plain or gzip-compressed:
///
///     TITLE = "..."
///     VARIABLES = "Time" "x" "y" "z"
///     DIAMETER=11.11[mm]
///     SOLID/FLUID DENSITY RATIO=0.65
///     0.0  1.234  5.678  9.012
///
/// Header entries in any order and case, DENSITY RATIO optional; columns by their names, with units in [],
/// further ones are not used; rows as in the track files (TrackRows.h); one ZONE at most. The diameter is in
/// m, cm, mm or um (none: mm). A row without a finite position means that the sphere was lost. Throws
/// std::runtime_error that says file, line, what was found, what was expected and what to do. `warnings` are
/// added.
SphereTrajectory readSphereTrajectory(const std::string& path, const SphereTrajectoryOptions& options,
                                      std::vector<std::string>& warnings);

/// Writes times in s with all digits, positions in mm to 1e-12 m, NaN where the sphere was lost. The file is
/// whole or not there: it is written beside its place and moved. Throws std::invalid_argument when the
/// trajectory cannot be written in this format (no diameter, no rows, times that do not increase) and
/// std::runtime_error when the file cannot be written.
void writeSphereTrajectory(const std::string& path, const SphereTrajectory& trajectory);

/// True when a file that begins so has a header entry DIAMETER and no column of track ids: then it is a
/// sphere's trajectory and no track table.
bool namesSphereDiameter(std::string_view head);

/// True for a file of this format, by its content: with a DIAMETER, or with times that increase from row to
/// row beside x, y and z, and nothing that tells of particles (track ids, velocities).
bool looksLikeSphereTrajectory(const std::string& path);

} // namespace rimflow
