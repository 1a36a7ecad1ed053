// How long every filter takes to answer an abort, and how long it is silent: times from the abort flag,
// raised at random moments by another thread and by a progress observer, to the return of Update; and the
// longest time without a progress event. Realistic sizes: 100,000 particles, 40 to 200 snapshots, grids up to
// 128^3. BenchAbort [trials [name...]]: trials per kind (default 5), only the cases whose names contain a
// given word.
#include "vtkInvisibleSphereLocator.h"
#include "vtkOmni3DPressure.h"
#include "vtkQCriterion.h"
#include "vtkSTBTrackReader.h"
#include "vtkSphereTrajectoryReader.h"
#include "vtkSurfaceForce.h"
#include "vtkSyntheticTracks.h"
#include "vtkTrajectorySmoother.h"
#include "vtkVICSharpResample.h"

#include "vtkCallbackCommand.h"
#include "vtkCommand.h"
#include "vtkDataArray.h"
#include "vtkDoubleArray.h"
#include "vtkFieldData.h"
#include "vtkFloatArray.h"
#include "vtkIdTypeArray.h"
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

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <functional>
#include <map>
#include <random>
#include <string>
#include <thread>
#include <vector>

namespace {

using Pipeline = vtkStreamingDemandDrivenPipeline;
using Algorithm = vtkSmartPointer<vtkAlgorithm>;

double now() {
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

/// What is measured: `make` gives a fresh filter whose inputs are up to date, `time` is what is asked of it.
struct Case {
  std::string name;
  std::function<Algorithm()> make;
  double time;
};

/// Watches the progress of one run, and raises the flag in the first event after `abortAt`, s from the start.
struct Watch {
  double start = now(), last = start, longest = 0, abortAt = 1e300, raised = 0;
  std::map<std::string, double> silences; ///< the longest, s, per text that it followed
  std::string text = "(start)";
  int events = 0;

  void event(vtkAlgorithm* filter) {
    tick(filter);
    if (raised == 0 && last - start >= abortAt) raised = last, filter->AbortExecute = 1;
  }
  void tick(vtkAlgorithm* filter) {
    const double t = now();
    silences[text] = std::max(silences[text], t - last);
    longest = std::max(longest, t - last);
    last = t;
    ++events;
    text = filter->GetProgressText() ? filter->GetProgressText() : "(no text)";
  }
};

void update(vtkAlgorithm* filter, double time) {
  if (filter->GetNumberOfInputPorts() > 0 || !std::isnan(time)) filter->UpdateTimeStep(time);
}

struct Run {
  double duration, latency;
  Watch watch;
};

/// Aborts `after` s by progress event, or by thread; never when `after` is infinite.
Run run(const Case& c, double after, bool byThread) {
  Algorithm filter = c.make();
  Run r;
  r.watch = Watch();
  if (!byThread) r.watch.abortAt = after;
  vtkNew<vtkCallbackCommand> command;
  command->SetClientData(&r.watch);
  command->SetCallback([](vtkObject* caller, unsigned long, void* data, void*) {
    static_cast<Watch*>(data)->event(vtkAlgorithm::SafeDownCast(caller));
  });
  filter->AddObserver(vtkCommand::ProgressEvent, command);
  std::atomic<double> raised{0};
  std::atomic<bool> over{false};
  std::thread timer;
  const double start = now();
  if (byThread)
    timer = std::thread([&] {
      while (!over && now() - start < after) std::this_thread::sleep_for(std::chrono::microseconds(500));
      if (!over) raised = now(), filter->AbortExecute = 1;
    });
  update(filter, c.time);
  const double end = now();
  over = true;
  if (timer.joinable()) timer.join();
  r.watch.tick(filter);
  const double flag = byThread ? raised.load() : r.watch.raised;
  r.duration = end - start;
  r.latency = flag > 0 && flag < end ? end - flag : 0;
  filter->RemoveAllObservers();
  return r;
}

void measure(const Case& c, int trials) {
  static std::mt19937 random(1);
  const Run whole = run(c, 1e300, false);
  std::vector<double> latencies[2];
  for (int kind = 0; kind < 2; ++kind)
    for (int t = 0; t < trials; ++t) {
      const double after = std::uniform_real_distribution<>(0, whole.duration)(random);
      latencies[kind].push_back(run(c, after, kind == 0).latency);
    }
  for (auto& l : latencies) std::sort(l.begin(), l.end());
  const auto text = std::max_element(whole.watch.silences.begin(), whole.watch.silences.end(),
                                     [](const auto& a, const auto& b) { return a.second < b.second; });
  std::printf("| %-34s | %7.2f | %6.3f | %6.3f | %6.3f | %6.3f | %6.3f | %5d | %s\n", c.name.c_str(),
              whole.duration, latencies[0][trials / 2], latencies[0].back(), latencies[1][trials / 2],
              latencies[1].back(), whole.watch.longest, whole.watch.events, text->first.c_str());
  std::fflush(stdout);
}

/// 100,000 particles around a moving sphere.
vtkSmartPointer<vtkSyntheticTracks> tracks(int snapshots, double density = 1.7e9) {
  auto t = vtkSmartPointer<vtkSyntheticTracks>::New();
  t->SetDensity(density);
  t->SetNumberOfSnapshots(snapshots);
  t->SetPositionNoise(5e-6);
  t->SetVelocityNoise(2e-3);
  t->SetAccelerationNoise(1);
  t->SetGhostFraction(0.005);
  return t;
}

vtkSmartPointer<vtkImageData> flowImage(int nx, int ny, int nz, double time = 0) {
  auto image = vtkSmartPointer<vtkImageData>::New();
  image->SetDimensions(nx, ny, nz);
  image->SetSpacing(0.5e-3, 0.5e-3, 0.5e-3);
  const char* names[] = {"Velocity", "MaterialAcceleration", "Pressure", "PressureGradient"};
  const int components[] = {3, 3, 1, 3};
  for (int a = 0; a < 4; ++a) {
    vtkNew<vtkFloatArray> array;
    array->SetName(names[a]);
    array->SetNumberOfComponents(components[a]);
    array->SetNumberOfTuples(image->GetNumberOfPoints());
    for (vtkIdType p = 0; p < image->GetNumberOfPoints(); ++p) {
      double x[3];
      image->GetPoint(p, x);
      for (int i = 0; i < components[a]; ++i)
        array->SetComponent(p, i, std::sin(200 * x[(i + 1) % 3] + 50 * x[i] + a + 10 * time));
    }
    image->GetPointData()->AddArray(array);
  }
  image->GetInformation()->Set(vtkDataObject::DATA_TIME_STEP(), time);
  return image;
}

/// Three snapshots of a flow without acceleration, each made already.
struct FlowSeries : vtkImageAlgorithm {
  static FlowSeries* New();
  vtkTypeMacro(FlowSeries, vtkImageAlgorithm);
  std::map<double, vtkSmartPointer<vtkImageData>> images;

protected:
  FlowSeries() {
    this->SetNumberOfInputPorts(0);
    for (double t : {0., 0.001, 0.002}) {
      images[t] = flowImage(128, 128, 128, t);
      images[t]->GetPointData()->RemoveArray("MaterialAcceleration");
    }
  }
  int RequestInformation(vtkInformation*, vtkInformationVector**, vtkInformationVector* outputs) override {
    vtkInformation* out = outputs->GetInformationObject(0);
    const double times[] = {0, 0.001, 0.002}, range[] = {0, 0.002};
    int extent[6];
    images[0]->GetExtent(extent);
    out->Set(Pipeline::TIME_STEPS(), times, 3);
    out->Set(Pipeline::TIME_RANGE(), range, 2);
    out->Set(Pipeline::WHOLE_EXTENT(), extent, 6);
    return 1;
  }
  int RequestData(vtkInformation*, vtkInformationVector**, vtkInformationVector* outputs) override {
    vtkInformation* out = outputs->GetInformationObject(0);
    const double asked = out->Has(Pipeline::UPDATE_TIME_STEP()) ? out->Get(Pipeline::UPDATE_TIME_STEP()) : 0;
    vtkImageData* image = vtkImageData::GetData(outputs);
    image->ShallowCopy(images.lower_bound(asked - 1e-9)->second);
    image->GetInformation()->Set(vtkDataObject::DATA_TIME_STEP(), asked);
    return 1;
  }
};
vtkStandardNewMacro(FlowSeries);

vtkSmartPointer<vtkPolyData> bodies(int count) {
  auto data = vtkSmartPointer<vtkPolyData>::New();
  const auto add = [&](const char* name, int components, const std::function<double(int, int)>& value) {
    vtkNew<vtkDoubleArray> array;
    array->SetName(name);
    array->SetNumberOfComponents(components);
    array->SetNumberOfTuples(count);
    for (int b = 0; b < count; ++b)
      for (int i = 0; i < components; ++i) array->SetComponent(b, i, value(b, i));
    data->GetFieldData()->AddArray(array);
  };
  add("Diameter", 1, [](int, int) { return 0.01111; });
  add("Centre", 3, [](int b, int i) { return 0.025 + 0.003 * b * (i == 0); });
  add("Velocity", 3, [](int, int i) { return i == 1 ? 0.35 : 0; });
  add("Acceleration", 3, [](int, int) { return 0.1; });
  add("Covariance", 6, [](int, int i) { return i < 3 ? 1e-9 : 0; });
  return data;
}

/// A Tecplot file with 20 snapshots of 100,000 particles, 190 MB, removed at the end.
struct TrackFile {
  std::filesystem::path path = std::filesystem::temp_directory_path() / "rimflow_bench_abort.dat";
  TrackFile() {
    std::FILE* file = std::fopen(path.c_str(), "w");
    std::fputs("TITLE = \"tracks\"\nVARIABLES = \"x [mm]\" \"y [mm]\" \"z [mm]\" \"u [m/s]\" \"v [m/s]\" "
               "\"w [m/s]\" \"ax [m/s^2]\" \"ay [m/s^2]\" \"az [m/s^2]\" \"trackID\"\n",
               file);
    std::mt19937 random(1);
    std::uniform_real_distribution<> in(-20, 20);
    std::vector<double> start(300000);
    for (double& x : start) x = in(random);
    for (int k = 0; k < 20; ++k) {
      std::fprintf(file, "ZONE T=\"Snapshot %d\" STRANDID=1 SOLUTIONTIME=%g\n", k, 0.001 * k);
      for (int p = 0; p < 100000; ++p)
        std::fprintf(file, "%.5f %.5f %.5f %.5f %.5f %.5f %.3f %.3f %.3f %d\n", start[3 * p] + 0.1 * k,
                     start[3 * p + 1] + 1e-5 * in(random), start[3 * p + 2], 0.1, 0.0, 0.0, in(random), 0.0,
                     0.0, p);
    }
    std::fclose(file);
  }
  ~TrackFile() { std::filesystem::remove(path); }
};

/// The path of a sphere as text, 20,000 rows.
struct PathFile {
  std::filesystem::path path = std::filesystem::temp_directory_path() / "rimflow_bench_abort_path.dat";
  PathFile() {
    std::FILE* file = std::fopen(path.c_str(), "w");
    std::fputs("VARIABLES = \"Time [s]\" \"x [m]\" \"y [m]\" \"z [m]\"\n", file);
    for (int k = 0; k < 20000; ++k)
      std::fprintf(file, "%.6f %.7f %.7f %.7f\n", 1e-4 * k, 1e-4 * k, 1e-3 * std::sin(0.1 * k),
                   1e-6 * (k % 7));
    std::fclose(file);
  }
  ~PathFile() { std::filesystem::remove(path); }
};

std::vector<Case> cases() {
  std::vector<Case> all;
  static TrackFile file;
  const auto reader = [](std::function<void(vtkSTBTrackReader*)> set, bool open) {
    return [=]() -> Algorithm {
      auto r = vtkSmartPointer<vtkSTBTrackReader>::New();
      r->SetFileName(file.path.c_str());
      r->SetCacheSize(0);
      set(r);
      if (open) r->UpdateInformation();
      return r;
    };
  };
  all.push_back({"reader: open and show", reader([](auto*) {}, false), 0.01});
  all.push_back({"reader: show", reader([](auto*) {}, true), 0.01});
  all.push_back({"reader: pathlines",
                 reader([](auto* r) { r->SetOutputMode(vtkSTBTrackReader::PATHLINES); }, true), 0.01});
  all.push_back({"reader: all pathlines",
                 reader(
                     [](auto* r) {
                       r->SetOutputMode(vtkSTBTrackReader::PATHLINES);
                       r->SetTrailLength(0);
                     },
                     true),
                 0.01});
  all.push_back(
      {"reader: track statistics", reader([](auto* r) { r->SetTrackStatistics(true); }, true), 0.01});
  all.push_back({"reader: velocities from positions",
                 reader([](auto* r) { r->SetEstimateVelocities(2); }, true), 0.01});
  static PathFile pathFile;
  all.push_back({"sphere trajectory: open",
                 []() -> Algorithm {
                   auto r = vtkSmartPointer<vtkSphereTrajectoryReader>::New();
                   r->SetFileName(pathFile.path.c_str());
                   r->SetDiameter(0.01);
                   return r;
                 },
                 0.01});
  all.push_back({"synthetic tracks", []() -> Algorithm { return tracks(40); }, 0.01});

  static auto series = tracks(40), thin = tracks(120, 4e8);
  const double middle = 0.02;
  const auto vic = [=](bool warm, double spacing) {
    return [=]() -> Algorithm {
      auto f = vtkSmartPointer<vtkVICSharpResample>::New();
      f->SetInputConnection(series->GetOutputPort());
      f->SetWarmStart(warm);
      f->SetSpacing(spacing);
      return f;
    };
  };
  all.push_back({"VIC#, default spacing", vic(true, 0), middle});
  all.push_back({"VIC#, 0.45 mm", vic(true, 0.45e-3), middle});
  all.push_back({"VIC#, each its own noise", vic(false, 0), middle});

  static auto cube = flowImage(128, 128, 128), paper = flowImage(160, 109, 36);
  all.push_back({"Q-criterion, 128^3",
                 []() -> Algorithm {
                   auto f = vtkSmartPointer<vtkQCriterion>::New();
                   f->SetInputData(cube);
                   f->SetComputeLambda2(true);
                   return f;
                 },
                 0});
  const auto pressure = [](vtkImageData* image, int method, std::function<void(vtkOmni3DPressure*)> set) {
    return [=]() -> Algorithm {
      auto f = vtkSmartPointer<vtkOmni3DPressure>::New();
      f->SetInputData(image);
      f->SetMethod(method);
      f->SetInputData(1, bodies(1));
      set(f);
      return f;
    };
  };
  const auto nothing = [](auto*) {};
  all.push_back({"pressure: one-shot, 128^3", pressure(cube, vtkOmni3DPressure::ONE_SHOT, nothing), 0});
  all.push_back({"pressure: one-shot, 160x109x36", pressure(paper, vtkOmni3DPressure::ONE_SHOT, nothing), 0});
  all.push_back(
      {"pressure: nodes left out, 128^3",
       pressure(cube, vtkOmni3DPressure::ONE_SHOT, [](auto* f) { f->SetLargestGradientError(1e3); }), 0});
  all.push_back(
      {"pressure: lines, 160x109x36", pressure(paper, vtkOmni3DPressure::PARALLEL_LINES, nothing), 0});
  all.push_back({"pressure: lines, 128^3", pressure(cube, vtkOmni3DPressure::PARALLEL_LINES, nothing), 0});
  static vtkNew<FlowSeries> flowSeries;
  all.push_back({"pressure: pseudo-tracking, 128^3",
                 []() -> Algorithm {
                   auto f = vtkSmartPointer<vtkOmni3DPressure>::New();
                   f->SetInputConnection(flowSeries->GetOutputPort());
                   return f;
                 },
                 0.001});
  const auto force = [](int resolution, int count) {
    return [=]() -> Algorithm {
      auto f = vtkSmartPointer<vtkSurfaceForce>::New();
      f->SetInputData(0, cube);
      f->SetInputData(1, bodies(count));
      f->SetSurfaceResolution(resolution);
      return f;
    };
  };
  all.push_back({"force: 128^3", force(16, 1), 0});
  all.push_back({"force: 128^3, finest surface", force(128, 1), 0});
  all.push_back({"force: 128^3, three bodies", force(32, 3), 0});

  const auto locator = [=](vtkAlgorithm* input, bool everything,
                           std::function<void(vtkInvisibleSphereLocator*)> set) {
    return [=]() -> Algorithm {
      auto f = vtkSmartPointer<vtkInvisibleSphereLocator>::New();
      f->SetInputConnection(input->GetOutputPort());
      f->SetDiameter(0.01111);
      f->SetProcessAllTimes(everything);
      set(f);
      input->UpdateTimeStep(middle);
      return f;
    };
  };
  all.push_back({"locator: first snapshot", locator(series, false, nothing), middle});
  all.push_back(
      {"locator: two spheres", locator(series, false, [](auto* f) { f->AddOtherDiameter(0.006); }), middle});
  all.push_back({"locator: 40 times, 100,000", locator(series, true, nothing), middle});
  all.push_back({"locator: 120 times, 24,000", locator(thin, true, nothing), middle});
  static vtkNew<vtkVICSharpResample> resample;
  static vtkNew<vtkQCriterion> vortices;
  resample->SetInputConnection(series->GetOutputPort());
  vortices->SetInputConnection(resample->GetOutputPort());
  all.push_back({"locator: published cost",
                 [=]() -> Algorithm {
                   auto f = vtkSmartPointer<vtkInvisibleSphereLocator>::New();
                   vortices->UpdateTimeStep(middle);
                   f->SetInputConnection(0, series->GetOutputPort());
                   f->SetInputConnection(1, vortices->GetOutputPort());
                   f->SetDiameter(0.01111);
                   f->SetMethod(vtkInvisibleSphereLocator::PUBLISHED_COST);
                   return f;
                 },
                 middle});
  static vtkNew<vtkInvisibleSphereLocator> seen;
  static std::vector<vtkSmartPointer<vtkPolyData>> walls;
  static vtkNew<vtkPolyData> centres;
  all.push_back({"smoother: 120 snapshots with walls",
                 []() -> Algorithm {
                   if (walls.empty()) {
                     seen->SetInputConnection(thin->GetOutputPort());
                     seen->SetDiameter(0.01111);
                     seen->SetJointTrajectory(false);
                     for (int k = 0; k < 120; ++k) {
                       seen->UpdateTimeStep(0.001 * k);
                       walls.push_back(vtkSmartPointer<vtkPolyData>::New());
                       walls.back()->DeepCopy(seen->GetOutputDataObject(3));
                     }
                     centres->DeepCopy(seen->GetOutputDataObject(2));
                   }
                   auto f = vtkSmartPointer<vtkTrajectorySmoother>::New();
                   f->SetInputData(0, centres);
                   for (vtkPolyData* wall : walls) f->AddInputDataObject(1, wall);
                   return f;
                 },
                 0});
  return all;
}

} // namespace

int main(int argc, char** argv) {
  const int trials = argc > 1 ? std::atoi(argv[1]) : 5;
  std::puts(
      "| case                               | whole s | thread: median, worst | progress: median, worst | "
      "silence | events | longest silence after");
  for (const Case& c : cases()) {
    bool wanted = argc < 3;
    for (int a = 2; a < argc; ++a) wanted = wanted || c.name.find(argv[a]) != std::string::npos;
    if (wanted) measure(c, trials);
  }
}
