// What every filter does first: find its input arrays, and ask whether the user wants to stop. Header only,
// internal.
#ifndef vtkFilterInput_h
#define vtkFilterInput_h

#include "vtkAlgorithm.h"
#include "vtkDataArray.h"
#include "vtkDataObject.h"
#include "vtkDataSet.h"
#include "vtkInformation.h"
#include "vtkPointData.h"
#include "vtkVersion.h"

#include <string>

namespace rimflow {

/// The array chosen with SetInputArrayToProcess(index); null when nothing is chosen yet, for which ParaView
/// sets the index as the name, or "(by name)", the first entry of our array lists. (Without such an entry
/// ParaView chooses the active vectors for every index, whatever they are.)
inline const char* chosenArray(vtkAlgorithm* filter, int index) {
  const char* chosen = filter->GetInputArrayInformation(index)->Get(vtkDataObject::FIELD_NAME());
  const bool none = !chosen || !*chosen || std::string(chosen) == std::to_string(index) ||
                    std::string(chosen) == "(by name)";
  return none ? nullptr : chosen;
}

/// The three-component point array chosen with SetInputArrayToProcess(index), else the one called `name`.
/// Nothing chosen (a filter made in Python before its input was updated) and none called so: the active
/// vectors when `orActive` is set. Null when there is none, or when what was chosen is not there or has no
/// three components.
inline vtkDataArray* pointVectors(vtkAlgorithm* filter, vtkDataSet* data, int index, const char* name,
                                  bool orActive = true) {
  const char* chosen = chosenArray(filter, index);
  const bool isDefault = !chosen || std::string(chosen) == name;
  vtkDataArray* array = data->GetPointData()->GetArray(isDefault ? name : chosen);
  if (!array && isDefault && orActive) array = data->GetPointData()->GetVectors();
  return array && array->GetNumberOfComponents() == 3 ? array : nullptr;
}

/// The one-component point array chosen with SetInputArrayToProcess(index), else the one called `name`; null
/// when there is none.
inline vtkDataArray* pointNumbers(vtkAlgorithm* filter, vtkDataSet* data, int index, const char* name) {
  const char* chosen = chosenArray(filter, index);
  vtkDataArray* array = data->GetPointData()->GetArray(chosen ? chosen : name);
  return array && array->GetNumberOfComponents() == 1 ? array : nullptr;
}

/// The names of the point arrays, for error messages.
inline std::string arrayNames(vtkDataSet* data) {
  const int n = data->GetPointData()->GetNumberOfArrays();
  if (n == 0) return "no point arrays";
  std::string names = "the point arrays ";
  for (int i = 0; i < n; ++i) {
    const char* name = data->GetPointData()->GetArrayName(i);
    names += std::string(i ? ", " : "") + (name ? name : "(unnamed)");
  }
  return names;
}

/// True when the user asked to stop. Call it from one thread.
inline bool aborted(vtkAlgorithm* filter) {
// in VTK 9.3 and in the VTK of ParaView 5.11
#if VTK_VERSION_NUMBER >= VTK_VERSION_CHECK(9, 2, 20220000)
  return filter->CheckAbort();
#else
  return filter->GetAbortExecute() != 0;
#endif
}

} // namespace rimflow

#endif
