#pragma once
#include <cstddef>
#include <string>

namespace rimflow {

/// A file under $TMPDIR (else /tmp) that nobody else sees and that vanishes with this object. Where something
/// fails, errno says why.
class TemporaryFile {
public:
  TemporaryFile();
  ~TemporaryFile();
  TemporaryFile(const TemporaryFile&) = delete;
  TemporaryFile& operator=(const TemporaryFile&) = delete;

  bool good() const { return fd >= 0; }
  int descriptor() const { return fd; }
  const std::string& folder() const { return folder_; }
  std::size_t size() const { return size_; }

  /// Appends; false when that fails (the disk is full).
  bool append(const void* from, std::size_t bytes);
  /// False when there are not so many bytes at this place.
  bool read(void* to, std::size_t bytes, std::size_t at) const;

private:
  std::string folder_;
  int fd = -1;
  std::size_t size_ = 0;
};

} // namespace rimflow
