// Breaks when vtkSurfaceForce reports another force than the flow's or under other names, does not say what
// is missing, or when a lost sphere ends a series.
#include "ImageOfFlow.h"
#include "vtkBodyFromPolyData.h"
#include "vtkSurfaceForce.h"

#include "vtkCommand.h"
#include "vtkExecutive.h"
#include "vtkTable.h"
#include "vtkTestErrorObserver.h"
#include "vtkVariant.h"

#include <cmath>
#include <gtest/gtest.h>
#include <string>
#include <utility>

namespace {

using namespace rimflow_testing;

constexpr double Density = 1200, Viscosity = 1e-3, Diameter = 0.01, Pi = 3.14159265358979323846;
const Eigen::Vector3d Motion(0, 0.02, 0);

rimflow::AnalyticFlow stokes(const Eigen::Vector3d& centre = {0.001, 0.0005, -0.0007}) {
  rimflow::AnalyticFlow flow;
  flow.kind = rimflow::FlowKind::StokesSphere;
  flow.density = Density;
  flow.viscosity = Viscosity;
  flow.body.diameter = Diameter;
  flow.body.centre = centre;
  flow.body.velocity = Motion;
  return flow;
}

/// All that vtkOmni3DPressure would give, but exact.
void fillImage(vtkImageData* image, const rimflow::AnalyticFlow& flow, double time = 0) {
  const int nodes = 49;
  const double spacing = 0.04 / (nodes - 1);
  image->SetExtent(0, nodes - 1, 1, nodes, -2, nodes - 3);
  image->SetSpacing(spacing, spacing, spacing);
  image->SetOrigin(-0.02, -0.02 - spacing, -0.02 + 2 * spacing);
  addFlow(image, flow, time);
  addArray(image, "Pressure", 1,
           [&](const Eigen::Vector3d& x) { return Eigen::Vector3d(flow.pressure(x, time), 0, 0); });
  addArray(image, "PressureGradient", 3, [&](const Eigen::Vector3d& x) {
    Eigen::Vector3d gradient;
    const double h = 1e-6;
    for (int a = 0; a < 3; ++a)
      gradient[a] = (flow.pressure(x + h * Eigen::Vector3d::Unit(a), time) -
                     flow.pressure(x - h * Eigen::Vector3d::Unit(a), time)) /
                    (2 * h);
    return gradient;
  });
}

struct Pipeline {
  vtkNew<vtkSurfaceForce> filter;
  vtkNew<vtkTest::ErrorObserver> errors;
  Pipeline() {
    filter->SetDensity(Density);
    filter->SetViscosity(Viscosity);
    filter->SetBodyDensity(1100);
    filter->AddObserver(vtkCommand::ErrorEvent, errors);
    filter->AddObserver(vtkCommand::WarningEvent, errors);
    filter->GetExecutive()->AddObserver(vtkCommand::ErrorEvent, errors);
  }
  explicit Pipeline(const rimflow::AnalyticFlow& flow) : Pipeline() {
    fillImage(image, flow);
    filter->SetInputData(0, image);
    filter->SetInputDataObject(1, bodyData(flow.body));
  }
  vtkNew<vtkImageData> image;

  vtkTable* table() { return vtkTable::SafeDownCast(filter->GetOutputDataObject(1)); }
  vtkPolyData* surface() { return filter->GetOutput(); }
  double number(const std::string& column, vtkIdType row = 0) {
    return table()->GetValueByName(row, column.c_str()).ToDouble();
  }
  std::string note(vtkIdType row = 0) { return table()->GetValueByName(row, "note").ToString(); }
  Eigen::Vector3d vector(const std::string& before, const std::string& unit) {
    return {number(before + "_x" + unit), number(before + "_y" + unit), number(before + "_z" + unit)};
  }
  void expectFailure(const char* text) {
    filter->Update();
    EXPECT_EQ(surface()->GetNumberOfPoints(), 0);
    EXPECT_EQ(table()->GetNumberOfRows(), 0);
    EXPECT_NE(errors->GetErrorMessage().find(text), std::string::npos) << errors->GetErrorMessage();
  }
};

} // namespace

TEST(VtkSurfaceForce, FindsStokesDrag) {
  Pipeline p(stokes());
  p.filter->Update();
  ASSERT_EQ(p.table()->GetNumberOfRows(), 1);
  const double drag = 3 * Pi * Viscosity * Density * Diameter * Motion[1]; // a third of it pressure
  EXPECT_NEAR(p.number("Fp_y_N"), -drag / 3, 0.05 * drag);
  EXPECT_NEAR(p.number("Fv_y_N"), -2 * drag / 3, 0.1 * drag);
  EXPECT_NEAR(p.number("drag_N"), -p.number("Fp_y_N") - p.number("Fv_y_N"), 1e-6 * drag);
  EXPECT_LT(p.number("lift_N"), 0.02 * drag);
  EXPECT_NEAR(p.vector("lift", "_N").norm(), p.number("lift_N"), 1e-6 * drag);
  const double dynamic = 0.5 * Density * Motion.squaredNorm() * Pi / 4 * Diameter * Diameter;
  EXPECT_NEAR(p.number("Cd"), p.number("drag_N") / dynamic, 1e-6 * p.number("Cd"));
  EXPECT_NEAR(p.number("Cl"), p.number("lift_N") / dynamic, 1e-6 * p.number("Cd"));
  // at constant speed the fluid carries what buoyancy leaves of the weight
  EXPECT_NEAR(p.number("Fin_y_N"), (1100 - Density) * 9.81 * Pi / 6 * std::pow(Diameter, 3), 1e-9);
  EXPECT_EQ(p.number("coverage"), 1);
  EXPECT_GT(p.number("control_volume_radius_m"), Diameter / 2);
  EXPECT_FALSE(p.errors->GetError() || p.errors->GetWarning());
}

TEST(VtkSurfaceForce, HasTheColumnsOfTheContract) {
  Pipeline p(stokes());
  p.filter->Update();
  for (const char* name : {"Time",
                           "SphereId",
                           "Fp_x_N",
                           "Fp_y_N",
                           "Fp_z_N",
                           "Fv_x_N",
                           "Fv_y_N",
                           "Fv_z_N",
                           "Fcv_x_N",
                           "Fcv_y_N",
                           "Fcv_z_N",
                           "Fin_x_N",
                           "Fin_y_N",
                           "Fin_z_N",
                           "drag_N",
                           "lift_N",
                           "Cd",
                           "Cl",
                           "sigma_Fp_x_N",
                           "sigma_Fv_y_N",
                           "sigma_Fcv_z_N",
                           "sigma_Fin_x_N",
                           "sigma_drag_N",
                           "sigma_lift_N",
                           "lift_x_N",
                           "drag_cv_N",
                           "lift_cv_N",
                           "sigma_lift_cv_N",
                           "Cd_cv",
                           "Cl_cv",
                           "torque_x_N_m",
                           "coverage",
                           "control_volume_radius_m",
                           "note"}) {
    EXPECT_TRUE(p.table()->GetColumnByName(name)) << name;
    EXPECT_TRUE(p.surface()->GetFieldData()->GetAbstractArray(name)) << name;
  }
}

TEST(VtkSurfaceForce, TheSurfaceCarriesThePressure) {
  const rimflow::AnalyticFlow flow = stokes();
  Pipeline p(flow);
  p.filter->SetSurfaceResolution(4);
  p.filter->Update();
  vtkPolyData* surface = p.surface();
  ASSERT_EQ(surface->GetNumberOfPoints(), 162);
  EXPECT_EQ(surface->GetNumberOfCells(), 320);
  vtkPointData* data = surface->GetPointData();
  EXPECT_EQ(data->GetScalars(), data->GetArray("Pressure"));
  EXPECT_EQ(data->GetNormals(), data->GetArray("Normals"));
  for (const char* name : {"PressureSigma", "Traction", "Seen"}) EXPECT_TRUE(data->GetArray(name)) << name;
  const double largest = flow.pressure(flow.body.centre + 0.5001 * Diameter * Eigen::Vector3d::UnitY(), 0);
  for (vtkIdType q = 0; q < surface->GetNumberOfPoints(); ++q) {
    const Eigen::Vector3d out = Eigen::Vector3d(surface->GetPoint(q)) - flow.body.centre;
    EXPECT_NEAR(out.norm(), Diameter / 2, 1e-6 * Diameter);
    const Eigen::Vector3d normal(data->GetNormals()->GetTuple(q));
    EXPECT_NEAR(normal.dot(out.normalized()), 1, 1e-6);
    EXPECT_NEAR(data->GetScalars()->GetTuple1(q), flow.pressure(flow.body.centre + 1.0001 * out, 0),
                0.1 * largest);
  }
  // it is a Body again
  EXPECT_EQ(surface->GetFieldData()->GetArray("Diameter")->GetTuple1(0), Diameter);
}

TEST(VtkSurfaceForce, TheUncertaintyGrowsWithThatOfTheCentre) {
  Pipeline p(stokes());
  p.filter->Update();
  const double before = p.number("sigma_Fp_y_N");
  const auto body = bodyData(stokes().body);
  const double s = std::pow(0.05 * Diameter, 2);
  addField(body, "Covariance", {s, s, s, 0, 0, 0}, 6);
  p.filter->SetInputDataObject(1, body);
  p.filter->Update();
  EXPECT_GT(p.number("sigma_Fp_y_N"), before);
}

TEST(VtkSurfaceForce, TheUncertaintyGrowsWithThatOfTheVelocity) {
  Pipeline p(stokes());
  const auto body = bodyData(stokes().body);
  p.filter->SetInputDataObject(1, body);
  const auto sigma = [&](double velocitySigma) {
    addField(body, "VelocitySigma", {0, velocitySigma, 0}, 3);
    body->Modified();
    p.filter->Update();
    return p.number("sigma_Fv_y_N");
  };
  const double without = sigma(0), speed = stokes().body.velocity.norm();
  EXPECT_GT(sigma(0.01 * speed), std::hypot(without, 0.02 * p.number("Fv_y_N")));
  EXPECT_EQ(sigma(-1), without);                                       // not known
  EXPECT_EQ(sigma(std::numeric_limits<double>::quiet_NaN()), without); // nor here
  EXPECT_FALSE(p.errors->GetError() || p.errors->GetWarning());
}

TEST(VtkSurfaceForce, InertiaNeedsAnAccelerationAndTakesItsUncertainty) {
  Pipeline p(stokes());
  const auto body = bodyData(stokes().body);
  addField(body, "AccelerationSigma", {0, 0.1, 0}, 3);
  p.filter->SetInputDataObject(1, body);
  p.filter->Update();
  EXPECT_NEAR(p.number("sigma_Fin_y_N"), 1100 * 0.1 * Pi / 6 * std::pow(Diameter, 3), 1e-9);
  body->GetFieldData()->RemoveArray("Acceleration");
  body->Modified();
  p.filter->Update();
  EXPECT_TRUE(std::isnan(p.number("Fin_y_N")));
}

TEST(VtkSurfaceForce, AWallFollowsNoMotionThatIsNoise) {
  using rimflow::significant;
  EXPECT_FALSE(significant({2, 2, 2}, {1, 1, 1})); // 12 < 14.16
  EXPECT_TRUE(significant({0, 4, 0}, {1, 1, 1}));
  EXPECT_FALSE(significant({9, 9, 9}, {-1, -1, -1})); // not known
  EXPECT_TRUE(significant({1e-9, 0, 0}, {0, 0, 0}));  // known exactly
  const auto data = bodyData(stokes().body);
  for (const auto& [name, sigma] :
       {std::pair{"Acceleration", "AccelerationSigma"}, {"AngularVelocity", "AngularVelocitySigma"}}) {
    addField(data, name, {0, 5, 0}, 3);
    addField(data, sigma, {2, 2, 2}, 3);
  }
  EXPECT_EQ(rimflow::bodyOf(data)->acceleration, Eigen::Vector3d::Zero());
  EXPECT_EQ(rimflow::bodyOf(data)->angularVelocity, Eigen::Vector3d::Zero());
  for (const char* sigma : {"AccelerationSigma", "AngularVelocitySigma"}) addField(data, sigma, {1, 1, 1}, 3);
  EXPECT_EQ(rimflow::bodyOf(data)->acceleration, Eigen::Vector3d(0, 5, 0));
  EXPECT_EQ(rimflow::bodyOf(data)->angularVelocity, Eigen::Vector3d(0, 5, 0));
}

TEST(VtkSurfaceForce, ALostSphereHasARowThatSaysSo) {
  Pipeline p(stokes());
  const auto lost = vtkSmartPointer<vtkPolyData>::New();
  addField(lost, "Diameter", {Diameter}, 1);
  addField(lost, "Status", {2}, 1);
  p.filter->SetInputDataObject(1, lost);
  p.filter->Update();
  EXPECT_EQ(p.surface()->GetNumberOfPoints(), 0);
  ASSERT_EQ(p.table()->GetNumberOfRows(), 1);
  EXPECT_TRUE(std::isnan(p.number("Fp_x_N")) && std::isnan(p.number("Cd")) &&
              std::isnan(p.number("coverage")));
  EXPECT_EQ(p.note(), "the body is lost");
  EXPECT_FALSE(p.errors->GetError() || p.errors->GetWarning());
}

TEST(VtkSurfaceForce, ABodyOutsideOfTheImageHasNoForce) {
  rimflow::AnalyticFlow flow = stokes();
  Pipeline p(flow);
  flow.body.centre[0] += 1;
  p.filter->SetInputDataObject(1, bodyData(flow.body));
  p.filter->Update();
  EXPECT_EQ(p.surface()->GetNumberOfPoints(), 0);
  ASSERT_EQ(p.table()->GetNumberOfRows(), 1);
  EXPECT_TRUE(std::isnan(p.number("drag_N")));
  EXPECT_FALSE(p.note().empty());
  EXPECT_TRUE(p.errors->GetWarning());
  EXPECT_FALSE(p.errors->GetError());
}

TEST(VtkSurfaceForce, SeveralBodiesHaveARowEach) {
  const rimflow::AnalyticFlow flow = stokes();
  Pipeline p(flow);
  const auto bodies = vtkSmartPointer<vtkPolyData>::New();
  const Eigen::Vector3d c = flow.body.centre;
  addField(bodies, "SphereId", {3, 5}, 1);
  addField(bodies, "Diameter", {Diameter, Diameter}, 1);
  addField(bodies, "Centre", {9, 9, 9, c[0], c[1], c[2]}, 3);
  addField(bodies, "Velocity", {0, 0, 0, Motion[0], Motion[1], Motion[2]}, 3);
  addField(bodies, "Status", {2, 0}, 1);
  p.filter->SetInputDataObject(1, bodies);
  p.filter->Update();
  ASSERT_EQ(p.table()->GetNumberOfRows(), 2);
  EXPECT_EQ(p.number("SphereId", 0), 3);
  EXPECT_EQ(p.number("SphereId", 1), 5);
  EXPECT_TRUE(std::isnan(p.number("drag_N", 0)));
  EXPECT_GT(p.number("drag_N", 1), 0);
  EXPECT_EQ(p.surface()->GetNumberOfPoints(), 2562);
}

TEST(VtkSurfaceForce, SaysWhatIsMissing) {
  for (const auto& [name, text] : {std::pair("Pressure", "no Pressure found"),
                                   std::pair("PressureGradient", "no PressureGradient found"),
                                   std::pair("Velocity", "no Velocity found"),
                                   std::pair("MaterialAcceleration", "no MaterialAcceleration found")}) {
    Pipeline p(stokes());
    p.image->GetPointData()->RemoveArray(name);
    p.expectFailure(text);
  }
  Pipeline p(stokes());
  p.filter->SetInputDataObject(1, vtkSmartPointer<vtkPolyData>::New());
  p.expectFailure("the Body has no Diameter");
  Pipeline q(stokes());
  q.filter->SetDensity(0);
  q.expectFailure("Density must be greater than 0");
}

TEST(VtkSurfaceForce, WarnsOfAnotherFluid) {
  Pipeline p(stokes());
  addField(p.image, "Density", {Density}, 1);
  addField(p.image, "Viscosity", {Viscosity}, 1);
  p.filter->Update();
  EXPECT_FALSE(p.errors->GetWarning());
  p.filter->SetViscosity(2 * Viscosity);
  p.filter->Update();
  EXPECT_NE(p.errors->GetWarningMessage().find("integrated with Viscosity"), std::string::npos);
}

TEST(VtkSurfaceForce, KnowsTheTime) {
  vtkNew<ImageSeries> source;
  source->times = {0.5, 0.75};
  vtkNew<vtkImageData> box;
  fillImage(box, stokes());
  box->GetExtent(source->extent);
  source->fill = [](vtkImageData* image, double time) { fillImage(image, stokes(), time - 0.5); };
  Pipeline p;
  p.filter->SetInputConnection(0, source->GetOutputPort());
  p.filter->SetInputDataObject(1, bodyData(stokes().body));
  p.filter->UpdateInformation();
  for (int port : {0, 1})
    EXPECT_EQ(p.filter->GetOutputInformation(port)->Length(vtkStreamingDemandDrivenPipeline::TIME_STEPS()),
              2);
  for (const double time : source->times) {
    p.filter->UpdateTimeStep(time);
    EXPECT_EQ(p.number("Time"), time);
    for (vtkDataObject* output : {p.filter->GetOutputDataObject(0), p.filter->GetOutputDataObject(1)})
      EXPECT_EQ(output->GetInformation()->Get(vtkDataObject::DATA_TIME_STEP()), time);
  }
}
