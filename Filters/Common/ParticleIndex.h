#pragma once
#include <Eigen/Core>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace rimflow {

/// An axis-aligned box, m.
struct Box {
  Eigen::Vector3d lower = Eigen::Vector3d::Zero();
  Eigen::Vector3d upper = Eigen::Vector3d::Zero();

  Eigen::Vector3d size() const { return upper - lower; }
  double volume() const { return size().prod(); }
  bool contains(const Eigen::Vector3d& x) const {
    return (x.array() >= lower.array()).all() && (x.array() <= upper.array()).all();
  }
  Eigen::Vector3d clamp(const Eigen::Vector3d& x) const { return x.cwiseMax(lower).cwiseMin(upper); }
};

/// The particles of one snapshot, sorted into cells once (O(N), about 8 per cell), for "particles within r of
/// x". Particles whose position is not finite are left out.
class ParticleIndex {
public:
  /// positions: count triples x y z, m. The array is not needed afterwards.
  ParticleIndex(const float* positions, std::size_t count);

  std::size_t size() const { return x_.size(); }
  /// Particles left out because their position is not finite.
  std::size_t rejected() const { return rejected_; }
  /// The seeded box: per axis between the 0.05 % and the 99.95 % quantile of the positions, so that a few
  /// stray particles do not stretch it.
  const Box& box() const { return box_; }
  /// Particles per volume of the box, 1/m3; 0 when there are none.
  double meanDensity() const { return box_.volume() > 0 ? size() / box_.volume() : 0; }

  /// Calls use(id, dx, dy, dz) with the offset (float, m) from x for each particle closer than r; id is the
  /// place in the array that was given.
  template <class Use>
  void forEachWithin(const Eigen::Vector3d& x, double r, Use&& use) const;
  std::size_t countWithin(const Eigen::Vector3d& x, double r) const;

  /// Position k in the sorted order, m.
  Eigen::Vector3d position(std::size_t k) const { return box_.lower + Eigen::Vector3d(x_[k], y_[k], z_[k]); }

private:
  int cellOf(int axis, double offset) const {
    const double c = std::floor(offset / cell_);
    return c <= 0 ? 0 : c >= n_[axis] - 1 ? n_[axis] - 1 : int(c);
  }

  Box box_;
  double cell_ = 1;
  int n_[3] = {1, 1, 1};
  std::vector<std::uint32_t> first_; // per cell, the first particle in the sorted order; one more at the end
  std::vector<float> x_, y_, z_;     // relative to box_.lower, cells in order
  std::vector<std::uint32_t> id_;
  std::size_t rejected_ = 0;
};

template <class Use>
void ParticleIndex::forEachWithin(const Eigen::Vector3d& x, double r, Use&& use) const {
  if (x_.empty()) return;
  const Eigen::Vector3d o = x - box_.lower;
  const float ox = float(o[0]), oy = float(o[1]), oz = float(o[2]), rr = float(r * r);
  int lo[3], hi[3];
  for (int a = 0; a < 3; ++a) {
    lo[a] = cellOf(a, o[a] - r);
    hi[a] = cellOf(a, o[a] + r);
  }
  for (int k = lo[2]; k <= hi[2]; ++k)
    for (int j = lo[1]; j <= hi[1]; ++j) {
      const std::size_t row = std::size_t(n_[0]) * (j + std::size_t(n_[1]) * k);
      for (std::uint32_t p = first_[row + lo[0]]; p < first_[row + hi[0] + 1]; ++p) {
        const float dx = x_[p] - ox, dy = y_[p] - oy, dz = z_[p] - oz;
        if (dx * dx + dy * dy + dz * dz < rr) use(id_[p], dx, dy, dz);
      }
    }
}

} // namespace rimflow
