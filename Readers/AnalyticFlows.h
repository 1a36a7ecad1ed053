#pragma once
#include "Body.h"

namespace rimflow {

enum class FlowKind {
  StokesSphere = 0,    ///< creeping flow around a moving (and rotating) sphere: no slip at the wall
  PotentialSphere = 1, ///< irrotational flow around a moving sphere: exact Euler, slips along the wall
  HillsVortex = 2,     ///< Hill's spherical vortex (1894): exact Euler, fluid inside as well
  TaylorGreen = 3,     ///< decaying two-dimensional Taylor-Green vortices: exact Navier-Stokes
  ABC = 4,             ///< decaying Arnold-Beltrami-Childress flow: exact Navier-Stokes
};

/// A flow with a known answer everywhere, in the laboratory frame, at rest at infinity (spheres, vortex) or
/// periodic (Taylor-Green, ABC). SI units. Formulas and sources stand at their implementation.
///
/// What is exact: velocity is divergence-free and gradient(), acceleration() belong to it for every kind. The
/// pressure balances the momentum (grad p = -rho Du/Dt + mu lap u) for every kind but Stokes: there it is the
/// Stokes pressure (grad p = mu lap u), while the acceleration is the kinematic Du/Dt of the velocity field.
/// The outer (potential) fields have lap u = 0; inside Hill's vortex the viscous term is left out.
struct AnalyticFlow {
  FlowKind kind = FlowKind::StokesSphere;
  Body body;                ///< sphere or vortex at referenceTime; diameter 0: fluid at rest. Acceleration is
                            ///< constant, and none for Hill's vortex; only Stokes flow follows a rotation
  double referenceTime = 0; ///< s
  double density = 1820;    ///< of the fluid, kg/m3, > 0
  double viscosity = 1.1e-6; ///< kinematic, m2/s, >= 0
  double amplitude = 0.1;    ///< Taylor-Green, ABC: speed at referenceTime, m/s
  double wavelength = 0.02;  ///< Taylor-Green, ABC: period in space, m, > 0

  bool isPeriodic() const { return kind == FlowKind::TaylorGreen || kind == FlowKind::ABC; }
  /// True when there is a wall that no tracer may cross.
  bool hasWall() const {
    return (kind == FlowKind::StokesSphere || kind == FlowKind::PotentialSphere) && body.diameter > 0;
  }
  /// The sphere or vortex at time t; its diameter is 0 for a flow without one.
  Body bodyAt(double t) const;

  /// u(x, t), m/s. Inside a wall: the body's own motion (as for the next three).
  Eigen::Vector3d velocity(const Eigen::Vector3d& x, double t) const;
  /// The same, but continued smoothly into a wall, for integrators whose stages fall a hair inside.
  Eigen::Vector3d fluidVelocity(const Eigen::Vector3d& x, double t) const;
  /// G(i, j) = d u_i / d x_j, 1/s.
  Eigen::Matrix3d gradient(const Eigen::Vector3d& x, double t) const;
  /// Du/Dt = du/dt + (u . grad) u, m/s2.
  Eigen::Vector3d acceleration(const Eigen::Vector3d& x, double t) const;
  /// Dynamic pressure, Pa; 0 at infinity, or on average over a period. 0 inside a wall.
  double pressure(const Eigen::Vector3d& x, double t) const;

  /// The body's speed (with its rotation), Taylor-Green's largest, ABC's root-mean-square speed, m/s.
  double typicalSpeed(double t) const;
  /// A speed that no fluid exceeds at time t, m/s.
  double maximumSpeed(double t) const;
  /// The time in which what a tracer at x sees changes by its own size, s; infinite where nothing moves.
  double timeScale(const Eigen::Vector3d& x, double t) const;
};

} // namespace rimflow
