#include "AnalyticFlows.h"

#include <limits>

namespace rimflow {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

// All velocity fields around a sphere of radius R at the origin are linear in its velocity V.
// r = x - centre, and grad of f(r) V_i, (V.r) r_i f(r) by the product rule.

/// f(r) V_i has gradient f'(r)/r V_i r_j; slope = f'(r)/r.
Matrix3d gradientAlong(const Vector3d& V, const Vector3d& r, double slope) {
  return slope * V * r.transpose();
}
/// f(r) (V.r) r_i has gradient f (V_j r_i + (V.r) delta_ij) + f'(r)/r (V.r) r_i r_j.
Matrix3d gradientRadial(const Vector3d& V, const Vector3d& r, double f, double slope) {
  const double Vr = V.dot(r);
  return f * (r * V.transpose() + Vr * Matrix3d::Identity()) + slope * Vr * r * r.transpose();
}
Matrix3d crossMatrix(const Vector3d& w) {
  Matrix3d m;
  m << 0, -w[2], w[1], w[2], 0, -w[0], -w[1], w[0], 0;
  return m;
}

// Stokes (1851); Batchelor, An Introduction to Fluid Dynamics, section 4.9:
//   u = (3R/4)(V/r + (V.r) r/r^3) + (R^3/4)(V/r^3 - 3 (V.r) r/r^5) + (R/r)^3 W x r
//   p = (3/2) mu R (V.r)/r^3
Vector3d stokesVelocity(const Vector3d& r, double R, const Vector3d& V, const Vector3d& W) {
  const double i2 = 1 / r.squaredNorm(), i1 = std::sqrt(i2), a = R * i1, a3 = a * a * a;
  return (0.75 * a + 0.25 * a3) * V + (0.75 * (a - a3) * i2 * V.dot(r)) * r + a3 * W.cross(r);
}
Matrix3d stokesGradient(const Vector3d& r, double R, const Vector3d& V, const Vector3d& W) {
  const double i2 = 1 / r.squaredNorm(), i1 = std::sqrt(i2), a = R * i1, a3 = a * a * a;
  return gradientAlong(V, r, -0.75 * (a + a3) * i2) +
         gradientRadial(V, r, 0.75 * (a - a3) * i2, (-2.25 * a + 3.75 * a3) * i2 * i2) + a3 * crossMatrix(W) -
         3 * a3 * i2 * W.cross(r) * r.transpose();
}

// Potential of a moving sphere, phi = -R^3 (V.r)/(2 r^3) (Batchelor, section 2.9); u = grad phi:
//   u = (R^3/2)(3 (V.r) r/r^5 - V/r^3)
Vector3d potentialVelocity(const Vector3d& r, double R, const Vector3d& V) {
  const double i2 = 1 / r.squaredNorm(), a = R * std::sqrt(i2), a3 = a * a * a;
  return 0.5 * a3 * (3 * i2 * V.dot(r) * r - V);
}
Matrix3d potentialGradient(const Vector3d& r, double R, const Vector3d& V) {
  const double i2 = 1 / r.squaredNorm(), a = R * std::sqrt(i2), a3 = a * a * a;
  return gradientAlong(V, r, 1.5 * a3 * i2) + gradientRadial(V, r, 1.5 * a3 * i2, -7.5 * a3 * i2 * i2);
}
// Bernoulli, p/rho = -d(phi)/dt - u^2/2 with d(phi)/dt = -V.u - R^3 (A.r)/(2 r^3) at a fixed place.
double potentialPressure(const Vector3d& r, double R, const Vector3d& V, const Vector3d& A,
                         const Vector3d& u) {
  const double a = R / r.norm();
  return V.dot(u) - 0.5 * u.squaredNorm() + 0.5 * a * a * a * A.dot(r);
}

// Hill (1894); Batchelor, section 7.2. Inside r < R, seen from the vortex, w = u - V:
//   w = (3/2) [V (1 - 2 r^2/R^2) + (V.r) r/R^2]
// Vorticity is proportional to the distance from the axis, so p/rho + w^2/2 is a function of the stream
// function: p/rho = V^2/2 - (45/8)/R^2 (V^2 r^2 - (V.r)^2)(1 - r^2/R^2) - w^2/2.   Outside: potential flow.
Vector3d hillInnerVelocity(const Vector3d& r, double R, const Vector3d& V) {
  const double i2 = 1 / (R * R);
  return V + 1.5 * ((1 - 2 * r.squaredNorm() * i2) * V + i2 * V.dot(r) * r);
}
Matrix3d hillInnerGradient(const Vector3d& r, double R, const Vector3d& V) {
  const double i2 = 1 / (R * R);
  return gradientAlong(V, r, -6 * i2) + gradientRadial(V, r, 1.5 * i2, 0);
}
double hillInnerPressure(const Vector3d& r, double R, const Vector3d& V, const Vector3d& u) {
  const double i2 = 1 / (R * R), r2 = r.squaredNorm(), Vr = V.dot(r);
  return 0.5 * V.squaredNorm() - 45. / 8 * i2 * (V.squaredNorm() * r2 - Vr * Vr) * (1 - r2 * i2) -
         0.5 * (u - V).squaredNorm();
}

/// Taylor & Green (1937) in two dimensions, F = exp(-2 nu k^2 (t - t0)):
///   u = U F (sin kx cos ky, -cos kx sin ky, 0),   p = (rho U^2 F^2/4)(cos 2kx + cos 2ky)
struct TaylorGreen {
  double k, speed, decayRate, sx, cx, sy, cy;
  TaylorGreen(const AnalyticFlow& flow, const Vector3d& x, double t)
      : k(2 * M_PI / flow.wavelength), decayRate(2 * flow.viscosity * k * k), sx(std::sin(k * x[0])),
        cx(std::cos(k * x[0])), sy(std::sin(k * x[1])), cy(std::cos(k * x[1])) {
    speed = flow.amplitude * std::exp(-decayRate * (t - flow.referenceTime));
  }
  Vector3d velocity() const { return speed * Vector3d(sx * cy, -cx * sy, 0); }
  Matrix3d gradient() const {
    Matrix3d g;
    g << cx * cy, -sx * sy, 0, sx * sy, -cx * cy, 0, 0, 0, 0;
    return k * speed * g;
  }
  double pressure() const { return 0.5 * speed * speed * (cx * cx - sx * sx + cy * cy - sy * sy) / 2; }
};

/// Arnold (1965), Childress (1970); Dombre et al. (1986). curl u = k u, so (u.grad) u = grad u^2/2 and each
/// component decays alone, F = exp(-nu k^2 (t - t0)):
///   u = F (A sin kz + C cos ky, B sin kx + A cos kz, C sin ky + B cos kx),   p = -rho (u^2 - <u^2>)/2
/// with A : B : C = sqrt 3 : sqrt 2 : 1 and A the amplitude; <u^2> = A^2 + B^2 + C^2 = 2 A^2.
struct Beltrami {
  double k, decayRate, A, B, C, sx, cx, sy, cy, sz, cz;
  Beltrami(const AnalyticFlow& flow, const Vector3d& x, double t)
      : k(2 * M_PI / flow.wavelength), decayRate(flow.viscosity * k * k), sx(std::sin(k * x[0])),
        cx(std::cos(k * x[0])), sy(std::sin(k * x[1])), cy(std::cos(k * x[1])), sz(std::sin(k * x[2])),
        cz(std::cos(k * x[2])) {
    A = flow.amplitude * std::exp(-decayRate * (t - flow.referenceTime));
    B = A * std::sqrt(2. / 3);
    C = A * std::sqrt(1. / 3);
  }
  Vector3d velocity() const { return {A * sz + C * cy, B * sx + A * cz, C * sy + B * cx}; }
  Matrix3d gradient() const {
    Matrix3d g;
    g << 0, -C * sy, A * cz, B * cx, 0, -A * sz, -B * sx, C * cy, 0;
    return k * g;
  }
  double pressure() const { return A * A - 0.5 * velocity().squaredNorm(); }
};

} // namespace

Body AnalyticFlow::bodyAt(double t) const {
  Body b = body;
  if (isPeriodic()) b.diameter = 0;
  const double dt = t - referenceTime;
  b.centre += dt * (body.velocity + 0.5 * dt * body.acceleration);
  b.velocity += dt * body.acceleration;
  return b;
}

Vector3d AnalyticFlow::velocity(const Vector3d& x, double t) const {
  if (hasWall()) {
    const Body b = bodyAt(t);
    if (b.contains(x)) return b.velocityAt(x);
  }
  return fluidVelocity(x, t);
}

Vector3d AnalyticFlow::fluidVelocity(const Vector3d& x, double t) const {
  if (kind == FlowKind::TaylorGreen) return TaylorGreen(*this, x, t).velocity();
  if (kind == FlowKind::ABC) return Beltrami(*this, x, t).velocity();
  const Body b = bodyAt(t);
  if (b.diameter <= 0) return Vector3d::Zero();
  const Vector3d r = x - b.centre;
  const double R = 0.5 * b.diameter;
  if (kind == FlowKind::StokesSphere) return stokesVelocity(r, R, b.velocity, b.angularVelocity);
  if (kind == FlowKind::HillsVortex && r.squaredNorm() < R * R) return hillInnerVelocity(r, R, b.velocity);
  return potentialVelocity(r, R, b.velocity);
}

Matrix3d AnalyticFlow::gradient(const Vector3d& x, double t) const {
  if (kind == FlowKind::TaylorGreen) return TaylorGreen(*this, x, t).gradient();
  if (kind == FlowKind::ABC) return Beltrami(*this, x, t).gradient();
  const Body b = bodyAt(t);
  if (b.diameter <= 0) return Matrix3d::Zero();
  const Vector3d r = x - b.centre;
  const double R = 0.5 * b.diameter;
  const bool inside = r.squaredNorm() < R * R;
  if (kind == FlowKind::HillsVortex)
    return inside ? hillInnerGradient(r, R, b.velocity) : potentialGradient(r, R, b.velocity);
  if (inside) return crossMatrix(b.angularVelocity);
  return kind == FlowKind::StokesSphere ? stokesGradient(r, R, b.velocity, b.angularVelocity)
                                        : potentialGradient(r, R, b.velocity);
}

Vector3d AnalyticFlow::acceleration(const Vector3d& x, double t) const {
  const Vector3d u = velocity(x, t);
  const Matrix3d G = gradient(x, t);
  if (kind == FlowKind::TaylorGreen) return G * u - TaylorGreen(*this, x, t).decayRate * u;
  if (kind == FlowKind::ABC) return G * u - Beltrami(*this, x, t).decayRate * u;
  const Body b = bodyAt(t);
  if (b.diameter <= 0) return Vector3d::Zero();
  if (hasWall() && b.contains(x)) return b.accelerationAt(x);
  // The field moves along with the body and is linear in its velocity: du/dt = -(V . grad) u + u[A].
  Vector3d a = G * (u - b.velocity);
  if (!b.acceleration.isZero(0)) {
    const Vector3d r = x - b.centre;
    a += kind == FlowKind::StokesSphere
             ? stokesVelocity(r, 0.5 * b.diameter, b.acceleration, Vector3d::Zero())
             : potentialVelocity(r, 0.5 * b.diameter, b.acceleration);
  }
  return a;
}

double AnalyticFlow::pressure(const Vector3d& x, double t) const {
  if (kind == FlowKind::TaylorGreen) return density * TaylorGreen(*this, x, t).pressure();
  if (kind == FlowKind::ABC) return density * Beltrami(*this, x, t).pressure();
  const Body b = bodyAt(t);
  if (b.diameter <= 0 || (hasWall() && b.contains(x))) return 0;
  const Vector3d r = x - b.centre;
  const double R = 0.5 * b.diameter;
  if (kind == FlowKind::StokesSphere)
    return 1.5 * density * viscosity * R * b.velocity.dot(r) / std::pow(r.norm(), 3);
  const Vector3d u = velocity(x, t);
  if (kind == FlowKind::HillsVortex && b.contains(x)) return density * hillInnerPressure(r, R, b.velocity, u);
  return density * potentialPressure(r, R, b.velocity, b.acceleration, u);
}

double AnalyticFlow::typicalSpeed(double t) const {
  const Vector3d origin = Vector3d::Zero();
  if (kind == FlowKind::TaylorGreen) return std::abs(TaylorGreen(*this, origin, t).speed);
  if (kind == FlowKind::ABC) return std::sqrt(2.) * std::abs(Beltrami(*this, origin, t).A);
  const Body b = bodyAt(t);
  return b.diameter > 0 ? b.velocity.norm() + 0.5 * b.diameter * b.angularVelocity.norm() : 0;
}

double AnalyticFlow::maximumSpeed(double t) const {
  if (kind == FlowKind::HillsVortex) return 2.5 * typicalSpeed(t); // at its centre
  // Each component of ABC is one term of (A, B, C) and one of (C, A, B), both sqrt(2) A long.
  if (kind == FlowKind::ABC) return 2 * typicalSpeed(t);
  return typicalSpeed(t);
}

double AnalyticFlow::timeScale(const Vector3d& x, double t) const {
  if (isPeriodic()) {
    const double speed = typicalSpeed(t);
    return speed > 0 ? wavelength / (2 * M_PI * speed) : std::numeric_limits<double>::infinity();
  }
  const Body b = bodyAt(t);
  if (b.diameter <= 0) return std::numeric_limits<double>::infinity();
  const double length = std::max((x - b.centre).norm(), 0.5 * b.diameter);
  // Gradients at the wall: 3 V/R in potential flow, 3/2 V/R in Stokes flow.
  const double factor = kind == FlowKind::PotentialSphere ? 0.5 : 1;
  return factor * length / (maximumSpeed(t) + std::sqrt(b.acceleration.norm() * length));
}

} // namespace rimflow
