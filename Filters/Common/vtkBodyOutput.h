// A sphere as a Body (vtkBodyFromPolyData.h) put out: its surface, its arrays as field data, and what is said
// when it is lost. Header only, internal; users need VTK::FiltersSources.
#ifndef vtkBodyOutput_h
#define vtkBodyOutput_h

#include "vtkFieldOutput.h"

#include "vtkFieldData.h"
#include "vtkIntArray.h"
#include "vtkNew.h"
#include "vtkPointData.h"
#include "vtkPolyData.h"
#include "vtkSmartPointer.h"
#include "vtkSphereSource.h"

#include <string>

namespace rimflow {

/// With point normals. `resolution`: facets around it.
inline vtkSmartPointer<vtkPolyData> sphereSurface(const double centre[3], double diameter, int resolution) {
  vtkNew<vtkSphereSource> source;
  source->SetCenter(centre[0], centre[1], centre[2]);
  source->SetRadius(0.5 * diameter);
  source->SetThetaResolution(resolution);
  source->SetPhiResolution(resolution / 2 + 1);
  source->Update();
  return source->GetOutput();
}

/// The point arrays of `from` become field data of `to`.
inline void pointsToFieldData(vtkPolyData* from, vtkPolyData* to) {
  for (int a = 0; a < from->GetPointData()->GetNumberOfArrays(); ++a)
    to->GetFieldData()->AddArray(from->GetPointData()->GetAbstractArray(a));
}

/// The field data of a time without a sphere: `Time`, `Diameter`, `Status` 2, `StatusText`.
inline void addLostBody(vtkPolyData* data, double time, double diameter, const std::string& why) {
  addNumber(data, "Time", time);
  addNumber(data, "Diameter", diameter);
  vtkNew<vtkIntArray> status;
  status->SetName("Status");
  status->InsertNextValue(2);
  data->GetFieldData()->AddArray(status);
  addText(data, "StatusText", why);
}

} // namespace rimflow

#endif
