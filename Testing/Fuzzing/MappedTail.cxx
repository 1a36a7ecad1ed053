// Parsers see files mapped into memory, in whole pages: what lies between the end of a file and the end of
// its last page can be read without a trap. This poisons it. Linked with --wrap=mmap and --wrap=munmap.
#include <cstddef>
#include <sanitizer/asan_interface.h>
#include <sys/mman.h>
#include <unistd.h>

namespace {
std::size_t wholePages(std::size_t bytes) {
  static const std::size_t page = std::size_t(::sysconf(_SC_PAGESIZE));
  return (bytes + page - 1) / page * page;
}
} // namespace

extern "C" void* __real_mmap(void* address, std::size_t bytes, int protection, int flags, int file,
                             off_t offset);
extern "C" int __real_munmap(void* address, std::size_t bytes);

extern "C" void* __wrap_mmap(void* address, std::size_t bytes, int protection, int flags, int file,
                             off_t offset) {
  void* mapped = __real_mmap(address, bytes, protection, flags, file, offset);
  if (mapped != MAP_FAILED && file >= 0 && protection == PROT_READ)
    __asan_poison_memory_region(static_cast<char*>(mapped) + bytes, wholePages(bytes) - bytes);
  return mapped;
}

extern "C" int __wrap_munmap(void* address, std::size_t bytes) {
  __asan_unpoison_memory_region(address, wholePages(bytes));
  return __real_munmap(address, bytes);
}
