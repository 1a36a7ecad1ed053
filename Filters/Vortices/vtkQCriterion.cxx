#include "vtkQCriterion.h"

#include "QCriterionKernel.h"
#include "vtkGridFromImage.h"

#include "vtkFilterProgress.h"
#include "vtkInformation.h"
#include "vtkInformationVector.h"
#include "vtkNew.h"
#include "vtkObjectFactory.h"
#include "vtkResultCache.h"

#include <algorithm>

vtkStandardNewMacro(vtkQCriterion);

struct vtkQCriterion::Internals {
  rimflow::ResultCache results;
};

vtkQCriterion::~vtkQCriterion() = default;

vtkQCriterion::vtkQCriterion() : State(new Internals) {
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
  if (input->GetNumberOfPoints() == 0 || this->State->results.restore(this, inputs, outputs)) return 1;
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
  if (!rimflow::qCriterion(rimflow::gridOf(input), velocity->GetPointer(0),
                           mask.empty() ? nullptr : mask.data(), this->Order,
                           {pointer(q), pointer(vorticity), pointer(lambda2), pointer(divergence)},
                           rimflow::progressOf(this, "Q-criterion")))
    return 1; // aborted: the output stays empty
  result->GetPointData()->SetActiveScalars("QCriterion");
  output->ShallowCopy(result);
  this->State->results.keep(this, outputs);
  return 1;
}

void vtkQCriterion::SetCacheSize(int mebibytes) {
  this->CacheSize = std::max(0, mebibytes);
  this->State->results.setLimit(this->CacheSize);
}

void vtkQCriterion::PrintSelf(ostream& os, vtkIndent indent) {
  this->Superclass::PrintSelf(os, indent);
  os << indent << "Order: " << this->Order << "\n"
     << indent << "ComputeVorticity: " << this->ComputeVorticity << "\n"
     << indent << "ComputeLambda2: " << this->ComputeLambda2 << "\n"
     << indent << "ComputeDivergence: " << this->ComputeDivergence << "\n"
     << indent << "CacheSize: " << this->CacheSize << "\n";
}
