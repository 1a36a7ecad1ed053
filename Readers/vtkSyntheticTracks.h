/**
 * @class vtkSyntheticTracks
 * @brief particle tracks in a flow with a known answer, as a Shake-The-Box measurement would give them
 *
 * A source for trying everything without data, and for tests with a known truth. Tracers fill the bounds
 * uniformly, outside the sphere, and are carried by an analytic flow; noise, drop-out and ghost tracks are
 * added on request. All in SI units, in the laboratory frame. The same settings give the same particles, and
 * any time can be asked for first.
 *
 * Output, as of vtkSTBTrackReader: one vertex per particle of the time step with the float point arrays
 * `Velocity` (m/s) and `Acceleration` (m/s2) and the vtkIdType array `TrackId` (a track ends where its
 * particle drops out, and goes on with a new id). Field data, where the flow has a sphere or a vortex:
 * `TrueCentre`, `TrueVelocity`, `TrueAcceleration`, `TrueAngularVelocity` (three doubles each) and
 * `TrueDiameter`. TIME_STEPS are those of the snapshots; the nearest one is output and named in
 * DATA_TIME_STEP.
 *
 * The formulas stand in AnalyticFlows.cxx, the ways of tracers and ghosts in TrackSynthesis.h.
 */
#ifndef vtkSyntheticTracks_h
#define vtkSyntheticTracks_h

#include "vtkPolyDataAlgorithm.h"
#include "vtkRIMFlowReadersModule.h"

#include <memory>

class VTKRIMFLOWREADERS_EXPORT vtkSyntheticTracks : public vtkPolyDataAlgorithm {
public:
  static vtkSyntheticTracks* New();
  vtkTypeMacro(vtkSyntheticTracks, vtkPolyDataAlgorithm);
  void PrintSelf(ostream& os, vtkIndent indent) override;

  enum FlowType { STOKES_SPHERE = 0, POTENTIAL_SPHERE = 1, HILLS_VORTEX = 2, TAYLOR_GREEN = 3, ABC = 4 };

  ///@{
  /// The flow. Default STOKES_SPHERE.
  /// STOKES_SPHERE: creeping flow around a moving sphere, which may rotate. It slips nowhere, like a real
  /// fluid; its pressure is the Stokes pressure, which leaves out inertia.
  /// POTENTIAL_SPHERE: frictionless flow around a moving sphere; velocity and pressure obey Euler's
  /// equations. HILLS_VORTEX: Hill's spherical vortex, with fluid and tracers inside; likewise. TAYLOR_GREEN,
  /// ABC: periodic vortices without a sphere that decay by friction; exact Navier-Stokes.
  vtkSetMacro(Flow, int);
  vtkGetMacro(Flow, int);
  ///@}

  ///@{
  /// Diameter of the sphere or vortex in m, >= 0; 0: none, the fluid is at rest. Default 0.01111.
  vtkSetMacro(Diameter, double);
  vtkGetMacro(Diameter, double);
  ///@}

  ///@{
  /// Where its centre is at the middle of the period, m. Default the origin.
  vtkSetVector3Macro(Centre, double);
  vtkGetVector3Macro(Centre, double);
  ///@}

  ///@{
  /// Its velocity at the middle of the period, m/s. Default (0, 0.35, 0).
  vtkSetVector3Macro(Velocity, double);
  vtkGetVector3Macro(Velocity, double);
  ///@}

  ///@{
  /// Its constant acceleration, m/s2; spheres only. Default 0.
  vtkSetVector3Macro(Acceleration, double);
  vtkGetVector3Macro(Acceleration, double);
  ///@}

  ///@{
  /// Its constant rotation rate, rad/s; STOKES_SPHERE only. Default 0.
  vtkSetVector3Macro(AngularVelocity, double);
  vtkGetVector3Macro(AngularVelocity, double);
  ///@}

  ///@{
  /// Speed of TAYLOR_GREEN and ABC at the middle of the period, m/s. Default 0.1.
  vtkSetMacro(Amplitude, double);
  vtkGetMacro(Amplitude, double);
  ///@}

  ///@{
  /// Period in space of TAYLOR_GREEN and ABC, m, > 0. Default 0.02.
  vtkSetMacro(Wavelength, double);
  vtkGetMacro(Wavelength, double);
  ///@}

  ///@{
  /// Kinematic viscosity of the fluid, m2/s, >= 0: it sets the decay of the periodic flows and the Stokes
  /// pressure. Default 1.1e-6.
  vtkSetMacro(Viscosity, double);
  vtkGetMacro(Viscosity, double);
  ///@}

  ///@{
  /// Density of the fluid, kg/m3, > 0: the true pressure is proportional to it. Default 1820.
  vtkSetMacro(FluidDensity, double);
  vtkGetMacro(FluidDensity, double);
  ///@}

  ///@{
  /// Tracers per m3 of fluid, >= 0. Default 4e8 (0.4 per mm3).
  vtkSetMacro(Density, double);
  vtkGetMacro(Density, double);
  ///@}

  ///@{
  /// The visible volume: x, y, z from and to, m. Default 40 x 60 x 25 mm around the origin.
  vtkSetVector6Macro(Bounds, double);
  vtkGetVector6Macro(Bounds, double);
  ///@}

  ///@{
  /// Number of snapshots, >= 1. Default 40.
  vtkSetMacro(NumberOfSnapshots, int);
  vtkGetMacro(NumberOfSnapshots, int);
  ///@}

  ///@{
  /// Time between snapshots, s, > 0. Default 0.001.
  vtkSetMacro(FramePeriod, double);
  vtkGetMacro(FramePeriod, double);
  ///@}

  ///@{
  /// Time of the first snapshot, s. Default 0.
  vtkSetMacro(StartTime, double);
  vtkGetMacro(StartTime, double);
  ///@}

  ///@{
  /// Standard deviation of the Gaussian noise per component: position in m, velocity in m/s, acceleration in
  /// m/s2; each >= 0. Default 0.
  vtkSetMacro(PositionNoise, double);
  vtkGetMacro(PositionNoise, double);
  vtkSetMacro(VelocityNoise, double);
  vtkGetMacro(VelocityNoise, double);
  vtkSetMacro(AccelerationNoise, double);
  vtkGetMacro(AccelerationNoise, double);
  ///@}

  ///@{
  /// Fraction of the particles that is missing from each snapshot, independently, 0 to 0.99. Default 0.
  vtkSetMacro(DropOut, double);
  vtkGetMacro(DropOut, double);
  ///@}

  ///@{
  /// Fraction of all particles that are ghosts, 0 to 0.99: tracks of 4 or 5 snapshots on straight lines
  /// anywhere, in the sphere too. Default 0.
  vtkSetMacro(GhostFraction, double);
  vtkGetMacro(GhostFraction, double);
  ///@}

  ///@{
  /// Tracks of fewer snapshots are left out, as trackers do; not more than NumberOfSnapshots is asked of a
  /// track. Default 1: all tracks.
  vtkSetMacro(MinimumTrackLength, int);
  vtkGetMacro(MinimumTrackLength, int);
  ///@}

  ///@{
  /// Fraction of the tracers that is not seen in the wake, 0 to 1: a cylinder of the sphere's diameter behind
  /// its centre. Default 0.
  vtkSetMacro(WakeDepletion, double);
  vtkGetMacro(WakeDepletion, double);
  ///@}

  ///@{
  /// Length of that cylinder in diameters, >= 0. Default 2.
  vtkSetMacro(WakeLength, double);
  vtkGetMacro(WakeLength, double);
  ///@}

  ///@{
  /// Another seed gives other tracers, noise and ghosts. Default 1.
  vtkSetMacro(Seed, int);
  vtkGetMacro(Seed, int);
  ///@}

  ///@{
  /// Also output what is behind each particle: the float arrays `TrueVelocity`, `TrueAcceleration`,
  /// `TruePressure` (Pa) of the flow at its true place, and `TrueTracerId`, the same for all tracks of one
  /// tracer, -1 for a ghost. Default off.
  vtkSetMacro(AddTruth, bool);
  vtkGetMacro(AddTruth, bool);
  vtkBooleanMacro(AddTruth, bool);
  ///@}

protected:
  vtkSyntheticTracks();
  ~vtkSyntheticTracks() override;

  int RequestInformation(vtkInformation*, vtkInformationVector**, vtkInformationVector*) override;
  int RequestData(vtkInformation*, vtkInformationVector**, vtkInformationVector*) override;

  int Flow = STOKES_SPHERE;
  double Diameter = 0.01111;
  double Centre[3] = {0, 0, 0};
  double Velocity[3] = {0, 0.35, 0};
  double Acceleration[3] = {0, 0, 0};
  double AngularVelocity[3] = {0, 0, 0};
  double Amplitude = 0.1;
  double Wavelength = 0.02;
  double Viscosity = 1.1e-6;
  double FluidDensity = 1820;
  double Density = 4e8;
  double Bounds[6] = {-0.02, 0.02, -0.03, 0.03, -0.0125, 0.0125};
  int NumberOfSnapshots = 40;
  double FramePeriod = 0.001;
  double StartTime = 0;
  double PositionNoise = 0;
  double VelocityNoise = 0;
  double AccelerationNoise = 0;
  double DropOut = 0;
  double GhostFraction = 0;
  int MinimumTrackLength = 1;
  double WakeDepletion = 0;
  double WakeLength = 2;
  int Seed = 1;
  bool AddTruth = false;

private:
  vtkSyntheticTracks(const vtkSyntheticTracks&) = delete;
  void operator=(const vtkSyntheticTracks&) = delete;

  bool Prepare();

  struct Tracks; // trajectories, kept until a setting changes
  std::unique_ptr<Tracks> Prepared;
};

#endif
