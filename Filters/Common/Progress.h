#pragma once
#include <functional>

namespace rimflow {

/// Called by long-running kernels, from one thread, with the fraction done (0 to 1).
/// It returns false to abort: the kernel then stops soon and returns what its header says.
using Progress = std::function<bool(double)>;

/// Reports to an optional callback; true means go on.
inline bool goOn(const Progress& progress, double fraction) { return !progress || progress(fraction); }

} // namespace rimflow
