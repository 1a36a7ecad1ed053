#include "vtkSTBTrackReader.h"

#include "SnapshotCache.h"
#include "TrackFormat.h"
#include "TrackPathlines.h"
#include "TrackSelection.h"
#include "vtkFilterInput.h"

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
#include <set>
#include <stdexcept>

vtkStandardNewMacro(vtkSTBTrackReader);

namespace {

struct Aborted {};

template <class ArrayType, class T>
vtkSmartPointer<ArrayType> makeArray(const char* name, int components, const std::vector<T>& values) {
  auto array = vtkSmartPointer<ArrayType>::New();
  array->SetName(name);
  array->SetNumberOfComponents(components);
  array->SetNumberOfTuples(vtkIdType(values.size()) / components);
  std::copy(values.begin(), values.end(), array->GetPointer(0));
  return array;
}

// Points and point arrays. A snapshot without particles has the arrays of its columns too, so that what
// follows in the pipeline finds the same names at all times.
void fillPoints(vtkPolyData* output, const rimflow::TrackSnapshot& s, const rimflow::TrackColumnPlan& plan) {
  vtkNew<vtkPoints> points;
  points->SetData(makeArray<vtkFloatArray>("Points", 3, s.position));
  output->SetPoints(points);
  vtkPointData* data = output->GetPointData();
  const auto there = [&](const auto& values, bool column) {
    return !values.empty() || (s.size() == 0 && column);
  };
  if (there(s.velocity, plan.hasVelocity))
    data->AddArray(makeArray<vtkFloatArray>("Velocity", 3, s.velocity));
  if (there(s.acceleration, plan.hasAcceleration))
    data->AddArray(makeArray<vtkFloatArray>("Acceleration", 3, s.acceleration));
  if (there(s.trackId, plan.hasTrackId)) data->AddArray(makeArray<vtkIdTypeArray>("TrackId", 1, s.trackId));
  if (there(s.intensity, plan.hasIntensity))
    data->AddArray(makeArray<vtkFloatArray>("Intensity", 1, s.intensity));
  for (const rimflow::TrackColumn& c : s.further)
    data->AddArray(makeArray<vtkDoubleArray>(c.name.c_str(), 1, c.values));
  if (s.size() == 0 && s.further.empty())
    for (const std::string& name : plan.furtherNames)
      data->AddArray(makeArray<vtkDoubleArray>(name.c_str(), 1, std::vector<double>()));
  data->SetActiveVectors("Velocity");
}

// Cells over consecutive points: cell c is points offsets[c] to offsets[c+1].
vtkSmartPointer<vtkCellArray> consecutive(const std::vector<vtkIdType>& offsets) {
  std::vector<vtkIdType> points(std::size_t(offsets.back() - offsets.front()));
  std::iota(points.begin(), points.end(), offsets.front());
  std::vector<vtkIdType> fromZero(offsets);
  for (vtkIdType& o : fromZero) o -= offsets.front();
  auto cells = vtkSmartPointer<vtkCellArray>::New();
  cells->SetData(makeArray<vtkIdTypeArray>("", 1, fromZero), makeArray<vtkIdTypeArray>("", 1, points));
  return cells;
}

vtkSmartPointer<vtkCellArray> verticesFor(vtkIdType points) {
  std::vector<vtkIdType> offsets(std::size_t(points) + 1);
  std::iota(offsets.begin(), offsets.end(), 0);
  return consecutive(offsets);
}

} // namespace

// The files that are open, and what was read from them.
struct vtkSTBTrackReader::Series {
  vtkSTBTrackReader* self;
  std::unique_ptr<rimflow::TrackFile> tracks;
  rimflow::TrackTimeline line;
  rimflow::SnapshotCache cache;
  rimflow::TrackUnits units; // of the snapshots in the cache
  std::unique_ptr<rimflow::TrackLengths> lengths;
  std::set<std::string> told; // warnings
  double progressBegin = 0, progressEnd = 1;

  explicit Series(vtkSTBTrackReader* reader) : self(reader) {}

  rimflow::Progress progress() {
    return [this](double fraction) {
      self->UpdateProgress(progressBegin + fraction * (progressEnd - progressBegin));
      return !rimflow::aborted(self);
    };
  }
  // Each warning once, and not more of them than anybody reads.
  void tell(const std::vector<std::string>& warnings) {
    constexpr std::size_t most = 100;
    for (const std::string& w : warnings) {
      if (told.size() > most || !told.insert(w).second) continue;
      vtkWarningWithObjectMacro(self, << w << (told.size() > most ? " Further warnings are not shown." : ""));
    }
  }
  const rimflow::TrackColumnPlan& plan(std::size_t snapshot) const {
    return tracks->columns(line.entries[snapshot], rimflow::LengthUnit(self->LengthUnit));
  }

  void open(bool trustRowCounts = true) {
    cache.clear();
    lengths.reset();
    told.clear();
    tracks = rimflow::makeTrackFile(self->FileNames);
    if (!tracks->open(self->FileNames, progress(), trustRowCounts)) throw Aborted();
  }
  void arrange() {
    std::vector<std::string> warnings;
    line = tracks->timeline({self->FramePeriod, self->TimeShift, self->ShiftTimeToZero}, warnings);
    tell(warnings);
  }
  std::size_t nearest(double time) const {
    const auto after = std::lower_bound(line.times.begin(), line.times.end(), time);
    if (after == line.times.begin()) return 0;
    const std::size_t s = std::size_t(after - line.times.begin());
    return after != line.times.end() && line.times[s] - time <= time - line.times[s - 1] ? s : s - 1;
  }

  rimflow::SnapshotCache::Pointer read(std::size_t snapshot) {
    cache.setLimit(std::size_t(self->CacheSize) << 20);
    const rimflow::TrackUnits wanted(rimflow::LengthUnit(self->LengthUnit), self->FramePeriod);
    if (wanted != units) cache.clear();
    units = wanted;
    const std::size_t zone = line.entries[snapshot];
    if (auto found = cache.find(zone)) return found;
    auto fresh = std::make_shared<rimflow::TrackSnapshot>();
    std::vector<std::string> warnings;
    const bool done = tracks->read(zone, units, *fresh, warnings, progress());
    tell(warnings);
    if (!done) throw Aborted();
    cache.add(zone, fresh);
    return fresh;
  }

  // Goes through all files, once; a damaged snapshot counts as one where no track is.
  void countLengths() {
    auto counted = std::make_unique<rimflow::TrackLengths>();
    const double begin = progressBegin, end = progressEnd;
    std::vector<std::string> warnings;
    for (std::size_t s = 0; s < line.entries.size(); ++s) {
      progressBegin = begin + (end - begin) * double(s) / double(line.entries.size());
      progressEnd = progressBegin;
      if (!progress()(0)) throw Aborted();
      rimflow::TrackSnapshot ids;
      try {
        std::vector<std::string> toldWhenRead;
        if (!tracks->read(line.entries[s], units, ids, toldWhenRead, {},
                          rimflow::TrackFile::Content::TrackIds))
          throw Aborted();
      } catch (const rimflow::TrackIndexOutdated&) {
        throw;
      } catch (const std::runtime_error& e) {
        warnings.push_back(std::string(e.what()) + " (Its tracks are not counted for MinimumTrackLength.)");
      }
      counted->add(ids.trackId);
    }
    tell(warnings);
    lengths = std::move(counted);
    progressBegin = progressEnd = end;
  }

  rimflow::TrackSelection selection(std::size_t snapshot) {
    rimflow::TrackSelection s{self->Stride, self->TrackIdRange[0], self->TrackIdRange[1],
                              self->MinimumTrackLength, nullptr};
    const bool needsIds = s.firstId >= 0 || s.lastId >= 0 || s.minimumLength > 1;
    if (needsIds && !plan(snapshot).hasTrackId)
      throw std::runtime_error(
          tracks->fileOf(line.entries[snapshot]) +
          ": there is no column trackID, so TrackIdRange and MinimumTrackLength cannot be "
          "applied. Set them back, or export the track IDs too.");
    progressBegin = 0;
    progressEnd = 0.9;
    if (s.minimumLength > 1 && !lengths) countLengths();
    s.lengths = lengths.get();
    return s;
  }

  void particles(std::size_t snapshot, vtkPolyData* output) {
    const rimflow::TrackSelection chosen = selection(snapshot);
    progressEnd = 1;
    const auto all = read(snapshot);
    if (chosen.keepsAll())
      fillPoints(output, *all, plan(snapshot));
    else
      fillPoints(output, rimflow::takeRows(*all, rimflow::selectedRows(*all, chosen)), plan(snapshot));
    output->SetVerts(verticesFor(output->GetNumberOfPoints()));
  }

  void pathlines(std::size_t snapshot, vtkPolyData* output) {
    rimflow::PathlineBuilder builder(selection(snapshot));
    const std::size_t count = std::min(snapshot + 1, std::size_t(self->TrailLength));
    const double begin = progressBegin;
    for (std::size_t i = 0; i < count; ++i) {
      progressBegin = begin + (1 - begin) * double(i) / double(count);
      progressEnd = begin + (1 - begin) * double(i + 1) / double(count);
      const std::size_t s = snapshot + 1 - count + i;
      builder.add(read(s), line.times[s]);
    }
    const rimflow::Pathlines lines = builder.finish();
    if (!lines.dropped.empty()) {
      std::string names;
      for (const std::string& name : lines.dropped) names += (names.empty() ? "" : ", ") + name;
      tell({"Only some of the snapshots in the pathlines' window have " + names +
            ", so the pathlines come without. Open files with the same columns together."});
    }
    fillPoints(output, lines.points, plan(snapshot));
    output->GetPointData()->AddArray(makeArray<vtkDoubleArray>("Time", 1, lines.time));
    const auto middle = lines.offsets.begin() + std::ptrdiff_t(lines.singles);
    output->SetVerts(consecutive({lines.offsets.begin(), middle + 1}));
    output->SetLines(consecutive({middle, lines.offsets.end()}));
    output->GetCellData()->AddArray(makeArray<vtkIdTypeArray>("TrackId", 1, lines.trackId));
  }

  void fill(std::size_t snapshot, vtkPolyData* output) {
    if (self->OutputMode == PATHLINES)
      pathlines(snapshot, output);
    else
      particles(snapshot, output);
    const rimflow::TrackColumnPlan& columns = plan(snapshot);
    output->GetFieldData()->AddArray(
        makeArray<vtkIdTypeArray>("SnapshotIndex", 1, std::vector<vtkIdType>{vtkIdType(snapshot)}));
    vtkNew<vtkStringArray> units;
    units->SetName("FileUnits");
    for (const std::string& u : {columns.lengthUnit, columns.velocityUnit, columns.accelerationUnit})
      units->InsertNextValue(rimflow::toUtf8(u));
    output->GetFieldData()->AddArray(units);
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
    if (!this->Open || !this->Open->tracks->isOpen(this->FileNames)) {
      this->Open = std::make_unique<Series>(this);
      this->Open->open();
    }
    this->Open->arrange();
  } catch (const Aborted&) {
    this->Open.reset();
    this->Modified(); // so that the next update tries again
    return 1;
  } catch (const std::exception& problem) {
    this->Open.reset();
    if (vtkPolyData* output = vtkPolyData::GetData(outputs)) output->Initialize();
    vtkErrorMacro(<< problem.what());
    return 0;
  }
  const std::vector<double>& times = this->Open->line.times;
  const double range[2] = {times.front(), times.back()};
  information->Set(vtkStreamingDemandDrivenPipeline::TIME_STEPS(), times.data(), int(times.size()));
  information->Set(vtkStreamingDemandDrivenPipeline::TIME_RANGE(), range, 2);
  return 1;
}

int vtkSTBTrackReader::RequestData(vtkInformation*, vtkInformationVector**, vtkInformationVector* outputs) {
  vtkPolyData* output = vtkPolyData::GetData(outputs);
  output->Initialize();
  if (!this->Open) return 1; // aborted while the files were indexed
  vtkInformation* information = outputs->GetInformationObject(0);
  const bool asked = information->Has(vtkStreamingDemandDrivenPipeline::UPDATE_TIME_STEP());
  const std::vector<double> times = this->Open->line.times;
  const double time =
      asked ? information->Get(vtkStreamingDemandDrivenPipeline::UPDATE_TIME_STEP()) : times.front();
  const std::size_t snapshot = this->Open->nearest(time);
  vtkNew<vtkPolyData> result;
  try {
    try {
      this->Open->fill(snapshot, result);
    } catch (const rimflow::TrackIndexOutdated& why) {
      // The files have changed, or their row counts misled the index: look at all lines, and go on if the
      // times that downstream knows of are still right.
      this->Open->open(false);
      this->Open->arrange();
      if (this->Open->line.times != times) {
        throw std::runtime_error(
            std::string(why.what()) + " The files were read anew and hold " +
            std::to_string(this->Open->line.times.size()) + " snapshots instead of " +
            std::to_string(times.size()) +
            ": reload the files (F5 in ParaView, Modified() in a program) to have all times.");
      }
      result->Initialize();
      this->Open->fill(snapshot, result);
    }
  } catch (const Aborted&) {
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
     << indent << "TrackIdRange: " << this->TrackIdRange[0] << " " << this->TrackIdRange[1] << "\n"
     << indent << "Stride: " << this->Stride << "\n"
     << indent << "CacheSize: " << this->CacheSize << "\n";
}
