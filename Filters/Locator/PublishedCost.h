#pragma once
#include "Grid.h"
#include "ParticleIndex.h"

#include <Eigen/Core>

namespace rimflow {

/// The flow on a grid, as the criteria need it.
struct FlowField {
  Grid grid;
  const float* velocity = nullptr;     ///< three per node, m/s
  const float* q = nullptr;            ///< Q-criterion, one per node, 1/s2
  const unsigned char* mask = nullptr; ///< non-zero: not fluid, left out; or null
};

/// Constants of the published cost function; the defaults are the published ones.
struct PublishedCostOptions {
  double diameter = 0;                           ///< of the sphere, m, > 0
  Eigen::Vector3d up = Eigen::Vector3d::UnitY(); ///< against gravity, any length; 0: directionOfMotion
  double weightVoid = 1;                         ///< of D; 0 leaves the criterion out
  double weightVelocity = 3.077;                 ///< w1
  double weightVortex = 4.415;                   ///< w2
  double a = 1.1, b = 1.5, c = 2, e = 2.5;       ///< radii of the shells over R; 0 < b < c, 1 < e, a > 0
  double velocityScale = 0;  ///< V0, m/s; 0: 99th percentile of the speed within 2 R of the guess
  double vortexScale = 0;    ///< Q0, 1/s2; 0: 99th percentile of |Q| within e R of the guess
  double seedingDensity = 0; ///< n0, 1/m3; 0: particles over the volume of the seeded box less the sphere
  double searchSide =
      0;           ///< side of the cube around the guess in which the centre is sought, m; 0: the diameter
  double step = 0; ///< of the finite differences, m; 0: the grid spacing
  double tolerance = 1e-3; ///< stop when R |grad J| is below
  int maximumIterations = 100;
};

/// The three criteria at one candidate, normalised.
struct Criteria {
  double density = 0;                     ///< D
  double velocityIn = 0, velocityOut = 0; ///< Vin, Vout
  double vortexIn = 0, vortexOut = 0;     ///< Qin, Qout
};

enum class Convergence { Gradient, NoDescent, Iterations };

struct PublishedEstimate {
  Eigen::Vector3d centre = Eigen::Vector3d::Zero();     ///< minimiser of J, m
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero(); ///< inverse of the Hessian of J, m2; 0 when that is
                                                        ///< not positive definite, rounding aside
  bool positiveDefinite = false;
  double cost = 0;         ///< J at the centre
  double gradientNorm = 0; ///< |grad J| there, 1/m
  int iterations = 0;
  Convergence convergence = Convergence::Iterations; ///< NoDescent: the line search found nothing lower
  std::size_t particlesInside = 0;
  Eigen::Vector3d voidMinimiser, velocityMinimiser, vortexMinimiser; ///< of each criterion alone, m
};

/// The criteria of section "Sphere Detection" (Jose et al. 2025) at candidate x; R: radius of the sphere:
///     D    = particles within R / (4/3 pi R^3) / n0
///     Vin  = mean upward velocity / V0 over the upper hemisphere r < a R,   Vout: over b R < r < c R
///     Qin  = integral of Q over r < a R / (4/3 pi R^3) / Q0,   Qout = mean of Q over R < r < e R / Q0
/// Integrals are sums over the grid's nodes; a node within half a spacing of a region's edge counts in part,
/// so that they are continuous in x. Only nodes on the grid and outside the mask count. The scales in
/// `options` must be set (minimisePublishedCost sets them).
Criteria publishedCriteria(const ParticleIndex& particles, const FlowField& flow, const Eigen::Vector3d& x,
                           const PublishedCostOptions& options);

/// Where the body at `centre` (m) is going, from the fluid that it drags along: the unit vector along the sum
/// of |u|^2 u over the nodes within one diameter of it, in which the fluid at the wall outweighs the wake. On
/// the CFD at Re = 100 it is 0.1 degrees off, and 1 degree when `centre` is half a diameter off. +y where the
/// fluid is at rest.
Eigen::Vector3d directionOfMotion(const FlowField& flow, const Eigen::Vector3d& centre, double diameter);

/// J(x) = D + w1 (-Vin + Vout) + w2 (Qin - Qout), eq. "cost_function".
double publishedCost(const Criteria& criteria, const PublishedCostOptions& options);

/// The published search: the minimum of D on a coarse grid of the search cube starts a Polak-Ribiere
/// conjugate gradient with backtracking line search; derivatives are fourth-order central differences.
/// Nothing outside the cube is looked at. Throws std::invalid_argument when an option is out of range or the
/// cube misses the grid.
PublishedEstimate minimisePublishedCost(const ParticleIndex& particles, const FlowField& flow,
                                        const Eigen::Vector3d& guess, const PublishedCostOptions& options);

} // namespace rimflow
