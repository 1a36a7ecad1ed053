// The trajectory file of a sphere: read with different settings; what was read can be written and read again.
#include "FuzzFiles.h"
#include "SphereTrajectoryFile.h"

#include <cmath>
#include <omp.h>

using namespace rimflow;
using fuzz::require;
using fuzz::requireReadable;

namespace {

void requireSound(const SphereTrajectory& t) {
  require(t.time.size() == t.centre.size() && !t.time.empty(), "every row has a time and a centre");
  require(std::isfinite(t.diameter) && t.diameter > 0, "the diameter is known");
  require(std::isfinite(t.densityRatio) && t.densityRatio >= 0, "the density ratio is known, or 0");
  for (std::size_t i = 0; i < t.time.size(); ++i) {
    require(std::isfinite(t.time[i]), "times are finite");
    require(i == 0 || t.time[i] > t.time[i - 1], "times increase");
  }
}

void requireSame(const SphereTrajectory& a, const SphereTrajectory& b) {
  require(a.time == b.time, "times come back as they were");
  for (std::size_t i = 0; i < a.time.size(); ++i)
    require(a.centre[i].allFinite() ? (a.centre[i] - b.centre[i]).norm() <= 1e-9 + 1e-12 * a.centre[i].norm()
                                    : !b.centre[i].allFinite(),
            "centres come back as they were");
}

} // namespace

extern "C" int LLVMFuzzerInitialize(int*, char***) {
  omp_set_num_threads(1); // inputs are small
  return 0;
}

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static const fuzz::Files folder("trajectory");
  const std::string file = folder.write({reinterpret_cast<const char*>(data), size}).front();
  looksLikeSphereTrajectory(file);
  for (const SphereTrajectoryOptions& options :
       {SphereTrajectoryOptions(), {0.5, -3, 0.01, LengthUnit::Auto}, {1e-3, 0, 0, LengthUnit::Metre}}) {
    std::vector<std::string> warnings;
    try {
      const SphereTrajectory t = readSphereTrajectory(file, options, warnings);
      requireSound(t);
      const std::string copy = folder.place() + "/copy";
      writeSphereTrajectory(copy, t);
      requireSame(t, readSphereTrajectory(copy, {}, warnings));
    } catch (const std::exception& e) {
      requireReadable(e.what());
      require(std::string(e.what()).find(folder.place()) != std::string::npos, "errors name their file",
              e.what());
    }
    for (const std::string& w : warnings) requireReadable(w);
  }
  return 0;
}
