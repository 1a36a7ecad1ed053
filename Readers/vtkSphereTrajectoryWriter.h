/**
 * @class vtkSphereTrajectoryWriter
 * @brief a sphere's trajectory as a text file for other programs
 *
 * Input: vtkPolyData with one point per time in any order, with the point arrays `Time` (s) and optionally
 * `Centre` (m; else the points' coordinates), `Status` (2: lost), `SphereId` and `Diameter` (m): the output
 * Trajectory of vtkInvisibleSphereLocator or vtkSphereTrajectoryReader, or the output of
 * vtkTrajectorySmoother. What vtkSphereTrajectoryReader reads is written: times in s, positions in mm, the
 * diameter, NaN where the sphere is lost, also at those of the pipeline's times at which the input has no
 * point. The file is whole or not there.
 */
#ifndef vtkSphereTrajectoryWriter_h
#define vtkSphereTrajectoryWriter_h

#include "vtkRIMFlowReadersModule.h"
#include "vtkWriter.h"

#include <string> // for std::string

class VTKRIMFLOWREADERS_EXPORT vtkSphereTrajectoryWriter : public vtkWriter {
public:
  static vtkSphereTrajectoryWriter* New();
  vtkTypeMacro(vtkSphereTrajectoryWriter, vtkWriter);
  void PrintSelf(ostream& os, vtkIndent indent) override;

  ///@{
  /// The file. None by default.
  void SetFileName(VTK_FILEPATH const char* name);
  VTK_FILEPATH const char* GetFileName() const { return this->FileName.c_str(); }
  ///@}

  ///@{
  /// Diameter of the sphere in m. 0 (default): from the input's array `Diameter`; it is an error when there
  /// is none.
  vtkSetClampMacro(Diameter, double, 0, VTK_DOUBLE_MAX);
  vtkGetMacro(Diameter, double);
  ///@}

  ///@{
  /// Density of the sphere over that of the fluid. 0 (default): from the input's field data `DensityRatio`;
  /// left out when there is none.
  vtkSetClampMacro(DensityRatio, double, 0, VTK_DOUBLE_MAX);
  vtkGetMacro(DensityRatio, double);
  ///@}

  ///@{
  /// Which sphere, where the input has several (`SphereId`): a file holds one. Default 0.
  vtkSetMacro(SphereId, int);
  vtkGetMacro(SphereId, int);
  ///@}

protected:
  vtkSphereTrajectoryWriter() = default;
  ~vtkSphereTrajectoryWriter() override = default;

  int FillInputPortInformation(int port, vtkInformation* info) override;
  void WriteData() override;

  std::string FileName;
  double Diameter = 0;
  double DensityRatio = 0;
  int SphereId = 0;

private:
  vtkSphereTrajectoryWriter(const vtkSphereTrajectoryWriter&) = delete;
  void operator=(const vtkSphereTrajectoryWriter&) = delete;
};

#endif
