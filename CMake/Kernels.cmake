# The numerics, without VTK. Each kernel stands beside the VTK class that uses it.
find_package(Eigen3 3.4 REQUIRED NO_MODULE)
find_package(OpenMP REQUIRED COMPONENTS CXX)

add_library(rimflow_kernels STATIC
  Filters/Common/BoxPoisson.cxx
  Filters/Common/Interpolation.cxx
  Filters/Resampling/VICSharpModel.cxx
  Filters/Vortices/QCriterionKernel.cxx
)
target_include_directories(rimflow_kernels PUBLIC
  ${CMAKE_SOURCE_DIR}/Readers
  ${CMAKE_SOURCE_DIR}/Filters/Common
  ${CMAKE_SOURCE_DIR}/Filters/Resampling
  ${CMAKE_SOURCE_DIR}/Filters/Vortices
  ${CMAKE_SOURCE_DIR}/Filters/Locator
)
target_link_libraries(rimflow_kernels PUBLIC Eigen3::Eigen OpenMP::OpenMP_CXX)
# Public: Eigen's alignment follows the instruction set, so kernels and their users must agree on it.
if(RIMFLOW_NATIVE)
  target_compile_options(rimflow_kernels PUBLIC -march=native)
endif()
target_compile_options(rimflow_kernels PRIVATE -Wall -Wextra -fno-math-errno -fno-trapping-math)
