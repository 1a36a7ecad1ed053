#pragma once
#include "Progress.h"
#include "VoidLikelihood.h"

#include <string>

namespace rimflow {

struct CaptureOptions {
  double falseAlarm = 1e-5; ///< largest probability of a find in a volume without a sphere, 0 to 1
  int candidates = 16;      ///< of the coarse scan that are looked at closely, >= 1
  int flowCandidates = 40;  ///< the same when the velocities are known: they find a sphere among many places
};

struct CaptureResult {
  bool found = false;
  Eigen::Vector3d centre = Eigen::Vector3d::Zero(); ///< good to about R/20; the likelihood refines it
  double diameter = 0;                              ///< given, or fitted where it is not known exactly, m
  double diameterSigma = 0;                         ///< of the fitted one, m
  std::size_t particlesInside = 0;                  ///< in the best ball
  double expectedInside = 0;                        ///< that it would hold without a sphere
  double logFalseAlarm = 0; ///< log of the probability of such a ball anywhere in the volume by chance,
                            ///< less the flow's evidence
  double flowEvidence = 0;  ///< log Bayes factor of a body against fluid, as it was counted; 0: not asked
  double secondLogFalseAlarm = 0; ///< the same of the best ball that does not overlap the first
  std::string reason;             ///< why nothing was found
};

/// First capture without a guess: the emptiest ball of the sphere's diameter in the whole volume.
/// 1. Every place on a grid of R/6: particles in a ball of 0.71 R (the largest that fits in the sphere from
/// the
///    nearest node) against those in the surroundings, by sums over a count grid.
/// 2. The best places that do not overlap: climb to the void, then count against the local seeding n(x).
/// 3. A find needs (independent places) x P(so few in a ball of fluid) <= falseAlarm, the log of the second
/// factor
///    divided by the seeding's dispersion, so that clustered seeding does not cry wolf; and it needs tracers
///    around it: a notch in the edge of the seeding is no sphere. The centre lies inside the seeded box;
///    outside nothing is expected, so nothing is missing.
/// 4. A find has a sphere's shape (closedLikeASphere): a depleted stripe has not.
/// 5. In thin seeding chance makes such voids. Where the void alone does not decide, and the velocities are
///    known, the flow around a place is asked as well (FlowAroundSphere.h): its log Bayes factor is taken off
///    the log false alarm, at most FlowShare of what a find needs, so that no flow makes a sphere without a
///    void.
/// The other spheres of `sphere.others` count as fluid in step 1, and no find overlaps them. Where several
/// are sought, capture the largest first and hand each find on to the next search. seeding: of the same
/// particles; changed (it excludes the ball last looked at). velocities: three per particle, m/s, or null.
CaptureResult captureSphere(const ParticleIndex& particles, SeedingDensity& seeding,
                            const VoidLikelihoodOptions& sphere, const CaptureOptions& options = {},
                            const Progress& progress = {}, const float* velocities = nullptr);

/// What the flow around a place may take off its log false alarm, where the void alone does not decide: the
/// log Bayes factor of a body against fluid (FlowAroundSphere.h), at most FlowShare of -limit. 0 where it is
/// not needed (alarm <= limit), cannot help, or there are no velocities (null). limit: log of the false alarm
/// that a find may have.
double boundedFlowEvidence(const ParticleIndex& particles, const float* velocities, const VoidEstimate& place,
                           double alarm, double limit);

/// Share of a find that the flow may contribute.
constexpr double FlowShare = 0.95;

/// Whether a void is closed as a sphere's is. Each part next to the wall is asked whether it holds as many
/// particles as the fluid or as few as the ball (log likelihood ratio of the Poisson counts, in nats):
/// - the rim of the ball (0.8 to 0.95 R) must not be fluid: then the void is smaller;
/// - the shell outside (1.05 to 1.2 R) must not be empty: then the void is larger;
/// - of two opposite caps (30 degrees, R to 1.6 R) not both may be empty: then it is a stripe. A wake is on
///   one side.
/// A part that lies outside the seeded box or in another sphere says nothing.
bool closedLikeASphere(const ParticleIndex& particles, const std::vector<Body>& others,
                       const VoidEstimate& estimate);

/// Log of the probability that chance makes a void like this somewhere among `places` independent places.
double logFalseAlarm(const VoidEstimate& estimate, double places);

/// Independent places for a ball of this radius in a volume: the balls' worth of volume times 40, for the
/// places between them; measured on volumes without a sphere (Documentation/methods-locator.md).
double independentPlaces(double volume, double radius);

/// Share of the directions around a ball in which there are tracers just outside it (0 to 1). About 0.7 for a
/// sphere whose centre lies on a face of the seeded volume, below 0.4 for a ball outside a convex volume.
double enclosure(const ParticleIndex& particles, const Eigen::Vector3d& centre, double radius);

/// Enclosure below which a void is no sphere for the capture.
constexpr double LeastEnclosure = 0.55;

} // namespace rimflow
