// Breaks when vtkOmni3DPressure gives another pressure than the flow's, looks at what is masked or inside the
// Body, mixes up the times of a series, or fails without an error and an empty output.
#include "ImageOfFlow.h"
#include "vtkOmni3DPressure.h"

#include "vtkCallbackCommand.h"
#include "vtkCommand.h"
#include "vtkExecutive.h"
#include "vtkTestErrorObserver.h"
#include "vtkUnsignedCharArray.h"

#include <cmath>
#include <gtest/gtest.h>
#include <limits>

namespace {

using namespace rimflow_testing;

constexpr double Density = 1200, Viscosity = 2e-5, Spacing = 6e-4;

rimflow::AnalyticFlow taylorGreen() {
  rimflow::AnalyticFlow flow;
  flow.kind = rimflow::FlowKind::TaylorGreen;
  flow.density = Density;
  flow.viscosity = Viscosity;
  flow.body.diameter = 0;
  return flow;
}

/// 33 x 29 x 17 nodes whose extent does not begin at 0.
void layOut(vtkImageData* image) {
  image->SetExtent(2, 34, -3, 25, 0, 16);
  image->SetSpacing(Spacing, Spacing, Spacing);
  image->SetOrigin(-0.01, 0.002, -0.005);
}

vtkSmartPointer<vtkImageData> image(const rimflow::AnalyticFlow& flow = taylorGreen()) {
  auto image = vtkSmartPointer<vtkImageData>::New();
  layOut(image);
  addFlow(image, flow, 0);
  return image;
}

Eigen::Vector3d middle(vtkImageData* image) {
  Eigen::Vector3d centre;
  image->GetCenter(centre.data());
  return centre;
}

rimflow::Body sphere(const Eigen::Vector3d& centre, double diameter = 9 * Spacing) {
  rimflow::Body body;
  body.diameter = diameter;
  body.centre = centre;
  return body;
}

struct Pipeline {
  vtkNew<vtkOmni3DPressure> filter;
  vtkNew<vtkTest::ErrorObserver> errors;
  Pipeline() {
    filter->SetDensity(Density);
    filter->SetViscosity(Viscosity);
    filter->AddObserver(vtkCommand::ErrorEvent, errors);
    filter->AddObserver(vtkCommand::WarningEvent, errors);
    filter->GetExecutive()->AddObserver(vtkCommand::ErrorEvent, errors);
  }
  explicit Pipeline(vtkImageData* input) : Pipeline() { filter->SetInputData(input); }
  vtkImageData* update() {
    filter->Update();
    return filter->GetOutput();
  }
  vtkDataArray* array(const char* name) { return filter->GetOutput()->GetPointData()->GetArray(name); }
  double number(const char* name) {
    vtkDataArray* found = filter->GetOutput()->GetFieldData()->GetArray(name);
    return found ? found->GetTuple1(0) : std::numeric_limits<double>::quiet_NaN();
  }
  void expectFailure(const char* text) {
    EXPECT_EQ(update()->GetNumberOfPoints(), 0);
    EXPECT_NE(errors->GetErrorMessage().find(text), std::string::npos) << errors->GetErrorMessage();
  }
};

/// rms of pressure - exact - mean over rms of exact - mean, over the nodes where `counts` is true.
template <class Counts>
double pressureError(vtkImageData* output, const rimflow::AnalyticFlow& flow, double time, Counts&& counts) {
  vtkDataArray* pressure = output->GetPointData()->GetArray("Pressure");
  if (!pressure) return 1e9;
  double n = 0, difference = 0, difference2 = 0, exact = 0, exact2 = 0;
  for (vtkIdType p = 0; p < output->GetNumberOfPoints(); ++p) {
    if (!counts(p)) continue;
    const double e = flow.pressure(Eigen::Vector3d(output->GetPoint(p)), time);
    const double d = pressure->GetTuple1(p) - e;
    n += 1, difference += d, difference2 += d * d, exact += e, exact2 += e * e;
  }
  return std::sqrt((difference2 - difference * difference / n) / (exact2 - exact * exact / n));
}
double pressureError(vtkImageData* output, const rimflow::AnalyticFlow& flow, double time = 0) {
  vtkDataArray* mask = output->GetPointData()->GetArray("Mask");
  return pressureError(output, flow, time, [&](vtkIdType p) { return !mask || mask->GetTuple1(p) == 0; });
}

void addMask(vtkImageData* image, const std::function<bool(const Eigen::Vector3d&)>& masked) {
  addArray(image, "Mask", 1, [&](const Eigen::Vector3d& x) { return Eigen::Vector3d(masked(x), 0, 0); });
}

} // namespace

TEST(VtkOmni3DPressure, FindsTheFlowsPressure) {
  for (const int order : {4, 2}) {
    Pipeline p(image());
    p.filter->SetOrder(order);
    vtkImageData* output = p.update();
    EXPECT_LT(pressureError(output, taylorGreen()), order == 4 ? 0.003 : 0.02);
    EXPECT_FALSE(p.errors->GetError() || p.errors->GetWarning());
  }
}

TEST(VtkOmni3DPressure, ParallelLinesAgree) {
  Pipeline p(image());
  p.filter->SetMethodToParallelLines();
  p.filter->SetNumberOfDirections(162);
  EXPECT_LT(pressureError(p.update(), taylorGreen()), 0.02);
  EXPECT_GT(p.number("Iterations"), 1);
}

TEST(VtkOmni3DPressure, KeepsTheInputAndSaysHowItWent) {
  Pipeline p(image());
  addField(vtkImageData::SafeDownCast(p.filter->GetInput()), "Iterations", {77}, 1);
  p.update();
  for (const char* name : {"Velocity", "MaterialAcceleration", "PressureGradient"}) {
    ASSERT_TRUE(p.array(name)) << name;
    EXPECT_EQ(p.array(name)->GetNumberOfComponents(), 3);
  }
  ASSERT_TRUE(p.array("PressureError"));
  EXPECT_EQ(p.filter->GetOutput()->GetPointData()->GetScalars(), p.array("Pressure"));
  EXPECT_FALSE(p.array("Mask"));
  EXPECT_FALSE(p.array("Region"));
  EXPECT_EQ(p.number("Density"), Density);
  EXPECT_EQ(p.number("Viscosity"), Viscosity);
  EXPECT_EQ(p.number("Regions"), 1);
  EXPECT_LT(p.number("Iterations"), 77);
  EXPECT_GT(p.number("Iterations"), 0);
  EXPECT_LT(p.number("Residual"), 1e-6);
  EXPECT_LT(p.number("CurlResidual"), 0.02);
  EXPECT_GE(p.number("ElapsedTime"), 0);
  // the input itself is left alone
  EXPECT_FALSE(vtkImageData::SafeDownCast(p.filter->GetInput())->GetPointData()->GetArray("Pressure"));
}

TEST(VtkOmni3DPressure, IsInviscidWithoutVelocity) {
  rimflow::AnalyticFlow flow = taylorGreen();
  flow.viscosity = 0;
  const auto input = image(flow);
  input->GetPointData()->RemoveArray("Velocity");
  Pipeline p(input);
  p.expectFailure("no velocity found");
  p.filter->SetViscosity(0);
  EXPECT_LT(pressureError(p.update(), flow), 0.003);
}

TEST(VtkOmni3DPressure, TakesOtherArraysByName) {
  const auto input = image();
  input->GetPointData()->GetArray("Velocity")->SetName("u");
  input->GetPointData()->GetArray("MaterialAcceleration")->SetName("a");
  addArray(input, "MaterialAcceleration", 3, [](const Eigen::Vector3d&) { return Eigen::Vector3d(9, 9, 9); });
  Pipeline p(input);
  p.filter->SetInputArrayToProcess(0, 0, 0, vtkDataObject::FIELD_ASSOCIATION_POINTS, "u");
  p.filter->SetInputArrayToProcess(1, 0, 0, vtkDataObject::FIELD_ASSOCIATION_POINTS, "a");
  EXPECT_LT(pressureError(p.update(), taylorGreen()), 0.003);
}

TEST(VtkOmni3DPressure, NeverLooksIntoTheBody) {
  const auto input = image();
  // inside one body, at the border, and outside of the image
  const Eigen::Vector3d border(input->GetBounds()[0], middle(input)[1], middle(input)[2]);
  for (const Eigen::Vector3d& centre :
       {middle(input), border, Eigen::Vector3d(middle(input) + Eigen::Vector3d(1, 0, 0))}) {
    const rimflow::Body body = sphere(centre);
    const auto spoilt = vtkSmartPointer<vtkImageData>::New();
    spoilt->DeepCopy(input);
    vtkIdType inside = 0;
    for (vtkIdType p = 0; p < spoilt->GetNumberOfPoints(); ++p) {
      if (!body.contains(Eigen::Vector3d(spoilt->GetPoint(p)))) continue;
      ++inside;
      for (const char* name : {"Velocity", "MaterialAcceleration"})
        spoilt->GetPointData()->GetArray(name)->SetComponent(p, 1, std::numeric_limits<double>::quiet_NaN());
    }
    Pipeline p(spoilt);
    p.filter->SetInputDataObject(1, bodyData(body));
    EXPECT_LT(pressureError(p.update(), taylorGreen()), 0.005);
    ASSERT_TRUE(p.array("Mask"));
    vtkIdType masked = 0;
    for (vtkIdType n = 0; n < spoilt->GetNumberOfPoints(); ++n) {
      if (p.array("Mask")->GetTuple1(n) == 0) continue;
      ++masked;
      EXPECT_EQ(p.array("Pressure")->GetTuple1(n), 0);
      EXPECT_EQ(p.array("PressureError")->GetTuple1(n), 0);
      EXPECT_EQ(p.array("PressureGradient")->GetComponent(n, 1), 0);
      EXPECT_NE(int(p.filter->GetOutput()->GetPointGhostArray()->GetValue(n)) &
                    vtkDataSetAttributes::HIDDENPOINT,
                0);
    }
    EXPECT_EQ(masked, inside);
  }
}

TEST(VtkOmni3DPressure, MasksSeveralBodiesButNoLostOne) {
  const auto input = image();
  const auto bodies = vtkSmartPointer<vtkPolyData>::New();
  const Eigen::Vector3d a = middle(input) - Eigen::Vector3d(8 * Spacing, 0, 0),
                        b = a + 2 * (middle(input) - a);
  addField(bodies, "Diameter", {4 * Spacing, 4 * Spacing}, 1);
  addField(bodies, "Centre", {a[0], a[1], a[2], b[0], b[1], b[2]}, 3);
  Pipeline p(input);
  p.filter->SetInputDataObject(1, bodies);
  vtkImageData* output = p.update();
  for (const Eigen::Vector3d& centre : {a, b})
    EXPECT_EQ(p.array("Mask")->GetTuple1(output->FindPoint(centre[0], centre[1], centre[2])), 1);
  addField(bodies, "Status", {0, 2}, 1);
  bodies->Modified();
  output = p.update();
  EXPECT_EQ(p.array("Mask")->GetTuple1(output->FindPoint(a[0], a[1], a[2])), 1);
  EXPECT_EQ(p.array("Mask")->GetTuple1(output->FindPoint(b[0], b[1], b[2])), 0);
}

TEST(VtkOmni3DPressure, PartsThatDoNotHangTogetherHaveTheirOwnMean) {
  const auto input = image();
  const double wall = middle(input)[0] + 4.2 * Spacing;
  addMask(input, [&](const Eigen::Vector3d& x) { return std::abs(x[0] - wall) < Spacing; });
  Pipeline p(input);
  vtkImageData* output = p.update();
  EXPECT_EQ(p.number("Regions"), 2);
  ASSERT_TRUE(p.array("Region"));
  for (const int region : {0, 1}) {
    const auto belongs = [&](vtkIdType n) { return p.array("Region")->GetTuple1(n) == region; };
    EXPECT_LT(pressureError(output, taylorGreen(), 0, belongs), 0.005);
    double sum = 0, square = 0;
    for (vtkIdType n = 0; n < output->GetNumberOfPoints(); ++n)
      if (belongs(n)) sum += p.array("Pressure")->GetTuple1(n), square += 1;
    EXPECT_NEAR(sum / square, 0, 1e-3);
  }
}

TEST(VtkOmni3DPressure, RefusesNumbersThatAreNone) {
  const auto input = image();
  for (const vtkIdType p : {100, 2000, 3000})
    input->GetPointData()
        ->GetArray("MaterialAcceleration")
        ->SetComponent(p, 2, std::numeric_limits<double>::infinity());
  Pipeline p(input);
  p.expectFailure("material acceleration is no finite number at 3 of 16269 nodes");
  input->GetPointData()->GetArray("Velocity")->SetComponent(5, 0, std::numeric_limits<double>::quiet_NaN());
  input->Modified();
  p.errors->Clear();
  p.expectFailure("velocity is no finite number at 1 of");
}

TEST(VtkOmni3DPressure, SaysWhenThereIsNoFluid) {
  const auto input = image();
  addMask(input, [](const Eigen::Vector3d&) { return true; });
  Pipeline p(input);
  p.expectFailure("no node holds fluid");
  const auto covered = image();
  Pipeline q(covered);
  q.filter->SetInputDataObject(1, bodyData(sphere(middle(covered), 1)));
  q.expectFailure("no node holds fluid");
}

TEST(VtkOmni3DPressure, RefusesWhatIsOutOfRange) {
  Pipeline p(image());
  p.filter->SetOrder(3);
  p.expectFailure("must be 2 or 4");
  p.filter->SetOrder(4);
  p.filter->SetDensity(0);
  p.errors->Clear();
  p.expectFailure("Density must be greater than 0");
  p.filter->SetDensity(Density);
  p.filter->SetWallWeight(0);
  p.errors->Clear();
  p.expectFailure("weight");
  p.filter->SetWallWeight(1);
  EXPECT_GT(p.update()->GetNumberOfPoints(), 0);
}

TEST(VtkOmni3DPressure, WarnsWhenIterationsDoNotSuffice) {
  const auto input = image();
  Pipeline p(input);
  p.filter->SetInputDataObject(1, bodyData(sphere(middle(input))));
  p.filter->SetMaximumIterations(1);
  p.update();
  EXPECT_NE(p.errors->GetWarningMessage().find("has not converged"), std::string::npos);
  EXPECT_GT(p.number("Residual"), 1e-6);
}

TEST(VtkOmni3DPressure, LeavesOutWhatNoPressureExplains) {
  const auto input = image();
  const vtkIdType bad = input->FindPoint(middle(input)[0], middle(input)[1], middle(input)[2]);
  vtkDataArray* acceleration = input->GetPointData()->GetArray("MaterialAcceleration");
  acceleration->SetComponent(bad, 0, 100);
  Pipeline p(input);
  const auto others = [bad](vtkIdType n) { return n != bad; };
  const double spoilt = pressureError(p.update(), taylorGreen(), 0, others);
  EXPECT_EQ(p.number("NodesLeftOut"), 0);
  p.filter->SetLargestGradientError(0.1 * Density * 100);
  const double cleaned = pressureError(p.update(), taylorGreen());
  EXPECT_LT(cleaned, 0.2 * spoilt);
  EXPECT_GE(p.number("NodesLeftOut"), 1);
  EXPECT_LE(p.number("NodesLeftOut"), 7);
  EXPECT_EQ(p.array("Mask")->GetTuple1(bad), 1);
}

TEST(VtkOmni3DPressure, StopsWhenAskedTo) {
  Pipeline p(image());
  vtkNew<vtkCallbackCommand> stop;
  stop->SetCallback([](vtkObject* caller, unsigned long, void*, void*) {
    vtkAlgorithm::SafeDownCast(caller)->SetAbortExecute(1);
  });
  p.filter->AddObserver(vtkCommand::ProgressEvent, stop);
  EXPECT_EQ(p.update()->GetNumberOfPoints(), 0);
  EXPECT_FALSE(p.errors->GetError());
}

// A sphere that moves through a decaying flow, without acceleration: three time steps are needed.
struct Series : Pipeline {
  vtkNew<ImageSeries> source;
  Series() {
    source->times = {0, 0.002, 0.004, 0.006, 0.008};
    vtkNew<vtkImageData> box;
    layOut(box);
    box->GetExtent(source->extent);
    source->fill = [](vtkImageData* image, double time) {
      layOut(image);
      addFlow(image, taylorGreen(), time);
      image->GetPointData()->RemoveArray("MaterialAcceleration");
    };
    filter->SetInputConnection(source->GetOutputPort());
  }
  vtkImageData* at(double time) {
    filter->UpdateTimeStep(time);
    return filter->GetOutput();
  }
  double dataTime() { return filter->GetOutput()->GetInformation()->Get(vtkDataObject::DATA_TIME_STEP()); }
};

TEST(VtkOmni3DPressure, FindsTheAccelerationFromTheTimeStepsAround) {
  Series s;
  const rimflow::AnalyticFlow flow = taylorGreen();
  for (const double time : {0.004, 0.002, 0.006}) {
    const auto known = [&](vtkIdType p) { return s.array("Mask")->GetTuple1(p) == 0; };
    EXPECT_LT(pressureError(s.at(time), flow, time, known), 0.05) << time;
    EXPECT_EQ(s.dataTime(), time);
    EXPECT_TRUE(s.array("MaterialAcceleration"));
  }
  // at the ends one side has to do
  for (const double time : {0., 0.008}) {
    EXPECT_LT(pressureError(s.at(time), flow, time), 0.2) << time;
    EXPECT_EQ(s.dataTime(), time);
  }
  EXPECT_FALSE(s.errors->GetError());
}

TEST(VtkOmni3DPressure, ForwardInTimeCostsOneSnapshotPerStep) {
  Series s;
  s.at(0.002);
  EXPECT_EQ(s.source->executed.size(), 3u);
  s.at(0.004);
  s.at(0.006);
  EXPECT_EQ(s.source->executed.size(), 5u);
  s.source->Modified(); // then nothing that was kept may be used
  s.at(0.006);
  EXPECT_EQ(s.source->executed.size(), 8u);
}

TEST(VtkOmni3DPressure, PseudoTrackingGoesRoundABodyThatMoves) {
  Series s;
  vtkNew<vtkImageData> box;
  layOut(box);
  const Eigen::Vector3d start = middle(box);
  s.source->fill = [start](vtkImageData* image, double time) {
    layOut(image);
    addFlow(image, taylorGreen(), time);
    image->GetPointData()->RemoveArray("MaterialAcceleration");
    const rimflow::Body body = sphere(start + Eigen::Vector3d(2 * Spacing * time / 0.002, 0, 0));
    addMask(image, [&](const Eigen::Vector3d& x) { return body.contains(x); });
    vtkDataArray* velocity = image->GetPointData()->GetArray("Velocity");
    for (vtkIdType p = 0; p < image->GetNumberOfPoints(); ++p) // what must not be looked at
      if (body.contains(Eigen::Vector3d(image->GetPoint(p)))) velocity->SetTuple3(p, 5, 5, 5);
  };
  EXPECT_LT(pressureError(s.at(0.004), taylorGreen(), 0.004), 0.1);
}

TEST(VtkOmni3DPressure, ASnapshotThatFailsIsDoneWithout) {
  Series s;
  s.source->failing = {0.006};
  EXPECT_LT(pressureError(s.at(0.004), taylorGreen(), 0.004), 0.2);
  EXPECT_EQ(s.dataTime(), 0.004);
  EXPECT_LT(pressureError(s.at(0.002), taylorGreen(), 0.002), 0.05);
}

TEST(VtkOmni3DPressure, PseudoTrackingOnRequest) {
  Series s;
  s.filter->SetPseudoTrackingToNever();
  s.source->UpdateTimeStep(0.004);
  s.at(0.004);
  EXPECT_NE(s.errors->GetErrorMessage().find("no material acceleration found"), std::string::npos);
  // alone: nothing to track with
  Pipeline one(image());
  one.filter->SetPseudoTrackingToAlways();
  one.expectFailure("pseudo-tracking needs the velocity at several times");
  // given, but not wanted
  Series always;
  const auto withoutAcceleration = always.source->fill;
  always.source->fill = [=](vtkImageData* image, double time) {
    withoutAcceleration(image, time);
    addArray(image, "MaterialAcceleration", 3,
             [](const Eigen::Vector3d&) { return Eigen::Vector3d(9, 9, 9); });
  };
  always.filter->SetPseudoTrackingToAlways();
  EXPECT_LT(pressureError(always.at(0.004), taylorGreen(), 0.004), 0.05);
}
