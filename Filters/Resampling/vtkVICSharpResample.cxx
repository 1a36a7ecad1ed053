#include "vtkVICSharpResample.h"

#include "ResamplingGrid.h"
#include "VICSharp.h"
#include "vtkBodyFromPolyData.h"
#include "vtkFieldOutput.h"
#include "vtkFilterProgress.h"
#include "vtkGridFromImage.h"
#include "vtkResultCache.h"
#include "vtkUpstream.h"

#include "vtkFieldData.h"
#include "vtkImageData.h"
#include "vtkInformation.h"
#include "vtkInformationVector.h"
#include "vtkNew.h"
#include "vtkObjectFactory.h"
#include "vtkPoints.h"
#include "vtkPolyData.h"
#include "vtkStreamingDemandDrivenPipeline.h"

#include <algorithm>
#include <chrono>
#include <optional>
#include <sstream>
#include <stdexcept>
#include <string>
#include <vector>

vtkStandardNewMacro(vtkVICSharpResample);

namespace {

using Pipeline = vtkStreamingDemandDrivenPipeline;

/// The particles' arrays as the kernel wants them; the smart pointers keep converted copies alive.
struct Tracks {
  vtkSmartPointer<vtkFloatArray> positions, velocities, accelerations;
  rimflow::VICSharpTracks view() const {
    return {positions->GetPointer(0), velocities->GetPointer(0),
            accelerations ? accelerations->GetPointer(0) : nullptr,
            std::size_t(positions->GetNumberOfTuples())};
  }
};

Tracks tracksOf(vtkAlgorithm* filter, vtkPolyData* particles, bool useAcceleration) {
  vtkDataArray* velocity =
      particles && particles->GetPoints() ? rimflow::pointVectors(filter, particles, 0, "Velocity") : nullptr;
  if (!velocity) return {};
  return {rimflow::asFloat(particles->GetPoints()->GetData()), rimflow::asFloat(velocity),
          rimflow::asFloat(useAcceleration
                               ? rimflow::pointVectors(filter, particles, 1, "Acceleration", false)
                               : nullptr)};
}

/// A number that the particles bring with them, such as their noise level; 0 without.
double fieldNumber(vtkPolyData* particles, const char* name) {
  vtkDataArray* array = particles->GetFieldData()->GetArray(name);
  return array && array->GetNumberOfValues() > 0 ? std::max(0., array->GetComponent(0, 0)) : 0;
}

/// What the user should know of a flow that misses the particles by far more than their noise, m/s; or empty.
std::string poorFit(const rimflow::VICSharpResult& r, double noise) {
  const double misfit = r.velocityMisfit * r.calibration.velocityNoise;
  if (r.explainedVariance > 0.8 || misfit < 2 * noise) return {};
  return "the flow that was found accounts for only " +
         std::to_string(std::lround(100 * std::max(0., r.explainedVariance))) +
         " % of the variance of the particles' velocities";
}

void fill(vtkImageData* image, const rimflow::VICSharpResult& r) {
  using namespace rimflow;
  image->SetDimensions(r.grid.n.data());
  image->SetSpacing(r.grid.spacing.data());
  image->SetOrigin(r.grid.origin.data());
  addPointArray(image, "Velocity", r.velocity);
  addPointArray(image, "Vorticity", r.vorticity);
  addPointArray(image, "MaterialAcceleration", r.acceleration);
  image->GetPointData()->SetActiveVectors("Velocity");
  addPointArray(image, "PressureOverDensity", r.pressure);
  if (!r.mask.empty()) addMask(image, r.mask);
  addNumber(image, "Iterations", r.iterations);
  addNumber(image, "MisfitVelocity", r.velocityMisfit);
  addNumber(image, "MisfitAcceleration", r.accelerationMisfit);
  addNumber(image, "ExplainedVariance", r.explainedVariance);
  addNumber(image, "DivergenceNorm", r.divergenceNorm);
  addNumber(image, "VelocityNoise", r.calibration.velocityNoise);
  addNumber(image, "AccelerationNoise", r.calibration.accelerationNoise);
  addNumber(image, "CurvatureWeight", r.calibration.curvatureWeight);
  addNumber(image, "ParticlesUsed", double(r.particlesUsed));
  addNumber(image, "Outliers", double(r.outliers));
  addText(image, "StopReason", r.stop);
}

} // namespace

/// What stays the same over all times.
struct vtkVICSharpResample::Internals {
  rimflow::Grid grid;
  Tracks sample; // the snapshot in the middle of the series, and the noise that it brings
  double sampleVelocityNoise = 0, sampleAccelerationNoise = 0;
  std::string settings;      // that all this belongs to; empty: not yet
  vtkMTimeType upstream = 0; // of everything that the particles come from
  std::optional<rimflow::VICSharpCalibration> calibration;
  bool warned = false; // of a flow that misses the particles; once is enough
  rimflow::ResultCache results;
};

vtkVICSharpResample::vtkVICSharpResample() : State(new Internals) {
  this->SetNumberOfInputPorts(2);
  this->SetInputArrayToProcess(0, 0, 0, vtkDataObject::FIELD_ASSOCIATION_POINTS, "Velocity");
  this->SetInputArrayToProcess(1, 0, 0, vtkDataObject::FIELD_ASSOCIATION_POINTS, "Acceleration");
}

vtkVICSharpResample::~vtkVICSharpResample() = default;

int vtkVICSharpResample::FillInputPortInformation(int port, vtkInformation* info) {
  info->Set(vtkAlgorithm::INPUT_REQUIRED_DATA_TYPE(), "vtkPolyData");
  if (port == 1) info->Set(vtkAlgorithm::INPUT_IS_OPTIONAL(), 1);
  return 1;
}

/// The particles in the middle of the series; where they are too few to stand for it (a broken snapshot),
/// those of the nearest time that has enough. Null when the user stopped what they come from.
vtkPolyData* vtkVICSharpResample::SampleOfSeries(vtkInformation* in) {
  constexpr vtkIdType Enough = 100;
  vtkAlgorithm* producer = this->GetInputAlgorithm(0, 0);
  const auto particlesAt = [&](int step) {
    if (step >= 0)
      producer->UpdateTimeStep(in->Get(Pipeline::TIME_STEPS())[step]);
    else
      producer->Update();
    const bool stopped = this->GetAbortExecute() || rimflow::aborted(producer);
    return stopped ? nullptr : vtkPolyData::SafeDownCast(this->GetInputDataObject(0, 0));
  };
  const int steps = in->Length(Pipeline::TIME_STEPS());
  if (steps == 0) return particlesAt(-1);
  const int middle = steps / 2;
  for (int distance = 0; distance <= middle; ++distance)
    for (int step : {middle + distance, middle - distance}) {
      if (step >= steps) continue;
      vtkPolyData* particles = particlesAt(step);
      if (!particles || particles->GetNumberOfPoints() >= Enough) return particles;
    }
  return particlesAt(middle);
}

/// The grid is the same at all times: it is laid out for the snapshot in the middle of the series, and noise
/// and smoothness are found from that one too, so that no result depends on where the user looked first.
/// False: stopped by the user.
bool vtkVICSharpResample::LayOut(vtkInformation* in) {
  std::ostringstream settings;
  settings.precision(17); // every digit of a double
  settings << this->Spacing << " " << this->UseBounds << " " << this->Viscosity << " " << this->VelocityNoise
           << " " << this->AccelerationNoise << " " << this->UseAcceleration;
  for (double b : this->Bounds) settings << " " << b;
  for (int array : {0, 1}) {
    const char* name = this->GetInputArrayInformation(array)->Get(vtkDataObject::FIELD_NAME());
    settings << " " << (name ? name : "");
  }
  const vtkMTimeType upstream = rimflow::upstreamMTime(this, 0);
  Internals& state = *this->State;
  if (settings.str() == state.settings && upstream == state.upstream) return true;
  state = Internals();
  state.results.setLimit(this->CacheSize);
  vtkPolyData* particles = this->SampleOfSeries(in);
  if (!particles) return false;
  std::optional<std::array<double, 6>> bounds;
  if (this->UseBounds) {
    bounds.emplace();
    std::copy_n(this->Bounds, 6, bounds->begin());
  }
  const auto positions =
      particles->GetPoints() ? rimflow::asFloat(particles->GetPoints()->GetData()) : nullptr;
  state.grid = rimflow::resamplingGrid(positions ? positions->GetPointer(0) : nullptr,
                                       positions ? std::size_t(positions->GetNumberOfTuples()) : 0,
                                       this->Spacing, bounds);
  state.sample = tracksOf(this, particles, this->UseAcceleration);
  state.sampleVelocityNoise = fieldNumber(particles, "VelocityNoise");
  state.sampleAccelerationNoise = fieldNumber(particles, "AccelerationNoise");
  state.settings = settings.str();
  state.warned = false;
  state.upstream = upstream;
  return true;
}

int vtkVICSharpResample::RequestInformation(vtkInformation*, vtkInformationVector** inputs,
                                            vtkInformationVector* outputs) {
  vtkInformation* in = inputs[0]->GetInformationObject(0);
  vtkInformation* out = outputs->GetInformationObject(0);
  try {
    if (!this->LayOut(in)) return 1;
  } catch (const std::invalid_argument& error) {
    vtkErrorMacro("The tracks cannot be resampled: " << error.what() << ".");
    return 0;
  }
  const rimflow::Grid& g = this->State->grid;
  const int extent[6] = {0, g.n[0] - 1, 0, g.n[1] - 1, 0, g.n[2] - 1};
  out->Set(Pipeline::WHOLE_EXTENT(), extent, 6);
  out->Set(vtkDataObject::SPACING(), g.spacing.data(), 3);
  out->Set(vtkDataObject::ORIGIN(), g.origin.data(), 3);
  return 1;
}

int vtkVICSharpResample::RequestUpdateExtent(vtkInformation*, vtkInformationVector**, vtkInformationVector*) {
  return 1; // the particles know no extents: nothing of the image's request is theirs
}

int vtkVICSharpResample::RequestData(vtkInformation*, vtkInformationVector** inputs,
                                     vtkInformationVector* outputs) {
  vtkImageData* output = vtkImageData::GetData(outputs);
  output->Initialize();
  // The grid and the calibration are those of the series.
  const vtkMTimeType stamp = this->State->upstream;
  if (this->State->settings.empty()) return 1; // the user stopped before there was a grid
  if (this->State->results.restore(this, inputs, outputs, stamp)) return 1;
  vtkPolyData* particles = vtkPolyData::GetData(inputs[0]);
  vtkPolyData* bodyData =
      inputs[1]->GetNumberOfInformationObjects() > 0 ? vtkPolyData::GetData(inputs[1]) : nullptr;
  const Tracks tracks = tracksOf(this, particles, this->UseAcceleration);
  if (!tracks.velocities) {
    vtkErrorMacro("No velocity found: the particles have "
                  << rimflow::arrayNames(particles)
                  << ". A point array with three components is needed, called "
                     "Velocity or chosen as the input array.");
    return 0;
  }
  const auto start = std::chrono::steady_clock::now();
  try {
    Internals& state = *this->State;
    rimflow::VICSharpOptions options;
    options.grid = state.grid;
    options.viscosity = this->Viscosity;
    options.maximumIterations = this->MaximumIterations;
    options.velocityNoise = this->VelocityNoise;
    options.accelerationNoise = this->AccelerationNoise;
    options.leastVelocityNoise = state.sampleVelocityNoise;
    options.leastAccelerationNoise = state.sampleAccelerationNoise;
    const bool warm = this->WarmStart && state.sample.velocities;
    if (warm && !state.calibration) {
      state.calibration = rimflow::calibrateVICSharp(
          state.sample.view(), options, rimflow::progressOf(this, "VIC#: noise and smoothness", 0, 0.3));
      if (!state.calibration) return 1; // aborted: the output stays empty
    }
    options.leastVelocityNoise = fieldNumber(particles, "VelocityNoise");
    options.leastAccelerationNoise = fieldNumber(particles, "AccelerationNoise");
    if (bodyData) options.body = rimflow::bodyOf(bodyData);
    const rimflow::VICSharpResult result =
        rimflow::vicSharp(tracks.view(), options, warm ? &*state.calibration : nullptr,
                          rimflow::progressOf(this, "VIC#: fit to the tracks", warm ? 0.3 : 0, 1));
    if (result.aborted) return 1;
    fill(output, result);
    const double known = std::max(options.leastVelocityNoise, options.velocityNoise);
    const std::string note = poorFit(result, known > 0 ? known : result.localNoise);
    if (!note.empty()) rimflow::addText(output, "Note", note);
    if (!note.empty() && !state.warned)
      vtkWarningMacro("At the time shown " << note
                                           << ". Do not use it before you know why: check the units of the "
                                              "tracks and the Viscosity ("
                                           << this->Viscosity
                                           << " m2/s), try a smaller Spacing, and Use Acceleration off. This "
                                              "is said once; the field data Note says where it is so.");
    state.warned = state.warned || !note.empty();
  } catch (const std::invalid_argument& error) {
    output->Initialize();
    vtkErrorMacro("The tracks cannot be resampled: " << error.what() << ".");
    return 0;
  }
  rimflow::addNumber(output, "ElapsedTime",
                     std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count());
  vtkInformation* data = particles->GetInformation();
  if (data->Has(vtkDataObject::DATA_TIME_STEP()))
    output->GetInformation()->Set(vtkDataObject::DATA_TIME_STEP(),
                                  data->Get(vtkDataObject::DATA_TIME_STEP()));
  this->State->results.keep(this, outputs, stamp);
  return 1;
}

void vtkVICSharpResample::SetCacheSize(int mebibytes) {
  this->CacheSize = std::max(0, mebibytes);
  this->State->results.setLimit(this->CacheSize);
}

void vtkVICSharpResample::PrintSelf(ostream& os, vtkIndent indent) {
  this->Superclass::PrintSelf(os, indent);
  os << indent << "Spacing: " << this->Spacing << "\n"
     << indent << "UseBounds: " << this->UseBounds << "\n"
     << indent << "Viscosity: " << this->Viscosity << "\n"
     << indent << "VelocityNoise: " << this->VelocityNoise << "\n"
     << indent << "AccelerationNoise: " << this->AccelerationNoise << "\n"
     << indent << "UseAcceleration: " << this->UseAcceleration << "\n"
     << indent << "MaximumIterations: " << this->MaximumIterations << "\n"
     << indent << "WarmStart: " << this->WarmStart << "\n"
     << indent << "CacheSize: " << this->CacheSize << "\n";
}
