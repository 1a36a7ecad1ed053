#include "vtkSphereTrajectoryReader.h"

#include "MappedFile.h"
#include "SphereMotion.h"
#include "SphereTrajectoryFile.h"
#include "TrackMessages.h"
#include "vtkBodyOutput.h"

#include "vtkCellArray.h"
#include "vtkDoubleArray.h"
#include "vtkInformation.h"
#include "vtkInformationVector.h"
#include "vtkIntArray.h"
#include "vtkNew.h"
#include "vtkObjectFactory.h"
#include "vtkPoints.h"
#include "vtkStreamingDemandDrivenPipeline.h"
#include "vtkStringArray.h"

#include <algorithm>
#include <stdexcept>

vtkStandardNewMacro(vtkSphereTrajectoryReader);

namespace {

using rimflow::CentreStatus;
using rimflow::SphereState;

// No measurement knows a sphere's centre to a millionth of its diameter: a path that scatters less was
// smoothed before, and says nothing of its error.
constexpr double LeastNoise = 1e-6;

struct Row {
  double time;
  SphereState state;
  std::string text;
};

Eigen::Matrix<double, 6, 1> packedCovariance(const SphereState& s) {
  Eigen::Matrix<double, 6, 1> c = Eigen::Matrix<double, 6, 1>::Zero();
  c.head<3>() = s.sigma.cwiseAbs2();
  return c;
}

/// Adds the values of all rows, but not when no row has any.
template <class F>
void add(vtkPolyData* data, const char* name, const std::vector<Row>& rows, F&& value) {
  vtkNew<vtkDoubleArray> array;
  array->SetName(name);
  bool any = false;
  for (const Row& row : rows) {
    const auto v = value(row);
    array->SetNumberOfComponents(int(v.size()));
    array->InsertNextTuple(v.data());
    any = any || v.allFinite();
  }
  if (any) data->GetPointData()->AddArray(array);
}

vtkSmartPointer<vtkPolyData> pointsOf(const std::vector<Row>& rows, double diameter) {
  auto data = vtkSmartPointer<vtkPolyData>::New();
  vtkNew<vtkPoints> points;
  vtkNew<vtkIntArray> status;
  vtkNew<vtkStringArray> text;
  points->SetDataTypeToDouble();
  status->SetName("Status");
  text->SetName("StatusText");
  for (const Row& row : rows) {
    points->InsertNextPoint(row.state.centre.data());
    status->InsertNextValue(int(row.state.status));
    text->InsertNextValue(row.text);
  }
  data->SetPoints(points);
  using One = Eigen::Matrix<double, 1, 1>;
  add(data, "Time", rows, [](const Row& r) { return One(r.time); });
  add(data, "Centre", rows, [](const Row& r) { return r.state.centre; });
  add(data, "Velocity", rows, [](const Row& r) { return r.state.velocity; });
  add(data, "Acceleration", rows, [](const Row& r) { return r.state.acceleration; });
  add(data, "Covariance", rows, [](const Row& r) { return packedCovariance(r.state); });
  add(data, "Sigma", rows, [](const Row& r) { return r.state.sigma; });
  add(data, "SigmaTensor", rows, [](const Row& r) {
    return Eigen::Matrix3d(r.state.sigma.asDiagonal()).reshaped<Eigen::RowMajor>().eval();
  });
  add(data, "VelocitySigma", rows, [](const Row& r) { return r.state.velocitySigma; });
  add(data, "AccelerationSigma", rows, [](const Row& r) { return r.state.accelerationSigma; });
  add(data, "Diameter", rows, [&](const Row&) { return One(diameter); });
  data->GetPointData()->AddArray(status);
  data->GetPointData()->AddArray(text);
  return data;
}

} // namespace

/// The file as it was read, and the motion in it.
struct vtkSphereTrajectoryReader::Opened {
  rimflow::FileStamp stamp;
  vtkMTimeType settings = 0; // the reader's MTime
  rimflow::SphereTrajectory file;
  std::unique_ptr<rimflow::SphereMotion> motion;
  vtkSmartPointer<vtkPolyData> trajectory;

  std::string textOf(double time, const SphereState& state) const {
    const std::vector<double>& times = motion->times();
    const auto seconds = [](double t) { return rimflow::shortNumber(t) + " s"; };
    if (time < times.front()) return "before the first row of the file, at " + seconds(times.front());
    if (time > times.back()) return "after the last row of the file, at " + seconds(times.back());
    if (state.status == CentreStatus::Lost)
      return "the file has no place near this time: the sphere was lost, or its rows are too far apart";
    if (state.status == CentreStatus::Predicted) return "predicted from the neighbouring rows of the file";
    const bool isRow = std::binary_search(times.begin(), times.end(), time);
    return isRow ? "a row of the file" : "between two rows of the file";
  }
  Row at(double time) const {
    const SphereState state = motion->at(time);
    return {time, state, textOf(time, state)};
  }
  void buildTrajectory() {
    std::vector<Row> rows;
    for (const double t : motion->times())
      if (const Row row = at(t); row.state.status != CentreStatus::Lost) rows.push_back(row);
    trajectory = pointsOf(rows, file.diameter);
    // one line from loss to loss
    vtkNew<vtkCellArray> lines, vertices;
    for (std::size_t begin = 0, end = 0; begin < rows.size(); begin = end) {
      for (end = begin + 1; end < rows.size(); ++end)
        if (motion->at(0.5 * (rows[end - 1].time + rows[end].time)).status == CentreStatus::Lost) break;
      vtkCellArray* cells = end - begin > 1 ? lines : vertices;
      cells->InsertNextCell(int(end - begin));
      for (std::size_t i = begin; i < end; ++i) cells->InsertCellPoint(vtkIdType(i));
    }
    trajectory->SetVerts(vertices);
    trajectory->SetLines(lines);
  }
};

vtkSphereTrajectoryReader::vtkSphereTrajectoryReader() {
  this->SetNumberOfInputPorts(0);
  this->SetNumberOfOutputPorts(3);
}
vtkSphereTrajectoryReader::~vtkSphereTrajectoryReader() = default;

void vtkSphereTrajectoryReader::SetFileName(const char* name) {
  const std::string given = name ? name : "";
  if (given == this->FileName) return;
  this->FileName = given;
  this->Modified();
}

int vtkSphereTrajectoryReader::CanReadFile(const char* name) {
  return name && rimflow::looksLikeSphereTrajectory(name);
}

int vtkSphereTrajectoryReader::RequestInformation(vtkInformation*, vtkInformationVector**,
                                                  vtkInformationVector* outputs) {
  using Pipeline = vtkStreamingDemandDrivenPipeline;
  try {
    if (this->FileName.empty()) throw std::runtime_error("No file name was given. Set FileName.");
    const rimflow::FileStamp stamp = rimflow::stampOf(this->FileName);
    if (!this->Open || this->Open->stamp != stamp || this->Open->settings != this->GetMTime()) {
      auto fresh = std::make_unique<Opened>();
      fresh->stamp = stamp;
      fresh->settings = this->GetMTime();
      std::vector<std::string> warnings;
      fresh->file = rimflow::readSphereTrajectory(
          this->FileName,
          {this->FramePeriod, this->TimeShift, this->Diameter, rimflow::LengthUnit(this->LengthUnit)},
          warnings);
      fresh->motion = std::make_unique<rimflow::SphereMotion>(
          fresh->file.time, fresh->file.centre,
          rimflow::SphereMotionOptions{this->PolynomialOrder, this->PolynomialWindow,
                                       LeastNoise * fresh->file.diameter});
      fresh->buildTrajectory();
      this->Open = std::move(fresh);
      for (const std::string& w : warnings) vtkWarningMacro(<< w);
    }
  } catch (const std::exception& problem) {
    this->Open.reset();
    for (int port = 0; port < 3; ++port) {
      outputs->GetInformationObject(port)->Remove(Pipeline::TIME_STEPS());
      outputs->GetInformationObject(port)->Remove(Pipeline::TIME_RANGE());
      if (vtkPolyData* output = vtkPolyData::GetData(outputs, port)) output->Initialize();
    }
    vtkErrorMacro(<< problem.what());
    return 0;
  }
  const std::vector<double>& times = this->Open->motion->times();
  const double range[2] = {times.front(), times.back()};
  for (int port = 0; port < 3; ++port) {
    vtkInformation* information = outputs->GetInformationObject(port);
    information->Set(Pipeline::TIME_STEPS(), times.data(), int(times.size()));
    information->Set(Pipeline::TIME_RANGE(), range, 2);
  }
  return 1;
}

int vtkSphereTrajectoryReader::RequestData(vtkInformation* request, vtkInformationVector**,
                                           vtkInformationVector* outputs) {
  using Pipeline = vtkStreamingDemandDrivenPipeline;
  vtkPolyData *sphere = vtkPolyData::GetData(outputs, 0), *centre = vtkPolyData::GetData(outputs, 1),
              *trajectory = vtkPolyData::GetData(outputs, 2);
  for (vtkPolyData* output : {sphere, centre, trajectory}) output->Initialize();
  if (!this->Open) return 0;
  const Opened& open = *this->Open;
  vtkInformation* asked =
      outputs->GetInformationObject(std::max(0, request->Get(vtkExecutive::FROM_OUTPUT_PORT())));
  const double time = asked->Has(Pipeline::UPDATE_TIME_STEP()) ? asked->Get(Pipeline::UPDATE_TIME_STEP())
                                                               : open.motion->times().front();
  const Row here = open.at(time);
  trajectory->ShallowCopy(open.trajectory);
  if (here.state.status == CentreStatus::Lost) {
    for (vtkPolyData* output : {sphere, centre})
      rimflow::addLostBody(output, time, open.file.diameter, here.text);
  } else {
    centre->ShallowCopy(pointsOf({here}, open.file.diameter));
    vtkNew<vtkCellArray> vertex;
    const vtkIdType first = 0;
    vertex->InsertNextCell(1, &first);
    centre->SetVerts(vertex);
    sphere->ShallowCopy(
        rimflow::sphereSurface(here.state.centre.data(), open.file.diameter, this->SphereResolution));
    rimflow::pointsToFieldData(centre, centre);
    rimflow::pointsToFieldData(centre, sphere);
  }
  for (vtkPolyData* output : {sphere, centre, trajectory}) {
    if (open.file.densityRatio > 0) rimflow::addNumber(output, "DensityRatio", open.file.densityRatio);
    output->GetInformation()->Set(vtkDataObject::DATA_TIME_STEP(), time);
  }
  return 1;
}

void vtkSphereTrajectoryReader::PrintSelf(ostream& os, vtkIndent indent) {
  this->Superclass::PrintSelf(os, indent);
  os << indent << "FileName: " << this->FileName << "\n"
     << indent << "Diameter: " << this->Diameter << "\n"
     << indent << "FramePeriod: " << this->FramePeriod << "\n"
     << indent << "TimeShift: " << this->TimeShift << "\n"
     << indent << "LengthUnit: " << this->LengthUnit << "\n"
     << indent << "PolynomialOrder: " << this->PolynomialOrder << "\n"
     << indent << "PolynomialWindow: " << this->PolynomialWindow << "\n"
     << indent << "SphereResolution: " << this->SphereResolution << "\n";
}
