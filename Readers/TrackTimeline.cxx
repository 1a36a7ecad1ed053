#include "TrackTimeline.h"

#include <algorithm>
#include <cctype>
#include <charconv>
#include <cmath>
#include <numeric>

namespace rimflow {
namespace {

bool isDigit(char c) { return c >= '0' && c <= '9'; }

std::int64_t toNumber(const char* begin, const char* end) {
  std::int64_t n = -1;
  const auto r = std::from_chars(begin, end, n);
  return r.ec == std::errc() ? n : -1;
}

template <class Number>
bool allDifferent(const std::vector<TrackTimeEntry>& entries, Number number) {
  std::vector<std::int64_t> all;
  for (const TrackTimeEntry& e : entries) all.push_back(number(e));
  std::sort(all.begin(), all.end());
  return all.empty() || (all.front() >= 0 && std::adjacent_find(all.begin(), all.end()) == all.end());
}

// Time of the snapshot with this number, from (number, time) pairs sorted by number.
double placeBetween(const std::vector<std::pair<std::int64_t, double>>& known, std::int64_t number,
                    double period, bool periodGiven) {
  const auto after =
      std::lower_bound(known.begin(), known.end(), std::pair<std::int64_t, double>(number, -INFINITY));
  const bool inside = after != known.begin() && after != known.end();
  if (!inside && (periodGiven || known.size() < 2)) {
    const auto& nearest = after == known.end() ? known.back() : known.front();
    return nearest.second + double(number - nearest.first) * period;
  }
  const auto right = after == known.begin() ? known.begin() + 1
                     : after == known.end() ? known.end() - 1
                                            : after;
  const auto left = right - 1;
  return left->second +
         double(number - left->first) * (right->second - left->second) / double(right->first - left->first);
}

} // namespace

std::int64_t numberAtEnd(const std::string& title) {
  std::size_t end = title.find_last_not_of(" \t\r");
  end = end == title.npos ? 0 : end + 1;
  std::size_t begin = end;
  while (begin > 0 && isDigit(title[begin - 1])) --begin;
  if (begin == end || (begin > 0 && (title[begin - 1] == '.' || title[begin - 1] == ','))) return -1;
  return toNumber(title.data() + begin, title.data() + end);
}

std::int64_t numberOfFile(const std::string& path) {
  std::string name = path.substr(path.find_last_of('/') + 1);
  // Extensions are dropped from the end as long as they hold a letter: track.0012.dat.gz is number 12.
  for (std::size_t dot = name.rfind('.'); dot != name.npos && dot > 0; dot = name.rfind('.')) {
    const auto letter = [](unsigned char c) { return std::isalpha(c); };
    if (!std::any_of(name.begin() + std::ptrdiff_t(dot), name.end(), letter)) break;
    name.resize(dot);
  }
  std::size_t end = name.size();
  while (end > 0 && !isDigit(name[end - 1])) --end;
  std::size_t begin = end;
  while (begin > 0 && isDigit(name[begin - 1])) --begin;
  return begin == end ? -1 : toNumber(name.data() + begin, name.data() + end);
}

bool naturallyBefore(const std::string& a, const std::string& b) {
  std::size_t i = 0, j = 0;
  while (i < a.size() && j < b.size()) {
    if (!isDigit(a[i]) || !isDigit(b[j])) {
      if (a[i] != b[j]) return a[i] < b[j];
      ++i, ++j;
      continue;
    }
    while (i < a.size() && a[i] == '0') ++i;
    while (j < b.size() && b[j] == '0') ++j;
    std::size_t iEnd = i, jEnd = j;
    while (iEnd < a.size() && isDigit(a[iEnd])) ++iEnd;
    while (jEnd < b.size() && isDigit(b[jEnd])) ++jEnd;
    if (iEnd - i != jEnd - j) return iEnd - i < jEnd - j;
    const int order = a.compare(i, iEnd - i, b, j, jEnd - j);
    if (order != 0) return order < 0;
    i = iEnd, j = jEnd;
  }
  if ((i == a.size()) != (j == b.size())) return i == a.size();
  return a < b; // equal but for leading zeros
}

TrackTimeline arrangeTimes(const std::vector<TrackTimeEntry>& entries, const TrackTimeOptions& options) {
  using Source = TrackTimeline::Source;
  TrackTimeline line;
  const std::size_t n = entries.size();
  if (n == 0) return line;

  std::vector<double> times(n);
  std::vector<std::size_t> timed;
  for (std::size_t e = 0; e < n; ++e) {
    times[e] = entries[e].time;
    if (std::isfinite(times[e])) timed.push_back(e);
  }
  line.allTimesEqual =
      timed.size() > 1 && timed.size() == n &&
      std::all_of(timed.begin(), timed.end(), [&](std::size_t e) { return times[e] == times[0]; });
  if (line.allTimesEqual) timed.clear();
  line.withoutTime = n - timed.size();

  if (line.withoutTime > 0) {
    const auto file = [](const TrackTimeEntry& e) { return std::int64_t(e.file); };
    const auto titleNumber = [](const TrackTimeEntry& e) { return e.titleNumber; };
    const auto fileNumber = [](const TrackTimeEntry& e) { return e.fileNumber; };
    std::vector<std::int64_t> number(n);
    if (allDifferent(entries, titleNumber)) {
      line.source = Source::TitleNumber;
      std::transform(entries.begin(), entries.end(), number.begin(), titleNumber);
    } else if (allDifferent(entries, file) && allDifferent(entries, fileNumber)) {
      line.source = Source::FileNumber;
      std::transform(entries.begin(), entries.end(), number.begin(), fileNumber);
    } else {
      line.source = Source::Order;
      std::iota(number.begin(), number.end(), 0);
    }
    const bool periodGiven = options.framePeriod > 0;
    const double period = periodGiven ? options.framePeriod : 1.0;
    std::vector<std::pair<std::int64_t, double>> known;
    for (std::size_t e : timed) known.emplace_back(number[e], times[e]);
    std::sort(known.begin(), known.end());
    line.framePeriodMissing = !periodGiven && known.size() < 2;
    for (std::size_t e = 0; e < n; ++e)
      if (known.empty())
        times[e] = double(number[e]) * period;
      else if (!std::isfinite(times[e]))
        times[e] = placeBetween(known, number[e], period, periodGiven);
    if (!known.empty()) line.source = Source::PartlyFile;
  }

  std::vector<std::size_t> order(n);
  std::iota(order.begin(), order.end(), std::size_t(0));
  std::stable_sort(order.begin(), order.end(),
                   [&](std::size_t a, std::size_t b) { return times[a] < times[b]; });
  for (std::size_t e : order) {
    if (!line.times.empty() && times[e] == line.times.back()) {
      line.replaced.push_back(line.entries.back());
      line.replacedBy.push_back(e);
      line.entries.back() = e;
      continue;
    }
    line.times.push_back(times[e]);
    line.entries.push_back(e);
  }
  const double first = line.times.front();
  for (double& t : line.times) t = (options.shiftToZero ? t - first : t) + options.shift;
  // A large shift can make neighbours equal in double precision; a time axis must still increase.
  for (std::size_t s = 1; s < line.times.size(); ++s)
    if (!(line.times[s] > line.times[s - 1])) line.times[s] = std::nextafter(line.times[s - 1], INFINITY);
  return line;
}

} // namespace rimflow
