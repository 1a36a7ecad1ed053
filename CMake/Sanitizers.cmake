# RIMFLOW_SANITIZER: everything compiled here with run-time checks; the presets `asan` and `tsan` set it.
#   address: AddressSanitizer, UndefinedBehaviorSanitizer, checked indices of the standard library
#   thread:  ThreadSanitizer; with Clang, whose OpenMP tells it about its barriers and tasks (libarcher)
set(RIMFLOW_SANITIZER "" CACHE STRING "Run-time checks: address, thread or none (empty)")
set_property(CACHE RIMFLOW_SANITIZER PROPERTY STRINGS "" address thread)
set(rimflow_sanitizers_dir "${CMAKE_SOURCE_DIR}/Testing/Sanitizers")
set(rimflow_sanitizer_environment)

if(RIMFLOW_SANITIZER STREQUAL "address")
  add_compile_definitions(_GLIBCXX_ASSERTIONS)
  set(flags -fsanitize=address,undefined,float-cast-overflow -fno-sanitize-recover=all -fno-omit-frame-pointer)
elseif(RIMFLOW_SANITIZER STREQUAL "thread")
  set(flags -fsanitize=thread -fno-omit-frame-pointer)
elseif(RIMFLOW_SANITIZER)
  message(FATAL_ERROR "RIMFLOW_SANITIZER is '${RIMFLOW_SANITIZER}'; it must be address, thread or empty.")
endif()
add_compile_options(${flags})
add_link_options(${flags})
