// Breaks when the locator's outputs miss an array, when the order of visits changes a result, when a changed
// property or input gives an old answer, when an empty volume gives a sphere, or when the published cost runs
// without a flow.
#include "vtkInvisibleSphereLocator.h"
#include "vtkQCriterion.h"
#include "vtkSyntheticTracks.h"

#include "vtkCell.h"
#include "vtkCommand.h"
#include "vtkDataArray.h"
#include "vtkDoubleArray.h"
#include "vtkExecutive.h"
#include "vtkFieldData.h"
#include "vtkFloatArray.h"
#include "vtkImageData.h"
#include "vtkInformation.h"
#include "vtkInformationVector.h"
#include "vtkMath.h"
#include "vtkNew.h"
#include "vtkPointData.h"
#include "vtkPoints.h"
#include "vtkPolyData.h"
#include "vtkPolyDataAlgorithm.h"
#include "vtkStreamingDemandDrivenPipeline.h"
#include "vtkStringArray.h"
#include "vtkTestErrorObserver.h"

#include <array>
#include <cmath>
#include <functional>
#include <gtest/gtest.h>

namespace {

constexpr double Diameter = 0.01111;

struct Scene {
  vtkNew<vtkSyntheticTracks> tracks;
  vtkNew<vtkInvisibleSphereLocator> locator;
  vtkNew<vtkTest::ErrorObserver> errors;

  Scene() {
    tracks->SetDiameter(Diameter);
    tracks->SetDensity(2e8);
    tracks->SetNumberOfSnapshots(12);
    tracks->SetPositionNoise(5e-6);
    tracks->SetGhostFraction(0.005);
    tracks->SetSeed(7);
    locator->SetInputConnection(tracks->GetOutputPort());
    locator->SetDiameter(Diameter);
    locator->AddObserver(vtkCommand::ErrorEvent, errors);
    locator->GetExecutive()->AddObserver(vtkCommand::ErrorEvent, errors);
  }
  double time(int k) {
    tracks->UpdateInformation();
    return tracks->GetOutputInformation(0)->Get(vtkStreamingDemandDrivenPipeline::TIME_STEPS())[k];
  }
  vtkPolyData* output(int port) { return vtkPolyData::SafeDownCast(locator->GetOutputDataObject(port)); }
  vtkPolyData* at(int k, int port = 1) {
    locator->UpdateTimeStep(time(k));
    return output(port);
  }
  /// Distance of the found centre from the true one, in diameters.
  double error() {
    double found[3], truth[3];
    output(1)->GetPointData()->GetArray("Centre")->GetTuple(0, found);
    tracks->GetOutput()->GetFieldData()->GetArray("TrueCentre")->GetTuple(0, truth);
    return std::hypot(found[0] - truth[0], found[1] - truth[1], found[2] - truth[2]) / Diameter;
  }
};

/// Keeps a share of the particles that depends on the time.
struct Thinning : vtkPolyDataAlgorithm {
  vtkTypeMacro(Thinning, vtkPolyDataAlgorithm);
  static Thinning* New() {
    auto* made = new Thinning;
    made->InitializeObjectBase();
    return made;
  }
  std::function<double(double)> share = [](double) { return 1; };

  int RequestData(vtkInformation*, vtkInformationVector** inputs, vtkInformationVector* outputs) override {
    vtkPolyData *in = vtkPolyData::GetData(inputs[0]), *out = vtkPolyData::GetData(outputs);
    const double time = in->GetInformation()->Get(vtkDataObject::DATA_TIME_STEP());
    const vtkIdType all = in->GetNumberOfPoints();
    vtkNew<vtkPoints> points;
    for (vtkIdType p = 0; p < vtkIdType(share(time) * double(all)); ++p) // in a scattered order
      points->InsertNextPoint(in->GetPoint(p * 7919 % all));
    out->SetPoints(points);
    out->GetInformation()->Set(vtkDataObject::DATA_TIME_STEP(), time);
    return 1;
  }
};

struct ThinnedScene : Scene {
  vtkNew<Thinning> thinning;

  /// share(k): of the particles in snapshot k that are kept, 0 to 1.
  template <class Share>
  explicit ThinnedScene(Share share) {
    const double start = time(0), step = time(1) - time(0);
    thinning->share = [=](double t) { return share(int(std::lround((t - start) / step))); };
    thinning->SetInputConnection(tracks->GetOutputPort());
    locator->SetInputConnection(thinning->GetOutputPort());
  }
};

} // namespace

TEST(VtkInvisibleSphereLocator, EveryArrayOfTheContractOnEveryPort) {
  Scene s;
  s.at(3);
  s.at(5);
  EXPECT_LT(s.error(), 0.02);
  vtkPolyData *centre = s.output(1), *surface = s.output(0), *trajectory = s.output(2);
  ASSERT_EQ(centre->GetNumberOfPoints(), 1);
  for (const auto& [name, components] : {std::pair{"Centre", 3},
                                         {"Velocity", 3},
                                         {"Acceleration", 3},
                                         {"Covariance", 6},
                                         {"Sigma", 3},
                                         {"SigmaTensor", 9},
                                         {"Diameter", 1},
                                         {"Cost", 1},
                                         {"GradientNorm", 1},
                                         {"Iterations", 1},
                                         {"ParticlesInside", 1},
                                         {"OffsetVoid", 1},
                                         {"OffsetVelocity", 1},
                                         {"OffsetVortex", 1},
                                         {"Status", 1}}) {
    for (vtkFieldData* where :
         {static_cast<vtkFieldData*>(centre->GetPointData()), centre->GetFieldData(), surface->GetFieldData(),
          static_cast<vtkFieldData*>(trajectory->GetPointData())}) {
      ASSERT_TRUE(where->GetArray(name)) << name;
      EXPECT_EQ(where->GetArray(name)->GetNumberOfComponents(), components) << name;
      for (int c = 0; c < components; ++c)
        EXPECT_TRUE(std::isfinite(where->GetArray(name)->GetComponent(0, c))) << name;
    }
  }
  EXPECT_TRUE(centre->GetPointData()->GetAbstractArray("StatusText"));
  EXPECT_EQ(trajectory->GetNumberOfPoints(), 2);
  // the tensor is the square root of the covariance
  double c[6], t[9];
  centre->GetPointData()->GetArray("Covariance")->GetTuple(0, c);
  centre->GetPointData()->GetArray("SigmaTensor")->GetTuple(0, t);
  EXPECT_NEAR(t[0] * t[0] + t[1] * t[1] + t[2] * t[2], c[0], 1e-6 * c[0]);
  EXPECT_NEAR(t[3] * t[0] + t[4] * t[1] + t[5] * t[2], c[3], 1e-6 * c[0]);
  // the surface lies around the centre, with normals
  ASSERT_TRUE(surface->GetPointData()->GetNormals());
  double x[3], m[3];
  surface->GetPoint(10, x);
  centre->GetPoint(0, m);
  EXPECT_NEAR(std::hypot(x[0] - m[0], x[1] - m[1], x[2] - m[2]), Diameter / 2, 1e-7);
}

TEST(VtkInvisibleSphereLocator, TheOrderOfVisitsDoesNotMatter) {
  Scene forward, jumping;
  std::vector<double> first(36), second(36);
  for (int k = 0; k < 12; ++k) forward.at(k)->GetPointData()->GetArray("Centre")->GetTuple(0, &first[3 * k]);
  for (int k : {7, 0, 11, 3, 4, 10, 1, 2, 9, 5, 8, 6})
    jumping.at(k)->GetPointData()->GetArray("Centre")->GetTuple(0, &second[3 * k]);
  for (int e = 0; e < 36; ++e) EXPECT_NEAR(first[e], second[e], 2e-3 * Diameter);
  EXPECT_EQ(jumping.output(2)->GetNumberOfPoints(), 12);
}

TEST(VtkInvisibleSphereLocator, AllTimesInOneUpdate) {
  Scene s;
  s.locator->ProcessAllTimesOn();
  s.at(4);
  vtkPolyData* trajectory = s.output(2);
  ASSERT_EQ(trajectory->GetNumberOfPoints(), 12);
  EXPECT_EQ(trajectory->GetNumberOfCells(), 1);
  EXPECT_EQ(s.output(1)->GetPointData()->GetArray("Time")->GetTuple1(0), s.time(4));
  EXPECT_LT(s.error(), 0.02);
  double v[3];
  trajectory->GetPointData()->GetArray("Velocity")->GetTuple(6, v);
  EXPECT_NEAR(v[1], 0.35, 0.02 * 0.35);
  s.at(9); // nothing left to do but to show another time
  EXPECT_EQ(s.output(1)->GetPointData()->GetArray("Time")->GetTuple1(0), s.time(9));
}

TEST(VtkInvisibleSphereLocator, AllTimesTogetherAreTruerAndTellTheRotation) {
  Scene s;
  s.tracks->SetDropOut(0.1);
  s.tracks->SetVelocityNoise(2e-3);
  s.tracks->SetAngularVelocity(0, 0, 20);
  s.locator->ProcessAllTimesOn();
  const auto velocityError = [&s] { // mean, of the sphere's speed
    double sum = 0, v[3];
    for (int k = 0; k < 12; ++k) {
      s.output(2)->GetPointData()->GetArray("Velocity")->GetTuple(k, v);
      sum += std::hypot(v[0], v[1] - 0.35, v[2]) / 0.35 / 12;
    }
    return sum;
  };
  const auto field = [&s](const char* name) {
    return s.output(2)->GetFieldData()->GetArray(name)->GetTuple1(0);
  };
  s.at(4);
  EXPECT_EQ(field("JointPoints"), 12);
  EXPECT_NEAR(field("PositionNoise"), 5e-6, 1.5e-6);
  const double jointly = velocityError();
  EXPECT_LT(jointly, 0.005);
  double omega[3], sigma[3];
  s.output(2)->GetPointData()->GetArray("AngularVelocity")->GetTuple(6, omega);
  s.output(2)->GetPointData()->GetArray("AngularVelocitySigma")->GetTuple(6, sigma);
  EXPECT_NEAR(omega[2], 20, 4 * sigma[2]);
  EXPECT_GT(sigma[2], 0);
  EXPECT_LT(sigma[2], 5);
  // the Body is the sphere as the path has it, also its rotation; the centre is what the snapshot says
  for (const char* name :
       {"Centre", "Velocity", "VelocitySigma", "Acceleration", "AccelerationSigma", "AngularVelocity"})
    for (int a = 0; a < 3; ++a)
      EXPECT_EQ(s.output(0)->GetFieldData()->GetArray(name)->GetComponent(0, a),
                s.output(2)->GetPointData()->GetArray(name)->GetComponent(4, a))
          << name;
  for (int a = 0; a < 3; ++a)
    EXPECT_EQ(s.output(1)->GetFieldData()->GetArray("Centre")->GetComponent(0, a),
              s.output(2)->GetPointData()->GetArray("RawCentre")->GetComponent(4, a));
  EXPECT_EQ(s.output(1)->GetPointData()->GetArray("VelocitySigma")->GetComponent(0, 1),
            s.output(2)->GetPointData()->GetArray("VelocitySigma")->GetComponent(4, 1));

  s.locator->JointTrajectoryOff();
  s.at(4);
  EXPECT_EQ(field("JointPoints"), 0);
  EXPECT_GT(velocityError(), jointly);
  EXPECT_EQ(s.output(2)->GetPointData()->GetArray("AngularVelocitySigma")->GetComponent(6, 0), -1);
}

TEST(VtkInvisibleSphereLocator, TheWallIsTheTracersNextToIt) {
  Scene s;
  s.at(3);
  vtkPolyData* wall = s.output(3);
  ASSERT_GT(wall->GetNumberOfPoints(), 100);
  double x[3], centre[3], range[2];
  wall->GetFieldData()->GetArray("Centre")->GetTuple(0, centre);
  wall->GetPoint(17, x);
  EXPECT_NEAR(wall->GetPointData()->GetArray("Distance")->GetTuple1(17),
              std::sqrt(vtkMath::Distance2BetweenPoints(x, centre)) - 0.5 * Diameter, 1e-8);
  wall->GetPointData()->GetArray("Distance")->GetRange(range);
  EXPECT_GT(range[0], -wall->GetFieldData()->GetArray("Reach")->GetTuple1(0));
  EXPECT_NE(wall->GetPointData()->GetArray("TrackId"), nullptr);
}

TEST(VtkInvisibleSphereLocator, ADiameterThatIsWrongIsFitted) {
  Scene s;
  s.locator->SetDiameter(1.05 * Diameter);
  s.locator->SetDiameterSigma(0.1 * Diameter);
  vtkPointData* data = s.at(5)->GetPointData();
  const double sigma = data->GetArray("DiameterSigma")->GetTuple1(0);
  EXPECT_NEAR(data->GetArray("Diameter")->GetTuple1(0), Diameter, 4 * sigma);
  EXPECT_GT(sigma, 0);
  EXPECT_LT(sigma, 0.01 * Diameter);
}

TEST(VtkInvisibleSphereLocator, SeveralSpheresOnEveryPort) {
  // Tracers at rest around two spheres, in no order.
  const double at[2][3] = {{-0.009, 0.002, 0}, {0.008, -0.004, 0.001}}, diameters[2] = {0.00953, 0.00793};
  vtkNew<vtkPoints> points;
  for (int i = 0; i < 9000; ++i) {
    const double x[3] = {0.036 * std::fmod(0.8191725134 * i, 1) - 0.018,
                         0.03 * std::fmod(0.6710436067 * i, 1) - 0.015,
                         0.025 * std::fmod(0.5497004779 * i, 1) - 0.0125};
    bool fluid = true;
    for (int k = 0; k < 2; ++k)
      fluid = fluid && vtkMath::Distance2BetweenPoints(x, at[k]) > 0.25 * diameters[k] * diameters[k];
    if (fluid) points->InsertNextPoint(x);
  }
  vtkNew<vtkPolyData> tracers;
  tracers->SetPoints(points);
  vtkNew<vtkInvisibleSphereLocator> locator;
  locator->SetInputData(tracers);
  locator->SetDiameter(diameters[0]);
  locator->AddOtherDiameter(diameters[1]);
  locator->Update();
  vtkPolyData* centres = vtkPolyData::SafeDownCast(locator->GetOutputDataObject(1));
  ASSERT_EQ(centres->GetNumberOfPoints(), 2);
  for (int k = 0; k < 2; ++k) {
    EXPECT_EQ(centres->GetPointData()->GetArray("SphereId")->GetTuple1(k), k);
    EXPECT_EQ(centres->GetPointData()->GetArray("Diameter")->GetTuple1(k), diameters[k]);
    double x[3];
    centres->GetPoint(k, x);
    EXPECT_LT(std::sqrt(vtkMath::Distance2BetweenPoints(x, at[k])), 0.03 * diameters[k]);
  }
  vtkPolyData* surface = vtkPolyData::SafeDownCast(locator->GetOutputDataObject(0));
  double ids[2];
  surface->GetPointData()->GetArray("SphereId")->GetRange(ids);
  EXPECT_EQ(ids[0], 0);
  EXPECT_EQ(ids[1], 1);
  locator->ClearOtherDiameters();
  locator->Update();
  EXPECT_EQ(vtkPolyData::SafeDownCast(locator->GetOutputDataObject(1))->GetNumberOfPoints(), 1);
}

TEST(VtkInvisibleSphereLocator, TheTrajectoryBridgesLostSnapshots) {
  ThinnedScene s([](int k) { return k == 5 || k == 6 ? 1e-4 : 1; });
  s.locator->ProcessAllTimesOn();
  s.at(4);
  vtkPolyData* trajectory = s.output(2);
  ASSERT_EQ(trajectory->GetNumberOfPoints(), 12);
  EXPECT_EQ(trajectory->GetCell(0)->GetNumberOfPoints(), 12);
  vtkPointData* p = trajectory->GetPointData();
  double velocity[3];
  s.tracks->GetVelocity(velocity);
  for (int k = 0; k < 12; ++k) {
    const bool lost = k == 5 || k == 6;
    EXPECT_EQ(p->GetArray("Time")->GetTuple1(k), s.time(k));
    EXPECT_EQ(p->GetArray("Status")->GetTuple1(k), lost ? 1 : 0);
    EXPECT_EQ(std::isnan(p->GetArray("RawCentre")->GetComponent(k, 1)), lost);
    for (int a = 0; a < 3; ++a) { // uniform motion
      const double expected =
          p->GetArray("Centre")->GetComponent(0, a) + velocity[a] * (s.time(k) - s.time(0));
      EXPECT_NEAR(p->GetArray("Centre")->GetComponent(k, a), expected, 0.02 * Diameter);
      EXPECT_NEAR(trajectory->GetPoint(k)[a], p->GetArray("Centre")->GetComponent(k, a), 1e-12);
    }
    // the tensor is the square root of the smoothed covariance
    double t[9];
    p->GetArray("SigmaTensor")->GetTuple(k, t);
    EXPECT_NEAR((t[0] * t[0] + t[1] * t[1] + t[2] * t[2]) / p->GetArray("Covariance")->GetComponent(k, 0), 1,
                1e-6);
  }
  s.at(5);
  EXPECT_EQ(s.output(1)->GetNumberOfPoints(), 0); // by itself the snapshot says nothing
  EXPECT_EQ(s.output(1)->GetFieldData()->GetArray("Status")->GetTuple1(0), 2);
  EXPECT_GT(s.output(0)->GetNumberOfPoints(), 0); // but the path goes through it
  EXPECT_EQ(s.output(0)->GetFieldData()->GetArray("Status")->GetTuple1(0), 1);
}

TEST(VtkInvisibleSphereLocator, AllTimesGoBackToWhatWasLostAtFirst) {
  // 0.2 particles per mm3, and 0.026 in the first snapshots: too few to find the sphere without a hint
  ThinnedScene s([](int k) { return k < 2 ? 0.13 : 1; });
  s.at(1);
  s.at(0);
  EXPECT_EQ(s.output(2)->GetNumberOfPoints(), 0);
  s.locator->ProcessAllTimesOn();
  s.at(8);
  EXPECT_EQ(s.output(1)->GetPointData()->GetArray("Time")->GetTuple1(0), s.time(8));
  vtkPointData* trajectory = s.output(2)->GetPointData();
  ASSERT_EQ(trajectory->GetArray("Time")->GetNumberOfTuples(), 12);
  for (int k = 0; k < 12; ++k) EXPECT_EQ(trajectory->GetArray("Status")->GetTuple1(k), 0) << k;
  s.at(1);
  ASSERT_EQ(s.output(1)->GetNumberOfPoints(), 1);
  EXPECT_LT(s.error(), 0.15);

  ThinnedScene scrubbed([](int k) { return k < 2 ? 0.13 : 1; }); // all times were seen one by one before
  for (int k = 0; k < 12; ++k) scrubbed.at(k);
  EXPECT_EQ(scrubbed.output(2)->GetPointData()->GetArray("Status")->GetTuple1(0), 1);
  scrubbed.locator->ProcessAllTimesOn();
  scrubbed.at(8);
  for (int k = 0; k < 12; ++k)
    EXPECT_EQ(scrubbed.output(2)->GetPointData()->GetArray("Status")->GetTuple1(k), 0) << k;
}

TEST(VtkInvisibleSphereLocator, ForgetsWhatNoLongerHolds) {
  Scene s;
  s.at(2);
  s.at(3);
  s.locator->SetDiameter(0.9 * Diameter);
  EXPECT_EQ(s.at(3, 2)->GetNumberOfPoints(), 1); // the trajectory starts anew
  s.locator->SetDiameter(Diameter);
  const double before = s.at(3)->GetPointData()->GetArray("Centre")->GetComponent(0, 1);
  s.tracks->SetCentre(0, 3e-3, 0);
  EXPECT_NEAR(s.at(3)->GetPointData()->GetArray("Centre")->GetComponent(0, 1) - before, 3e-3,
              0.05 * Diameter);
}

TEST(VtkInvisibleSphereLocator, SaysThatThereIsNoSphere) {
  Scene s;
  s.tracks->SetDiameter(0);
  s.tracks->SetFlow(vtkSyntheticTracks::TAYLOR_GREEN);
  s.at(2);
  EXPECT_EQ(s.output(0)->GetNumberOfPoints(), 0);
  EXPECT_EQ(s.output(1)->GetNumberOfPoints(), 0);
  EXPECT_EQ(s.output(1)->GetFieldData()->GetArray("Status")->GetTuple1(0), 2);
  EXPECT_FALSE(vtkStringArray::SafeDownCast(s.output(1)->GetFieldData()->GetAbstractArray("StatusText"))
                   ->GetValue(0)
                   .empty());
  EXPECT_FALSE(s.errors->GetError());
}

TEST(VtkInvisibleSphereLocator, PublishedCostNeedsAFlow) {
  Scene s;
  s.locator->SetMethodToPublishedCost();
  s.at(2);
  EXPECT_EQ(s.errors->CheckErrorMessage("connect the output of Q-Criterion"), 0);
  EXPECT_EQ(s.output(1)->GetNumberOfPoints(), 0);
}

TEST(VtkInvisibleSphereLocator, PublishedCostFindsThePlaceToAFractionOfTheDiameter) {
  // The exact flow on a grid: potential flow around the sphere, rigid motion inside.
  Scene s;
  double centre[3];
  s.tracks->UpdateTimeStep(s.time(5));
  s.tracks->GetOutput()->GetFieldData()->GetArray("TrueCentre")->GetTuple(0, centre);
  vtkNew<vtkImageData> flow;
  flow->SetDimensions(45, 65, 35);
  flow->SetSpacing(0.7e-3, 0.7e-3, 0.7e-3);
  flow->SetOrigin(-15.4e-3, -22.4e-3, -11.9e-3);
  vtkNew<vtkFloatArray> u;
  u->SetName("Velocity");
  u->SetNumberOfComponents(3);
  u->SetNumberOfTuples(flow->GetNumberOfPoints());
  for (vtkIdType p = 0; p < flow->GetNumberOfPoints(); ++p) {
    double x[3];
    flow->GetPoint(p, x);
    const double r[3] = {x[0] - centre[0], x[1] - centre[1], x[2] - centre[2]},
                 d = std::hypot(r[0], r[1], r[2]);
    const double a = Diameter / 2, k = d > a ? 0.35 * std::pow(a / d, 3) / 2 : 0;
    u->SetTuple3(p, 3 * k * r[1] * r[0] / (d * d), d > a ? k * (3 * r[1] * r[1] / (d * d) - 1) : 0.35,
                 3 * k * r[1] * r[2] / (d * d));
  }
  flow->GetPointData()->AddArray(u);
  vtkNew<vtkQCriterion> q;
  q->SetInputData(flow);
  s.locator->SetMethodToPublishedCost();
  s.locator->SetInputConnection(1, q->GetOutputPort());
  s.at(5);
  ASSERT_EQ(s.output(1)->GetNumberOfPoints(), 1);
  EXPECT_LT(s.error(), 0.5); // the published weights do not aim at the true centre
  EXPECT_GE(s.output(1)->GetPointData()->GetArray("OffsetVortex")->GetTuple1(0), 0);
  EXPECT_EQ(s.output(3)->GetNumberOfPoints(), 0); // its path is no void's

  // Unless told otherwise, up is where the sphere goes: here +y. The properties reach the search.
  const auto centreNow = [&] {
    s.at(5);
    std::array<double, 3> x;
    s.output(1)->GetPoint(0, x.data());
    return x;
  };
  const auto free = centreNow();
  const auto moved = [&](const std::array<double, 3>& x) {
    return std::sqrt(vtkMath::Distance2BetweenPoints(x.data(), free.data())) / Diameter;
  };
  s.locator->SetUpDirection(0, 2, 0);
  EXPECT_LT(moved(centreNow()), 0.02);
  s.locator->SetUpDirection(0, -1, 0);
  EXPECT_GT(moved(centreNow()), 0.05);
  s.locator->SetUpDirection(0, 0, 0);
  s.locator->SetTolerance(1e9);
  s.at(5);
  EXPECT_EQ(s.output(1)->GetPointData()->GetArray("Iterations")->GetTuple1(0), 0);
}

TEST(VtkInvisibleSphereLocator, RefusesADiameterOfZero) {
  Scene s;
  s.locator->SetDiameter(0);
  s.at(1);
  EXPECT_EQ(s.errors->CheckErrorMessage("greater than 0"), 0);
}
