#include "TrackTexts.h"

#include "TrackFile.h"
#include "TrackTimeline.h"

#include <algorithm>
#include <stdexcept>

namespace rimflow {
namespace {

constexpr std::size_t pieceToRelease = std::size_t(32) << 20;
constexpr std::size_t mostPlainFilesOpen = 8;
constexpr std::size_t mostTemporaryBytes = std::size_t(4) << 30; // of unpacked files, when there are several

std::vector<std::string> inNaturalOrder(std::vector<std::string> files) {
  std::stable_sort(files.begin(), files.end(), naturallyBefore);
  return files;
}

} // namespace

TrackTexts::TrackTexts(std::vector<std::string> files) : paths_(inNaturalOrder(std::move(files))) {
  if (paths_.empty()) throw std::runtime_error("No file name was given. Set FileNames.");
  for (std::size_t f = 1; f < paths_.size(); ++f)
    if (paths_[f] == paths_[f - 1]) notes_.push_back(paths_[f] + ": given more than once; read once.");
  paths_.erase(std::unique(paths_.begin(), paths_.end()), paths_.end());
  stamps.resize(paths_.size());
  lines.resize(paths_.size());
}

bool TrackTexts::areStill(std::vector<std::string> files) const {
  files = inNaturalOrder(std::move(files));
  files.erase(std::unique(files.begin(), files.end()), files.end());
  if (files.empty() || files != paths_) return false;
  try {
    for (std::size_t f = 0; f < files.size(); ++f)
      if (stampOf(files[f]) != stamps[f]) return false;
  } catch (const std::exception&) {
    return false;
  }
  return true;
}

void TrackTexts::checkUnchanged(std::size_t file) const {
  if (stampOf(paths_[file]) != stamps[file])
    throw TrackIndexOutdated(paths_[file] + ": the file has changed since it was opened.");
}

std::shared_ptr<MappedFile> TrackTexts::first(std::size_t file, const Progress& progress) {
  stamps[file] = stampOf(paths_[file]);
  return mapped(file, progress);
}

std::shared_ptr<MappedFile> TrackTexts::mapped(std::size_t file, const Progress& progress) const {
  if (const auto found = open.find(file); found != open.end()) {
    lastUsed.erase(std::find(lastUsed.begin(), lastUsed.end(), file));
    lastUsed.push_back(file);
    return found->second;
  }
  auto source = MappedFile::open(paths_[file], progress);
  if (!source) return nullptr;
  if (source->stamp() != stamps[file])
    throw TrackIndexOutdated(paths_[file] + ": the file has changed since it was opened.");
  std::size_t temporary = source->temporaryBytes(), plain = source->temporaryBytes() == 0;
  for (auto f = lastUsed.rbegin(); f != lastUsed.rend(); ++f) {
    temporary += open[*f]->temporaryBytes();
    plain += open[*f]->temporaryBytes() == 0;
    if (temporary > mostTemporaryBytes || plain > mostPlainFilesOpen) open.erase(*f);
  }
  lastUsed.erase(
      std::remove_if(lastUsed.begin(), lastUsed.end(), [&](std::size_t f) { return !open.count(f); }),
      lastUsed.end());
  open[file] = source;
  lastUsed.push_back(file);
  return source;
}

std::size_t TrackTexts::lineOf(std::size_t file, std::size_t offset) const {
  const auto source = mapped(file);
  const std::string_view text = source->text();
  offset = std::min(offset, text.size());
  auto& known = lines[file];
  known.emplace(0, 1);
  const auto before = std::prev(known.upper_bound(offset));
  std::size_t p = before->first, line = before->second;
  while (p < offset) {
    const std::size_t end = std::min(offset, p + pieceToRelease);
    line +=
        std::size_t(std::count(text.begin() + std::ptrdiff_t(p), text.begin() + std::ptrdiff_t(end), '\n'));
    if (offset - before->first > pieceToRelease) source->release(p, end);
    p = end;
  }
  known.emplace(offset, line);
  return line;
}

std::string TrackTexts::at(std::size_t file, std::size_t offset) const {
  return paths_[file] + ", line " + std::to_string(lineOf(file, offset)) + ": ";
}

} // namespace rimflow
