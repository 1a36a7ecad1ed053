#pragma once
#include <cstdint>
#include <cstring>

namespace rimflow {

/// Bytes that must be readable from the start of a number given to plainDecimal or plainInteger.
constexpr int plainDecimalReach = 24;

namespace detail {

/// The decimal digits a string begins with: as digit values, one per byte, the first in the lowest byte;
/// other bytes are not meaningful. At most eight are looked at.
struct LeadingDigits {
  std::uint64_t values;
  int count;
};
inline LeadingDigits leadingDigits(const char* p) {
  std::uint64_t word;
  std::memcpy(&word, p, 8);
  const std::uint64_t values = word ^ 0x3030303030303030u;
  // The highest bit of a byte is set where it is no digit. A carry can only spoil bytes after the first of
  // those.
  const std::uint64_t other = ((values + 0x7676767676767676u) | values) & 0x8080808080808080u;
  return {values, other ? __builtin_ctzll(other) >> 3 : 8};
}

/// Eight digit values, the most significant in the lowest byte, as a number: pairs, then fours, then eight
/// (after D. Lemire, "Number parsing at a gigabyte per second", 2021).
inline std::uint64_t joinEight(std::uint64_t v) {
  v = (v * 10) + (v >> 8);
  return (((v & 0x000000FF000000FFu) * 0x000F424000000064u) +
          (((v >> 16) & 0x000000FF000000FFu) * 0x0000271000000001u)) >>
         32;
}

/// The leading `count` digits as a number.
inline std::uint64_t whole(const LeadingDigits& d) {
  return d.count == 0 ? 0 : joinEight(d.values << (8 * (8 - d.count)));
}
/// The leading `count` digits as a fraction, in units of 1e-8.
inline std::uint64_t fraction(const LeadingDigits& d) {
  return joinEight(d.count == 8 ? d.values : d.values & ((std::uint64_t(1) << (8 * d.count)) - 1));
}

} // namespace detail

/// The commonest numbers of a track table, [-]digits[.digits] with at most seven digits before the point and
/// eight after it, without a branch that depends on their lengths; correctly rounded, because the digits make
/// an integer below 2^53 that is divided by an exact power of ten. Returns where the number ends, or null
/// when it is anything else (then nothing is said about it: use a full parser). The caller looks at what
/// follows.
inline const char* plainDecimal(const char* p, double& x) {
#if __BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__
  const bool negative = *p == '-';
  p += negative;
  const detail::LeadingDigits before = detail::leadingDigits(p);
  p += before.count;
  const bool point = *p == '.';
  detail::LeadingDigits after = detail::leadingDigits(p + 1);
  after.count = point ? after.count : 0;
  p += point ? 1 + after.count : 0;
  if (before.count > 7 || before.count + after.count == 0 || (after.count == 8 && *p >= '0' && *p <= '9'))
    return nullptr;
  const double magnitude =
      double(std::int64_t(detail::whole(before) * 100000000u + detail::fraction(after))) / 1e8;
  x = negative ? -magnitude : magnitude;
  return p;
#else
  (void)p, (void)x;
  return nullptr;
#endif
}

/// The same for whole numbers of at most seven digits.
inline const char* plainInteger(const char* p, std::int64_t& n) {
#if __BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__
  const detail::LeadingDigits d = detail::leadingDigits(p);
  if (d.count == 0 || d.count > 7) return nullptr;
  n = std::int64_t(detail::whole(d));
  return p + d.count;
#else
  (void)p, (void)n;
  return nullptr;
#endif
}

} // namespace rimflow
