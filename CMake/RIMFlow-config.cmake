# find_package(RIMFlow): the targets RIMFlow::RIMFlowReaders and RIMFlow::RIMFlowFilters.
# Find VTK (or ParaView, whose VTK the modules were built with) first.
if(NOT VTK_FOUND AND NOT ParaView_FOUND)
  set(RIMFlow_FOUND 0)
  set(RIMFlow_NOT_FOUND_MESSAGE "find_package(ParaView) or find_package(VTK) must come before find_package(RIMFlow).")
  return()
endif()
include("${CMAKE_CURRENT_LIST_DIR}/RIMFlow-targets.cmake")
include("${CMAKE_CURRENT_LIST_DIR}/RIMFlow-vtk-module-properties.cmake")
