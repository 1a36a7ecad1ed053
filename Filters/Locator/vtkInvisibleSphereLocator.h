/**
 * @class vtkInvisibleSphereLocator
 * @brief Finds the transparent sphere among tracer particles
 *
 * Input 0, `Particles`: vtkPolyData, one point per particle, metres; its velocity (SetInputArrayToProcess
 * index 0, else `Velocity`) and the id of its track (index 1, else `TrackId`) are optional. Input 1, `Flow`
 * (optional; needed by the published cost): vtkImageData with `Velocity` (m/s) and `QCriterion` (1/s2).
 *
 * Output 0, Sphere: the surface at the found place, with point normals; the arrays of output 1 as field data,
 * so that it serves as a Body. Empty when the sphere was not found. Output 1, Centre: one point with, as
 * point and field data, what this snapshot says by itself: `Time` (s), `Centre`, `Velocity`, `Acceleration`,
 * `AngularVelocity` and of the latter three `VelocitySigma` .. (3; -1: not known), `Covariance` (6: xx yy zz
 * xy yz xz, m2), `Sigma` (3, m), `SigmaTensor` (9, m, square root of the covariance, for Tensor Glyph),
 * `Diameter` and `DiameterSigma` (m), `SphereId`, `Cost`, `GradientNorm` (1/m), `Iterations`,
 * `ParticlesInside`, `OffsetVoid`, `OffsetVelocity`, `OffsetVortex` (m; -1: not computed), `Status` (0 found,
 * 2 lost), `StatusText`. Velocity and Acceleration come from the smoothed trajectory; while only one snapshot
 * is known, the velocity comes from the particles at the wall (no slip). When lost: no point, and Time,
 * Diameter, Status and StatusText as field data. Output 2, Trajectory: a polyline over all times visited so
 * far (all times with ProcessAllTimes), smoothed; the arrays of output 1 and those of vtkTrajectorySmoother,
 * with `RawCentre` as the single-snapshot estimate. Snapshots where nothing was found have Status 1 and are
 * bridged while their predicted centre is certain to a radius (StatusText says why nothing was found; Cost,
 * GradientNorm and RawCentre are no numbers, ParticlesInside is -1); beyond that they are left out. As soon
 * as all times of the input have been visited, the trajectory is the joint estimate of all snapshots, and
 * output 0 is the sphere as that has it, with its motion, also where it is bridged: the Body for the flow;
 * Centre stays what the snapshot says by itself. Output 3, Wall: the tracers next to the wall at this time,
 * which decide where it is, with `Distance` from the wall (m), `Velocity` and `TrackId` (a sample of tracks
 * beyond the wall's immediate neighbourhood); with all that vtkTrajectorySmoother needs for the joint
 * estimate as field data.
 *
 * With several spheres (OtherDiameters) outputs 0 to 2 hold them one after the other: a surface, a point, a
 * line for each that was found. Wall is that of the first; it is empty with the published cost, whose
 * trajectory is always the smoothed path through the single snapshots.
 *
 * Every time is searched for once and kept until the particles or a property change. Times may come in any
 * order: what was found at other times only says where to look first. A time that was lost before anything
 * had been found is looked at again when it is visited again; ProcessAllTimes goes back to all of them.
 *
 * Sources: section "Sphere Detection" of Jose et al. 2025 (published cost); VoidLikelihood.h,
 * SphereCapture.h.
 */
#ifndef vtkInvisibleSphereLocator_h
#define vtkInvisibleSphereLocator_h

#include "vtkPolyDataAlgorithm.h"
#include "vtkRIMFlowFiltersModule.h"

#include <memory>
#include <string>
#include <vector>

class vtkImageData;

class VTKRIMFLOWFILTERS_EXPORT vtkInvisibleSphereLocator : public vtkPolyDataAlgorithm {
public:
  static vtkInvisibleSphereLocator* New();
  vtkTypeMacro(vtkInvisibleSphereLocator, vtkPolyDataAlgorithm);
  void PrintSelf(ostream& os, vtkIndent indent) override;

  enum Methods { VOID_LIKELIHOOD = 0, PUBLISHED_COST = 1 };

  ///@{
  /// Diameter of the sphere, m, > 0. Default 0.01111.
  vtkSetMacro(Diameter, double);
  vtkGetMacro(Diameter, double);
  ///@}

  ///@{
  /// Standard deviation of what is known of the diameters beforehand, m, >= 0. 0 (default): they are known
  /// exactly. Above 0 each snapshot fits its diameter with the centre (`Diameter`, `DiameterSigma`).
  vtkSetClampMacro(DiameterSigma, double, 0, VTK_DOUBLE_MAX);
  vtkGetMacro(DiameterSigma, double);
  ///@}

  ///@{
  /// Diameters of further spheres in the volume, m, > 0; none by default. The spheres' `SphereId` is 0 for
  /// the one of `Diameter`, then 1, 2, ... in the order in which they were added.
  void AddOtherDiameter(double diameter);
  void ClearOtherDiameters();
  int GetNumberOfOtherDiameters() const { return int(this->OtherDiameters.size()); }
  double GetOtherDiameter(int index) const { return this->OtherDiameters.at(std::size_t(index)); }
  ///@}

  ///@{
  /// How the sphere is found: VOID_LIKELIHOOD (default) or PUBLISHED_COST.
  vtkSetClampMacro(Method, int, VOID_LIKELIHOOD, PUBLISHED_COST);
  vtkGetMacro(Method, int);
  void SetMethodToVoidLikelihood() { this->SetMethod(VOID_LIKELIHOOD); }
  void SetMethodToPublishedCost() { this->SetMethod(PUBLISHED_COST); }
  ///@}

  ///@{
  /// Where to look first, m. Off by default: the whole volume is searched.
  vtkSetMacro(UseInitialGuess, bool);
  vtkGetMacro(UseInitialGuess, bool);
  vtkBooleanMacro(UseInitialGuess, bool);
  vtkSetVector3Macro(InitialGuess, double);
  vtkGetVector3Macro(InitialGuess, double);
  ///@}

  ///@{
  /// Half the side of the cube around the guess in which the centre is sought, m. 0 (default): half the
  /// diameter.
  vtkSetClampMacro(SearchRadius, double, 0, VTK_DOUBLE_MAX);
  vtkGetMacro(SearchRadius, double);
  ///@}

  ///@{
  /// Go through all times of the input in one update, so that Trajectory is whole. Default off.
  vtkSetMacro(ProcessAllTimes, bool);
  vtkGetMacro(ProcessAllTimes, bool);
  vtkBooleanMacro(ProcessAllTimes, bool);
  ///@}

  ///@{
  /// Estimate all snapshots jointly as soon as all times of the input have been visited, for the Trajectory.
  /// Off: it stays the smoothed path through the single snapshots. Default on.
  vtkSetMacro(JointTrajectory, bool);
  vtkGetMacro(JointTrajectory, bool);
  vtkBooleanMacro(JointTrajectory, bool);
  ///@}

  ///@{
  /// Void likelihood: standard deviation of a particle's position per component, m; 0 (default): from the
  /// data.
  vtkSetClampMacro(PositionNoise, double, 0, VTK_DOUBLE_MAX);
  vtkGetMacro(PositionNoise, double);
  ///@}

  ///@{
  /// Void likelihood: density of ghost particles inside the sphere over the seeding density, 0 to 1; negative
  /// (default): from the data.
  vtkSetMacro(GhostRate, double);
  vtkGetMacro(GhostRate, double);
  ///@}

  ///@{
  /// Published cost: the direction against gravity, of any length. Default (0, 0, 0): the direction of the
  /// sphere's motion, from the flow around it.
  vtkSetVector3Macro(UpDirection, double);
  vtkGetVector3Macro(UpDirection, double);
  ///@}

  ///@{
  /// Published cost: w1 and w2. Defaults 3.077 and 4.415.
  vtkSetMacro(WeightVelocity, double);
  vtkGetMacro(WeightVelocity, double);
  vtkSetMacro(WeightVortex, double);
  vtkGetMacro(WeightVortex, double);
  ///@}

  ///@{
  /// Published cost: radii of the shells over the sphere's radius. Defaults 1.1, 1.5, 2 and 2.5; 0 < b < c, e
  /// > 1.
  vtkSetMacro(ShellA, double);
  vtkGetMacro(ShellA, double);
  vtkSetMacro(ShellB, double);
  vtkGetMacro(ShellB, double);
  vtkSetMacro(ShellC, double);
  vtkGetMacro(ShellC, double);
  vtkSetMacro(ShellE, double);
  vtkGetMacro(ShellE, double);
  ///@}

  ///@{
  /// Published cost: step of the finite differences, m; 0 (default): the grid spacing.
  vtkSetClampMacro(FiniteDifferenceStep, double, 0, VTK_DOUBLE_MAX);
  vtkGetMacro(FiniteDifferenceStep, double);
  ///@}

  ///@{
  /// Published cost: epsilon; the search stops when the radius times |grad J| is below, >= 0. Default 0.001.
  vtkSetClampMacro(Tolerance, double, 0, VTK_DOUBLE_MAX);
  vtkGetMacro(Tolerance, double);
  ///@}

  ///@{
  /// Published cost: conjugate-gradient steps at most, >= 1. Default 100.
  vtkSetClampMacro(MaximumIterations, int, 1, VTK_INT_MAX);
  vtkGetMacro(MaximumIterations, int);
  ///@}

  ///@{
  /// Facets around the sphere's surface, 8 to 512. Default 64.
  vtkSetClampMacro(SphereResolution, int, 8, 512);
  vtkGetMacro(SphereResolution, int);
  ///@}

protected:
  vtkInvisibleSphereLocator();
  ~vtkInvisibleSphereLocator() override;

  int FillInputPortInformation(int port, vtkInformation* info) override;
  int RequestInformation(vtkInformation*, vtkInformationVector**, vtkInformationVector*) override;
  int RequestUpdateExtent(vtkInformation*, vtkInformationVector**, vtkInformationVector*) override;
  int RequestData(vtkInformation*, vtkInformationVector**, vtkInformationVector*) override;

  double Diameter = 0.01111;
  double DiameterSigma = 0;
  std::vector<double> OtherDiameters;
  int Method = VOID_LIKELIHOOD;
  bool UseInitialGuess = false;
  double InitialGuess[3] = {0, 0, 0};
  double SearchRadius = 0;
  bool ProcessAllTimes = false;
  bool JointTrajectory = true;
  double PositionNoise = 0;
  double GhostRate = -1;
  double UpDirection[3] = {0, 0, 0};
  double WeightVelocity = 3.077;
  double WeightVortex = 4.415;
  double ShellA = 1.1;
  double ShellB = 1.5;
  double ShellC = 2;
  double ShellE = 2.5;
  double FiniteDifferenceStep = 0;
  double Tolerance = 1e-3;
  int MaximumIterations = 100;
  int SphereResolution = 64;

public:
  struct Internals; // not for users

private:
  vtkInvisibleSphereLocator(const vtkInvisibleSphereLocator&) = delete;
  void operator=(const vtkInvisibleSphereLocator&) = delete;

  void RenewTracker();
  void LocateAt(double time, vtkPolyData* particles, vtkImageData* flow);
  bool AllTimesKnown(vtkInformation* input) const;
  std::string StepText(const std::string& step) const;
  void ShiftProgress();
  void FillOutputs(double time, bool whole, vtkInformationVector* outputs);

  std::unique_ptr<Internals> State;
};

#endif
