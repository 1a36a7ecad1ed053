#include "TrackTableLayout.h"

#include <algorithm>

namespace rimflow {
namespace {

using Target = TrackColumnPlan::Target;

void skip(TrackColumnPlan& plan, std::size_t column) {
  TrackColumnPlan::Column& c = plan.columns[column];
  if (c.target == Target::Further) {
    plan.furtherNames.erase(plan.furtherNames.begin() + c.index);
    for (TrackColumnPlan::Column& other : plan.columns)
      if (other.target == Target::Further && other.index > c.index) --other.index;
  }
  c.target = Target::Skip;
}

} // namespace

TrackColumnPlan outputPlan(const TrackTableLayout& layout, LengthUnit unit) {
  TrackColumnPlan plan = planTrackColumns(layout.columns, unit);
  plan.delimiter = layout.delimiter;
  plan.hasText = layout.delimiter &&
                 std::find(layout.ignored.begin(), layout.ignored.end(), true) != layout.ignored.end();
  for (std::size_t c = 0; c < layout.ignored.size(); ++c)
    if (layout.ignored[c]) skip(plan, c);
  if (layout.frame >= 0) skip(plan, std::size_t(layout.frame));
  // Many formats have positions only: velocities can be had from the tracks, so this is no news.
  const auto aboutVelocities = [](const std::string& w) {
    return w.rfind("there are no velocities", 0) == 0;
  };
  plan.warnings.erase(std::remove_if(plan.warnings.begin(), plan.warnings.end(), aboutVelocities),
                      plan.warnings.end());
  for (std::string& w : plan.warnings)
    if (!layout.withoutIds.empty() && w.rfind("there is no column trackID", 0) == 0) w = layout.withoutIds;
  const auto inOurWords = [](std::string& message) {
    if (const std::size_t p = message.find("VARIABLES"); p != message.npos) message.replace(p, 9, "columns");
  };
  inOurWords(plan.error);
  std::for_each(plan.warnings.begin(), plan.warnings.end(), inOurWords);
  if (layout.perFrame && plan.error.empty()) {
    const double metres = unit == LengthUnit::Auto ? unitInSI(plan.lengthUnit, 0).value_or(1e-3)
                                                   : planTrackColumns({"x", "y", "z"}, unit).columns[0].scale;
    for (TrackColumnPlan::Column& c : plan.columns)
      if (c.target == Target::Velocity || c.target == Target::Acceleration) c.scale = metres;
    if (plan.hasVelocity) plan.velocityUnit = plan.lengthUnit + "/frame";
    if (plan.hasAcceleration) plan.accelerationUnit = plan.lengthUnit + "/frame^2";
  }
  return plan;
}

TrackColumnPlan rawPlan(const TrackTableLayout& layout) {
  TrackColumnPlan plan = outputPlan(layout, LengthUnit::Metre);
  for (TrackColumnPlan::Column& c : plan.columns) c.scale = 1;
  if (layout.frame >= 0) {
    TrackColumnPlan::Column& c = plan.columns[std::size_t(layout.frame)];
    c.target = Target::Further;
    c.index = int(plan.furtherNames.size());
    c.clock = true;
    plan.furtherNames.push_back("frame");
  }
  return plan;
}

} // namespace rimflow
