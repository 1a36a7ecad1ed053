#include "TrackColumns.h"

#include <algorithm>
#include <array>
#include <cctype>
#include <map>
#include <set>
#include <utility>

namespace rimflow {
namespace {

// Length of the UTF-8 sequence at p, or 0 when it is none.
std::size_t utf8Length(std::string_view s, std::size_t p) {
  const auto byte = [&](std::size_t i) { return i < s.size() ? static_cast<unsigned char>(s[i]) : 0u; };
  const unsigned lead = byte(p);
  const std::size_t n = lead < 0x80                   ? 1
                        : lead >= 0xC2 && lead < 0xE0 ? 2
                        : lead >= 0xE0 && lead < 0xF0 ? 3
                        : lead >= 0xF0 && lead < 0xF5 ? 4
                                                      : 0;
  for (std::size_t i = 1; i < n; ++i)
    if ((byte(p + i) & 0xC0) != 0x80) return 0;
  if ((lead == 0xE0 && byte(p + 1) < 0xA0) || (lead == 0xED && byte(p + 1) > 0x9F) ||
      (lead == 0xF0 && byte(p + 1) < 0x90) || (lead == 0xF4 && byte(p + 1) > 0x8F))
    return 0;
  return n;
}

std::string trimmed(const std::string& s) {
  const std::size_t begin = s.find_first_not_of(" \t\r\n"), end = s.find_last_not_of(" \t\r\n");
  return begin == s.npos ? "" : s.substr(begin, end - begin + 1);
}

// "m / s²" and "mm*s^-1" become "m/s2" and "mms-1"; a character lost in a change of encoding becomes '?'.
std::string plainUnit(std::string_view raw) {
  const std::string unit = toUtf8(raw);
  std::string plain;
  for (std::size_t p = 0; p < unit.size();) {
    const std::size_t n = std::max<std::size_t>(1, utf8Length(unit, p));
    const std::string c = unit.substr(p, n);
    p += n;
    if (c == "\xC2\xB2")
      plain += '2'; // superscript two
    else if (c == "\xC2\xB5" || c == "\xCE\xBC")
      plain += 'u'; // micro sign, Greek mu
    else if (c == "\xE2\x88\x92" || c == "\xC2\xAF" || c == "\xE2\x81\xBB")
      plain += '-';
    else if (c == "\xC2\xB7" || c == " " || c == "\t" || c == "^" || c == "*" || c == "(" || c == ")")
      continue;
    else
      plain += n > 1 ? '?' : char(std::tolower(static_cast<unsigned char>(c[0])));
  }
  return plain;
}

std::optional<double> lengthInMetres(const std::string& unit) {
  if (unit == "m" || unit == "meter" || unit == "metre") return 1;
  if (unit == "dm") return 1e-1;
  if (unit == "cm") return 1e-2;
  if (unit == "mm") return 1e-3;
  if (unit == "um" || unit == "micron" || unit == "microns") return 1e-6;
  return {};
}

std::optional<double> perSecond(const std::string& time) {
  if (time == "s" || time == "sec") return 1;
  if (time == "ms") return 1e3;
  if (time == "us") return 1e6;
  return {};
}

bool endsWith(const std::string& s, const std::string& tail) {
  return s.size() >= tail.size() && s.compare(s.size() - tail.size(), tail.size(), tail) == 0;
}

std::string plainName(std::string_view name) {
  std::string plain;
  for (char c : name)
    if (std::isalnum(static_cast<unsigned char>(c)) || c == '|')
      plain += char(std::tolower(static_cast<unsigned char>(c)));
  return plain;
}

struct Named {
  std::string label, name, unit; // "Vx [m/s]", "Vx", "m/s"
};

bool isUnit(const std::string& s) { return unitInSI(s, 0) || unitInSI(s, 1) || unitInSI(s, 2); }

Named separateUnit(const std::string& raw) {
  Named result{plainText(raw), trimmed(plainText(raw)), ""};
  if (result.name.empty()) return result;
  const char close = result.name.back(), open = close == ']' ? '[' : close == ')' ? '(' : '\0';
  const std::size_t begin = open ? result.name.rfind(open) : std::string::npos;
  if (begin == std::string::npos) return result;
  const std::string inside = trimmed(result.name.substr(begin + 1, result.name.size() - begin - 2));
  if (open == '(' && !isUnit(inside)) return result;
  result.unit = inside;
  result.name = trimmed(result.name.substr(0, begin));
  return result;
}

// Of columns with the same meaning, the one with the lowest rank has it (the first of several): `id` may be
// the number of the row where there is a `trackID`, and `ux` a displacement where there is a `vx`.
struct Role {
  TrackColumnPlan::Target target;
  int index;
  int rank;
};

// Components of vectors as ParaView writes them: Velocity:0, Velocity_0.
bool isParaViewComponent(const std::string& name, const char* vector, int index) {
  return name == vector + std::to_string(index);
}

Role roleOf(const std::string& name) {
  using Target = TrackColumnPlan::Target;
  const std::string n = plainName(name);
  const auto is = [&](std::initializer_list<std::string> any) {
    return std::find(any.begin(), any.end(), n) != any.end();
  };
  for (int i = 0; i < 3; ++i) {
    const std::string c(1, "xyz"[i]), u(1, "uvw"[i]);
    if (is({c, "pos" + c, c + "pos", "position" + c, c + "position", "coordinate" + c, c + "coordinate"}))
      return {Target::Position, i, 0};
    if (isParaViewComponent(n, "points", i)) return {Target::Position, i, 1};
    if (is({"v" + c, "velocity" + c, "velocity" + u, "velocityv" + c, "vel" + c, "vel" + u, c + "velocity",
            u + "velocity", "v" + c + "velocity"}) ||
        isParaViewComponent(n, "velocity", i))
      return {Target::Velocity, i, 0};
    if (n == u) return {Target::Velocity, i, 1};
    if (n == "u" + c && name.find('(') == name.npos) return {Target::Velocity, i, 2}; // u(x): an uncertainty
    if (is({"a" + c, "acceleration" + c, "accelerationa" + c, "acc" + c, "accel" + c, c + "acceleration",
            "a" + c + "acceleration"}) ||
        isParaViewComponent(n, "acceleration", i))
      return {Target::Acceleration, i, 0};
  }
  if (is({"i", "intensity", "particleintensity"})) return {Target::Intensity, 0, 0};
  if (is({"trackid", "track", "tracknumber", "trackno", "trackindex", "trajectoryid", "trajectory", "trajid",
          "traj"}))
    return {Target::TrackId, 0, 0};
  if (is({"particleid", "particle"})) return {Target::TrackId, 0, 1};
  if (n == "id") return {Target::TrackId, 0, 2};
  if (is({"|v|", "|u|", "|velocity|", "velocity|v|", "velocity|u|", "velocitymagnitude", "magnitudevelocity",
          "vmag", "speed", "|a|", "|acceleration|", "acceleration|a|", "accelerationmagnitude", "amag"}))
    return {Target::Skip, 0, 0};
  return {Target::Further, 0, 0};
}

const char* const componentNames[4][3] = {{}, {"x", "y", "z"}, {"Vx", "Vy", "Vz"}, {"Ax", "Ay", "Az"}};

std::string list(const std::vector<std::string>& names) {
  std::string all;
  constexpr std::size_t most = 30;
  for (std::size_t n = 0; n < std::min(names.size(), most); ++n)
    all += (all.empty() ? "\"" : " \"") + plainText(names[n], 60) + "\"";
  return names.size() > most ? all + " ..." : all;
}

} // namespace

std::string toUtf8(std::string_view text) {
  for (std::size_t p = 0, n = 1; p < text.size(); p += n)
    if ((n = utf8Length(text, p)) == 0) { // not UTF-8, so Latin-1
      std::string result;
      for (char c : text) {
        const unsigned char b = static_cast<unsigned char>(c);
        if (b < 0x80)
          result += c;
        else
          (result += char(0xC0 | (b >> 6))) += char(0x80 | (b & 0x3F));
      }
      return result;
    }
  return std::string(text);
}

std::string plainText(std::string_view text, std::size_t most) {
  if (text.size() > most) { // not in the middle of a character
    for (int back = 0; back < 3 && most > 0 && (text[most] & 0xC0) == 0x80; ++back) --most;
    text = text.substr(0, most);
  }
  std::string result = toUtf8(text);
  for (char& c : result)
    if (static_cast<unsigned char>(c) < 0x20 || c == 0x7f) c = '?';
  return result;
}

std::optional<double> unitInSI(std::string_view unit, int power) {
  const std::string plain = plainUnit(unit);
  if (power == 0) return lengthInMetres(plain);
  // Only the exponent can be lost in an acceleration's unit, so anything after m/s is read as the square.
  const std::vector<std::string> tails =
      power == 1 ? std::vector<std::string>{"s-1"} : std::vector<std::string>{"s-2"};
  for (const std::string& tail : tails)
    if (endsWith(plain, tail)) return lengthInMetres(plain.substr(0, plain.size() - tail.size()));
  const std::size_t slash = plain.find('/');
  if (slash == plain.npos) return {};
  const auto length = lengthInMetres(plain.substr(0, slash));
  std::string time = plain.substr(slash + 1);
  if (power == 2) {
    const std::size_t second = time.find('/');
    if (second != time.npos)
      time = time.substr(0, second) == time.substr(second + 1) ? time.substr(0, second) : "";
    else if (!time.empty() && (time.back() == '2' || time.back() == '?'))
      time.erase(time.find_first_of("2?"));
    else
      return {};
  }
  const auto rate = perSecond(time);
  if (!length || !rate) return {};
  return *length * (power == 2 ? *rate * *rate : *rate);
}

TrackColumnPlan planTrackColumns(const std::vector<std::string>& names, LengthUnit lengthUnit) {
  using Target = TrackColumnPlan::Target;
  struct Unit {
    const char* name;
    double scale;
  };
  static const Unit lengthUnits[] = {{"", 0}, {"m", 1}, {"mm", 1e-3}, {"cm", 1e-2}, {"um", 1e-6}};
  const Unit& chosen = lengthUnits[int(lengthUnit)];

  TrackColumnPlan plan;
  std::vector<Named> named;
  std::array<std::array<int, 3>, 4>
      place; // of each component; rows: unused, position, velocity, acceleration
  for (auto& p : place) p.fill(-1);
  bool unitKnown[4] = {true, true, true, true};
  std::string* units[4] = {nullptr, &plan.lengthUnit, &plan.velocityUnit, &plan.accelerationUnit};

  std::vector<Role> roles;
  std::map<std::pair<Target, int>, std::size_t> best; // the column that has a meaning
  for (std::size_t c = 0; c < names.size(); ++c) {
    named.push_back(separateUnit(names[c]));
    roles.push_back(roleOf(named.back().name));
    const auto [found, first] = best.emplace(std::make_pair(roles[c].target, roles[c].index), c);
    if (!first && roles[c].rank < roles[found->second].rank) found->second = c;
  }
  for (std::size_t c = 0; c < names.size(); ++c) {
    const Named& n = named[c];
    const Role role = roles[c];
    const bool chief = best.at({role.target, role.index}) == c;
    TrackColumnPlan::Column column{role.target, role.index, 1, n.label};
    const int kind = role.target == Target::Position       ? 1
                     : role.target == Target::Velocity     ? 2
                     : role.target == Target::Acceleration ? 3
                                                           : 0;
    if (kind && chief) {
      const bool points = kind == 1 && role.rank == 1;
      const char* const defaults[] = {"", points ? "m" : "mm", "m/s", "m/s^2"};
      place[kind][role.index] = int(c);
      const bool overridden = kind == 1 && lengthUnit != LengthUnit::Auto;
      const std::string unit = overridden ? chosen.name : n.unit.empty() ? defaults[kind] : n.unit;
      const auto scale = overridden ? std::optional<double>(chosen.scale) : unitInSI(unit, kind - 1);
      column.scale = scale.value_or(1);
      if (!scale) {
        unitKnown[kind] = false;
        const std::string what = "the unit of column \"" + n.label + "\" is not known; expected ";
        if (kind == 1)
          plan.error =
              what + "[m], [mm], [cm] or [um]. If the numbers are in one of these, choose it as LengthUnit; "
                     "otherwise export with calibrated positions";
        else
          plan.warnings.push_back(what +
                                  (kind == 2 ? "[m/s] or [mm/s], so there is no Velocity"
                                             : "[m/s^2] or [mm/s^2], so there is no Acceleration") +
                                  ". Export with these units");
      }
      if (units[kind]->empty()) *units[kind] = unit;
      if (points && !overridden && role.index == 0)
        plan.warnings.push_back("the positions \"" + n.label + "\"" +
                                ", ... have no unit; they are taken for metres, as ParaView saves what was "
                                "read here. If they are not, choose LengthUnit");
    } else if (!chief && role.target != Target::Skip) {
      column.target = Target::Further;
    }
    plan.hasIntensity = plan.hasIntensity || column.target == Target::Intensity;
    plan.hasTrackId = plan.hasTrackId || column.target == Target::TrackId;
    plan.columns.push_back(column);
  }

  const auto missing = [&](int kind) {
    std::string all;
    for (int i = 0; i < 3; ++i)
      if (place[kind][i] < 0) all += (all.empty() ? "" : ", ") + std::string(componentNames[kind][i]);
    return all;
  };
  const auto count = [&](int kind) {
    return std::count_if(place[kind].begin(), place[kind].end(), [](int p) { return p >= 0; });
  };
  if (count(1) < 3)
    plan.error = "no column " + missing(1) + " among the VARIABLES " + list(names) +
                 "; expected x, y and z. Export the particle positions with their column names";
  plan.hasVelocity = count(2) == 3 && unitKnown[2];
  plan.hasAcceleration = count(3) == 3 && unitKnown[3];
  if (count(2) == 0)
    plan.warnings.push_back("there are no velocities among the VARIABLES " + list(names) +
                            "; they are estimated from the positions of each track, if there are track ids. "
                            "Export Vx, Vy and Vz to have the tracker's own");
  for (int kind : {2, 3})
    if (count(kind) > 0 && count(kind) < 3)
      plan.warnings.push_back("there is no column " + missing(kind) + ", so there is no " +
                              (kind == 2 ? "Velocity" : "Acceleration") +
                              " array; the components that are there are kept one by one. Export all three");
  if (!plan.hasTrackId)
    plan.warnings.push_back("there is no column trackID among the VARIABLES " + list(names) +
                            "; pathlines and choices by track are not possible. Export the track IDs too");
  if (!plan.hasVelocity) plan.velocityUnit.clear();
  if (!plan.hasAcceleration) plan.accelerationUnit.clear();

  const std::set<std::string> ours = {"Velocity", "Acceleration", "Intensity",   "TrackId",
                                      "Time",     "Points",       "vtkGhostType"};
  std::set<std::string> taken;
  for (std::size_t c = 0; c < plan.columns.size(); ++c) {
    TrackColumnPlan::Column& column = plan.columns[c];
    std::string name = named[c].name;
    for (int kind : {2, 3})
      if (column.target == (kind == 2 ? Target::Velocity : Target::Acceleration) &&
          !(kind == 2 ? plan.hasVelocity : plan.hasAcceleration)) {
        column.target = unitKnown[kind] ? Target::Further : Target::Skip;
        name = componentNames[kind][column.index];
      }
    if (column.target != Target::Further) continue;
    constexpr std::size_t most = 64;
    if (plan.furtherNames.size() == most) {
      column.target = Target::Skip;
      if (plan.warnings.empty() || plan.warnings.back().rfind("more than", 0) != 0)
        plan.warnings.push_back("more than " + std::to_string(most) +
                                " columns without a known meaning; the rest of them is left out");
      continue;
    }
    if (name.empty()) name = "Column " + std::to_string(c + 1);
    if (ours.count(name)) name += " (file)";
    const std::string base = name;
    for (int n = 2; !taken.insert(name).second; ++n) name = base + " " + std::to_string(n);
    column.index = int(plan.furtherNames.size());
    plan.furtherNames.push_back(name);
  }
  return plan;
}

} // namespace rimflow
