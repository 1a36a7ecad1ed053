#pragma once
#include "Progress.h"

#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <string_view>

namespace rimflow {

/// What tells whether a file is still the one that was read before.
struct FileStamp {
  std::uint64_t device = 0, inode = 0, size = 0;
  std::int64_t modified = 0; ///< nanoseconds
  bool operator==(const FileStamp& o) const {
    return device == o.device && inode == o.inode && size == o.size && modified == o.modified;
  }
  bool operator!=(const FileStamp& o) const { return !(*this == o); }
};

/// Throws std::runtime_error when the file is not there or is no ordinary file.
FileStamp stampOf(const std::string& path);

/// The first bytes of a file, unpacked if it is gzip-compressed; fewer when the file is shorter. Throws
/// std::runtime_error when the file cannot be read.
std::string headOfFile(const std::string& path, std::size_t bytes);

/// A file's text, mapped into memory: pages are read from disk when they are touched. A gzip-compressed file
/// (known by its content) is first unpacked, in pieces, into a temporary file under $TMPDIR (else /tmp) that
/// nobody else sees and that vanishes with this object.
class MappedFile {
public:
  /// Throws std::runtime_error: not there, not readable, disk full, gzip data cut or damaged. Returns null
  /// when aborted.
  static std::shared_ptr<MappedFile> open(const std::string& path, const Progress& progress = {});
  ~MappedFile();
  MappedFile(const MappedFile&) = delete;
  MappedFile& operator=(const MappedFile&) = delete;

  std::string_view text() const { return {data, size}; }
  /// The file as it was when it was opened.
  const FileStamp& stamp() const { return opened; }
  /// Bytes of temporary disk space held; 0 for a file that was not compressed.
  std::size_t temporaryBytes() const { return unpacked ? size : 0; }
  /// These bytes will be wanted soon.
  void willNeed(std::size_t begin, std::size_t end) const;
  /// These bytes are no longer wanted: gives their memory back.
  void release(std::size_t begin, std::size_t end) const;

private:
  MappedFile() = default;
  void map(const std::string& path, int fd);
  const char* data = nullptr;
  std::size_t size = 0;
  bool unpacked = false;
  FileStamp opened;
};

} // namespace rimflow
