#pragma once
#include "BoxPoisson.h"
#include "Interpolation.h"
#include "Stencils.h"

#include <array>
#include <memory>
#include <vector>

namespace rimflow {

/// What the reconstruction is compared with. The mean velocity is subtracted from the data.
struct VICSharpData {
  std::vector<double> position;           ///< x y z per particle, m, within the grid
  std::vector<double> velocity;           ///< three per particle, m/s, less the mean
  std::vector<double> acceleration;       ///< three per particle, m/s2; empty: velocity only
  std::vector<double> velocityWeight;     ///< one per particle, >= 0; empty: 1
  std::vector<double> accelerationWeight; ///< one per particle, >= 0; empty: 1
  std::array<double, 3> meanVelocity{0, 0, 0};
  std::size_t size() const { return position.size() / 3; }
};

/// Constants of the cost function.
struct VICSharpConstants {
  double viscosity = 0;                                                           ///< nu, m2/s, >= 0
  double particleSpacing = 0;                                                     ///< r, m, > 0
  double velocityScale = 0;                                                       ///< su, m/s, > 0
  double accelerationScale = 0;                                                   ///< sa, m/s2, > 0
  double accelerationWeight = 0.3;                                                ///< alpha, >= 0
  double divergenceWeight = 0;                                                    ///< bu, >= 0
  double vorticityDivergenceWeight = 0;                                           ///< bw, >= 0
  double accelerationDivergenceWeight = 0;                                        ///< bd, >= 0
  double navierStokesWeight = 0;                                                  ///< bn, >= 0
  double roughnessWeight = 0;                                                     ///< bc, >= 0
  int smoothingPasses = 1;                                                        ///< m, >= 1
  double vorticityScale() const { return 0.5 * velocityScale / particleSpacing; } ///< sw
  double pressureScale() const { return accelerationScale * particleSpacing; }    ///< sp
};

/// VIC+ (Schneiders & Scarano 2016) with the additions of VIC# (Jeon, Mueller & Michaelis 2022) as one
/// function of the unknowns {c, u_b/su, d_b/sa, p/sp}:
///     w = sw B c                                       Gw_ij = D_j w_i
///     L u = -curl w,   u = u_b on the boundary          Gu_ij = D_j u_i
///     q_i = w_j Gu_ij - U_j Gw_ij + nu (L w)_i          = dw/dt,   U = u + mean velocity
///     L d = -curl q,   d = d_b on the boundary          = du/dt
///     a_i = d_i + U_j Gu_ij                             = Du/Dt
///     J = |P u - u_p|^2/(Np su^2) + alpha^2 |P a - a_p|^2/(Np sa^2)
///       + bu^2 <(div u)^2>/sw^2 + bw^2 r^2 <(div w)^2>/sw^2 + bd^2 r^2 <(div d)^2>/sa^2
///       + bn^2 <|a + grad p - nu L u|^2>/sa^2 + bc^2 <|c|^2>
/// (p: pressure/density). Its gradient is the exact discrete adjoint of these lines.
template <class Real>
class VICSharpModel {
public:
  using Vector = std::vector<Real>;
  using VectorField = std::array<std::vector<Real>, 3>;
  /// The parts of J; the misfits are without alpha: mean squared misfit per component in units of su, sa,
  /// times three.
  struct Terms {
    double velocity = 0, acceleration = 0, divergence = 0, vorticityDivergence = 0,
           accelerationDivergence = 0, navierStokes = 0, roughness = 0;
  };

  VICSharpModel(const Grid& grid, const VICSharpData& data, const VICSharpConstants& constants);

  const Grid& grid() const { return grid_; }
  const VICSharpConstants& constants() const { return constants_; }
  const BoundaryNodes& boundary() const { return boundary_; }
  bool hasAcceleration() const { return constants_.accelerationWeight > 0; }
  bool hasPressure() const { return hasAcceleration() && constants_.navierStokesWeight > 0; }
  /// Unknowns, in the order c (x y z components), u_b, d_b (if accelerations are used).
  std::size_t size() const;
  std::size_t boundaryVelocityOffset() const { return 3 * grid_.size(); }
  std::size_t boundaryRateOffset() const { return 3 * (grid_.size() + boundary_.size()); }

  /// J and its gradient. Fields and terms below then belong to x.
  double cost(const Vector& x, Vector& gradient);
  /// The fields alone.
  void forward(const Vector& x);

  const Terms& terms() const { return terms_; }
  const VectorField& vorticity() const { return w_; }
  const VectorField& velocity() const { return u_; } ///< less the mean
  const VectorField& rate() const { return d_; }     ///< du/dt
  const VectorField& acceleration() const { return a_; }
  const Vector& pressure() const { return p_; } ///< over density

private:
  void smooth(const std::array<const Real*, 3>& from, const std::array<Real*, 3>& to);
  void solveCurl(const VectorField& source, const Real* boundaryValues, Real scale, VectorField& out) const;
  void solveCurlTransposed(VectorField& bar, Real scale, Real* boundaryGradient) const;
  void addCurlTransposed(const VectorField& bar, Real scale, VectorField& out, bool accumulate) const;
  AxisBasis normalBasis(int axis) const;
  void transport();
  void materialAcceleration();
  double velocityMisfit();
  double accelerationMisfit();
  double penaliseDivergence(const VectorField& f, double weight, Vector& bar) const;
  void solvePressure();
  double penaliseMomentum();
  double penaliseRoughness(const Real* c, Real* gradient) const;
  void momentumTransposed();
  void rateTransposed();
  void transportTransposed();
  void addDivergenceTransposed(const Vector& bar, VectorField& out) const;

  Grid grid_;
  VICSharpConstants constants_;
  Stencils<Real> stencils_;
  BoxPoisson<Real> poisson_;
  std::unique_ptr<BoxPoisson<Real>> pressurePoisson_; // sum of D_i^T D_i
  BoundaryNodes boundary_;
  TrilinearSampler<Real> sampler_;
  std::array<Real, 3> mean_;
  std::array<Vector, 3> velocityData_, accelerationData_;
  Vector velocityWeight_, accelerationWeight_;
  Terms terms_;
  VectorField w_, u_, q_, d_, a_;         // q_ holds its adjoint after transport
  VectorField wBar_, uBar_, aBar_, dBar_; // adjoints: dJ/dw and so on
  Vector divergenceUBar_, divergenceWBar_, divergenceDBar_;
  Vector p_, sampled_;
};

extern template class VICSharpModel<float>;
extern template class VICSharpModel<double>;

} // namespace rimflow
