#pragma once
// What the reader tests share: a folder that vanishes, small track files in every dialect, damage, and ways
// to read files and messages.
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <gtest/gtest.h>
#include <random>
#include <stdexcept>
#include <string>
#include <unistd.h>
#include <vector>
#include <zlib.h>

namespace testing_tracks {

class Folder {
public:
  Folder() {
    std::string name = (std::filesystem::temp_directory_path() / "rimflow-test-XXXXXX").string();
    if (!mkdtemp(name.data())) throw std::runtime_error("no temporary folder");
    path = name;
  }
  ~Folder() {
    std::error_code ignored;
    std::filesystem::remove_all(path, ignored);
  }
  std::string operator/(const std::string& name) const { return (path / name).string(); }
  std::string write(const std::string& name, const std::string& content) const {
    std::filesystem::remove(path / name); // ext4 waits for the disk where a file is written over
    std::ofstream(path / name, std::ios::binary) << content;
    return *this / name;
  }
  std::string writeGzip(const std::string& name, const std::string& content) const {
    gzFile f = gzopen((*this / name).c_str(), "wb1");
    gzwrite(f, content.data(), unsigned(content.size()));
    gzclose(f);
    return *this / name;
  }

private:
  std::filesystem::path path;
};

inline std::string print(const char* format, double x) {
  char text[64];
  std::snprintf(text, sizeof text, format, x);
  return text;
}

/// The value of a column for a particle, in the unit of the header: different for every column, id and
/// snapshot.
inline double value(int column, long id, int snapshot) {
  return (column % 2 ? -1 : 1) * (0.125 * column + 0.5 * double(id % 1000) + 0.03125 * snapshot);
}

struct Dialect {
  std::vector<std::string> names = {"x[mm]",     "y[mm]",     "z[mm]",     "I",       "Vx[m/s]",
                                    "Vy[m/s]",   "Vz[m/s]",   "|V|[m/s]",  "trackID", "Ax[m/s^2]",
                                    "Ay[m/s^2]", "Az[m/s^2]", "|A|[m/s^2]"};
  int idColumn = 8;
  std::string separator = " ", newline = "\n", rowBegin, rowEnd;
  std::string zoneHeader(int snapshot, long rows) const {
    return "ZONE T=\"Snapshot " + print("%04.0f", snapshot) + "\"" + newline +
           "STRANDID=1, SOLUTIONTIME=" + print("%.9f", 43.124719773 + 0.001 * snapshot) + newline +
           "I=" + std::to_string(rows) + ", J=1, K=1, ZONETYPE = Ordered" + newline + "DATAPACKING = POINT" +
           newline;
  }
  std::string variables() const {
    std::string text = "TITLE = \"B00001\"" + newline + "VARIABLES =";
    for (const std::string& n : names) text += " \"" + n + "\"";
    return text + newline;
  }
  std::string row(long id, int snapshot) const {
    std::string text = rowBegin;
    for (int c = 0; c < int(names.size()); ++c)
      text +=
          (c ? separator : "") + (c == idColumn ? std::to_string(id) : print("%.6g", value(c, id, snapshot)));
    return text + rowEnd + newline;
  }
  std::string zone(int snapshot, const std::vector<long>& ids) const {
    std::string text = zoneHeader(snapshot, long(ids.size()));
    for (long id : ids) text += row(id, snapshot);
    return text;
  }
};

using Strings = std::vector<std::string>;

inline void expectParts(const std::string& text, const Strings& parts) {
  for (const std::string& part : parts)
    EXPECT_NE(text.find(part), std::string::npos) << part << "\nis not in: " << text;
}

inline std::string joined(const Strings& texts) {
  std::string all;
  for (const std::string& t : texts) all += t + "\n";
  return all;
}

/// A text after some random changes: bytes replaced, left out or put in, pieces repeated.
inline std::string damaged(std::string text, std::mt19937& random, int changes) {
  static const std::string bytes = "0123456789.,;+-eE \t\r\n\"=()ZONEVARIABLESIJK#xyztfid\xB2\xFF[]";
  for (int change = 0; change < changes; ++change) {
    const std::size_t at = random() % text.size();
    switch (random() % 4) {
    case 0:
      text[at] = bytes[random() % bytes.size()];
      break;
    case 1:
      text.erase(at, 1 + random() % 30);
      break;
    case 2:
      text.insert(at, 1 + random() % 3, bytes[random() % bytes.size()]);
      break;
    default:
      text.insert(at, text.substr(random() % text.size(), random() % 150));
    }
    if (text.empty()) text = " ";
  }
  return text;
}

} // namespace testing_tracks
