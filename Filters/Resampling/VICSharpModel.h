#pragma once
#include "BoxPoisson.h"
#include "Interpolation.h"
#include "Stencils.h"

#include <array>
#include <cmath>
#include <cstdint>
#include <functional>
#include <memory>
#include <vector>

namespace rimflow {

/// What the reconstruction is compared with. The mean velocity is subtracted from the data.
struct VICSharpData {
  std::vector<double> position;                           ///< x y z per particle, m, within the grid
  std::vector<double> velocity;                           ///< three per particle, m/s, less the mean
  std::vector<double> acceleration;                       ///< three per particle, m/s2; empty: velocity only
  std::vector<double> velocityWeight, accelerationWeight; ///< one per particle, >= 0; empty: 1
  std::array<double, 3> meanVelocity{0, 0, 0};
  std::size_t size() const { return position.size() / 3; }
};

/// Constants of the cost function.
struct VICSharpConstants {
  double viscosity = 0;                      ///< nu, m2/s, >= 0
  double particleSpacing = 0;                ///< r, m, > 0
  double velocityScale = 0;                  ///< su, m/s, > 0
  double accelerationScale = 0;              ///< sa, m/s2, > 0
  double accelerationWeight = 0.3;           ///< alpha, >= 0
  double divergenceWeight = 0.1;             ///< bu, >= 0
  double vorticityDivergenceWeight = 0.1;    ///< bw, >= 0
  double accelerationDivergenceWeight = 0.1; ///< bd, >= 0
  double navierStokesWeight = 0.1; ///< bn, >= 0; 0 without accelerations: velocity and vorticity alone
  double curvatureWeight = 0.01;   ///< bc, >= 0
  double velocityOutlier = 0;      ///< hu, m/s: larger misfits of a particle count linearly; 0: never
  double accelerationOutlier = 0;  ///< ha, m/s2, likewise
  int order = 4;                   ///< of the central differences and of sampling, 2 or 4
  bool precondition = true;        ///< unknowns scaled mode by mode, so that all converge at a like pace
  /// Signed distance of x, y, z from the nearest wall or void, m, < 0 inside; empty: there is none.
  std::function<double(double, double, double)> distance;
  double vorticityScale() const { return 0.5 * velocityScale / particleSpacing; } ///< sw
};

/// Huber's function of a squared misfit m^2: m^2 up to the threshold h, 2 h |m| - h^2 beyond (always m^2 if h
/// is 0); and its derivative by m^2.
struct Huber {
  double value, slope = 1;
  Huber(double square, double threshold) : value(square) {
    if (threshold <= 0 || square <= threshold * threshold) return;
    const double misfit = std::sqrt(square);
    value = 2 * threshold * misfit - threshold * threshold;
    slope = threshold / misfit;
  }
};

/// VIC+ (Schneiders & Scarano 2016) with the additions of VIC# (Jeon, Mueller & Michaelis 2022) as one
/// function of the unknowns {c, b, e}: the vorticity, the boundary velocity and its time derivative, scaled:
///     w = sw F c                                        Gw_ij = D_j w_i
///     L u = -curl w,   u = su Fb b on the boundary       Gu_ij = D_j u_i
///     q_i = w_j Gu_ij - U_j Gw_ij + nu (L w)_i           = dw/dt,   U = u + mean velocity
///     L d = -curl q,   d = sa Fe e on the boundary       = du/dt
///     a_i = d_i + U_j Gu_ij                              = Du/Dt
///     J = |P u - u_p|^2/(Np su^2) + alpha^2 |P a - a_p|^2/(Np sa^2)
///       + bu^2 <(div u)^2>/sw^2 + bw^2 r^2 <(div w)^2>/sw^2 + bd^2 r^2 <(div d)^2>/sa^2
///       + bn^2 min over p of <|a + grad p - nu L u|^2>/sa^2
///       + bc^2 (r^4 <|L w|^2>/sw^2 + 2 r^5 A/V <|Lt u|^2/su^2 + |Lt d|^2/sa^2> on the faces)
/// where |.|^2 of the data becomes Huber's function for particles that miss by more than hu or ha.
/// Inside a wall or a void (distance < 0) the fields are smooth extensions of those outside. The vorticity
/// equation does not hold there, as the wall makes vorticity: there q = (1 - s) (...) + s f, where f is
/// unknown too (a weak penalty on f keeps it finite), and s rises from 0 at half a spacing outside to 1. Next
/// to a wall the flow changes more quickly than elsewhere: bc^2 falls to a thirtieth at the wall.
/// p is pressure/density and is found exactly in each evaluation; Lt is the Laplacian within a face, A and V
/// are the area and the volume of the box. F, Fb and Fe are symmetric smoothing operators, diagonal in
/// cosines, that make the Hessian of J roughly the identity; they change the path to the minimum, not the
/// minimum. The gradient is the exact discrete adjoint of these lines.
template <class Real>
class VICSharpModel {
public:
  using Vector = std::vector<Real>;
  using VectorField = std::array<std::vector<Real>, 3>;
  /// The parts of J without alpha^2.
  struct Terms {
    double velocity = 0, acceleration = 0, divergence = 0, vorticityDivergence = 0,
           accelerationDivergence = 0, navierStokes = 0, curvature = 0;
  };
  /// A solution in physical units on its grid, to start another one from.
  struct State {
    Grid grid;
    VectorField vorticity, velocity, rate; ///< velocity less the mean; rate may be empty
    VectorField source;                    ///< dw/dt inside; empty: nothing is inside
    std::array<double, 3> mean;
  };

  VICSharpModel(const Grid& grid, const VICSharpData& data, const VICSharpConstants& constants);

  const Grid& grid() const { return grid_; }
  const VICSharpConstants& constants() const { return constants_; }
  /// New constants for the same data (order stays). Unknowns change their meaning with the curvature weight:
  /// carry them over with unknowns(state()).
  void setConstants(const VICSharpConstants& constants);
  bool hasAccelerationData() const {
    return !accelerationData_[0].empty() && constants_.accelerationWeight > 0;
  }
  bool hasPressure() const { return constants_.navierStokesWeight > 0; }
  bool hasRate() const { return hasAccelerationData() || hasPressure(); }
  /// Unknowns, in the order c (x, y, z components), b, e (if the model has a rate).
  std::size_t size() const {
    return 3 * (grid_.size() + (hasRate() ? 2 : 1) * boundary_.size() + inside_.size());
  }

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
  /// Squared misfit of each particle, m2/s2 and m2/s4, whatever its weight.
  const std::vector<double>& velocityMisfits() const { return velocityMisfits_; }
  const std::vector<double>& accelerationMisfits() const { return accelerationMisfits_; }

  /// The present solution, and the unknowns that come closest to a solution of any grid.
  State state() const;
  Vector unknowns(const State& state) const;

private:
  /// A face of the box without the nodes that an earlier face has.
  struct Face {
    Grid grid;                         ///< n is 1 along the normal
    std::vector<std::size_t> boundary; ///< place of each of its nodes among the boundary nodes
    std::unique_ptr<BoxPoisson<Real>> u, d, inverseU, inverseD; ///< Fb, Fe
  };
  /// The 5-point Laplacian within a face at one boundary node.
  struct FaceLaplacian {
    std::uint32_t centre, neighbour[4];
    Real weight[2];
  };

  void findInside();
  void freeInside(const Real* source);
  double freeInsideTransposed(const Real* source, Real* bar);
  double sourceScale() const { return 3 * constants_.accelerationScale / constants_.particleSpacing; }
  void makePreconditioners();
  void makeFaceLaplacian();
  AxisBasis normalBasis(int axis) const;
  void applyFaces(const std::unique_ptr<BoxPoisson<Real>> Face::*map, const Real* from, Real scale,
                  Real* to) const;
  void solveCurl(const VectorField& source, const Vector& boundaryValues, VectorField& out) const;
  void solveCurlTransposed(VectorField& bar, Vector& boundaryBar) const;
  void addCurlTransposed(const VectorField& bar, Real scale, VectorField& out, bool accumulate) const;
  void transport();
  void materialAcceleration();
  double velocityMisfit();
  double accelerationMisfit();
  double penaliseDivergence(const VectorField& f, double weight, VectorField& bar);
  void solvePressure();
  double penaliseMomentum();
  double penaliseCurvature();
  double penaliseBoundaryCurvature(const Vector& b, double scale, Vector& bar) const;
  void momentumTransposed();
  void transportTransposed();

  Grid grid_;
  VICSharpConstants constants_;
  Stencils<Real> stencils_;
  BoxPoisson<Real> poisson_;
  std::unique_ptr<BoxPoisson<Real>> pressurePoisson_;   // sum of D_i^T D_i
  std::unique_ptr<BoxPoisson<Real>> smooth_, unsmooth_; // F and its inverse
  BoundaryNodes boundary_;
  std::vector<Face> faces_;
  std::vector<FaceLaplacian> faceLaplacian_;
  std::vector<std::uint32_t> inside_; ///< nodes where dw/dt is free
  Vector insideShare_;                ///< s, 0 < s <= 1, of each of them
  Vector smoothness_;                 ///< part of bc^2 that counts, per node; empty: 1
  double areaOverVolume_ = 0;
  Sampler<Real> sampler_;
  std::array<Real, 3> mean_;
  std::array<Vector, 3> velocityData_, accelerationData_;
  Vector velocityWeight_, accelerationWeight_;
  Terms terms_;
  Vector source_;                 // the unknown f of each node inside, by component
  VectorField w_, u_, q_, d_, a_; // q_ holds its adjoint after transport
  Vector uBoundary_, dBoundary_;
  VectorField wBar_, uBar_, aBar_, dBar_; // adjoints: dJ/dw and so on
  Vector boundaryBar_, p_, scalar_;
  VectorField sampled_;
  std::vector<double> velocityMisfits_, accelerationMisfits_;
};

extern template class VICSharpModel<float>;
extern template class VICSharpModel<double>;

} // namespace rimflow
