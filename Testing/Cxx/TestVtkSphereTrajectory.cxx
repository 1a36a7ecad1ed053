// Breaks when vtkSphereTrajectoryReader puts out another place, motion or status than the file's, other
// arrays than its header says, or anything after an error; and when vtkSphereTrajectoryWriter writes another
// path than its input's or leaves a file after an error.
#include "../Kernels/TrackFiles.h"
#include "vtkSphereTrajectoryReader.h"
#include "vtkSphereTrajectoryWriter.h"

#include "vtkCellArray.h"
#include "vtkCommand.h"
#include "vtkDataArray.h"
#include "vtkDoubleArray.h"
#include "vtkExecutive.h"
#include "vtkFieldData.h"
#include "vtkInformation.h"
#include "vtkIntArray.h"
#include "vtkNew.h"
#include "vtkPointData.h"
#include "vtkPoints.h"
#include "vtkPolyData.h"
#include "vtkStreamingDemandDrivenPipeline.h"
#include "vtkStringArray.h"
#include "vtkTestErrorObserver.h"

#include <cmath>
#include <fstream>
#include <gtest/gtest.h>
#include <sstream>
#include <string>

namespace {

using testing_tracks::Folder;
using Pipeline = vtkStreamingDemandDrivenPipeline;

/// x = 1 mm + 0.3 m/s t, y = 2 m/s2 t^2 / 2, z = 0 at t = k ms; rows 20 to 39 and row 50 are lost.
/// z scatters by 0.01 mm on request.
std::string fileText(bool scatters = false) {
  std::string text = "TITLE = \"test\"\nVARIABLES = \"Time[ms]\" \"x\" \"y\" \"z\"\nDIAMETER=11.11[mm]\n"
                     "SOLID/FLUID DENSITY RATIO=0.65\n";
  for (int k = 0; k < 80; ++k) {
    const bool lost = (k >= 20 && k < 40) || k == 50;
    text += std::to_string(k) + (lost ? " NaN NaN NaN\n"
                                      : " " + testing_tracks::print("%.9f", 1 + 0.3 * k) + " " +
                                            testing_tracks::print("%.9f", 1e-3 * k * k) + " " +
                                            (scatters && k % 2 ? "0.02\n" : "0\n"));
  }
  return text;
}

struct Reader {
  Folder folder;
  vtkNew<vtkSphereTrajectoryReader> reader;
  vtkNew<vtkTest::ErrorObserver> errors;
  explicit Reader(const std::string& text = fileText()) {
    reader->SetFileName(folder.write("sphere.dat", text).c_str());
    reader->AddObserver(vtkCommand::ErrorEvent, errors);
    reader->AddObserver(vtkCommand::WarningEvent, errors);
    reader->GetExecutive()->AddObserver(vtkCommand::ErrorEvent, errors);
  }
  vtkPolyData* at(double time, int port = 0) {
    reader->UpdateTimeStep(time, -1, 1, 0, nullptr);
    return vtkPolyData::SafeDownCast(reader->GetOutputDataObject(port));
  }
  static double number(vtkPolyData* data, const char* name, int component = 0) {
    vtkDataArray* array = data->GetFieldData()->GetArray(name);
    return array ? array->GetComponent(0, component) : -999;
  }
};

TEST(SphereTrajectoryReader, putsOutTheSphereAsABody) {
  Reader r;
  vtkPolyData* sphere = r.at(0.010);
  EXPECT_FALSE(r.errors->GetError() || r.errors->GetWarning());
  EXPECT_NE(sphere->GetPointData()->GetNormals(), nullptr);
  double bounds[6];
  sphere->GetBounds(bounds);
  EXPECT_NEAR(0.5 * (bounds[2] + bounds[3]), 1e-4, 1e-6);
  EXPECT_NEAR(bounds[3] - bounds[2], 0.01111, 1e-4);
  vtkPolyData* centre = vtkPolyData::SafeDownCast(r.reader->GetOutputDataObject(1));
  ASSERT_EQ(centre->GetNumberOfPoints(), 1);
  EXPECT_EQ(centre->GetNumberOfVerts(), 1);
  for (vtkPolyData* data : {sphere, centre}) {
    EXPECT_DOUBLE_EQ(Reader::number(data, "Time"), 0.010);
    EXPECT_NEAR(Reader::number(data, "Centre", 0), 4e-3, 1e-15);
    EXPECT_NEAR(Reader::number(data, "Centre", 1), 1e-4, 1e-15);
    EXPECT_NEAR(Reader::number(data, "Velocity", 0), 0.3, 1e-7);
    EXPECT_NEAR(Reader::number(data, "Velocity", 1), 0.02, 1e-7);
    EXPECT_NEAR(Reader::number(data, "Acceleration", 1), 2, 1e-4);
    EXPECT_DOUBLE_EQ(Reader::number(data, "Diameter"), 0.01111);
    EXPECT_EQ(Reader::number(data, "Status"), 0);
    EXPECT_EQ(Reader::number(data, "DensityRatio"), 0.65);
    EXPECT_NE(data->GetFieldData()->GetAbstractArray("StatusText"), nullptr);
    EXPECT_EQ(data->GetInformation()->Get(vtkDataObject::DATA_TIME_STEP()), 0.010);
  }
  EXPECT_EQ(centre->GetPointData()->GetArray("Covariance"), nullptr); // a smooth path does not tell it
}

TEST(SphereTrajectoryReader, tellsTheUncertaintyOfAPathThatScatters) {
  Reader r(fileText(true));
  vtkPolyData* sphere = r.at(0.010);
  EXPECT_NEAR(Reader::number(sphere, "Sigma", 2), 1e-5, 2e-6);
  EXPECT_LT(Reader::number(sphere, "Sigma", 0), 1e-9);
  EXPECT_NEAR(Reader::number(sphere, "Covariance", 2), 1e-10, 4e-11);
  EXPECT_NEAR(Reader::number(sphere, "SigmaTensor", 8), 1e-5, 2e-6);
  EXPECT_GT(Reader::number(sphere, "AccelerationSigma", 2), 0.1);
  EXPECT_GT(Reader::number(sphere, "VelocitySigma", 2), 1e-4);
}

TEST(SphereTrajectoryReader, interpolatesPredictsAndLoses) {
  Reader r;
  vtkPolyData* sphere = r.at(0.0105); // between two rows
  EXPECT_EQ(Reader::number(sphere, "Status"), 0);
  EXPECT_NEAR(Reader::number(sphere, "Centre", 0), 4.15e-3, 1e-12);
  EXPECT_NEAR(Reader::number(sphere, "Centre", 1), 0.0105 * 0.0105, 1e-12);
  EXPECT_EQ(sphere->GetInformation()->Get(vtkDataObject::DATA_TIME_STEP()), 0.0105);
  sphere = r.at(0.050); // one lost row
  EXPECT_EQ(Reader::number(sphere, "Status"), 1);
  EXPECT_NEAR(Reader::number(sphere, "Centre", 0), 16e-3, 1e-12);
  for (const double lost : {0.030, -0.001, 0.081}) {
    SCOPED_TRACE(lost);
    sphere = r.at(lost);
    EXPECT_EQ(sphere->GetNumberOfPoints(), 0);
    EXPECT_EQ(Reader::number(sphere, "Status"), 2);
    EXPECT_EQ(sphere->GetFieldData()->GetArray("Centre"), nullptr);
    EXPECT_DOUBLE_EQ(Reader::number(sphere, "Diameter"), 0.01111);
    EXPECT_EQ(r.at(lost, 1)->GetNumberOfPoints(), 0);
  }
  EXPECT_FALSE(r.errors->GetError());
}

TEST(SphereTrajectoryReader, publishesTimesAndThePath) {
  Reader r;
  r.reader->SetTimeShift(5);
  r.reader->UpdateInformation();
  for (int port = 0; port < 3; ++port) {
    vtkInformation* out = r.reader->GetOutputInformation(port);
    ASSERT_EQ(out->Length(Pipeline::TIME_STEPS()), 80);
    EXPECT_DOUBLE_EQ(out->Get(Pipeline::TIME_STEPS())[79], 5.079);
    EXPECT_DOUBLE_EQ(out->Get(Pipeline::TIME_RANGE())[1], 5.079);
  }
  vtkPolyData* path = r.at(5.03, 2);
  EXPECT_EQ(path->GetNumberOfLines(), 2); // broken by the long loss
  vtkDataArray* status = path->GetPointData()->GetArray("Status");
  int found = 0, predicted = 0;
  for (vtkIdType p = 0; p < path->GetNumberOfPoints(); ++p) {
    found += status->GetTuple1(p) == 0;
    predicted += status->GetTuple1(p) == 1;
    EXPECT_TRUE(std::isfinite(path->GetPoint(p)[0]));
  }
  EXPECT_EQ(found, 59);
  EXPECT_EQ(predicted, 1);
  EXPECT_EQ(path->GetPointData()->GetArray("Velocity")->GetNumberOfTuples(), path->GetNumberOfPoints());
  // a file that has changed is read anew
  r.folder.write("sphere.dat", "VARIABLES = \"Time\" x y z\nDIAMETER=5\n0.5 0 0 0\n");
  r.reader->UpdateInformation();
  r.reader->Modified();
  r.reader->UpdateInformation();
  EXPECT_EQ(r.reader->GetOutputInformation(0)->Length(Pipeline::TIME_STEPS()), 1);
  vtkPolyData* sphere = r.at(5.5);
  EXPECT_EQ(Reader::number(sphere, "Diameter"), 0.005);
  EXPECT_EQ(sphere->GetFieldData()->GetArray("Velocity"), nullptr); // one place is no motion
}

TEST(SphereTrajectoryReader, anErrorLeavesTheOutputsEmpty) {
  Reader r;
  r.at(0.01);
  r.folder.write("sphere.dat", "VARIABLES = \"Time\" \"x\" \"y\" \"z\"\n0 1 2 3\n");
  r.reader->Modified();
  r.at(0.01);
  const std::string message = r.errors->GetErrorMessage();
  EXPECT_NE(message.find("sphere.dat, line 1: the header has no DIAMETER"), std::string::npos) << message;
  for (int port = 0; port < 3; ++port)
    EXPECT_EQ(vtkPolyData::SafeDownCast(r.reader->GetOutputDataObject(port))->GetNumberOfPoints(), 0);
  r.errors->Clear();
  r.reader->SetDiameter(0.01);
  EXPECT_GT(r.at(0)->GetNumberOfPoints(), 100);
  EXPECT_FALSE(r.errors->GetError());
  r.reader->SetPolynomialOrder(5);
  r.reader->SetPolynomialWindow(4);
  r.at(0);
  EXPECT_NE(r.errors->GetErrorMessage().find("window greater than the order"), std::string::npos);
  r.errors->Clear();
  r.reader->SetFileName("");
  r.at(0);
  EXPECT_NE(r.errors->GetErrorMessage().find("Set FileName"), std::string::npos);
}

struct Writer {
  Folder folder;
  vtkNew<vtkSphereTrajectoryWriter> writer;
  vtkNew<vtkTest::ErrorObserver> errors;
  vtkNew<vtkPolyData> path;
  Writer() {
    writer->SetFileName((folder / "out.dat").c_str());
    writer->AddObserver(vtkCommand::ErrorEvent, errors);
    writer->SetInputData(path);
    vtkNew<vtkPoints> points;
    points->SetDataTypeToDouble();
    vtkNew<vtkDoubleArray> time, diameter;
    vtkNew<vtkIntArray> status, id;
    time->SetName("Time"), diameter->SetName("Diameter"), status->SetName("Status"), id->SetName("SphereId");
    for (const auto& [t, s] : {std::pair(0.3, 1), std::pair(0.1, 0), std::pair(0.2, 2)})
      for (int sphere = 0; sphere < 2; ++sphere) {
        points->InsertNextPoint(t, 0.01 * sphere, 0);
        time->InsertNextValue(t);
        diameter->InsertNextValue(0.01 * (1 + sphere));
        status->InsertNextValue(s);
        id->InsertNextValue(sphere);
      }
    path->SetPoints(points);
    for (vtkDataArray* array : std::initializer_list<vtkDataArray*>{time, diameter, status, id})
      path->GetPointData()->AddArray(array);
  }
  std::string text() const {
    std::ostringstream all;
    all << std::ifstream(folder / "out.dat").rdbuf();
    return all.str();
  }
};

TEST(SphereTrajectoryWriter, writesOneSphereInTheOrderOfTime) {
  Writer w;
  w.writer->SetDensityRatio(0.65);
  EXPECT_EQ(w.writer->Write(), 1);
  const std::string header = "TITLE = \"Sphere trajectory: time in s, positions in mm\"\n"
                             "VARIABLES = \"Time\" \"x\" \"y\" \"z\"\n";
  EXPECT_EQ(w.text(), header + "DIAMETER=10[mm]\nSOLID/FLUID DENSITY RATIO=0.65\n"
                               "0.1 100.000000000 0.000000000 0.000000000\n0.2 NaN NaN NaN\n"
                               "0.3 300.000000000 0.000000000 0.000000000\n");
  w.writer->SetSphereId(1);
  w.writer->SetDensityRatio(0);
  EXPECT_EQ(w.writer->Write(), 1);
  EXPECT_EQ(w.text(), header + "DIAMETER=20[mm]\n0.1 100.000000000 10.000000000 0.000000000\n"
                               "0.2 NaN NaN NaN\n0.3 300.000000000 10.000000000 0.000000000\n");
  EXPECT_FALSE(w.errors->GetError());
}

TEST(SphereTrajectoryWriter, saysWhatIsMissing) {
  const auto complaint = [](auto&& spoil) {
    Writer w;
    spoil(w);
    EXPECT_EQ(w.writer->Write(), 0);
    EXPECT_EQ(w.text(), "");
    return w.errors->GetErrorMessage();
  };
  const auto says = [&](const std::string& words, auto&& spoil) {
    const std::string message = complaint(spoil);
    EXPECT_NE(message.find(words), std::string::npos) << message;
  };
  says("no points", [](Writer& w) { w.path->Initialize(); });
  says("no point array Time", [](Writer& w) { w.path->GetPointData()->RemoveArray("Time"); });
  says("diameter is 0 m", [](Writer& w) { w.path->GetPointData()->RemoveArray("Diameter"); });
  says("more than once", [](Writer& w) { w.path->GetPointData()->RemoveArray("SphereId"); });
  says("no sphere with the SphereId 5", [](Writer& w) { w.writer->SetSphereId(5); });
  says("Set FileName", [](Writer& w) { w.writer->SetFileName(""); });
  says("cannot be written", [](Writer& w) { w.writer->SetFileName((w.folder / "no/out.dat").c_str()); });
}

} // namespace
