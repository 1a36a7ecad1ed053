/**
 * @class vtkSphereTrajectoryReader
 * @brief a sphere's trajectory from a file, as a Body for the filters
 *
 * Reads the text files with `VARIABLES = "Time" "x" "y" "z"` and `DIAMETER=11.11[mm]` in which trajectories
 * of spheres are exchanged (SphereTrajectoryFile.h, Documentation/file-formats.md), plain or gzip-compressed.
 *
 * Output 0, Sphere: the surface at the time asked for, with point normals; the arrays of output 1 as field
 * data, so that it serves as a Body. Output 1, Centre: one point with, as point and field data, `Time` (s),
 * `Centre` (m), `Velocity` (m/s), `Acceleration` (m/s2) (3 each), `Covariance` (6: xx yy zz xy yz xz, m2),
 * `Sigma` (3, m), `SigmaTensor` (9, m), `VelocitySigma`, `AccelerationSigma` (3), `Diameter` (m), `Status` (0
 * found, 1 predicted, 2 lost) and `StatusText`. What too few rows tell is left out. When lost: no point, and
 * Time, Diameter, Status and StatusText as field data. Output 2, Trajectory: polylines through all rows
 * that are not lost, broken where the sphere is lost in between, with the same arrays; what is not known
 * there is no number. All have the field data `DensityRatio` (solid over fluid) when the file has it.
 *
 * At a time between two rows the centre is interpolated; velocity and acceleration, which the file does not
 * have, come from local polynomials through the rows (SphereMotion.h). So do the standard deviations, from
 * how the rows scatter around them: too small for a path that was smoothed before, and left out when the rows
 * scatter by less than a millionth of the diameter.
 *
 * On an error the outputs are empty and the message says file, line, what was found, what was expected and
 * what to do. A warning is given once for each file.
 */
#ifndef vtkSphereTrajectoryReader_h
#define vtkSphereTrajectoryReader_h

#include "vtkPolyDataAlgorithm.h"
#include "vtkRIMFlowReadersModule.h"

#include <memory> // for std::unique_ptr
#include <string> // for std::string

class VTKRIMFLOWREADERS_EXPORT vtkSphereTrajectoryReader : public vtkPolyDataAlgorithm {
public:
  static vtkSphereTrajectoryReader* New();
  vtkTypeMacro(vtkSphereTrajectoryReader, vtkPolyDataAlgorithm);
  void PrintSelf(ostream& os, vtkIndent indent) override;

  ///@{
  /// The file. None by default.
  void SetFileName(VTK_FILEPATH const char* name);
  VTK_FILEPATH const char* GetFileName() const { return this->FileName.c_str(); }
  ///@}

  /// 1 when the content is a sphere's trajectory, else 0. The name does not matter.
  static int CanReadFile(VTK_FILEPATH const char* name);

  ///@{
  /// Diameter of the sphere in m, in place of the file's. 0 (default): the file's own; without one there it
  /// is an error. Range 0 and more.
  vtkSetClampMacro(Diameter, double, 0, VTK_DOUBLE_MAX);
  vtkGetMacro(Diameter, double);
  ///@}

  ///@{
  /// Time between two frames in s. 0 (default): a time column without a unit is in s. Above 0: such a column
  /// counts frames. A column of frames (`Frame`, `Time[frame]`) needs it; without it 1 s is taken, with a
  /// warning. A unit of time in the file decides in any case. Range 0 and more.
  vtkSetClampMacro(FramePeriod, double, 0, VTK_DOUBLE_MAX);
  vtkGetMacro(FramePeriod, double);
  ///@}

  ///@{
  /// Added to all times, s, to make them those of the tracks. Default 0.
  vtkSetMacro(TimeShift, double);
  vtkGetMacro(TimeShift, double);
  ///@}

  enum LengthUnits { AUTO = 0, METRE = 1, MILLIMETRE = 2, CENTIMETRE = 3, MICROMETRE = 4 };
  ///@{
  /// Unit of the positions. AUTO (default): the file's own, mm where it has none. DIAMETER has its own unit.
  vtkSetClampMacro(LengthUnit, int, AUTO, MICROMETRE);
  vtkGetMacro(LengthUnit, int);
  ///@}

  ///@{
  /// Order of the local polynomial that gives velocity and acceleration. Default 3, range 2 to 5.
  vtkSetClampMacro(PolynomialOrder, int, 2, 5);
  vtkGetMacro(PolynomialOrder, int);
  ///@}

  ///@{
  /// Rows that the polynomial spans, more than its order: more for a noisy path, fewer for a quick manoeuvre.
  /// A loss of up to about so many rows is bridged. Default 15, range 3 to 999.
  vtkSetClampMacro(PolynomialWindow, int, 3, 999);
  vtkGetMacro(PolynomialWindow, int);
  ///@}

  ///@{
  /// Facets around the sphere's surface, 8 to 512. Default 64.
  vtkSetClampMacro(SphereResolution, int, 8, 512);
  vtkGetMacro(SphereResolution, int);
  ///@}

protected:
  vtkSphereTrajectoryReader();
  ~vtkSphereTrajectoryReader() override;

  int RequestInformation(vtkInformation*, vtkInformationVector**, vtkInformationVector*) override;
  int RequestData(vtkInformation*, vtkInformationVector**, vtkInformationVector*) override;

  std::string FileName;
  double Diameter = 0;
  double FramePeriod = 0;
  double TimeShift = 0;
  int LengthUnit = AUTO;
  int PolynomialOrder = 3;
  int PolynomialWindow = 15;
  int SphereResolution = 64;

private:
  vtkSphereTrajectoryReader(const vtkSphereTrajectoryReader&) = delete;
  void operator=(const vtkSphereTrajectoryReader&) = delete;

  struct Opened;
  std::unique_ptr<Opened> Open;
};

#endif
