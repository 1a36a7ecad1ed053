# RIMFLOW_SANITIZER: everything compiled here with run-time checks; the presets `asan` and `tsan` set it.
#   address: AddressSanitizer, UndefinedBehaviorSanitizer, checked indices of the standard library
#   thread:  ThreadSanitizer; with Clang, whose OpenMP tells it about its barriers and tasks (libarcher)
set(RIMFLOW_SANITIZER "" CACHE STRING "Run-time checks: address, thread or none (empty)")
set_property(CACHE RIMFLOW_SANITIZER PROPERTY STRINGS "" address thread)
set(rimflow_test_timeout 300) # seconds, of a test of C++
set(rimflow_sanitizer_environment) # for tests whose program is not ours: pvpython, pvbatch, ParaView, Python

if(RIMFLOW_SANITIZER STREQUAL "address")
  # Left out: what AddressSanitizer sees too, once it matters, and what Eigen takes twice the time to compile with.
  set(rimflow_sanitizer_flags -fsanitize=address,undefined,float-cast-overflow -fno-sanitize=null,object-size,pointer-overflow,alignment,vptr
    -fno-sanitize-recover=all -fno-omit-frame-pointer)
  add_compile_definitions(_GLIBCXX_ASSERTIONS)
  if(RIMFLOW_BUILD_VTK)
    if(NOT CMAKE_CXX_COMPILER_ID STREQUAL GNU)
      message(FATAL_ERROR "RIMFLOW_SANITIZER=address loads GCC's run-time library into ParaView: set CMAKE_CXX_COMPILER to g++, or RIMFLOW_BUILD_VTK to OFF.")
    endif()
    # The C++ library as well: Python, a C program, brings none that the interceptors could find when they start.
    foreach(library IN ITEMS libasan.so libstdc++.so.6)
      execute_process(COMMAND "${CMAKE_CXX_COMPILER}" "-print-file-name=${library}" OUTPUT_VARIABLE file OUTPUT_STRIP_TRAILING_WHITESPACE)
      string(APPEND rimflow_preload " ${file}")
    endforeach()
    string(STRIP "${rimflow_preload}" rimflow_preload)
    set(rimflow_sanitizer_environment "LD_PRELOAD=${rimflow_preload}" "ASAN_OPTIONS=detect_leaks=0") # ParaView and Python leak
  endif()
elseif(RIMFLOW_SANITIZER STREQUAL "thread")
  set(rimflow_sanitizer_flags -fsanitize=thread -fno-omit-frame-pointer)
elseif(RIMFLOW_SANITIZER)
  message(FATAL_ERROR "RIMFLOW_SANITIZER is '${RIMFLOW_SANITIZER}'; it must be address, thread or empty.")
endif()
if(RIMFLOW_SANITIZER)
  set(rimflow_test_timeout 3000)
  message(STATUS "With run-time checks: ${rimflow_sanitizer_flags}") # CMake forgets a preset's variables when the compiler changes
endif()
add_compile_options(${rimflow_sanitizer_flags})
add_link_options(${rimflow_sanitizer_flags})
