// Breaks when going back to a time computes again, or shows what belongs to other settings, other tracks or
// another Body; when more is kept than CacheSize allows, or anything with CacheSize 0.
#include "ImageOfFlow.h"
#include "vtkInvisibleSphereLocator.h"
#include "vtkOmni3DPressure.h"
#include "vtkQCriterion.h"
#include "vtkSurfaceForce.h"
#include "vtkSyntheticTracks.h"
#include "vtkVICSharpResample.h"

#include "vtkCallbackCommand.h"
#include "vtkCommand.h"
#include "vtkDataArray.h"
#include "vtkFieldData.h"
#include "vtkFloatArray.h"
#include "vtkNew.h"
#include "vtkTable.h"

#include <cstring>
#include <gtest/gtest.h>
#include <vector>

namespace {

using namespace rimflow_testing;

/// Tracks -> VIC# -> Q -> pressure -> force around a sphere whose place is told.
struct Chain {
  vtkNew<vtkSyntheticTracks> tracks;
  vtkNew<vtkVICSharpResample> resample;
  vtkNew<vtkQCriterion> vortices;
  vtkNew<vtkOmni3DPressure> pressure;
  vtkNew<vtkSurfaceForce> force;
  vtkSmartPointer<vtkPolyData> body;

  Chain() {
    tracks->SetDensity(1e8);
    tracks->SetNumberOfSnapshots(5);
    resample->SetInputConnection(tracks->GetOutputPort());
    resample->SetSpacing(3e-3);
    resample->SetMaximumIterations(5);
    rimflow::Body sphere;
    sphere.diameter = 0.01111;
    sphere.velocity = {0, 0.35, 0};
    body = bodyData(sphere);
    resample->SetInputData(1, body);
    vortices->SetInputConnection(resample->GetOutputPort());
    pressure->SetInputConnection(vortices->GetOutputPort());
    pressure->SetInputData(1, body);
    force->SetInputConnection(pressure->GetOutputPort());
    force->SetInputData(1, body);
  }

  using Arrays = std::vector<vtkSmartPointer<vtkDataArray>>;
  /// What each of the four filters computes at a time.
  Arrays at(double time) {
    force->UpdateTimeStep(time);
    return {resample->GetOutput()->GetPointData()->GetArray("Velocity"),
            vortices->GetOutput()->GetPointData()->GetArray("QCriterion"),
            pressure->GetOutput()->GetPointData()->GetArray("Pressure"),
            vtkDataArray::SafeDownCast(
                vtkTable::SafeDownCast(force->GetOutputDataObject(1))->GetColumnByName("drag_N"))};
  }
  void moveBody(double x) {
    vtkDataArray* centre = body->GetFieldData()->GetArray("Centre");
    centre->SetComponent(0, 0, x);
    centre->Modified();
    body->Modified();
  }
};

bool same(const Chain::Arrays& a, const Chain::Arrays& b) {
  for (std::size_t i = 0; i < a.size(); ++i) {
    if (a[i]->GetNumberOfValues() != b[i]->GetNumberOfValues()) return false;
    const auto bytes = std::size_t(a[i]->GetNumberOfValues() * a[i]->GetDataTypeSize());
    if (std::memcmp(a[i]->GetVoidPointer(0), b[i]->GetVoidPointer(0), bytes) != 0) return false;
  }
  return true;
}

/// How many of them are the very same objects: nothing was computed.
int kept(const Chain::Arrays& a, const Chain::Arrays& b) {
  int count = 0;
  for (std::size_t i = 0; i < a.size(); ++i) count += a[i] == b[i];
  return count;
}

} // namespace

TEST(VtkResultCache, GoingBackComputesNothing) {
  Chain chain;
  const auto first = chain.at(0.001), second = chain.at(0.002);
  EXPECT_EQ(kept(first, second), 0);
  EXPECT_EQ(kept(chain.at(0.001), first), 4);
  EXPECT_EQ(kept(chain.at(0.002), second), 4);
  EXPECT_EQ(chain.force->GetOutputDataObject(1)->GetInformation()->Get(vtkDataObject::DATA_TIME_STEP()),
            0.002);
  EXPECT_EQ(vtkTable::SafeDownCast(chain.force->GetOutputDataObject(1))->GetNumberOfRows(), 1);
  EXPECT_GT(chain.force->GetOutput()->GetNumberOfPolys(), 100);
}

TEST(VtkResultCache, AnotherSettingComputesAgain) {
  Chain chain;
  const auto before = chain.at(0.001);
  chain.pressure->SetDensity(1000);
  chain.force->SetDensity(1000);
  const auto after = chain.at(0.001);
  EXPECT_EQ(kept(before, after), 2); // resampling and vortices do not know the density
  EXPECT_FALSE(same({before[2]}, {after[2]}));
  chain.resample->SetViscosity(1e-5);
  const auto thick = chain.at(0.001);
  EXPECT_EQ(kept(after, thick), 0);
}

TEST(VtkResultCache, OtherTracksComputeAgain) {
  Chain chain, other;
  const auto before = chain.at(0.001);
  for (Chain* c : {&chain, &other}) c->tracks->SetSeed(8);
  const auto after = chain.at(0.001);
  EXPECT_EQ(kept(before, after), 0);
  EXPECT_TRUE(same(after, other.at(0.001)));
}

TEST(VtkResultCache, AnotherPlaceOfTheBodyComputesAgain) {
  Chain chain, other;
  const auto before = chain.at(0.001);
  for (Chain* c : {&chain, &other}) c->moveBody(0.002);
  const auto moved = chain.at(0.001);
  EXPECT_EQ(kept(before, moved), 0);
  EXPECT_TRUE(same(moved, other.at(0.001)));
}

TEST(VtkResultCache, NothingIsKeptWithoutMemory) {
  Chain chain;
  chain.resample->SetCacheSize(0);
  chain.vortices->SetCacheSize(0);
  chain.pressure->SetCacheSize(0);
  chain.force->SetCacheSize(0);
  const auto first = chain.at(0.001);
  chain.at(0.002);
  const auto again = chain.at(0.001);
  EXPECT_EQ(kept(first, again), 0);
  EXPECT_TRUE(same(first, again));
}

TEST(VtkResultCache, LessMemoryForgetsWhatIsOldest) {
  Chain chain;
  const auto first = chain.at(0), second = chain.at(0.001), third = chain.at(0.002);
  const vtkMTimeType before = chain.resample->GetMTime();
  chain.resample->SetCacheSize(1);
  EXPECT_EQ(chain.resample->GetMTime(), before); // nothing is computed for that
  EXPECT_EQ(kept(chain.at(0.002), third), 4);
  EXPECT_EQ(kept({chain.at(0)[0]}, {first[0]}), 0);
}

TEST(VtkResultCache, AnAbortedResultIsNotKept) {
  Chain chain, other;
  vtkNew<vtkCallbackCommand> stop;
  stop->SetCallback([](vtkObject* caller, unsigned long, void*, void*) {
    vtkAlgorithm::SafeDownCast(caller)->SetAbortExecute(1);
  });
  const unsigned long observer = chain.resample->AddObserver(vtkCommand::ProgressEvent, stop);
  chain.resample->UpdateTimeStep(0.001);
  EXPECT_EQ(chain.resample->GetOutput()->GetNumberOfPoints(), 0);
  chain.resample->RemoveObserver(observer);
  chain.resample->SetAbortExecute(0);
  EXPECT_TRUE(same(chain.at(0.001), other.at(0.001)));
}

// The locator's velocity at a time changes with the times that it has seen: the flow then is computed again,
// and goes with the Body that is shown.
TEST(VtkResultCache, TheFlowGoesWithTheBodyOnShow) {
  Chain chain;
  vtkNew<vtkInvisibleSphereLocator> locator;
  locator->SetInputConnection(chain.tracks->GetOutputPort());
  chain.resample->SetInputConnection(1, locator->GetOutputPort());
  const auto expectTheBodysVelocity = [&] {
    vtkDataArray* mask = chain.resample->GetOutput()->GetPointData()->GetArray("Mask");
    vtkDataArray* flow = chain.resample->GetOutput()->GetPointData()->GetArray("Velocity");
    vtkDataArray* velocity = locator->GetOutputDataObject(0)->GetFieldData()->GetArray("Velocity");
    vtkIdType inside = 0;
    while (inside < mask->GetNumberOfTuples() && mask->GetTuple1(inside) == 0) ++inside;
    ASSERT_LT(inside, mask->GetNumberOfTuples());
    for (int a = 0; a < 3; ++a)
      EXPECT_EQ(float(flow->GetComponent(inside, a)), float(velocity->GetComponent(0, a)));
  };
  for (double time : {0.001, 0.003, 0.001, 0.004, 0., 0.002, 0.001}) {
    chain.resample->UpdateTimeStep(time);
    expectTheBodysVelocity();
  }
  // all times are known now, so that the velocities stay
  const auto velocityAt = [&](double time) {
    chain.resample->UpdateTimeStep(time);
    return vtkSmartPointer<vtkDataArray>(chain.resample->GetOutput()->GetPointData()->GetArray("Velocity"));
  };
  const auto first = velocityAt(0.002);
  velocityAt(0.003);
  EXPECT_EQ(velocityAt(0.002), first);
}
