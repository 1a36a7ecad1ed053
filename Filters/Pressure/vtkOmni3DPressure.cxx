#include "vtkOmni3DPressure.h"

#include "BodyMask.h"
#include "OneShotPressure.h"
#include "ParallelLinePressure.h"
#include "PressureError.h"
#include "PressureGradient.h"
#include "PseudoTracking.h"
#include "vtkBodyFromPolyData.h"
#include "vtkFieldOutput.h"
#include "vtkFilterProgress.h"
#include "vtkGridFromImage.h"
#include "vtkResultCache.h"
#include "vtkUpstream.h"

#include "vtkInformation.h"
#include "vtkInformationVector.h"
#include "vtkIntArray.h"
#include "vtkObjectFactory.h"
#include "vtkStreamingDemandDrivenPipeline.h"

#include <chrono>
#include <map>
#include <stdexcept>

vtkStandardNewMacro(vtkOmni3DPressure);

namespace {

using Pipeline = vtkStreamingDemandDrivenPipeline;

/// The inputs at one time.
struct Snapshot {
  double time = 0;
  bool hasTime = false;
  vtkSmartPointer<vtkImageData> image;
  rimflow::Grid grid;
  vtkSmartPointer<vtkFloatArray> velocity, acceleration; // or null
  std::vector<unsigned char> mask;                       // empty: fluid everywhere

  const float* velocities() const { return velocity ? velocity->GetPointer(0) : nullptr; }
  const unsigned char* masked() const { return mask.empty() ? nullptr : mask.data(); }
};

/// What the inputs hold now.
Snapshot snapshotOf(vtkAlgorithm* filter) {
  Snapshot s;
  vtkImageData* image = vtkImageData::SafeDownCast(filter->GetInputDataObject(0, 0));
  vtkInformation *data = image->GetInformation(), *in = filter->GetInputInformation(0, 0);
  s.hasTime = data->Has(vtkDataObject::DATA_TIME_STEP());
  s.time = s.hasTime                               ? data->Get(vtkDataObject::DATA_TIME_STEP())
           : in->Has(Pipeline::UPDATE_TIME_STEP()) ? in->Get(Pipeline::UPDATE_TIME_STEP())
                                                   : 0;
  s.image = vtkSmartPointer<vtkImageData>::New();
  s.image->ShallowCopy(image);
  s.grid = rimflow::gridOf(image);
  s.velocity = rimflow::asFloat(rimflow::pointVectors(filter, image, 0, "Velocity", false));
  s.acceleration = rimflow::asFloat(rimflow::pointVectors(filter, image, 1, "MaterialAcceleration", false));
  s.mask = rimflow::maskOf(image);
  if (vtkPolyData* body = vtkPolyData::SafeDownCast(filter->GetInputDataObject(1, 0)))
    for (const rimflow::Body& b : rimflow::bodiesOf(body)) rimflow::maskInside(s.grid, b, s.mask);
  return s;
}

/// Brings the inputs to another time. False when one of them fails.
bool updateInputs(vtkAlgorithm* filter, double time) {
  for (int port = 0; port < filter->GetNumberOfInputPorts(); ++port) {
    if (filter->GetNumberOfInputConnections(port) == 0) continue;
    int from = 0;
    vtkAlgorithm* producer = filter->GetInputAlgorithm(port, 0, from);
    vtkNew<vtkInformationVector> requests;
    requests->SetNumberOfInformationObjects(producer->GetNumberOfOutputPorts());
    requests->GetInformationObject(from)->Set(Pipeline::UPDATE_TIME_STEP(), time);
    if (!producer->Update(from, requests)) return false;
  }
  return true;
}

void refuseWhatIsNoNumber(const char* what, const float* values, const Snapshot& s) {
  if (!values) return;
  std::size_t count = 0;
  for (std::size_t p = 0; p < s.grid.size(); ++p)
    count += (s.mask.empty() || !s.mask[p]) && !Eigen::Map<const Eigen::Vector3f>(values + 3 * p).allFinite();
  if (count > 0)
    throw std::invalid_argument("the " + std::string(what) + " is no finite number at " +
                                std::to_string(count) + " of " + std::to_string(s.grid.size()) +
                                " nodes that hold fluid; mask nodes without data (Mask = 1)");
}

/// Masks the nodes whose gradient is farther than `largest` from that of the pressure; returns how many.
std::size_t leaveOut(const std::vector<float>& unexplained, double largest, Snapshot& s,
                     std::vector<float>& gradient) {
  std::size_t count = 0;
  if (s.mask.empty()) s.mask.assign(s.grid.size(), 0);
  for (std::size_t p = 0; p < s.grid.size(); ++p) {
    if (!(unexplained[p] > largest)) continue;
    s.mask[p] = 1;
    std::fill_n(gradient.begin() + std::ptrdiff_t(3 * p), 3, 0.f);
    ++count;
  }
  return count;
}

/// rms of what is left over the rms of the gradient, both per component.
double partOf(const std::vector<float>& gradient, const std::vector<float>& left) {
  double sum = 0, all = 0;
  for (float e : left) sum += double(e) * e;
  for (float g : gradient) all += double(g) * g;
  return all > 0 ? std::sqrt(3 * sum / all) : 0;
}

void fill(Snapshot& s, const std::vector<float>& gradient, const rimflow::PressureSolution& solution,
          const std::vector<float>& error) {
  using namespace rimflow;
  addPointArray(s.image, "Pressure", solution.pressure);
  addPointArray(s.image, "PressureGradient", gradient);
  addPointArray(s.image, "PressureError", error);
  s.image->GetPointData()->SetActiveScalars("Pressure");
  if (!s.mask.empty()) addMask(s.image, s.mask);
  if (solution.regions > 1) {
    vtkNew<vtkIntArray> region;
    region->SetName("Region");
    region->SetNumberOfTuples(s.image->GetNumberOfPoints());
    std::copy(solution.region.begin(), solution.region.end(), region->GetPointer(0));
    s.image->GetPointData()->AddArray(region);
  }
  addNumber(s.image, "Iterations", solution.iterations);
  addNumber(s.image, "Residual", solution.residual);
  addNumber(s.image, "Regions", solution.regions);
}

} // namespace

struct vtkOmni3DPressure::Internals {
  std::map<double, Snapshot> known; // around the present time, for pseudo-tracking
  vtkMTimeType upstream = 0;        // of everything that the inputs come from
  rimflow::ResultCache results;

  const Snapshot* at(vtkAlgorithm* filter, double time) {
    const auto found = known.find(time);
    if (found != known.end()) return &found->second;
    if (!updateInputs(filter, time)) return nullptr;
    return &(known[time] = snapshotOf(filter));
  }
  rimflow::PseudoTrackingResult track(vtkAlgorithm* filter, const Snapshot& present);
  bool complete(vtkOmni3DPressure* filter, Snapshot& s);
};

/// Du/Dt from the time steps before and after; one of them is enough. Empty when aborted.
rimflow::PseudoTrackingResult vtkOmni3DPressure::Internals::track(vtkAlgorithm* filter,
                                                                  const Snapshot& present) {
  vtkInformation* in = filter->GetInputInformation(0, 0);
  const int n = in->Length(Pipeline::TIME_STEPS());
  if (n < 2)
    throw std::invalid_argument("pseudo-tracking needs the velocity at several times, and the input has " +
                                std::to_string(n) +
                                " time steps; give it MaterialAcceleration, or a series of snapshots");
  const std::vector<double> times(in->Get(Pipeline::TIME_STEPS()), in->Get(Pipeline::TIME_STEPS()) + n);
  const auto nearest = std::min_element(times.begin(), times.end(), [&](double a, double b) {
    return std::abs(a - present.time) < std::abs(b - present.time);
  });
  const double now = *nearest, before = nearest == times.begin() ? now : nearest[-1],
               after = nearest + 1 == times.end() ? now : nearest[1];
  const vtkMTimeType changed = rimflow::upstreamMTime(filter);
  if (changed != upstream) known.clear();
  upstream = changed;
  for (auto it = known.begin(); it != known.end();)
    it = it->first < before || it->first > after ? known.erase(it) : std::next(it);
  known[now] = present;

  rimflow::VelocitySeries series;
  series.grid = present.grid;
  series.present = present.velocities(), series.presentMask = present.masked();
  const auto neighbour = [&](double time, const float*& velocity, const unsigned char*& mask, double& apart) {
    const Snapshot* s = time == now || rimflow::aborted(filter) ? nullptr : this->at(filter, time);
    if (!s || !s->velocity) return; // the end of the series, or a snapshot that cannot be had
    if (s->grid.n != present.grid.n || s->grid.origin != present.grid.origin ||
        s->grid.spacing != present.grid.spacing)
      throw std::invalid_argument("the grid changes from one time step to the next, and pseudo-tracking "
                                  "needs the same one; give the resampling fixed bounds and spacing");
    refuseWhatIsNoNumber("velocity of the time step before or after", s->velocities(), *s);
    velocity = s->velocities(), mask = s->masked(), apart = std::abs(time - now);
  };
  neighbour(before, series.previous, series.previousMask, series.timeBefore);
  neighbour(after, series.next, series.nextMask, series.timeAfter);
  if (rimflow::aborted(filter)) return {};
  return rimflow::pseudoTracking(series, rimflow::progressOf(filter, "Pressure: pseudo-tracking", 0, 0.2));
}

/// Throws when the settings or the arrays do not do; finds the acceleration where it is to be found. False:
/// aborted.
bool vtkOmni3DPressure::Internals::complete(vtkOmni3DPressure* filter, Snapshot& s) {
  if (!(filter->Density > 0)) throw std::invalid_argument("the Density must be greater than 0 kg/m3");
  if (filter->Order != 2 && filter->Order != 4)
    throw std::invalid_argument("the Order is " + std::to_string(filter->Order) + "; it must be 2 or 4");
  const bool tracks = filter->PseudoTracking == ALWAYS || (filter->PseudoTracking == AUTO && !s.acceleration);
  const auto missing = [&s](const std::string& what, const std::string& name, const std::string& instead) {
    return std::invalid_argument("no " + what + " found: the image has " + rimflow::arrayNames(s.image) +
                                 ". A point array with three components is needed, called " + name +
                                 " or chosen as the input array" + instead);
  };
  if (tracks && !s.velocity) throw missing("velocity", "Velocity", "");
  if (filter->Viscosity > 0 && !s.velocity)
    throw missing("velocity", "Velocity", "; or set Viscosity to 0 for an inviscid fluid");
  if (!tracks && !s.acceleration)
    throw missing("material acceleration", "MaterialAcceleration", "; or allow pseudo-tracking");
  if (tracks || filter->Viscosity > 0) refuseWhatIsNoNumber("velocity", s.velocities(), s);
  if (tracks) {
    const rimflow::PseudoTrackingResult result = this->track(filter, s);
    if (result.mask.empty()) return false;
    s.mask = result.mask;
    rimflow::addPointArray(s.image, "MaterialAcceleration", result.acceleration);
    s.acceleration = vtkFloatArray::SafeDownCast(s.image->GetPointData()->GetArray("MaterialAcceleration"));
  }
  refuseWhatIsNoNumber("material acceleration", s.acceleration->GetPointer(0), s);
  return true;
}

vtkOmni3DPressure::vtkOmni3DPressure() : State(new Internals) {
  this->SetNumberOfInputPorts(2);
  this->SetInputArrayToProcess(0, 0, 0, vtkDataObject::FIELD_ASSOCIATION_POINTS, "Velocity");
  this->SetInputArrayToProcess(1, 0, 0, vtkDataObject::FIELD_ASSOCIATION_POINTS, "MaterialAcceleration");
}

vtkOmni3DPressure::~vtkOmni3DPressure() = default;

int vtkOmni3DPressure::FillInputPortInformation(int port, vtkInformation* info) {
  info->Set(vtkAlgorithm::INPUT_REQUIRED_DATA_TYPE(), port == 0 ? "vtkImageData" : "vtkPolyData");
  if (port == 1) info->Set(vtkAlgorithm::INPUT_IS_OPTIONAL(), 1);
  return 1;
}

int vtkOmni3DPressure::RequestUpdateExtent(vtkInformation*, vtkInformationVector** inputs,
                                           vtkInformationVector*) {
  // The pressure of a part depends on all of the image.
  vtkInformation* in = inputs[0]->GetInformationObject(0);
  if (in->Has(Pipeline::WHOLE_EXTENT()))
    in->Set(Pipeline::UPDATE_EXTENT(), in->Get(Pipeline::WHOLE_EXTENT()), 6);
  return 1;
}

rimflow::PressureSolution vtkOmni3DPressure::Solve(const rimflow::PressureProblem& problem,
                                                   const std::function<bool(double)>& progress) {
  const auto choose = [this](auto options) {
    if (this->Tolerance > 0) options.tolerance = this->Tolerance;
    if (this->MaximumIterations > 0) options.maximumIterations = this->MaximumIterations;
    return options;
  };
  const auto warnUnlessConverged = [this](const rimflow::PressureSolution& s, int most, double tolerance) {
    if (!s.aborted && s.iterations >= most && s.residual > tolerance)
      vtkWarningMacro("The pressure has not converged: after "
                      << s.iterations << " iterations the residual is " << s.residual << ", not " << tolerance
                      << ". Allow more iterations or a larger tolerance.");
  };
  if (this->Method == PARALLEL_LINES) {
    rimflow::ParallelLineOptions options = choose(rimflow::ParallelLineOptions());
    options.directions = this->NumberOfDirections;
    options.lineSpacing = this->LineSpacing;
    auto solution = rimflow::parallelLinePressure(problem, options, progress);
    warnUnlessConverged(solution, options.maximumIterations, options.tolerance);
    return solution;
  }
  rimflow::OneShotOptions options = choose(rimflow::OneShotOptions());
  options.order = this->Order;
  options.wallWeight = this->WallWeight;
  auto solution = rimflow::oneShotPressure(problem, options, progress);
  warnUnlessConverged(solution, options.maximumIterations, options.tolerance);
  return solution;
}

int vtkOmni3DPressure::RequestData(vtkInformation*, vtkInformationVector** inputs,
                                   vtkInformationVector* outputs) {
  vtkImageData* output = vtkImageData::GetData(outputs);
  output->Initialize();
  // Pseudo-tracking also looks at what the inputs hold at other times.
  const vtkMTimeType stamp = this->PseudoTracking == NEVER ? 0 : rimflow::upstreamMTime(this);
  if (this->State->results.restore(this, inputs, outputs, stamp)) return 1;
  const auto start = std::chrono::steady_clock::now();
  try {
    Snapshot s = snapshotOf(this);
    if (s.grid.size() == 0) return 1;
    if (!this->State->complete(this, s)) return 1; // aborted: the output stays empty
    std::vector<float> gradient = rimflow::pressureGradient(
        s.grid, this->Viscosity > 0 ? s.velocities() : nullptr, s.acceleration->GetPointer(0), s.masked(),
        this->Density, this->Viscosity, rimflow::progressOf(this, "Pressure: its gradient", 0.2, 0.25));
    if (gradient.empty()) return 1;
    refuseWhatIsNoNumber("pressure gradient", gradient.data(), s);

    rimflow::PressureProblem problem{s.grid, gradient.data(), s.masked()};
    const bool leavesOut = this->LargestGradientError > 0;
    const char* const integration = "Pressure: integration";
    auto solution =
        this->Solve(problem, rimflow::progressOf(this, integration, 0.25, leavesOut ? 0.55 : 0.85));
    std::size_t leftOut = 0;
    if (leavesOut && !solution.aborted) {
      leftOut = leaveOut(rimflow::unexplainedGradient(problem, solution.pressure.data(), this->Order),
                         this->LargestGradientError, s, gradient);
      problem.mask = s.masked();
      if (leftOut > 0) solution = this->Solve(problem, rimflow::progressOf(this, integration, 0.55, 0.85));
    }
    if (solution.aborted) return 1;
    rimflow::Progress uncertainty = rimflow::progressOf(this, "Pressure: uncertainty", 0.85, 1);
    const std::vector<float> error =
        rimflow::pressureError(problem, solution.pressure.data(), rimflow::part(uncertainty, 0, 0.8));
    if (error.empty() || !uncertainty(0.8)) return 1;
    fill(s, gradient, solution, error);
    rimflow::addNumber(
        s.image, "CurlResidual",
        partOf(gradient, rimflow::unexplainedGradient(problem, solution.pressure.data(), this->Order)));
    rimflow::addNumber(s.image, "NodesLeftOut", double(leftOut));
    rimflow::addNumber(s.image, "Density", this->Density);
    rimflow::addNumber(s.image, "Viscosity", this->Viscosity);
    rimflow::addNumber(s.image, "ElapsedTime",
                       std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count());
    output->ShallowCopy(s.image);
    if (s.hasTime) output->GetInformation()->Set(vtkDataObject::DATA_TIME_STEP(), s.time);
    this->State->results.keep(this, outputs, stamp);
  } catch (const std::invalid_argument& error) {
    vtkErrorMacro("The pressure cannot be integrated: " << error.what() << ".");
    return 0;
  }
  return 1;
}

void vtkOmni3DPressure::SetCacheSize(int mebibytes) {
  this->CacheSize = std::max(0, mebibytes);
  this->State->results.setLimit(this->CacheSize);
}

void vtkOmni3DPressure::PrintSelf(ostream& os, vtkIndent indent) {
  this->Superclass::PrintSelf(os, indent);
  os << indent << "Density: " << this->Density << "\n"
     << indent << "Viscosity: " << this->Viscosity << "\n"
     << indent << "Method: " << (this->Method == PARALLEL_LINES ? "parallel lines" : "one-shot") << "\n"
     << indent << "Order: " << this->Order << "\n"
     << indent << "WallWeight: " << this->WallWeight << "\n"
     << indent << "NumberOfDirections: " << this->NumberOfDirections << "\n"
     << indent << "LineSpacing: " << this->LineSpacing << "\n"
     << indent << "Tolerance: " << this->Tolerance << "\n"
     << indent << "MaximumIterations: " << this->MaximumIterations << "\n"
     << indent << "LargestGradientError: " << this->LargestGradientError << "\n"
     << indent << "PseudoTracking: " << this->PseudoTracking << "\n"
     << indent << "CacheSize: " << this->CacheSize << "\n";
}
