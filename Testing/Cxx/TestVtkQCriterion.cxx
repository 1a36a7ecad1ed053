// Breaks when vtkQCriterion disagrees with vtkGradientFilter, looks across the mask, or fails without an
// error on bad input.
#include "vtkQCriterion.h"

#include "vtkCommand.h"
#include "vtkDataSetAttributes.h"
#include "vtkExecutive.h"
#include "vtkFloatArray.h"
#include "vtkGradientFilter.h"
#include "vtkImageData.h"
#include "vtkNew.h"
#include "vtkPointData.h"
#include "vtkTestErrorObserver.h"
#include "vtkUnsignedCharArray.h"

#include <cmath>
#include <gtest/gtest.h>
#include <limits>

namespace {

// A smooth field without symmetry, on a grid whose extent does not begin at 0.
void fill(vtkImageData* image, const char* name) {
  image->SetExtent(3, 26, -2, 19, 0, 17);
  image->SetSpacing(0.11, 0.09, 0.13);
  image->SetOrigin(-1, 0.5, 2);
  vtkNew<vtkFloatArray> u;
  u->SetName(name);
  u->SetNumberOfComponents(3);
  u->SetNumberOfTuples(image->GetNumberOfPoints());
  for (vtkIdType p = 0; p < image->GetNumberOfPoints(); ++p) {
    double x[3];
    image->GetPoint(p, x);
    u->SetTuple3(p, std::sin(2 * x[1]) + 0.3 * std::cos(x[2]), std::cos(1.5 * x[2]) * std::sin(x[0]),
                 std::sin(x[0] + x[1]));
  }
  image->GetPointData()->AddArray(u);
}

} // namespace

TEST(VtkQCriterion, AgreesWithVtkGradientFilterInside) {
  vtkNew<vtkImageData> image;
  fill(image, "Velocity");
  vtkNew<vtkGradientFilter> peer;
  peer->SetInputData(image);
  peer->SetInputScalars(vtkDataObject::FIELD_ASSOCIATION_POINTS, "Velocity");
  peer->SetComputeQCriterion(true);
  peer->SetComputeVorticity(true);
  peer->Update();
  vtkNew<vtkQCriterion> ours;
  ours->SetInputData(image);
  ours->SetComputeVorticity(true);
  ours->Update();
  vtkDataArray* expected = peer->GetOutput()->GetPointData()->GetArray("Q-criterion");
  vtkDataArray* expectedVorticity = peer->GetOutput()->GetPointData()->GetArray("Vorticity");
  vtkDataArray* found = ours->GetOutput()->GetPointData()->GetArray("QCriterion");
  vtkDataArray* foundVorticity = ours->GetOutput()->GetPointData()->GetArray("Vorticity");
  ASSERT_TRUE(expected && found && expectedVorticity && foundVorticity);
  int e[6];
  image->GetExtent(e);
  double largest = 0, difference = 0, largestVorticity = 0, differenceVorticity = 0;
  for (int k = e[4] + 1; k < e[5]; ++k)
    for (int j = e[2] + 1; j < e[3]; ++j)
      for (int i = e[0] + 1; i < e[1]; ++i) {
        int ijk[3] = {i, j, k};
        const vtkIdType p = image->ComputePointId(ijk);
        largest = std::max(largest, std::abs(expected->GetComponent(p, 0)));
        difference = std::max(difference, std::abs(expected->GetComponent(p, 0) - found->GetComponent(p, 0)));
        for (int c = 0; c < 3; ++c) {
          largestVorticity = std::max(largestVorticity, std::abs(expectedVorticity->GetComponent(p, c)));
          differenceVorticity = std::max(differenceVorticity, std::abs(expectedVorticity->GetComponent(p, c) -
                                                                       foundVorticity->GetComponent(p, c)));
        }
      }
  EXPECT_GT(largest, 0.5);
  EXPECT_LT(difference, 1e-5 * largest);
  EXPECT_LT(differenceVorticity, 1e-5 * largestVorticity);
}

TEST(VtkQCriterion, HiddenPointsAndMaskAreNeverUsed) {
  for (const bool byMask : {false, true}) {
    vtkNew<vtkImageData> image;
    fill(image, "Velocity");
    int ijk[3] = {12, 8, 9};
    const vtkIdType hole = image->ComputePointId(ijk);
    for (int c = 0; c < 3; ++c)
      image->GetPointData()
          ->GetArray("Velocity")
          ->SetComponent(hole, c, std::numeric_limits<double>::quiet_NaN());
    vtkNew<vtkUnsignedCharArray> mark;
    mark->SetName(byMask ? "Mask" : vtkDataSetAttributes::GhostArrayName());
    mark->SetNumberOfTuples(image->GetNumberOfPoints());
    mark->Fill(0);
    mark->SetValue(hole, byMask ? 1 : vtkDataSetAttributes::HIDDENPOINT);
    image->GetPointData()->AddArray(mark);
    vtkNew<vtkQCriterion> filter;
    filter->SetInputData(image);
    filter->Update();
    vtkDataArray* q = filter->GetOutput()->GetPointData()->GetArray("QCriterion");
    ASSERT_TRUE(q);
    for (vtkIdType p = 0; p < q->GetNumberOfTuples(); ++p) ASSERT_TRUE(std::isfinite(q->GetComponent(p, 0)));
    EXPECT_EQ(q->GetComponent(hole, 0), 0);
  }
}

TEST(VtkQCriterion, TakesAnotherArrayByNameAndTheActiveVectors) {
  vtkNew<vtkImageData> image;
  fill(image, "u");
  vtkNew<vtkQCriterion> filter;
  filter->SetInputData(image);
  filter->SetInputArrayToProcess(0, 0, 0, vtkDataObject::FIELD_ASSOCIATION_POINTS, "u");
  filter->Update();
  EXPECT_TRUE(filter->GetOutput()->GetPointData()->GetArray("QCriterion"));
  filter->SetInputArrayToProcess(0, 0, 0, vtkDataObject::FIELD_ASSOCIATION_POINTS, "");
  image->GetPointData()->SetActiveVectors("u");
  filter->Update();
  EXPECT_TRUE(filter->GetOutput()->GetPointData()->GetArray("QCriterion"));
}

TEST(VtkQCriterion, BadInputGivesAnErrorAndNothingElse) {
  vtkNew<vtkImageData> image;
  fill(image, "u");
  vtkNew<vtkTest::ErrorObserver> errors;
  vtkNew<vtkQCriterion> filter;
  filter->AddObserver(vtkCommand::ErrorEvent, errors);
  filter->GetExecutive()->AddObserver(vtkCommand::ErrorEvent, errors);
  filter->SetInputData(image);
  filter->Update();
  EXPECT_EQ(errors->CheckErrorMessage("No velocity found"), 0);
  EXPECT_EQ(filter->GetOutput()->GetNumberOfPoints(), 0);
  filter->SetInputArrayToProcess(0, 0, 0, vtkDataObject::FIELD_ASSOCIATION_POINTS, "u");
  filter->SetOrder(3);
  filter->Update();
  EXPECT_EQ(errors->CheckErrorMessage("must be 2 or 4"), 0);
  EXPECT_EQ(filter->GetOutput()->GetNumberOfPoints(), 0);
}
