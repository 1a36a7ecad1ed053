#pragma once
#include "PressureProblem.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <random>
#include <vector>

namespace rimflow {

enum class PressureField { TaylorGreen, ABC };
enum class GradientNoise {
  None,
  White,      ///< normal, independent from node to node
  Correlated, ///< white noise after a Gaussian filter: correlation exp(-(r/4)^2), r in nodes, same rms
};

/// A pressure that is known, its analytic gradient and a sphere without data in the middle of the grid.
/// Spacing 1 and 64 nodes per period, so that a larger grid is a larger box.
struct PressureCase {
  Grid grid;
  std::vector<unsigned char> mask; ///< 1 within the sphere
  std::vector<double> exact;       ///< one per node; mean 0 and rms 1 over the fluid
  std::vector<float> gradient;     ///< with its noise, three per node
  double sigma = 0;                ///< of the noise per component

  PressureProblem problem() const { return {grid, gradient.data(), mask.data()}; }
};

struct PressureCaseOptions {
  PressureField field = PressureField::TaylorGreen;
  std::array<int, 3> nodes{64, 64, 64};
  double maskDiameter = 16; ///< in nodes; 0: fluid everywhere
  GradientNoise noise = GradientNoise::None;
  double noiseLevel = 0.05; ///< rms of the noise per rms of the gradient's components
};

namespace pressure_cases {

/// Calls f(node, X, Y, Z) for every node, with the phases of the flow there.
template <class F>
void forEachPhase(const Grid& grid, F&& f) {
  const double wavenumber = 2 * 3.14159265358979323846 / 64;
  for (int k = 0; k < grid.n[2]; ++k)
    for (int j = 0; j < grid.n[1]; ++j)
      for (int i = 0; i < grid.n[0]; ++i)
        f(grid.index(i, j, k), wavenumber * i + 0.3, wavenumber * j + 0.7, wavenumber * k + 1.1);
}

/// Pressure and its gradient per node; lengths in periods / 2 pi.
struct Value {
  double pressure;
  std::array<double, 3> gradient;
};

/// p = (cos 2X + cos 2Y)(cos 2Z + 2)/16
inline Value taylorGreen(double x, double y, double z) {
  const double plane = std::cos(2 * x) + std::cos(2 * y), depth = std::cos(2 * z) + 2;
  return {plane * depth / 16,
          {-std::sin(2 * x) * depth / 8, -std::sin(2 * y) * depth / 8, -plane * std::sin(2 * z) / 8}};
}

/// p = -|u|^2/2 with u = (A sin Z + C cos Y, B sin X + A cos Z, C sin Y + B cos X)
inline Value abc(double x, double y, double z) {
  constexpr double A = 1, B = 0.8, C = 0.6;
  const double u = A * std::sin(z) + C * std::cos(y), v = B * std::sin(x) + A * std::cos(z),
               w = C * std::sin(y) + B * std::cos(x);
  return {-0.5 * (u * u + v * v + w * w),
          {-(v * B * std::cos(x) - w * B * std::sin(x)), -(w * C * std::cos(y) - u * C * std::sin(y)),
           -(u * A * std::cos(z) - v * A * std::sin(z))}};
}

/// A Gaussian filter of three numbers per node along each axis; its weights are cut off and normalised at the
/// faces.
inline void gaussianFilter(const Grid& grid, double deviation, std::vector<double>& values) {
  const int reach = int(std::ceil(4 * deviation));
  std::vector<double> bell(reach + 1);
  for (int s = 0; s <= reach; ++s) bell[s] = std::exp(-0.5 * s * s / (deviation * deviation));
  for (int axis = 0; axis < 3; ++axis) {
    const std::size_t stride = axis == 0 ? 1 : axis == 1 ? grid.n[0] : std::size_t(grid.n[0]) * grid.n[1];
    std::vector<double> filtered(values.size());
    for (std::size_t node = 0; node < grid.size(); ++node) {
      const int at = int(node / stride % grid.n[axis]);
      double weights = 0;
      for (int s = std::max(-reach, -at); s <= std::min(reach, grid.n[axis] - 1 - at); ++s) {
        const double weight = bell[std::abs(s)];
        weights += weight;
        for (int c = 0; c < 3; ++c)
          filtered[3 * node + c] += weight * values[3 * (node + std::ptrdiff_t(stride) * s) + c];
      }
      for (int c = 0; c < 3; ++c) filtered[3 * node + c] /= weights;
    }
    values.swap(filtered);
  }
}

/// Three numbers per node of rms 1 over all nodes, always the same.
inline std::vector<double> noise(const Grid& grid, GradientNoise kind) {
  std::mt19937_64 random(12345);
  std::normal_distribution<double> normal;
  std::vector<double> values(3 * grid.size());
  for (double& value : values) value = normal(random);
  if (kind == GradientNoise::White) return values;
  gaussianFilter(grid, 2, values);
  double square = 0;
  for (double value : values) square += value * value;
  const double scale = 1 / std::sqrt(square / values.size());
  for (double& value : values) value *= scale;
  return values;
}

} // namespace pressure_cases

/// Taylor-Green or ABC flow, a sphere masked, with noise on the gradient if asked for.
inline PressureCase pressureCase(const PressureCaseOptions& options = {}) {
  using namespace pressure_cases;
  PressureCase out;
  out.grid = {{0, 0, 0}, {1, 1, 1}, options.nodes};
  const Grid& grid = out.grid;
  out.mask.assign(grid.size(), 0);
  const double centre[3] = {0.5 * (grid.n[0] - 1), 0.5 * (grid.n[1] - 1), 0.5 * (grid.n[2] - 1)};
  const double radius = 0.5 * options.maskDiameter;
  forEachNodeNear(grid, centre, radius, [&](int i, int j, int k) {
    const double x = i - centre[0], y = j - centre[1], z = k - centre[2];
    out.mask[grid.index(i, j, k)] = x * x + y * y + z * z < radius * radius;
  });

  out.exact.resize(grid.size());
  std::vector<double> gradient(3 * grid.size());
  double fluid = 0, sum = 0, square = 0, gradientSquare = 0;
  const double wavenumber = 2 * 3.14159265358979323846 / 64;
  forEachPhase(grid, [&](std::size_t node, double x, double y, double z) {
    const Value value = options.field == PressureField::ABC ? abc(x, y, z) : taylorGreen(x, y, z);
    out.exact[node] = value.pressure;
    for (int c = 0; c < 3; ++c) gradient[3 * node + c] = wavenumber * value.gradient[c];
    if (out.mask[node]) return;
    fluid += 1, sum += value.pressure, square += value.pressure * value.pressure;
    for (int c = 0; c < 3; ++c) gradientSquare += gradient[3 * node + c] * gradient[3 * node + c];
  });
  const double mean = sum / fluid, rms = std::sqrt(square / fluid - mean * mean);
  for (double& p : out.exact) p = (p - mean) / rms;

  std::vector<double> added;
  if (options.noise != GradientNoise::None) {
    out.sigma = options.noiseLevel * std::sqrt(gradientSquare / fluid / 3) / rms;
    added = noise(grid, options.noise);
  }
  out.gradient.resize(gradient.size());
  for (std::size_t e = 0; e < gradient.size(); ++e)
    out.gradient[e] = float(gradient[e] / rms + (added.empty() ? 0 : out.sigma * added[e]));
  return out;
}

/// How far a pressure is from the exact one, with its mean over the fluid taken out; relative to the exact
/// rms.
struct PressureErrors {
  double all = 0;  ///< rms over the fluid
  double wall = 0; ///< rms over the nodes that share a face with the mask
};

inline PressureErrors pressureErrors(const PressureCase& problem, const std::vector<float>& pressure) {
  const Grid& grid = problem.grid;
  double fluid = 0, mean = 0;
  for (std::size_t node = 0; node < grid.size(); ++node)
    if (!problem.mask[node]) fluid += 1, mean += pressure[node] - problem.exact[node];
  mean /= fluid;
  const auto touchesMask = [&](int i, int j, int k) {
    const int at[3] = {i, j, k};
    const std::ptrdiff_t stride[3] = {1, grid.n[0], std::ptrdiff_t(grid.n[0]) * grid.n[1]};
    const std::size_t node = grid.index(i, j, k);
    for (int a = 0; a < 3; ++a)
      if ((at[a] > 0 && problem.mask[node - stride[a]]) ||
          (at[a] + 1 < grid.n[a] && problem.mask[node + stride[a]]))
        return true;
    return false;
  };
  double all = 0, wall = 0, walls = 0;
  for (int k = 0; k < grid.n[2]; ++k)
    for (int j = 0; j < grid.n[1]; ++j)
      for (int i = 0; i < grid.n[0]; ++i) {
        const std::size_t node = grid.index(i, j, k);
        if (problem.mask[node]) continue;
        const double error = pressure[node] - problem.exact[node] - mean;
        all += error * error;
        if (touchesMask(i, j, k)) wall += error * error, walls += 1;
      }
  return {std::sqrt(all / fluid), walls > 0 ? std::sqrt(wall / walls) : 0};
}

/// rms(p of the noisy gradient - p of the clean one)/(sigma h) over the fluid, means taken out.
inline double noiseAmplification(const PressureCase& noisy, const std::vector<float>& pressure,
                                 const std::vector<float>& clean) {
  double fluid = 0, sum = 0, square = 0;
  for (std::size_t node = 0; node < noisy.grid.size(); ++node) {
    if (noisy.mask[node]) continue;
    const double difference = double(pressure[node]) - clean[node];
    fluid += 1, sum += difference, square += difference * difference;
  }
  const double mean = sum / fluid;
  return std::sqrt(square / fluid - mean * mean) / (noisy.sigma * noisy.grid.spacing[0]);
}

} // namespace rimflow
