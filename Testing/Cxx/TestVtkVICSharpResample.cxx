// Breaks when vtkVICSharpResample lays its grid out or calibrates anew for every snapshot, drifts along a
// series, misses the noise that the particles bring along, or fails without an error and an empty output.
#include "vtkSyntheticTracks.h"
#include "vtkVICSharpResample.h"

#include "vtkCommand.h"
#include "vtkDoubleArray.h"
#include "vtkExecutive.h"
#include "vtkFieldData.h"
#include "vtkFloatArray.h"
#include "vtkImageData.h"
#include "vtkNew.h"
#include "vtkPointData.h"
#include "vtkPolyData.h"
#include "vtkTestErrorObserver.h"

#include <cmath>
#include <gtest/gtest.h>
#include <vector>

namespace {

constexpr int ABC = 4;
constexpr double VelocityNoise = 0.003, AccelerationNoise = 0.3, Period = 0.001;

struct Pipeline {
  vtkNew<vtkSyntheticTracks> tracks;
  vtkNew<vtkVICSharpResample> resample;
  Pipeline() {
    tracks->SetFlow(ABC);
    tracks->SetWavelength(0.02);
    tracks->SetDensity(1.5e8);
    tracks->SetBounds(0, 0.02, 0, 0.02, 0, 0.016);
    tracks->SetNumberOfSnapshots(5);
    tracks->SetFramePeriod(Period);
    tracks->SetStartTime(0);
    tracks->SetVelocityNoise(VelocityNoise);
    tracks->SetAccelerationNoise(AccelerationNoise);
    resample->SetInputConnection(0, tracks->GetOutputPort());
  }
  std::vector<float> velocity(int step) {
    resample->UpdateTimeStep(step * Period);
    auto* array = vtkFloatArray::SafeDownCast(resample->GetOutput()->GetPointData()->GetArray("Velocity"));
    return {array->GetPointer(0), array->GetPointer(0) + array->GetNumberOfValues()};
  }
  double number(const char* name) {
    vtkDataArray* array = resample->GetOutput()->GetFieldData()->GetArray(name);
    return array ? array->GetComponent(0, 0) : -1;
  }
};

double rmsDifference(const std::vector<float>& a, const std::vector<float>& b) {
  double sum = 0;
  for (std::size_t e = 0; e < a.size(); ++e) sum += std::pow(double(a[e]) - double(b[e]), 2);
  return std::sqrt(sum / double(a.size()));
}

} // namespace

TEST(VtkVICSharpResample, SaysHowWellItFits) {
  Pipeline p;
  p.velocity(2);
  vtkImageData* image = p.resample->GetOutput();
  for (const char* name : {"Velocity", "Vorticity", "MaterialAcceleration"}) {
    ASSERT_TRUE(image->GetPointData()->GetArray(name)) << name;
    EXPECT_EQ(image->GetPointData()->GetArray(name)->GetNumberOfComponents(), 3);
  }
  ASSERT_TRUE(image->GetPointData()->GetArray("PressureOverDensity"));
  EXPECT_NEAR(p.number("VelocityNoise"), VelocityNoise, 0.3 * VelocityNoise);
  EXPECT_NEAR(p.number("AccelerationNoise"), AccelerationNoise, 0.3 * AccelerationNoise);
  EXPECT_GT(p.number("MisfitVelocity"), 0.6);
  EXPECT_LT(p.number("MisfitVelocity"), 1.2);
  EXPECT_LT(p.number("DivergenceNorm"), 1e-4);
  EXPECT_GT(p.number("Iterations"), 0);
}

TEST(VtkVICSharpResample, ASnapshotDoesNotDependOnThoseBefore) {
  Pipeline series, alone, cold;
  std::vector<float> last;
  for (int step : {0, 3, 4}) last = series.velocity(step);
  EXPECT_EQ(rmsDifference(last, alone.velocity(4)), 0);
  EXPECT_EQ(alone.number("CurvatureWeight"), series.number("CurvatureWeight"));
  cold.resample->SetWarmStart(false);
  EXPECT_LT(rmsDifference(cold.velocity(4), last), 0.5 * VelocityNoise);
  EXPECT_NE(cold.number("CurvatureWeight"), alone.number("CurvatureWeight")); // its own
}

TEST(VtkVICSharpResample, WarnsOfAFlowThatMissesTheParticles) {
  Pipeline p;
  vtkNew<vtkTest::ErrorObserver> warnings;
  p.resample->AddObserver(vtkCommand::WarningEvent, warnings);
  p.velocity(2);
  EXPECT_GT(p.number("ExplainedVariance"), 0.98);
  EXPECT_FALSE(warnings->GetWarning());
  EXPECT_FALSE(p.resample->GetOutput()->GetFieldData()->HasArray("Note"));
  p.tracks->SetWavelength(0.006);
  p.tracks->SetDensity(1.5e9);
  p.tracks->SetBounds(0, 0.02, 0, 0.02, 0, 0.02);
  p.resample->SetSpacing(4e-3);
  p.velocity(2);
  EXPECT_LT(p.number("ExplainedVariance"), 0.7);
  EXPECT_TRUE(p.resample->GetOutput()->GetFieldData()->HasArray("Note"));
  ASSERT_TRUE(warnings->GetWarning());
  EXPECT_NE(warnings->GetWarningMessage().find("of the variance of the particles' velocities"),
            std::string::npos);
  warnings->Clear();
  p.velocity(3);
  EXPECT_TRUE(p.resample->GetOutput()->GetFieldData()->HasArray("Note"));
  EXPECT_FALSE(warnings->GetWarning()); // once is enough
}

TEST(VtkVICSharpResample, DoesNotWarnOfNoise) {
  vtkNew<vtkTest::ErrorObserver> warnings;
  Pipeline seen, given;
  for (Pipeline* p : {&seen, &given}) {
    p->resample->AddObserver(vtkCommand::WarningEvent, warnings);
    p->tracks->SetVelocityNoise(1);
  }
  given.resample->SetVelocityNoise(1);
  seen.velocity(2), given.velocity(2);
  EXPECT_LT(seen.number("ExplainedVariance"), 0.5);
  EXPECT_LT(given.number("ExplainedVariance"), 0.5);
  EXPECT_FALSE(warnings->GetWarning()) << warnings->GetWarningMessage();
}

TEST(VtkVICSharpResample, LeavesTheAccelerationsOutOnRequest) {
  Pipeline p;
  p.resample->SetUseAcceleration(false);
  p.velocity(2);
  EXPECT_EQ(p.number("AccelerationNoise"), 0);
  EXPECT_EQ(p.number("MisfitAcceleration"), 0);
  EXPECT_TRUE(p.resample->GetOutput()->GetPointData()->GetArray("MaterialAcceleration"));
}

// Too little of it (clean tracks, or noise that the reader does not see) must not make it fit what the grid
// cannot resolve.
TEST(VtkVICSharpResample, TheNoiseThatTheParticlesBringIsTheLeast) {
  Pipeline p;
  p.tracks->UpdateTimeStep(0);
  const auto withNoise = [&](double velocity, double acceleration) {
    vtkNew<vtkPolyData> particles;
    particles->ShallowCopy(p.tracks->GetOutput());
    for (const auto& [name, value] :
         {std::pair("VelocityNoise", velocity), std::pair("AccelerationNoise", acceleration)}) {
      vtkNew<vtkDoubleArray> array;
      array->SetName(name);
      array->InsertNextValue(value);
      particles->GetFieldData()->AddArray(array);
    }
    p.resample->SetInputDataObject(0, particles);
    p.resample->Update();
    return std::pair(p.number("VelocityNoise"), p.number("AccelerationNoise"));
  };
  const auto estimated = withNoise(0, 0);
  EXPECT_EQ(withNoise(1e-6, 1e-6), estimated);
  EXPECT_EQ(withNoise(0.01, 2.), std::pair(0.01, 2.));
}

TEST(VtkVICSharpResample, RefusesParticlesWithoutVelocity) {
  Pipeline p;
  p.tracks->Update();
  vtkNew<vtkPolyData> particles;
  particles->SetPoints(p.tracks->GetOutput()->GetPoints());
  p.resample->SetInputDataObject(0, particles);
  vtkNew<vtkTest::ErrorObserver> errors;
  p.resample->AddObserver(vtkCommand::ErrorEvent, errors);
  p.resample->GetExecutive()->AddObserver(vtkCommand::ErrorEvent, errors);
  p.resample->Update();
  EXPECT_EQ(errors->CheckErrorMessage("No velocity found"), 0);
  EXPECT_EQ(p.resample->GetOutput()->GetNumberOfPoints(), 0);
}
