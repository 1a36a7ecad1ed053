// How a filter tells ParaView what it is doing, and learns that it is to stop. Header only, internal.
#ifndef vtkFilterProgress_h
#define vtkFilterProgress_h

#include "Progress.h"
#include "vtkFilterInput.h"

#include "vtkCallbackCommand.h"
#include "vtkCommand.h"
#include "vtkNew.h"

#include <chrono>
#include <cmath>
#include <string>

namespace rimflow {

/// Progress for a kernel: its 0 to 1 are `from` to `to` of the filter's work, and `step` names it in
/// ParaView's status bar. Events come with every per cent, and every tenth of a second however slow the work
/// is, for ParaView looks at its Abort button then; not more often, for observers cost time.
inline Progress progressOf(vtkAlgorithm* filter, const std::string& step, double from = 0, double to = 1) {
  using Clock = std::chrono::steady_clock;
  return [=, shown = -1., last = Clock::time_point()](double fraction) mutable {
    const double now = from + (to - from) * fraction;
    if (std::abs(now - shown) >= 0.01 || Clock::now() - last > std::chrono::milliseconds(100)) {
      filter->SetProgressText(step.c_str());
      filter->UpdateProgress(shown = now);
      last = Clock::now();
    }
    return !aborted(filter);
  };
}

/// Updates a filter that another one runs inside; its progress is that of `progress`, which may stop it.
/// False: aborted.
inline bool updateInside(vtkAlgorithm* inner, Progress progress) {
  vtkNew<vtkCallbackCommand> report;
  report->SetClientData(&progress);
  report->SetCallback([](vtkObject* caller, unsigned long, void* outer, void*) {
    vtkAlgorithm* filter = vtkAlgorithm::SafeDownCast(caller);
    if (!goOn(*static_cast<Progress*>(outer), filter->GetProgress())) filter->SetAbortExecute(1);
  });
  const unsigned long observer = inner->AddObserver(vtkCommand::ProgressEvent, report);
  inner->Update();
  inner->RemoveObserver(observer);
  return !inner->GetAbortExecute();
}

} // namespace rimflow

#endif
