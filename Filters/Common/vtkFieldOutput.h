// What filters add to their output: point arrays, the mask, numbers and texts. Header only, internal.
#ifndef vtkFieldOutput_h
#define vtkFieldOutput_h

#include "vtkDataSet.h"
#include "vtkDataSetAttributes.h"
#include "vtkDoubleArray.h"
#include "vtkFieldData.h"
#include "vtkFloatArray.h"
#include "vtkNew.h"
#include "vtkPointData.h"
#include "vtkStringArray.h"
#include "vtkUnsignedCharArray.h"

#include <algorithm>
#include <string>
#include <vector>

namespace rimflow {

/// As many components as there are values per point; nothing is added when there are no values.
inline void addPointArray(vtkDataSet* data, const char* name, const std::vector<float>& values) {
  if (values.empty()) return;
  vtkNew<vtkFloatArray> array;
  array->SetName(name);
  array->SetNumberOfComponents(int(vtkIdType(values.size()) / data->GetNumberOfPoints()));
  array->SetNumberOfTuples(data->GetNumberOfPoints());
  std::copy(values.begin(), values.end(), array->GetPointer(0));
  data->GetPointData()->AddArray(array);
}

/// `Mask`, and HIDDENPOINT in vtkGhostType where it is not 0; other flags of vtkGhostType stay.
inline void addMask(vtkDataSet* data, const std::vector<unsigned char>& masked) {
  vtkUnsignedCharArray* given = data->GetPointGhostArray();
  vtkNew<vtkUnsignedCharArray> mask, ghosts;
  mask->SetName("Mask");
  ghosts->SetName(vtkDataSetAttributes::GhostArrayName());
  for (vtkUnsignedCharArray* array : {mask.Get(), ghosts.Get()})
    array->SetNumberOfTuples(vtkIdType(masked.size()));
  for (vtkIdType p = 0; p < vtkIdType(masked.size()); ++p) {
    mask->SetValue(p, masked[std::size_t(p)]);
    ghosts->SetValue(
        p, static_cast<unsigned char>((given ? given->GetValue(p) : 0) |
                                      (masked[std::size_t(p)] ? vtkDataSetAttributes::HIDDENPOINT : 0)));
  }
  data->GetPointData()->AddArray(mask);
  data->GetPointData()->AddArray(ghosts);
}

/// One number in the field data.
inline void addNumber(vtkDataObject* data, const char* name, double value) {
  vtkNew<vtkDoubleArray> array;
  array->SetName(name);
  array->InsertNextValue(value);
  data->GetFieldData()->AddArray(array);
}

/// One text in the field data.
inline void addText(vtkDataObject* data, const char* name, const std::string& text) {
  vtkNew<vtkStringArray> array;
  array->SetName(name);
  array->InsertNextValue(text);
  data->GetFieldData()->AddArray(array);
}

} // namespace rimflow

#endif
