// What the image filters share: the kernels' view of a vtkImageData. Header only, internal.
#ifndef vtkGridFromImage_h
#define vtkGridFromImage_h

#include "Grid.h"

#include "vtkDataArray.h"
#include "vtkDataSetAttributes.h"
#include "vtkFloatArray.h"
#include "vtkImageData.h"
#include "vtkPointData.h"
#include "vtkSmartPointer.h"
#include "vtkUnsignedCharArray.h"

#include <vector>

namespace rimflow {

inline Grid gridOf(vtkImageData* image) {
  Grid grid;
  int extent[6];
  image->GetExtent(extent);
  image->GetDimensions(grid.n.data());
  image->GetSpacing(grid.spacing.data());
  for (int a = 0; a < 3; ++a) grid.origin[a] = image->GetOrigin()[a] + extent[2 * a] * grid.spacing[a];
  return grid;
}

/// 1 where a node holds no fluid: vtkGhostType with HIDDENPOINT, or `Mask` not 0. Empty: no such node is
/// marked.
inline std::vector<unsigned char> maskOf(vtkImageData* image) {
  std::vector<unsigned char> mask;
  vtkUnsignedCharArray* ghosts = image->GetPointGhostArray();
  vtkDataArray* marks = image->GetPointData()->GetArray("Mask");
  if (!ghosts && !marks) return mask;
  const std::size_t n = image->GetNumberOfPoints();
  mask.assign(n, 0);
  if (ghosts) {
    const unsigned char* flags = ghosts->GetPointer(0);
    for (std::size_t p = 0; p < n; ++p) mask[p] |= (flags[p] & vtkDataSetAttributes::HIDDENPOINT) != 0;
  }
  if (auto* bytes = vtkUnsignedCharArray::SafeDownCast(marks)) { // as our filters write it
    const unsigned char* marked = bytes->GetPointer(0);
    const int stride = bytes->GetNumberOfComponents();
    for (std::size_t p = 0; p < n; ++p) mask[p] |= marked[stride * p] != 0;
  } else if (marks)
    for (std::size_t p = 0; p < n; ++p) mask[p] |= marks->GetComponent(p, 0) != 0;
  return mask;
}

/// The array itself when it is a vtkFloatArray, else a copy of its values as float.
inline vtkSmartPointer<vtkFloatArray> asFloat(vtkDataArray* array) {
  vtkSmartPointer<vtkFloatArray> values = vtkFloatArray::SafeDownCast(array);
  if (!values && array) {
    values = vtkSmartPointer<vtkFloatArray>::New();
    values->DeepCopy(array);
  }
  return values;
}

} // namespace rimflow

#endif
