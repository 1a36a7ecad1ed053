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
    int index = 0;     ///< 0, 1, 2 for x, y, z; the place in furtherNames for Further
    double scale = 1;  ///< from the file's unit to SI; 1 for Intensity and Further
    std::string label; ///< the name as written, in UTF-8, for messages
  };
  std::vector<Column> columns; ///< in the file's order
  bool hasVelocity = false, hasAcceleration = false, hasIntensity = false, hasTrackId = false;
  std::vector<std::string> furtherNames; ///< without units, in UTF-8, each different from all other arrays
  std::string lengthUnit, velocityUnit,
      accelerationUnit; ///< as used: "mm", "m/s", ...; empty: no such column
  std::vector<std::string> warnings;
  std::string error; ///< why there are no positions; empty when all is well
};

/// Names, in any case and with blanks, dots or underscores anywhere: x y z (also `Position x`); Vx Vy Vz, u v
/// w, `Velocity u`; Ax Ay Az, `Acceleration x`; I, Intensity; trackID, `Track ID`, track_id. A unit stands
/// behind the name in [] (or in (), if it is one). Positions m, cm, mm, um (none: mm), velocities length/s,
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
