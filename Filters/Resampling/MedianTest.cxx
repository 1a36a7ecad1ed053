#include "MedianTest.h"

#include "ParticleIndex.h"

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <stdexcept>

namespace rimflow {
namespace {

constexpr int Most = 32;               // neighbours
constexpr int Least = 7;               // neighbours: the fit has four coefficients
constexpr float Cut = 2;               // of Geman-McClure's function, in units of s_i
constexpr float Suspect = 3;           // a neighbour beyond, in units of s_i, calls for the robust fit
constexpr int RobustRounds = 3;        // of reweighting
constexpr float Ridge = 1e-3f;         // neighbours in a plane say nothing of the gradient across it
constexpr float Variation = 2;         // g_i that a plain particle may lie off
constexpr double Resolution = 1e-3;    // of the rms: what no measurement resolves
constexpr double MedianLength = 1.538; // of three Gaussian components

struct Neighbours {
  int count = 0;
  std::array<std::uint32_t, Most> id;
  std::array<Eigen::Vector4f, Most> basis; // 1 and the offset over the farthest one's distance
};

struct Residual {
  float size = -1;     ///< |v_i - f(x_i)|/sqrt(1 + h_i); negative: not tested
  float scale = 0;     ///< s_i
  float variation = 0; ///< g_i, if that is still to be asked
};

bool finite(const float* v) { return std::isfinite(v[0]) && std::isfinite(v[1]) && std::isfinite(v[2]); }

float medianOf(std::array<float, Most> values, int n) {
  std::nth_element(values.begin(), values.begin() + n / 2, values.begin() + n);
  return values[n / 2];
}

/// The nearest particles without those that `skip` says; fewer than wanted if there are no more.
template <class Skip>
Neighbours nearest(const ParticleIndex& index, const float* x, int wanted, double radius, const Skip& skip) {
  struct Candidate {
    float square;
    std::uint32_t id;
    float offset[3];
    bool operator<(const Candidate& o) const { return square != o.square ? square < o.square : id < o.id; }
  };
  thread_local std::vector<Candidate> found;
  const Eigen::Vector3d at(x[0], x[1], x[2]);
  for (int attempt = 0; attempt < 12; ++attempt, radius *= 1.3) {
    found.clear();
    index.forEachWithin(at, radius, [&](std::uint32_t id, float dx, float dy, float dz) {
      if (!skip(id)) found.push_back({dx * dx + dy * dy + dz * dz, id, {dx, dy, dz}});
    });
    if (int(found.size()) >= wanted) break;
  }
  Neighbours out;
  out.count = std::min(wanted, int(found.size()));
  if (out.count == 0) return out;
  std::nth_element(found.begin(), found.begin() + out.count - 1, found.end());
  const float size = std::sqrt(std::max(found[out.count - 1].square, 1e-30f));
  for (int j = 0; j < out.count; ++j) {
    const Candidate& c = found[j];
    out.id[j] = c.id;
    out.basis[j] << 1, c.offset[0] / size, c.offset[1] / size, c.offset[2] / size;
  }
  return out;
}

Residual residual(const Neighbours& neighbours, const float* values, std::size_t particle, float threshold) {
  const float* own = values + 3 * particle;
  if (!finite(own)) return {};
  std::array<Eigen::Vector4f, Most> basis, value; // value: less the particle's own
  std::array<float, Most> t, w;
  int n = 0;
  for (int j = 0; j < neighbours.count; ++j) {
    const float* v = values + 3 * neighbours.id[j];
    if (!finite(v)) continue;
    basis[n] = neighbours.basis[j];
    w[n] = 1;
    value[n++] << v[0] - own[0], v[1] - own[1], v[2] - own[2], 0;
  }
  if (n < Least) return {};
  for (int round = 0;; ++round) {
    Eigen::Matrix4f A = Eigen::Matrix4f::Zero(), B = Eigen::Matrix4f::Zero();
    for (int j = 0; j < n; ++j) {
      const Eigen::Vector4f weighted = w[j] * basis[j];
      A.noalias() += weighted * basis[j].transpose();
      B.noalias() += value[j] * weighted.transpose();
    }
    A.diagonal().tail<3>().array() += Ridge * A(0, 0);
    const Eigen::Matrix4f inverse = A.inverse(), fit = B * inverse;
    float largest = 0;
    for (int j = 0; j < n; ++j) {
      const float leverage = w[j] * basis[j].dot(inverse * basis[j]);
      t[j] = (value[j] - fit * basis[j]).norm() / std::sqrt(std::max(0.05f, 1 - leverage));
      largest = std::max(largest, t[j]);
    }
    const float scale = std::max(medianOf(t, n), 1e-20f);
    if (round == RobustRounds || (round == 0 && largest < Suspect * scale)) {
      const float size = fit.col(0).norm() / std::sqrt(1 + inverse(0, 0));
      if (size <= threshold * scale) return {size, scale, 0};
      for (int j = 0; j < n; ++j) t[j] = (fit.rightCols<3>() * basis[j].tail<3>()).norm();
      return {size, scale, medianOf(t, n)};
    }
    for (int j = 0; j < n; ++j) {
      const float q = t[j] / (Cut * scale);
      w[j] = 1 / ((1 + q * q) * (1 + q * q));
    }
  }
}

/// e: the lower quartile of all s_i, at least what no measurement resolves. Of particles that may be outliers
/// neither the value nor the size says anything.
float noiseFloor(const std::vector<Residual>& residuals, const float* values, float threshold) {
  std::vector<float> scales;
  double squares = 0;
  for (std::size_t p = 0; p < residuals.size(); ++p) {
    const Residual& r = residuals[p];
    if (!(r.size >= 0 && r.size <= threshold * r.scale)) continue;
    scales.push_back(r.scale);
    for (int c = 0; c < 3; ++c) squares += double(values[3 * p + c]) * values[3 * p + c];
  }
  if (scales.empty()) return 0;
  const auto quartile = scales.begin() + std::ptrdiff_t(scales.size() / 4);
  std::nth_element(scales.begin(), quartile, scales.end());
  return std::max(*quartile, float(Resolution * std::sqrt(squares / double(scales.size()))));
}

} // namespace

MedianTestResult medianTest(const float* positions, const float* velocities, const float* accelerations,
                            std::size_t count, const MedianTestOptions& options, const Progress& progress) {
  if (options.neighbours < 8 || options.neighbours > Most || !(options.threshold > 0))
    throw std::invalid_argument("the median test needs 8 to 32 neighbours and a threshold greater than 0");
  MedianTestResult result;
  std::vector<unsigned char>& outlier = result.outlier;
  outlier.assign(count, 0);
  const ParticleIndex index(positions, count);
  if (index.size() <= Least || !(index.meanDensity() > 0)) return result;
  // a ball with 1.4 times the neighbours on average
  const double radius = std::cbrt(1.4 * options.neighbours / (4. / 3 * M_PI * index.meanDensity()));

  const auto n = std::ptrdiff_t(count);
  const int k = options.neighbours;
  const auto threshold = float(options.threshold);
  std::vector<Residual> velocity(count), acceleration(accelerations ? count : 0);
  std::vector<std::uint32_t> around(count * k); // k neighbours of each particle; itself where there are fewer
  std::vector<unsigned char> look(count), skip(count);
  for (std::ptrdiff_t p = 0; p < n; ++p) {
    look[p] = finite(positions + 3 * p) && finite(velocities + 3 * p);
    skip[p] = !look[p];
  }
  const auto examine = [&](const Progress& watch) {
    constexpr std::ptrdiff_t Piece = 512; // particles
    return forEachPiece(std::size_t((n + Piece - 1) / Piece), watch, [&](std::size_t piece, const Progress&) {
      const std::ptrdiff_t first = std::ptrdiff_t(piece) * Piece;
      for (std::ptrdiff_t p = first; p < std::min(n, first + Piece); ++p) {
        if (!look[p]) continue;
        const Neighbours found = nearest(index, positions + 3 * p, k, radius, [&](std::uint32_t id) {
          return skip[id] || id == std::uint32_t(p);
        });
        for (int j = 0; j < k; ++j) around[p * k + j] = j < found.count ? found.id[j] : std::uint32_t(p);
        velocity[p] = residual(found, velocities, p, threshold);
        if (accelerations) acceleration[p] = residual(found, accelerations, p, threshold);
      }
    });
  };
  const auto over = [&](const Residual& r, float floor) {
    // so that what is too large to square is one, too
    return !(r.size <= std::max(threshold * (r.scale + floor), Variation * r.variation));
  };
  float velocityFloor = 0, accelerationFloor = 0;
  const auto judge = [&] {
    for (std::ptrdiff_t p = 0; p < n; ++p)
      if (look[p])
        outlier[p] = (over(velocity[p], velocityFloor) ? 1 : 0) +
                     (accelerations && over(acceleration[p], accelerationFloor) ? 2 : 0);
  };
  if (!examine(part(progress, 0, 0.7))) return result;
  velocityFloor = noiseFloor(velocity, velocities, threshold);
  if (accelerations) accelerationFloor = noiseFloor(acceleration, accelerations, threshold);
  judge();

  for (std::ptrdiff_t p = 0; p < n; ++p) {
    const auto* first = &around[p * k];
    look[p] = look[p] && (outlier[p] || std::any_of(first, first + k, [&](auto id) { return outlier[id]; }));
  }
  for (std::ptrdiff_t p = 0; p < n; ++p) skip[p] |= outlier[p];
  if (!examine(part(progress, 0.7, 1))) return result;
  judge();

  result.count = std::size_t(n - std::count(outlier.begin(), outlier.end(), 0));
  result.velocityNoise = velocityFloor / MedianLength;
  result.accelerationNoise = accelerationFloor / MedianLength;
  return result;
}

} // namespace rimflow
