// Breaks when vtkTrajectorySmoother drops an array, loses the order of time, or fails without an error on bad
// input.
#include "vtkTrajectorySmoother.h"

#include "vtkCellArray.h"
#include "vtkCommand.h"
#include "vtkDoubleArray.h"
#include "vtkExecutive.h"
#include "vtkFieldData.h"
#include "vtkIntArray.h"
#include "vtkNew.h"
#include "vtkPointData.h"
#include "vtkPoints.h"
#include "vtkPolyData.h"
#include "vtkTestErrorObserver.h"

#include <cmath>
#include <gtest/gtest.h>

namespace {

// Ten snapshots of uniform motion at (0.1, 0.3, 0) m/s, in descending order of time; snapshot 4 was not
// found.
void fill(vtkPolyData* data) {
  vtkNew<vtkPoints> points;
  vtkNew<vtkDoubleArray> time, centre, covariance;
  vtkNew<vtkIntArray> status;
  time->SetName("Time");
  centre->SetName("Centre");
  centre->SetNumberOfComponents(3);
  covariance->SetName("Covariance");
  covariance->SetNumberOfComponents(6);
  status->SetName("Status");
  for (int k = 9; k >= 0; --k) {
    const double t = 5 + 1e-3 * k, x[3] = {1e-4 * k, 3e-4 * k, 0};
    points->InsertNextPoint(x);
    time->InsertNextValue(t);
    centre->InsertNextTuple3(k == 4 ? std::nan("") : x[0], x[1], x[2]);
    covariance->InsertNextTuple6(1e-10, 2e-10, 1e-10, 0.5e-10, 0, 0);
    status->InsertNextValue(k == 4 ? 2 : 0);
  }
  data->SetPoints(points);
  for (vtkDataArray* array :
       {(vtkDataArray*)time, (vtkDataArray*)centre, (vtkDataArray*)covariance, (vtkDataArray*)status})
    data->GetPointData()->AddArray(array);
}

} // namespace

TEST(VtkTrajectorySmoother, GivesEveryArrayInTheOrderOfTheInput) {
  vtkNew<vtkPolyData> input;
  fill(input);
  vtkNew<vtkTrajectorySmoother> smoother;
  smoother->SetInputData(input);
  smoother->Update();
  vtkPointData* p = smoother->GetOutput()->GetPointData();
  ASSERT_EQ(smoother->GetOutput()->GetNumberOfPoints(), 10);
  for (const auto& [name, components] : {std::pair{"Time", 1},
                                         {"Centre", 3},
                                         {"Velocity", 3},
                                         {"Acceleration", 3},
                                         {"Covariance", 6},
                                         {"VelocityCovariance", 6},
                                         {"AccelerationCovariance", 6},
                                         {"Sigma", 3},
                                         {"VelocitySigma", 3},
                                         {"AccelerationSigma", 3},
                                         {"Status", 1},
                                         {"RawCentre", 3}}) {
    ASSERT_TRUE(p->GetArray(name)) << name;
    EXPECT_EQ(p->GetArray(name)->GetNumberOfComponents(), components) << name;
  }
  EXPECT_NEAR(p->GetArray("Velocity")->GetComponent(3, 1), 0.3, 0.02);
  EXPECT_EQ(p->GetArray("Status")->GetComponent(5, 0), 1); // snapshot 4, bridged
  EXPECT_NEAR(p->GetArray("Centre")->GetComponent(5, 1), 1.2e-3, 2e-5);
  EXPECT_TRUE(std::isnan(p->GetArray("RawCentre")->GetComponent(5, 0)));
  vtkNew<vtkIdList> line;
  smoother->GetOutput()->GetLines()->GetCellAtId(0, line);
  ASSERT_EQ(line->GetNumberOfIds(), 10);
  EXPECT_EQ(line->GetId(0), 9); // the earliest is last in the input
  EXPECT_TRUE(smoother->GetOutput()->GetFieldData()->GetArray("JerkIntensity"));
}

TEST(VtkTrajectorySmoother, BadInputGivesAnErrorAndNothingElse) {
  vtkNew<vtkPolyData> input;
  fill(input);
  vtkNew<vtkTest::ErrorObserver> errors;
  vtkNew<vtkTrajectorySmoother> smoother;
  smoother->AddObserver(vtkCommand::ErrorEvent, errors);
  smoother->GetExecutive()->AddObserver(vtkCommand::ErrorEvent, errors);
  smoother->SetInputData(input);
  input->GetPointData()->GetArray("Covariance")->Fill(0);
  smoother->Update();
  EXPECT_EQ(errors->CheckErrorMessage("not positive definite"), 0);
  EXPECT_EQ(smoother->GetOutput()->GetNumberOfPoints(), 0);
  input->GetPointData()->RemoveArray("Covariance");
  input->Modified();
  smoother->Update();
  EXPECT_EQ(errors->CheckErrorMessage("no point array Covariance"), 0);
  EXPECT_EQ(smoother->GetOutput()->GetNumberOfPoints(), 0);
}
