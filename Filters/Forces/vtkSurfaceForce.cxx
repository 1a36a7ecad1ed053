#include "vtkSurfaceForce.h"

#include "BodyMask.h"
#include "SurfaceForce.h"
#include "vtkBodyFromPolyData.h"
#include "vtkFieldOutput.h"
#include "vtkFilterProgress.h"
#include "vtkGridFromImage.h"
#include "vtkResultCache.h"

#include "vtkCellArray.h"
#include "vtkInformation.h"
#include "vtkInformationVector.h"
#include "vtkIntArray.h"
#include "vtkObjectFactory.h"
#include "vtkPoints.h"
#include "vtkStreamingDemandDrivenPipeline.h"
#include "vtkTable.h"

#include <cmath>
#include <initializer_list>
#include <limits>
#include <stdexcept>

vtkStandardNewMacro(vtkSurfaceForce);

namespace {

using Pipeline = vtkStreamingDemandDrivenPipeline;
using rimflow::ForceResult;

constexpr double Nothing = std::numeric_limits<double>::quiet_NaN();

/// The image's arrays as the kernel wants them; the smart pointers keep converted copies alive.
struct Fields {
  vtkSmartPointer<vtkFloatArray> velocity, acceleration, pressure, gradient, error;
  std::vector<unsigned char> mask;
  rimflow::Grid grid;

  rimflow::ForceFields view() const {
    const auto pointer = [](vtkFloatArray* array) { return array ? array->GetPointer(0) : nullptr; };
    return {grid,
            pointer(velocity),
            pointer(acceleration),
            pointer(pressure),
            pointer(gradient),
            pointer(error),
            mask.empty() ? nullptr : mask.data()};
  }
};

/// Throws std::invalid_argument when an array is missing.
Fields fieldsOf(vtkAlgorithm* filter, vtkImageData* image) {
  const auto found = [&](vtkDataArray* array, const std::string& name, const char* advice) {
    if (!array)
      throw std::invalid_argument("no " + name + " found: the image has " + rimflow::arrayNames(image) +
                                  ". " + advice);
    return rimflow::asFloat(array);
  };
  const char* fromPressure = "Apply Omni3D Pressure first, or choose the input array";
  const char* fromFlow =
      "Give the image that VIC Sharp Resample and Omni3D Pressure have made, or choose the "
      "input array (three components)";
  Fields f;
  f.grid = rimflow::gridOf(image);
  f.pressure = found(rimflow::pointNumbers(filter, image, 2, "Pressure"), "Pressure", fromPressure);
  f.gradient = found(rimflow::pointVectors(filter, image, 3, "PressureGradient", false), "PressureGradient",
                     fromPressure);
  f.velocity = found(rimflow::pointVectors(filter, image, 0, "Velocity", false), "Velocity", fromFlow);
  f.acceleration = found(rimflow::pointVectors(filter, image, 1, "MaterialAcceleration", false),
                         "MaterialAcceleration", fromFlow);
  vtkDataArray* error = image->GetPointData()->GetArray("PressureError");
  if (error && error->GetNumberOfComponents() == 1) f.error = rimflow::asFloat(error);
  f.mask = rimflow::maskOf(image);
  return f;
}

/// The table's row: names and numbers in order, and the note.
struct Row {
  std::vector<std::pair<std::string, double>> numbers;
  std::string note;

  void add(const std::string& name, double value) { numbers.emplace_back(name, value); }
  void add(const std::string& name, const Eigen::Vector3d& v, const std::string& unit) {
    for (int a = 0; a < 3; ++a) this->add(name + "_" + "xyz"[a] + unit, v[a]);
  }
};

/// Half rho V^2 times the frontal area: what Cd and Cl are relative to, N; not a number for a body at rest.
double dynamicForce(const rimflow::Body& body, double density) {
  const double force =
      density / 2 * body.velocity.squaredNorm() * EIGEN_PI / 4 * body.diameter * body.diameter;
  return force > 0 ? force : Nothing;
}

Row rowOf(double time, double sphere, const ForceResult& r, double dynamicForce) {
  const Eigen::Vector3d unknown = Eigen::Vector3d::Constant(Nothing);
  const std::pair<const char*, const rimflow::Force&> forces[] = {
      {"Fp", r.pressureForce}, {"Fv", r.friction}, {"Fcv", r.controlVolume}, {"Fin", r.inertia}};
  const bool balanced = r.controlVolume.known;
  const double liftCv = balanced ? r.controlVolumeLift.norm() : Nothing;
  Row row;
  row.add("Time", time);
  row.add("SphereId", sphere);
  for (const auto& [name, force] : forces) row.add(name, force.known ? force.value : unknown, "_N");
  row.add("drag_N", r.drag);
  row.add("lift_N", r.lift.norm());
  row.add("Cd", r.dragCoefficient);
  row.add("Cl", r.liftCoefficient);
  for (const auto& [name, force] : forces)
    row.add(std::string("sigma_") + name, force.known ? force.sigma : unknown, "_N");
  row.add("sigma_drag_N", r.dragSigma);
  row.add("sigma_lift_N", r.liftSigma);
  row.add("lift", r.lift, "_N");
  row.add("drag_cv_N", balanced ? r.controlVolumeDrag : Nothing);
  row.add("sigma_drag_cv_N", balanced ? r.controlVolumeDragSigma : Nothing);
  row.add("lift_cv_N", liftCv);
  row.add("sigma_lift_cv_N", balanced ? r.controlVolumeLiftSigma : Nothing);
  row.add("Cd_cv", balanced ? r.controlVolumeDragCoefficient : Nothing);
  row.add("Cl_cv", liftCv / dynamicForce);
  row.add("torque", r.torque, "_N_m");
  row.add("coverage", r.coverage);
  row.add("control_volume_radius_m", r.controlVolumeRadius);
  row.note = r.note;
  return row;
}

/// The same columns for a body without a force.
Row emptyRow(double time, double sphere, const std::string& note) {
  Row row = rowOf(time, sphere, {}, Nothing);
  for (std::size_t c = 2; c < row.numbers.size(); ++c) row.numbers[c].second = Nothing;
  row.note = note;
  return row;
}

void fillTable(const std::vector<Row>& rows, vtkTable* table) {
  for (std::size_t c = 0; c < rows.front().numbers.size(); ++c) {
    vtkNew<vtkDoubleArray> column;
    column->SetName(rows.front().numbers[c].first.c_str());
    for (const Row& row : rows) column->InsertNextValue(row.numbers[c].second);
    table->AddColumn(column);
  }
  vtkNew<vtkStringArray> notes;
  notes->SetName("note");
  for (const Row& row : rows) notes->InsertNextValue(row.note);
  table->AddColumn(notes);
}

template <class Array>
vtkSmartPointer<Array> namedArray(const char* name, int components) {
  auto array = vtkSmartPointer<Array>::New();
  array->SetName(name);
  array->SetNumberOfComponents(components);
  return array;
}

/// The surfaces one after the other.
void fillSurface(const std::vector<ForceResult>& results, vtkPolyData* surface) {
  vtkNew<vtkPoints> points;
  points->SetDataTypeToDouble();
  vtkNew<vtkCellArray> triangles;
  const auto pressure = namedArray<vtkFloatArray>("Pressure", 1);
  const auto sigma = namedArray<vtkFloatArray>("PressureSigma", 1);
  const auto traction = namedArray<vtkFloatArray>("Traction", 3);
  const auto normals = namedArray<vtkFloatArray>("Normals", 3);
  const auto seen = namedArray<vtkUnsignedCharArray>("Seen", 1);
  for (const ForceResult& r : results) {
    const vtkIdType first = points->GetNumberOfPoints();
    for (std::size_t p = 0; p < r.points.size(); ++p) {
      points->InsertNextPoint(r.points[p].data());
      pressure->InsertNextValue(float(r.pressure[p]));
      sigma->InsertNextValue(float(r.pressureSigma[p]));
      traction->InsertNextTuple(r.traction[p].data());
      normals->InsertNextTuple(r.normals[p].data());
      seen->InsertNextValue(r.seen[p]);
    }
    for (const auto& t : r.triangles) {
      const vtkIdType corners[3] = {first + t[0], first + t[1], first + t[2]};
      triangles->InsertNextCell(3, corners);
    }
  }
  surface->SetPoints(points);
  surface->SetPolys(triangles);
  vtkPointData* data = surface->GetPointData();
  for (vtkDataArray* array : std::initializer_list<vtkDataArray*>{sigma, traction, seen})
    data->AddArray(array);
  data->SetScalars(pressure);
  data->SetNormals(normals);
}

} // namespace

struct vtkSurfaceForce::Internals {
  rimflow::ResultCache results;
};

vtkSurfaceForce::~vtkSurfaceForce() = default;

vtkSurfaceForce::vtkSurfaceForce() : State(new Internals) {
  this->SetNumberOfInputPorts(2);
  this->SetNumberOfOutputPorts(2);
  int index = 0;
  for (const char* name : {"Velocity", "MaterialAcceleration", "Pressure", "PressureGradient"})
    this->SetInputArrayToProcess(index++, 0, 0, vtkDataObject::FIELD_ASSOCIATION_POINTS, name);
}

int vtkSurfaceForce::FillInputPortInformation(int port, vtkInformation* info) {
  info->Set(vtkAlgorithm::INPUT_REQUIRED_DATA_TYPE(), port == 0 ? "vtkImageData" : "vtkPolyData");
  return 1;
}

int vtkSurfaceForce::FillOutputPortInformation(int port, vtkInformation* info) {
  info->Set(vtkDataObject::DATA_TYPE_NAME(), port == 0 ? "vtkPolyData" : "vtkTable");
  return 1;
}

int vtkSurfaceForce::RequestUpdateExtent(vtkInformation*, vtkInformationVector** inputs,
                                         vtkInformationVector*) {
  vtkInformation* in = inputs[0]->GetInformationObject(0); // all of the image: a surface knows no extents
  if (in->Has(Pipeline::WHOLE_EXTENT()))
    in->Set(Pipeline::UPDATE_EXTENT(), in->Get(Pipeline::WHOLE_EXTENT()), 6);
  return 1;
}

void vtkSurfaceForce::WarnOfOtherFluid(vtkDataObject* image, const char* name, double mine) {
  vtkDataArray* array = image->GetFieldData()->GetArray(name);
  if (!array || array->GetNumberOfValues() == 0) return;
  const double theirs = array->GetComponent(0, 0);
  if (std::abs(theirs - mine) > 1e-6 * std::abs(theirs))
    vtkWarningMacro("The pressure was integrated with " << name << " " << theirs << ", and the force uses "
                                                        << mine << ". Set " << name
                                                        << " to the same value in both filters.");
}

int vtkSurfaceForce::RequestData(vtkInformation*, vtkInformationVector** inputs,
                                 vtkInformationVector* outputs) {
  vtkPolyData* surface = vtkPolyData::GetData(outputs, 0);
  vtkTable* table = vtkTable::GetData(outputs, 1);
  surface->Initialize();
  table->Initialize();
  vtkImageData* image = vtkImageData::GetData(inputs[0]);
  vtkPolyData* bodyData = vtkPolyData::GetData(inputs[1]);
  vtkInformation* data = image->GetInformation();
  const bool hasTime = data->Has(vtkDataObject::DATA_TIME_STEP());
  const double time = hasTime ? data->Get(vtkDataObject::DATA_TIME_STEP()) : 0;
  try {
    if (!(this->Density > 0)) throw std::invalid_argument("the Density must be greater than 0 kg/m3");
    if (image->GetNumberOfPoints() == 0) return 1;
    if (this->State->results.restore(this, inputs, outputs)) return 1;
    Fields fields = fieldsOf(this, image);
    this->WarnOfOtherFluid(image, "Density", this->Density);
    this->WarnOfOtherFluid(image, "Viscosity", this->Viscosity);
    for (const rimflow::Body& b : rimflow::bodiesOf(bodyData))
      rimflow::maskInside(fields.grid, b, fields.mask);

    rimflow::ForceOptions options;
    options.density = this->Density;
    options.viscosity = this->Viscosity;
    options.bodyDensity = rimflow::bodyArray(bodyData, "Acceleration", 3) ? this->BodyDensity : 0;
    options.gravity = Eigen::Vector3d(this->Gravity);
    options.surfaceResolution = this->SurfaceResolution;
    options.controlVolumeRadius = this->ControlVolumeRadius;
    std::vector<Row> rows;
    std::vector<ForceResult> results;
    vtkDataArray* ids = rimflow::bodyArray(bodyData, "SphereId", 1);
    const vtkIdType bodies = rimflow::numberOfBodies(bodyData);
    for (vtkIdType which = 0; which < bodies; ++which) {
      const rimflow::Progress progress = rimflow::progressOf(
          this, "Surface force", double(which) / double(bodies), double(which + 1) / double(bodies));
      if (!progress(0)) return 1; // aborted: the outputs stay empty
      const double id = ids && which < ids->GetNumberOfTuples() ? ids->GetTuple1(which) : double(which);
      const auto body = rimflow::bodyOf(bodyData, which);
      if (!body) {
        rows.push_back(emptyRow(time, id, "the body is lost"));
        continue;
      }
      options.centreCovariance = rimflow::centreCovarianceOf(bodyData, which);
      options.velocityCovariance = rimflow::motionCovarianceOf(bodyData, "VelocitySigma", which);
      options.accelerationCovariance = rimflow::motionCovarianceOf(bodyData, "AccelerationSigma", which);
      try {
        results.push_back(rimflow::surfaceForce(fields.view(), *body, options, progress));
        if (results.back().points.empty()) return 1;
        rows.push_back(rowOf(time, id, results.back(), dynamicForce(*body, this->Density)));
      } catch (const std::invalid_argument& error) { // a body that leaves the image does not end a series
        vtkWarningMacro("No force on the body at " << time << " s: " << error.what() << ".");
        rows.push_back(emptyRow(time, id, error.what()));
      }
    }
    fillTable(rows, table);
    if (!results.empty()) fillSurface(results, surface);
    surface->GetFieldData()->ShallowCopy(bodyData->GetFieldData());
    for (vtkIdType c = 0; c < table->GetNumberOfColumns(); ++c)
      surface->GetFieldData()->AddArray(table->GetColumn(c));
  } catch (const std::invalid_argument& error) {
    vtkErrorMacro("The force cannot be found: " << error.what() << ".");
    return 0;
  }
  if (hasTime)
    for (vtkDataObject* output : std::initializer_list<vtkDataObject*>{surface, table})
      output->GetInformation()->Set(vtkDataObject::DATA_TIME_STEP(), time);
  this->State->results.keep(this, outputs);
  return 1;
}

void vtkSurfaceForce::SetCacheSize(int mebibytes) {
  this->CacheSize = std::max(0, mebibytes);
  this->State->results.setLimit(this->CacheSize);
}

void vtkSurfaceForce::PrintSelf(ostream& os, vtkIndent indent) {
  this->Superclass::PrintSelf(os, indent);
  os << indent << "Density: " << this->Density << "\n"
     << indent << "Viscosity: " << this->Viscosity << "\n"
     << indent << "BodyDensity: " << this->BodyDensity << "\n"
     << indent << "Gravity: " << this->Gravity[0] << " " << this->Gravity[1] << " " << this->Gravity[2]
     << "\n"
     << indent << "SurfaceResolution: " << this->SurfaceResolution << "\n"
     << indent << "ControlVolumeRadius: " << this->ControlVolumeRadius << "\n"
     << indent << "CacheSize: " << this->CacheSize << "\n";
}
