/**
 * @class vtkSurfaceForce
 * @brief Force of the flow on the sphere, from the pressure around it
 *
 * Pressure and friction on the surface, momentum balance over a control volume, and what the body's own
 * acceleration asks for, side by side (dynamic part: without buoyancy).
 *
 * Input 0, `Input`: vtkImageData with `Velocity` (m/s, SetInputArrayToProcess index 0),
 * `MaterialAcceleration` (m/s2, index 1), `Pressure` (Pa, index 2) and `PressureGradient` (Pa/m, index 3), as
 * vtkOmni3DPressure gives them; its `PressureError` (Pa) is used where there is one. Nodes hold no fluid
 * where `Mask` is not 0, vtkGhostType has HIDDENPOINT set, or a Body covers them. Input 1, `Body`: the
 * locator's Sphere or Centre, or any vtkPolyData with `Diameter`(1), `Centre`(3) and optionally `Velocity`,
 * `Acceleration`, `AngularVelocity`(3), `Covariance`(6: xx yy zz xy yz xz, m2), `VelocitySigma` and
 * `AccelerationSigma`(3) in its field data, one tuple per body. Without Acceleration there is no inertia
 * force.
 *
 * Output 0: the surface with the point arrays `Pressure` (Pa, active scalars), `PressureSigma` (Pa),
 * `Traction` (Pa, three components), `Normals` (into the fluid) and `Seen` (0: no measured fluid near,
 * carried over from neighbours); field data: those of the Body and the row of output 1. Output 1: vtkTable,
 * one row per body (see the column list in the user guide): `Time` (s), `SphereId`, forces of pressure
 * `Fp_x_N` .. , friction `Fv_x_N` .. , control volume `Fcv_x_N` .. , inertia `Fin_x_N` .. , `drag_N`,
 * `lift_N`, `Cd`, `Cl` (from pressure and friction), standard deviations `sigma_...`, `lift_x_N` .. ,
 * `drag_cv_N`, `sigma_drag_cv_N`, `lift_cv_N`, `sigma_lift_cv_N`, `Cd_cv`, `Cl_cv`, `torque_x_N_m` .. ,
 * `coverage`, `control_volume_radius_m`, `note`. What is not known is not a number.
 *
 * A Body that is lost (`Status` 2), or that has no fluid around it in the image, has a row that is not a
 * number, with a note, and no surface; so a series goes on.
 *
 * Sources: SurfaceForce.h.
 */
#ifndef vtkSurfaceForce_h
#define vtkSurfaceForce_h

#include "vtkPolyDataAlgorithm.h"
#include "vtkRIMFlowFiltersModule.h"

#include <memory>

class VTKRIMFLOWFILTERS_EXPORT vtkSurfaceForce : public vtkPolyDataAlgorithm {
public:
  static vtkSurfaceForce* New();
  vtkTypeMacro(vtkSurfaceForce, vtkPolyDataAlgorithm);
  void PrintSelf(ostream& os, vtkIndent indent) override;

  ///@{
  /// Density of the fluid, kg/m3, > 0. Default 1820. A warning tells when the pressure was integrated with
  /// another one.
  vtkSetMacro(Density, double);
  vtkGetMacro(Density, double);
  ///@}

  ///@{
  /// Kinematic viscosity, m2/s, >= 0. Default 1.1e-6. A warning tells when the pressure was integrated with
  /// another one.
  vtkSetClampMacro(Viscosity, double, 0, VTK_DOUBLE_MAX);
  vtkGetMacro(Viscosity, double);
  ///@}

  ///@{
  /// Density of the body, kg/m3, >= 0. Default 1190. 0: unknown, then there is no inertia force.
  vtkSetClampMacro(BodyDensity, double, 0, VTK_DOUBLE_MAX);
  vtkGetMacro(BodyDensity, double);
  ///@}

  ///@{
  /// Acceleration of gravity, m/s2. Default (0, -9.81, 0).
  vtkSetVector3Macro(Gravity, double);
  vtkGetVector3Macro(Gravity, double);
  ///@}

  ///@{
  /// Subdivisions n of the icosahedron's edges, 1 to 128: the surface has 10 n^2 + 2 points. Default 16.
  vtkSetClampMacro(SurfaceResolution, int, 1, 128);
  vtkGetMacro(SurfaceResolution, int);
  ///@}

  ///@{
  /// Outer radius of the control volume, m; 0 (default): as large as the image allows, up to two diameters.
  vtkSetClampMacro(ControlVolumeRadius, double, 0, VTK_DOUBLE_MAX);
  vtkGetMacro(ControlVolumeRadius, double);
  ///@}

  ///@{
  /// Memory for the results of times visited before, MiB, >= 0: going back to one of them is then instant.
  /// What was not used for longest goes first; 0: nothing is kept. Default 256. A result is shown again only
  /// where the settings and all that the inputs hold are the same. Setting it changes no result.
  void SetCacheSize(int mebibytes);
  vtkGetMacro(CacheSize, int);
  ///@}

protected:
  vtkSurfaceForce();
  ~vtkSurfaceForce() override;

  int FillInputPortInformation(int port, vtkInformation* info) override;
  int FillOutputPortInformation(int port, vtkInformation* info) override;
  int RequestUpdateExtent(vtkInformation*, vtkInformationVector**, vtkInformationVector*) override;
  int RequestData(vtkInformation*, vtkInformationVector**, vtkInformationVector*) override;

  double Density = 1820;
  double Viscosity = 1.1e-6;
  double BodyDensity = 1190;
  double Gravity[3] = {0, -9.81, 0};
  int SurfaceResolution = 16;
  double ControlVolumeRadius = 0;
  int CacheSize = 256;

private:
  vtkSurfaceForce(const vtkSurfaceForce&) = delete;
  void operator=(const vtkSurfaceForce&) = delete;

  void WarnOfOtherFluid(vtkDataObject* image, const char* name, double mine);

  struct Internals;
  std::unique_ptr<Internals> State;
};

#endif
