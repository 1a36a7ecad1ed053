#pragma once
#include <functional>

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

} // namespace rimflow
