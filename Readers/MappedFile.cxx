#include "MappedFile.h"

#include "TemporaryFile.h"

#include <cerrno>
#include <cstring>
#include <fcntl.h>
#include <stdexcept>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>
#include <utility>
#include <vector>
#include <zlib.h>

namespace rimflow {
namespace {

class Descriptor {
public:
  explicit Descriptor(int fd) : fd(fd) {}
  Descriptor(Descriptor&& o) noexcept : fd(std::exchange(o.fd, -1)) {}
  Descriptor& operator=(Descriptor&& o) noexcept {
    std::swap(fd, o.fd);
    return *this;
  }
  ~Descriptor() {
    if (fd >= 0) ::close(fd);
  }
  int get() const { return fd; }
  int leave() { return std::exchange(fd, -1); }

private:
  int fd;
};

[[noreturn]] void fail(const std::string& path, const std::string& what) {
  throw std::runtime_error(path + ": " + what);
}

FileStamp stampOf(const std::string& path, const struct stat& s) {
  if (S_ISDIR(s.st_mode)) fail(path, "this is a folder; choose the track files inside it.");
  if (!S_ISREG(s.st_mode))
    fail(path, "this is no ordinary file (a pipe or a device); copy it to a file first.");
  return {std::uint64_t(s.st_dev), std::uint64_t(s.st_ino), std::uint64_t(s.st_size),
          std::int64_t(s.st_mtim.tv_sec) * 1000000000 + s.st_mtim.tv_nsec};
}

Descriptor openForReading(const std::string& path, FileStamp& stamp) {
  // O_NONBLOCK: opening a pipe must not wait for its writer.
  Descriptor file(::open(path.c_str(), O_RDONLY | O_NONBLOCK | O_CLOEXEC));
  if (file.get() < 0) fail(path, std::string("cannot be opened: ") + std::strerror(errno) + ".");
  struct stat s;
  if (::fstat(file.get(), &s) != 0) fail(path, std::string("cannot be read: ") + std::strerror(errno) + ".");
  stamp = stampOf(path, s);
  return file;
}

bool isGzip(int fd) {
  unsigned char magic[2];
  return ::pread(fd, magic, 2, 0) == 2 && magic[0] == 0x1f && magic[1] == 0x8b;
}

struct GzipStream {
  GzipStream(const std::string& path, Descriptor&& from) : path(path) {
    file = gzdopen(from.get(), "rb");
    if (!file) fail(path, "not enough memory to unpack it.");
    from.leave();
    gzbuffer(file, 1 << 18);
  }
  ~GzipStream() {
    if (file) gzclose_r(file);
  }
  /// 0 at the end of the data.
  std::size_t read(char* to, std::size_t bytes) {
    const int n = gzread(file, to, unsigned(bytes));
    // After a cut file zlib hands out what there is, and only tells here.
    int code = Z_OK;
    const char* message = gzerror(file, &code);
    if (n < 0 || code == Z_BUF_ERROR)
      fail(path, std::string("the gzip data are ") + (code == Z_BUF_ERROR ? "cut short" : "damaged") + " (" +
                     (message && *message ? message : "no detail") +
                     "). Copy the file again; `gzip -t` must find it whole.");
    return std::size_t(n);
  }
  double fractionRead(const FileStamp& stamp) const {
    return stamp.size ? double(gzoffset(file)) / double(stamp.size) : 1.0;
  }

private:
  std::string path;
  gzFile file = nullptr;
};

} // namespace

FileStamp stampOf(const std::string& path) {
  struct stat s;
  if (::stat(path.c_str(), &s) != 0)
    fail(path, std::string("cannot be opened: ") + std::strerror(errno) + ".");
  return stampOf(path, s);
}

std::string headOfFile(const std::string& path, std::size_t bytes) {
  FileStamp stamp;
  Descriptor file = openForReading(path, stamp);
  std::string head(bytes, '\0');
  std::size_t got = 0;
  if (isGzip(file.get())) {
    GzipStream stream(path, std::move(file));
    while (got < bytes) {
      const std::size_t n = stream.read(&head[got], bytes - got);
      if (n == 0) break;
      got += n;
    }
  } else {
    while (got < bytes) {
      const ssize_t n = ::pread(file.get(), &head[got], bytes - got, off_t(got));
      if (n < 0 && errno == EINTR) continue;
      if (n < 0) fail(path, std::string("cannot be read: ") + std::strerror(errno) + ".");
      if (n == 0) break;
      got += std::size_t(n);
    }
  }
  head.resize(got);
  return head;
}

std::shared_ptr<MappedFile> MappedFile::open(const std::string& path, const Progress& progress) {
  std::shared_ptr<MappedFile> result(new MappedFile);
  Descriptor file = openForReading(path, result->opened);
  result->size = result->opened.size;
  if (isGzip(file.get())) {
    TemporaryFile to;
    if (!to.good())
      fail(path, "cannot be unpacked: no temporary file in " + to.folder() + " (" + std::strerror(errno) +
                     "). Set TMPDIR to a folder with room, or unpack the file with gunzip.");
    GzipStream from(path, std::move(file));
    std::vector<char> piece(1 << 22);
    result->unpacked = true;
    while (const std::size_t n = from.read(piece.data(), piece.size())) {
      if (!to.append(piece.data(), n))
        fail(path, "cannot be unpacked into " + to.folder() + " after " + std::to_string(to.size() >> 20) +
                       " MiB: " + std::strerror(errno) +
                       ". Free some space, set TMPDIR to a folder with room, or unpack it with gunzip.");
      if (!goOn(progress, from.fractionRead(result->opened))) return nullptr;
    }
    result->size = to.size();
    result->map(path, to.descriptor());
    return result;
  }
  result->map(path, file.get());
  return result;
}

void MappedFile::map(const std::string& path, int fd) {
  if (size == 0) return;
  void* mapped = ::mmap(nullptr, size, PROT_READ, MAP_SHARED, fd, 0);
  if (mapped == MAP_FAILED) {
    size = 0;
    fail(path, std::string("cannot be mapped into memory: ") + std::strerror(errno) + ".");
  }
  data = static_cast<const char*>(mapped);
}

MappedFile::~MappedFile() {
  if (data) ::munmap(const_cast<char*>(data), size);
}

namespace {
// madvise wants whole pages; half pages at the ends are left alone when they are to be given back.
void advise(const char* data, std::size_t size, std::size_t begin, std::size_t end, bool outwards,
            int advice) {
  static const std::size_t page = std::size_t(::sysconf(_SC_PAGESIZE));
  if (end >= size) end = outwards ? size : (size + page - 1) / page * page;
  begin = outwards ? begin / page * page : (begin + page - 1) / page * page;
  end = outwards ? end : end / page * page;
  if (data && begin < end) ::madvise(const_cast<char*>(data) + begin, end - begin, advice);
}
} // namespace

void MappedFile::willNeed(std::size_t begin, std::size_t end) const {
  advise(data, size, begin, end, true, MADV_WILLNEED);
}

void MappedFile::release(std::size_t begin, std::size_t end) const {
  advise(data, size, begin, end, false, MADV_DONTNEED);
}

} // namespace rimflow
