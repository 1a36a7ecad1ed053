#pragma once
#include "Progress.h"

#include <cstddef>
#include <vector>

namespace rimflow {

struct MedianTestOptions {
  int neighbours = 14;    ///< that each particle is compared with, 8..32
  double threshold = 2.5; ///< larger normalised residuals are outliers, > 0
};

struct MedianTestResult {
  std::vector<unsigned char> outlier; ///< one per particle: 1 by its velocity, 2 by its acceleration, 3 both
  std::size_t count = 0;              ///< of outliers
  double velocityNoise = 0, accelerationNoise = 0; ///< of the quieter parts, per component: m/s, m/s2
};

/// Particles whose velocity or acceleration does not belong among their neighbours': the universal median
/// test (Westerweel & Scarano 2005; Duncan et al. 2010 for scattered data), with a robust local linear fit in
/// place of the median, so that a gradient is no outlier. With v_i the value of a particle, f the fit to its
/// nearest neighbours j alone, h their leverages and h_i the variance of f(x_i) in units of the neighbours':
///     t_j = |v_j - f(x_j)|/sqrt(1 - h_j),   s_i = median of t_j,   g_i = median of |f(x_j) - f(x_i)|
///     an outlier:  |v_i - f(x_i)|/sqrt(1 + h_i) > max(threshold (s_i + e), 2 g_i)
/// f minimises Geman-McClure's function of t_j/s_i; e, the noise, is the lower quartile of all s_i; g_i
/// spares thin layers, which bend more than their neighbours show. Particles next to an outlier are looked at
/// again without it, and so are the outliers. Values that are not finite are neither tested nor used. The
/// result does not depend on the number of threads. positions, velocities, accelerations: three per particle,
/// SI; accelerations may be null. When progress aborts, nothing is tested to the end.
MedianTestResult medianTest(const float* positions, const float* velocities, const float* accelerations,
                            std::size_t count, const MedianTestOptions& options = {},
                            const Progress& progress = {});

} // namespace rimflow
