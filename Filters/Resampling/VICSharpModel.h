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
  std::size_t wallPoints = 0; ///< the last so many are not particles but points on a wall
  std::size_t size() const { return position.size() / 3; }
  std::size_t particles() const { return size() - wallPoints; }
};

/// Constants of the cost function.
struct VICSharpConstants {
  double viscosity = 0;            ///< nu, m2/s, >= 0
  double particleSpacing = 0;      ///< r, m, > 0
  double velocityScale = 0;        ///< su, m/s, > 0
  double accelerationScale = 0;    ///< sa, m/s2, > 0
  double accelerationWeight = 0.3; ///< alpha, >= 0
  double curvatureWeight = 0.01;   ///< bc, >= 0
  double velocityOutlier = 0;      ///< hu, m/s: larger misfits of a particle count linearly; 0: never
  double accelerationOutlier = 0;  ///< ha, m/s2, likewise
  int order = 4;                   ///< of the central differences and of sampling, 2 or 4
  /// Signed distance of x, y, z from the nearest wall or void, m, < 0 inside; empty: there is none.
  std::function<double(double, double, double)> distance;
  /// bc^2 inside over bc^2 at the wall, > 0; less than 1 where the wall's velocity is known, as the velocity
  /// has a kink there.
  double insideSmoothness = 1;

  /// sf = nu su/r^2: the friction on eddies as large as the particles' spacing, m/s2.
  double frictionScale() const { return viscosity * velocityScale / (particleSpacing * particleSpacing); }
  /// sg: what the pressure gradient balances, acceleration or friction, m/s2.
  double pressureGradientScale() const { return std::hypot(accelerationScale, frictionScale()); }
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

/// VIC# (Jeon, Mueller & Michaelis 2022) with its penalties taken to their limits. There, the vorticity, the
/// velocity and its time derivative on the boundary and the pressure are unknown, and the vorticity equation
/// and penalties on div u, div w, div du/dt and the Navier-Stokes residual tie them together. Here, the same
/// equations hold exactly: the velocity is the curl of a vector potential, so it and the vorticity have no
/// sources; the acceleration is that of the pressure, whose Poisson equation says that du/dt has none; and
/// the curl of that acceleration is the vorticity equation. Unknown are {c, b, s}: the potential's modes, the
/// pressure on the boundary, and its sources inside walls and voids, scaled:
///     A = su r Z F c                                vector potential
///     u = curl A                                    velocity less its mean;  Gu_ij = D_j u_i
///     M p = -Gu_ij Gu_ji,   p = sg r Fb b on the boundary
///     a_i = -D_i p + nu (L u)_i                     = Du/Dt
///     J = |P u - u_p|^2/(Np su^2) + alpha^2 |P a - a_p|^2/(Np sa^2)
///       + bc^2 (4 r^6 <|L L A|^2>/su^2 + 2 r^5 A/V <|Lt p|^2/(sg r)^2> on the faces)
/// where |.|^2 of the data becomes Huber's function for particles that miss by more than hu or ha. The
/// penalty on curvature is that of the vorticity's Laplacian, r^4 <|L w|^2>/sw^2 with sw = su/(2 r), since
/// w = -L A up to a gradient. The mean velocity does not enter.
/// Z are modes of a box with free faces, and F, Fb make the Hessian of J roughly the identity; they change
/// the path to the minimum, not the minimum. M is the compact Laplacian of fourth order (of second, if the
/// differences are), Lt the Laplacian
/// within a face, A and V are the area and the volume of the box. Inside a wall or a void (distance < 0) the
/// fields are smooth extensions of those outside, and the equation of the pressure does not hold there: M p =
/// (1 - s) (...) + s f, where f is unknown too (a weak penalty on f keeps it finite), and s rises from 0 at
/// half a spacing outside to 1. Next to a wall the flow changes more quickly than elsewhere: bc^2 falls to a
/// hundredth at the wall. The gradient is the exact discrete adjoint of these lines.
template <class Real>
class VICSharpModel {
public:
  using Vector = std::vector<Real>;
  using VectorField = std::array<std::vector<Real>, 3>;
  /// A solution in physical units on its grid, to start another one from.
  struct State {
    Grid grid;
    VectorField potential; ///< A, m2/s: its curl is the velocity less the mean
    Vector pressure;       ///< over density, m2/s2; empty without acceleration data
    Vector source;         ///< of the pressure inside walls and voids, 1/s2; empty: nothing is inside
  };

  /// At least 5 nodes per axis.
  VICSharpModel(const Grid& grid, const VICSharpData& data, const VICSharpConstants& constants);

  const Grid& grid() const { return grid_; }
  const VICSharpConstants& constants() const { return constants_; }
  /// New weights bc, alpha (> 0 if it was so before) and outlier limits hu, ha; the rest stays. Unknowns
  /// change their meaning with bc and alpha: carry them over with unknowns(state()).
  void setWeights(const VICSharpConstants& constants);
  bool hasAccelerationData() const {
    return !accelerationData_[0].empty() && constants_.accelerationWeight > 0;
  }
  /// Unknowns, in the order c (x, y, z components), and, with acceleration data, b, s.
  std::size_t size() const {
    return 3 * grid_.size() + (hasAccelerationData() ? boundary_.size() + inside_.size() : 0);
  }

  /// J and its gradient. Fields and terms below then belong to x.
  double cost(const Vector& x, Vector& gradient);
  /// The fields alone.
  void forward(const Vector& x);
  /// Without acceleration data the pressure is known up to a harmonic function. This takes the one for which
  /// <|du/dt|^2> = <|grad p + U . grad u - nu L u|^2> is least as seen from a frame that moves with `frame`,
  /// m/s, and sets the acceleration that belongs to it.
  void accelerationOfSteadiestFlow(const std::array<double, 3>& frame);

  const VectorField& velocity() const { return u_; } ///< less the mean
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
    std::unique_ptr<BoxPoisson<Real>> smooth, unsmooth; ///< Fb and its inverse
  };
  /// The 5-point Laplacian within a face at one boundary node.
  struct FaceLaplacian {
    std::uint32_t centre, neighbour[4];
    Real weight[2];
  };

  double sourceScale() const { return 3 * constants_.pressureGradientScale() / constants_.particleSpacing; }
  double potentialScale() const { return constants_.velocityScale * constants_.particleSpacing; }
  double pressureScale() const { return constants_.pressureGradientScale() * constants_.particleSpacing; }
  double bending(double eigenvalue) const;
  double hessian(double eigenvalue) const;
  void findInside();
  void makePreconditioners();
  template <class F>
  void forEachReached(std::size_t boundaryNode, F&& f) const;
  void makeFaceLaplacian();
  void applyFaces(const std::unique_ptr<BoxPoisson<Real>> Face::*map, const Real* from, Real scale,
                  Real* to) const;
  AxisBasis normalBasis(int axis) const;
  void curl(const VectorField& f, VectorField& out) const;
  void curlTransposed(const VectorField& bar, VectorField& out) const;
  void solvePressure(const Real* source);
  double solvePressureTransposed(const Real* source, Real* sourceBar);
  void materialAcceleration();
  void materialAccelerationTransposed();
  double velocityMisfit();
  double accelerationMisfit();
  double penaliseCurvature(const Vector& x, Vector& gradient);
  double penaliseBoundaryCurvature();

  Grid grid_;
  VICSharpConstants constants_;
  Stencils<Real> stencils_;
  BoxPoisson<Real> poisson_; // M
  std::vector<Real> reach_;  // of a boundary value on the nodes inwards
  std::array<AxisBasis, 3> modes_;
  std::unique_ptr<BoxPoisson<Real>> smooth_; // Z F
  std::unique_ptr<BoxPoisson<Real>> bend_;   // Z k^4 F, where the smoothness varies
  Vector prior_;                             // bc^2 k^8 F^2 of each mode, where it does not
  BoundaryNodes boundary_;
  std::vector<Face> faces_;
  std::vector<FaceLaplacian> faceLaplacian_;
  std::vector<std::uint32_t> inside_; ///< nodes where the pressure's source is free
  Vector insideShare_;                ///< s, 0 < s <= 1, of each of them
  Vector smoothness_;                 ///< part of bc^2 that counts, per node; empty: 1
  double areaOverVolume_ = 0;
  Sampler<Real> sampler_;
  std::array<Real, 3> mean_;
  std::array<Vector, 3> velocityData_, accelerationData_;
  Vector velocityWeight_, accelerationWeight_;
  VectorField potential_, u_, a_, work_;
  std::array<Vector, 9> gradient_; // D_j u_i at 3 i + j; then their adjoints
  Vector p_, source_;              // source_: the unknown f of each node inside
  VectorField uBar_, aBar_;        // adjoints: dJ/du and so on
  Vector pBar_, boundaryPressure_, boundaryBar_;
  VectorField sampled_;
  std::vector<double> velocityMisfits_, accelerationMisfits_;
};

extern template class VICSharpModel<float>;
extern template class VICSharpModel<double>;

} // namespace rimflow
