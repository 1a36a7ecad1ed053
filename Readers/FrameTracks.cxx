#include "FrameTracks.h"

#include "TrackMessages.h"
#include "TrackRows.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <limits>
#include <numeric>

namespace rimflow {
namespace {

constexpr std::size_t mostFrames = 1000000;
const char* const noRows =
    "there is no row of numbers after the header. Export the tracks again if there should be.";

// The end of a block of whole lines that begins at p; where a line has no end within reach, one byte more
// than the longest line.
std::size_t endOfBlock(std::string_view text, std::size_t p, std::size_t bytes) {
  if (text.size() - p <= bytes) return text.size();
  const std::size_t room = std::min(text.size() - p - bytes, longestTrackLine + 1);
  const void* newline = std::memchr(text.data() + p + bytes, '\n', room);
  return newline ? std::size_t(static_cast<const char*>(newline) - text.data()) + 1 : p + bytes + room;
}

struct Separators {
  std::array<bool, 256> table{};
  constexpr Separators() {
    for (const char c : {' ', '\t', ',', ';', '\r', '\n'}) table[static_cast<unsigned char>(c)] = true;
  }
  bool operator[](char c) const { return table[static_cast<unsigned char>(c)]; }
};
constexpr Separators isSeparator;

// A block of values without line ends as rows: every `columns`-th separator becomes a line end. A line end
// elsewhere is left, so that a row with a wrong number of values cannot shift all that follow. The block ends
// with a whole row, and byte n of the result stands for byte p + n of the text.
std::string asRows(std::string_view text, std::size_t p, std::size_t bytes, std::size_t columns) {
  std::string rows(text.substr(p, bytes + longestTrackLine + 1));
  std::size_t values = 0;
  bool inValue = false;
  for (std::size_t i = 0; i < rows.size(); ++i) {
    if (!isSeparator[rows[i]]) {
      inValue = true;
      continue;
    }
    values += inValue;
    const bool whole = (inValue && values == columns) || (rows[i] == '\n' && values > 0);
    rows[i] = whole ? '\n' : ',';
    inValue = false;
    if (!whole) continue;
    values = 0;
    if (i + 1 >= bytes) rows.resize(i + 1);
  }
  return rows;
}

template <std::size_t width, class T>
void permute(std::vector<T>& values, const std::vector<std::uint32_t>& order) {
  if (values.empty()) return;
  std::vector<T> sorted(values.size());
  for (std::size_t i = 0; i < order.size(); ++i)
    for (std::size_t c = 0; c < width; ++c) sorted[width * i + c] = values[width * order[i] + c];
  values = std::move(sorted);
}

void permute(TrackSnapshot& s, const std::vector<std::uint32_t>& order) {
  permute<3>(s.position, order);
  permute<3>(s.velocity, order);
  permute<3>(s.acceleration, order);
  permute<1>(s.intensity, order);
  permute<1>(s.trackId, order);
  for (TrackColumn& c : s.further) permute<1>(c.values, order);
}

bool sameArrays(const TrackColumnPlan& a, const TrackColumnPlan& b) {
  return a.hasVelocity == b.hasVelocity && a.hasAcceleration == b.hasAcceleration &&
         a.hasIntensity == b.hasIntensity && a.hasTrackId == b.hasTrackId &&
         a.furtherNames == b.furtherNames && a.lengthUnit == b.lengthUnit &&
         a.velocityUnit == b.velocityUnit && a.accelerationUnit == b.accelerationUnit &&
         a.error.empty() == b.error.empty();
}

// To SI. A vector that is then beyond single precision becomes NaN; returns how many.
std::size_t scale(std::vector<float>& values, const TrackColumnPlan& plan, TrackColumnPlan::Target target,
                  double rate) {
  double factor[3] = {1, 1, 1};
  for (const TrackColumnPlan::Column& c : plan.columns)
    if (c.target == target) factor[c.index] = c.scale * rate;
  for (std::size_t i = 0; i < values.size(); ++i) values[i] = float(double(values[i]) * factor[i % 3]);
  std::size_t tooLarge = 0;
  for (std::size_t i = 0; i < values.size(); i += 3) {
    float* v = &values[i];
    if (!std::isinf(v[0]) && !std::isinf(v[1]) && !std::isinf(v[2])) continue;
    v[0] = v[1] = v[2] = std::numeric_limits<float>::quiet_NaN();
    ++tooLarge;
  }
  return tooLarge;
}

// Where both vectors are zero, there is none.
void zeroToNaN(TrackSnapshot& s) {
  const bool both = !s.acceleration.empty();
  for (std::size_t p = 0; 3 * p < s.velocity.size(); ++p) {
    const auto zero = [p](const std::vector<float>& v) {
      return v[3 * p] == 0 && v[3 * p + 1] == 0 && v[3 * p + 2] == 0;
    };
    if (!zero(s.velocity) || (both && !zero(s.acceleration))) continue;
    for (std::size_t c = 3 * p; c < 3 * p + 3; ++c) {
      s.velocity[c] = std::numeric_limits<float>::quiet_NaN();
      if (both) s.acceleration[c] = std::numeric_limits<float>::quiet_NaN();
    }
  }
}

} // namespace

FrameTracks::FrameTracks(TrackTableFormat format, const Options& options)
    : format(std::move(format)), options(options), store(options.memoryLimit) {}

const std::string& FrameTracks::fileOf(std::size_t snapshot) const {
  return texts.paths()[frames.at(snapshot).runs.front().file];
}

std::string FrameTracks::nameOf(std::size_t snapshot) const {
  return fileOf(snapshot) + (layouts.front().secondsPerUnit > 0 ? ", time " : ", frame ") +
         shortNumber(frames[snapshot].number) + ": ";
}

const TrackColumnPlan& FrameTracks::columns(std::size_t, LengthUnit unit) const {
  const auto found = plans.find(unit);
  return found != plans.end() ? found->second
                              : plans.emplace(unit, outputPlan(layouts.front(), unit)).first->second;
}

std::size_t FrameTracks::frameOf(double number) {
  number += 0.; // -0 is 0
  std::uint64_t bits;
  std::memcpy(&bits, &number, sizeof bits);
  bits ^= bits >> 32; // the low bits of whole numbers are all zero, and the table needs some that differ
  std::int32_t& slot = frameNumbers[std::int64_t(bits)];
  if (slot == IdTable::none) {
    slot = std::int32_t(frames.size());
    frames.push_back({number, {}});
  }
  return std::size_t(slot);
}

// Sorts rows by frame (a counting sort, so that rows of a frame keep their order) and stores them.
void FrameTracks::putAway(std::size_t file, TrackSnapshot&& rows) {
  if (rows.size() == 0) return;
  const std::vector<double> number = std::move(rows.further.back().values);
  rows.further.pop_back();
  std::vector<std::uint32_t> frame(number.size()), order(number.size());
  double last = NAN;
  for (std::size_t r = 0; r < number.size(); ++r) {
    frame[r] = r > 0 && number[r] == last ? frame[r - 1] : std::uint32_t(frameOf(number[r]));
    last = number[r];
  }
  if (frames.size() > mostFrames)
    throw std::runtime_error(texts.paths()[file] + ": more than a million different " +
                             (layouts[file].secondsPerUnit > 0 ? "times" : "frame numbers") +
                             ". Check the column, or open fewer files at a time.");
  std::vector<std::uint32_t> begin(frames.size() + 1, 0);
  for (const std::uint32_t f : frame) ++begin[f + 1];
  std::partial_sum(begin.begin(), begin.end(), begin.begin());
  std::vector<std::uint32_t> next(begin.begin(), begin.end() - 1);
  for (std::size_t r = 0; r < frame.size(); ++r) order[next[frame[r]]++] = std::uint32_t(r);
  permute(rows, order);
  for (std::int64_t& id : rows.trackId) {
    if (id < 0) continue;
    if (firstId < 0 || __builtin_add_overflow(id, firstId, &id))
      throw std::runtime_error(texts.paths()[file] +
                               ": the track ids are too large to be made different from "
                               "those of the other files. Open the files one by one.");
    lastId = std::max(lastId, id);
  }
  const std::size_t segment = store.add(std::move(rows));
  for (std::size_t f = 0; f < frames.size(); ++f)
    if (begin[f + 1] > begin[f]) frames[f].runs.push_back({file, segment, begin[f], begin[f + 1] - begin[f]});
}

bool FrameTracks::readFile(std::size_t file, const Progress& progress) {
  using Fault = TrackRowsResult::Fault;
  const auto source = texts.first(file, progress);
  if (!source) return false;
  const std::string_view text = source->text();
  const auto fail = [&](std::size_t offset, const std::string& what) {
    throw std::runtime_error(texts.at(file, offset) + what);
  };
  const std::string& path = texts.paths()[file];
  try {
    layouts.push_back(format.layout(text.substr(0, trackHeadBytes)));
  } catch (const std::runtime_error& e) {
    throw std::runtime_error(path + ", " + e.what());
  }
  const TrackTableLayout& layout = layouts.back();
  for (const std::string& w : layout.warnings) notes.push_back(path + ": " + w);
  const TrackTableLayout& other = layouts.front();
  if (layout.frame < 0 || layout.secondsPerUnit != other.secondsPerUnit ||
      !sameArrays(outputPlan(other, LengthUnit::Auto), outputPlan(layout, LengthUnit::Auto)))
    throw std::runtime_error(path + ", line 1: other columns than in " + texts.paths()[0] +
                             ". Open files with the same columns together, others one by one.");
  const TrackColumnPlan plan = rawPlan(layout);
  std::int64_t rows = 0, notFinite = 0;
  std::size_t firstNotFinite = 0;
  for (std::size_t p = layout.rows; p < text.size();) {
    std::string converted;
    std::string_view block;
    if (layout.oneLine)
      block = converted = asRows(text, p, options.blockBytes, plan.columns.size());
    else
      block = text.substr(p, endOfBlock(text, p, options.blockBytes) - p);
    const std::size_t end = p + block.size();
    TrackSnapshot particles;
    TrackRowsResult r = readTrackRows(block, plan, false, particles);
    const std::size_t offset = p + r.offset;
    const bool lastLine = end == text.size() && block.find('\n', r.offset) == block.npos;
    if (lastLine && (r.fault == Fault::TooFew || r.fault == Fault::NotANumber || r.fault == Fault::NotAnId)) {
      const std::size_t newline = block.rfind('\n', r.offset);
      const std::size_t whole = newline == block.npos ? 0 : newline + 1;
      notes.push_back(texts.at(file, offset) +
                      "the file ends in the middle of a row; it is read up to here, and what is missing may "
                      "belong to any snapshot. Copy or export the file again.");
      r = readTrackRows(block.substr(0, whole), plan, false, particles);
    }
    if (r.fault != Fault::None)
      fail(offset, (layout.oneLine ? "byte " + std::to_string(offset + 1) + ": " : std::string()) +
                       rowFault(r, block, r.offset, plan, layout.expected));
    if (r.notFinite > 0 && notFinite == 0) firstNotFinite = p + r.firstNotFinite;
    notFinite += r.notFinite;
    rows += r.rows;
    putAway(file, std::move(particles));
    source->release(p, end);
    p = end;
    if (!goOn(progress, double(p) / double(text.size()))) return false;
  }
  if (rows == 0) notes.push_back(path + ", line 1: " + noRows);
  if (notFinite > 0)
    notes.push_back(texts.at(file, firstNotFinite) + notFiniteWarning(notFinite, rows, "this file"));
  return true;
}

bool FrameTracks::open(std::vector<std::string> files, const Progress& progress, bool) {
  *this = FrameTracks(format, options);
  try {
    texts = TrackTexts(std::move(files));
    bool done = true;
    for (std::size_t f = 0; f < texts.size() && done; ++f) {
      const bool none = lastId == std::numeric_limits<std::int64_t>::max(); // no id is left for this file
      firstId = !format.idsRestart ? 0 : none ? -1 : lastId + 1;
      done = readFile(
          f, [&](double fraction) { return goOn(progress, (double(f) + fraction) / double(texts.size())); });
    }
    if (done && frames.empty())
      throw std::runtime_error(notes.empty() ? texts.paths()[0] + ", line 1: " + noRows : notes.front());
    if (!done) *this = FrameTracks(format, options);
    return done;
  } catch (...) {
    *this = FrameTracks(format, options);
    throw;
  }
}

TrackTimeline FrameTracks::timeline(const TrackTimeOptions& given, std::vector<std::string>& warnings) const {
  const double seconds = layouts.front().secondsPerUnit;
  const double unit = seconds > 0 ? seconds : given.framePeriod > 0 ? given.framePeriod : 1;
  std::vector<TrackTimeEntry> entries;
  for (const Frame& f : frames) {
    entries.emplace_back();
    entries.back().time = f.number * unit;
  }
  warnings.insert(warnings.end(), texts.notes().begin(), texts.notes().end());
  warnings.insert(warnings.end(), notes.begin(), notes.end());
  const auto first = std::min_element(frames.begin(), frames.end(),
                                      [](const Frame& a, const Frame& b) { return a.number < b.number; });
  if (seconds == 0 && given.framePeriod <= 0)
    warnings.push_back(texts.paths()[0] + ": the time is the frame number times " + framePeriodWords(0) +
                       ".");
  if (first->number < 0)
    warnings.push_back(nameOf(std::size_t(first - frames.begin())) +
                       "this is negative; it is kept. Set TimeShift or ShiftTimeToZero to move all times.");
  return arrangeTimes(entries, given);
}

bool FrameTracks::read(std::size_t snapshot, const TrackUnits& units, TrackSnapshot& particles,
                       std::vector<std::string>& warnings, const Progress& progress, Content content) const {
  using Target = TrackColumnPlan::Target;
  particles = {};
  const TrackTableLayout& layout = layouts.front();
  const TrackColumnPlan& plan = columns(snapshot, units.length);
  const bool idsOnly = content == Content::TrackIds;
  if (!plan.error.empty()) throw std::runtime_error(fileOf(snapshot) + ", line 1: " + plan.error + ".");
  if (layout.perFrame && plan.hasVelocity && units.framePeriod <= 0 && !idsOnly)
    throw std::runtime_error(
        fileOf(snapshot) + ", line 1: the velocities of a " + format.name +
        " file are per frame, and no FramePeriod is set. Set FramePeriod (the time between "
        "two frames, in s) to have them in m/s.");
  if (!goOn(progress, 0)) return false;
  for (const Run& run : frames.at(snapshot).runs)
    store.append(run.segment, run.begin, run.count, idsOnly, particles);
  const double rate = layout.perFrame && units.framePeriod > 0 ? 1 / units.framePeriod : 1;
  if (layout.zeroIsNone && !idsOnly) zeroToNaN(particles);
  scale(particles.position, plan, Target::Position, 1);
  const std::size_t tooLarge = scale(particles.velocity, plan, Target::Velocity, rate) +
                               scale(particles.acceleration, plan, Target::Acceleration, rate * rate);
  if (tooLarge > 0)
    warnings.push_back(nameOf(snapshot) + std::to_string(tooLarge) +
                       " velocities or accelerations are beyond single precision in SI, so they are NaN. "
                       "Check their units, and FramePeriod.");
  for (const TrackColumnPlan::Column& c : plan.columns)
    if (c.target == Target::Further && c.scale != 1 && !idsOnly)
      for (double& x : particles.further[std::size_t(c.index)].values) x *= c.scale;

  for (const std::string& w : plan.warnings) warnings.push_back(texts.paths()[0] + ": " + w + ".");
  if (const auto duplicates = duplicateIds(particles)) warnings.push_back(nameOf(snapshot) + *duplicates);
  return true;
}

} // namespace rimflow
