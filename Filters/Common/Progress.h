#pragma once
#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstddef>
#include <functional>
#include <omp.h>
#include <thread>

namespace rimflow {

/// Called by long-running kernels, from one thread, with the fraction done (0 to 1).
/// It returns false to abort: the kernel then stops soon and returns what its header says.
using Progress = std::function<bool(double)>;

/// Reports to an optional callback; true means go on.
inline bool goOn(const Progress& progress, double fraction) { return !progress || progress(fraction); }

/// Progress of one part of the work: its 0 to 1 are `from` to `to` of the whole, which must outlive it.
inline Progress part(const Progress& progress, double from, double to) {
  return [&progress, from, to](double fraction) { return goOn(progress, from + (to - from) * fraction); };
}

/// Remembers that it was told to stop, so that what runs deep inside may simply return.
class Watched {
public:
  explicit Watched(const Progress& progress) : progress_(progress) {}
  bool operator()(double fraction) {
    aborted_ = aborted_ || !goOn(progress_, fraction);
    return !aborted_;
  }
  bool aborted() const { return aborted_; }

private:
  const Progress& progress_;
  bool aborted_ = false;
};

/// f(piece, progress of this piece) for the pieces 0 to count - 1, in parallel. Only the first thread calls
/// `progress`: at the beginning, at the end, and also while it waits for the others; these learn from it
/// whether to stop. Pieces that are not
/// begun when it says stop are left out. False: aborted. f must not throw.
template <class F>
bool forEachPiece(std::size_t count, const Progress& progress, F&& f) {
  std::atomic<std::size_t> next{0}, done{0};
  std::atomic<bool> stopped{false};
#pragma omp parallel
  {
    const bool first = omp_get_thread_num() == 0;
    const Progress report = [&](double fraction) {
      if (first &&
          !goOn(progress, std::min(1., (double(done) + fraction) / double(std::max<std::size_t>(count, 1)))))
        stopped = true;
      return !stopped;
    };
    report(0);
    for (std::size_t piece; !stopped && (piece = next++) < count; ++done)
      if (report(0)) f(piece, report);
    while (first && !stopped && done < count) {
      std::this_thread::sleep_for(std::chrono::milliseconds(5));
      report(0);
    }
    if (!stopped) report(0);
  }
  return !stopped;
}

} // namespace rimflow
