#include "TemporaryFile.h"

#include <cerrno>
#include <cstdlib>
#include <unistd.h>

namespace rimflow {

TemporaryFile::TemporaryFile() {
  const char* given = std::getenv("TMPDIR");
  folder_ = given && *given ? given : "/tmp";
  std::string name = folder_ + "/rimflow-XXXXXX";
  fd = ::mkstemp(name.data());
  if (fd >= 0) ::unlink(name.c_str());
}

TemporaryFile::~TemporaryFile() {
  if (fd >= 0) ::close(fd);
}

bool TemporaryFile::append(const void* from, std::size_t bytes) {
  const char* p = static_cast<const char*>(from);
  while (bytes > 0) {
    const ssize_t written = ::write(fd, p, bytes);
    if (written < 0 && errno == EINTR) continue;
    if (written <= 0) return false;
    p += written;
    bytes -= std::size_t(written);
    size_ += std::size_t(written);
  }
  return true;
}

bool TemporaryFile::read(void* to, std::size_t bytes, std::size_t at) const {
  char* p = static_cast<char*>(to);
  while (bytes > 0) {
    const ssize_t got = ::pread(fd, p, bytes, off_t(at));
    if (got < 0 && errno == EINTR) continue;
    if (got <= 0) return false;
    p += got;
    at += std::size_t(got);
    bytes -= std::size_t(got);
  }
  return true;
}

} // namespace rimflow
