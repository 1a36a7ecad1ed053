#pragma once
#include <cstddef>
#include <cstdint>
#include <vector>

namespace rimflow {

/// A small number for each track id, found in a few nanoseconds whatever the ids are (open addressing).
class IdTable {
public:
  static constexpr std::int32_t none = -1;

  explicit IdTable(std::size_t expected = 0) {
    std::size_t n = 16;
    while (n < 2 * expected) n *= 2;
    slots.resize(n);
  }
  std::size_t size() const { return used; }
  std::int32_t find(std::int64_t id) const { return slots[place(id)].value; }
  /// The number of this id, to be set (>= 0) by the caller when it is `none`.
  std::int32_t& operator[](std::int64_t id) {
    if (2 * used >= slots.size()) grow();
    Slot& slot = slots[place(id)];
    if (slot.value == none) {
      slot.id = id;
      ++used;
    }
    return slot.value;
  }

private:
  struct Slot {
    std::int64_t id = 0;
    std::int32_t value = none;
  };
  std::size_t place(std::int64_t id) const {
    const std::size_t mask = slots.size() - 1;
    std::uint64_t h = std::uint64_t(id) * 0x9E3779B97F4A7C15u; // Fibonacci hashing
    std::size_t p = std::size_t(h ^ (h >> 32)) & mask;
    while (slots[p].value != none && slots[p].id != id) p = (p + 1) & mask;
    return p;
  }
  void grow() {
    std::vector<Slot> old(slots.size() * 2);
    old.swap(slots);
    for (const Slot& s : old)
      if (s.value != none) slots[place(s.id)] = s;
  }

  std::vector<Slot> slots;
  std::size_t used = 0;
};

} // namespace rimflow
