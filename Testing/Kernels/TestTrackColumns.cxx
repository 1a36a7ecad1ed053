// Breaks when a column's meaning or unit is told wrongly from its name, or a Tecplot header is misread.
#include "TecplotHeader.h"
#include "TrackColumns.h"

#include <cmath>
#include <gtest/gtest.h>

using namespace rimflow;
using Target = TrackColumnPlan::Target;

namespace {
// One letter per column: p v a (followed by the component), I, T (trackID), F (further), - (left out).
std::string meaning(const TrackColumnPlan& plan) {
  std::string text;
  for (const auto& c : plan.columns) {
    const int t = int(c.target);
    text += "-pvaITF"[t];
    if (t >= 1 && t <= 3) text += char('0' + c.index);
  }
  return text;
}
TrackColumnPlan plan(const std::vector<std::string>& names, LengthUnit unit = LengthUnit::Auto) {
  return planTrackColumns(names, unit);
}
} // namespace

TEST(TrackColumns, TheFourLayoutsOfDaVis) {
  EXPECT_EQ(
      meaning(plan({"x[mm]", "y[mm]", "z[mm]", "Vx[m/s]", "Vy[m/s]", "Vz[m/s]", "|V|[m/s]", "trackID"})),
      "p0p1p2v0v1v2-T");
  const auto ten = plan(
      {"x[mm]", "y[mm]", "z[mm]", "I", "Vx[m/s]", "Vy[m/s]", "Vz[m/s]", "|V|[m/s]", "trackID", "Ax[mm/s^2]"});
  EXPECT_EQ(meaning(ten), "p0p1p2Iv0v1v2-TF");
  EXPECT_FALSE(ten.hasAcceleration);
  ASSERT_EQ(ten.warnings.size(), 1u);
  EXPECT_NE(ten.warnings[0].find("no column Ay, Az"), std::string::npos) << ten.warnings[0];
  ASSERT_EQ(ten.furtherNames, std::vector<std::string>{"Ax"});
  EXPECT_DOUBLE_EQ(ten.columns[9].scale, 1e-3);
  const auto fourteen =
      plan({"x[mm]", "y[mm]", "z[mm]", "I", "Vx[m/s]", "Vy[m/s]", "Vz[m/s]", "|V|[m/s]", "trackID",
            "Ax[m/s\xB2]", "Ay[m/s\xC2\xB2]", "Az[m/s^2]", "|A|[m/s\xB2]", "Absolute intensity[]"});
  EXPECT_EQ(meaning(fourteen), "p0p1p2Iv0v1v2-Ta0a1a2-F");
  EXPECT_TRUE(fourteen.hasAcceleration && fourteen.hasVelocity && fourteen.hasTrackId &&
              fourteen.hasIntensity);
  EXPECT_EQ(fourteen.furtherNames, std::vector<std::string>{"Absolute intensity"});
  EXPECT_TRUE(fourteen.warnings.empty());
  for (int c : {9, 10, 11}) EXPECT_EQ(fourteen.columns[std::size_t(c)].scale, 1.0);
}

TEST(TrackColumns, NamesInAnyFormAndOrder) {
  EXPECT_EQ(meaning(plan({"Track ID", "Z", "w", "Intensity", "Y [mm]", "v", "X (mm)", "U"})),
            "Tp2v2Ip1v1p0v0");
  EXPECT_EQ(
      meaning(plan({"Position x", "position_y", "z position", "Velocity u", "velocity_v", "Velocity w [m/s]",
                    "Acceleration x", "acc y", "az", "track_id", "I [counts]", "Velocity magnitude"})),
      "p0p1p2v0v1v2a0a1a2TI-");
  EXPECT_EQ(meaning(plan({"x", "y", "z", "Vx", "Vy", "Vz", "V"})), "p0p1p2v0v1v2F");
}

TEST(TrackColumns, NamesOfOtherPrograms) {
  const auto paraview = plan({"TrackId", "Velocity:0", "Velocity:1", "Velocity:2", "Acceleration_0",
                              "Acceleration_1", "Acceleration_2", "Points:2", "Points:1", "Points:0"});
  EXPECT_EQ(meaning(paraview), "Tv0v1v2a0a1a2p2p1p0");
  EXPECT_EQ(paraview.columns[7].scale, 1.0); // what was read here is saved in metres
  ASSERT_EQ(paraview.warnings.size(), 1u);
  EXPECT_NE(paraview.warnings[0].find("taken for metres"), std::string::npos);
  EXPECT_EQ(plan({"Points:0", "Points:1", "Points:2", "id"}, LengthUnit::Millimetre).columns[0].scale, 1e-3);
  EXPECT_EQ(meaning(plan({"y", "x", "mass", "size", "frame", "particle", "z"})), "p1p0FFFTp2"); // trackpy
  EXPECT_EQ(meaning(plan({"trajectory", "x", "y", "z", "vel_x", "vel_y", "vel_z", "accx", "accy", "accz"})),
            "Tp0p1p2v0v1v2a0a1a2");
  EXPECT_EQ(meaning(plan({"traj_id", "X", "Y", "Z", "u_x", "u_y", "u_z"})), "Tp0p1p2v0v1v2");
}

TEST(TrackColumns, TheMoreExactNameWins) {
  EXPECT_EQ(meaning(plan({"id", "particle", "track_id", "x", "y", "z"})), "FFTp0p1p2");
  EXPECT_EQ(meaning(plan({"id", "particle", "x", "y", "z"})), "FTp0p1p2");
  EXPECT_EQ(meaning(plan({"x", "y", "z", "ux", "uy", "uz", "vx", "vy", "vz"})), "p0p1p2FFFv0v1v2");
  EXPECT_EQ(meaning(plan({"x", "y", "z", "u(x)", "u(y)", "u(z)"})), "p0p1p2FFF"); // uncertainties
  EXPECT_EQ(meaning(plan({"Points:0", "Points:1", "Points:2", "x", "y", "z"})), "FFFp0p1p2");
}

TEST(TrackColumns, NamesAndMessagesHaveNoControlCharacters) {
  const std::vector<std::string> names = {"x", "y\x01[mm]", "a\nb", "c\x1b[31m"};
  for (const std::string& text : {plan(names).error, plan({"x", "y", "z", "a\nb"}).furtherNames.at(0)})
    for (const char c : text) EXPECT_GE(c, ' ') << text;
  EXPECT_EQ(plainText("caf\xC3\xA9\t", 4), "caf"); // not in the middle of a character
  EXPECT_EQ(plainText("caf\xC3\xA9\t", 5), "caf\xC3\xA9");
  EXPECT_LT(plan(std::vector<std::string>(10000, "name")).error.size(), 1000u);
}

TEST(TrackColumns, UnitsBecomeSI) {
  EXPECT_EQ(unitInSI("m", 0), 1.0);
  EXPECT_EQ(unitInSI("mm", 0), 1e-3);
  EXPECT_EQ(unitInSI("CM", 0), 1e-2);
  EXPECT_EQ(unitInSI("um", 0), 1e-6);
  EXPECT_EQ(unitInSI("\xB5m", 0), 1e-6);     // Latin-1
  EXPECT_EQ(unitInSI("\xC2\xB5m", 0), 1e-6); // UTF-8
  EXPECT_EQ(unitInSI("\xCE\xBCm", 0), 1e-6); // Greek
  EXPECT_FALSE(unitInSI("px", 0) || unitInSI("", 0) || unitInSI("m/s", 0));
  EXPECT_EQ(unitInSI("mm/s", 1), 1e-3);
  EXPECT_EQ(unitInSI("m s^-1", 1), 1.0);
  EXPECT_EQ(unitInSI("mm/ms", 1), 1.0);
  EXPECT_FALSE(unitInSI("px/frame", 1) || unitInSI("m", 1) || unitInSI("m/s^2", 1));
  for (const char* same : {"m/s^2", "m/s\xB2", "m/s\xC2\xB2", "m/s2", "m / s**2", "m/s/s", "m s^-2", "m/s?",
                           "m/s\xEF\xBF\xBD", "m/(s^2)"})
    EXPECT_EQ(unitInSI(same, 2), 1.0) << same;
  EXPECT_EQ(unitInSI("mm/s\xB2", 2), 1e-3);
  EXPECT_FALSE(unitInSI("m/s", 2) || unitInSI("px/s^2", 2));
}

TEST(TrackColumns, WithoutUnitMmAndMetresPerSecond) {
  const auto p = plan({"x", "y", "z", "u", "v", "w", "trackID"});
  EXPECT_EQ(p.columns[0].scale, 1e-3);
  EXPECT_EQ(p.columns[3].scale, 1.0);
  EXPECT_EQ(p.lengthUnit, "mm");
  EXPECT_EQ(p.velocityUnit, "m/s");
  EXPECT_EQ(p.accelerationUnit, "");
}

TEST(TrackColumns, TheUsersLengthUnitWinsForPositionsOnly) {
  const auto p =
      plan({"x[mm]", "y[mm]", "z[mm]", "u[mm/s]", "v[mm/s]", "w[mm/s]", "trackID"}, LengthUnit::Metre);
  EXPECT_EQ(p.columns[0].scale, 1.0);
  EXPECT_EQ(p.columns[3].scale, 1e-3);
  EXPECT_EQ(p.lengthUnit, "m");
}

TEST(TrackColumns, UnknownUnitsNeverGiveWrongNumbers) {
  const std::vector<std::string> pixels = {"x[px]",       "y[px]",       "z[px]", "u[px/frame]",
                                           "v[px/frame]", "w[px/frame]", "id"};
  EXPECT_NE(plan(pixels).error.find("LengthUnit"), std::string::npos);
  const auto forced = plan(pixels, LengthUnit::Micrometre);
  EXPECT_TRUE(forced.error.empty());
  EXPECT_FALSE(forced.hasVelocity);
  EXPECT_FALSE(forced.warnings.empty());
  EXPECT_EQ(meaning(forced), "p0p1p2---T");
}

TEST(TrackColumns, SaysWhatIsMissing) {
  EXPECT_NE(plan({"x", "z", "u", "v", "w"}).error.find("no column y"), std::string::npos);
  const auto positions = plan({"x", "y", "z"});
  EXPECT_TRUE(positions.error.empty());
  ASSERT_EQ(positions.warnings.size(), 2u);
  EXPECT_NE(positions.warnings[0].find("velocities"), std::string::npos);
  EXPECT_NE(positions.warnings[1].find("trackID"), std::string::npos);
  EXPECT_FALSE(plan({"x", "y", "z", "u", "v", "trackID"}).hasVelocity);
}

TEST(TrackColumns, FurtherNamesAreUniqueUtf8AndNeverHideAnArray) {
  const auto p = plan({"x", "y", "z", "x", "Caf\xE9", "Time[s]", "Time[ms]", "", "Velocity"});
  EXPECT_EQ(p.furtherNames, (std::vector<std::string>{"x", "Caf\xC3\xA9", "Time (file)", "Time (file) 2",
                                                      "Column 8", "Velocity (file)"}));
}

TEST(TecplotHeader, OneLineOrManyInAnyOrder) {
  for (const char* text :
       {"ZONE T=\"Snapshot 0003\"\nSTRANDID=1, SOLUTIONTIME=43.5\nI=2, J=1, K=1, ZONETYPE = Ordered\n"
        "DATAPACKING = POINT\n",
        "zone datapacking=point,zonetype=ORDERED K=1 I = 2 SolutionTime= +4.35e1 t=\"Snapshot 0003\"",
        "  ZONE\r\n\r\n# a comment with ZONE I=9\r\nDT=(SINGLE\r\n SINGLE)\r\nI=2\r\n"
        "SOLUTIONTIME=43.5\r\nF=POINT\r\nT = \"Snapshot 0003\"\r\nAUXDATA who = \"me\"\r\n",
        "ZONE T=Snapshot 0003, I=2, SOLUTIONTIME=43.5, F=POINT",
        "ZONE T=Snapshot 0003 I=2 SOLUTIONTIME=43.5 F=POINT"}) {
    const TecplotHeader h = parseTecplotHeader(text);
    ASSERT_EQ(h.zones.size(), 1u) << text;
    const TecplotZoneHeader& z = h.zones[0];
    EXPECT_EQ(z.title, "Snapshot 0003") << text;
    EXPECT_EQ(z.rows, 2) << text;
    EXPECT_EQ(z.time, 43.5) << text;
    EXPECT_EQ(z.packing, "POINT") << text;
    EXPECT_EQ(z.problem, "") << text;
  }
}

TEST(TecplotHeader, VariablesQuotedOrNotOnOneLineOrMany) {
  const std::vector<std::string> expected = {"x [mm]", "y", "z", "trackID"};
  for (const char* text : {"VARIABLES = \"x [mm]\" \"y\" \"z\" \"trackID\"\nZONE",
                           "VARIABLES=\"x [mm]\",\"y\",\"z\",\"trackID\"",
                           "variables = \"x [mm]\"\n\"y\"\n# comment\n\"z\"\r\n\"trackID\"\r\nzone I=1",
                           "VARIABLES = x [mm], y, z, trackID\nZONE I=1", "VARIABLES = x [mm] y z trackID\n",
                           "VARIABLES = x [mm] y z trackID ZONE I=1",
                           "TITLE=\"a ZONE b\"\nVARIABLES = x [mm],\ny,\nz,\ntrackID\n",
                           "\xEF\xBB\xBFVARIABLES = \"x [mm]\" \"y\" \"z\" \"trackID\"\nFILETYPE=FULL\n"})
    EXPECT_EQ(parseTecplotHeader(text).variables, expected) << text;
}

TEST(TecplotHeader, MissingValuesAndSeveralZones) {
  const TecplotHeader h = parseTecplotHeader(
      "ZONE T=1200 I=0\nZONE T=\"a\", SOLUTIONTIME=None\nI=abc\nZONE SOLUTIONTIME=nan J=3 K=2\n");
  ASSERT_EQ(h.zones.size(), 3u);
  EXPECT_EQ(h.zones[0].title, "1200");
  EXPECT_EQ(h.zones[0].rows, 0);
  EXPECT_EQ(h.zones[1].rows, -1);
  EXPECT_TRUE(std::isnan(h.zones[1].time) && std::isnan(h.zones[2].time));
  EXPECT_EQ(h.zones[2].j, 3);
  EXPECT_EQ(h.zones[2].k, 2);
  EXPECT_FALSE(h.hasVariables);
}

TEST(TecplotHeader, DamageIsNamed) {
  const TecplotHeader h = parseTecplotHeader("ZONE I=3\nabc 1.0 2.0\n");
  ASSERT_EQ(h.zones.size(), 1u);
  EXPECT_NE(h.zones[0].problem.find("\"abc\""), std::string::npos);
  EXPECT_EQ(h.zones[0].problemOffset, 9u);
  for (const char* text : {"", "ZONE", "VARIABLES", "VARIABLES=", "ZONE T=\"", "ZONE DT=(", "=", "\"",
                           "ZONE =", "ZONE I=", ",,,"})
    EXPECT_NO_THROW(parseTecplotHeader(text)) << text;
}

TEST(TecplotHeader, TellsRowsFromHeaders) {
  for (const char* row : {"1 2", "-1", "+1", ".5", "  \t7", "nan 1", "-inf", ",1", "Infinity 2"})
    EXPECT_TRUE(looksLikeRow(row)) << row;
  for (const char* other : {"", "ZONE", "I=1", "\"x\"", "# 1", "abc", "nan = 3", "information"})
    EXPECT_FALSE(looksLikeRow(other)) << other;
  for (const char* record : {"ZONE", "zone T=1", " Zone", "TITLE=", "VARIABLES =", "\xEF\xBB\xBFTITLE"})
    EXPECT_TRUE(beginsTecplotRecord(record)) << record;
  for (const char* other : {"ZONES", "ZONE1", "1 ZONE", "", "I=1", "zonetype=ordered"})
    EXPECT_FALSE(beginsTecplotRecord(other)) << other;
}
