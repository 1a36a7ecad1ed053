#pragma once
// What the fuzz targets share: files in memory for the parsers to open, and checks that end the process.
#include "TrackColumns.h"

#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <fcntl.h>
#include <filesystem>
#include <string>
#include <string_view>
#include <unistd.h>
#include <vector>

namespace fuzz {

inline void require(bool condition, const char* what, const std::string& detail = {}) {
  if (condition) return;
  std::fprintf(stderr, "NOT TRUE: %s: %s\n", what, detail.c_str());
  std::abort();
}

/// One line of valid UTF-8 that a person can read.
inline void requireReadable(const std::string& text) {
  for (const char c : text)
    require(static_cast<unsigned char>(c) >= 0x20 && c != 0x7f, "no control characters in a text", text);
  require(rimflow::toUtf8(text) == text, "texts are valid UTF-8", text);
  require(text.size() < 4096, "texts are short", text.substr(0, 400));
}

/// A folder in memory that vanishes, with the files of one input: file n is called `stem`.7+n. The temporary
/// files of the parsers go there too.
class Files {
public:
  static constexpr char between = '\x1d'; ///< ends a file and begins the next: ASCII's group separator
  static constexpr std::size_t most = 3;

  explicit Files(std::string stem) : stem(std::move(stem)) {
    const bool memory = ::access("/dev/shm", W_OK) == 0;
    folder = (memory ? "/dev/shm" : std::filesystem::temp_directory_path().string()) + "/rimflow-fuzz-XXXXXX";
    require(::mkdtemp(folder.data()) != nullptr, "a temporary folder", folder);
    ::setenv("TMPDIR", folder.c_str(), 1);
  }
  ~Files() {
    std::error_code ignored;
    std::filesystem::remove_all(folder, ignored);
  }
  Files(const Files&) = delete;
  Files& operator=(const Files&) = delete;

  /// The paths of the files that the input is.
  std::vector<std::string> write(std::string_view input) const {
    std::vector<std::string> paths;
    for (bool more = true; more;) {
      const std::size_t end = paths.size() + 1 < most ? input.find(between) : input.npos;
      more = end != input.npos;
      paths.push_back(folder + "/" + stem + "." + std::to_string(7 + paths.size()));
      writeFile(paths.back(), input.substr(0, end));
      if (more) input.remove_prefix(end + 1);
    }
    return paths;
  }
  /// What an error must begin with or contain to name its file.
  const std::string& place() const { return folder; }

private:
  static void writeFile(const std::string& path, std::string_view text) {
    const int fd = ::open(path.c_str(), O_WRONLY | O_CREAT | O_TRUNC, 0600);
    require(fd >= 0 && ::write(fd, text.data(), text.size()) == ssize_t(text.size()), "a file written", path);
    ::close(fd);
  }
  std::string stem, folder;
};

} // namespace fuzz
