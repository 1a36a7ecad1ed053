// Breaks when vtkSTBTrackReader gives wrong particles, times, arrays or pathlines, depends on the order in
// which times are visited, reads what it need not, or fails without an error and an empty output.
#include "vtkSTBTrackReader.h"

#include "../Kernels/TrackFiles.h"

#include "vtkCallbackCommand.h"
#include "vtkCellData.h"
#include "vtkCommand.h"
#include "vtkDoubleArray.h"
#include "vtkExecutive.h"
#include "vtkFieldData.h"
#include "vtkFloatArray.h"
#include "vtkIdList.h"
#include "vtkIdTypeArray.h"
#include "vtkInformation.h"
#include "vtkNew.h"
#include "vtkPointData.h"
#include "vtkPolyData.h"
#include "vtkSmartPointer.h"
#include "vtkStreamingDemandDrivenPipeline.h"
#include "vtkStringArray.h"
#include "vtkTestErrorObserver.h"

#include <algorithm>
#include <cmath>
#include <gtest/gtest.h>
#include <map>
#include <random>
#include <set>

using namespace testing_tracks;
using SDDP = vtkStreamingDemandDrivenPipeline;

namespace {

const std::string data = RIMFLOW_TEST_DATA "/davis/";

std::vector<double> timesOf(vtkAlgorithm* reader) {
  reader->UpdateInformation();
  vtkInformation* information = reader->GetOutputInformation(0);
  const double* t = information->Get(SDDP::TIME_STEPS());
  return {t, t + information->Length(SDDP::TIME_STEPS())};
}
double dataTime(vtkSTBTrackReader* reader) {
  return reader->GetOutput()->GetInformation()->Get(vtkDataObject::DATA_TIME_STEP());
}
vtkIdType snapshotIndex(vtkSTBTrackReader* reader) {
  auto* index = vtkIdTypeArray::SafeDownCast(reader->GetOutput()->GetFieldData()->GetArray("SnapshotIndex"));
  return index ? index->GetValue(0) : -1;
}
double fieldNumber(vtkSTBTrackReader* reader, const char* name) {
  vtkDataArray* array = reader->GetOutput()->GetFieldData()->GetArray(name);
  return array ? array->GetComponent(0, 0) : std::nan("");
}
void expectEqual(vtkPolyData* a, vtkPolyData* b) {
  ASSERT_EQ(a->GetNumberOfPoints(), b->GetNumberOfPoints());
  ASSERT_EQ(a->GetNumberOfCells(), b->GetNumberOfCells());
  ASSERT_EQ(a->GetPointData()->GetNumberOfArrays(), b->GetPointData()->GetNumberOfArrays());
  for (vtkIdType p = 0; p < a->GetNumberOfPoints(); ++p)
    for (int c = 0; c < 3; ++c) ASSERT_EQ(a->GetPoint(p)[c], b->GetPoint(p)[c]);
  for (int i = 0; i < a->GetPointData()->GetNumberOfArrays(); ++i) {
    vtkDataArray* x = a->GetPointData()->GetArray(i);
    vtkDataArray* y = b->GetPointData()->GetArray(x->GetName());
    ASSERT_TRUE(y) << x->GetName();
    for (vtkIdType p = 0; p < x->GetNumberOfTuples(); ++p)
      for (int c = 0; c < x->GetNumberOfComponents(); ++c)
        ASSERT_EQ(x->GetComponent(p, c), y->GetComponent(p, c));
  }
  for (vtkIdType cell = 0; cell < a->GetNumberOfCells(); ++cell) {
    vtkNew<vtkIdList> i, j;
    a->GetCellPoints(cell, i);
    b->GetCellPoints(cell, j);
    ASSERT_EQ(i->GetNumberOfIds(), j->GetNumberOfIds());
    for (vtkIdType p = 0; p < i->GetNumberOfIds(); ++p) ASSERT_EQ(i->GetId(p), j->GetId(p));
  }
}

// Errors and warnings of a reader, on both itself and its executive.
struct Observed {
  vtkNew<vtkTest::ErrorObserver> observer;
  explicit Observed(vtkAlgorithm* reader) {
    for (auto event : {vtkCommand::ErrorEvent, vtkCommand::WarningEvent}) {
      reader->AddObserver(event, observer);
      reader->GetExecutive()->AddObserver(event, observer);
    }
  }
  bool saw(const std::string& what) { return observer->GetErrorMessage().find(what) != std::string::npos; }
  bool warned(const std::string& what) {
    return observer->GetWarningMessage().find(what) != std::string::npos;
  }
};

} // namespace

TEST(VtkSTBTrackReader, ReadsTheSampleOfOneFile) {
  const std::string file = data + "onefile_8zones_utf8.dat";
  EXPECT_EQ(vtkSTBTrackReader::CanReadFile(file.c_str()), 1);
  EXPECT_EQ(vtkSTBTrackReader::CanReadFile((data + "NOTE.txt").c_str()), 0);
  EXPECT_EQ(vtkSTBTrackReader::CanReadFile((data + "none.dat").c_str()), 0);
  vtkNew<vtkSTBTrackReader> reader;
  Observed observed(reader);
  reader->SetFileName(file.c_str());
  const std::vector<double> times = timesOf(reader);
  ASSERT_EQ(times.size(), 8u);
  EXPECT_EQ(times[0], 43.124719773);
  EXPECT_EQ(times[7], 43.131719773);
  EXPECT_EQ(reader->GetOutputInformation(0)->Get(SDDP::TIME_RANGE())[1], 43.131719773);
  const vtkIdType counts[] = {7, 15, 19, 27, 35, 40, 43, 49};
  for (int k : {3, 0, 7, 1, 2, 6, 5, 4}) {
    reader->UpdateTimeStep(times[std::size_t(k)]);
    vtkPolyData* output = reader->GetOutput();
    EXPECT_EQ(output->GetNumberOfPoints(), counts[k]);
    EXPECT_EQ(output->GetNumberOfVerts(), counts[k]);
    EXPECT_EQ(output->GetNumberOfCells(), counts[k]);
    EXPECT_EQ(dataTime(reader), times[std::size_t(k)]);
    EXPECT_EQ(snapshotIndex(reader), k);
  }
  reader->UpdateTimeStep(times[0]);
  vtkPolyData* output = reader->GetOutput();
  vtkPointData* arrays = output->GetPointData();
  ASSERT_TRUE(vtkFloatArray::SafeDownCast(output->GetPoints()->GetData()));
  EXPECT_FLOAT_EQ(float(output->GetPoint(0)[0]), 43.0536e-3f);
  EXPECT_FLOAT_EQ(float(output->GetPoint(1)[2]), 51.7557e-3f);
  auto* velocity = vtkFloatArray::SafeDownCast(arrays->GetArray("Velocity"));
  auto* acceleration = vtkFloatArray::SafeDownCast(arrays->GetArray("Acceleration"));
  auto* intensity = vtkFloatArray::SafeDownCast(arrays->GetArray("Intensity"));
  auto* trackId = vtkIdTypeArray::SafeDownCast(arrays->GetArray("TrackId"));
  ASSERT_TRUE(velocity && acceleration && intensity && trackId && arrays->GetArray("Absolute intensity"));
  EXPECT_EQ(arrays->GetNumberOfArrays(), 5);
  EXPECT_EQ(arrays->GetVectors(), velocity);
  EXPECT_FLOAT_EQ(velocity->GetTypedComponent(0, 1), -1.38054f);
  EXPECT_FLOAT_EQ(acceleration->GetTypedComponent(1, 2), 5.45025f);
  EXPECT_FLOAT_EQ(intensity->GetValue(0), 0.443057f);
  EXPECT_EQ(arrays->GetArray("Absolute intensity")->GetComponent(1, 0), 491.896);
  EXPECT_EQ(trackId->GetValue(1), 10);
  auto* units = vtkStringArray::SafeDownCast(output->GetFieldData()->GetAbstractArray("FileUnits"));
  ASSERT_TRUE(units);
  EXPECT_EQ(units->GetValue(0), "mm");
  EXPECT_EQ(units->GetValue(1), "m/s");
  EXPECT_EQ(units->GetValue(2), "m/s\xC2\xB2");
  EXPECT_FALSE(observed.observer->GetError() || observed.observer->GetWarning());
}

TEST(VtkSTBTrackReader, ReadsTheSamplesOfOneFilePerSnapshot) {
  for (const char* folder : {"latin1_14col", "old_8col"}) {
    const bool old = folder[0] == 'o';
    vtkNew<vtkSTBTrackReader> reader, one;
    Observed observed(reader);
    for (int k : {4, 2, 6, 1, 5, 3})
      reader->AddFileName((data + folder + "/B0000" + std::to_string(k) + ".dat").c_str());
    EXPECT_EQ(reader->GetNumberOfFileNames(), 6);
    one->SetFileName((data + "onefile_8zones_utf8.dat").c_str());
    reader->SetFramePeriod(0.001);
    const std::vector<double> times = timesOf(reader), oneTimes = timesOf(one);
    ASSERT_EQ(times.size(), 6u);
    for (std::size_t k = 0; k < 6; ++k) {
      EXPECT_NEAR(times[k], old ? 0.001 * (100 + double(k)) : oneTimes[k], 1e-12);
      reader->UpdateTimeStep(times[k]);
      one->UpdateTimeStep(oneTimes[k]);
      vtkPointData* arrays = reader->GetOutput()->GetPointData();
      EXPECT_TRUE(arrays->HasArray("Acceleration")); // the old layout has none: estimated
      if (!old) expectEqual(reader->GetOutput(), one->GetOutput());
      ASSERT_EQ(reader->GetOutput()->GetNumberOfPoints(), one->GetOutput()->GetNumberOfPoints());
      for (const char* name : {"Velocity", "TrackId"})
        for (vtkIdType p = 0; p < reader->GetOutput()->GetNumberOfPoints(); ++p)
          EXPECT_EQ(arrays->GetArray(name)->GetComponent(p, 0),
                    one->GetOutput()->GetPointData()->GetArray(name)->GetComponent(p, 0));
    }
    EXPECT_FALSE(observed.observer->GetError() || observed.observer->GetWarning());
  }
}

TEST(VtkSTBTrackReader, SnapsToTheNearestTimeAndShifts) {
  vtkNew<vtkSTBTrackReader> reader;
  reader->SetFileName((data + "onefile_8zones_utf8.dat").c_str());
  reader->UpdateTimeStep(43.1273);
  EXPECT_EQ(dataTime(reader), 43.127719773);
  reader->UpdateTimeStep(-5);
  EXPECT_EQ(snapshotIndex(reader), 0);
  reader->UpdateTimeStep(1e9);
  EXPECT_EQ(snapshotIndex(reader), 7);
  reader->SetShiftTimeToZero(true);
  reader->SetTimeShift(0.5);
  const std::vector<double> times = timesOf(reader);
  EXPECT_EQ(times[0], 0.5);
  EXPECT_NEAR(times[7], 0.507, 1e-12);
  reader->UpdateTimeStep(0.5032);
  EXPECT_EQ(snapshotIndex(reader), 3);
  EXPECT_EQ(dataTime(reader), times[3]);
}

TEST(VtkSTBTrackReader, ChoosesWholeTracks) {
  vtkNew<vtkSTBTrackReader> reader;
  reader->SetFileName((data + "onefile_8zones_utf8.dat").c_str());
  const std::vector<double> times = timesOf(reader);
  std::map<vtkIdType, int> length;
  std::vector<std::vector<vtkIdType>> all;
  const auto idsAt = [&](double t) {
    reader->UpdateTimeStep(t);
    std::vector<vtkIdType> ids;
    auto* array = vtkIdTypeArray::SafeDownCast(reader->GetOutput()->GetPointData()->GetArray("TrackId"));
    for (vtkIdType p = 0; p < reader->GetOutput()->GetNumberOfPoints(); ++p)
      ids.push_back(array->GetValue(p));
    EXPECT_EQ(reader->GetOutput()->GetNumberOfVerts(), vtkIdType(ids.size()));
    return ids;
  };
  for (double t : times) {
    all.push_back(idsAt(t));
    for (vtkIdType id : all.back()) ++length[id];
  }
  const auto expectKept = [&](auto keep) {
    std::size_t left = 0;
    for (std::size_t k = 0; k < times.size(); ++k) {
      std::vector<vtkIdType> expected;
      for (vtkIdType id : all[k])
        if (keep(id)) expected.push_back(id);
      EXPECT_EQ(idsAt(times[k]), expected);
      left += expected.size();
    }
    EXPECT_GT(left, 0u);
  };
  reader->SetStride(3);
  expectKept([](vtkIdType id) { return id % 3 == 0; });
  reader->SetStride(1);
  reader->SetTrackIdRange(5, 30);
  expectKept([](vtkIdType id) { return id >= 5 && id <= 30; });
  reader->SetTrackIdRange(-1, 12);
  expectKept([](vtkIdType id) { return id <= 12; });
  reader->SetTrackIdRange(-1, -1);
  reader->SetMinimumTrackLength(6);
  expectKept([&](vtkIdType id) { return length[id] >= 6; });
}

TEST(VtkSTBTrackReader, PathlinesFollowTheTracksOfTheWindow) {
  vtkNew<vtkSTBTrackReader> particles, lines;
  for (vtkSTBTrackReader* r : {particles.Get(), lines.Get()})
    r->SetFileName((data + "onefile_8zones_utf8.dat").c_str());
  lines->SetOutputMode(vtkSTBTrackReader::PATHLINES);
  lines->SetTrailLength(4);
  const std::vector<double> times = timesOf(particles);
  for (std::size_t k : {7, 0, 2, 5}) {
    // id -> snapshot -> position, from the particles
    std::map<vtkIdType, std::map<std::size_t, std::array<double, 3>>> tracks;
    vtkIdType total = 0;
    for (std::size_t s = k < 3 ? 0 : k - 3; s <= k; ++s) {
      particles->UpdateTimeStep(times[s]);
      vtkPolyData* p = particles->GetOutput();
      for (vtkIdType i = 0; i < p->GetNumberOfPoints(); ++i, ++total)
        tracks[vtkIdType(p->GetPointData()->GetArray("TrackId")->GetComponent(i, 0))][s] = {
            p->GetPoint(i)[0], p->GetPoint(i)[1], p->GetPoint(i)[2]};
    }
    lines->UpdateTimeStep(times[k]);
    vtkPolyData* output = lines->GetOutput();
    EXPECT_EQ(snapshotIndex(lines), vtkIdType(k));
    EXPECT_EQ(output->GetNumberOfPoints(), total);
    auto* time = vtkDoubleArray::SafeDownCast(output->GetPointData()->GetArray("Time"));
    auto* pointId = output->GetPointData()->GetArray("TrackId");
    auto* cellId = vtkIdTypeArray::SafeDownCast(output->GetCellData()->GetArray("TrackId"));
    ASSERT_TRUE(time && pointId && cellId);
    for (const char* name : {"Velocity", "Acceleration", "Intensity"})
      EXPECT_TRUE(output->GetPointData()->HasArray(name));
    ASSERT_EQ(cellId->GetNumberOfTuples(), output->GetNumberOfCells());
    vtkIdType pieces = 0;
    for (const auto& [id, points] : tracks)
      for (const auto& [s, x] : points) pieces += !points.count(s - 1);
    EXPECT_EQ(output->GetNumberOfCells(), pieces);
    for (vtkIdType c = 0; c < output->GetNumberOfCells(); ++c) {
      vtkNew<vtkIdList> ids;
      output->GetCellPoints(c, ids);
      EXPECT_EQ(output->GetCellType(c), ids->GetNumberOfIds() == 1   ? VTK_VERTEX
                                        : ids->GetNumberOfIds() == 2 ? VTK_LINE
                                                                     : VTK_POLY_LINE);
      for (vtkIdType i = 0; i < ids->GetNumberOfIds(); ++i) {
        const vtkIdType p = ids->GetId(i);
        ASSERT_EQ(pointId->GetComponent(p, 0), cellId->GetValue(c));
        const std::size_t s =
            std::size_t(std::lower_bound(times.begin(), times.end(), time->GetValue(p)) - times.begin());
        ASSERT_TRUE(tracks[cellId->GetValue(c)].count(s));
        for (int d = 0; d < 3; ++d)
          EXPECT_EQ(output->GetPoint(p)[d], tracks[cellId->GetValue(c)][s][std::size_t(d)]);
        if (i == 0) continue;
        EXPECT_NEAR(time->GetValue(p) - time->GetValue(ids->GetId(i - 1)), 0.001, 1e-9);
      }
    }
  }
}

TEST(VtkSTBTrackReader, RandomJumpsEqualASequentialPass) {
  Folder folder;
  const Dialect dialect;
  std::mt19937 random(2);
  std::string text = dialect.variables();
  for (int k = 0; k < 15; ++k) {
    std::vector<long> ids;
    for (long id = 0; id < 400; ++id)
      if (random() % 6) ids.push_back(id);
    text += dialect.zone(k, k == 9 ? std::vector<long>() : ids);
  }
  const std::string file = folder.write("t.dat", text);
  for (int cache : {256, 0})
    for (int mode : {vtkSTBTrackReader::PARTICLES, vtkSTBTrackReader::PATHLINES}) {
      vtkNew<vtkSTBTrackReader> sequential, jumping;
      for (vtkSTBTrackReader* r : {sequential.Get(), jumping.Get()}) {
        r->SetFileName(file.c_str());
        r->SetOutputMode(mode);
        r->SetTrailLength(5);
      }
      jumping->SetCacheSize(cache);
      const std::vector<double> times = timesOf(sequential);
      std::vector<vtkSmartPointer<vtkPolyData>> expected;
      for (double t : times) {
        sequential->UpdateTimeStep(t);
        expected.push_back(vtkSmartPointer<vtkPolyData>::New());
        expected.back()->DeepCopy(sequential->GetOutput());
      }
      EXPECT_EQ(expected[9]->GetNumberOfPoints() == 0, mode == vtkSTBTrackReader::PARTICLES);
      for (int jump = 0; jump < 40; ++jump) {
        const std::size_t k = random() % times.size();
        jumping->UpdateTimeStep(times[k]);
        expectEqual(jumping->GetOutput(), expected[k]);
        EXPECT_EQ(dataTime(jumping), times[k]);
      }
    }
}

TEST(VtkSTBTrackReader, AnEmptySnapshotKeepsItsArrays) {
  Folder folder;
  const Dialect dialect;
  vtkNew<vtkSTBTrackReader> reader;
  Observed observed(reader);
  reader->SetFileName(
      folder.write("t.dat", dialect.variables() + dialect.zone(0, {1, 2}) + dialect.zone(1, {})).c_str());
  for (int mode : {vtkSTBTrackReader::PARTICLES, vtkSTBTrackReader::PATHLINES}) {
    reader->SetOutputMode(mode);
    reader->SetTrailLength(1);
    reader->UpdateTimeStep(44);
    EXPECT_EQ(snapshotIndex(reader), 1);
    EXPECT_EQ(reader->GetOutput()->GetNumberOfPoints(), 0);
    EXPECT_EQ(reader->GetOutput()->GetNumberOfCells(), 0);
    for (const char* name : {"Velocity", "Acceleration", "TrackId", "Intensity"})
      EXPECT_TRUE(reader->GetOutput()->GetPointData()->HasArray(name)) << name;
  }
  EXPECT_FALSE(observed.observer->GetError() || observed.observer->GetWarning());
}

TEST(VtkSTBTrackReader, SettingsThatDoNotConcernTheFilesDoNotOpenThemAgain) {
  Folder folder;
  const Dialect dialect;
  const std::string file = folder.writeGzip("t.dat.gz", dialect.variables() + dialect.zone(0, {1, 2, 3}) +
                                                            dialect.zone(1, {1, 2, 3}));
  vtkNew<vtkSTBTrackReader> reader;
  reader->SetFileName(file.c_str());
  reader->Update();
  // A compressed file is unpacked when it is opened: without room for that, opening again would fail.
  const char* before = std::getenv("TMPDIR");
  const std::string kept = before ? before : "";
  setenv("TMPDIR", (folder / "none").c_str(), 1);
  Observed observed(reader);
  reader->SetStride(2);
  reader->SetLengthUnit(vtkSTBTrackReader::METRE);
  reader->SetShiftTimeToZero(true);
  reader->SetOutputMode(vtkSTBTrackReader::PATHLINES);
  reader->SetMinimumTrackLength(2);
  reader->UpdateTimeStep(1);
  EXPECT_EQ(reader->GetOutput()->GetNumberOfLines(), 1);
  EXPECT_DOUBLE_EQ(reader->GetOutput()->GetPoint(0)[0], 1.0); // x of track 2, now in m
  EXPECT_FALSE(observed.observer->GetError() || observed.observer->GetWarning());
  before ? setenv("TMPDIR", kept.c_str(), 1) : unsetenv("TMPDIR");
}

TEST(VtkSTBTrackReader, ErrorsEmptyTheOutputAndOtherSnapshotsStayReadable) {
  Folder folder;
  const Dialect dialect;
  std::string bad = dialect.zone(1, {3, 4});
  bad.replace(bad.rfind(" -"), 2, " -x");
  vtkNew<vtkSTBTrackReader> reader;
  Observed observed(reader);
  reader->SetFileName(
      folder.write("t.dat", dialect.variables() + dialect.zone(0, {1, 2}) + bad + dialect.zone(2, {5}))
          .c_str());
  const std::vector<double> times = timesOf(reader);
  ASSERT_EQ(times.size(), 3u);
  reader->UpdateTimeStep(times[0]);
  EXPECT_EQ(reader->GetOutput()->GetNumberOfPoints(), 2);
  reader->UpdateTimeStep(times[1]);
  EXPECT_EQ(reader->GetOutput()->GetNumberOfPoints(), 0);
  EXPECT_EQ(reader->GetOutput()->GetNumberOfCells(), 0);
  EXPECT_TRUE(observed.saw("t.dat, line 14: found \"-x")) << observed.observer->GetErrorMessage();
  EXPECT_TRUE(observed.saw("Repair this row"));
  observed.observer->Clear();
  reader->UpdateTimeStep(times[2]);
  EXPECT_EQ(reader->GetOutput()->GetNumberOfPoints(), 1);
  EXPECT_FALSE(observed.observer->GetError());
  reader->SetOutputMode(vtkSTBTrackReader::PATHLINES);
  reader->Update(); // the tracks count as absent in the damaged snapshot
  EXPECT_FALSE(observed.observer->GetError());
  EXPECT_EQ(reader->GetOutput()->GetNumberOfPoints(), 3);
  reader->UpdateTimeStep(times[1]);
  EXPECT_TRUE(observed.saw("t.dat, line 14"));
  EXPECT_EQ(reader->GetOutput()->GetNumberOfPoints(), 0);
  observed.observer->Clear();

  reader->SetOutputMode(vtkSTBTrackReader::PARTICLES);
  reader->UpdateTimeStep(times[2]);
  EXPECT_EQ(reader->GetOutput()->GetNumberOfPoints(), 1);
  reader->SetFileName((folder / "none.dat").c_str());
  reader->Update();
  EXPECT_TRUE(observed.saw("none.dat: cannot be opened"));
  EXPECT_EQ(reader->GetOutput()->GetNumberOfPoints(), 0);
  EXPECT_FALSE(reader->GetOutputInformation(0)->Has(SDDP::TIME_STEPS()));
  observed.observer->Clear();
  reader->RemoveAllFileNames();
  reader->Update();
  EXPECT_TRUE(observed.saw("FileNames"));
}

TEST(VtkSTBTrackReader, EveryFormatHasTimesArraysPathlinesAndChoices) {
  const std::string samples = RIMFLOW_TEST_DATA;
  struct Format {
    std::vector<std::string> files;
    std::size_t times;
    vtkIdType particles, tracks; // in all snapshots
  };
  const std::vector<Format> formats = {
      {{"/openlpt/ExitTrack_12.csv", "/openlpt/LongTrackActive_12.csv"}, 12, 108, 9},
      {{"/myptv/smoothed_trajectories"}, 7, 222, 34},
      {{"/myptv/trajectories"}, 7, 281, 36},
      {{"/openptv/ptv_is.7", "/openptv/ptv_is.8", "/openptv/ptv_is.9"}, 3, 12, 5}};
  for (const Format& f : formats) {
    vtkNew<vtkSTBTrackReader> reader;
    Observed observed(reader);
    for (const std::string& file : f.files) reader->AddFileName((samples + file).c_str());
    reader->SetFramePeriod(0.002);
    const std::vector<double> times = timesOf(reader);
    ASSERT_EQ(times.size(), f.times) << f.files[0];
    vtkIdType particles = 0;
    std::map<vtkIdType, int> length;
    for (const double t : times) {
      reader->UpdateTimeStep(t);
      vtkPointData* arrays = reader->GetOutput()->GetPointData();
      EXPECT_TRUE(arrays->HasArray("Velocity") && arrays->HasArray("Acceleration"));
      EXPECT_GT(fieldNumber(reader, "PositionNoise") * fieldNumber(reader, "VelocityNoise"), 0) << f.files[0];
      particles += reader->GetOutput()->GetNumberOfPoints();
      auto* ids = vtkIdTypeArray::SafeDownCast(arrays->GetArray("TrackId"));
      ASSERT_NE(ids, nullptr);
      for (vtkIdType i = 0; i < ids->GetNumberOfTuples(); ++i)
        if (ids->GetValue(i) >= 0) ++length[ids->GetValue(i)];
      for (int c = 0; c < 6; ++c) EXPECT_LT(std::abs(reader->GetOutput()->GetBounds()[c]), 0.2); // m
    }
    EXPECT_EQ(particles, f.particles) << f.files[0];
    EXPECT_EQ(vtkIdType(length.size()), f.tracks) << f.files[0];
    reader->SetMinimumTrackLength(3);
    reader->SetOutputMode(vtkSTBTrackReader::PATHLINES);
    reader->SetTrailLength(int(times.size()));
    reader->UpdateTimeStep(times.back());
    std::set<vtkIdType> lines;
    auto* cellIds = vtkIdTypeArray::SafeDownCast(reader->GetOutput()->GetCellData()->GetArray("TrackId"));
    for (vtkIdType c = 0; c < cellIds->GetNumberOfTuples(); ++c) lines.insert(cellIds->GetValue(c));
    EXPECT_EQ(lines.size(), std::size_t(std::count_if(length.begin(), length.end(),
                                                      [](auto& l) { return l.second >= 3; })));
    EXPECT_GT(lines.size(), 0u);
    EXPECT_FALSE(observed.observer->GetError() || observed.observer->GetWarning())
        << observed.observer->GetWarningMessage();
  }
}

TEST(VtkSTBTrackReader, VelocitiesComeFromTheFileOrThePositions) {
  vtkNew<vtkSTBTrackReader> reader;
  for (int k = 1; k <= 6; ++k)
    reader->AddFileName((data + "old_8col/B0000" + std::to_string(k) + ".dat").c_str());
  reader->SetFramePeriod(0.0001);
  constexpr double longest = 21; // a track that is in all six snapshots
  const double time = timesOf(reader)[3];
  const auto at = [&](int estimate, int order, int window) {
    reader->SetEstimateVelocities(estimate);
    reader->SetPolynomialOrder(order);
    reader->SetPolynomialWindow(window);
    reader->UpdateTimeStep(time);
    vtkPointData* arrays = reader->GetOutput()->GetPointData();
    vtkDataArray *v = arrays->GetArray("Velocity"), *id = arrays->GetArray("TrackId");
    for (vtkIdType p = 0; v && p < v->GetNumberOfTuples(); ++p)
      if (id->GetComponent(p, 0) == longest) return v->GetComponent(p, 1);
    return std::nan("");
  };
  const double file = at(vtkSTBTrackReader::MISSING, 2, 9), own = at(vtkSTBTrackReader::ALWAYS, 2, 5),
               other = at(vtkSTBTrackReader::ALWAYS, 2, 3);
  EXPECT_EQ(at(vtkSTBTrackReader::NEVER, 2, 9), file);
  EXPECT_FALSE(reader->GetOutput()->GetPointData()->HasArray("Acceleration"));
  EXPECT_NE(own, file);
  EXPECT_NE(own, other);
  EXPECT_NEAR(own, file, 0.3 * std::abs(file));
  Observed observed(reader);
  at(vtkSTBTrackReader::ALWAYS, 2, 6);
  EXPECT_TRUE(observed.saw("odd")) << observed.observer->GetErrorMessage();
  EXPECT_EQ(reader->GetOutput()->GetNumberOfPoints(), 0);
}

TEST(VtkSTBTrackReader, TimeRangeStatisticsAndWholePathlines) {
  vtkNew<vtkSTBTrackReader> reader, all;
  for (vtkSTBTrackReader* r : {reader.Get(), all.Get()})
    r->SetFileName((data + "onefile_8zones_utf8.dat").c_str());
  const std::vector<double> times = timesOf(all);
  reader->SetUseTimeRange(true);
  reader->SetTimeRange(times[2] - 1e-5, times[5] + 1e-5);
  EXPECT_EQ(timesOf(reader), (std::vector<double>{times.begin() + 2, times.begin() + 6}));
  reader->UpdateTimeStep(times[0]);
  EXPECT_EQ(dataTime(reader), times[2]);
  EXPECT_EQ(snapshotIndex(reader), 2); // of the whole series

  reader->SetTrackStatistics(true);
  reader->UpdateTimeStep(times[4]);
  vtkPointData* arrays = reader->GetOutput()->GetPointData();
  const auto number = [&](const char* name, vtkIdType p) {
    return arrays->GetArray(name)->GetComponent(p, 0);
  };
  for (vtkIdType p = 0; p < reader->GetOutput()->GetNumberOfPoints(); ++p) {
    EXPECT_GE(number("TrackLength", p), 1);
    EXPECT_NEAR(number("TrackAge", p), times[4] - number("TrackStart", p), 1e-12);
    EXPECT_GE(number("TrackEnd", p), times[4]);
    EXPECT_NEAR((number("TrackEnd", p) - number("TrackStart", p)) / 0.001 + 1, number("TrackLength", p),
                1e-6);
  }

  reader->SetOutputMode(vtkSTBTrackReader::PATHLINES);
  reader->SetTrailLength(0);
  reader->UpdateTimeStep(times[2]);
  vtkNew<vtkPolyData> first;
  first->DeepCopy(reader->GetOutput());
  EXPECT_TRUE(first->GetPointData()->HasArray("TrackAge"));
  reader->UpdateTimeStep(times[5]);
  expectEqual(reader->GetOutput(), first); // whatever the time
  EXPECT_EQ(dataTime(reader), times[5]);
  EXPECT_EQ(snapshotIndex(reader), 5);
  reader->SetTrackStatistics(false);
  reader->UpdateTimeStep(times[2]);
  all->SetOutputMode(vtkSTBTrackReader::PATHLINES);
  all->SetTrailLength(4);
  all->UpdateTimeStep(times[5]);
  expectEqual(reader->GetOutput(), all->GetOutput());

  Observed observed(reader);
  reader->SetTimeRange(1, 2);
  reader->Update();
  EXPECT_TRUE(observed.saw("TimeRange"));
  EXPECT_EQ(reader->GetOutput()->GetNumberOfPoints(), 0);
}

TEST(VtkSTBTrackReader, VelocitiesPerFrameNeedTheFramePeriod) {
  vtkNew<vtkSTBTrackReader> reader;
  Observed observed(reader);
  reader->SetFileName((std::string(RIMFLOW_TEST_DATA) + "/myptv/smoothed_trajectories").c_str());
  reader->Update();
  EXPECT_TRUE(observed.saw("per frame"));
  EXPECT_TRUE(observed.saw("Set FramePeriod"));
  EXPECT_EQ(reader->GetOutput()->GetNumberOfPoints(), 0);
  observed.observer->Clear();
  reader->SetFramePeriod(0.002);
  reader->UpdateTimeStep(0.006);
  EXPECT_FALSE(observed.observer->GetError());
  const auto speed = [&] {
    return reader->GetOutput()->GetPointData()->GetArray("Velocity")->GetComponent(0, 0);
  };
  const double v = speed();
  reader->SetFramePeriod(0.001); // twice as fast, also from the cache
  reader->UpdateTimeStep(0.003);
  EXPECT_NEAR(speed(), 2 * v, 1e-6 * std::abs(v));
  EXPECT_GT(std::abs(v), 0);
}

TEST(VtkSTBTrackReader, WithoutTrackIdsParticlesComeAndPathlinesSayWhy) {
  Folder folder;
  vtkNew<vtkSTBTrackReader> reader;
  Observed observed(reader);
  reader->SetFileName(
      folder.write("t.dat", "VARIABLES = \"x\" \"y\" \"z\"\nZONE T=\"0\"\n1 2 3\n4 5 6\n").c_str());
  reader->Update();
  EXPECT_EQ(reader->GetOutput()->GetNumberOfPoints(), 2);
  EXPECT_EQ(reader->GetOutput()->GetPointData()->GetNumberOfArrays(), 0);
  EXPECT_TRUE(observed.warned("velocities") || observed.warned("trackID") || observed.warned("FramePeriod"));
  EXPECT_FALSE(observed.observer->GetError());
  reader->SetTrackIdRange(1, 5);
  reader->Update();
  EXPECT_TRUE(observed.saw("no column trackID"));
  EXPECT_EQ(reader->GetOutput()->GetNumberOfPoints(), 0);
  observed.observer->Clear();
  reader->SetTrackIdRange(-1, -1);
  reader->SetOutputMode(vtkSTBTrackReader::PATHLINES);
  reader->Update();
  EXPECT_TRUE(observed.saw("so Pathlines"));
  observed.observer->Clear();
  reader->SetOutputMode(vtkSTBTrackReader::PARTICLES);
  reader->SetTrackStatistics(true);
  reader->Update();
  EXPECT_TRUE(observed.saw("no column trackID"));
}

TEST(VtkSTBTrackReader, AFileThatGrewIsReadAnew) {
  Folder folder;
  const Dialect dialect;
  const std::string two = dialect.variables() + dialect.zone(0, {1, 2}) + dialect.zone(1, {1, 2, 3});
  vtkNew<vtkSTBTrackReader> reader;
  Observed observed(reader);
  reader->SetFileName(folder.write("t.dat", two).c_str());
  reader->SetCacheSize(0);
  const std::vector<double> times = timesOf(reader);
  reader->UpdateTimeStep(times[0]);
  folder.write("t.dat", two + dialect.zone(2, {7}));
  reader->UpdateTimeStep(times[1]);
  EXPECT_TRUE(observed.saw("3 snapshots instead of 2"));
  EXPECT_EQ(reader->GetOutput()->GetNumberOfPoints(), 0);
  EXPECT_TRUE(observed.saw("reload"));
  observed.observer->Clear();
  reader->Modified();
  ASSERT_EQ(timesOf(reader).size(), 3u);
  reader->UpdateTimeStep(times[1]);
  EXPECT_EQ(reader->GetOutput()->GetNumberOfPoints(), 3);
  EXPECT_FALSE(observed.observer->GetError());
}

TEST(VtkSTBTrackReader, AWarningIsGivenOnce) {
  Folder folder;
  const Dialect dialect;
  std::string zone = dialect.zone(0, {1, 2});
  zone.replace(zone.find("I=2"), 3, "I=5");
  vtkNew<vtkSTBTrackReader> reader;
  int warnings = 0;
  vtkNew<vtkCallbackCommand> count;
  count->SetClientData(&warnings);
  count->SetCallback([](vtkObject*, unsigned long, void* n, void*) { ++*static_cast<int*>(n); });
  reader->AddObserver(vtkCommand::WarningEvent, count);
  reader->SetCacheSize(0);
  reader->SetFileName(folder.write("t.dat", dialect.variables() + zone + dialect.zone(1, {1})).c_str());
  const std::vector<double> times = timesOf(reader);
  for (double t : {times[0], times[1], times[0], times[1], times[0]}) reader->UpdateTimeStep(t);
  EXPECT_EQ(warnings, 1);
  EXPECT_EQ(reader->GetOutput()->GetNumberOfPoints(), 2);
}

TEST(VtkSTBTrackReader, AbortLeavesTheOutputEmpty) {
  vtkNew<vtkSTBTrackReader> reader;
  reader->SetFileName((data + "onefile_8zones_utf8.dat").c_str());
  reader->SetOutputMode(vtkSTBTrackReader::PATHLINES);
  reader->UpdateInformation();
  vtkNew<vtkCallbackCommand> stop;
  stop->SetCallback([](vtkObject* caller, unsigned long, void*, void*) {
    static_cast<vtkAlgorithm*>(caller)->SetAbortExecute(1);
  });
  reader->AddObserver(vtkCommand::ProgressEvent, stop);
  reader->UpdateTimeStep(44);
  EXPECT_EQ(reader->GetOutput()->GetNumberOfPoints(), 0);
  reader->RemoveAllObservers();
  reader->SetAbortExecute(0);
  reader->Modified();
  reader->UpdateTimeStep(44);
  EXPECT_GT(reader->GetOutput()->GetNumberOfPoints(), 49);
}
