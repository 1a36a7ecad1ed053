# The numerics, without VTK. Each kernel stands beside the VTK class that uses it.
find_package(Eigen3 3.4 REQUIRED NO_MODULE)
find_package(OpenMP REQUIRED COMPONENTS CXX)
find_package(ZLIB REQUIRED)
find_path(FASTFLOAT_INCLUDE_DIR fast_float/fast_float.h REQUIRED) # Debian: libfast-float-dev

# What reads files that others wrote: also fuzzed, by itself (Testing/Fuzzing).
set(rimflow_parsers
  Readers/FileSnapshots.cxx
  Readers/FrameTracks.cxx
  Readers/LPTChallengeTracks.cxx
  Readers/MappedFile.cxx
  Readers/MyPTVTracks.cxx
  Readers/OpenLPTTracks.cxx
  Readers/OpenPTVTracks.cxx
  Readers/ParticleStore.cxx
  Readers/SphereTrajectoryFile.cxx
  Readers/TableHead.cxx
  Readers/TableTracks.cxx
  Readers/TecplotHeader.cxx
  Readers/TecplotTracks.cxx
  Readers/TemporaryFile.cxx
  Readers/TimeColumn.cxx
  Readers/TrackColumns.cxx
  Readers/TrackFormat.cxx
  Readers/TrackMessages.cxx
  Readers/TrackPathlines.cxx
  Readers/TrackRows.cxx
  Readers/TrackSelection.cxx
  Readers/TrackStatistics.cxx
  Readers/TrackTableLayout.cxx
  Readers/TrackTexts.cxx
  Readers/TrackTimeline.cxx
)
add_library(rimflow_kernels STATIC
  ${rimflow_parsers}
  Readers/AnalyticFlows.cxx
  Readers/SphereMotion.cxx
  Readers/TrackDerivatives.cxx
  Readers/TrackNoise.cxx
  Readers/TrackSeries.cxx
  Readers/TrackSynthesis.cxx
  Filters/Common/BoxPoisson.cxx
  Filters/Common/Interpolation.cxx
  Filters/Common/ParticleIndex.cxx
  Filters/Resampling/MedianTest.cxx
  Filters/Resampling/ResamplingGrid.cxx
  Filters/Resampling/VICSharp.cxx
  Filters/Resampling/VICSharpCalibration.cxx
  Filters/Resampling/VICSharpModel.cxx
  Filters/Resampling/VICSharpProblem.cxx
  Filters/Resampling/VoidDistance.cxx
  Filters/Locator/FlowAroundSphere.cxx
  Filters/Locator/ImportanceSampling.cxx
  Filters/Locator/PathPosterior.cxx
  Filters/Locator/PublishedCost.cxx
  Filters/Locator/SeedingDensity.cxx
  Filters/Locator/SphereCapture.cxx
  Filters/Locator/SphereGroup.cxx
  Filters/Locator/SphereTracker.cxx
  Filters/Locator/TrajectorySmoother.cxx
  Filters/Locator/VoidLikelihood.cxx
  Filters/Vortices/QCriterionKernel.cxx
  Filters/Pressure/FluidRegions.cxx
  Filters/Pressure/OneShotPressure.cxx
  Filters/Pressure/ParallelLinePressure.cxx
  Filters/Pressure/PressureGradient.cxx
  Filters/Pressure/PseudoTracking.cxx
  Filters/Pressure/PressureError.cxx
  Filters/Forces/ControlVolume.cxx
  Filters/Forces/SurfaceForce.cxx
  Filters/Forces/WallFriction.cxx
  Filters/Forces/WallPressure.cxx
)
target_include_directories(rimflow_kernels PUBLIC
  ${CMAKE_SOURCE_DIR}/Readers
  ${CMAKE_SOURCE_DIR}/Filters/Common
  ${CMAKE_SOURCE_DIR}/Filters/Resampling
  ${CMAKE_SOURCE_DIR}/Filters/Vortices
  ${CMAKE_SOURCE_DIR}/Filters/Locator
  ${CMAKE_SOURCE_DIR}/Filters/Pressure
  ${CMAKE_SOURCE_DIR}/Filters/Forces
)
target_link_libraries(rimflow_kernels PUBLIC Eigen3::Eigen OpenMP::OpenMP_CXX PRIVATE ZLIB::ZLIB)
target_include_directories(rimflow_kernels SYSTEM PRIVATE ${FASTFLOAT_INCLUDE_DIR})
# Public: Eigen's alignment follows the instruction set, so kernels and their users must agree on it.
if(RIMFLOW_NATIVE)
  target_compile_options(rimflow_kernels PUBLIC -march=native)
endif()
# -Wno-maybe-uninitialized: GCC 12 warns of its own AVX-512 intrinsics.
target_compile_options(rimflow_kernels PRIVATE -Wall -Wextra -Wno-maybe-uninitialized -fno-math-errno -fno-trapping-math)
