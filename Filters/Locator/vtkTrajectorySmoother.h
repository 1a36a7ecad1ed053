/**
 * @class vtkTrajectorySmoother
 * @brief Position, velocity and acceleration of a body from its single-snapshot positions
 *
 * Input: vtkPolyData with one point per snapshot, in any order, and the point arrays `Time` (s), `Centre` (3,
 * m; else the points' coordinates), `Covariance` (6: xx yy zz xy yz xz, m2), and optionally `Status` (0
 * found, anything else: not found, its numbers are not used). Output: a polyline in the order of time through
 * all points that are not lost, with the input's arrays and `Centre`, `Velocity`, `Acceleration` (3),
 * `Covariance`, `VelocityCovariance`, `AccelerationCovariance` (6), `Sigma`, `SigmaTensor` (9),
 * `VelocitySigma`, `AccelerationSigma` (3), `AngularVelocity` and `AngularVelocitySigma` (3, rad/s; velocity
 * 0 and sigma -1: not known), `Status` (0 found, 1 predicted from the neighbours, 2 lost) and `RawCentre`
 * (3), the input's Centre; all double but Status. Lost is what no find is near enough to for a prediction
 * (LargestPredictionSigma), and everything when nothing was found; the numbers of a lost point are not
 * numbers. Field data: `JerkIntensity` (m2/s5), `CorrelatedFraction`, `CorrelationTime` (s),
 * `CovarianceInflation`, `Rejected`, `AccelerationPrior` (m/s2), `PositionNoise` (m), `JointPoints`.
 *
 * Optional input 1, `Walls` (any number): the locator's output Wall of each snapshot. With them, and with the
 * point array `Diameter` (m), the snapshots are estimated jointly: one smooth path that no track may enter.
 *
 * Kalman filter and Rauch-Tung-Striebel smoother for white-noise jerk; see TrajectorySmoother.h for the
 * model, and PathPosterior.h for the joint estimate.
 */
#ifndef vtkTrajectorySmoother_h
#define vtkTrajectorySmoother_h

#include "vtkPolyDataAlgorithm.h"
#include "vtkRIMFlowFiltersModule.h"

class VTKRIMFLOWFILTERS_EXPORT vtkTrajectorySmoother : public vtkPolyDataAlgorithm {
public:
  static vtkTrajectorySmoother* New();
  vtkTypeMacro(vtkTrajectorySmoother, vtkPolyDataAlgorithm);
  void PrintSelf(ostream& os, vtkIndent indent) override;

  ///@{
  /// Spectral density of the jerk, m2/s5: how abruptly the body may change its acceleration. Negative
  /// (default): the most likely value.
  vtkSetMacro(JerkIntensity, double);
  vtkGetMacro(JerkIntensity, double);
  ///@}

  ///@{
  /// Part of the single-snapshot variance that is correlated from snapshot to snapshot, 0 to 0.95. Negative
  /// (default): the most likely value.
  vtkSetMacro(CorrelatedFraction, double);
  vtkGetMacro(CorrelatedFraction, double);
  ///@}

  ///@{
  /// Time over which that part is correlated, s. 0 (default): the most likely value.
  vtkSetMacro(CorrelationTime, double);
  vtkGetMacro(CorrelationTime, double);
  ///@}

  ///@{
  /// A snapshot without a find is predicted while its centre's standard deviation is at most this in every
  /// direction, m; beyond, it is lost. 0 (default): no limit.
  vtkSetClampMacro(LargestPredictionSigma, double, 0, VTK_DOUBLE_MAX);
  vtkGetMacro(LargestPredictionSigma, double);
  ///@}

protected:
  vtkTrajectorySmoother();
  ~vtkTrajectorySmoother() override = default;

  int FillInputPortInformation(int port, vtkInformation* info) override;
  int RequestData(vtkInformation*, vtkInformationVector**, vtkInformationVector*) override;

  double JerkIntensity = -1;
  double CorrelatedFraction = -1;
  double CorrelationTime = 0;
  double LargestPredictionSigma = 0;

private:
  vtkTrajectorySmoother(const vtkTrajectorySmoother&) = delete;
  void operator=(const vtkTrajectorySmoother&) = delete;
};

#endif
