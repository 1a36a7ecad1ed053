#include "TrackNoise.h"

#include "ParticleIndex.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <numeric>
#include <stdexcept>

namespace rimflow {
namespace {

using Rows = std::vector<std::vector<std::int32_t>>;
using Array = std::vector<float> TrackSnapshot::*;
constexpr Array arrays[3] = {&TrackSnapshot::position, &TrackSnapshot::velocity,
                             &TrackSnapshot::acceleration};

constexpr int fewNeighbours = 20, manyNeighbours = 40; // of a quadratic fit in space (10 coefficients)
constexpr std::size_t fewestForSpace = 60;             // tracks
constexpr std::size_t sampledTracks = 800;
constexpr int spanForMeans = 9; // snapshots; below, a tracker's filter may be as long as the span

/// Vectors of the sampled tracks through the span: value(track, snapshot, component).
struct Series {
  std::size_t tracks = 0;
  int span = 0;
  std::vector<double> values;

  Series(std::size_t tracks, int span) : tracks(tracks), span(span), values(tracks * span * 3) {}
  double* track(std::size_t i) { return &values[i * span * 3]; }
  const double* track(std::size_t i) const { return &values[i * span * 3]; }
};

/// Variance per component of Gaussian values, from the median of their sizes: up to half of them may be
/// anything. 1.4826 = 1 / (upper quartile of the normal distribution).
double robustVariance(std::vector<double>& sizes) {
  if (sizes.empty()) return std::numeric_limits<double>::quiet_NaN();
  const auto middle = sizes.begin() + sizes.size() / 2;
  std::nth_element(sizes.begin(), middle, sizes.end());
  return 1.4826 * 1.4826 * *middle * *middle;
}

/// Mean over x, y, z of the robust variance of what `collect(x, push)` pushes for each track; x[3 k] is the
/// component at snapshot k.
template <class Collect>
double variance(const Series& series, Collect&& collect) {
  double sum = 0;
  std::vector<double> sizes;
  for (int c = 0; c < 3; ++c) {
    sizes.clear();
    for (std::size_t i = 0; i < series.tracks; ++i)
      collect(series.track(i) + c, [&](double v) {
        if (std::isfinite(v)) sizes.push_back(std::abs(v));
      });
    sum += robustVariance(sizes) / 3;
  }
  return sum;
}

/// At single snapshots.
double varianceAtOnce(const Series& e) {
  return variance(e, [&](const double* x, auto&& push) {
    for (int k = 0; k < e.span; ++k) push(x[3 * k]);
  });
}

/// From differences over `least` to `most` snapshots.
double varianceOverLags(const Series& e, int least, int most) {
  return 0.5 * variance(e, [&](const double* x, auto&& push) {
           for (int lag = least; lag <= most; ++lag)
             for (int k = 0; k + lag < e.span; ++k) push(x[3 * (k + lag)] - x[3 * k]);
         });
}

/// About each track's mean over the span.
double varianceAboutMean(const Series& e) {
  const double s = e.span;
  return s / (s - 1) * variance(e, [&](const double* x, auto&& push) {
           double mean = 0;
           for (int k = 0; k < e.span; ++k) mean += x[3 * k] / s;
           for (int k = 0; k < e.span; ++k) push(x[3 * k] - mean);
         });
}

/// Of a weighted sum over the span.
double varianceOfSum(const Series& e, const Eigen::VectorXd& weights) {
  return variance(e, [&](const double* x, auto&& push) {
    double sum = 0;
    for (int k = 0; k < e.span; ++k) sum += weights[k] * x[3 * k];
    push(sum);
  });
}

/// From the residuals of polynomials in time through `length` successive values: r = (I - Q Q^T) x, divided
/// by the standard deviation that white noise of variance 1 gives them.
double varianceAlongTrack(const Series& series, const std::vector<double>& times, int length) {
  const int order = std::min(3, length - 2);
  std::vector<Eigen::MatrixXd> residual;
  for (int first = 0; first + length <= series.span; ++first) {
    const Eigen::VectorXd t = Eigen::VectorXd::Map(&times[first], length).array() - times[first + length / 2];
    Eigen::MatrixXd powers(length, order + 1);
    powers.col(0).setOnes();
    for (int j = 1; j <= order; ++j)
      powers.col(j) = powers.col(j - 1).cwiseProduct(t / t.cwiseAbs().maxCoeff());
    const Eigen::MatrixXd q = Eigen::HouseholderQR<Eigen::MatrixXd>(powers).householderQ() *
                              Eigen::MatrixXd::Identity(length, order + 1);
    Eigen::MatrixXd r = Eigen::MatrixXd::Identity(length, length) - q * q.transpose();
    for (int k = 0; k < length; ++k) r.row(k) /= std::sqrt(std::max(r(k, k), 1e-9));
    residual.push_back(r);
  }
  return variance(series, [&](const double* x, auto&& push) {
    for (std::size_t first = 0; first < residual.size(); ++first) {
      const Eigen::Map<const Eigen::VectorXd, 0, Eigen::InnerStride<3>> y(x + 3 * first, length);
      for (int k = 0; k < length; ++k) push(residual[first].row(k).dot(y));
    }
  });
}

/// Tracks with a finite value of every needed array in each snapshot of a span around the current one.
struct Population {
  const TrackWindow& window;
  const Rows& rows; // of the snapshots from `base` on
  std::size_t base = 0, first = 0;
  int span = 0;
  std::vector<std::int32_t> tracks; // rows of the current snapshot

  Eigen::Vector3d at(Array a, int k, std::int32_t track) const {
    const std::size_t s = first + k;
    const float* v = &(window.snapshots[s].get()->*a)[3 * std::size_t(rows[s - base][track])];
    return {v[0], v[1], v[2]};
  }
};

bool hasArray(const TrackWindow& w, Array a, std::size_t first, std::size_t last) {
  for (std::size_t s = first; s <= last; ++s) {
    const TrackSnapshot& snapshot = *w.snapshots[s];
    if (snapshot.size() > 0 && (snapshot.*a).size() != 3 * snapshot.size()) return false;
  }
  return true;
}

std::uint32_t spanBits(int first, int span) { return ((std::uint32_t(1) << span) - 1) << first; }

/// The longest span that a fifth of the current particles goes through, so that neighbours stay near; where
/// there is none, the longest with enough tracks for a fit in space, or with any.
Population populate(const TrackWindow& window, const Rows& rows, std::size_t base,
                    const std::vector<Array>& needed) {
  const int total = int(rows.size()), here = int(window.current - base);
  Population best{window, rows, base, window.current, 0, {}};
  const std::size_t n = window.snapshots[window.current]->size();
  std::vector<std::uint32_t> present(n, 0); // bits of snapshots
  for (int s = 0; s < total; ++s)
    for (std::size_t r = 0; r < n; ++r) {
      const std::int32_t row = rows[s][r];
      bool all = row >= 0;
      for (Array a : needed) {
        if (!all) break;
        const float* v = &(window.snapshots[base + s].get()->*a)[3 * std::size_t(row)];
        all = std::isfinite(v[0]) && std::isfinite(v[1]) && std::isfinite(v[2]);
      }
      present[r] |= std::uint32_t(all) << s;
    }
  for (std::size_t least : {std::max(n / 5, fewestForSpace), fewestForSpace, std::size_t(1)})
    for (int span = total; span >= 1; --span) {
      std::size_t most = 0;
      int first = 0;
      for (int f = std::max(0, here - span + 1); f <= std::min(here, total - span); ++f) {
        const std::uint32_t bits = spanBits(f, span);
        const std::size_t count = std::size_t(std::count_if(
            present.begin(), present.end(), [&](std::uint32_t p) { return (p & bits) == bits; }));
        if (count > most) {
          most = count;
          first = f;
        }
      }
      if (most < least) continue;
      best.first = base + first;
      best.span = span;
      for (std::size_t r = 0; r < n; ++r)
        if ((present[r] & spanBits(first, span)) == spanBits(first, span))
          best.tracks.push_back(std::int32_t(r));
      return best;
    }
  return best;
}

/// What the neighbours in the same snapshot do not tell: value minus the quadratic polynomial in space,
/// fitted to the nearest neighbours, at the track's place; over sqrt(1 + |w|^2), so that noise keeps its
/// variance. Places are means over the span, positions are displacements from them.
struct SpatialResiduals {
  std::vector<Series> few, many; // for each array
};

Eigen::VectorXd weightsAtCentre(const Eigen::Matrix3Xd& offsets) {
  const int n = int(offsets.cols());
  const Eigen::Matrix3Xd r = offsets / offsets.colwise().norm().maxCoeff();
  Eigen::MatrixXd a(n, 10);
  for (int i = 0; i < n; ++i) {
    const double x = r(0, i), y = r(1, i), z = r(2, i);
    a.row(i) << 1, x, y, z, x * x, y * y, z * z, x * y, y * z, z * x;
  }
  // w = A (A^T A)^-1 e_0; rank-revealing, as neighbours may lie in a plane.
  return Eigen::CompleteOrthogonalDecomposition<Eigen::MatrixXd>(a.transpose())
      .solve(Eigen::VectorXd::Unit(10, 0));
}

class Neighbourhoods {
public:
  explicit Neighbourhoods(const Population& population)
      : places(meanPlaces(population)),
        index(std::vector<float>(places.begin(), places.end()).data(), population.tracks.size()) {
    if (index.meanDensity() > 0) radius = std::cbrt(1.5 * manyNeighbours / (4.19 * index.meanDensity()));
  }

  /// The nearest tracks of track i, places in p.tracks; empty where there is no volume to look through.
  std::vector<std::uint32_t> nearest(std::size_t i) const {
    std::vector<std::pair<float, std::uint32_t>> found;
    const Eigen::Vector3d x = place(i);
    double r = radius;
    for (int attempt = 0; r > 0 && attempt < 12 && found.size() < manyNeighbours; ++attempt, r *= 1.4) {
      found.clear();
      index.forEachWithin(x, r, [&](std::uint32_t j, float dx, float dy, float dz) {
        if (j != i) found.push_back({dx * dx + dy * dy + dz * dz, j});
      });
    }
    if (found.size() < manyNeighbours) return {};
    std::partial_sort(found.begin(), found.begin() + manyNeighbours, found.end());
    std::vector<std::uint32_t> out(manyNeighbours);
    for (int k = 0; k < manyNeighbours; ++k) out[k] = found[k].second;
    return out;
  }
  Eigen::Vector3d place(std::size_t i) const { return Eigen::Vector3d::Map(&places[3 * i]); }

private:
  static std::vector<double> meanPlaces(const Population& p) {
    std::vector<double> out(3 * p.tracks.size());
    for (std::size_t i = 0; i < p.tracks.size(); ++i) {
      Eigen::Vector3d sum = Eigen::Vector3d::Zero();
      for (int k = 0; k < p.span; ++k) sum += p.at(&TrackSnapshot::position, k, p.tracks[i]);
      Eigen::Vector3d::Map(&out[3 * i]) = sum / p.span;
    }
    return out;
  }

  std::vector<double> places;
  ParticleIndex index;
  double radius = 0;
};

SpatialResiduals spatialResiduals(const Population& p, const std::vector<Array>& fields,
                                  const std::vector<std::size_t>& samples) {
  const Neighbourhoods neighbourhoods(p);
  SpatialResiduals out;
  for (std::size_t f = 0; f < fields.size(); ++f) {
    out.few.emplace_back(samples.size(), p.span);
    out.many.emplace_back(samples.size(), p.span);
  }
  std::vector<char> lost(samples.size(), 0);
#pragma omp parallel for schedule(dynamic, 32)
  for (std::ptrdiff_t s = 0; s < std::ptrdiff_t(samples.size()); ++s) {
    const std::size_t i = samples[s];
    const std::vector<std::uint32_t> near = neighbourhoods.nearest(i);
    if (near.empty()) {
      lost[s] = 1;
      continue;
    }
    Eigen::Matrix3Xd offsets(3, manyNeighbours);
    for (int j = 0; j < manyNeighbours; ++j)
      offsets.col(j) = neighbourhoods.place(near[j]) - neighbourhoods.place(i);
    const Eigen::VectorXd wFew = weightsAtCentre(offsets.leftCols(fewNeighbours));
    const Eigen::VectorXd wMany = weightsAtCentre(offsets);
    const double toFew = 1 / std::sqrt(1 + wFew.squaredNorm());
    const double toMany = 1 / std::sqrt(1 + wMany.squaredNorm());
    // The weights' sum is 1: with offsets from the own place, displacements are differences of places.
    const Eigen::Vector3d ownPlace = neighbourhoods.place(i);
    const Eigen::Vector3d placeFew = offsets.leftCols(fewNeighbours) * wFew, placeMany = offsets * wMany;
    for (std::size_t f = 0; f < fields.size(); ++f) {
      const bool ballistic = fields[f] == &TrackSnapshot::position;
      const Eigen::Vector3d zero = Eigen::Vector3d::Zero(), origin = ballistic ? ownPlace : zero;
      for (int k = 0; k < p.span; ++k) {
        Eigen::Vector3d few = ballistic ? -placeFew : zero, many = ballistic ? -placeMany : zero;
        for (int j = 0; j < manyNeighbours; ++j) {
          const Eigen::Vector3d v = p.at(fields[f], k, p.tracks[near[j]]) - origin;
          if (j < fewNeighbours) few += wFew[j] * v;
          many += wMany[j] * v;
        }
        const Eigen::Vector3d here = p.at(fields[f], k, p.tracks[i]) - origin;
        Eigen::Vector3d::Map(out.few[f].track(s) + 3 * k) = (here - few) * toFew;
        Eigen::Vector3d::Map(out.many[f].track(s) + 3 * k) = (here - many) * toMany;
      }
    }
  }
  for (std::vector<Series>* set : {&out.few, &out.many})
    for (Series& e : *set) {
      std::size_t kept = 0;
      for (std::size_t s = 0; s < samples.size(); ++s) {
        if (lost[s]) continue;
        std::copy_n(e.track(s), 3 * p.span, e.track(kept++));
      }
      e.tracks = kept;
    }
  return out;
}

/// The variance without the part that the flow's third derivatives put into the residuals. That part grows by
/// about 2.7 from 20 to 40 neighbours (measured on flows without noise; by 4 if 20 were many); the noise does
/// not. Never below a quarter, as the extrapolation may go too far.
double withoutTruncation(double few, double many) {
  return std::max(few - std::max(many - few, 0.0) / 1.7, 0.25 * few);
}

template <class Measure>
double extrapolated(const SpatialResiduals& e, std::size_t f, Measure&& measure) {
  return withoutTruncation(measure(e.few[f]), measure(e.many[f]));
}

struct Level {
  double variance = std::numeric_limits<double>::quiet_NaN();
  bool white = false; // in time, as far as it can be told
};

Series sampled(const Population& p, Array a, const std::vector<std::size_t>& samples) {
  Series out(samples.size(), p.span);
  for (std::size_t s = 0; s < samples.size(); ++s) {
    const std::int32_t track = p.tracks[samples[s]];
    for (int k = 0; k < p.span; ++k) // relative to the first value, for the digits
      Eigen::Vector3d::Map(out.track(s) + 3 * k) = p.at(a, k, track) - p.at(a, 0, track);
  }
  return out;
}

/// A place has no residual of its own at a single time, but changes of place have; the longer the time, the
/// less the noise at both ends has in common, and the more the flow's third derivatives weigh.
double overLongLags(const SpatialResiduals& e, std::size_t f, int span) {
  if (span < 2) return std::numeric_limits<double>::quiet_NaN();
  const auto longLags = [&](const Series& s) { return varianceOverLags(s, span / 2, span - 1); };
  const double few = longLags(e.few[f]), many = longLags(e.many[f]);
  return many < 2 * few ? withoutTruncation(few, many) : extrapolated(e, f, varianceAboutMean);
}

/// Where the flow's third derivatives weigh little, what differs from the neighbours is noise; elsewhere only
/// what changes of it.
double atOnceOrAboutMean(const SpatialResiduals& e, std::size_t f, int span) {
  const double few = varianceAtOnce(e.few[f]), many = varianceAtOnce(e.many[f]);
  if (span < spanForMeans || many < 1.5 * few) return withoutTruncation(few, many);
  return extrapolated(e, f, varianceAboutMean);
}

/// See the comment of measureTrackNoise for the reasons.
Level levelOf(const Population& p, Array field, std::size_t f, const SpatialResiduals& e,
              const std::vector<std::size_t>& samples) {
  const bool ballistic = field == &TrackSnapshot::position;
  const bool neighbours = !e.few.empty() && e.few[f].tracks >= fewestForSpace / 2;
  Level level;
  double along = 0, alongShort = 0;
  const bool polynomials = p.span >= (neighbours ? 6 : 3);
  if (polynomials) {
    const Series series = sampled(p, field, samples);
    const std::vector<double> times(p.window.times.begin() + p.first,
                                    p.window.times.begin() + p.first + p.span);
    along = varianceAlongTrack(series, times, p.span);
    alongShort = varianceAlongTrack(series, times, std::min(5, p.span));
  }
  if (!neighbours) {
    if (polynomials) level = {along, true};
    return level;
  }
  if (p.span >= 3) {
    const double next = extrapolated(e, f, [](const Series& s) { return varianceOverLags(s, 1, 1); });
    const double second = extrapolated(e, f, [](const Series& s) { return varianceOverLags(s, 2, 2); });
    if (second <= 1.25 * next) return {polynomials ? std::fmin(along, next) : next, true};
  }
  const double total = ballistic ? overLongLags(e, f, p.span) : atOnceOrAboutMean(e, f, p.span);
  if (p.span >= spanForMeans && along <= 1.15 * alongShort && total < 4 * along) return {along, true};
  return {total, false};
}

std::vector<std::size_t> sample(std::size_t tracks) {
  std::vector<std::size_t> out(std::min(tracks, sampledTracks));
  for (std::size_t i = 0; i < out.size(); ++i) out[i] = i * tracks / out.size();
  return out;
}

/// The snapshots nearest to the current one.
std::pair<std::size_t, std::size_t> nearestSnapshots(const TrackWindow& w) {
  const std::size_t count = std::min(noiseSnapshots, w.times.size());
  const std::size_t before = std::min(w.current, count / 2);
  const std::size_t first = std::min(w.current - before, w.times.size() - count);
  return {first, first + count - 1};
}

/// Noise of derivatives from correlated positions: the stencil applied to what neighbours do not tell.
TrackNoise derivedFromResiduals(const Population& p, const SpatialResiduals& e,
                                const TrackDerivativeOptions& options, const DerivativeGain& gain) {
  const std::vector<double> times(p.window.times.begin() + p.first,
                                  p.window.times.begin() + p.first + p.span);
  const DerivativeStencil s = derivativeStencil(times, times.size() / 2, options);
  TrackNoise noise;
  const auto level = [&](const std::vector<double>& weights) {
    Eigen::VectorXd w = Eigen::VectorXd::Zero(p.span);
    for (std::size_t i = 0; i < weights.size(); ++i) w[s.snapshot[i]] = weights[i];
    return std::sqrt(extrapolated(e, 0, [&](const Series& r) { return varianceOfSum(r, w); }));
  };
  if (!s.velocity.empty()) noise.velocity = level(s.velocity) * gain.velocity / s.gain.velocity;
  if (!s.acceleration.empty())
    noise.acceleration = level(s.acceleration) * gain.acceleration / s.gain.acceleration;
  return noise;
}

/// Without tracks, the current snapshot alone can still tell how its particles differ from their neighbours.
Rows rowsOrSnapshot(const TrackWindow& window, std::size_t first, std::size_t last) {
  Rows rows = rowsOfTracks(window, first, last);
  std::vector<std::int32_t>& here = rows[window.current - first];
  if (std::all_of(here.begin(), here.end(), [](std::int32_t r) { return r < 0; }))
    std::iota(here.begin(), here.end(), 0);
  return rows;
}

TrackNoise measure(const TrackWindow& window, const TrackDerivativeOptions* derivatives,
                   const DerivativeGain& gain, const Progress& progress) {
  if (window.snapshots.size() != window.times.size() || window.current >= window.times.size())
    throw std::invalid_argument("A window of snapshots needs a time for each and one that is current");
  const auto [first, last] = nearestSnapshots(window);
  const Rows rows = rowsOrSnapshot(window, first, last);
  TrackNoise noise;
  if (!goOn(progress, 0.3)) return noise;
  double* levels[3] = {&noise.position, &noise.velocity, &noise.acceleration};

  std::vector<Array> available;
  for (Array a : arrays)
    if ((!derivatives || a == &TrackSnapshot::position) && hasArray(window, a, first, last))
      available.push_back(a);
  // All at once where most tracks have all arrays, otherwise each with its own tracks.
  std::vector<std::vector<Array>> groups{available};
  if (available.size() > 1 && 2 * populate(window, rows, first, available).tracks.size() <
                                  populate(window, rows, first, {available[0]}).tracks.size()) {
    groups.clear();
    for (Array a : available) groups.push_back({a});
  }
  for (const std::vector<Array>& group : groups) {
    if (!goOn(progress, 0.4)) return noise;
    const Population p = populate(window, rows, first, group);
    if (p.tracks.empty()) continue;
    const std::vector<std::size_t> samples = sample(p.tracks.size());
    SpatialResiduals e;
    if (p.tracks.size() >= fewestForSpace) e = spatialResiduals(p, group, samples);
    for (std::size_t f = 0; f < group.size(); ++f) {
      if (!goOn(progress, 0.8)) return noise;
      const Level level = levelOf(p, group[f], f, e, samples);
      *levels[std::find(arrays, arrays + 3, group[f]) - arrays] = std::sqrt(level.variance);
      if (!derivatives) continue;
      noise.velocity = gain.velocity * noise.position;
      noise.acceleration = gain.acceleration * noise.position;
      if (!level.white && p.span >= derivatives->window) {
        const TrackNoise derived = derivedFromResiduals(p, e, *derivatives, gain);
        noise.velocity = derived.velocity;
        noise.acceleration = derived.acceleration;
      }
    }
  }
  return noise;
}

} // namespace

TrackNoise measureTrackNoise(const TrackWindow& window, const Progress& progress) {
  return measure(window, nullptr, {}, progress);
}

TrackNoise measureTrackNoise(const TrackWindow& window, const TrackDerivativeOptions& derivatives,
                             const DerivativeGain& gain, const Progress& progress) {
  return measure(window, &derivatives, gain, progress);
}

} // namespace rimflow
