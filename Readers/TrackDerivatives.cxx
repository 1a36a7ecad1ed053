#include "TrackDerivatives.h"

#include "IdTable.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <stdexcept>

namespace rimflow {
namespace {

const double none = std::numeric_limits<double>::quiet_NaN();
constexpr int largestWindow = 31; // 61 snapshots then fit into the 64 bits of a presence pattern

void check(const TrackDerivativeOptions& o) {
  if (o.order < 2 || o.order > 5)
    throw std::invalid_argument("The order of the polynomial in time must be 2 to 5, not " +
                                std::to_string(o.order));
  if (o.window % 2 == 0 || o.window <= o.order || o.window > largestWindow)
    throw std::invalid_argument("The window of the polynomial in time must be odd, larger than its order (" +
                                std::to_string(o.order) + ") and at most 31 points, not " +
                                std::to_string(o.window));
}

void check(const TrackWindow& w) {
  if (w.snapshots.size() != w.times.size() || w.current >= w.times.size())
    throw std::invalid_argument("A window of snapshots needs a time for each and one that is current");
  for (const auto& s : w.snapshots)
    if (!s) throw std::invalid_argument("A snapshot of the window is missing");
}

bool hasTracks(const TrackSnapshot& s) { return s.trackId.size() == s.size(); }

bool isPlaced(const TrackSnapshot& s, std::size_t row) {
  const float* x = &s.position[3 * row];
  return std::isfinite(x[0]) && std::isfinite(x[1]) && std::isfinite(x[2]);
}

/// The `count` of the snapshots in `present` that are nearest in time to `current`, in the order of time. Of
/// two at the same distance the one on the side with fewer points is taken.
std::vector<std::int32_t> nearest(const std::vector<double>& times, std::size_t current,
                                  const std::vector<std::int32_t>& present, int count) {
  int last = int(std::lower_bound(present.begin(), present.end(), std::int32_t(current)) - present.begin());
  int first = last;
  const double tolerance = 1e-6 * std::abs(times[present.back()] - times[present.front()]);
  while (last - first + 1 < std::min(count, int(present.size()))) {
    const bool canGoBack = first > 0, canGoOn = last + 1 < int(present.size());
    bool back = canGoBack;
    if (canGoBack && canGoOn) {
      const double before = times[current] - times[present[first - 1]];
      const double after = times[present[last + 1]] - times[current];
      const int here =
          int(std::lower_bound(present.begin(), present.end(), std::int32_t(current)) - present.begin());
      back = std::abs(before - after) <= tolerance ? here - first <= last - here : before < after;
    }
    if (back)
      --first;
    else
      ++last;
  }
  return {present.begin() + first, present.begin() + last + 1};
}

/// The highest order that leaves the noise of `points` points some way to average out: 2 order + 1 <= points.
int orderFor(int points, const TrackDerivativeOptions& options) {
  return std::min(options.order, std::max(1, (points - 1) / 2));
}

/// Least squares fit of sum_j c_j (t / T)^j: c = R^-1 Q^T x (Savitzky & Golay 1964, for any times). Returns
/// the row of R^-1 Q^T that gives c_j.
Eigen::VectorXd fitWeights(const Eigen::VectorXd& t, double T, int order, int j) {
  Eigen::MatrixXd powers(t.size(), order + 1);
  powers.col(0).setOnes();
  for (int k = 1; k <= order; ++k) powers.col(k) = powers.col(k - 1).cwiseProduct(t / T);
  const Eigen::HouseholderQR<Eigen::MatrixXd> qr(powers);
  const Eigen::VectorXd row =
      qr.matrixQR().topRows(order + 1).triangularView<Eigen::Upper>().transpose().solve(
          Eigen::VectorXd::Unit(order + 1, j));
  Eigen::VectorXd padded = Eigen::VectorXd::Zero(t.size());
  padded.head(order + 1) = row;
  return qr.householderQ() * padded;
}

/// Velocity c_1 / T and acceleration 2 c_2 / T^2 at the current time.
DerivativeStencil fit(const std::vector<double>& times, std::size_t current,
                      const std::vector<std::int32_t>& present, const TrackDerivativeOptions& options) {
  DerivativeStencil s;
  s.snapshot = nearest(times, current, present, options.window);
  const int n = int(s.snapshot.size());
  Eigen::VectorXd t(n);
  for (int i = 0; i < n; ++i) t[i] = times[s.snapshot[i]] - times[current];
  const double T = t.cwiseAbs().maxCoeff();
  int different = 1; // times; two snapshots may have the same
  for (int i = 1; i < n; ++i) different += t[i] - t[i - 1] > 1e-9 * T;
  const int order = orderFor(different, options);
  if (different < 2) return s;
  s.velocity.resize(n);
  Eigen::VectorXd::Map(s.velocity.data(), n) = fitWeights(t, T, order, 1) / T;
  s.gain.velocity = Eigen::VectorXd::Map(s.velocity.data(), n).norm();
  if (different < 3) return s;
  s.acceleration.resize(n);
  Eigen::VectorXd::Map(s.acceleration.data(), n) = fitWeights(t, T, std::max(2, order), 2) * (2 / (T * T));
  s.gain.acceleration = Eigen::VectorXd::Map(s.acceleration.data(), n).norm();
  return s;
}

double median(std::vector<double>& v) {
  if (v.empty()) return none;
  const auto middle = v.begin() + v.size() / 2;
  std::nth_element(v.begin(), middle, v.end());
  return *middle;
}

} // namespace

DerivativeStencil derivativeStencil(const std::vector<double>& times, std::size_t current,
                                    const TrackDerivativeOptions& options) {
  check(options);
  if (current >= times.size()) throw std::invalid_argument("The current time is not among the times");
  std::vector<std::int32_t> all(times.size());
  std::iota(all.begin(), all.end(), 0);
  return fit(times, current, all, options);
}

std::vector<std::vector<std::int32_t>> rowsOfTracks(const TrackWindow& window, std::size_t first,
                                                    std::size_t last) {
  check(window);
  if (first > window.current || last < window.current || last >= window.times.size())
    throw std::invalid_argument("The rows of tracks are asked for in snapshots that are not in the window");
  const TrackSnapshot& here = *window.snapshots[window.current];
  const std::size_t n = here.size();
  std::vector<std::vector<std::int32_t>> rows(last - first + 1, std::vector<std::int32_t>(n, -1));
  if (!hasTracks(here)) return rows;
  IdTable table(n);
  for (std::size_t r = 0; r < n; ++r) {
    if (here.trackId[r] < 0 || !isPlaced(here, r)) continue;
    std::int32_t& place = table[here.trackId[r]];
    if (place != IdTable::none) continue;
    place = std::int32_t(r);
    rows[window.current - first][r] = std::int32_t(r);
  }
#pragma omp parallel for schedule(dynamic)
  for (std::ptrdiff_t s = std::ptrdiff_t(first); s <= std::ptrdiff_t(last); ++s) {
    const TrackSnapshot& there = *window.snapshots[s];
    if (std::size_t(s) == window.current || !hasTracks(there)) continue;
    const std::vector<std::int32_t>& known = rows[window.current - first];
    std::vector<std::int32_t>& continued = rows[s - first];
    std::size_t k = 0;
    for (std::size_t r = 0; r < there.size(); ++r) {
      const std::int64_t id = there.trackId[r];
      if (id < 0) continue;
      // Files keep their order as a rule: then the track is one of the next rows, and need not be looked up.
      std::size_t next = k;
      while (next < std::min(n, k + 4) && (here.trackId[next] != id || known[next] < 0)) ++next;
      if (next == std::min(n, k + 4)) {
        const std::int32_t found = table.find(id);
        if (found == IdTable::none) continue;
        next = std::size_t(found);
      }
      k = next;
      if (continued[k] < 0 && isPlaced(there, r)) continued[k] = std::int32_t(r);
      ++k;
    }
  }
  return rows;
}

DerivativeGain estimateDerivatives(const TrackWindow& window, const TrackDerivativeOptions& options,
                                   TrackSnapshot& particles) {
  check(options);
  check(window);
  const std::size_t n = particles.size();
  if (n != window.snapshots[window.current]->size())
    throw std::invalid_argument("The particles are not those of the window's current snapshot");
  const std::size_t each = snapshotsEachSide(options);
  const std::size_t first = window.current - std::min(window.current, each);
  const std::size_t last = std::min(window.current + each, window.times.size() - 1);
  const auto rows = rowsOfTracks(window, first, last);
  const std::vector<double> times(window.times.begin() + first, window.times.begin() + last + 1);
  const std::size_t current = window.current - first;

  // One fit for each pattern of presence: a bit for each snapshot.
  std::vector<std::uint64_t> presence(n, 0);
  for (std::size_t s = 0; s < rows.size(); ++s)
    for (std::size_t r = 0; r < n; ++r) presence[r] |= std::uint64_t(rows[s][r] >= 0) << s;
  IdTable known;
  std::vector<std::uint64_t> patterns;
  std::vector<std::int32_t> pattern(n, -1);
  for (std::size_t r = 0; r < n; ++r) {
    if (rows[current][r] < 0) continue;
    std::int32_t& place = known[std::int64_t(presence[r])];
    if (place == IdTable::none) {
      place = std::int32_t(patterns.size());
      patterns.push_back(presence[r]);
    }
    pattern[r] = place;
  }
  std::vector<DerivativeStencil> stencils(patterns.size());
#pragma omp parallel for schedule(dynamic, 16)
  for (std::ptrdiff_t p = 0; p < std::ptrdiff_t(patterns.size()); ++p) {
    std::vector<std::int32_t> present;
    for (std::size_t s = 0; s < rows.size(); ++s)
      if (patterns[p] >> s & 1) present.push_back(std::int32_t(s));
    stencils[p] = fit(times, current, present, options);
  }

  particles.velocity.assign(3 * n, float(none));
  particles.acceleration.assign(3 * n, float(none));
  const std::vector<float>& x0 = window.snapshots[window.current]->position;
#pragma omp parallel for
  for (std::ptrdiff_t r = 0; r < std::ptrdiff_t(n); ++r) {
    if (pattern[r] < 0) continue;
    const DerivativeStencil& s = stencils[pattern[r]];
    if (s.velocity.empty()) continue;
    double v[3] = {0, 0, 0}, a[3] = {0, 0, 0};
    for (std::size_t i = 0; i < s.snapshot.size(); ++i) {
      const std::int32_t at = s.snapshot[i];
      const float* x = &window.snapshots[first + at]->position[3 * std::size_t(rows[at][r])];
      const double wv = s.velocity[i], wa = s.acceleration.empty() ? none : s.acceleration[i];
      for (int c = 0; c < 3; ++c) {
        const double offset = double(x[c]) - x0[3 * r + c]; // the weights' sum is 0
        v[c] += wv * offset;
        a[c] += wa * offset;
      }
    }
    for (int c = 0; c < 3; ++c) {
      particles.velocity[3 * r + c] = float(v[c]);
      particles.acceleration[3 * r + c] = float(a[c]);
    }
  }

  std::vector<double> velocityGains, accelerationGains;
  for (std::size_t r = 0; r < n; ++r) {
    if (pattern[r] < 0) continue;
    const DerivativeGain& gain = stencils[pattern[r]].gain;
    if (gain.velocity > 0) velocityGains.push_back(gain.velocity);
    if (gain.acceleration > 0) accelerationGains.push_back(gain.acceleration);
  }
  return {median(velocityGains), median(accelerationGains)};
}

} // namespace rimflow
