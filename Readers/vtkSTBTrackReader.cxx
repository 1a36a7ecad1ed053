#include "vtkSTBTrackReader.h"

#include "TrackFormat.h"
#include "TrackSeries.h"
#include "vtkFilterProgress.h"

#include "vtkCellArray.h"
#include "vtkCellData.h"
#include "vtkDoubleArray.h"
#include "vtkFieldData.h"
#include "vtkFloatArray.h"
#include "vtkIdTypeArray.h"
#include "vtkInformation.h"
#include "vtkInformationVector.h"
#include "vtkNew.h"
#include "vtkObjectFactory.h"
#include "vtkPointData.h"
#include "vtkPoints.h"
#include "vtkPolyData.h"
#include "vtkSmartPointer.h"
#include "vtkStreamingDemandDrivenPipeline.h"
#include "vtkStringArray.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <stdexcept>
#include <type_traits>
#include <utility>

vtkStandardNewMacro(vtkSTBTrackReader);

namespace {

// Whole numbers become ids.
template <class T>
using ArrayOf =
    std::conditional_t<std::is_same_v<T, float>, vtkFloatArray,
                       std::conditional_t<std::is_same_v<T, double>, vtkDoubleArray, vtkIdTypeArray>>;

template <class T>
vtkSmartPointer<ArrayOf<T>> makeArray(const char* name, int components, const std::vector<T>& values) {
  auto array = vtkSmartPointer<ArrayOf<T>>::New();
  array->SetName(name);
  array->SetNumberOfComponents(components);
  array->SetNumberOfTuples(vtkIdType(values.size()) / components);
  std::copy(values.begin(), values.end(), array->GetPointer(0));
  return array;
}

template <class T>
void release(std::vector<T>& values) {
  std::vector<T>().swap(values);
}
template <class T>
void release(const std::vector<T>&) {} // somebody else needs them

// Points and point arrays. A snapshot without particles has the arrays of its columns too, so that what
// follows in the pipeline finds the same names at all times. What is not const is emptied on the way, so that
// a recording of lines is not twice in memory.
template <class Snapshot>
void fillPoints(vtkPolyData* output, Snapshot& s, const rimflow::TrackColumnPlan& plan) {
  const bool empty = s.size() == 0;
  vtkNew<vtkPoints> points;
  points->SetData(makeArray("Points", 3, s.position));
  release(s.position);
  output->SetPoints(points);
  vtkPointData* data = output->GetPointData();
  const auto add = [&](const char* name, int components, auto& values, bool column) {
    if (!values.empty() || (empty && column)) data->AddArray(makeArray(name, components, values));
    release(values);
  };
  add("Velocity", 3, s.velocity, plan.hasVelocity);
  add("Acceleration", 3, s.acceleration, plan.hasAcceleration);
  add("TrackId", 1, s.trackId, plan.hasTrackId);
  add("Intensity", 1, s.intensity, plan.hasIntensity);
  for (auto& c : s.further) add(c.name.c_str(), 1, c.values, true);
  if (empty && s.further.empty())
    for (const std::string& name : plan.furtherNames)
      data->AddArray(makeArray(name.c_str(), 1, std::vector<double>()));
  data->SetActiveVectors("Velocity");
  data->SetActiveScalars("Velocity"); // ParaView colours by these at first
}

// Cells over consecutive points: cell c is points offsets[c] to offsets[c+1].
vtkSmartPointer<vtkCellArray> consecutive(const std::vector<vtkIdType>& offsets) {
  vtkNew<vtkIdTypeArray> points;
  points->SetNumberOfTuples(offsets.back() - offsets.front());
  std::iota(points->GetPointer(0), points->GetPointer(0) + points->GetNumberOfTuples(), offsets.front());
  std::vector<vtkIdType> fromZero(offsets);
  for (vtkIdType& o : fromZero) o -= offsets.front();
  auto cells = vtkSmartPointer<vtkCellArray>::New();
  cells->SetData(makeArray("", 1, fromZero), points);
  return cells;
}

vtkSmartPointer<vtkCellArray> verticesFor(vtkIdType points) {
  std::vector<vtkIdType> offsets(std::size_t(points) + 1);
  std::iota(offsets.begin(), offsets.end(), 0);
  return consecutive(offsets);
}

} // namespace

// The files that are open, and how this reader's settings select from them.
struct vtkSTBTrackReader::Series {
  vtkSTBTrackReader* self;
  rimflow::TrackSeries series;
  vtkNew<vtkPolyData> wholePathlines; // the same at all times
  vtkMTimeType wholeMTime = 0;

  explicit Series(vtkSTBTrackReader* reader) : self(reader) {}

  void tell() {
    for (const std::string& w : series.takeWarnings()) vtkWarningWithObjectMacro(self, << w);
  }

  void open(bool trustRowCounts = true) {
    wholeMTime = 0;
    series.open(self->FileNames, rimflow::progressOf(self, "Reading tracks: index"), trustRowCounts);
  }
  void use() {
    rimflow::TrackSeries::Settings s;
    s.units = {rimflow::LengthUnit(self->LengthUnit), self->FramePeriod};
    s.time = {self->FramePeriod, self->TimeShift, self->ShiftTimeToZero};
    if (self->UseTimeRange) s.timeRange = {self->TimeRange[0], self->TimeRange[1]};
    s.estimate = rimflow::TrackSeries::Estimate(self->EstimateVelocities);
    s.polynomial = {self->PolynomialOrder, self->PolynomialWindow};
    s.cacheBytes = std::size_t(self->CacheSize) << 20;
    series.use(s);
    tell();
  }

  rimflow::TrackSelection selection(std::size_t snapshot) {
    rimflow::TrackSelection s{self->Stride, self->TrackIdRange[0], self->TrackIdRange[1],
                              self->MinimumTrackLength, nullptr};
    const bool needsIds = s.firstId >= 0 || s.lastId >= 0 || s.minimumLength > 1 || self->TrackStatistics ||
                          self->OutputMode == PATHLINES;
    if (needsIds && !series.columns(snapshot).hasTrackId)
      throw std::runtime_error(
          series.fileOf(snapshot) +
          ": there is no column trackID, so Pathlines, TrackIdRange, MinimumTrackLength and TrackStatistics "
          "cannot be had. Set them back, or export the track IDs too.");
    if (s.minimumLength > 1 || self->TrackStatistics)
      s.tracks = &series.statistics(rimflow::progressOf(self, "Reading tracks: statistics", 0, 0.6));
    return s;
  }

  void particles(std::size_t snapshot, vtkPolyData* output) {
    const rimflow::TrackSelection chosen = selection(snapshot);
    rimflow::TrackSeries::Snapshot shown =
        series.particles(snapshot, rimflow::progressOf(self, "Reading tracks", 0.6, 0.7));
    if (!chosen.keepsAll() || self->TrackStatistics) {
      auto copy = std::make_shared<rimflow::TrackSnapshot>(
          rimflow::takeRows(*shown, rimflow::selectedRows(*shown, chosen)));
      if (self->TrackStatistics) series.addStatistics(*copy, {series.times()[snapshot]});
      shown = copy;
    }
    fillPoints(output, *shown, series.columns(snapshot));
    output->SetVerts(verticesFor(output->GetNumberOfPoints()));
  }

  void pathlines(std::size_t from, std::size_t to, vtkPolyData* output) {
    rimflow::Pathlines lines = series.pathlines(
        from, to, selection(to), rimflow::progressOf(self, "Reading tracks: pathlines", 0.2, 0.7));
    if (!lines.dropped.empty()) {
      std::string names;
      for (const std::string& name : lines.dropped) names += (names.empty() ? "" : ", ") + name;
      vtkWarningWithObjectMacro(self, "Only some of the snapshots in the pathlines' window have "
                                          << names
                                          << ", so the pathlines come without. Open files with the same "
                                             "columns together.");
    }
    if (self->TrackStatistics) series.addStatistics(lines.points, lines.time);
    fillPoints(output, lines.points, series.columns(to));
    output->GetPointData()->AddArray(makeArray("Time", 1, lines.time));
    release(lines.time);
    const auto middle = lines.offsets.begin() + std::ptrdiff_t(lines.singles);
    output->SetVerts(consecutive({lines.offsets.begin(), middle + 1}));
    output->SetLines(consecutive({middle, lines.offsets.end()}));
    output->GetCellData()->AddArray(makeArray("TrackId", 1, lines.trackId));
  }

  void addFieldData(std::size_t snapshot, vtkPolyData* output) {
    vtkFieldData* data = output->GetFieldData();
    data->AddArray(makeArray("SnapshotIndex", 1, std::vector<vtkIdType>{vtkIdType(snapshot)}));
    const rimflow::TrackColumnPlan columns = series.columns(snapshot);
    vtkNew<vtkStringArray> units;
    units->SetName("FileUnits");
    for (const std::string& u : {columns.lengthUnit, columns.velocityUnit, columns.accelerationUnit})
      units->InsertNextValue(rimflow::toUtf8(u));
    data->AddArray(units);
    const rimflow::TrackNoise noise =
        series.noise(rimflow::progressOf(self, "Reading tracks: noise", 0.7, 1));
    for (const auto& [name, value] :
         {std::pair("PositionNoise", noise.position), std::pair("VelocityNoise", noise.velocity),
          std::pair("AccelerationNoise", noise.acceleration)})
      if (std::isfinite(value)) data->AddArray(makeArray(name, 1, std::vector<double>{value}));
  }

  void fill(std::size_t snapshot, vtkPolyData* output) {
    const std::size_t trail = std::size_t(self->TrailLength);
    if (self->OutputMode == PARTICLES)
      particles(snapshot, output);
    else if (trail > 0) {
      series.particles(snapshot, rimflow::progressOf(self, "Reading tracks", 0,
                                                     0.2)); // an error, if the current one is damaged
      pathlines(std::max(series.first() + trail, snapshot + 1) - trail, snapshot, output);
    } else {
      if (wholeMTime != self->GetMTime()) {
        wholePathlines->Initialize();
        pathlines(series.first(), series.last(), wholePathlines);
        wholeMTime = self->GetMTime();
      }
      output->ShallowCopy(wholePathlines);
    }
    addFieldData(snapshot, output);
    tell();
  }
};

vtkSTBTrackReader::vtkSTBTrackReader() { this->SetNumberOfInputPorts(0); }
vtkSTBTrackReader::~vtkSTBTrackReader() = default;

void vtkSTBTrackReader::AddFileName(const char* name) {
  if (!name || !*name) return;
  this->FileNames.emplace_back(name);
  this->Modified();
}

void vtkSTBTrackReader::RemoveAllFileNames() {
  if (this->FileNames.empty()) return;
  this->FileNames.clear();
  this->Modified();
}

void vtkSTBTrackReader::SetFileName(const char* name) {
  if (name && this->FileNames.size() == 1 && this->FileNames[0] == name) return;
  this->RemoveAllFileNames();
  this->AddFileName(name);
}

int vtkSTBTrackReader::GetNumberOfFileNames() const { return int(this->FileNames.size()); }

const char* vtkSTBTrackReader::GetFileName(int index) const {
  return index >= 0 && index < this->GetNumberOfFileNames() ? this->FileNames[std::size_t(index)].c_str()
                                                            : nullptr;
}

int vtkSTBTrackReader::CanReadFile(const char* name) { return name && rimflow::looksLikeTracks(name); }

int vtkSTBTrackReader::RequestInformation(vtkInformation*, vtkInformationVector**,
                                          vtkInformationVector* outputs) {
  vtkInformation* information = outputs->GetInformationObject(0);
  information->Remove(vtkStreamingDemandDrivenPipeline::TIME_STEPS());
  information->Remove(vtkStreamingDemandDrivenPipeline::TIME_RANGE());
  try {
    if (!this->Open || !this->Open->series.isOpen(this->FileNames)) {
      this->Open = std::make_unique<Series>(this);
      this->Open->open();
    }
    this->Open->use();
  } catch (const rimflow::TrackReadAborted&) {
    this->Open.reset();
    this->Modified(); // so that the next update tries again
    return 1;
  } catch (const std::exception& problem) {
    this->Open.reset();
    if (vtkPolyData* output = vtkPolyData::GetData(outputs)) output->Initialize();
    vtkErrorMacro(<< problem.what());
    return 0;
  }
  const rimflow::TrackSeries& series = this->Open->series;
  const double* times = series.times().data();
  const double range[2] = {times[series.first()], times[series.last()]};
  information->Set(vtkStreamingDemandDrivenPipeline::TIME_STEPS(), times + series.first(),
                   int(series.last() - series.first() + 1));
  information->Set(vtkStreamingDemandDrivenPipeline::TIME_RANGE(), range, 2);
  return 1;
}

int vtkSTBTrackReader::RequestData(vtkInformation*, vtkInformationVector**, vtkInformationVector* outputs) {
  vtkPolyData* output = vtkPolyData::GetData(outputs);
  output->Initialize();
  if (!this->Open) return 1; // aborted while the files were indexed
  vtkInformation* information = outputs->GetInformationObject(0);
  const bool asked = information->Has(vtkStreamingDemandDrivenPipeline::UPDATE_TIME_STEP());
  rimflow::TrackSeries& series = this->Open->series;
  const std::vector<double> times = series.times();
  const double time =
      asked ? information->Get(vtkStreamingDemandDrivenPipeline::UPDATE_TIME_STEP()) : times[series.first()];
  const std::size_t snapshot = series.nearest(time);
  vtkNew<vtkPolyData> result;
  try {
    try {
      this->Open->fill(snapshot, result);
    } catch (const rimflow::TrackIndexOutdated& why) {
      // The files have changed, or their row counts misled the index: look at all lines, and go on if the
      // times that downstream knows of are still right.
      this->Open->open(false);
      this->Open->use();
      if (series.times() != times) {
        throw std::runtime_error(
            std::string(why.what()) + " The files were read anew and hold " +
            std::to_string(series.times().size()) + " snapshots instead of " + std::to_string(times.size()) +
            ": reload the files (F5 in ParaView, Modified() in a program) to have all times.");
      }
      result->Initialize();
      this->Open->fill(snapshot, result);
    }
  } catch (const rimflow::TrackReadAborted&) {
    return 1; // the output stays empty
  } catch (const std::exception& problem) {
    vtkErrorMacro(<< problem.what());
    return 0;
  }
  output->ShallowCopy(result);
  output->GetInformation()->Set(vtkDataObject::DATA_TIME_STEP(), times[snapshot]);
  return 1;
}

void vtkSTBTrackReader::PrintSelf(ostream& os, vtkIndent indent) {
  this->Superclass::PrintSelf(os, indent);
  os << indent << "FileNames:";
  for (const std::string& name : this->FileNames) os << " " << name;
  os << "\n"
     << indent << "LengthUnit: " << this->LengthUnit << "\n"
     << indent << "FramePeriod: " << this->FramePeriod << "\n"
     << indent << "TimeShift: " << this->TimeShift << "\n"
     << indent << "ShiftTimeToZero: " << this->ShiftTimeToZero << "\n"
     << indent << "OutputMode: " << this->OutputMode << "\n"
     << indent << "TrailLength: " << this->TrailLength << "\n"
     << indent << "MinimumTrackLength: " << this->MinimumTrackLength << "\n"
     << indent << "UseTimeRange: " << this->UseTimeRange << "\n"
     << indent << "TimeRange: " << this->TimeRange[0] << " " << this->TimeRange[1] << "\n"
     << indent << "TrackStatistics: " << this->TrackStatistics << "\n"
     << indent << "EstimateVelocities: " << this->EstimateVelocities << "\n"
     << indent << "PolynomialOrder: " << this->PolynomialOrder << "\n"
     << indent << "PolynomialWindow: " << this->PolynomialWindow << "\n"
     << indent << "TrackIdRange: " << this->TrackIdRange[0] << " " << this->TrackIdRange[1] << "\n"
     << indent << "Stride: " << this->Stride << "\n"
     << indent << "CacheSize: " << this->CacheSize << "\n";
}
