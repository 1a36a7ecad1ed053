# The VTK modules, their Python wrapping and the ParaView plugin on top of them.
set(rimflow_vtk_components CommonCore CommonDataModel CommonExecutionModel CommonMath FiltersGeneral WrappingPythonCore)
if(RIMFLOW_BUILD_PARAVIEW)
  find_package(ParaView 5.11 REQUIRED COMPONENTS RemotingCore)
  # The same VTK that ParaView was built with, and the components that its own config leaves out.
  find_package(VTK REQUIRED COMPONENTS ${rimflow_vtk_components} FiltersSources IOXML RenderingOpenGL2 TestingRendering InteractionStyle
    PATHS "${ParaView_DIR}/vtk" NO_DEFAULT_PATH)
else()
  find_package(VTK 9.2 REQUIRED COMPONENTS ${rimflow_vtk_components} FiltersSources IOXML)
endif()
find_package(Python3 REQUIRED COMPONENTS Interpreter Development.Module)

set(rimflow_python_build_dir "lib/python${Python3_VERSION_MAJOR}.${Python3_VERSION_MINOR}/site-packages") # in the install tree too

vtk_module_find_modules(rimflow_module_files "${CMAKE_SOURCE_DIR}/Readers" "${CMAKE_SOURCE_DIR}/Filters")
vtk_module_scan(
  MODULE_FILES ${rimflow_module_files}
  REQUEST_MODULES RIMFlow::RIMFlowReaders RIMFlow::RIMFlowFilters
  PROVIDES_MODULES rimflow_modules
  WANT_BY_DEFAULT ON)
vtk_module_build(
  MODULES ${rimflow_modules}
  PACKAGE RIMFlow
  INSTALL_EXPORT RIMFlow
  INSTALL_HEADERS ON
  HEADERS_DESTINATION "${CMAKE_INSTALL_INCLUDEDIR}/rimflow"
  CMAKE_DESTINATION "${CMAKE_INSTALL_LIBDIR}/cmake/rimflow"
  LIBRARY_DESTINATION "${CMAKE_INSTALL_LIBDIR}"
  TARGETS_COMPONENT development)
# Python: `from rimflow.vtkRIMFlowFilters import vtkQCriterion`
vtk_module_wrap_python(
  MODULES ${rimflow_modules}
  TARGET RIMFlow::PythonWrapped
  PYTHON_PACKAGE rimflow
  MODULE_DESTINATION "${rimflow_python_build_dir}"
  LIBRARY_DESTINATION "${CMAKE_INSTALL_LIBDIR}" # where the installed Python modules look for the libraries
  BUILD_STATIC OFF
  INSTALL_HEADERS OFF)
add_subdirectory(Python)

if(RIMFLOW_BUILD_PARAVIEW)
  set(rimflow_plugin_dir "${CMAKE_INSTALL_LIBDIR}/rimflow/plugins")
  paraview_plugin_scan(
    PLUGIN_FILES "${CMAKE_SOURCE_DIR}/ServerManager/paraview.plugin"
    PROVIDES_PLUGINS rimflow_plugins
    ENABLE_BY_DEFAULT ON
    HIDE_PLUGINS_FROM_CACHE ON)
  # What ParaView makes help pages with; without it there are none.
  find_program(RIMFLOW_XMLPATTERNS NAMES xmlpatterns-qt5 xmlpatterns)
  find_package(Qt5 QUIET COMPONENTS Help)
  set(rimflow_without_help ON)
  if(RIMFLOW_XMLPATTERNS AND Qt5Help_FOUND)
    set(rimflow_without_help OFF)
  else()
    message(STATUS "Without help pages: they need xmlpatterns and Qt 5's Help (Debian: qttools5-dev qtxmlpatterns5-dev-tools)")
  endif()
  paraview_plugin_build(
    PLUGINS ${rimflow_plugins}
    PLUGINS_FILE_NAME rimflow.xml
    RUNTIME_DESTINATION "${CMAKE_INSTALL_BINDIR}"
    LIBRARY_DESTINATION "${CMAKE_INSTALL_LIBDIR}"
    LIBRARY_SUBDIRECTORY "rimflow/plugins"
    DISABLE_XML_DOCUMENTATION ${rimflow_without_help})
endif()

include(CMakePackageConfigHelpers)
configure_file(CMake/rimflow-config.cmake.in "${CMAKE_BINARY_DIR}/CMakeFiles/rimflow-config.cmake" @ONLY)
write_basic_package_version_file("${CMAKE_BINARY_DIR}/CMakeFiles/rimflow-config-version.cmake" COMPATIBILITY SameMinorVersion)
install(FILES "${CMAKE_BINARY_DIR}/CMakeFiles/rimflow-config.cmake" "${CMAKE_BINARY_DIR}/CMakeFiles/rimflow-config-version.cmake"
  DESTINATION "${CMAKE_INSTALL_LIBDIR}/cmake/rimflow")
