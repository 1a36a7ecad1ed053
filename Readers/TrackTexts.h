#pragma once
#include "MappedFile.h"
#include "Progress.h"

#include <cstddef>
#include <map>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

namespace rimflow {

/// The text files that are open together, in natural order (B2 before B10) and each once. Only some are
/// mapped at a time, so that thousands of files, or large unpacked ones, can be open.
class TrackTexts {
public:
  TrackTexts() = default;
  /// Throws std::runtime_error when there is no file name.
  explicit TrackTexts(std::vector<std::string> files);

  std::size_t size() const { return paths_.size(); }
  const std::vector<std::string>& paths() const { return paths_; }
  /// Warnings about the choice of files.
  const std::vector<std::string>& notes() const { return notes_; }

  /// Maps a file for the first time and remembers how it was. Null when aborted.
  std::shared_ptr<MappedFile> first(std::size_t file, const Progress& progress = {});
  /// Throws TrackIndexOutdated when the file is no longer as first() found it. Null when aborted.
  std::shared_ptr<MappedFile> mapped(std::size_t file, const Progress& progress = {}) const;
  /// Throws TrackIndexOutdated when the file on disk is no longer as first() found it.
  void checkUnchanged(std::size_t file) const;
  /// True when these are the files, all of them as first() found them.
  bool areStill(std::vector<std::string> files) const;

  /// The line of a byte, from 1.
  std::size_t lineOf(std::size_t file, std::size_t offset) const;
  /// "path, line 12: ", the beginning of a message.
  std::string at(std::size_t file, std::size_t offset) const;
  /// Line numbers that are known, by the byte at which the line begins.
  std::map<std::size_t, std::size_t>& knownLines(std::size_t file) const { return lines[file]; }

private:
  std::vector<std::string> paths_, notes_;
  std::vector<FileStamp> stamps;
  mutable std::map<std::size_t, std::shared_ptr<MappedFile>> open;
  mutable std::vector<std::size_t> lastUsed; ///< files in `open`, the most recent one last
  mutable std::vector<std::map<std::size_t, std::size_t>> lines;
};

} // namespace rimflow
