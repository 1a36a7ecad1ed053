// A Body from what the locator (port 0 or 1) or a user gives: `Diameter`(1) and `Centre`(3), and optionally
// `Velocity`, `Acceleration` and `AngularVelocity`(3), in the field data or on the first point. Header only,
// internal.
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

namespace rimflow {

/// Nothing when the data says that there is no body (the locator's `Status` is 2, lost). Throws
/// std::invalid_argument when an array is missing or holds no usable number.
inline std::optional<Body> bodyOf(vtkPolyData* data) {
  const auto find = [&](const char* name, int components) -> vtkDataArray* {
    for (vtkFieldData* attributes :
         {data->GetFieldData(), static_cast<vtkFieldData*>(data->GetPointData())}) {
      vtkDataArray* array = attributes->GetArray(name);
      if (array && array->GetNumberOfTuples() > 0 && array->GetNumberOfComponents() == components)
        return array;
    }
    return nullptr;
  };
  vtkDataArray* status = find("Status", 1);
  if (status && status->GetTuple1(0) == 2) return std::nullopt;
  vtkDataArray* diameter = find("Diameter", 1);
  vtkDataArray* centre = find("Centre", 3);
  if (!diameter || !centre)
    throw std::invalid_argument(std::string("the Body has no ") +
                                (diameter ? "Centre (3 components)" : "Diameter") +
                                " in its field data; connect the Sphere output of the locator");
  Body body;
  body.diameter = diameter->GetTuple1(0);
  centre->GetTuple(0, body.centre.data());
  if (vtkDataArray* v = find("Velocity", 3)) v->GetTuple(0, body.velocity.data());
  if (vtkDataArray* a = find("Acceleration", 3)) a->GetTuple(0, body.acceleration.data());
  if (vtkDataArray* w = find("AngularVelocity", 3)) w->GetTuple(0, body.angularVelocity.data());
  if (!(body.diameter > 0) || !body.centre.allFinite() || !body.velocity.allFinite() ||
      !body.acceleration.allFinite() || !body.angularVelocity.allFinite())
    throw std::invalid_argument(
        "the Body's Diameter must be greater than 0 and its Centre and motion finite numbers");
  return body;
}

} // namespace rimflow

#endif
