/**
 * @class vtkOmni3DPressure
 * @brief Pressure from the material acceleration on a regular grid
 *
 * Integrates the gradient of the dynamic pressure, -rho (Du/Dt - nu lap u), over all directions in space
 * (hydrostatic pressure is not part of it). Input 0, `Input`: vtkImageData with the velocity
 * (SetInputArrayToProcess index 0, else `Velocity`, m/s) and the material acceleration (index 1, else
 * `MaterialAcceleration`, m/s2), three components each. Without velocity the fluid must be inviscid
 * (Viscosity 0). Without acceleration it is found by pseudo-tracking from the velocities of the time steps
 * before and after, which are asked of the pipeline; one of them is enough at the ends of a series. The input
 * then rests at the last time asked for, and going forward in time costs one snapshot per step. Input 1,
 * `Body` (optional): the locator's Sphere or Centre, or any vtkPolyData with `Diameter`(1) and `Centre`(3) in
 * its field data, one tuple per body. A Body whose `Status` is 2 (lost) counts as none.
 *
 * Nodes hold no fluid where `Mask` is not 0, vtkGhostType has HIDDENPOINT set, or a Body covers them. A
 * velocity or acceleration that is no finite number is refused with the count, unless its node is masked.
 * Parts of the fluid that do not hang together get a constant of their own: mean 0 over each.
 *
 * Output: the input with the float point arrays `Pressure` (Pa, active scalars), `PressureGradient` (Pa/m,
 * three components), `PressureError` (standard deviation of the pressure, Pa), all 0 at masked nodes; `Mask`
 * and vtkGhostType where nodes are masked; `MaterialAcceleration` when it comes from pseudo-tracking;
 * `Region` (0 for the largest part of the fluid, -1 for none) when there are several. Field data:
 * `Iterations`, `Residual` (of the equation, relative), `Regions`, `CurlResidual` (rms of the gradient that
 * no pressure explains over the rms of the gradient), `NodesLeftOut` (see LargestGradientError), `Density`,
 * `Viscosity`, `ElapsedTime` (s).
 *
 * Sources: OneShotPressure.h, ParallelLinePressure.h, PseudoTracking.h.
 */
#ifndef vtkOmni3DPressure_h
#define vtkOmni3DPressure_h

#include "vtkImageAlgorithm.h"
#include "vtkRIMFlowFiltersModule.h"

#include <functional>
#include <memory>

namespace rimflow {
struct PressureProblem;
struct PressureSolution;
} // namespace rimflow

class VTKRIMFLOWFILTERS_EXPORT vtkOmni3DPressure : public vtkImageAlgorithm {
public:
  static vtkOmni3DPressure* New();
  vtkTypeMacro(vtkOmni3DPressure, vtkImageAlgorithm);
  void PrintSelf(ostream& os, vtkIndent indent) override;

  enum Methods { ONE_SHOT = 0, PARALLEL_LINES = 1 };
  enum PseudoTrackingModes { AUTO = 0, NEVER = 1, ALWAYS = 2 };

  ///@{
  /// Density of the fluid, kg/m3, > 0. Default 1820. Other values are refused with an error.
  vtkSetMacro(Density, double);
  vtkGetMacro(Density, double);
  ///@}

  ///@{
  /// Kinematic viscosity, m2/s, >= 0. Default 1.1e-6.
  vtkSetClampMacro(Viscosity, double, 0, VTK_DOUBLE_MAX);
  vtkGetMacro(Viscosity, double);
  ///@}

  ///@{
  /// ONE_SHOT (default): infinitely many lines in one solve. PARALLEL_LINES: line by line, much slower.
  vtkSetClampMacro(Method, int, ONE_SHOT, PARALLEL_LINES);
  vtkGetMacro(Method, int);
  void SetMethodToOneShot() { this->SetMethod(ONE_SHOT); }
  void SetMethodToParallelLines() { this->SetMethod(PARALLEL_LINES); }
  ///@}

  ///@{
  /// One-shot: order of the integration from node to node, 4 (default) or 2. Other values are refused with an
  /// error.
  vtkSetMacro(Order, int);
  vtkGetMacro(Order, int);
  ///@}

  ///@{
  /// One-shot: weight of the nodes next to the mask, where gradients are least certain, over that of all
  /// others, > 0 to 1. Default 0.3. Other values are refused with an error.
  vtkSetMacro(WallWeight, double);
  vtkGetMacro(WallWeight, double);
  ///@}

  ///@{
  /// Parallel lines: directions, >= 12; the next larger 10 n^2 + 2 is taken. Default 642.
  vtkSetClampMacro(NumberOfDirections, int, 12, VTK_INT_MAX);
  vtkGetMacro(NumberOfDirections, int);
  ///@}

  ///@{
  /// Parallel lines: distance between the lines of one direction, m; 0 (default): the smallest grid spacing.
  vtkSetClampMacro(LineSpacing, double, 0, VTK_DOUBLE_MAX);
  vtkGetMacro(LineSpacing, double);
  ///@}

  ///@{
  /// Where the iteration stops, relative; 0 (default): 1e-6 of the right-hand side (one-shot), 1e-4 of the
  /// boundary's pressure (parallel lines).
  vtkSetClampMacro(Tolerance, double, 0, VTK_DOUBLE_MAX);
  vtkGetMacro(Tolerance, double);
  ///@}

  ///@{
  /// Iterations at most; 0 (default): 500 (one-shot) or 200 (parallel lines). A warning tells when they do
  /// not suffice.
  vtkSetClampMacro(MaximumIterations, int, 0, VTK_INT_MAX);
  vtkGetMacro(MaximumIterations, int);
  ///@}

  ///@{
  /// Nodes whose gradient is farther than this from that of the pressure, Pa/m per component, are masked and
  /// the pressure is integrated again without them (Wang, Zhang & Katz 2019 leave out regions with large
  /// errors in the same way). 0 (default): off.
  vtkSetClampMacro(LargestGradientError, double, 0, VTK_DOUBLE_MAX);
  vtkGetMacro(LargestGradientError, double);
  ///@}

  ///@{
  /// Find the acceleration by pseudo-tracking: AUTO (default), when the image has none; NEVER; or ALWAYS.
  vtkSetClampMacro(PseudoTracking, int, AUTO, ALWAYS);
  vtkGetMacro(PseudoTracking, int);
  void SetPseudoTrackingToAuto() { this->SetPseudoTracking(AUTO); }
  void SetPseudoTrackingToNever() { this->SetPseudoTracking(NEVER); }
  void SetPseudoTrackingToAlways() { this->SetPseudoTracking(ALWAYS); }
  ///@}

  ///@{
  /// Memory for the results of times visited before, MiB, >= 0: going back to one of them is then instant.
  /// What was not used for longest goes first; 0: nothing is kept. Default 256. A result is shown again only
  /// where the settings and all that the inputs hold are the same. Setting it changes no result.
  void SetCacheSize(int mebibytes);
  vtkGetMacro(CacheSize, int);
  ///@}

protected:
  vtkOmni3DPressure();
  ~vtkOmni3DPressure() override;

  int FillInputPortInformation(int port, vtkInformation* info) override;
  int RequestUpdateExtent(vtkInformation*, vtkInformationVector**, vtkInformationVector*) override;
  int RequestData(vtkInformation*, vtkInformationVector**, vtkInformationVector*) override;

  double Density = 1820;
  double Viscosity = 1.1e-6;
  int Method = ONE_SHOT;
  int Order = 4;
  double WallWeight = 0.3;
  int NumberOfDirections = 642;
  double LineSpacing = 0;
  double Tolerance = 0;
  int MaximumIterations = 0;
  double LargestGradientError = 0;
  int PseudoTracking = AUTO;
  int CacheSize = 256;

private:
  vtkOmni3DPressure(const vtkOmni3DPressure&) = delete;
  void operator=(const vtkOmni3DPressure&) = delete;

  rimflow::PressureSolution Solve(const rimflow::PressureProblem& problem,
                                  const std::function<bool(double)>& progress);

  struct Internals;
  std::unique_ptr<Internals> State;
};

#endif
