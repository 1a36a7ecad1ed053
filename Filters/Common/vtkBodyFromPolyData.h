// Bodies from what the locator (port 0 or 1) or a user gives: `Diameter`(1) and `Centre`(3), and optionally
// `Velocity`, `Acceleration` and `AngularVelocity`(3), in the field data (one tuple per body) or on the first
// point; with `AccelerationSigma` and `AngularVelocitySigma`(3) only as far as they are significant. Header
// only, internal.
#ifndef vtkBodyFromPolyData_h
#define vtkBodyFromPolyData_h

#include "Body.h"

#include "vtkDataArray.h"
#include "vtkFieldData.h"
#include "vtkPointData.h"
#include "vtkPolyData.h"

#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

namespace rimflow {

/// The array that tells this of the bodies; null when there is none with so many components.
inline vtkDataArray* bodyArray(vtkPolyData* data, const char* name, int components) {
  for (vtkFieldData* attributes : {data->GetFieldData(), static_cast<vtkFieldData*>(data->GetPointData())}) {
    vtkDataArray* array = attributes->GetArray(name);
    if (array && array->GetNumberOfTuples() > 0 && array->GetNumberOfComponents() == components) return array;
  }
  return nullptr;
}

/// As many as the field data have centres; on points, the first one counts.
inline vtkIdType numberOfBodies(vtkPolyData* data) {
  vtkDataArray* centres = data->GetFieldData()->GetArray("Centre");
  return centres && centres->GetNumberOfTuples() > 0 ? centres->GetNumberOfTuples() : 1;
}

/// Whether a vector is more than noise of these standard deviations: pure noise is taken for more as seldom
/// as a normal variable exceeds three of them (0.27 %). A negative sigma: the vector is not known; 0: it is
/// known exactly.
inline bool significant(const Eigen::Vector3d& vector, const Eigen::Vector3d& sigma) {
  constexpr double ChiSquared = 14.16; // of three components
  if (sigma.minCoeff() < 0) return false;
  return sigma.maxCoeff() == 0 || vector.cwiseQuotient(sigma).squaredNorm() > ChiSquared;
}

/// The body at index `which`, 0 to numberOfBodies - 1. Nothing when the data says that there is no body (the
/// locator's `Status` is 2, lost). Throws std::invalid_argument when an array is missing or holds no usable
/// number.
inline std::optional<Body> bodyOf(vtkPolyData* data, vtkIdType which = 0) {
  const auto find = [&](const char* name, int components) -> vtkDataArray* {
    vtkDataArray* array = bodyArray(data, name, components);
    return array && which < array->GetNumberOfTuples() ? array : nullptr;
  };
  vtkDataArray* status = find("Status", 1);
  if (status && status->GetTuple1(which) == 2) return std::nullopt;
  vtkDataArray* diameter = find("Diameter", 1);
  vtkDataArray* centre = find("Centre", 3);
  if (!diameter || !centre)
    throw std::invalid_argument(std::string("the Body has no ") +
                                (diameter ? "Centre (3 components)" : "Diameter") +
                                " in its field data; connect the Sphere output of the locator");
  Body body;
  body.diameter = diameter->GetTuple1(which);
  centre->GetTuple(which, body.centre.data());
  if (vtkDataArray* v = find("Velocity", 3)) v->GetTuple(which, body.velocity.data());
  // The wall's motion is taken for certain: what is but noise would be a motion that nobody has seen.
  const auto motion = [&](const char* name, const char* sigmaName, Eigen::Vector3d& value) {
    Eigen::Vector3d sigma = Eigen::Vector3d::Zero();
    if (vtkDataArray* array = find(name, 3)) array->GetTuple(which, value.data());
    if (vtkDataArray* array = find(sigmaName, 3)) array->GetTuple(which, sigma.data());
    if (value.allFinite() && !significant(value, sigma)) value.setZero();
  };
  motion("Acceleration", "AccelerationSigma", body.acceleration);
  motion("AngularVelocity", "AngularVelocitySigma", body.angularVelocity);
  if (!(body.diameter > 0) || !body.centre.allFinite() || !body.velocity.allFinite() ||
      !body.acceleration.allFinite() || !body.angularVelocity.allFinite())
    throw std::invalid_argument(
        "the Body's Diameter must be greater than 0 and its Centre and motion finite numbers");
  return body;
}

/// All bodies that are not lost. Throws as bodyOf does.
inline std::vector<Body> bodiesOf(vtkPolyData* data) {
  std::vector<Body> bodies;
  for (vtkIdType which = 0; which < numberOfBodies(data); ++which)
    if (const auto body = bodyOf(data, which)) bodies.push_back(*body);
  return bodies;
}

/// The covariance of a body's centre, m2, from `Covariance`(6: xx yy zz xy yz xz); 0 when it is not told.
inline Eigen::Matrix3d centreCovarianceOf(vtkPolyData* data, vtkIdType which) {
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();
  vtkDataArray* array = bodyArray(data, "Covariance", 6);
  if (!array || which >= array->GetNumberOfTuples()) return covariance;
  double c[6];
  array->GetTuple(which, c);
  covariance << c[0], c[3], c[5], c[3], c[1], c[4], c[5], c[4], c[2];
  return covariance;
}

/// The covariance of a body's velocity, m2/s2, or acceleration, m2/s4, from `VelocitySigma` or
/// `AccelerationSigma`(3), which the smoothed trajectory has; 0 when it is not told, not a number or negative
/// (not known).
inline Eigen::Matrix3d motionCovarianceOf(vtkPolyData* data, const char* sigmaName, vtkIdType which) {
  Eigen::Vector3d sigma = Eigen::Vector3d::Zero();
  vtkDataArray* array = bodyArray(data, sigmaName, 3);
  if (array && which < array->GetNumberOfTuples()) array->GetTuple(which, sigma.data());
  if (!sigma.allFinite() || sigma.minCoeff() < 0) sigma.setZero();
  return sigma.cwiseAbs2().asDiagonal();
}

} // namespace rimflow

#endif
