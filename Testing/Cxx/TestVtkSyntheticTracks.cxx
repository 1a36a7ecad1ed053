// Breaks when vtkSyntheticTracks has wrong times, arrays or field data, keeps old particles after a setting
// has changed, or fails without an error and an empty output.
#include "vtkSyntheticTracks.h"

#include "vtkCellArray.h"
#include "vtkCommand.h"
#include "vtkDoubleArray.h"
#include "vtkExecutive.h"
#include "vtkFieldData.h"
#include "vtkFloatArray.h"
#include "vtkIdTypeArray.h"
#include "vtkInformation.h"
#include "vtkNew.h"
#include "vtkPointData.h"
#include "vtkPolyData.h"
#include "vtkStreamingDemandDrivenPipeline.h"
#include "vtkTestErrorObserver.h"

#include <cmath>
#include <gtest/gtest.h>
#include <set>

namespace {

double centreY(vtkSyntheticTracks* tracks) {
  return tracks->GetOutput()->GetFieldData()->GetArray("TrueCentre")->GetComponent(0, 1);
}
double dataTime(vtkSyntheticTracks* tracks) {
  return tracks->GetOutput()->GetInformation()->Get(vtkDataObject::DATA_TIME_STEP());
}

} // namespace

TEST(VtkSyntheticTracks, PublishesItsTimesAndSnapsToTheNearest) {
  vtkNew<vtkSyntheticTracks> tracks;
  tracks->SetStartTime(43);
  tracks->SetNumberOfSnapshots(5);
  tracks->SetFramePeriod(0.002);
  tracks->SetDensity(1e7);
  tracks->UpdateInformation();
  vtkInformation* information = tracks->GetOutputInformation(0);
  ASSERT_EQ(information->Length(vtkStreamingDemandDrivenPipeline::TIME_STEPS()), 5);
  EXPECT_DOUBLE_EQ(information->Get(vtkStreamingDemandDrivenPipeline::TIME_STEPS())[3], 43.006);
  EXPECT_DOUBLE_EQ(information->Get(vtkStreamingDemandDrivenPipeline::TIME_RANGE())[1], 43.008);
  const double asked[] = {43.0051, 40, 50, 43.004}, given[] = {43.006, 43, 43.008, 43.004};
  for (int i = 0; i < 4; ++i) {
    tracks->UpdateTimeStep(asked[i]);
    EXPECT_DOUBLE_EQ(dataTime(tracks), given[i]);
    EXPECT_NEAR(centreY(tracks), 0.35 * (given[i] - 43.004), 1e-12); // at the middle of the period: 0
  }
}

TEST(VtkSyntheticTracks, ParticlesAreVerticesWithTheDocumentedArrays) {
  vtkNew<vtkSyntheticTracks> tracks;
  tracks->Update();
  vtkPolyData* output = tracks->GetOutput();
  const vtkIdType n = output->GetNumberOfPoints();
  EXPECT_NEAR(n, 4e8 * (6e-5 - M_PI / 6 * std::pow(0.01111, 3)), 800);
  ASSERT_EQ(output->GetNumberOfVerts(), n);
  ASSERT_EQ(output->GetNumberOfCells(), n);
  vtkNew<vtkIdList> ids;
  output->GetCellPoints(n - 1, ids);
  EXPECT_EQ(ids->GetNumberOfIds(), 1);
  EXPECT_EQ(ids->GetId(0), n - 1);
  EXPECT_TRUE(vtkFloatArray::SafeDownCast(output->GetPoints()->GetData()));
  EXPECT_TRUE(vtkFloatArray::SafeDownCast(output->GetPointData()->GetArray("Velocity")));
  EXPECT_TRUE(vtkFloatArray::SafeDownCast(output->GetPointData()->GetArray("Acceleration")));
  auto* trackId = vtkIdTypeArray::SafeDownCast(output->GetPointData()->GetArray("TrackId"));
  ASSERT_TRUE(trackId);
  std::set<vtkIdType> different(trackId->GetPointer(0), trackId->GetPointer(0) + n);
  EXPECT_EQ(vtkIdType(different.size()), n);
  EXPECT_EQ(output->GetPointData()->GetNumberOfArrays(), 3); // no truth unless asked for
  double bounds[6];
  output->GetBounds(bounds);
  for (int b = 0; b < 6; ++b) EXPECT_NEAR(bounds[b], tracks->GetBounds()[b], 2e-4);
}

TEST(VtkSyntheticTracks, TruthAndNoise) {
  vtkNew<vtkSyntheticTracks> tracks;
  tracks->SetFlow(vtkSyntheticTracks::TAYLOR_GREEN);
  tracks->SetVelocityNoise(0.01);
  tracks->SetGhostFraction(0.1);
  tracks->AddTruthOn();
  tracks->Update();
  vtkPointData* data = tracks->GetOutput()->GetPointData();
  const vtkIdType n = tracks->GetOutput()->GetNumberOfPoints();
  const double k = 2 * M_PI / tracks->GetWavelength(), U = tracks->GetAmplitude(),
               nu = tracks->GetViscosity();
  const double F = std::exp(2 * nu * k * k * 0.0195); // the middle of the period lies 0.0195 s ahead
  double square = 0, ghosts = 0, count = 0;
  for (vtkIdType p = 0; p < n; ++p) {
    if (data->GetArray("TrueTracerId")->GetComponent(p, 0) < 0) {
      ++ghosts;
      continue;
    }
    double x[3];
    tracks->GetOutput()->GetPoint(p, x);
    const double u = U * F * std::sin(k * x[0]) * std::cos(k * x[1]);
    EXPECT_NEAR(data->GetArray("TrueVelocity")->GetComponent(p, 0), u, 1e-5 * U);
    const double pressure =
        0.25 * tracks->GetFluidDensity() * U * U * F * F * (std::cos(2 * k * x[0]) + std::cos(2 * k * x[1]));
    EXPECT_NEAR(data->GetArray("TruePressure")->GetComponent(p, 0), pressure, 1e-4);
    EXPECT_NEAR(data->GetArray("TrueAcceleration")->GetComponent(p, 2), 0, 1e-9);
    square += std::pow(data->GetArray("Velocity")->GetComponent(p, 0) - u, 2);
    ++count;
  }
  EXPECT_NEAR(std::sqrt(square / count), 0.01, 2e-4);
  EXPECT_NEAR(ghosts / n, 0.1, 0.01);
  EXPECT_FALSE(tracks->GetOutput()->GetFieldData()->HasArray("TrueCentre")); // there is no sphere
}

TEST(VtkSyntheticTracks, AChangedSettingCounts) {
  vtkNew<vtkSyntheticTracks> tracks;
  tracks->SetDensity(1e7);
  tracks->Update();
  double before[3], after[3];
  tracks->GetOutput()->GetPoint(10, before);
  tracks->SetSeed(2);
  tracks->Update();
  tracks->GetOutput()->GetPoint(10, after);
  EXPECT_NE(before[0], after[0]);
  tracks->SetSeed(1);
  tracks->Update();
  tracks->GetOutput()->GetPoint(10, after);
  EXPECT_EQ(before[0], after[0]);
}

TEST(VtkSyntheticTracks, BadSettingsGiveAnErrorAndNothingElse) {
  vtkNew<vtkTest::ErrorObserver> errors;
  vtkNew<vtkSyntheticTracks> tracks;
  tracks->AddObserver(vtkCommand::ErrorEvent, errors);
  tracks->GetExecutive()->AddObserver(vtkCommand::ErrorEvent, errors);
  const auto refused = [&](const char* what) {
    tracks->Update();
    EXPECT_EQ(errors->CheckErrorMessage(what), 0);
    EXPECT_EQ(tracks->GetOutput()->GetNumberOfPoints(), 0);
  };
  tracks->SetFlow(7);
  refused("Flow must be");
  tracks->SetFlow(0);
  tracks->SetNumberOfSnapshots(0);
  refused("number of snapshots must be at least 1");
  tracks->SetNumberOfSnapshots(2);
  tracks->SetFramePeriod(-1);
  refused("frame period must be > 0");
  tracks->SetFramePeriod(0.001);
  tracks->SetBounds(0, 0, 0, 1, 0, 1);
  refused("bounds");
  tracks->SetBounds(0, 0.01, 0, 0.01, 0, 0.01);
  tracks->Update(); // and it recovers
  EXPECT_GT(tracks->GetOutput()->GetNumberOfPoints(), 100);
}

TEST(VtkSyntheticTracks, AbortLeavesAnEmptyOutputAndTheNextUpdateRecovers) {
  vtkNew<vtkSyntheticTracks> tracks;
  struct Abort : vtkCommand {
    static Abort* New() { return new Abort; }
    void Execute(vtkObject* caller, unsigned long, void*) override {
      vtkAlgorithm::SafeDownCast(caller)->AbortExecuteOn();
    }
  };
  vtkNew<Abort> abort;
  const unsigned long observer = tracks->AddObserver(vtkCommand::ProgressEvent, abort);
  tracks->Update();
  EXPECT_EQ(tracks->GetOutput()->GetNumberOfPoints(), 0);
  tracks->RemoveObserver(observer);
  tracks->AbortExecuteOff();
  tracks->Modified();
  tracks->Update();
  EXPECT_GT(tracks->GetOutput()->GetNumberOfPoints(), 20000);
}
