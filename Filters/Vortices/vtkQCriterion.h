/**
 * @class vtkQCriterion
 * @brief Q-criterion of a velocity field on a regular grid
 *
 * Q = (|Omega|^2 - |S|^2)/2 in 1/s2, with S and Omega the symmetric and antisymmetric parts of the velocity
 * gradient: positive where rotation wins over strain (section "Vortex Criterion" of Jose et al. 2025).
 *
 * Input: vtkImageData with a three-component point array, m/s: SetInputArrayToProcess index 0, else the array
 * `Velocity`, else the active vectors. Nodes whose vtkGhostType has HIDDENPOINT set, or whose `Mask` is not
 * 0, hold no fluid: they get 0, and no difference is taken across them. Output: the input with the float
 * point array `QCriterion`, and the extra arrays that are switched on.
 *
 * Central differences of the chosen order inside; second order and one-sided at the faces and at the mask.
 */
#ifndef vtkQCriterion_h
#define vtkQCriterion_h

#include "vtkImageAlgorithm.h"
#include "vtkRIMFlowFiltersModule.h"

#include <memory>

class VTKRIMFLOWFILTERS_EXPORT vtkQCriterion : public vtkImageAlgorithm {
public:
  static vtkQCriterion* New();
  vtkTypeMacro(vtkQCriterion, vtkImageAlgorithm);
  void PrintSelf(ostream& os, vtkIndent indent) override;

  ///@{
  /// Order of the central differences: 2 (default) or 4. Other values are refused with an error.
  vtkSetMacro(Order, int);
  vtkGetMacro(Order, int);
  ///@}

  ///@{
  /// Also output `Vorticity` = curl u, three components, 1/s. Default off.
  vtkSetMacro(ComputeVorticity, bool);
  vtkGetMacro(ComputeVorticity, bool);
  vtkBooleanMacro(ComputeVorticity, bool);
  ///@}

  ///@{
  /// Also output `Lambda2`, the middle eigenvalue of S^2 + Omega^2, 1/s2 (Jeong & Hussain 1995): negative in
  /// a vortex. Default off.
  vtkSetMacro(ComputeLambda2, bool);
  vtkGetMacro(ComputeLambda2, bool);
  vtkBooleanMacro(ComputeLambda2, bool);
  ///@}

  ///@{
  /// Also output `Divergence` = div u, 1/s: zero for a liquid, so it shows where the field cannot be trusted.
  /// Default off.
  vtkSetMacro(ComputeDivergence, bool);
  vtkGetMacro(ComputeDivergence, bool);
  vtkBooleanMacro(ComputeDivergence, bool);
  ///@}

  ///@{
  /// Memory for the results of times visited before, MiB, >= 0: going back to one of them is then instant.
  /// What was not used for longest goes first; 0: nothing is kept. Default 256. A result is shown again only
  /// where the settings and all that the inputs hold are the same. Setting it changes no result.
  void SetCacheSize(int mebibytes);
  vtkGetMacro(CacheSize, int);
  ///@}

protected:
  vtkQCriterion();
  ~vtkQCriterion() override;

  int RequestData(vtkInformation*, vtkInformationVector**, vtkInformationVector*) override;

  int Order = 2;
  bool ComputeVorticity = false;
  bool ComputeLambda2 = false;
  bool ComputeDivergence = false;
  int CacheSize = 256;

private:
  vtkQCriterion(const vtkQCriterion&) = delete;
  void operator=(const vtkQCriterion&) = delete;

  struct Internals;
  std::unique_ptr<Internals> State;
};

#endif
