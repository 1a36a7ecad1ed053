// vtkQCriterion beside vtkGradientFilter on the grid of the paper's typical case (160 x 109 x 36, float),
// both with two threads. VTK's filter gets the fastest settings it has: only Q, no gradient, and VTK's
// threads (STDThread) as well as its default without. "memory" reads and writes what Q has to, and does
// nothing else.
#include "SideBySide.h"

#include "QCriterionKernel.h"
#include "vtkGridFromImage.h"
#include "vtkQCriterion.h"

#include "vtkDataObject.h"
#include "vtkFloatArray.h"
#include "vtkGradientFilter.h"
#include "vtkImageData.h"
#include "vtkNew.h"
#include "vtkPointData.h"
#include "vtkSMPTools.h"
#include "vtkUnsignedCharArray.h"

#include <cmath>
#include <omp.h>
#include <string>

namespace {

constexpr int Threads = 2, Repetitions = 41;

vtkImageData* field(bool masked) {
  static vtkNew<vtkImageData> images[2];
  vtkImageData* image = images[masked];
  if (image->GetNumberOfPoints() > 0) return image;
  image->SetDimensions(160, 109, 36);
  image->SetSpacing(0.689e-3, 0.689e-3, 0.689e-3);
  vtkNew<vtkFloatArray> u;
  u->SetName("Velocity");
  u->SetNumberOfComponents(3);
  u->SetNumberOfTuples(image->GetNumberOfPoints());
  vtkNew<vtkUnsignedCharArray> mask;
  mask->SetName("Mask");
  mask->SetNumberOfTuples(image->GetNumberOfPoints());
  for (vtkIdType p = 0; p < image->GetNumberOfPoints(); ++p) {
    double x[3];
    image->GetPoint(p, x);
    u->SetTuple3(p, std::sin(200 * x[1]) + 0.3 * std::cos(300 * x[2]),
                 std::cos(150 * x[2]) * std::sin(100 * x[0]), std::sin(100 * (x[0] + x[1])));
    mask->SetValue(p, std::hypot(x[0] - 0.05, x[1] - 0.04, x[2] - 0.012) < 0.0055);
  }
  image->GetPointData()->AddArray(u);
  if (masked) image->GetPointData()->AddArray(mask);
  return image;
}

void ours(benchmark::State& state, bool masked) {
  vtkNew<vtkQCriterion> filter;
  filter->SetInputData(field(masked));
  omp_set_num_threads(Threads);
  for (auto _ : state) {
    filter->Modified();
    filter->Update();
  }
}

void kernelAlone(benchmark::State& state) {
  vtkImageData* image = field(false);
  const rimflow::Grid grid = rimflow::gridOf(image);
  const float* u = rimflow::asFloat(image->GetPointData()->GetArray("Velocity"))->GetPointer(0);
  std::vector<float> q(grid.size());
  omp_set_num_threads(Threads);
  for (auto _ : state) {
    rimflow::qCriterion(grid, u, nullptr, 2, {q.data()});
    benchmark::DoNotOptimize(q.data());
    benchmark::ClobberMemory();
  }
}

void memory(benchmark::State& state) {
  vtkImageData* image = field(false);
  const std::size_t n = image->GetNumberOfPoints();
  const float* u = rimflow::asFloat(image->GetPointData()->GetArray("Velocity"))->GetPointer(0);
  std::vector<float> q(n);
  float* to = q.data();
  for (auto _ : state) {
#pragma omp parallel for num_threads(Threads) schedule(static)
    for (std::size_t p = 0; p < n; ++p) to[p] = u[3 * p] + u[3 * p + 1] + u[3 * p + 2];
    benchmark::DoNotOptimize(to);
    benchmark::ClobberMemory();
  }
}

void peer(benchmark::State& state, const char* backend) {
  vtkSMPTools::SetBackend(backend);
  vtkSMPTools::Initialize(Threads);
  if (vtkSMPTools::GetBackend() != std::string(backend)) {
    state.SkipWithError("this VTK was built without that backend");
    return;
  }
  vtkNew<vtkGradientFilter> filter;
  filter->SetInputData(field(false));
  filter->SetInputScalars(vtkDataObject::FIELD_ASSOCIATION_POINTS, "Velocity");
  filter->SetComputeGradient(false);
  filter->SetComputeQCriterion(true);
  for (auto _ : state) {
    filter->Modified();
    filter->Update();
  }
  vtkSMPTools::SetBackend("Sequential");
}

} // namespace

int main(int argc, char** argv) {
  const auto add = [](const char* name, auto run) {
    benchmark::RegisterBenchmark(name, run)
        ->UseRealTime()
        ->Unit(benchmark::kMillisecond)
        ->MinTime(0.02)
        ->Repetitions(Repetitions);
  };
  add("vtkQCriterion", [](benchmark::State& s) { ours(s, false); });
  add("vtkQCriterion, sphere masked", [](benchmark::State& s) { ours(s, true); });
  add("our kernel alone", kernelAlone);
  add("memory", memory);
  add("vtkGradientFilter, STDThread", [](benchmark::State& s) { peer(s, "STDThread"); });
  add("vtkGradientFilter, Sequential", [](benchmark::State& s) { peer(s, "Sequential"); });
  return rimflow::runSideBySide(argc, argv, "vtkQCriterion");
}
