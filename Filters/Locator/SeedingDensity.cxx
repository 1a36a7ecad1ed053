#include "SeedingDensity.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace rimflow {
namespace {

constexpr double Pi = 3.14159265358979323846;
constexpr int Directions = 400;
constexpr double Backing = 8; // particles at which a narrow kernel weighs as much as the next wider one
constexpr int Passes[] = {1, 3, 12}; // of [1 2 1]/4, added per wider kernel (each doubles the width)
constexpr std::size_t MaximumCells = 200000;

/// One pass of [1 2 1]/4 along each axis; nothing comes in from outside.
void blur(std::vector<double>& f, const std::array<int, 3>& n) {
  const std::size_t stride[3] = {1, std::size_t(n[0]), std::size_t(n[0]) * n[1]};
  for (int a = 0; a < 3; ++a) {
    if (n[a] < 2) continue;
    const int b = (a + 1) % 3, c = (a + 2) % 3;
    for (int j = 0; j < n[c]; ++j)
      for (int i = 0; i < n[b]; ++i) {
        double* row = f.data() + i * stride[b] + j * stride[c];
        double before = 0;
        for (int k = 0; k < n[a]; ++k) {
          double& here = row[k * stride[a]];
          const double after = k + 1 < n[a] ? row[(k + 1) * stride[a]] : 0;
          const double value = 0.25 * before + 0.5 * here + 0.25 * after;
          before = here;
          here = value;
        }
      }
  }
}

std::vector<Eigen::Vector3d> fibonacci(int n) {
  std::vector<Eigen::Vector3d> directions;
  const double golden = Pi * (3 - std::sqrt(5.));
  for (int i = 0; i < n; ++i) {
    const double z = 1 - (2 * i + 1.) / n, r = std::sqrt(1 - z * z);
    directions.emplace_back(r * std::cos(golden * i), r * std::sin(golden * i), z);
  }
  return directions;
}

} // namespace

const std::vector<Eigen::Vector3d>& evenDirections() {
  static const std::vector<Eigen::Vector3d> directions = fibonacci(Directions);
  return directions;
}

SeedingDensity::SeedingDensity(const ParticleIndex& particles, double cell)
    : particles_(&particles), box_(particles.box()) {
  const Eigen::Vector3d size = box_.size().cwiseMax(1e-9);
  const double volume = size.prod();
  cell = std::max({cell, std::cbrt(volume / std::max<std::size_t>(particles.size(), 1)),
                   std::cbrt(volume / MaximumCells)});
  for (int a = 0; a < 3; ++a) {
    n_[a] = std::max(1, int(std::lround(size[a] / cell)));
    h_[a] = size[a] / n_[a];
  }
  count_.assign(std::size_t(n_[0]) * n_[1] * n_[2], 0);
  for (std::size_t p = 0; p < particles.size(); ++p) {
    const Eigen::Vector3d x = particles.position(p);
    if (box_.contains(x)) ++count_[cellIndex(cellOf(0, x[0]), cellOf(1, x[1]), cellOf(2, x[2]))];
  }
  measureDispersion();
  exclude({});
}

void SeedingDensity::exclude(const std::vector<Body>& bodies) {
  constexpr int Sub = 4; // points per axis with which a cut cell's free volume is sampled
  std::vector<double> count = count_, volume(count_.size(), h_.prod());
  for (std::size_t b = 0; b < bodies.size(); ++b) {
    const Body& body = bodies[b];
    const double radius = 0.5 * body.diameter;
    // Where bodies overlap, the first one counts.
    auto own = [&](const Eigen::Vector3d& x) {
      return body.contains(x) && std::none_of(bodies.begin(), bodies.begin() + b,
                                              [&x](const Body& earlier) { return earlier.contains(x); });
    };
    if ((body.centre.array() + radius < box_.lower.array()).any() ||
        (body.centre.array() - radius > box_.upper.array()).any())
      continue;
    int lo[3], hi[3];
    for (int a = 0; a < 3; ++a) {
      lo[a] = cellOf(a, body.centre[a] - radius);
      hi[a] = cellOf(a, body.centre[a] + radius);
    }
    for (int k = lo[2]; k <= hi[2]; ++k)
      for (int j = lo[1]; j <= hi[1]; ++j)
        for (int i = lo[0]; i <= hi[0]; ++i)
          for (int s = 0; s < Sub * Sub * Sub; ++s) {
            const Eigen::Vector3d at(i + (s % Sub + 0.5) / Sub, j + (s / Sub % Sub + 0.5) / Sub,
                                     k + (s / Sub / Sub + 0.5) / Sub);
            if (own(box_.lower + at.cwiseProduct(h_)))
              volume[cellIndex(i, j, k)] -= h_.prod() / (Sub * Sub * Sub);
          }
    particles_->forEachWithin(body.centre, radius, [&](std::uint32_t, float dx, float dy, float dz) {
      const Eigen::Vector3d x = body.centre + Eigen::Vector3d(dx, dy, dz);
      if (!box_.contains(x) || !own(x)) return;
      double& n = count[cellIndex(cellOf(0, x[0]), cellOf(1, x[1]), cellOf(2, x[2]))];
      n = std::max(0., n - 1);
    });
  }
  estimate(std::move(count), volume);
}

// b(x) = m X(x) Y(y) Z(z), the seeding's profiles across the volume, from sums over slabs of cells (iterative
// proportional fitting, Deming & Stephan 1940), so that a body's hole does not show in them.
std::vector<double> SeedingDensity::profiles(const std::vector<double>& count,
                                             const std::vector<double>& volume) const {
  std::vector<double> base(count.size(), mean_);
  for (int sweep = 0; sweep < 3; ++sweep)
    for (int a = 0; a < 3; ++a) {
      std::vector<double> found(n_[a], 0), expected(n_[a], 0);
      forEachCell([&](std::size_t c, const int* at) {
        found[at[a]] += count[c];
        expected[at[a]] += base[c] * std::max(0., volume[c]);
      });
      for (int i = 0; i < n_[a]; ++i) found[i] = (found[i] + Backing) / (expected[i] + Backing);
      forEachCell([&](std::size_t c, const int* at) { base[c] *= found[at[a]]; });
    }
  return base;
}

// n = b r, and r from wide kernels to narrow ones: r_l = (C_l + B r_wider)/(E_l + B) with C and E the found
// and expected (b times free volume) particles under kernel l, B the backing.
void SeedingDensity::estimate(std::vector<double> count, const std::vector<double>& volume) {
  double particles = 0, space = 0;
  for (std::size_t c = 0; c < count.size(); ++c) {
    particles += count[c];
    space += std::max(0., volume[c]);
  }
  mean_ = space > 0 ? particles / space : 0;
  density_.assign(count.size(), mean_);
  cautious_ = density_;
  if (mean_ <= 0) return;
  const std::vector<double> base = profiles(count, volume);
  std::vector<double> expected(count.size());
  for (std::size_t c = 0; c < count.size(); ++c) expected[c] = base[c] * std::max(0., volume[c]);
  std::vector<std::vector<double>> counts, expectations;
  std::vector<double> weight; // kernel sums as particles: the kernel holds about (3.5 sigma)^3 cells' worth
  int passes = 0;
  for (int more : Passes) {
    for (int p = 0; p < more; ++p) {
      blur(count, n_);
      blur(expected, n_);
    }
    passes += more;
    counts.push_back(count);
    expectations.push_back(expected);
    weight.push_back(std::pow(3.545 * std::sqrt(0.5 * passes), 3)); // sigma^2 = passes/2 cells^2
  }
  for (std::size_t c = 0; c < density_.size(); ++c) {
    double ratio = 1;
    for (std::size_t l = counts.size(); l-- > 0;)
      ratio = (weight[l] * counts[l][c] + Backing * ratio) / (weight[l] * expectations[l][c] + Backing);
    density_[c] = base[c] * ratio;
    cautious_[c] = base[c] * std::min(1., ratio);
  }
}

double SeedingDensity::interpolate(const std::vector<double>& values, const Eigen::Vector3d& x) const {
  if (!box_.contains(x)) return 0;
  int i0[3], i1[3];
  double f[3];
  for (int a = 0; a < 3; ++a) {
    const double g = std::min(std::max((x[a] - box_.lower[a]) / h_[a] - 0.5, 0.), n_[a] - 1.);
    i0[a] = int(g);
    i1[a] = std::min(i0[a] + 1, n_[a] - 1);
    f[a] = g - i0[a];
  }
  auto row = [&](int j, int k) {
    return (1 - f[0]) * values[cellIndex(i0[0], j, k)] + f[0] * values[cellIndex(i1[0], j, k)];
  };
  return (1 - f[2]) * ((1 - f[1]) * row(i0[1], i0[2]) + f[1] * row(i1[1], i0[2])) +
         f[2] * ((1 - f[1]) * row(i0[1], i1[2]) + f[1] * row(i1[1], i1[2]));
}

double SeedingDensity::expectedWithin(const Eigen::Vector3d& centre, double radius) const {
  return integrate(density_, centre, radius);
}
double SeedingDensity::cautiouslyExpectedWithin(const Eigen::Vector3d& centre, double radius) const {
  return integrate(cautious_, centre, radius);
}

double SeedingDensity::integrate(const std::vector<double>& values, const Eigen::Vector3d& centre,
                                 double radius) const {
  // Gauss-Legendre in r^3 (uniform in volume), even directions
  constexpr double node[] = {0.0469100770306680, 0.2307653449471585, 0.5, 0.7692346550528415,
                             0.9530899229693320};
  constexpr double weight[] = {0.1184634425280945, 0.2393143352496832, 0.2844444444444444, 0.2393143352496832,
                               0.1184634425280945};
  double sum = 0;
  for (int s = 0; s < 5; ++s) {
    double shell = 0;
    for (const Eigen::Vector3d& e : evenDirections())
      shell += interpolate(values, centre + radius * std::cbrt(node[s]) * e);
    sum += weight[s] * shell / Directions;
  }
  return sum * ballVolume(radius);
}

Eigen::Vector3d SeedingDensity::expectedGradient(const Eigen::Vector3d& centre, double radius) const {
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  for (const Eigen::Vector3d& e : evenDirections()) sum += at(centre + radius * e) * e;
  return sum * (4 * Pi * radius * radius / Directions);
}

double SeedingDensity::expectedPerRadius(const Eigen::Vector3d& centre, double radius) const {
  double sum = 0;
  for (const Eigen::Vector3d& e : evenDirections()) sum += at(centre + radius * e);
  return sum * (4 * Pi * radius * radius / Directions);
}

void SeedingDensity::measureDispersion() {
  constexpr int Edge = 3; // cells per block and axis
  const int m[3] = {n_[0] / Edge, n_[1] / Edge, n_[2] / Edge};
  if (m[0] < 1 || m[1] < 1 || m[2] < 1) return;
  auto block = [&m](int i, int j, int k) { return i + std::size_t(m[0]) * (j + std::size_t(m[1]) * k); };
  std::vector<double> count(std::size_t(m[0]) * m[1] * m[2], 0);
  for (int k = 0; k < m[2] * Edge; ++k)
    for (int j = 0; j < m[1] * Edge; ++j)
      for (int i = 0; i < m[0] * Edge; ++i)
        count[block(i / Edge, j / Edge, k / Edge)] += count_[cellIndex(i, j, k)];
  // Against the mean of the two neighbours along one axis, so that a slope cancels; the axis with the least
  // spread counts, so that a smooth profile across the light sheet is not taken for clusters.
  double least = std::numeric_limits<double>::infinity();
  for (int a = 0; a < 3; ++a) {
    std::vector<double> squared;
    for (int k = 0; k < m[2]; ++k)
      for (int j = 0; j < m[1]; ++j)
        for (int i = 0; i < m[0]; ++i) {
          const int at[3] = {i, j, k};
          if (at[a] == 0 || at[a] == m[a] - 1) continue;
          const int di = a == 0, dj = a == 1, dk = a == 2;
          const double expected =
              0.5 * (count[block(i - di, j - dj, k - dk)] + count[block(i + di, j + dj, k + dk)]);
          const double difference = count[block(i, j, k)] - expected;
          if (expected >= 1) squared.push_back(difference * difference / (1.5 * expected));
        }
    if (squared.size() < 12) continue;
    std::nth_element(squared.begin(), squared.begin() + squared.size() / 2, squared.end());
    const double estimate = squared[squared.size() / 2] / 0.4549; // median of chi-squared with 1 dof
    least = std::min(least, estimate / (1 + 4.6 / std::sqrt(double(squared.size())))); // less its own 2 sigma
  }
  if (std::isfinite(least)) dispersion_ = std::max(1., least);
}

} // namespace rimflow
