#pragma once
#include "Body.h"
#include "ForceFields.h"
#include "Progress.h"

#include <Eigen/Core>
#include <array>
#include <string>
#include <vector>

namespace rimflow {

struct ForceOptions {
  double density = 1820;                   ///< of the fluid, kg/m3, > 0
  double viscosity = 1.1e-6;               ///< kinematic, m2/s, >= 0
  double bodyDensity = 0;                  ///< kg/m3; 0: unknown, then there is no inertia force
  Eigen::Vector3d gravity = {0, -9.81, 0}; ///< m/s2
  int surfaceResolution = 16;              ///< n of the geodesic icosphere with 10 n^2 + 2 points, 1 to 128
  /// Outer radius of the control volume, m, at least five spacings beyond the wall; what reaches beyond the
  /// grid is cut off. 0: as large as the grid allows, up to 2 d.
  double controlVolumeRadius = 0;
  Eigen::Matrix3d centreCovariance = Eigen::Matrix3d::Zero();       ///< of the body's centre, m2
  Eigen::Matrix3d velocityCovariance = Eigen::Matrix3d::Zero();     ///< of its velocity, m2/s2
  Eigen::Matrix3d accelerationCovariance = Eigen::Matrix3d::Zero(); ///< of its acceleration, m2/s4
};

/// A force with its uncertainty, N.
struct Force {
  Eigen::Vector3d value = Eigen::Vector3d::Zero();
  /// Standard deviation per component: of the covariances in ForceOptions, of the pressure's error, and of
  /// the models, which err alike in all snapshots.
  Eigen::Vector3d sigma = Eigen::Vector3d::Zero();
  bool known = false; ///< false: value and sigma mean nothing
};

/// Forces of the fluid on the body, without buoyancy (the dynamic part). Torque about the body's centre.
struct ForceResult {
  std::vector<Eigen::Vector3d> points;         ///< of the surface, m
  std::vector<Eigen::Vector3d> normals;        ///< into the fluid
  std::vector<std::array<int, 3>> triangles;   ///< counter-clockwise seen from the fluid
  std::vector<double> area;                    ///< of the surface that belongs to each point, m2
  std::vector<double> pressure, pressureSigma; ///< at each point, Pa
  std::vector<Eigen::Vector3d> traction;       ///< -p n + friction, at each point, Pa
  std::vector<unsigned char>
      seen; ///< 1: from measured fluid; 0: no fluid near, the value is carried over from neighbours

  Force pressureForce, friction, controlVolume, inertia; ///< N
  Eigen::Vector3d torque = Eigen::Vector3d::Zero();      ///< N m, of the friction and the pressure
  double drag = 0, dragSigma = 0;                        ///< of pressure + friction against the motion, N
  Eigen::Vector3d lift = Eigen::Vector3d::Zero();        ///< the rest of pressure + friction, N
  double liftSigma = 0; ///< of each of the two components of lift, N; at rest 0, as dragSigma
  double dragCoefficient = 0, liftCoefficient = 0; ///< over rho V^2/2 pi d^2/4; NaN when the body rests
  double controlVolumeDrag = 0, controlVolumeDragCoefficient = 0; ///< the same from the control volume
  double controlVolumeDragSigma = 0;                              ///< N
  Eigen::Vector3d controlVolumeLift = Eigen::Vector3d::Zero();
  double controlVolumeLiftSigma = 0; ///< as liftSigma, N
  double controlVolumeRadius = 0;    ///< as used, m; 0: none fits into the grid
  double coverage = 0;               ///< part of the surface that is seen, 0 to 1
  std::string note;                  ///< what the user should know; empty: all is well
};

/// Pressure, friction and momentum balance around a sphere. Throws std::invalid_argument when the body lies
/// outside the grid, no fluid node is near it, or an option is out of range. When progress aborts, the result
/// has no points.
ForceResult surfaceForce(const ForceFields& fields, const Body& body, const ForceOptions& options,
                         const Progress& progress = {});

} // namespace rimflow
