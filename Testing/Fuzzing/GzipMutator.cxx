// For the target whose inputs are compressed: half of the changes are made to the text inside, because
// nothing that hits the compressed bytes leaves a whole stream. The other half damages the stream.
#include <algorithm>
#include <cstdint>
#include <cstring>
#include <string>
#include <zlib.h>

extern "C" std::size_t LLVMFuzzerMutate(std::uint8_t* data, std::size_t size, std::size_t most);

namespace {

constexpr int gzipFormat = 15 + 16; // the largest window, with gzip's header

// Empty when the stream is damaged.
std::string unpacked(const std::uint8_t* data, std::size_t size, std::size_t most) {
  z_stream stream = {};
  inflateInit2(&stream, gzipFormat);
  std::string text(most, '\0');
  stream.next_in = const_cast<std::uint8_t*>(data);
  stream.avail_in = unsigned(size);
  stream.next_out = reinterpret_cast<Bytef*>(text.data());
  stream.avail_out = unsigned(text.size());
  const int code = inflate(&stream, Z_FINISH);
  text.resize(code == Z_STREAM_END ? stream.total_out : 0);
  inflateEnd(&stream);
  return text;
}

std::string packed(const std::string& text) {
  z_stream stream = {};
  deflateInit2(&stream, 6, Z_DEFLATED, gzipFormat, 8, Z_DEFAULT_STRATEGY);
  std::string result(deflateBound(&stream, uLong(text.size())), '\0');
  stream.next_in = reinterpret_cast<Bytef*>(const_cast<char*>(text.data()));
  stream.avail_in = unsigned(text.size());
  stream.next_out = reinterpret_cast<Bytef*>(result.data());
  stream.avail_out = unsigned(result.size());
  deflate(&stream, Z_FINISH);
  result.resize(stream.total_out);
  deflateEnd(&stream);
  return result;
}

} // namespace

extern "C" std::size_t LLVMFuzzerCustomMutator(std::uint8_t* data, std::size_t size, std::size_t most,
                                               unsigned seed) {
  constexpr std::size_t longestText = 1 << 14;
  std::string text = seed % 2 ? unpacked(data, size, longestText) : std::string();
  if (text.empty()) return LLVMFuzzerMutate(data, size, most);
  const std::size_t was = text.size();
  text.resize(longestText);
  text.resize(LLVMFuzzerMutate(reinterpret_cast<std::uint8_t*>(text.data()), was, longestText));
  const std::string result = packed(text);
  if (result.size() > most) return LLVMFuzzerMutate(data, size, most);
  std::memcpy(data, result.data(), result.size());
  return result.size();
}
