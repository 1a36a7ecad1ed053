// Breaks when a filter goes on after it was told to stop, in any of its steps; when it then puts out half a
// result, or the next update does not give the whole one; and when a step has no name in the status bar.
#include "ImageOfFlow.h"
#include "vtkInvisibleSphereLocator.h"
#include "vtkOmni3DPressure.h"
#include "vtkQCriterion.h"
#include "vtkSTBTrackReader.h"
#include "vtkSurfaceForce.h"
#include "vtkSyntheticTracks.h"
#include "vtkTrajectorySmoother.h"
#include "vtkVICSharpResample.h"

#include "vtkCallbackCommand.h"
#include "vtkCommand.h"
#include "vtkDataSet.h"
#include "vtkNew.h"
#include "vtkTable.h"
#include "vtkTestErrorObserver.h"

#include <gtest/gtest.h>
#include <string>
#include <vector>

namespace {

using namespace rimflow_testing;
using Algorithm = vtkSmartPointer<vtkAlgorithm>;

/// Progress events; raises the abort flag at the first one of a step that is as far as `stopAt`.
struct Watch {
  struct Event {
    double progress;
    std::string step;
  };
  std::vector<Event> events;
  Event stopAt{2, ""};
  bool stopped = false;
  double stoppedAt = 1; ///< progress
  int after = 0;        ///< events since then

  void see(vtkAlgorithm* filter) {
    const char* text = filter->GetProgressText();
    events.push_back({filter->GetProgress(), text ? text : ""});
    after += stopped;
    if (stopped || events.back().step != stopAt.step || filter->GetProgress() < stopAt.progress) return;
    stopped = true;
    stoppedAt = filter->GetProgress();
    filter->SetAbortExecute(1);
  }
  static void callback(vtkObject* caller, unsigned long, void* watch, void*) {
    static_cast<Watch*>(watch)->see(vtkAlgorithm::SafeDownCast(caller));
  }
};

Watch update(vtkAlgorithm* filter, double time, const Watch::Event& stopAt = {2, ""}) {
  Watch watch;
  watch.stopAt = stopAt;
  vtkNew<vtkCallbackCommand> command;
  command->SetClientData(&watch);
  command->SetCallback(Watch::callback);
  const unsigned long observer = filter->AddObserver(vtkCommand::ProgressEvent, command);
  filter->UpdateTimeStep(time);
  filter->RemoveObserver(observer);
  return watch;
}

/// Points and rows of all outputs.
std::vector<vtkIdType> sizes(vtkAlgorithm* filter) {
  std::vector<vtkIdType> all;
  for (int port = 0; port < filter->GetNumberOfOutputPorts(); ++port) {
    vtkDataObject* data = filter->GetOutputDataObject(port);
    if (vtkTable* table = vtkTable::SafeDownCast(data))
      all.push_back(table->GetNumberOfRows());
    else
      all.push_back(vtkDataSet::SafeDownCast(data)->GetNumberOfPoints());
  }
  return all;
}

/// Stops a fresh filter in the middle of every step, and lets it go on.
void expectThatEveryStepStops(const std::function<Algorithm()>& make, double time,
                              const std::vector<std::string>& steps) {
  const Algorithm whole = make();
  const Watch reference = update(whole, time);
  for (const std::string& step : steps) {
    std::vector<Watch::Event> ofStep;
    for (const Watch::Event& e : reference.events)
      if (e.step == step) ofStep.push_back(e);
    ASSERT_FALSE(ofStep.empty()) << "no progress of: " << step;
    for (const std::size_t which : {std::size_t(0), ofStep.size() / 2}) {
      Watch::Event at = ofStep[which];
      if (at.progress >= 1) continue;  // the end of all
      if (which == 0) at.progress = 0; // a quick step may be done when it is first reported
      SCOPED_TRACE(step + " at " + std::to_string(at.progress));
      const Algorithm filter = make();
      vtkNew<vtkTest::ErrorObserver> errors;
      filter->AddObserver(vtkCommand::ErrorEvent, errors);
      const Watch watch = update(filter, time, at);
      // The first event of a step always comes; how many follow before the end depends on the machine.
      if (which > 0 && watch.stoppedAt >= 1) continue;
      ASSERT_TRUE(watch.stopped);
      EXPECT_LE(watch.after, 2); // what the pipeline says at the end
      EXPECT_EQ(sizes(filter), std::vector<vtkIdType>(std::size_t(filter->GetNumberOfOutputPorts()), 0));
      EXPECT_FALSE(errors->GetError());
      if (which == 0 && ofStep.size() > 1) continue; // once per step is enough
      filter->SetAbortExecute(0);
      update(filter, time);
      EXPECT_EQ(sizes(filter), sizes(whole));
    }
  }
}

vtkSmartPointer<vtkSyntheticTracks> tracks(int snapshots) {
  auto t = vtkSmartPointer<vtkSyntheticTracks>::New();
  t->SetDensity(6e7);
  t->SetNumberOfSnapshots(snapshots);
  t->SetPositionNoise(5e-6);
  return t;
}

rimflow::AnalyticFlow taylorGreen() {
  rimflow::AnalyticFlow flow;
  flow.kind = rimflow::FlowKind::TaylorGreen;
  flow.body.diameter = 0;
  return flow;
}

void layOut(vtkImageData* image) {
  image->SetDimensions(24, 22, 20);
  image->SetSpacing(1e-3, 1e-3, 1e-3);
  image->SetOrigin(-0.012, -0.011, -0.01);
}

vtkSmartPointer<vtkImageData> flowImage() {
  auto image = vtkSmartPointer<vtkImageData>::New();
  layOut(image);
  addFlow(image, taylorGreen(), 0);
  addArray(image, "Pressure", 1, [](const Eigen::Vector3d& x) { return Eigen::Vector3d(x[0], 0, 0); });
  addArray(image, "PressureGradient", 3, [](const Eigen::Vector3d&) { return Eigen::Vector3d(1, 0, 0); });
  return image;
}

vtkSmartPointer<vtkPolyData> body() {
  rimflow::Body b;
  b.diameter = 0.006;
  b.velocity = {0, 0.3, 0};
  return bodyData(b);
}

} // namespace

TEST(VtkAbort, TrackReader) {
  const auto reader = [](const std::function<void(vtkSTBTrackReader*)>& set) {
    return [set]() -> Algorithm {
      auto r = vtkSmartPointer<vtkSTBTrackReader>::New();
      r->SetFileName(RIMFLOW_TEST_DATA "/davis/onefile_8zones_utf8.dat");
      set(r);
      return r;
    };
  };
  expectThatEveryStepStops(
      reader([](vtkSTBTrackReader* r) { r->SetTrackStatistics(true); }), 44,
      {"Reading tracks: index", "Reading tracks: statistics", "Reading tracks", "Reading tracks: noise"});
  expectThatEveryStepStops(
      reader([](vtkSTBTrackReader* r) { r->SetOutputMode(vtkSTBTrackReader::PATHLINES); }), 44,
      {"Reading tracks: pathlines"});
}

TEST(VtkAbort, SyntheticTracks) {
  expectThatEveryStepStops([]() -> Algorithm { return tracks(5); }, 0.002, {"Synthetic tracks"});
}

TEST(VtkAbort, Resampling) {
  const auto source = tracks(3);
  const auto make = [&](bool warm) {
    return [&source, warm]() -> Algorithm {
      auto f = vtkSmartPointer<vtkVICSharpResample>::New();
      f->SetInputConnection(source->GetOutputPort());
      f->SetInputData(1, body());
      f->SetSpacing(3e-3);
      f->SetWarmStart(warm);
      return f;
    };
  };
  expectThatEveryStepStops(make(true), 0.001, {"VIC#: noise and smoothness", "VIC#: fit to the tracks"});
  expectThatEveryStepStops(make(false), 0.001, {"VIC#: fit to the tracks"});
}

TEST(VtkAbort, QCriterion) {
  const auto image = flowImage();
  expectThatEveryStepStops(
      [&]() -> Algorithm {
        auto f = vtkSmartPointer<vtkQCriterion>::New();
        f->SetInputData(image);
        return f;
      },
      0, {"Q-criterion"});
}

TEST(VtkAbort, Locator) {
  const auto source = tracks(5);
  const auto make = [&](bool everything) {
    return [&source, everything]() -> Algorithm {
      auto f = vtkSmartPointer<vtkInvisibleSphereLocator>::New();
      f->SetInputConnection(source->GetOutputPort());
      f->SetProcessAllTimes(everything);
      return f;
    };
  };
  expectThatEveryStepStops(make(false), 0.004, {"Locating the sphere"});
  expectThatEveryStepStops(make(true), 0.004,
                           {"Locating the sphere: time 1 of 5", "Locating the sphere: time 5 of 5",
                            "Joint estimate of all times"});
}

// The other way to be stopped: from the outside, between two events.
TEST(VtkAbort, LocatorGoesOnWhereItWasStopped) {
  const auto source = tracks(5);
  vtkNew<vtkInvisibleSphereLocator> locator;
  locator->SetInputConnection(source->GetOutputPort());
  locator->SetProcessAllTimes(true);
  update(locator, 0.004, {0, "Locating the sphere: time 3 of 5"});
  locator->SetAbortExecute(0);
  const Watch rest = update(locator, 0.004);
  for (const Watch::Event& e : rest.events) EXPECT_EQ(e.step.find("of 5"), std::string::npos) << e.step;
  EXPECT_EQ(vtkDataSet::SafeDownCast(locator->GetOutputDataObject(2))->GetNumberOfPoints(), 5);
}

TEST(VtkAbort, Smoother) {
  const auto source = tracks(5);
  vtkNew<vtkInvisibleSphereLocator> locator;
  locator->SetInputConnection(source->GetOutputPort());
  locator->SetJointTrajectory(false);
  std::vector<vtkSmartPointer<vtkPolyData>> walls;
  for (int k = 0; k < 5; ++k) {
    locator->UpdateTimeStep(0.001 * k);
    walls.push_back(vtkSmartPointer<vtkPolyData>::New());
    walls.back()->DeepCopy(locator->GetOutputDataObject(3));
  }
  expectThatEveryStepStops(
      [&]() -> Algorithm {
        auto f = vtkSmartPointer<vtkTrajectorySmoother>::New();
        f->SetInputData(0, locator->GetOutputDataObject(2));
        for (vtkPolyData* wall : walls) f->AddInputDataObject(1, wall);
        return f;
      },
      0, {"Smoothing the trajectory"});
}

TEST(VtkAbort, Pressure) {
  const auto image = flowImage();
  for (int method : {vtkOmni3DPressure::ONE_SHOT, vtkOmni3DPressure::PARALLEL_LINES})
    expectThatEveryStepStops(
        [&]() -> Algorithm {
          auto f = vtkSmartPointer<vtkOmni3DPressure>::New();
          f->SetInputData(image);
          f->SetMethod(method);
          return f;
        },
        0, {"Pressure: its gradient", "Pressure: integration", "Pressure: uncertainty"});
}

TEST(VtkAbort, PseudoTracking) {
  vtkNew<ImageSeries> source;
  source->times = {0, 0.001, 0.002};
  vtkNew<vtkImageData> box;
  layOut(box);
  box->GetExtent(source->extent);
  source->fill = [](vtkImageData* image, double time) {
    layOut(image);
    addFlow(image, taylorGreen(), time);
    image->GetPointData()->RemoveArray("MaterialAcceleration");
  };
  expectThatEveryStepStops(
      [&]() -> Algorithm {
        auto f = vtkSmartPointer<vtkOmni3DPressure>::New();
        f->SetInputConnection(source->GetOutputPort());
        return f;
      },
      0.001, {"Pressure: pseudo-tracking"});
}

TEST(VtkAbort, SurfaceForce) {
  const auto image = flowImage();
  expectThatEveryStepStops(
      [&]() -> Algorithm {
        auto f = vtkSmartPointer<vtkSurfaceForce>::New();
        f->SetInputData(0, image);
        f->SetInputData(1, body());
        return f;
      },
      0, {"Surface force"});
}
