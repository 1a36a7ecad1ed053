#include "vtkQCriterion.h"

#include "QCriterionKernel.h"
#include "vtkGridFromImage.h"

#include "vtkFilterInput.h"
#include "vtkInformation.h"
#include "vtkInformationVector.h"
#include "vtkNew.h"
#include "vtkObjectFactory.h"

vtkStandardNewMacro(vtkQCriterion);

vtkQCriterion::vtkQCriterion() {
  this->SetInputArrayToProcess(0, 0, 0, vtkDataObject::FIELD_ASSOCIATION_POINTS, "Velocity");
}

namespace {
vtkSmartPointer<vtkFloatArray> addArray(vtkImageData* image, const char* name, int components, bool wanted) {
  if (!wanted) return nullptr;
  auto array = vtkSmartPointer<vtkFloatArray>::New();
  array->SetName(name);
  array->SetNumberOfComponents(components);
  array->SetNumberOfTuples(image->GetNumberOfPoints());
  image->GetPointData()->AddArray(array);
  return array;
}
float* pointer(vtkFloatArray* array) { return array ? array->GetPointer(0) : nullptr; }
} // namespace

int vtkQCriterion::RequestData(vtkInformation*, vtkInformationVector** inputs,
                               vtkInformationVector* outputs) {
  vtkImageData* input = vtkImageData::GetData(inputs[0]);
  vtkImageData* output = vtkImageData::GetData(outputs);
  output->Initialize();
  if (this->Order != 2 && this->Order != 4) {
    vtkErrorMacro("Order is " << this->Order << "; it must be 2 or 4.");
    return 0;
  }
  if (input->GetNumberOfPoints() == 0) return 1;
  vtkDataArray* array = rimflow::pointVectors(this, input, 0, "Velocity");
  if (!array) {
    vtkErrorMacro("No velocity found: the input has " << rimflow::arrayNames(input)
                                                      << ". A point array with three components is needed, "
                                                         "called Velocity or chosen as the input array.");
    return 0;
  }

  const auto velocity = rimflow::asFloat(array);
  const auto mask = rimflow::maskOf(input);
  vtkNew<vtkImageData> result;
  result->ShallowCopy(input);
  const auto q = addArray(result, "QCriterion", 1, true);
  const auto vorticity = addArray(result, "Vorticity", 3, this->ComputeVorticity);
  const auto lambda2 = addArray(result, "Lambda2", 1, this->ComputeLambda2);
  const auto divergence = addArray(result, "Divergence", 1, this->ComputeDivergence);
  const auto progress = [this](double fraction) {
    this->UpdateProgress(fraction);
    return !rimflow::aborted(this);
  };
  if (!rimflow::qCriterion(rimflow::gridOf(input), velocity->GetPointer(0),
                           mask.empty() ? nullptr : mask.data(), this->Order,
                           {pointer(q), pointer(vorticity), pointer(lambda2), pointer(divergence)}, progress))
    return 1; // aborted: the output stays empty
  result->GetPointData()->SetActiveScalars("QCriterion");
  output->ShallowCopy(result);
  return 1;
}

void vtkQCriterion::PrintSelf(ostream& os, vtkIndent indent) {
  this->Superclass::PrintSelf(os, indent);
  os << indent << "Order: " << this->Order << "\n"
     << indent << "ComputeVorticity: " << this->ComputeVorticity << "\n"
     << indent << "ComputeLambda2: " << this->ComputeLambda2 << "\n"
     << indent << "ComputeDivergence: " << this->ComputeDivergence << "\n";
}
