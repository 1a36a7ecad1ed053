#include "ParticleStore.h"

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <stdexcept>
#include <string>

namespace rimflow {
namespace {

// Calls f(array of one, array of the other, values per particle) for every array. Only those that the shape
// has are there.
template <class A, class B, class F>
void forEachArray(A& a, B& b, F f) {
  f(a.trackId, b.trackId, std::size_t(1));
  f(a.position, b.position, std::size_t(3));
  f(a.velocity, b.velocity, std::size_t(3));
  f(a.acceleration, b.acceleration, std::size_t(3));
  f(a.intensity, b.intensity, std::size_t(1));
  for (std::size_t c = 0; c < a.further.size(); ++c)
    f(a.further[c].values, b.further[c].values, std::size_t(1));
}

[[noreturn]] void failToStore(const TemporaryFile& file) {
  throw std::runtime_error(
      "The particles are too many for the memory and cannot be put into a temporary file in " +
      file.folder() + ": " + std::strerror(errno) +
      ". Free some space, or set TMPDIR to a folder with room.");
}

} // namespace

std::size_t ParticleStore::add(TrackSnapshot&& particles) {
  Segment s;
  s.rows = particles.size();
  if (segments.empty()) {
    shape.further.resize(particles.further.size());
    for (std::size_t c = 0; c < shape.further.size(); ++c) shape.further[c].name = particles.further[c].name;
  }
  forEachArray(particles, shape, [](const auto& from, auto& to, std::size_t) {
    if (!from.empty() && to.empty()) to.resize(1);
  });
  s.onDisk = held + particles.bytes() > memoryLimit;
  if (s.onDisk) {
    if (!file) file = std::make_shared<TemporaryFile>();
    if (!file->good()) failToStore(*file);
    s.at = file->size();
    forEachArray(particles, shape, [&](const auto& from, const auto&, std::size_t) {
      if (!file->append(from.data(), from.size() * sizeof(from[0]))) failToStore(*file);
    });
  } else {
    held += particles.bytes();
    s.particles = std::move(particles);
  }
  segments.push_back(std::move(s));
  return segments.size() - 1;
}

void ParticleStore::append(std::size_t segment, std::size_t begin, std::size_t count, bool idsOnly,
                           TrackSnapshot& to) const {
  const Segment& s = segments.at(segment);
  const auto fromDisk = [&](void* into, std::size_t bytes, std::size_t at) {
    if (!file->read(into, bytes, at))
      throw std::runtime_error("The temporary file with the particles cannot be read: " +
                               std::string(std::strerror(errno)) + ". Reload the files.");
  };
  if (idsOnly) { // they stand first
    if (shape.trackId.empty()) return;
    const std::size_t before = to.trackId.size(), width = sizeof(std::int64_t);
    to.trackId.resize(before + count);
    if (s.onDisk)
      fromDisk(to.trackId.data() + before, count * width, s.at + begin * width);
    else
      std::copy_n(s.particles.trackId.begin() + std::ptrdiff_t(begin), count,
                  to.trackId.begin() + std::ptrdiff_t(before));
    return;
  }
  if (to.further.empty())
    for (const TrackColumn& c : shape.further) to.further.push_back({c.name, {}});
  if (!s.onDisk) {
    forEachArray(s.particles, to, [&](const auto& from, auto& into, std::size_t width) {
      if (from.empty()) return;
      const auto first = from.begin() + std::ptrdiff_t(begin * width);
      into.insert(into.end(), first, first + std::ptrdiff_t(count * width));
    });
    return;
  }
  std::size_t at = s.at;
  forEachArray(shape, to, [&](const auto& there, auto& into, std::size_t width) {
    if (there.empty()) return;
    const std::size_t before = into.size(), bytes = width * sizeof(there[0]);
    into.resize(before + count * width);
    fromDisk(into.data() + before, count * bytes, at + begin * bytes);
    at += s.rows * bytes;
  });
}

} // namespace rimflow
