#include "vtkSyntheticTracks.h"

#include "TrackSynthesis.h"
#include "vtkFilterProgress.h"

#include "vtkCellArray.h"
#include "vtkDoubleArray.h"
#include "vtkFieldData.h"
#include "vtkFloatArray.h"
#include "vtkIdTypeArray.h"
#include "vtkInformation.h"
#include "vtkInformationVector.h"
#include "vtkNew.h"
#include "vtkObjectFactory.h"
#include "vtkPointData.h"
#include "vtkPoints.h"
#include "vtkPolyData.h"
#include "vtkSmartPointer.h"
#include "vtkStreamingDemandDrivenPipeline.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <stdexcept>
#include <vector>

vtkStandardNewMacro(vtkSyntheticTracks);

struct vtkSyntheticTracks::Tracks {
  rimflow::TrackSynthesis synthesis;
  vtkTimeStamp when;
};

vtkSyntheticTracks::vtkSyntheticTracks() { this->SetNumberOfInputPorts(0); }
vtkSyntheticTracks::~vtkSyntheticTracks() = default;

namespace {

template <class ArrayType, class T>
vtkSmartPointer<ArrayType> makeArray(const char* name, int components, const std::vector<T>& values) {
  auto array = vtkSmartPointer<ArrayType>::New();
  array->SetName(name);
  array->SetNumberOfComponents(components);
  array->SetNumberOfTuples(static_cast<vtkIdType>(values.size()) / components);
  std::copy(values.begin(), values.end(), array->GetPointer(0));
  return array;
}

void addField(vtkPolyData* output, const char* name, const Eigen::Vector3d& v) {
  output->GetFieldData()->AddArray(
      makeArray<vtkDoubleArray>(name, 3, std::vector<double>(v.data(), v.data() + 3)));
}

} // namespace

// The trajectories, computed anew when a setting has changed. False when aborted.
bool vtkSyntheticTracks::Prepare() {
  if (this->Prepared && this->Prepared->when > this->GetMTime()) return true;
  this->Prepared.reset();
  if (this->Flow < STOKES_SPHERE || this->Flow > ABC)
    throw std::invalid_argument("Flow must be 0 (Stokes), 1 (potential), 2 (Hill's vortex), 3 (Taylor-Green) "
                                "or 4 (ABC); found " +
                                std::to_string(this->Flow) + ".");
  rimflow::TrackSynthesisOptions o;
  o.flow.kind = static_cast<rimflow::FlowKind>(this->Flow);
  o.flow.body.diameter = this->Diameter;
  o.flow.body.centre = Eigen::Vector3d(this->Centre);
  o.flow.body.velocity = Eigen::Vector3d(this->Velocity);
  o.flow.body.acceleration = Eigen::Vector3d(this->Acceleration);
  o.flow.body.angularVelocity = Eigen::Vector3d(this->AngularVelocity);
  o.flow.referenceTime = this->StartTime + 0.5 * (this->NumberOfSnapshots - 1) * this->FramePeriod;
  o.flow.amplitude = this->Amplitude;
  o.flow.wavelength = this->Wavelength;
  o.flow.viscosity = this->Viscosity;
  o.flow.density = this->FluidDensity;
  o.density = this->Density;
  std::copy_n(this->Bounds, 6, o.bounds.begin());
  o.snapshots = this->NumberOfSnapshots;
  o.framePeriod = this->FramePeriod;
  o.startTime = this->StartTime;
  o.positionNoise = this->PositionNoise;
  o.velocityNoise = this->VelocityNoise;
  o.accelerationNoise = this->AccelerationNoise;
  o.dropOut = this->DropOut;
  o.ghostFraction = this->GhostFraction;
  o.minimumTrackLength = this->MinimumTrackLength;
  o.wakeDepletion = this->WakeDepletion;
  o.wakeLength = this->WakeLength;
  o.seed = static_cast<std::uint64_t>(this->Seed);
  auto tracks = std::make_unique<Tracks>();
  if (!tracks->synthesis.prepare(o, rimflow::progressOf(this, "Synthetic tracks", 0, 0.9))) return false;
  tracks->when.Modified();
  this->Prepared = std::move(tracks);
  return true;
}

int vtkSyntheticTracks::RequestInformation(vtkInformation*, vtkInformationVector**,
                                           vtkInformationVector* outputs) {
  vtkInformation* information = outputs->GetInformationObject(0);
  std::vector<double> times(std::max(this->NumberOfSnapshots, 1));
  for (std::size_t k = 0; k < times.size(); ++k) times[k] = this->StartTime + k * this->FramePeriod;
  const double range[2] = {times.front(), times.back()};
  information->Set(vtkStreamingDemandDrivenPipeline::TIME_STEPS(), times.data(), int(times.size()));
  information->Set(vtkStreamingDemandDrivenPipeline::TIME_RANGE(), range, 2);
  return 1;
}

int vtkSyntheticTracks::RequestData(vtkInformation*, vtkInformationVector**, vtkInformationVector* outputs) {
  vtkPolyData* output = vtkPolyData::GetData(outputs);
  output->Initialize();
  try {
    if (!this->Prepare()) return 1; // aborted: the output stays empty
  } catch (const std::exception& problem) {
    vtkErrorMacro(<< problem.what());
    return 0;
  }
  const rimflow::TrackSynthesis& synthesis = this->Prepared->synthesis;
  vtkInformation* information = outputs->GetInformationObject(0);
  int k = 0;
  if (information->Has(vtkStreamingDemandDrivenPipeline::UPDATE_TIME_STEP())) {
    const double t = information->Get(vtkStreamingDemandDrivenPipeline::UPDATE_TIME_STEP());
    const double nearest = std::round((t - this->StartTime) / this->FramePeriod);
    k = int(std::clamp(nearest, 0., this->NumberOfSnapshots - 1.));
  }
  const rimflow::SyntheticSnapshot rows = synthesis.snapshot(k, this->AddTruth);

  vtkNew<vtkPoints> points;
  points->SetData(makeArray<vtkFloatArray>("Points", 3, rows.position));
  output->SetPoints(points);
  std::vector<vtkIdType> each(rows.size());
  std::iota(each.begin(), each.end(), 0);
  vtkNew<vtkCellArray> vertices;
  vertices->SetData(1, makeArray<vtkIdTypeArray>("", 1, each));
  output->SetVerts(vertices);
  vtkPointData* data = output->GetPointData();
  data->AddArray(makeArray<vtkFloatArray>("Velocity", 3, rows.velocity));
  data->AddArray(makeArray<vtkFloatArray>("Acceleration", 3, rows.acceleration));
  data->AddArray(makeArray<vtkIdTypeArray>("TrackId", 1, rows.trackId));
  data->SetActiveVectors("Velocity");
  data->SetActiveScalars("Velocity"); // ParaView colours by these at first
  if (this->AddTruth) {
    data->AddArray(makeArray<vtkFloatArray>("TrueVelocity", 3, rows.trueVelocity));
    data->AddArray(makeArray<vtkFloatArray>("TrueAcceleration", 3, rows.trueAcceleration));
    data->AddArray(makeArray<vtkFloatArray>("TruePressure", 1, rows.truePressure));
    data->AddArray(makeArray<vtkIdTypeArray>("TrueTracerId", 1, rows.trueTracerId));
  }
  const rimflow::Body body = synthesis.options().flow.bodyAt(synthesis.time(k));
  if (body.diameter > 0) {
    addField(output, "TrueCentre", body.centre);
    addField(output, "TrueVelocity", body.velocity);
    addField(output, "TrueAcceleration", body.acceleration);
    addField(output, "TrueAngularVelocity", body.angularVelocity);
    output->GetFieldData()->AddArray(
        makeArray<vtkDoubleArray>("TrueDiameter", 1, std::vector<double>{body.diameter}));
  }
  output->GetInformation()->Set(vtkDataObject::DATA_TIME_STEP(), synthesis.time(k));
  return 1;
}

void vtkSyntheticTracks::PrintSelf(ostream& os, vtkIndent indent) {
  this->Superclass::PrintSelf(os, indent);
  const auto vector = [](const double* v) {
    return std::to_string(v[0]) + " " + std::to_string(v[1]) + " " + std::to_string(v[2]);
  };
  os << indent << "Flow: " << this->Flow << "\n"
     << indent << "Diameter: " << this->Diameter << "\n"
     << indent << "Centre: " << vector(this->Centre) << "\n"
     << indent << "Velocity: " << vector(this->Velocity) << "\n"
     << indent << "Acceleration: " << vector(this->Acceleration) << "\n"
     << indent << "AngularVelocity: " << vector(this->AngularVelocity) << "\n"
     << indent << "Amplitude: " << this->Amplitude << "\n"
     << indent << "Wavelength: " << this->Wavelength << "\n"
     << indent << "Viscosity: " << this->Viscosity << "\n"
     << indent << "FluidDensity: " << this->FluidDensity << "\n"
     << indent << "Density: " << this->Density << "\n"
     << indent << "Bounds: " << this->Bounds[0] << " " << this->Bounds[1] << " " << this->Bounds[2] << " "
     << this->Bounds[3] << " " << this->Bounds[4] << " " << this->Bounds[5] << "\n"
     << indent << "NumberOfSnapshots: " << this->NumberOfSnapshots << "\n"
     << indent << "FramePeriod: " << this->FramePeriod << "\n"
     << indent << "StartTime: " << this->StartTime << "\n"
     << indent << "PositionNoise: " << this->PositionNoise << "\n"
     << indent << "VelocityNoise: " << this->VelocityNoise << "\n"
     << indent << "AccelerationNoise: " << this->AccelerationNoise << "\n"
     << indent << "DropOut: " << this->DropOut << "\n"
     << indent << "GhostFraction: " << this->GhostFraction << "\n"
     << indent << "MinimumTrackLength: " << this->MinimumTrackLength << "\n"
     << indent << "WakeDepletion: " << this->WakeDepletion << "\n"
     << indent << "WakeLength: " << this->WakeLength << "\n"
     << indent << "Seed: " << this->Seed << "\n"
     << indent << "AddTruth: " << this->AddTruth << "\n";
}
