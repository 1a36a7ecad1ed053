#include "vtkInvisibleSphereLocator.h"

#include "SphereGroup.h"
#include "vtkBodyOutput.h"
#include "vtkFilterProgress.h"
#include "vtkGridFromImage.h"
#include "vtkTrajectorySmoother.h"
#include "vtkUpstream.h"
#include "vtkWallView.h"

#include "vtkAppendPolyData.h"
#include "vtkCellArray.h"
#include "vtkDoubleArray.h"
#include "vtkExecutive.h"
#include "vtkFieldData.h"
#include "vtkImageData.h"
#include "vtkInformation.h"
#include "vtkInformationVector.h"
#include "vtkIntArray.h"
#include "vtkNew.h"
#include "vtkObjectFactory.h"
#include "vtkPointData.h"
#include "vtkPoints.h"
#include "vtkPolyData.h"
#include "vtkStreamingDemandDrivenPipeline.h"
#include "vtkStringArray.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <limits>
#include <stdexcept>
#include <vector>

vtkStandardNewMacro(vtkInvisibleSphereLocator);

struct vtkInvisibleSphereLocator::Internals {
  std::unique_ptr<rimflow::SphereGroup> group;
  std::vector<double> settings; // that the group was made with
  vtkMTimeType upstream = 0;    // of everything that the particles and the flow come from
  std::vector<double> pending;  // times that ProcessAllTimes has still to visit
  std::size_t pendingAtStart = 0;
  bool looping = false, lookingAgain = false;
  double requested = 0; // the time that was asked for when the loop began

  /// A sphere's trajectory, kept until more is known of it.
  struct Smoothed {
    vtkSmartPointer<vtkPolyData> trajectory;
    std::size_t known = 0, found = 0;
    bool whole = false;
    // the most likely parameters of the motion, kept while the number of snapshots hardly changes
    std::size_t fittedTo = 0;
    double jerkIntensity = -1, correlatedFraction = -1, correlationTime = 0;
  };
  std::vector<Smoothed> smoothed; // one per sphere
};

namespace {

using rimflow::LocatedSphere;

constexpr double Nothing = std::numeric_limits<double>::quiet_NaN();

/// One row per snapshot under the names of the public contract.
class Rows {
public:
  explicit Rows(std::size_t sphere) : sphere_(double(sphere)) {
    points_->SetDataTypeToDouble();
    for (const auto& [name, components] : {std::pair{"Time", 1},
                                           {"Centre", 3},
                                           {"Velocity", 3},
                                           {"VelocitySigma", 3},
                                           {"Acceleration", 3},
                                           {"AccelerationSigma", 3},
                                           {"AngularVelocity", 3},
                                           {"AngularVelocitySigma", 3},
                                           {"Covariance", 6},
                                           {"Sigma", 3},
                                           {"SigmaTensor", 9},
                                           {"Diameter", 1},
                                           {"DiameterSigma", 1},
                                           {"Cost", 1},
                                           {"GradientNorm", 1},
                                           {"OffsetVoid", 1},
                                           {"OffsetVelocity", 1},
                                           {"OffsetVortex", 1}}) {
      vtkNew<vtkDoubleArray> array;
      array->SetName(name);
      array->SetNumberOfComponents(components);
      data_->GetPointData()->AddArray(array);
    }
    for (const char* name : {"SphereId", "Iterations", "ParticlesInside", "Status"}) {
      vtkNew<vtkIntArray> array;
      array->SetName(name);
      data_->GetPointData()->AddArray(array);
    }
    text_->SetName("StatusText");
    data_->GetPointData()->AddArray(text_);
    data_->SetPoints(points_);
  }

  void add(double time, const LocatedSphere& s) {
    const Eigen::Matrix3d& c = s.covariance;
    const double packed[6] = {c(0, 0), c(1, 1), c(2, 2), c(0, 1), c(1, 2), c(0, 2)};
    const Eigen::Vector3d sigma = c.diagonal().cwiseSqrt();
    const Eigen::Matrix3d root = Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>(c).operatorSqrt();
    const Eigen::Vector3d velocity = s.wallVelocitySigma >= 0 ? s.wallVelocity : Eigen::Vector3d::Zero();
    points_->InsertNextPoint(s.centre.data());
    tuple("Time", &time);
    tuple("Centre", s.found ? s.centre.data() : Eigen::Vector3d::Constant(Nothing).eval().data());
    tuple("Velocity", velocity.data());
    tuple("VelocitySigma", Eigen::Vector3d::Constant(std::max(-1., s.wallVelocitySigma)).eval().data());
    const Eigen::Vector3d zero = Eigen::Vector3d::Zero(), notKnown = Eigen::Vector3d::Constant(-1);
    tuple("Acceleration", zero.data());
    tuple("AccelerationSigma", notKnown.data());
    tuple("AngularVelocity", zero.data());
    tuple("AngularVelocitySigma", notKnown.data());
    tuple("Covariance", packed);
    tuple("Sigma", sigma.data());
    tuple("SigmaTensor", root.data());
    tuple("Diameter", s.found ? &s.diameter : &Nothing);
    tuple("DiameterSigma", s.found ? &s.diameterSigma : &Nothing);
    tuple("SphereId", &sphere_);
    tuple("Cost", s.found ? &s.cost : &Nothing);
    tuple("GradientNorm", s.found ? &s.gradientNorm : &Nothing);
    tuple("OffsetVoid", &s.offsetVoid);
    tuple("OffsetVelocity", &s.offsetVelocity);
    tuple("OffsetVortex", &s.offsetVortex);
    const double counts[3] = {double(s.iterations), s.found ? double(s.particlesInside) : -1.,
                              s.found ? 0. : 2.};
    tuple("Iterations", counts);
    tuple("ParticlesInside", counts + 1);
    tuple("Status", counts + 2);
    text_->InsertNextValue(s.found ? s.text : "predicted from the neighbours; by itself: " + s.text);
  }

  vtkPolyData* data() { return data_; }
  /// The same diameter in all rows: a sphere has one.
  void fillDiameter(double diameter) { data_->GetPointData()->GetArray("Diameter")->Fill(diameter); }

private:
  void tuple(const char* name, const double* values) {
    data_->GetPointData()->GetArray(name)->InsertNextTuple(values);
  }

  double sphere_;
  vtkNew<vtkPolyData> data_;
  vtkNew<vtkPoints> points_;
  vtkNew<vtkStringArray> text_;
};

/// The trajectory's points that are not lost; the line goes through these already.
void withoutLost(vtkPolyData* smoothed, vtkPolyData* trajectory) {
  vtkDataArray* status = smoothed->GetPointData()->GetArray("Status");
  vtkPointData* data = trajectory->GetPointData();
  data->CopyAllOn();
  data->CopyAllocate(smoothed->GetPointData(), smoothed->GetNumberOfPoints());
  vtkNew<vtkPoints> points;
  points->SetDataTypeToDouble();
  vtkNew<vtkCellArray> line;
  for (vtkIdType p = 0; p < smoothed->GetNumberOfPoints(); ++p)
    if (status->GetTuple1(p) != 2)
      data->CopyData(smoothed->GetPointData(), p, points->InsertNextPoint(smoothed->GetPoint(p)));
  line->InsertNextCell(int(points->GetNumberOfPoints()));
  for (vtkIdType p = 0; p < points->GetNumberOfPoints(); ++p) line->InsertCellPoint(p);
  trajectory->SetPoints(points);
  trajectory->SetLines(line);
  trajectory->GetFieldData()->ShallowCopy(smoothed->GetFieldData());
}

rimflow::CentreEstimate estimateOf(double time, const LocatedSphere& s) {
  return {time, s.found, s.centre, s.covariance, s.wall};
}

/// Brings a sphere's trajectory up to date: as it is known so far, or `whole`: all snapshots jointly. False:
/// aborted.
bool smooth(std::size_t sphere, const std::map<double, LocatedSphere>& known, bool whole,
            vtkInvisibleSphereLocator::Internals::Smoothed& state, const rimflow::Progress& progress) {
  const auto found =
      std::size_t(std::count_if(known.begin(), known.end(), [](const auto& k) { return k.second.found; }));
  if (state.trajectory && state.known == known.size() && state.found == found && state.whole == whole)
    return true;
  state.trajectory = nullptr;
  state.known = known.size(), state.found = found, state.whole = whole;
  const auto trajectory = vtkSmartPointer<vtkPolyData>::New();
  Rows rows(sphere);
  vtkNew<vtkTrajectorySmoother> smoother;
  double diameter = 0;
  for (const auto& [time, s] : known) {
    if (!s.found && found < 2) continue;
    rows.add(time, s);
    if (!s.found) continue;
    diameter += s.diameter / double(found);
    if (!whole || !s.wall) continue;
    vtkNew<vtkPolyData> wall;
    rimflow::wallToPolyData(estimateOf(time, s), 0.5 * s.diameter, wall);
    smoother->AddInputDataObject(1, wall);
  }
  if (found < 2) {
    trajectory->ShallowCopy(rows.data());
    state.trajectory = trajectory;
    return true;
  }
  rows.fillDiameter(diameter);
  const bool fresh = found > 30 && found < 1.2 * state.fittedTo && found >= state.fittedTo;
  smoother->SetJerkIntensity(fresh ? state.jerkIntensity : -1);
  smoother->SetCorrelatedFraction(fresh ? state.correlatedFraction : -1);
  smoother->SetCorrelationTime(fresh ? state.correlationTime : 0);
  smoother->SetLargestPredictionSigma(0.5 * diameter);
  smoother->SetInputData(rows.data());
  if (!rimflow::updateInside(smoother, progress)) return false;
  withoutLost(smoother->GetOutput(), trajectory);
  state.trajectory = trajectory;
  if (!fresh) {
    const auto fitted = [&](const char* name) {
      return smoother->GetOutput()->GetFieldData()->GetArray(name)->GetTuple1(0);
    };
    state.fittedTo = found;
    state.jerkIntensity = fitted("JerkIntensity");
    state.correlatedFraction = fitted("CorrelatedFraction");
    state.correlationTime = fitted("CorrelationTime");
  }
  return true;
}

/// The point of a trajectory at this time; -1: there is none.
vtkIdType pointAt(double time, vtkPolyData* trajectory) {
  vtkDataArray* times = trajectory->GetPointData()->GetArray("Time");
  for (vtkIdType p = 0; p < trajectory->GetNumberOfPoints(); ++p)
    if (times->GetTuple1(p) == time) return p;
  return -1;
}

void makeVertex(vtkPolyData* point) {
  vtkNew<vtkCellArray> vertex;
  const vtkIdType first = 0;
  vertex->InsertNextCell(1, &first);
  point->SetVerts(vertex);
}

/// One point for a found sphere, with the motion that its trajectory tells.
vtkSmartPointer<vtkPolyData> centreOf(std::size_t sphere, double time, const LocatedSphere& s,
                                      vtkPolyData* trajectory) {
  Rows one(sphere);
  one.add(time, s);
  const vtkIdType at = pointAt(time, trajectory);
  if (at >= 0 && trajectory->GetPointData()->GetArray("RawCentre")) // smoothed
    for (const char* name : {"Velocity", "VelocitySigma", "Acceleration", "AccelerationSigma",
                             "AngularVelocity", "AngularVelocitySigma"})
      one.data()->GetPointData()->GetArray(name)->SetTuple(0, at, trajectory->GetPointData()->GetArray(name));
  makeVertex(one.data());
  return one.data();
}

/// One point of a trajectory by itself.
vtkSmartPointer<vtkPolyData> onTrajectory(vtkPolyData* trajectory, vtkIdType at) {
  auto one = vtkSmartPointer<vtkPolyData>::New();
  vtkNew<vtkPoints> points;
  points->SetDataTypeToDouble();
  points->InsertNextPoint(trajectory->GetPoint(at));
  one->SetPoints(points);
  one->GetPointData()->CopyAllOn();
  one->GetPointData()->CopyAllocate(trajectory->GetPointData(), 1);
  one->GetPointData()->CopyData(trajectory->GetPointData(), at, 0);
  makeVertex(one);
  return one;
}

/// Around a point with Centre and Diameter.
vtkSmartPointer<vtkPolyData> surfaceOf(std::size_t sphere, vtkPolyData* point, int resolution) {
  const auto surface =
      rimflow::sphereSurface(point->GetPointData()->GetArray("Centre")->GetTuple3(0),
                             point->GetPointData()->GetArray("Diameter")->GetTuple1(0), resolution);
  vtkNew<vtkIntArray> id;
  id->SetName("SphereId");
  id->SetNumberOfTuples(surface->GetNumberOfPoints());
  id->Fill(double(sphere));
  surface->GetPointData()->AddArray(id);
  return surface;
}

void join(vtkAppendPolyData* parts, vtkPolyData* output) {
  if (parts->GetNumberOfInputConnections(0) == 1) {
    output->ShallowCopy(parts->GetInput(0));
    return;
  }
  parts->Update();
  output->ShallowCopy(parts->GetOutput());
}

} // namespace

vtkInvisibleSphereLocator::vtkInvisibleSphereLocator() : State(new Internals) {
  this->SetNumberOfInputPorts(2);
  this->SetNumberOfOutputPorts(4);
  this->SetInputArrayToProcess(0, 0, 0, vtkDataObject::FIELD_ASSOCIATION_POINTS, "Velocity");
  this->SetInputArrayToProcess(1, 0, 0, vtkDataObject::FIELD_ASSOCIATION_POINTS, "TrackId");
}

vtkInvisibleSphereLocator::~vtkInvisibleSphereLocator() = default;

int vtkInvisibleSphereLocator::FillInputPortInformation(int port, vtkInformation* info) {
  info->Set(vtkAlgorithm::INPUT_REQUIRED_DATA_TYPE(), port == 0 ? "vtkPolyData" : "vtkImageData");
  if (port == 1) info->Set(vtkAlgorithm::INPUT_IS_OPTIONAL(), 1);
  return 1;
}

int vtkInvisibleSphereLocator::RequestInformation(vtkInformation*, vtkInformationVector** inputs,
                                                  vtkInformationVector* outputs) {
  using Pipeline = vtkStreamingDemandDrivenPipeline;
  vtkInformation* in = inputs[0]->GetInformationObject(0);
  for (int port = 0; port < this->GetNumberOfOutputPorts(); ++port) {
    vtkInformation* out = outputs->GetInformationObject(port);
    if (in->Has(Pipeline::TIME_STEPS())) out->CopyEntry(in, Pipeline::TIME_STEPS());
    if (in->Has(Pipeline::TIME_RANGE())) out->CopyEntry(in, Pipeline::TIME_RANGE());
  }
  return 1;
}

int vtkInvisibleSphereLocator::RequestUpdateExtent(vtkInformation* request, vtkInformationVector** inputs,
                                                   vtkInformationVector* outputs) {
  using Pipeline = vtkStreamingDemandDrivenPipeline;
  Internals& state = *this->State;
  if (this->ProcessAllTimes && !state.looping) {
    this->RenewTracker();
    vtkInformation* in = inputs[0]->GetInformationObject(0);
    const int n = in->Length(Pipeline::TIME_STEPS());
    const double* times = in->Get(Pipeline::TIME_STEPS());
    state.pending.clear();
    for (int k = n; k-- > 0;)
      if (state.group && !state.group->knows(times[k])) state.pending.push_back(times[k]);
    if (state.pending.empty() && state.group) { // all visited one by one, but not all in the best order
      const std::vector<double> again = state.group->worthAnotherLook();
      state.pending.assign(again.rbegin(), again.rend());
    }
    const int port = std::max(0, request->Get(vtkExecutive::FROM_OUTPUT_PORT()));
    vtkInformation* out = outputs->GetInformationObject(port);
    state.requested = out->Has(Pipeline::UPDATE_TIME_STEP()) ? out->Get(Pipeline::UPDATE_TIME_STEP())
                      : n                                    ? times[0]
                                                             : 0;
    state.pendingAtStart = state.pending.size();
    state.looping = !state.pending.empty();
    state.lookingAgain = false;
    state.pending.insert(state.pending.begin(),
                         state.requested); // last, so that the inputs end at the time on show
  }
  this->ShiftProgress();
  if (state.looping)
    for (int port = 0; port < 2; ++port)
      if (inputs[port]->GetNumberOfInformationObjects() > 0)
        inputs[port]->GetInformationObject(0)->Set(Pipeline::UPDATE_TIME_STEP(), state.pending.back());
  return 1;
}

void vtkInvisibleSphereLocator::RenewTracker() {
  Internals& state = *this->State;
  std::vector<double> diameters{this->Diameter};
  diameters.insert(diameters.end(), this->OtherDiameters.begin(), this->OtherDiameters.end());
  std::vector<double> settings{double(this->Method), double(this->UseInitialGuess),
                               this->SearchRadius,   this->PositionNoise,
                               this->GhostRate,      this->DiameterSigma};
  settings.insert(settings.end(), diameters.begin(), diameters.end());
  if (this->UseInitialGuess) settings.insert(settings.end(), this->InitialGuess, this->InitialGuess + 3);
  if (this->Method == PUBLISHED_COST)
    settings.insert(settings.end(),
                    {this->UpDirection[0], this->UpDirection[1], this->UpDirection[2], this->WeightVelocity,
                     this->WeightVortex, this->ShellA, this->ShellB, this->ShellC, this->ShellE,
                     this->FiniteDifferenceStep, this->Tolerance, double(this->MaximumIterations)});
  const vtkMTimeType upstream = rimflow::upstreamMTime(this);
  if (state.group && settings == state.settings && upstream == state.upstream) return;

  rimflow::TrackerOptions o;
  o.method = this->Method == PUBLISHED_COST ? rimflow::LocatorMethod::PublishedCost
                                            : rimflow::LocatorMethod::VoidLikelihood;
  o.likelihood.diameterSigma = this->DiameterSigma;
  o.likelihood.positionNoise = this->PositionNoise;
  o.likelihood.ghostRate = this->GhostRate;
  o.likelihood.searchSide = 2 * this->SearchRadius;
  o.published.up = Eigen::Vector3d(this->UpDirection);
  o.published.weightVelocity = this->WeightVelocity;
  o.published.weightVortex = this->WeightVortex;
  o.published.a = this->ShellA;
  o.published.b = this->ShellB;
  o.published.c = this->ShellC;
  o.published.e = this->ShellE;
  o.published.step = this->FiniteDifferenceStep;
  o.published.tolerance = this->Tolerance;
  o.published.maximumIterations = this->MaximumIterations;
  if (this->UseInitialGuess) o.guess = Eigen::Vector3d(this->InitialGuess);
  state = Internals();
  state.group = std::make_unique<rimflow::SphereGroup>(o, diameters); // throws when a diameter is none
  state.smoothed.resize(diameters.size());
  state.settings = settings;
  state.upstream = upstream;
}

void vtkInvisibleSphereLocator::LocateAt(double time, vtkPolyData* particles, vtkImageData* image) {
  if (!this->State->group->wants(time)) return;
  vtkSmartPointer<vtkFloatArray> positions, velocities, flowVelocity, flowQ;
  vtkSmartPointer<vtkIdTypeArray> tracks;
  if (particles->GetPoints()) positions = rimflow::asFloat(particles->GetPoints()->GetData());
  velocities = rimflow::asFloat(rimflow::pointVectors(this, particles, 0, "Velocity"));
  tracks = vtkIdTypeArray::SafeDownCast(rimflow::pointNumbers(this, particles, 1, "TrackId"));
  static_assert(sizeof(vtkIdType) == sizeof(std::int64_t), "ids of tracks have 64 bits");
  const rimflow::SnapshotParticles snapshot(
      positions ? positions->GetPointer(0) : nullptr,
      std::size_t(positions ? positions->GetNumberOfTuples() : 0),
      velocities ? velocities->GetPointer(0) : nullptr,
      tracks ? reinterpret_cast<const std::int64_t*>(tracks->GetPointer(0)) : nullptr);

  rimflow::FlowField flow;
  std::vector<unsigned char> mask;
  if (this->Method == PUBLISHED_COST) {
    vtkDataArray* q = image ? image->GetPointData()->GetArray("QCriterion") : nullptr;
    vtkDataArray* u = image ? image->GetPointData()->GetArray("Velocity") : nullptr;
    if (!q || !u || u->GetNumberOfComponents() != 3)
      throw std::invalid_argument(
          std::string("the published cost needs the flow on a grid: ") +
          (image ? "the Flow input has " + rimflow::arrayNames(image) +
                       ", and Velocity and QCriterion are needed"
                 : "connect the output of Q-Criterion (after VIC# Resample of the same particles) to Flow") +
          ", or choose the void likelihood");
    flowVelocity = rimflow::asFloat(u);
    flowQ = rimflow::asFloat(q);
    mask = rimflow::maskOf(image);
    flow = {rimflow::gridOf(image), flowVelocity->GetPointer(0), flowQ->GetPointer(0),
            mask.empty() ? nullptr : mask.data()};
  }
  this->State->group->locate(time, snapshot, flow.velocity ? &flow : nullptr,
                             rimflow::progressOf(this, this->StepText("Locating the sphere"), 0, 0.9));
}

/// What is done, and at how many of the times that ProcessAllTimes visits.
std::string vtkInvisibleSphereLocator::StepText(const std::string& step) const {
  const Internals& state = *this->State;
  if (!state.looping) return step;
  const std::size_t visit =
      state.pendingAtStart + 1 - std::min(state.pendingAtStart, state.pending.size() - 1);
  return step + ": time " + std::to_string(std::min(visit, state.pendingAtStart)) + " of " +
         std::to_string(state.pendingAtStart);
}

/// The pipeline executes the filter once per visit: each is its part of the whole. The last one also makes
/// the trajectory.
void vtkInvisibleSphereLocator::ShiftProgress() {
  const Internals& state = *this->State;
  constexpr double Visits = 0.7;
  this->SetProgressText(this->StepText("Locating the sphere").c_str());
  if (!state.looping) {
    this->SetProgressShiftScale(0, 1);
    return;
  }
  const double all = double(state.pendingAtStart), left = double(state.pending.size()) - 1;
  const bool last = left <= 0;
  this->SetProgressShiftScale(Visits * (last ? 1 : std::max(0., 1 - left / all)),
                              last ? 1 - Visits : Visits / all);
}

int vtkInvisibleSphereLocator::RequestData(vtkInformation* request, vtkInformationVector** inputs,
                                           vtkInformationVector* outputs) {
  Internals& state = *this->State;
  for (int port = 0; port < 4; ++port) vtkPolyData::GetData(outputs, port)->Initialize();
  vtkPolyData* particles = vtkPolyData::GetData(inputs[0]);
  vtkImageData* flow =
      inputs[1]->GetNumberOfInformationObjects() > 0 ? vtkImageData::GetData(inputs[1]) : nullptr;
  vtkInformation* data = particles->GetInformation();
  const double time =
      data->Has(vtkDataObject::DATA_TIME_STEP()) ? data->Get(vtkDataObject::DATA_TIME_STEP()) : 0;
  try {
    this->RenewTracker();
    this->LocateAt(time, particles, flow);
    if (state.looping) {
      if (!state.pending.empty()) state.pending.pop_back();
      if (state.pending.size() == 1 && !state.lookingAgain) { // all visited: back to those lost at first
        const std::vector<double> again = state.group->worthAnotherLook();
        state.pending.insert(state.pending.end(), again.rbegin(), again.rend());
        state.pendingAtStart += again.size();
        state.lookingAgain = true;
      }
      if (!state.pending.empty() && !rimflow::aborted(this)) {
        request->Set(vtkStreamingDemandDrivenPipeline::CONTINUE_EXECUTING(), 1);
        return 1;
      }
      request->Remove(vtkStreamingDemandDrivenPipeline::CONTINUE_EXECUTING());
      state.looping = false;
    }
    if (!rimflow::aborted(this))
      this->FillOutputs(
          time, this->JointTrajectory && this->AllTimesKnown(inputs[0]->GetInformationObject(0)), outputs);
  } catch (const std::exception& error) {
    request->Remove(vtkStreamingDemandDrivenPipeline::CONTINUE_EXECUTING());
    state.looping = false;
    for (int port = 0; port < 4; ++port) vtkPolyData::GetData(outputs, port)->Initialize();
    vtkErrorMacro("The sphere cannot be located: " << error.what() << ".");
    return 0;
  }
  return 1;
}

bool vtkInvisibleSphereLocator::AllTimesKnown(vtkInformation* input) const {
  using Pipeline = vtkStreamingDemandDrivenPipeline;
  const int n = input->Length(Pipeline::TIME_STEPS());
  const double* times = input->Get(Pipeline::TIME_STEPS());
  return std::all_of(times, times + n, [this](double t) { return this->State->group->knows(t); });
}

void vtkInvisibleSphereLocator::FillOutputs(double time, bool whole, vtkInformationVector* outputs) {
  Internals& state = *this->State;
  vtkPolyData *surface = vtkPolyData::GetData(outputs, 0), *centre = vtkPolyData::GetData(outputs, 1),
              *trajectory = vtkPolyData::GetData(outputs, 2), *wall = vtkPolyData::GetData(outputs, 3);
  vtkNew<vtkAppendPolyData> surfaces, bodies, centres, trajectories;
  std::string why;
  for (std::size_t i = 0; i < state.group->size(); ++i) {
    const auto& known = (*state.group)[i].known();
    const auto here = known.find(time);
    const double begin = whole ? 0.1 : 0.9, share = (1 - begin) / double(state.group->size()),
                 from = begin + share * double(i);
    if (here == known.end() ||
        !smooth(i, known, whole, state.smoothed[i],
                rimflow::progressOf(this, whole ? "Joint estimate of all times" : "Smoothing the trajectory",
                                    from, from + share)))
      return; // aborted
    vtkPolyData* path = state.smoothed[i].trajectory;
    trajectories->AddInputData(path);
    vtkSmartPointer<vtkPolyData> body;
    if (here->second.found) {
      centres->AddInputData(body = centreOf(i, time, here->second, path));
      if (i == 0 && here->second.wall)
        rimflow::wallToPolyData(estimateOf(time, here->second), 0.5 * here->second.diameter, wall);
    } else
      why += (why.empty() ? "" : "; ") + here->second.text;
    if (const vtkIdType at = whole ? pointAt(time, path) : -1; at >= 0) body = onTrajectory(path, at);
    if (!body) continue;
    bodies->AddInputData(body);
    surfaces->AddInputData(surfaceOf(i, body, this->SphereResolution));
  }
  join(trajectories, trajectory);
  if (state.group->size() == 1)
    trajectory->GetFieldData()->ShallowCopy(state.smoothed[0].trajectory->GetFieldData());
  if (centres->GetNumberOfInputConnections(0) == 0)
    rimflow::addLostBody(centre, time, this->Diameter, why);
  else {
    join(centres, centre);
    rimflow::pointsToFieldData(centre, centre);
  }
  if (bodies->GetNumberOfInputConnections(0) == 0)
    rimflow::addLostBody(surface, time, this->Diameter, why);
  else {
    vtkNew<vtkPolyData> points;
    join(bodies, points);
    join(surfaces, surface);
    rimflow::pointsToFieldData(points, surface);
  }
  for (vtkPolyData* output : {surface, centre, trajectory, wall})
    output->GetInformation()->Set(vtkDataObject::DATA_TIME_STEP(), time);
}

void vtkInvisibleSphereLocator::AddOtherDiameter(double diameter) {
  this->OtherDiameters.push_back(diameter);
  this->Modified();
}

void vtkInvisibleSphereLocator::ClearOtherDiameters() {
  if (this->OtherDiameters.empty()) return;
  this->OtherDiameters.clear();
  this->Modified();
}

void vtkInvisibleSphereLocator::PrintSelf(ostream& os, vtkIndent indent) {
  this->Superclass::PrintSelf(os, indent);
  os << indent << "Diameter: " << this->Diameter << "\n"
     << indent << "Method: " << (this->Method == PUBLISHED_COST ? "published cost" : "void likelihood")
     << "\n"
     << indent << "SearchRadius: " << this->SearchRadius << "\n"
     << indent << "DiameterSigma: " << this->DiameterSigma << "\n"
     << indent << "OtherDiameters: " << this->OtherDiameters.size() << "\n"
     << indent << "ProcessAllTimes: " << this->ProcessAllTimes << "\n"
     << indent << "JointTrajectory: " << this->JointTrajectory << "\n";
}
