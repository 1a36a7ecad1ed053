/**
 * @class vtkVICSharpResample
 * @brief Velocity, vorticity and material acceleration on a grid, from particle tracks
 *
 * Input 0, `Particles`: vtkPolyData, one point per particle, metres, with a velocity (SetInputArrayToProcess
 * index 0, else `Velocity`, m/s) and optionally a material acceleration (index 1, else `Acceleration`, m/s2).
 * Input 1, `Body` (optional): the locator's Sphere or Centre, or any vtkPolyData with `Diameter`(1),
 * `Centre`(3) and optionally `Velocity`, `Acceleration`, `AngularVelocity`(3) in its field data. A Body whose
 * `Status` is 2 (lost) counts as none. Output: vtkImageData with the float point arrays `Velocity` (m/s),
 * `Vorticity` (1/s) and `MaterialAcceleration` (m/s2), three components each, and `PressureOverDensity`
 * (m2/s2, mean 0). With a Body, nodes inside it carry its rigid motion, `Mask` = 1 and vtkGhostType
 * HIDDENPOINT. Field data: `Iterations`, `MisfitVelocity`, `MisfitAcceleration` (rms per datum in units of
 * the noise), `ExplainedVariance` (1 - mean square misfit of the velocities over their variance; there is a
 * warning below 0.8 where noise is not the reason), `DivergenceNorm` (rms of div u over rms of |grad u|),
 * `VelocityNoise`, `AccelerationNoise` (used), `CurvatureWeight`, `ParticlesUsed`, `Outliers` (particles left
 * out because their velocity or acceleration does not belong among their neighbours': ghost tracks),
 * `StopReason`, `ElapsedTime` (s), and `Note` where the user should know something.
 *
 * VIC# (Jeon, Mueller & Michaelis 2022) on VIC+ (Schneiders & Scarano 2016): the flow without
 * sources, and the pressure that goes with it, whose velocity and acceleration fit the tracks as closely as
 * their noise allows; see VICSharpModel.h.
 */
#ifndef vtkVICSharpResample_h
#define vtkVICSharpResample_h

#include "vtkImageAlgorithm.h"
#include "vtkRIMFlowFiltersModule.h"

#include <memory>

class vtkPolyData;

class VTKRIMFLOWFILTERS_EXPORT vtkVICSharpResample : public vtkImageAlgorithm {
public:
  static vtkVICSharpResample* New();
  vtkTypeMacro(vtkVICSharpResample, vtkImageAlgorithm);
  void PrintSelf(ostream& os, vtkIndent indent) override;

  ///@{
  /// Distance between nodes, the same along all axes, m. 0 (default): from the particle density.
  vtkSetClampMacro(Spacing, double, 0, VTK_DOUBLE_MAX);
  vtkGetMacro(Spacing, double);
  ///@}

  ///@{
  /// The box to fill, m: xmin xmax ymin ymax zmin zmax. Used when UseBounds is on; off (default): the
  /// particles' box.
  vtkSetMacro(UseBounds, bool);
  vtkGetMacro(UseBounds, bool);
  vtkBooleanMacro(UseBounds, bool);
  vtkSetVector6Macro(Bounds, double);
  vtkGetVector6Macro(Bounds, double);
  ///@}

  ///@{
  /// Kinematic viscosity, m2/s, >= 0. Default 1.1e-6.
  vtkSetClampMacro(Viscosity, double, 0, VTK_DOUBLE_MAX);
  vtkGetMacro(Viscosity, double);
  ///@}

  ///@{
  /// Standard deviation of the measured velocity (m/s) and acceleration (m/s2) per component. 0 (default):
  /// estimated; not less than what the particles say in their field data (arrays of the same names).
  vtkSetClampMacro(VelocityNoise, double, 0, VTK_DOUBLE_MAX);
  vtkGetMacro(VelocityNoise, double);
  vtkSetClampMacro(AccelerationNoise, double, 0, VTK_DOUBLE_MAX);
  vtkGetMacro(AccelerationNoise, double);
  ///@}

  ///@{
  /// Also fit the measured accelerations, where the particles have them. Default on.
  vtkSetMacro(UseAcceleration, bool);
  vtkGetMacro(UseAcceleration, bool);
  vtkBooleanMacro(UseAcceleration, bool);
  ///@}

  ///@{
  /// Iterations at most, >= 1. Default 300; as a rule the noise stops the iteration before.
  vtkSetClampMacro(MaximumIterations, int, 1, VTK_INT_MAX);
  vtkGetMacro(MaximumIterations, int);
  ///@}

  ///@{
  /// Start with the noise levels and the smoothness that the snapshot in the middle of the series was found
  /// to have. Default on. Off: every snapshot finds its own, which takes longer. Either way the result does
  /// not depend on the snapshots that were looked at before.
  vtkSetMacro(WarmStart, bool);
  vtkGetMacro(WarmStart, bool);
  vtkBooleanMacro(WarmStart, bool);
  ///@}

  ///@{
  /// Memory for the results of times visited before, MiB, >= 0: going back to one of them is then instant.
  /// What was not used for longest goes first; 0: nothing is kept. Default 256. A result is shown again only
  /// where the settings and all that the inputs hold are the same. Setting it changes no result.
  void SetCacheSize(int mebibytes);
  vtkGetMacro(CacheSize, int);
  ///@}

protected:
  vtkVICSharpResample();
  ~vtkVICSharpResample() override;

  int FillInputPortInformation(int port, vtkInformation* info) override;
  int RequestInformation(vtkInformation*, vtkInformationVector**, vtkInformationVector*) override;
  int RequestUpdateExtent(vtkInformation*, vtkInformationVector**, vtkInformationVector*) override;
  int RequestData(vtkInformation*, vtkInformationVector**, vtkInformationVector*) override;

  double Spacing = 0;
  bool UseBounds = false;
  double Bounds[6] = {0, 0, 0, 0, 0, 0};
  double Viscosity = 1.1e-6;
  double VelocityNoise = 0;
  double AccelerationNoise = 0;
  bool UseAcceleration = true;
  int MaximumIterations = 300;
  bool WarmStart = true;
  int CacheSize = 256;

private:
  vtkVICSharpResample(const vtkVICSharpResample&) = delete;
  void operator=(const vtkVICSharpResample&) = delete;

  bool LayOut(vtkInformation* particles);
  vtkPolyData* SampleOfSeries(vtkInformation* particles);

  struct Internals;
  std::unique_ptr<Internals> State;
};

#endif
