#pragma once
#include "Progress.h"
#include "SeedingDensity.h"

namespace rimflow {

struct VoidLikelihoodOptions {
  double diameter = 0;      ///< of the sphere, m, > 0
  double diameterSigma = 0; ///< standard deviation of what is known of the diameter beforehand, m; 0: known
                            ///< exactly. Above 0 the diameter is fitted with the centre
  double positionNoise = 0; ///< standard deviation of a particle's position per component, m; 0: unknown,
                            ///< then averaged over a prior around 1/200 of the mean particle spacing
  double ghostRate = -1;    ///< density of ghost particles inside over the seeding density outside, below 1;
                            ///< negative: estimated from the particles deep inside
  double searchSide = 0;    ///< side of the cube around the guess in which to look, m; 0: the diameter
  int samples = 2048;       ///< of the posterior in the last round
  /// Other spheres in the volume, as far as they are known. They are no fluid, and the sphere sought overlaps
  /// none of them. Of spheres of different diameters, locate the larger first: its void holds a smaller one.
  std::vector<Body> others;
};

struct VoidEstimate {
  Eigen::Vector3d centre = Eigen::Vector3d::Zero();     ///< posterior mean, m
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero(); ///< posterior covariance, m2, whatever the diameter
  double diameter = 0;                                  ///< given, or its posterior mean, m
  double diameterSigma = 0;    ///< posterior standard deviation, m; 0 for a diameter known exactly
  double cost = 0;             ///< -sum of log((1 - f) + eps f) at the centre; 0 for a clean void
  double gradientNorm = 0;     ///< |grad log L| at the centre, 1/m
  int iterations = 0;          ///< Newton steps and proposal rounds
  double effectiveSamples = 0; ///< of the last round
  std::size_t particlesInside = 0;
  double expectedInside = 0; ///< particles that the ball would hold if it were fluid
  double logChance = 0;      ///< log of the probability that a ball of fluid holds so few
  double ghostRate = 0;      ///< used or estimated
  double positionNoise = 0;  ///< given, or its posterior mean, m
  Eigen::Vector3d voidMinimiser = Eigen::Vector3d::Zero(); ///< middle of the places with the fewest particles
};

/// The sphere as the void it leaves among tracers (METHODS, section 4). Tracers are a Poisson process of
/// density n(x) in the fluid and eps n(x) (ghosts) in the body, blurred by the position noise. With
///     s_i = |x_i - x| - R,   f = 1/(1 + exp(s/w)),   w = 0.627 sigma (the logistic with the noise's slope)
/// the likelihood of centre x is
///     log L(x) = sum_i log((1 - f_i) + eps f_i) + (1 - eps) integral over the ball of n
/// The integral counts where n is not uniform: at the faces of the volume, in thin seeding, in a depleted
/// wake. Steps: a scan of the search cube, Newton steps at w = R/10, then the posterior by importance
/// sampling while w falls to the noise. The centre is sought inside the seeded box only. The guess selects
/// the basin and nothing else. `seeding` is changed: on return it excludes the found ball and the others.
/// A diameter that is not known exactly is a fourth unknown with a normal prior; the integral then keeps the
/// ball from shrinking, for a larger ball explains more of the empty space.
/// When progress aborts, the estimate does not count.
VoidEstimate locateVoid(const ParticleIndex& particles, SeedingDensity& seeding, const Eigen::Vector3d& guess,
                        const VoidLikelihoodOptions& options, const Progress& progress = {});

/// The first two steps alone, for a search among many candidates: centre, particlesInside, expectedInside and
/// logChance are set.
VoidEstimate roughVoid(const ParticleIndex& particles, SeedingDensity& seeding, const Eigen::Vector3d& guess,
                       const VoidLikelihoodOptions& options);

/// Whether a ball of this radius may be centred here: it overlaps no other sphere by more than 5 % of its
/// radius (what the centres may be off).
bool clearOf(const std::vector<Body>& others, const Eigen::Vector3d& centre, double radius);

/// Log of the probability that a ball of fluid holds at most `found` particles, where `expected` is estimated
/// from the shell around it (R to 1.5 R).
double logChanceOfVoid(std::size_t found, double expected);

} // namespace rimflow
