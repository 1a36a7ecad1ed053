// From tracks to the drag on the sphere, without ParaView:
//     forces TRACKS DIAMETER DENSITY VISCOSITY SURFACE.vtp [STEP]
// Prints time, drag and drag coefficient of every STEPth snapshot (default 5) and writes the sphere of the
// last one, with the pressure and the traction on it. Diameter in m, density in kg/m3, kinematic viscosity in
// m2/s.
#include <vtkInvisibleSphereLocator.h>
#include <vtkOmni3DPressure.h>
#include <vtkSTBTrackReader.h>
#include <vtkSurfaceForce.h>
#include <vtkVICSharpResample.h>

#include <vtkCommand.h>
#include <vtkExecutive.h>
#include <vtkInformation.h>
#include <vtkNew.h>
#include <vtkPolyData.h>
#include <vtkStreamingDemandDrivenPipeline.h>
#include <vtkTable.h>
#include <vtkVariant.h>
#include <vtkXMLPolyDataWriter.h>

#include <algorithm>
#include <cstdio>
#include <stdexcept>
#include <string>
#include <vector>

namespace {

/// Remembers the first error of the algorithms that it watches. VTK would print it, and go on with an empty
/// output.
class FirstError : public vtkCommand {
public:
  static FirstError* New() { return new FirstError; }
  void Watch(vtkAlgorithm* algorithm) {
    algorithm->AddObserver(vtkCommand::ErrorEvent, this);
    algorithm->GetExecutive()->AddObserver(vtkCommand::ErrorEvent, this);
  }
  void Execute(vtkObject*, unsigned long, void* message) override {
    if (this->Message.empty()) this->Message = static_cast<const char*>(message);
  }
  void ThrowIfAny() const {
    if (!this->Message.empty()) throw std::runtime_error(this->Message);
  }

private:
  std::string Message;
};

/// From the tracks to the forces; one Update(time) brings all of it to that time.
class Pipeline {
public:
  Pipeline(const char* tracks, double diameter, double density, double viscosity) {
    this->Tracks->SetFileName(tracks);

    this->Locator->SetInputConnection(0, this->Tracks->GetOutputPort());
    this->Locator->SetDiameter(diameter);
    this->Locator->ProcessAllTimesOn(); // the sphere's velocity and acceleration come from its whole path

    this->Flow->SetInputConnection(0, this->Tracks->GetOutputPort());
    this->Flow->SetInputConnection(1, this->Locator->GetOutputPort());
    this->Flow->SetViscosity(viscosity);

    this->Pressure->SetInputConnection(0, this->Flow->GetOutputPort());
    this->Pressure->SetDensity(density);
    this->Pressure->SetViscosity(viscosity);

    this->Force->SetInputConnection(0, this->Pressure->GetOutputPort());
    this->Force->SetInputConnection(1, this->Locator->GetOutputPort());
    this->Force->SetDensity(density);
    this->Force->SetViscosity(viscosity);

    for (vtkAlgorithm* algorithm :
         std::vector<vtkAlgorithm*>{this->Tracks, this->Locator, this->Flow, this->Pressure, this->Force})
      this->Error->Watch(algorithm);
  }

  /// The times of the snapshots, s.
  std::vector<double> Times() {
    this->Tracks->UpdateInformation();
    this->Error->ThrowIfAny();
    vtkInformation* info = this->Tracks->GetOutputInformation(0);
    auto* key = vtkStreamingDemandDrivenPipeline::TIME_STEPS();
    return std::vector<double>(info->Get(key), info->Get(key) + info->Length(key));
  }

  void Update(double time) {
    this->Force->UpdateTimeStep(time);
    this->Error->ThrowIfAny();
  }

  /// The sphere with `Pressure` and `Traction` (Pa) on it.
  vtkPolyData* Surface() { return this->Force->GetOutput(); }

  /// A column of the table of forces, e.g. drag_N or Cd; Documentation/user-guide.md lists them.
  vtkVariant Column(const char* name) {
    return vtkTable::SafeDownCast(this->Force->GetOutputDataObject(1))->GetValueByName(0, name);
  }

private:
  vtkNew<vtkSTBTrackReader> Tracks;
  vtkNew<vtkInvisibleSphereLocator> Locator;
  vtkNew<vtkVICSharpResample> Flow;
  vtkNew<vtkOmni3DPressure> Pressure;
  vtkNew<vtkSurfaceForce> Force;
  vtkNew<FirstError> Error;
};

void write(vtkPolyData* surface, const char* name) {
  vtkNew<vtkXMLPolyDataWriter> writer;
  writer->SetInputData(surface);
  writer->SetFileName(name);
  if (!writer->Write()) throw std::runtime_error(std::string(name) + " cannot be written");
}

void run(const std::vector<std::string>& arguments) {
  Pipeline pipeline(arguments[0].c_str(), std::stod(arguments[1]), std::stod(arguments[2]),
                    std::stod(arguments[3]));
  const std::vector<double> times = pipeline.Times();
  const std::size_t step = arguments.size() > 5 ? std::max(1, std::stoi(arguments[5])) : 5;
  std::printf("    time [s]   drag [mN]       Cd\n");
  for (std::size_t i = std::min(step / 2, times.size() - 1); i < times.size(); i += step) {
    pipeline.Update(times[i]);
    std::printf("%12.6f %11.3f %8.3f  %s\n", times[i], 1e3 * pipeline.Column("drag_N").ToDouble(),
                pipeline.Column("Cd").ToDouble(), pipeline.Column("note").ToString().c_str());
  }
  write(pipeline.Surface(), arguments[4].c_str());
}

} // namespace

int main(int count, char** values) {
  const std::vector<std::string> arguments(values + 1, values + count);
  if (arguments.size() < 5 || arguments.size() > 6) {
    std::fprintf(stderr, "usage: forces TRACKS DIAMETER_IN_METRES DENSITY VISCOSITY SURFACE.vtp [STEP]\n");
    return 2;
  }
  try {
    run(arguments);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "forces: %s\n", error.what());
    return 1;
  }
}
