#pragma once
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace rimflow {

/// Unit of the positions: as the file says (without a word from it: mm, as DaVis means it), or the user's.
enum class LengthUnit { Auto = 0, Metre = 1, Millimetre = 2, Centimetre = 3, Micrometre = 4 };

/// What the columns of a track table mean, told by their names and units, never by their places.
struct TrackColumnPlan {
  enum class Target { Skip, Position, Velocity, Acceleration, Intensity, TrackId, Further };
  struct Column {
    Target target = Target::Skip;
    int index = 0;      ///< 0, 1, 2 for x, y, z; the place in furtherNames for Further
    double scale = 1;   ///< from the file's unit to SI; 1 for Intensity and Further
    std::string label;  ///< the name as written, in UTF-8, for messages
    bool clock = false; ///< a Further one with frames or times: a row without one is left out
  };
  std::vector<Column> columns; ///< in the file's order
  char delimiter = 0;   ///< between values of which some may be missing; 0: blanks, commas, ... all alike
  bool hasText = false; ///< some of the columns left out hold text
  bool hasVelocity = false, hasAcceleration = false, hasIntensity = false, hasTrackId = false;
  std::vector<std::string> furtherNames; ///< without units, in UTF-8, each different from all other arrays
  std::string lengthUnit, velocityUnit,
      accelerationUnit; ///< as used: "mm", "m/s", ...; empty: no such column
  std::vector<std::string> warnings;
  std::string error; ///< why there are no positions; empty when all is well
};

/// Names, in any case and with blanks, dots or underscores anywhere: x y z (also `Position x`, `Points:0`);
/// Vx Vy Vz, u v w, ux uy uz, `Velocity u`, `Velocity:0`; Ax Ay Az, `Acceleration x`; I, Intensity; trackID,
/// `Track ID`, track_id, trajectory, particle, id. Where several columns have names for the same, those that
/// come first in this list win (for ids: as listed; for velocities: Vx, then u, then ux), and the others are
/// further columns. A unit stands behind the name in [] (or in (), if it is one). Positions m, cm, mm, um
/// (none: mm; `Points:0`: m), velocities length/s,
/// /ms (none: m/s), accelerations length/s^2, with the square in any encoding (none: m/s2). Magnitudes (|V|,
/// |A|) are left out: they follow from the vectors. A vector that lacks a component, or whose unit is
/// unknown, is not output as such; a known component is kept as a further column in SI. All other columns are
/// kept as they are.
TrackColumnPlan planTrackColumns(const std::vector<std::string>& names, LengthUnit lengthUnit);

/// Metres, m/s or m/s2 per unit: the `power` is that of 1/s (0, 1, 2). Nothing when the unit is not known.
std::optional<double> unitInSI(std::string_view unit, int power);

/// The text if it is valid UTF-8, else read as Latin-1.
std::string toUtf8(std::string_view text);
/// The same with control characters replaced, and cut after `most` bytes of `text`: what names of arrays and
/// messages are made of.
std::string plainText(std::string_view text, std::size_t most = std::string_view::npos);

} // namespace rimflow
