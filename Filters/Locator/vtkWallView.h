// The tracers next to a sphere's wall as vtkPolyData and back: the locator's output Wall, the smoother's
// input Walls. Header only, internal.
#ifndef vtkWallView_h
#define vtkWallView_h

#include "CentreEstimate.h"

#include "vtkCellArray.h"
#include "vtkDoubleArray.h"
#include "vtkFieldData.h"
#include "vtkFloatArray.h"
#include "vtkIdTypeArray.h"
#include "vtkNew.h"
#include "vtkPointData.h"
#include "vtkPoints.h"
#include "vtkPolyData.h"

#include <stdexcept>
#include <string>
#include <utility>

namespace rimflow {

/// Appends one vertex per tracer: `Distance` from the wall (m), `Velocity` (m/s, where the tracers have one)
/// and `TrackId`. Field data: `Time` (s), `Centre` (m), `Radius`, `Reach` and `PositionNoise` (m),
/// `GhostRate`, `SeedingTilt` (3, 1/m) and `SeedingBend` (9, 1/m2).
inline void wallToPolyData(const CentreEstimate& estimate, double radius, vtkPolyData* data) {
  const WallView& wall = *estimate.wall;
  vtkNew<vtkPoints> points;
  points->SetDataTypeToDouble();
  vtkNew<vtkCellArray> vertices;
  vtkNew<vtkFloatArray> distance, velocity;
  distance->SetName("Distance");
  velocity->SetName("Velocity");
  velocity->SetNumberOfComponents(3);
  vtkNew<vtkIdTypeArray> track;
  track->SetName("TrackId");
  for (const WallParticle& p : wall.particles) {
    const Eigen::Vector3d x = estimate.centre + p.offset.cast<double>();
    const vtkIdType point = points->InsertNextPoint(x.data());
    vertices->InsertNextCell(1, &point);
    distance->InsertNextValue(float(double(p.offset.norm()) - radius));
    velocity->InsertNextTypedTuple(p.velocity.data());
    track->InsertNextValue(vtkIdType(p.track));
  }
  data->SetPoints(points);
  data->SetVerts(vertices);
  data->GetPointData()->AddArray(distance);
  data->GetPointData()->AddArray(velocity);
  data->GetPointData()->AddArray(track);
  const auto add = [data](const char* name, const double* values, int components) {
    vtkNew<vtkDoubleArray> array;
    array->SetName(name);
    array->SetNumberOfComponents(components);
    array->InsertNextTuple(values);
    data->GetFieldData()->AddArray(array);
  };
  add("Time", &estimate.time, 1);
  add("Centre", estimate.centre.data(), 3);
  add("Radius", &radius, 1);
  add("Reach", &wall.reach, 1);
  add("PositionNoise", &wall.positionNoise, 1);
  add("GhostRate", &wall.ghostRate, 1);
  add("SeedingTilt", wall.tilt.data(), 3);
  add("SeedingBend", wall.bend.data(), 9);
}

/// Time and wall. Throws std::invalid_argument when an array is missing.
inline std::pair<double, std::shared_ptr<const WallView>> wallFromPolyData(vtkPolyData* data) {
  const auto read = [data](const char* name, double* values, int components) {
    vtkDataArray* array = data->GetFieldData()->GetArray(name);
    if (!array || array->GetNumberOfComponents() != components || array->GetNumberOfTuples() < 1)
      throw std::invalid_argument(std::string("a wall has no ") + name +
                                  " in its field data; connect the locator's output Wall");
    array->GetTuple(0, values);
  };
  double time = 0;
  Eigen::Vector3d centre;
  WallView wall;
  read("Time", &time, 1);
  read("Centre", centre.data(), 3);
  read("Reach", &wall.reach, 1);
  read("PositionNoise", &wall.positionNoise, 1);
  read("GhostRate", &wall.ghostRate, 1);
  read("SeedingTilt", wall.tilt.data(), 3);
  read("SeedingBend", wall.bend.data(), 9);
  vtkDataArray* velocity = data->GetPointData()->GetArray("Velocity");
  vtkDataArray* track = data->GetPointData()->GetArray("TrackId");
  wall.particles.resize(std::size_t(data->GetNumberOfPoints()));
  for (vtkIdType i = 0; i < data->GetNumberOfPoints(); ++i) {
    WallParticle& p = wall.particles[std::size_t(i)];
    Eigen::Vector3d x;
    data->GetPoint(i, x.data());
    p.offset = (x - centre).cast<float>();
    if (velocity && velocity->GetNumberOfComponents() == 3) {
      double u[3];
      velocity->GetTuple(i, u);
      p.velocity = {float(u[0]), float(u[1]), float(u[2])};
    }
    if (track) p.track = std::int64_t(track->GetComponent(i, 0));
  }
  return {time, std::make_shared<const WallView>(std::move(wall))};
}

} // namespace rimflow

#endif
