#include "TrackRows.h"

#include "PlainDecimal.h"
#include "TableHead.h"
#include "TecplotHeader.h"
#include "TrackTimeline.h"

#include <algorithm>
#include <array>
#include <atomic>
#include <charconv>
#include <cmath>
#include <cstring>
#include <fast_float/fast_float.h>
#include <limits>
#include <omp.h>
#include <string>
#include <vector>

namespace rimflow {
namespace {

using Fault = TrackRowsResult::Fault;
using Target = TrackColumnPlan::Target;

struct Separators {
  std::array<bool, 256> table{};
  constexpr Separators() {
    for (const char c : {' ', '\t', ',', ';', '\r'}) table[static_cast<unsigned char>(c)] = true;
  }
  bool operator[](char c) const { return table[static_cast<unsigned char>(c)]; }
};
constexpr Separators isSeparator;

// Tokens end at a separator or at the line's end, and every line here has one.
bool endsToken(char c) { return isSeparator[c] || c == '\n'; }
const char* endOfToken(const char* p) {
  while (!endsToken(*p)) ++p;
  return p;
}

// What fast_float does not take: a leading plus, Fortran's exponent D, the NaN of old C libraries (1.#IND),
// and numbers too large or too small for a double.
bool unusualNumber(const char*& p, double& x) {
  const char* stop = endOfToken(p);
  std::string token(p, std::min<std::ptrdiff_t>(stop - p, 64));
  if (stop - p > 64) return false;
  if (token.size() > 1 && token[0] == '+' && token[1] != '-' && token[1] != '+') token.erase(0, 1);
  if (token.find('#') != token.npos) {
    const std::size_t sign = token[0] == '-';
    if (token.compare(sign, 3, "1.#") != 0) return false;
    x = std::numeric_limits<double>::quiet_NaN();
    p = stop;
    return true;
  }
  const std::size_t d = token.find_first_of("dD");
  if (d != token.npos && token.find_first_not_of("0123456789.+-dD") == token.npos) token[d] = 'e';
  const auto r = fast_float::from_chars(token.data(), token.data() + token.size(), x);
  if ((r.ec != std::errc() && r.ec != std::errc::result_out_of_range) || r.ptr != token.data() + token.size())
    return false;
  p = stop;
  return true;
}

inline bool number(const char*& p, const char* end, double& x) {
  if (end - p >= plainDecimalReach) {
    const char* after = plainDecimal(p, x);
    if (after && endsToken(*after)) {
      p = after;
      return true;
    }
  }
  const auto r = fast_float::from_chars(p, end, x);
  if (r.ec == std::errc() && endsToken(*r.ptr)) {
    p = r.ptr;
    return true;
  }
  return unusualNumber(p, x);
}

// An id may have been written as 7, +7, 7.0 or 1.2e4; as a double it is exact up to 2^53.
enum class IdResult { Good, NotFinite, Bad };
IdResult trackId(const char*& p, const char* end, std::int64_t& id) {
  if (end - p >= plainDecimalReach) {
    const char* after = plainInteger(p, id);
    if (after && endsToken(*after)) {
      p = after;
      return IdResult::Good;
    }
  }
  const auto r = std::from_chars(p, end, id);
  if (r.ec == std::errc() && endsToken(*r.ptr)) {
    p = r.ptr;
    return IdResult::Good;
  }
  double x = 0;
  const char* after = p;
  if (!number(after, end, x)) return IdResult::Bad;
  if (!std::isfinite(x)) {
    p = after;
    return IdResult::NotFinite;
  }
  if (x != std::floor(x) || std::abs(x) > 9007199254740992.0) return IdResult::Bad;
  id = std::int64_t(x);
  p = after;
  return IdResult::Good;
}

// Where the values of a column go: element `index` of every group of `stride`.
struct Field {
  enum class Kind { Skip, Float, Intensity, Id, Double, Clock } kind = Kind::Skip; // Clock: a frame or time
  double scale = 1;
  void* to = nullptr;
  std::size_t stride = 1;
};

// Whole lines, the last one with its '\n', so that no loop below needs to look for the end of the text.
struct Chunk {
  const char* begin;
  const char* end;
  const char* origin;       // begin stands for this place in the file's text
  const char* endlessLine;  // a line that has no end within reach begins here; null: none
  std::size_t firstRow = 0; // in the arrays
  std::size_t kept = 0;
  TrackRowsResult result;
};

const char* endOfLine(const char* p, const char* end) {
  const std::size_t room = std::min<std::size_t>(std::size_t(end - p), longestTrackLine + 1);
  const void* newline = std::memchr(p, '\n', room);
  return newline ? static_cast<const char*>(newline) : p + room;
}

// Rows, or lines without any value and comments: an upper limit, at the speed of memory.
std::size_t countLines(const Chunk& c) {
  std::size_t lines = 0;
  const char* p = c.begin;
  for (; c.end - p >= 128; p += 128) {
    unsigned char here = 0; // a narrow sum keeps this loop in vector registers
    for (int i = 0; i < 128; ++i) here = static_cast<unsigned char>(here + (p[i] == '\n'));
    lines += here;
  }
  return lines + std::size_t(std::count(p, c.end, '\n'));
}

std::size_t countRows(const Chunk& c) {
  std::size_t rows = 0;
  for (const char* p = c.begin; p < c.end; ++p) {
    while (isSeparator[*p]) ++p;
    rows += *p != '\n' && *p != '#';
    p = static_cast<const char*>(std::memchr(p, '\n', std::size_t(c.end - p)));
  }
  return rows;
}

// What a row is found to be, and where the fault is.
struct RowFault {
  Fault fault = Fault::None;
  const char* where = nullptr;
  std::size_t column = 0;
};

// Reads the values at p into row `row` of the arrays, and leaves p at the line's end if all is well.
inline RowFault parseRow(const char*& p, const char* end, const Field* fields, std::size_t columns,
                         std::size_t row, bool& finite) {
  const char* const line = p;
  for (std::size_t f = 0; f < columns; ++f) {
    const Field& field = fields[f];
    while (isSeparator[*p]) ++p;
    if (*p == '\n') return {Fault::TooFew, line, f};
    double x = 0;
    switch (field.kind) {
    case Field::Kind::Skip:
      p = endOfToken(p);
      break;
    case Field::Kind::Float: {
      if (!number(p, end, x)) return {Fault::NotANumber, p, f};
      const float value = float(x * field.scale);
      finite = finite && std::isfinite(value);
      static_cast<float*>(field.to)[row * field.stride] = value;
      break;
    }
    case Field::Kind::Intensity:
      if (!number(p, end, x)) return {Fault::NotANumber, p, f};
      static_cast<float*>(field.to)[row] = float(x);
      break;
    case Field::Kind::Clock:
    case Field::Kind::Double:
      if (!number(p, end, x)) return {Fault::NotANumber, p, f};
      finite = finite && (field.kind == Field::Kind::Double || std::abs(x) <= largestTime);
      static_cast<double*>(field.to)[row] = x * field.scale;
      break;
    case Field::Kind::Id: {
      const IdResult id = trackId(p, end, static_cast<std::int64_t*>(field.to)[row]);
      if (id == IdResult::Bad) return {Fault::NotAnId, p, f};
      finite = finite && id == IdResult::Good;
      break;
    }
    }
  }
  while (isSeparator[*p]) ++p;
  return *p == '\n' ? RowFault{} : RowFault{Fault::TooMany, line, 0};
}

// The same for a row of a table with this delimiter in which values are missing, in quotes, or text with
// blanks: exactly one value between two delimiters. False when it is no such row.
bool parseRowWithGaps(const char* line, const char* lineEnd, char delimiter, const std::vector<Field>& fields,
                      std::size_t row, bool& finite) {
  std::vector<std::string_view> values = valuesBetween({line, std::size_t(lineEnd - line)}, delimiter);
  if (values.size() == fields.size() + 1 && values.back().empty()) values.pop_back();
  if (values.size() != fields.size()) return false;
  finite = true;
  for (std::size_t f = 0; f < fields.size(); ++f) {
    const Field& field = fields[f];
    if (field.kind == Field::Kind::Skip) continue;
    const std::string token = (isMissing(values[f]) ? "nan" : std::string(values[f])) + '\n';
    const char *p = token.data(), *const end = p + token.size();
    if (parseRow(p, end, &field, 1, row, finite).fault != Fault::None || p + 1 != end) return false;
  }
  return true;
}

// Separators other than the delimiter could hide that a value is missing: blanks in texts, decimal commas.
// Only these two cases need a look at every row.
bool strictly(const TrackColumnPlan& plan) {
  return plan.delimiter == ';' || (plan.delimiter && plan.hasText);
}
bool hasOtherSeparators(const char* line, const char* lineEnd, const TrackColumnPlan& plan) {
  const std::size_t bytes = std::size_t(lineEnd - line);
  return (plan.delimiter == ';' && std::memchr(line, ',', bytes)) ||
         (plan.hasText && (std::memchr(line, ' ', bytes) || std::memchr(line, '\t', bytes)));
}

const char* lineEndOf(const char* line, const char* end) {
  return static_cast<const char*>(std::memchr(line, '\n', std::size_t(end - line)));
}

// Reads the rows of a chunk into the arrays; `advance` is 0 when only the first fault is looked for.
void parseChunk(Chunk& chunk, const char* text, const TrackColumnPlan& plan, const std::vector<Field>& fields,
                std::size_t advance, const std::atomic<bool>& stopped) {
  TrackRowsResult& result = chunk.result;
  const auto offset = [&](const char* p) { return std::size_t(chunk.origin + (p - chunk.begin) - text); };
  const auto fault = [&](const RowFault& f) {
    result.fault = f.fault;
    result.offset = offset(f.where);
    result.column = f.column;
  };
  std::size_t row = chunk.firstRow;
  const char* const end = chunk.end;
  for (const char* p = chunk.begin; p < end; ++p) {
    const char* const begin = p;
    while (isSeparator[*p]) ++p;
    if (*p == '\n') continue;
    const char* const line = p;
    if (*p == '#') {
      p = lineEndOf(p, end);
      continue;
    }
    bool finite = true;
    RowFault found;
    const char* const lineEnd = strictly(plan) ? lineEndOf(line, end) : nullptr;
    const bool strict = lineEnd && hasOtherSeparators(line, lineEnd, plan);
    if (strict && parseRowWithGaps(begin, lineEnd, plan.delimiter, fields, row, finite)) {
      p = lineEnd;
    } else {
      found = parseRow(p, end, fields.data(), fields.size(), row, finite);
      if (strict && found.fault == Fault::None) found = {Fault::TooMany, line, 0};
    }
    if (found.fault != Fault::None) {
      p = lineEndOf(line, end);
      if (!plan.delimiter || strict || !parseRowWithGaps(begin, p, plan.delimiter, fields, row, finite))
        return fault(found);
    }
    ++result.rows;
    if (finite) {
      row += advance;
      ++chunk.kept;
    } else if (result.notFinite++ == 0) {
      result.firstNotFinite = offset(line);
    }
    if ((result.rows & 4095) == 0 && stopped.load(std::memory_order_relaxed)) return;
  }
  if (chunk.endlessLine) fault({Fault::TooLong, chunk.endlessLine, 0});
}

// Looks at the whole row of a fault: it may be a header that stands where none was expected, and a wrong
// number of values says more than the value that ended up in the wrong column.
void lookAtRow(TrackRowsResult& result, std::string_view text, std::size_t columns) {
  if (result.fault == Fault::None || result.fault == Fault::TooLong) return;
  const std::size_t newline = result.offset == 0 ? text.npos : text.rfind('\n', result.offset - 1);
  const std::size_t line = newline == text.npos ? 0 : newline + 1;
  if (beginsTecplotRecord(text.substr(line, 64))) {
    result.fault = Fault::HeaderInside;
    result.offset = line;
    return;
  }
  const char* p = text.data() + line;
  const std::string row(p, endOfLine(p, text.data() + text.size()));
  for (const char* q = row.c_str(); q < row.c_str() + row.size();) {
    while (isSeparator[*q]) ++q;
    if (*q == '\0' && q == row.c_str() + row.size()) break;
    ++result.values;
    while (q < row.c_str() + row.size() && !isSeparator[*q]) ++q;
  }
  if (result.values == columns) return;
  result.fault = result.values < columns ? Fault::TooFew : Fault::TooMany;
  result.offset = line;
}

template <class T>
void moveRows(std::vector<T>& values, std::size_t width, std::size_t to, std::size_t from, std::size_t rows) {
  if (!values.empty() && to != from)
    std::memmove(values.data() + to * width, values.data() + from * width, rows * width * sizeof(T));
}

struct Arrays {
  TrackSnapshot& s;
  const TrackColumnPlan& plan;
  bool idsOnly;

  void resize(std::size_t rows) {
    if (plan.hasTrackId) s.trackId.resize(rows);
    if (idsOnly) return;
    s.position.resize(3 * rows);
    if (plan.hasVelocity) s.velocity.resize(3 * rows);
    if (plan.hasAcceleration) s.acceleration.resize(3 * rows);
    if (plan.hasIntensity) s.intensity.resize(rows);
    s.further.resize(plan.furtherNames.size());
    for (std::size_t f = 0; f < s.further.size(); ++f) {
      s.further[f].name = plan.furtherNames[f];
      s.further[f].values.resize(rows);
    }
  }
  void move(std::size_t to, std::size_t from, std::size_t rows) {
    moveRows(s.trackId, 1, to, from, rows);
    moveRows(s.position, 3, to, from, rows);
    moveRows(s.velocity, 3, to, from, rows);
    moveRows(s.acceleration, 3, to, from, rows);
    moveRows(s.intensity, 1, to, from, rows);
    for (TrackColumn& c : s.further) moveRows(c.values, 1, to, from, rows);
  }
  std::vector<Field> fields() {
    std::vector<Field> all;
    for (const TrackColumnPlan::Column& c : plan.columns) {
      Field f;
      f.scale = c.scale;
      const auto vector = [&](std::vector<float>& to) {
        f.kind = Field::Kind::Float;
        f.to = to.data() + c.index;
        f.stride = 3;
      };
      if (c.target == Target::TrackId) {
        f.kind = Field::Kind::Id;
        f.to = s.trackId.data();
      } else if (!idsOnly) {
        if (c.target == Target::Position) vector(s.position);
        if (c.target == Target::Velocity) vector(s.velocity);
        if (c.target == Target::Acceleration) vector(s.acceleration);
        if (c.target == Target::Intensity) {
          f.kind = Field::Kind::Intensity;
          f.to = s.intensity.data();
        }
        if (c.target == Target::Further) {
          f.kind = c.clock ? Field::Kind::Clock : Field::Kind::Double;
          f.to = s.further[std::size_t(c.index)].values.data();
        }
      }
      all.push_back(f);
    }
    return all;
  }
};

// `lastLine` keeps the last line when the text ends without a '\n'.
std::vector<Chunk> splitAtLines(std::string_view text, std::string& lastLine) {
  constexpr std::size_t usual = 1 << 18;
  std::vector<Chunk> chunks;
  const char* const end = text.data() + text.size();
  for (const char* p = text.data(); p < end;) {
    Chunk c{p, std::size_t(end - p) <= usual ? end : endOfLine(p + usual, end), p, nullptr, 0, 0, {}};
    if (c.end < end && *c.end == '\n') ++c.end;
    const void* newline = ::memrchr(p, '\n', std::size_t(c.end - p));
    const char* const lines = newline ? static_cast<const char*>(newline) + 1 : p; // end of the whole lines
    if (lines == c.end) {
      chunks.push_back(c);
      p = c.end;
      continue;
    }
    const char* const rest = lines;
    if (c.end == end && std::size_t(end - rest) <= longestTrackLine) {
      c.end = lines;
      chunks.push_back(c);
      lastLine.assign(rest, end);
      lastLine += '\n';
      chunks.push_back({lastLine.data(), lastLine.data() + lastLine.size(), rest, nullptr, 0, 0, {}});
    } else {
      c.end = lines;
      c.endlessLine = rest;
      chunks.push_back(c);
    }
    break;
  }
  return chunks;
}

} // namespace

TrackRowsResult readTrackRows(std::string_view text, const TrackColumnPlan& plan, bool idsOnly,
                              TrackSnapshot& snapshot, const Progress& progress) {
  snapshot = {};
  std::string lastLine;
  std::vector<Chunk> chunks = splitAtLines(text, lastLine);
  const int n = int(chunks.size());
  const int threads = std::max(1, std::min(n, omp_get_max_threads()));

  // A whole row has at least two bytes per value, or one where values may be missing. More rows than that
  // cannot be whole: then nothing is stored, and only the first fault is looked for, so that a damaged file
  // cannot ask for more memory than its own size.
  const std::size_t leastBytes = (plan.delimiter ? 1 : 2) * plan.columns.size();
  bool store = true;
  std::size_t rows = 0;
  for (Chunk& c : chunks) {
    const std::size_t whole = std::size_t(c.end - c.begin) / leastBytes;
    std::size_t count = countLines(c);
    if (count > whole) count = countRows(c);
    store = store && count <= whole;
    c.firstRow = rows;
    rows += count;
  }
  Arrays arrays{snapshot, plan, idsOnly};
  arrays.resize(store ? std::max<std::size_t>(rows, 1) : 1); // fields point into the arrays
  const std::vector<Field> fields = arrays.fields();
  std::atomic<bool> stopped{false};
  std::atomic<int> done{0}, faulty{n}; // faulty: the first chunk known to have a fault
  if (!store)
    for (Chunk& c : chunks) c.firstRow = 0;

#pragma omp parallel num_threads(threads) if (threads > 1 && store)
  {
#pragma omp for schedule(dynamic, 1)
    for (int c = 0; c < n; ++c) {
      // Only what comes after a fault is left out: a thread may be late with a chunk before it.
      if (stopped || c > faulty) continue;
      parseChunk(chunks[std::size_t(c)], text.data(), plan, fields, store ? 1 : 0, stopped);
      if (chunks[std::size_t(c)].result.fault != Fault::None)
        for (int first = faulty; c < first && !faulty.compare_exchange_weak(first, c);) {
        }
      const int finished = ++done;
      if (omp_get_thread_num() == 0 && !goOn(progress, double(finished) / n)) stopped = true;
    }
  }

  TrackRowsResult result;
  std::size_t kept = 0;
  for (const Chunk& c : chunks) {
    if (c.result.fault != Fault::None) {
      const std::int64_t before = result.rows;
      result = c.result;
      result.rows += before;
      break;
    }
    if (c.result.notFinite > 0 && result.notFinite == 0) result.firstNotFinite = c.result.firstNotFinite;
    result.notFinite += c.result.notFinite;
    result.rows += c.result.rows;
    arrays.move(kept, c.firstRow, c.kept);
    kept += c.kept;
  }
  lookAtRow(result, text, fields.size());
  result.aborted = stopped && result.fault == Fault::None;
  if (stopped || result.fault != Fault::None)
    snapshot = {};
  else
    arrays.resize(kept);
  return result;
}

} // namespace rimflow
