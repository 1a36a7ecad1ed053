#include "vtkTrajectorySmoother.h"

#include "TrajectorySmoother.h"
#include "vtkFieldOutput.h"
#include "vtkFilterProgress.h"
#include "vtkWallView.h"

#include "vtkCellArray.h"
#include "vtkDoubleArray.h"
#include "vtkFieldData.h"
#include "vtkInformation.h"
#include "vtkInformationVector.h"
#include "vtkIntArray.h"
#include "vtkNew.h"
#include "vtkObjectFactory.h"
#include "vtkPointData.h"
#include "vtkPoints.h"
#include "vtkPolyData.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <map>
#include <numeric>
#include <stdexcept>
#include <vector>

vtkStandardNewMacro(vtkTrajectorySmoother);

namespace {

using rimflow::CentreStatus;

/// The array, when it is there with so many components; else an exception that says what is missing.
vtkDataArray* needed(vtkPolyData* data, const char* name, int components) {
  vtkDataArray* array = data->GetPointData()->GetArray(name);
  if (!array || array->GetNumberOfComponents() != components)
    throw std::invalid_argument("the input has no point array " + std::string(name) + " with " +
                                std::to_string(components) +
                                " component(s); connect the locator's centres or a trajectory");
  return array;
}

Eigen::Matrix3d symmetric(const double c[6]) {
  Eigen::Matrix3d m;
  m << c[0], c[3], c[5], c[3], c[1], c[4], c[5], c[4], c[2];
  return m;
}

std::vector<rimflow::CentreEstimate> estimatesOf(vtkPolyData* input) {
  vtkDataArray* time = needed(input, "Time", 1);
  vtkDataArray* covariance = needed(input, "Covariance", 6);
  vtkDataArray* status = input->GetPointData()->GetArray("Status");
  vtkDataArray* centre =
      input->GetPointData()->GetArray("Centre") ? needed(input, "Centre", 3) : input->GetPoints()->GetData();
  std::vector<rimflow::CentreEstimate> estimates(input->GetNumberOfPoints());
  for (vtkIdType p = 0; p < input->GetNumberOfPoints(); ++p) {
    double c[6];
    estimates[p].time = time->GetComponent(p, 0);
    estimates[p].found = !status || status->GetComponent(p, 0) == 0;
    centre->GetTuple(p, estimates[p].centre.data());
    covariance->GetTuple(p, c);
    estimates[p].covariance = symmetric(c);
  }
  return estimates;
}

/// Adds a double array filled by value(point), a vector or a matrix.
template <class F>
void add(vtkPolyData* output, const char* name, int components,
         const std::vector<rimflow::SmoothedCentre>& points, F&& value) {
  vtkNew<vtkDoubleArray> array;
  array->SetName(name);
  array->SetNumberOfComponents(components);
  array->SetNumberOfTuples(vtkIdType(points.size()));
  for (vtkIdType p = 0; p < vtkIdType(points.size()); ++p) {
    const auto v = value(points[p]);
    for (int c = 0; c < components; ++c) array->SetComponent(p, c, v.data()[c]);
  }
  output->GetPointData()->AddArray(array);
}

Eigen::Matrix<double, 6, 1> packed(const Eigen::Matrix3d& m) {
  return (Eigen::Matrix<double, 6, 1>() << m(0, 0), m(1, 1), m(2, 2), m(0, 1), m(1, 2), m(0, 2)).finished();
}
Eigen::Vector3d sigma(const Eigen::Matrix3d& covariance) { return covariance.diagonal().cwiseSqrt(); }
/// The square root, by which Tensor Glyph draws the ellipsoid; not numbers for a lost point.
Eigen::Matrix3d root(const Eigen::Matrix3d& covariance) {
  if (!covariance.allFinite()) return covariance;
  return Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>(covariance).operatorSqrt();
}

void fill(vtkPolyData* input, const rimflow::SmoothedTrajectory& t, vtkPolyData* output) {
  using rimflow::addNumber;
  const vtkIdType n = input->GetNumberOfPoints();
  vtkDataArray* time = input->GetPointData()->GetArray("Time");
  vtkDataArray* centre = input->GetPointData()->GetArray("Centre");
  output->GetPointData()->ShallowCopy(input->GetPointData());
  output->GetFieldData()->ShallowCopy(input->GetFieldData());

  vtkNew<vtkDoubleArray> raw;
  raw->DeepCopy(centre ? centre : input->GetPoints()->GetData());
  raw->SetName("RawCentre");
  output->GetPointData()->AddArray(raw);
  using P = rimflow::SmoothedCentre;
  add(output, "Centre", 3, t.points, [](const P& p) { return p.centre; });
  add(output, "Velocity", 3, t.points, [](const P& p) { return p.velocity; });
  add(output, "Acceleration", 3, t.points, [](const P& p) { return p.acceleration; });
  add(output, "Covariance", 6, t.points, [](const P& p) { return packed(p.centreCovariance); });
  add(output, "VelocityCovariance", 6, t.points, [](const P& p) { return packed(p.velocityCovariance); });
  add(output, "AccelerationCovariance", 6, t.points,
      [](const P& p) { return packed(p.accelerationCovariance); });
  add(output, "Sigma", 3, t.points, [](const P& p) { return sigma(p.centreCovariance); });
  add(output, "SigmaTensor", 9, t.points, [](const P& p) { return root(p.centreCovariance); });
  add(output, "VelocitySigma", 3, t.points, [](const P& p) { return sigma(p.velocityCovariance); });
  add(output, "AccelerationSigma", 3, t.points, [](const P& p) { return sigma(p.accelerationCovariance); });
  add(output, "AngularVelocity", 3, t.points, [](const P& p) { return p.angularVelocity; });
  add(output, "AngularVelocitySigma", 3, t.points, [](const P& p) { return p.angularVelocitySigma; });
  vtkNew<vtkIntArray> status;
  status->SetName("Status");
  for (const P& p : t.points) status->InsertNextValue(int(p.status));
  output->GetPointData()->AddArray(status);

  vtkNew<vtkPoints> points;
  points->SetDataTypeToDouble();
  points->SetNumberOfPoints(n);
  std::vector<vtkIdType> order;
  for (vtkIdType p = 0; p < n; ++p) {
    const bool lost = t.points[p].status == CentreStatus::Lost;
    points->SetPoint(p, lost ? input->GetPoint(p) : t.points[p].centre.data());
    if (!lost) order.push_back(p);
  }
  output->SetPoints(points);
  std::stable_sort(order.begin(), order.end(), [&](vtkIdType a, vtkIdType b) {
    return time->GetComponent(a, 0) < time->GetComponent(b, 0);
  });
  vtkNew<vtkCellArray> line;
  if (!order.empty()) line->InsertNextCell(vtkIdType(order.size()), order.data());
  output->SetLines(line);

  addNumber(output, "JerkIntensity", t.jerkIntensity);
  addNumber(output, "CorrelatedFraction", t.correlatedFraction);
  addNumber(output, "CorrelationTime", t.correlationTime);
  addNumber(output, "CovarianceInflation", t.inflation);
  addNumber(output, "Rejected", t.rejected);
  addNumber(output, "AccelerationPrior", t.accelerationPrior);
  addNumber(output, "PositionNoise", t.positionNoise);
  addNumber(output, "JointPoints", t.joint);
}

/// Gives each estimate its wall. False: there are none.
bool addWalls(vtkInformationVector* inputs, std::vector<rimflow::CentreEstimate>& estimates) {
  std::map<double, std::shared_ptr<const rimflow::WallView>> walls;
  for (int i = 0; i < inputs->GetNumberOfInformationObjects(); ++i) {
    vtkPolyData* data = vtkPolyData::GetData(inputs, i);
    if (data && data->GetNumberOfPoints() > 0) walls.insert(rimflow::wallFromPolyData(data));
  }
  for (rimflow::CentreEstimate& e : estimates)
    if (const auto wall = walls.find(e.time); wall != walls.end()) e.wall = wall->second;
  return !walls.empty();
}

} // namespace

vtkTrajectorySmoother::vtkTrajectorySmoother() { this->SetNumberOfInputPorts(2); }

int vtkTrajectorySmoother::FillInputPortInformation(int port, vtkInformation* info) {
  info->Set(vtkAlgorithm::INPUT_REQUIRED_DATA_TYPE(), "vtkPolyData");
  if (port == 1) {
    info->Set(vtkAlgorithm::INPUT_IS_OPTIONAL(), 1);
    info->Set(vtkAlgorithm::INPUT_IS_REPEATABLE(), 1);
  }
  return 1;
}

int vtkTrajectorySmoother::RequestData(vtkInformation*, vtkInformationVector** inputs,
                                       vtkInformationVector* outputs) {
  vtkPolyData* input = vtkPolyData::GetData(inputs[0]);
  vtkPolyData* output = vtkPolyData::GetData(outputs);
  output->Initialize();
  if (input->GetNumberOfPoints() == 0) return 1;
  if (this->CorrelatedFraction > 0.95) {
    vtkErrorMacro("CorrelatedFraction is "
                  << this->CorrelatedFraction
                  << "; it must be at most 0.95, or negative for the most likely value.");
    return 0;
  }
  rimflow::SmootherOptions options;
  options.jerkIntensity = this->JerkIntensity;
  options.correlatedFraction = this->CorrelatedFraction;
  options.correlationTime = this->CorrelationTime;
  options.largestPredictionSigma = this->LargestPredictionSigma;
  try {
    std::vector<rimflow::CentreEstimate> estimates = estimatesOf(input);
    if (addWalls(inputs[1], estimates))
      options.radius = 0.5 * needed(input, "Diameter", 1)->GetComponent(0, 0);
    const rimflow::SmoothedTrajectory smoothed =
        rimflow::smoothTrajectory(estimates, options, rimflow::progressOf(this, "Smoothing the trajectory"));
    if (smoothed.aborted) return 1; // the output stays empty
    fill(input, smoothed, output);
  } catch (const std::invalid_argument& error) {
    output->Initialize();
    vtkErrorMacro("The trajectory cannot be smoothed: " << error.what() << ".");
    return 0;
  }
  return 1;
}

void vtkTrajectorySmoother::PrintSelf(ostream& os, vtkIndent indent) {
  this->Superclass::PrintSelf(os, indent);
  os << indent << "JerkIntensity: " << this->JerkIntensity << "\n"
     << indent << "CorrelatedFraction: " << this->CorrelatedFraction << "\n"
     << indent << "CorrelationTime: " << this->CorrelationTime << "\n"
     << indent << "LargestPredictionSigma: " << this->LargestPredictionSigma << "\n";
}
