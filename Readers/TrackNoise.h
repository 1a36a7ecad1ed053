#pragma once
#include "Progress.h"
#include "TrackDerivatives.h"

#include <limits>

namespace rimflow {

/// Standard deviations per component of the noise of a measurement. NaN: cannot be told.
struct TrackNoise {
  double position = std::numeric_limits<double>::quiet_NaN();     ///< m
  double velocity = std::numeric_limits<double>::quiet_NaN();     ///< m/s
  double acceleration = std::numeric_limits<double>::quiet_NaN(); ///< m/s2
};

/// Snapshots that measureTrackNoise looks at: those of the window nearest to the current one.
inline constexpr std::size_t noiseSnapshots = 9;

/// The noise of positions, and of velocities and accelerations where the snapshots have them, in the
/// snapshots around the current one. Two things are looked at, on 1500 tracks at most:
/// - along the track, the residual of a cubic polynomial through the snapshots. It is right for noise that is
///   white in time, and tells far too little where a tracker has smoothed its tracks;
/// - in space, what differs from a quadratic polynomial through the nearest 20 tracks, and through the
/// nearest
///   40. Noise is the same in both, the flow's third derivatives weigh more in the second: what they do is
///   extrapolated and taken off. Positions are compared as displacements over more than half of the
///   snapshots.
/// The noise counts as white when what differs from the neighbours changes as much from one snapshot to the
/// next as over two, or when a cubic polynomial leaves as much over all snapshots as over five; then the
/// first of the two rules, otherwise the second. Medians of sizes (x 1.4826) stand for standard deviations,
/// so that ghosts and regions of strong shear count little, and heavy tails of the noise too. x, y and z are
/// averaged as variances.
///
/// With 13 snapshots, white noise is told within 5 %, noise after a tracker's quadratic or cubic fit over 7
/// to 11 frames within 20 %. Where it fails:
/// - smoothing over more than about 10 frames: the positions' noise is told too low (0.8 of it at 20 frames);
/// - tracks of 5 to 15 snapshots fitted by one parabola each: velocities are told at 0.55 to 0.8 of their
///   noise, which is largest at the ends, positions at 0.6 to 1;
/// - noise that neighbours share (calibration, vibration) is no noise here;
/// - structures smaller than the distance of particles count as noise if the noise is not white. Without
///   noise, the result is what the flow leaves, at least that of the file's digits;
/// - fewer than 60 tracks: only the polynomials along the track remain, right for white noise.
/// NaN: positions without tracks of three snapshots, or an array that some snapshots do not have. Particles
/// with a value that is not finite are left out. Independent of the number of threads. Throws
/// std::invalid_argument when the window is not as TrackWindow says.
/// When progress aborts, the result does not count.
TrackNoise measureTrackNoise(const TrackWindow& window, const Progress& progress = {});

/// The same where velocity and acceleration come from estimateDerivatives with these options, which returned
/// this gain; what the snapshots have is not looked at. White noise of the positions is multiplied by the
/// gain. Other noise: the estimate's weights are applied to what differs from the neighbours.
TrackNoise measureTrackNoise(const TrackWindow& window, const TrackDerivativeOptions& derivatives,
                             const DerivativeGain& gain, const Progress& progress = {});

} // namespace rimflow
