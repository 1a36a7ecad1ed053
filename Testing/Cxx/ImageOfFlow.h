#pragma once
// A flow with a known answer as the image that the filters take, and a source of such images in time.
#include "AnalyticFlows.h"

#include "vtkDoubleArray.h"
#include "vtkFieldData.h"
#include "vtkFloatArray.h"
#include "vtkImageAlgorithm.h"
#include "vtkImageData.h"
#include "vtkInformation.h"
#include "vtkInformationVector.h"
#include "vtkNew.h"
#include "vtkObjectFactory.h"
#include "vtkPointData.h"
#include "vtkPolyData.h"
#include "vtkSmartPointer.h"
#include "vtkStreamingDemandDrivenPipeline.h"

#include <functional>
#include <set>
#include <vector>

namespace rimflow_testing {

/// Adds a point array whose values are f(x).
template <class F>
void addArray(vtkImageData* image, const char* name, int components, F&& f) {
  vtkNew<vtkFloatArray> array;
  array->SetName(name);
  array->SetNumberOfComponents(components);
  array->SetNumberOfTuples(image->GetNumberOfPoints());
  for (vtkIdType p = 0; p < image->GetNumberOfPoints(); ++p) {
    const Eigen::Vector3d value = f(Eigen::Vector3d(image->GetPoint(p)));
    for (int c = 0; c < components; ++c) array->SetComponent(p, c, value[c]);
  }
  image->GetPointData()->AddArray(array);
}

/// Velocity and material acceleration of the flow at a time.
inline void addFlow(vtkImageData* image, const rimflow::AnalyticFlow& flow, double time) {
  addArray(image, "Velocity", 3, [&](const Eigen::Vector3d& x) { return flow.velocity(x, time); });
  addArray(image, "MaterialAcceleration", 3,
           [&](const Eigen::Vector3d& x) { return flow.acceleration(x, time); });
}

/// Field data `name` with the given numbers.
inline void addField(vtkDataObject* data, const char* name, const std::vector<double>& values,
                     int components) {
  vtkNew<vtkDoubleArray> array;
  array->SetName(name);
  array->SetNumberOfComponents(components);
  array->SetNumberOfTuples(vtkIdType(values.size()) / components);
  std::copy(values.begin(), values.end(), array->GetPointer(0));
  data->GetFieldData()->AddArray(array);
}

/// A Body as the filters take it.
inline vtkSmartPointer<vtkPolyData> bodyData(const rimflow::Body& body) {
  auto data = vtkSmartPointer<vtkPolyData>::New();
  const auto vector = [](const Eigen::Vector3d& v) { return std::vector<double>{v[0], v[1], v[2]}; };
  addField(data, "Diameter", {body.diameter}, 1);
  addField(data, "Centre", vector(body.centre), 3);
  addField(data, "Velocity", vector(body.velocity), 3);
  addField(data, "Acceleration", vector(body.acceleration), 3);
  return data;
}

/// Images in time: `fill` makes the one of a time step; it fails at the steps in `failing`.
class ImageSeries : public vtkImageAlgorithm {
public:
  static ImageSeries* New();
  vtkTypeMacro(ImageSeries, vtkImageAlgorithm);
  std::vector<double> times;
  std::function<void(vtkImageData*, double)> fill;
  std::set<double> failing;
  std::vector<double> executed; ///< the times that were made, in order
  int extent[6] = {0, 0, 0, 0, 0, 0};

protected:
  ImageSeries() { this->SetNumberOfInputPorts(0); }
  int RequestInformation(vtkInformation*, vtkInformationVector**, vtkInformationVector* outputs) override {
    using Pipeline = vtkStreamingDemandDrivenPipeline;
    vtkInformation* out = outputs->GetInformationObject(0);
    out->Set(Pipeline::WHOLE_EXTENT(), extent, 6);
    if (times.empty()) return 1;
    const double range[2] = {times.front(), times.back()};
    out->Set(Pipeline::TIME_STEPS(), times.data(), int(times.size()));
    out->Set(Pipeline::TIME_RANGE(), range, 2);
    return 1;
  }
  int RequestData(vtkInformation*, vtkInformationVector**, vtkInformationVector* outputs) override {
    using Pipeline = vtkStreamingDemandDrivenPipeline;
    vtkInformation* out = outputs->GetInformationObject(0);
    const double asked = out->Has(Pipeline::UPDATE_TIME_STEP()) ? out->Get(Pipeline::UPDATE_TIME_STEP())
                         : times.empty()                        ? 0
                                                                : times.front();
    if (failing.count(asked)) return 0;
    vtkImageData* image = vtkImageData::GetData(outputs);
    image->Initialize();
    fill(image, asked);
    image->GetInformation()->Set(vtkDataObject::DATA_TIME_STEP(), asked);
    executed.push_back(asked);
    return 1;
  }
};
inline vtkStandardNewMacro(ImageSeries);

} // namespace rimflow_testing
