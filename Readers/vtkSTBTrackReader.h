/**
 * @class vtkSTBTrackReader
 * @brief particle tracks from Shake-The-Box and other tracking programs
 *
 * Reads DaVis' Tecplot ASCII export, OpenLPT, MyPTV, OpenPTV, LPT challenge files and tables with a header,
 * plain or gzip-compressed, all of it recognised by the content. Tecplot files are indexed once; then only
 * the snapshots that are asked for are read. Formats with their rows in the order of tracks are read once and
 * kept in binary, in memory or in a temporary file. So a file may be far larger than the memory. Columns are
 * found by their names; units become SI. Which dialects, and what happens with damaged files: TrackFormat.h
 * and Documentation/file-formats.md.
 *
 * Output: vtkPolyData at the snapshot nearest to the time asked for, points in m (float).
 *  - Particles: one vertex per particle. Point arrays `Velocity` (m/s), `Acceleration` (m/s2), `TrackId`
 *    (vtkIdType), `Intensity`, as far as the file has them or they can be estimated, and all further columns
 * under their own names.
 *  - Pathlines: one polyline per track over the last TrailLength snapshots up to that time, broken where the
 *    track is absent; ended tracks stay until the window has passed them. A piece of one point is a vertex.
 *    The same point arrays, `Time` (s) at each point, and `TrackId` for each cell as well.
 *
 * Field data: `SnapshotIndex` (vtkIdType: place in the series sorted by time, from 0), `FileUnits` (three
 * strings: those of position, velocity and acceleration in the file; empty where there is none), and the
 * measured noise, standard deviations per component: `PositionNoise` (m), `VelocityNoise` (m/s) and
 * `AccelerationNoise` (m/s2), as far as it can be told (TrackNoise.h).
 *
 * On an error the output is empty and the message says file, line, what was found, what was expected and what
 * to do. A warning is given once for each set of files.
 */
#ifndef vtkSTBTrackReader_h
#define vtkSTBTrackReader_h

#include "vtkPolyDataAlgorithm.h"
#include "vtkRIMFlowReadersModule.h"

#include <memory> // for std::unique_ptr
#include <string> // for std::string
#include <vector> // for std::vector

class VTKRIMFLOWREADERS_EXPORT vtkSTBTrackReader : public vtkPolyDataAlgorithm {
public:
  static vtkSTBTrackReader* New();
  vtkTypeMacro(vtkSTBTrackReader, vtkPolyDataAlgorithm);
  void PrintSelf(ostream& os, vtkIndent indent) override;

  ///@{
  /// The files, in any order: snapshots are sorted by their times. SetFileName is for a single file.
  void AddFileName(VTK_FILEPATH const char* name);
  void RemoveAllFileNames();
  void SetFileName(VTK_FILEPATH const char* name);
  int GetNumberOfFileNames() const;
  /// Null when there is no such file name.
  VTK_FILEPATH const char* GetFileName(int index) const;
  ///@}

  /// 1 when the content is a track table that this class reads (or a DaVis .set folder's file, for which it
  /// says how to export), else 0. The name does not matter.
  static int CanReadFile(VTK_FILEPATH const char* name);

  enum LengthUnits { AUTO = 0, METRE = 1, MILLIMETRE = 2, CENTIMETRE = 3, MICROMETRE = 4 };
  ///@{
  /// Unit of the positions. AUTO (default): the file's own, mm where it has none. Velocities and
  /// accelerations always have the file's own (m/s and m/s2 where it has none), unless they are lengths per
  /// frame.
  vtkSetClampMacro(LengthUnit, int, AUTO, MICROMETRE);
  vtkGetMacro(LengthUnit, int);
  ///@}

  ///@{
  /// Time between two frames in s, used where the file gives no time: then the time is the frame number (in
  /// Tecplot files the number in the zone's title, else in the file's name, else the place in the series)
  /// times this. 0 (default): not known; 1 s is taken, with a warning. Velocities per frame (MyPTV) need it:
  /// without it such a file is an error. Range 0 and more.
  vtkSetClampMacro(FramePeriod, double, 0, VTK_DOUBLE_MAX);
  vtkGetMacro(FramePeriod, double);
  ///@}

  ///@{
  /// Added to all times, s. Default 0.
  vtkSetMacro(TimeShift, double);
  vtkGetMacro(TimeShift, double);
  ///@}

  ///@{
  /// Let the first snapshot be at time 0 (plus TimeShift); a file's times may come from an absolute clock.
  /// Default off.
  vtkSetMacro(ShiftTimeToZero, bool);
  vtkGetMacro(ShiftTimeToZero, bool);
  vtkBooleanMacro(ShiftTimeToZero, bool);
  ///@}

  enum OutputModes { PARTICLES = 0, PATHLINES = 1 };
  ///@{
  /// PARTICLES (default) or PATHLINES.
  vtkSetClampMacro(OutputMode, int, PARTICLES, PATHLINES);
  vtkGetMacro(OutputMode, int);
  ///@}

  ///@{
  /// Pathlines: over how many snapshots they reach back, the current one included; 0: over the whole series
  /// (or the time range) at any time. Default 10, 0 and more. All snapshots are gone through, but only the
  /// lines are held in memory: choose tracks with Stride or MinimumTrackLength where they are too many.
  vtkSetClampMacro(TrailLength, int, 0, VTK_INT_MAX);
  vtkGetMacro(TrailLength, int);
  ///@}

  ///@{
  /// Only tracks that appear in at least so many snapshots of the whole series. Default 1: all. A larger
  /// value makes the reader go through all files once. Range 1 to 65535.
  vtkSetClampMacro(MinimumTrackLength, int, 1, 65535);
  vtkGetMacro(MinimumTrackLength, int);
  ///@}

  ///@{
  /// Only tracks whose id is in this range, both ends included; a negative end is open. Default -1, -1: all.
  vtkSetVector2Macro(TrackIdRange, vtkIdType);
  vtkGetVector2Macro(TrackIdRange, vtkIdType);
  ///@}

  ///@{
  /// Only the tracks whose id is a multiple of this: every n-th of ids that are numbered through, and a track
  /// stays or goes as a whole. Particles without a track are counted off in the file's order. Default 1: all.
  vtkSetClampMacro(Stride, int, 1, VTK_INT_MAX);
  vtkGetMacro(Stride, int);
  ///@}

  ///@{
  /// Only snapshots with times from TimeRange[0] to TimeRange[1] (s, both included); the others are not among
  /// the time steps. It is an error if there are none. Default off.
  vtkSetMacro(UseTimeRange, bool);
  vtkGetMacro(UseTimeRange, bool);
  vtkBooleanMacro(UseTimeRange, bool);
  vtkSetVector2Macro(TimeRange, double);
  vtkGetVector2Macro(TimeRange, double);
  ///@}

  ///@{
  /// Adds point arrays about each particle's track: `TrackLength` (number of snapshots in which it is),
  /// `TrackStart` and `TrackEnd` (s, of the first and last of them) and `TrackAge` (s since the start).
  /// Particles without a track have length 1 and NaN. All files are gone through once. Default off.
  vtkSetMacro(TrackStatistics, bool);
  vtkGetMacro(TrackStatistics, bool);
  vtkBooleanMacro(TrackStatistics, bool);
  ///@}

  enum VelocityEstimates { MISSING = 0, ALWAYS = 1, NEVER = 2 };
  ///@{
  /// Where velocities and accelerations come from. MISSING (default): from the file, and what it lacks from
  /// the positions (accelerations: from the velocities, if there are some) along each track, by a local
  /// polynomial in time (TrackDerivatives.h). ALWAYS: all from the positions. NEVER: only from the file.
  vtkSetClampMacro(EstimateVelocities, int, MISSING, NEVER);
  vtkGetMacro(EstimateVelocities, int);
  ///@}

  ///@{
  /// Order of that polynomial, and to how many points of a track it is fitted: more points mean less noise
  /// and less resolution in time. Defaults 2 and 9; the order is 2 to 5, the window odd and larger.
  vtkSetClampMacro(PolynomialOrder, int, 2, 5);
  vtkGetMacro(PolynomialOrder, int);
  vtkSetClampMacro(PolynomialWindow, int, 3, 31);
  vtkGetMacro(PolynomialWindow, int);
  ///@}

  ///@{
  /// Memory for snapshots that were read before, MiB: going back, and moving a pathline window on, need not
  /// read them again. Default 64. Range 0 and more.
  vtkSetClampMacro(CacheSize, int, 0, VTK_INT_MAX);
  vtkGetMacro(CacheSize, int);
  ///@}

protected:
  vtkSTBTrackReader();
  ~vtkSTBTrackReader() override;

  int RequestInformation(vtkInformation*, vtkInformationVector**, vtkInformationVector*) override;
  int RequestData(vtkInformation*, vtkInformationVector**, vtkInformationVector*) override;

  int LengthUnit = AUTO;
  double FramePeriod = 0;
  double TimeShift = 0;
  bool ShiftTimeToZero = false;
  int OutputMode = PARTICLES;
  int TrailLength = 10;
  int MinimumTrackLength = 1;
  vtkIdType TrackIdRange[2] = {-1, -1};
  int Stride = 1;
  bool UseTimeRange = false;
  double TimeRange[2] = {0, 1};
  bool TrackStatistics = false;
  int EstimateVelocities = MISSING;
  int PolynomialOrder = 2;
  int PolynomialWindow = 9;
  int CacheSize = 64;

private:
  vtkSTBTrackReader(const vtkSTBTrackReader&) = delete;
  void operator=(const vtkSTBTrackReader&) = delete;

  std::vector<std::string> FileNames;
  struct Series;
  std::unique_ptr<Series> Open;
};

#endif
