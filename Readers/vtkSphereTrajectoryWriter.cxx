#include "vtkSphereTrajectoryWriter.h"

#include "SphereTrajectoryFile.h"
#include "vtkBodyFromPolyData.h"

#include "vtkErrorCode.h"
#include "vtkInformation.h"
#include "vtkObjectFactory.h"
#include "vtkPolyData.h"
#include "vtkStreamingDemandDrivenPipeline.h"

#include <algorithm>
#include <limits>
#include <map>
#include <set>
#include <stdexcept>

vtkStandardNewMacro(vtkSphereTrajectoryWriter);

namespace {

const Eigen::Vector3d Lost = Eigen::Vector3d::Constant(std::numeric_limits<double>::quiet_NaN());

vtkDataArray* pointArray(vtkPolyData* data, const char* name, int components) {
  vtkDataArray* array = data->GetPointData()->GetArray(name);
  return array && array->GetNumberOfComponents() == components ? array : nullptr;
}

/// The rows of one sphere by their times.
std::map<double, Eigen::Vector3d> placesOf(vtkPolyData* data, int sphere) {
  vtkDataArray* time = pointArray(data, "Time", 1);
  if (!time || data->GetNumberOfPoints() == 0)
    throw std::invalid_argument(
        data->GetNumberOfPoints() == 0
            ? "the input has no points. Save the Trajectory output, after its times have been visited"
            : "the input has no point array Time. Save the Trajectory output of the Invisible Sphere "
              "Locator, "
              "the Trajectory Smoother or the Sphere Trajectory Reader");
  vtkDataArray *centre = pointArray(data, "Centre", 3), *status = pointArray(data, "Status", 1),
               *id = pointArray(data, "SphereId", 1);
  std::map<double, Eigen::Vector3d> places;
  for (vtkIdType p = 0; p < data->GetNumberOfPoints(); ++p) {
    if (id && id->GetTuple1(p) != sphere) continue;
    Eigen::Vector3d x = Lost;
    if (!status || status->GetTuple1(p) != 2) {
      if (centre)
        centre->GetTuple(p, x.data());
      else
        data->GetPoint(p, x.data());
    }
    if (!places.emplace(time->GetTuple1(p), x).second)
      throw std::invalid_argument("the time " + std::to_string(time->GetTuple1(p)) +
                                  " s occurs more than once. A file holds the path of one sphere");
  }
  if (places.empty())
    throw std::invalid_argument("the input has no sphere with the SphereId " + std::to_string(sphere));
  return places;
}

/// The pipeline's other times, when the places are at times of the pipeline.
void addLostTimes(vtkInformation* input, std::map<double, Eigen::Vector3d>& places) {
  using Pipeline = vtkStreamingDemandDrivenPipeline;
  if (!input->Has(Pipeline::TIME_STEPS())) return;
  const double* steps = input->Get(Pipeline::TIME_STEPS());
  const std::set<double> times(steps, steps + input->Length(Pipeline::TIME_STEPS()));
  if (!std::all_of(places.begin(), places.end(), [&](const auto& p) { return times.count(p.first); })) return;
  for (const double t : times) places.emplace(t, Lost);
}

} // namespace

void vtkSphereTrajectoryWriter::SetFileName(const char* name) {
  const std::string given = name ? name : "";
  if (given == this->FileName) return;
  this->FileName = given;
  this->Modified();
}

int vtkSphereTrajectoryWriter::FillInputPortInformation(int, vtkInformation* info) {
  info->Set(vtkAlgorithm::INPUT_REQUIRED_DATA_TYPE(), "vtkPolyData");
  return 1;
}

void vtkSphereTrajectoryWriter::WriteData() {
  this->SetErrorCode(vtkErrorCode::NoError);
  try {
    if (this->FileName.empty()) throw std::invalid_argument("no file name was given. Set FileName");
    vtkPolyData* data = vtkPolyData::SafeDownCast(this->GetInput());
    rimflow::SphereTrajectory trajectory;
    std::map<double, Eigen::Vector3d> places = placesOf(data, this->SphereId);
    addLostTimes(this->GetInputInformation(), places);
    for (const auto& [time, centre] : places) {
      trajectory.time.push_back(time);
      trajectory.centre.push_back(centre);
    }
    vtkDataArray *diameter = rimflow::bodyArray(data, "Diameter", 1), *id = pointArray(data, "SphereId", 1),
                 *ratio = data->GetFieldData()->GetArray("DensityRatio");
    trajectory.diameter = this->Diameter;
    for (vtkIdType p = 0; diameter && !(trajectory.diameter > 0) && p < diameter->GetNumberOfTuples(); ++p)
      if (!id || p >= id->GetNumberOfTuples() || id->GetTuple1(p) == this->SphereId)
        trajectory.diameter = diameter->GetTuple1(p);
    trajectory.densityRatio = this->DensityRatio > 0                     ? this->DensityRatio
                              : ratio && ratio->GetNumberOfTuples() == 1 ? ratio->GetTuple1(0)
                                                                         : 0;
    rimflow::writeSphereTrajectory(this->FileName, trajectory);
  } catch (const std::invalid_argument& problem) {
    this->SetErrorCode(vtkErrorCode::UnknownError);
    vtkErrorMacro("The trajectory cannot be written: " << problem.what() << ".");
  } catch (const std::exception& problem) {
    this->SetErrorCode(vtkErrorCode::CannotOpenFileError);
    vtkErrorMacro(<< problem.what());
  }
}

void vtkSphereTrajectoryWriter::PrintSelf(ostream& os, vtkIndent indent) {
  this->Superclass::PrintSelf(os, indent);
  os << indent << "FileName: " << this->FileName << "\n"
     << indent << "Diameter: " << this->Diameter << "\n"
     << indent << "DensityRatio: " << this->DensityRatio << "\n"
     << indent << "SphereId: " << this->SphereId << "\n";
}
