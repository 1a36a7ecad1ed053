"""The filters as a chain for headless runs, and what is written from their outputs. The wrapped VTK classes do the work."""
import ctypes
import io
import json
import os
import sys
import time as clock
import traceback
from dataclasses import dataclass, field

import numpy as np
from vtkmodules.util.numpy_support import numpy_to_vtk, vtk_to_numpy
from vtkmodules.vtkCommonCore import VTK_STRING, vtkPoints, vtkUnsignedCharArray, vtkVersion
from vtkmodules.vtkCommonDataModel import vtkCellArray, vtkDataObject, vtkPolyData
from vtkmodules.vtkCommonExecutionModel import vtkStreamingDemandDrivenPipeline
from vtkmodules.vtkFiltersSources import vtkSphereSource
from vtkmodules.vtkIOXML import vtkXMLImageDataWriter, vtkXMLPolyDataReader, vtkXMLPolyDataWriter
from vtkmodules.vtkParallelCore import vtkCommunicator, vtkMultiProcessController

from paraview.modules.vtkPVVTKExtensionsIOCore import vtkPVDReader

from rimflow import files
from rimflow.options import UsageError, gravity, is_series
from rimflow.vtkRIMFlowFilters import (vtkInvisibleSphereLocator, vtkOmni3DPressure, vtkQCriterion, vtkSurfaceForce, vtkTrajectorySmoother,
                                       vtkVICSharpResample)
from rimflow.vtkRIMFlowReaders import vtkSphereTrajectoryWriter, vtkSTBTrackReader

FIELD_ARRAYS = ("Velocity", "MaterialAcceleration", "Vorticity", "QCriterion", "Pressure", "PressureError", "Mask", "vtkGhostType")

FOUND, PREDICTED, LOST = 0, 1, 2  # `Status` of the sphere: in the snapshot itself, from its neighbours, not at all
# Chi-squared of three components beyond which a motion is more than noise, as the filters take it (Filters/Common/vtkBodyFromPolyData.h).
SIGNIFICANT = 14.16
WORLD = vtkMultiProcessController.GetGlobalController()  # all ranks, also when ParaView's controller is one rank's own


class PipelineError(Exception):
    """What the filters reported as an error."""


class Ranks:
    """The MPI processes that share the work; one when there is no MPI."""

    def __init__(self):
        self.controller = WORLD
        self.count = self.controller.GetNumberOfProcesses() if self.controller else 1
        self.index = self.controller.GetLocalProcessId() if self.controller else 0
        self.first = self.index == 0
        if self.count > 1:  # whole snapshots per rank: to ParaView each rank is alone from now on
            from paraview.spatiotemporalparallelism import CreateControllers

            _, self.alone, _ = CreateControllers(1)

    def share(self, items):
        """This rank's contiguous part of a list."""
        n = len(items)
        return items[self.index * n // self.count:(self.index + 1) * n // self.count]

    def wait(self):
        if self.count > 1:
            self.controller.Barrier()

    def gathered(self, texts):
        """The texts of all ranks on the first one, nothing on the others."""
        if self.count == 1:
            return texts
        mine = json.dumps(texts).encode()
        length = int(self.largest(len(mine)))
        padded, together = numpy_to_vtk(np.frombuffer(mine.ljust(length), np.uint8).copy(), deep=True), vtkUnsignedCharArray()
        self.controller.Gather(padded, together, 0)
        if not self.first:
            return []
        return [text for part in vtk_to_numpy(together).reshape(self.count, length) for text in json.loads(part.tobytes())]

    def shared(self, arrays):
        """The first rank's dictionary of arrays, on all of them; what the others give does not count."""
        if self.count == 1:
            return arrays
        packed = io.BytesIO()
        if self.first:
            np.savez(packed, **arrays)
        length = int(self.largest(len(packed.getvalue())))
        everywhere = numpy_to_vtk(np.frombuffer(packed.getvalue().ljust(length), np.uint8).copy(), deep=True)
        self.controller.Broadcast(everywhere, 0)
        with np.load(io.BytesIO(vtk_to_numpy(everywhere).tobytes())) as received:
            return dict(received)

    def largest(self, value):
        """The largest of the ranks' values, on all of them."""
        if self.count == 1:
            return value
        mine, all_of_them = numpy_to_vtk(np.array([float(value)]), deep=True), numpy_to_vtk(np.zeros(1), deep=True)
        self.controller.AllReduce(mine, all_of_them, vtkCommunicator.MAX_OP)
        return all_of_them.GetValue(0)


class Errors:
    """Collects what the watched filters report, so that an error ends in an exception and not only in the log."""

    def __init__(self):
        self.messages = []

    def watch(self, *algorithms):
        def heard(_, __, text):
            # "ERROR: In file.cxx, line 12\nvtkX (0x...): what happened": the last part is for people
            message = text.strip().split("): ", 1)[-1].strip()
            if "returned failure for request" not in message:
                self.messages.append(message)

        heard.CallDataType = VTK_STRING
        for algorithm in algorithms:
            algorithm.AddObserver("ErrorEvent", heard)
            algorithm.GetExecutive().AddObserver("ErrorEvent", heard)

    def check(self):
        messages, self.messages = self.messages, []
        if messages:
            raise PipelineError("; ".join(dict.fromkeys(messages)))


def track_reader(names, frame_period=None):
    """A reader of track files, or of a series that `rimflow convert` made of them."""
    if is_series(names[0]):
        reader = vtkPVDReader()
        reader.SetFileName(names[0])
        return reader
    reader = vtkSTBTrackReader()
    for name in names:
        reader.AddFileName(name)
    if frame_period:
        reader.SetFramePeriod(frame_period)
    return reader


def times(reader, errors, name):
    """The times of the snapshots in the files, s. name: of the first file, for the message."""
    reader.UpdateInformation()
    try:
        errors.check()
    except PipelineError as error:
        raise UsageError(str(error)) from None
    steps = reader.GetOutputInformation(0).Get(vtkStreamingDemandDrivenPipeline.TIME_STEPS())
    if not steps:
        raise UsageError(f"{name} holds no snapshot")
    return list(steps)


class Chain:
    """Tracks -> locator, for any time of the file."""

    def __init__(self, options):
        self.options, self.errors = options, Errors()
        self.reader = track_reader(options.tracks, options.frame_period)
        self.flow = flow_filters(self.reader, options)
        self.errors.watch(self.reader, *self.flow)
        self.begin()

    def begin(self, guess=None):
        """Forgets where the sphere was. guess: where it may be in the snapshot that is located next, m; None: anywhere."""
        self.locator = vtkInvisibleSphereLocator()
        self.locator.SetInputConnection(0, self.reader.GetOutputPort())
        self.locator.SetDiameter(self.options.diameter)
        self.locator.JointTrajectoryOff()  # all ranks' snapshots are estimated together in the end
        self.locator.SetUpDirection(*(self.options.up or (0, 0, 0)))
        if guess:
            self.locator.SetInitialGuess(guess)
            self.locator.UseInitialGuessOn()
        if self.options.method == "published":
            self.locator.SetMethodToPublishedCost()
            self.locator.SetInputConnection(1, self.flow[1].GetOutputPort())
        self.errors.watch(self.locator)

    def times(self):
        """The times of the snapshots in the files, s."""
        return times(self.reader, self.errors, self.options.tracks[0])

    def locate(self, time):
        """What the locator says of one snapshot, as plain numbers."""
        self.locator.UpdateTimeStep(time)
        self.errors.check()
        return located(self.locator.GetOutputDataObject(1))

    def wall(self):
        """The tracers next to the wall in the snapshot that was located last; empty when the sphere was not found."""
        return self.locator.GetOutputDataObject(3)

    def snapshot(self, time, flow):
        """The particles of one time and, on request, the flow without a body; both stay when the time moves on."""
        self.reader.UpdateTimeStep(time)
        if flow:
            self.flow[1].UpdateTimeStep(time)
        self.errors.check()
        return kept(self.reader.GetOutputDataObject(0)), kept(self.flow[1].GetOutput()) if flow else None


def flow_filters(reader, options):
    """VIC# and the Q-criterion on a reader's particles."""
    resample, vortices = vtkVICSharpResample(), vtkQCriterion()
    resample.SetInputConnection(0, reader.GetOutputPort())
    resample.SetViscosity(options.viscosity)
    if options.spacing:
        resample.SetSpacing(options.spacing)
    vortices.SetInputConnection(resample.GetOutputPort())
    for step in (resample, vortices):
        step.SetCacheSize(0)  # as a rule no snapshot comes twice
    return resample, vortices


@dataclass
class Flow:
    """The flow of one snapshot. A step that fails leaves what was there before it, and the reason."""
    image: object = None    # vtkImageData with FIELD_ARRAYS
    quality: dict = None    # how well it was reconstructed
    surface: object = None  # vtkPolyData with Pressure and Traction; None where the forces are not known
    forces: dict = None     # the numbers of vtkSurfaceForce's table by their names
    note: str = ""          # what the user should know of the flow and the forces
    failed: str = ""        # what failed, and why
    seconds: dict = field(default_factory=dict)  # per step


class FlowChain:
    """Tracks + sphere -> VIC# -> Q-criterion -> pressure -> forces on the sphere, for any time of the file."""

    def __init__(self, chain):
        options = chain.options
        self.options, self.errors = options, chain.errors
        self.resample, self.vortices = flow_filters(chain.reader, options)
        self.pressure, self.force = vtkOmni3DPressure(), vtkSurfaceForce()
        self.pressure.SetInputConnection(0, self.vortices.GetOutputPort())
        self.pressure.SetDensity(options.density)
        self.pressure.SetViscosity(options.viscosity)
        self.force.SetInputConnection(0, self.pressure.GetOutputPort())
        self.force.SetDensity(options.density)
        self.force.SetViscosity(options.viscosity)
        self.force.SetBodyDensity(options.body_density or 0)
        self.force.SetGravity(*gravity(options))
        for step in (self.pressure, self.force):
            step.SetCacheSize(0)  # no snapshot comes twice
        self.errors.watch(self.resample, self.vortices, self.pressure, self.force)
        self.resample.UpdateInformation()  # reads a snapshot from the middle of the series: where that one is broken, this is not ...
        self.errors.messages.clear()       # ... the fault of the snapshot that comes first

    def compute(self, time, body):
        """The Flow at one time around a Body, if its place and motion are known. Raises nothing for what the filters report."""
        arrays = body.GetFieldData()
        known = arrays.HasArray("Centre") and arrays.HasArray("Velocity")
        for step in (self.resample, self.pressure, self.force):
            step.SetInputDataObject(1, body if known else None)
        flow = Flow()
        try:
            for name, step in (("flow", self.vortices), ("pressure", self.pressure)):
                flow.seconds[name] = self._run(step, time)
                flow.image = _with_arrays(step.GetOutputDataObject(0), FIELD_ARRAYS)
                flow.quality = {**(flow.quality or {}), **quality(flow.image, QUALITY[name])}
                flow.image.GetFieldData().RemoveArray("ElapsedTime")  # the same run twice writes the same files
            if flow.image.GetFieldData().HasArray("Note"):
                flow.note = _text(flow.image, "Note")
            wanted = arrays.HasArray("Centre") and not self.options.no_forces
            if wanted and not known:
                raise PipelineError("the sphere was found in this snapshot alone, which does not tell how it moves")
            if wanted:
                flow.seconds["forces"] = self._run(self.force, time)
                numbers, note = force_row(self.force.GetOutputDataObject(1))
                if numbers["drag_N"] is None:
                    raise PipelineError(note)
                flow.note = "; ".join(filter(None, (flow.note, note)))
                flow.forces, flow.surface = numbers, kept(self.force.GetOutputDataObject(0))
        except PipelineError as error:
            flow.failed = str(error)
        return flow

    def _run(self, step, time):
        start = clock.monotonic()
        step.UpdateTimeStep(time)
        self.errors.check()
        return round(clock.monotonic() - start, 4)


def force_row(table):
    """The one row of vtkSurfaceForce's table: its numbers by name, and its note."""
    numbers = {}
    for i in range(table.GetNumberOfColumns()):
        column = table.GetColumn(i)
        if hasattr(column, "GetTuple1"):
            numbers[column.GetName()] = _plain(column.GetTuple1(0))
    return numbers, _text(table, "note")


def _with_arrays(image, names):
    copy = kept(image)
    points = copy.GetPointData()
    for name in [points.GetArrayName(i) for i in range(points.GetNumberOfArrays())]:
        if name not in names:
            points.RemoveArray(name)
    return copy


def kept(data):
    copy = data.NewInstance()
    copy.ShallowCopy(data)
    return copy


def located(found):
    """One point of the locator's Centre output as plain numbers."""
    value = lambda name: _values(found, name)
    status = int(value("Status")[0])
    record = {"status": status, "status_text": _text(found, "StatusText")}
    if status != LOST:
        record.update(centre_m=value("Centre"), covariance_m2=value("Covariance"), cost=value("Cost")[0],
                      gradient_norm=value("GradientNorm")[0], iterations=int(value("Iterations")[0]),
                      particles_inside=int(value("ParticlesInside")[0]), offset_void_m=value("OffsetVoid")[0],
                      offset_velocity_m=value("OffsetVelocity")[0], offset_vortex_m=value("OffsetVortex")[0])
    return {k: _plain(v) for k, v in record.items()}


# numbers of the run's report by the names of the field data that vtkVICSharpResample and vtkOmni3DPressure give
QUALITY = {
    "flow": {name: name for name in ("MisfitVelocity", "MisfitAcceleration", "ExplainedVariance", "VelocityNoise", "AccelerationNoise", "DivergenceNorm",
                                     "CurvatureWeight", "ParticlesUsed", "Outliers", "Iterations", "ElapsedTime")},
    "pressure": {"PressureIterations": "Iterations", "PressureCurlResidual": "CurlResidual"}}


def quality(image, names):
    """How well the flow or its pressure was found, as plain numbers."""
    return {name: _plain(_values(image, array)[0]) for name, array in names.items()}


def _array(data, name):
    for attributes in (data.GetAttributes(vtkDataObject.POINT), data.GetAttributes(vtkDataObject.ROW), data.GetFieldData()):
        array = attributes and attributes.GetAbstractArray(name)
        if array and array.GetNumberOfTuples():
            return array
    raise PipelineError(f"there is no array {name}")


def _values(data, name):
    return [float(v) for v in vtk_to_numpy(_array(data, name)).reshape(-1)]


def _text(data, name):
    return _array(data, name).GetValue(0)


def _plain(value):
    """JSON has no NaN: what is not a number is null."""
    if isinstance(value, list):
        return [_plain(v) for v in value]
    return None if isinstance(value, float) and not np.isfinite(value) else value


def add_array(attributes, name, values):
    array = numpy_to_vtk(np.ascontiguousarray(values), deep=True)
    array.SetName(name)
    attributes.AddArray(array)


def vtk_points(positions):
    points = vtkPoints()
    points.SetData(numpy_to_vtk(np.ascontiguousarray(positions), deep=True))
    return points


def smooth(times, centres, covariances, status, diameter, walls=()):
    """The trajectory smoother on single-snapshot results and the locator's walls; a dictionary of arrays over the same times."""
    data = vtkPolyData()
    data.SetPoints(vtk_points(np.nan_to_num(centres)))
    for name, values in (("Time", times), ("Centre", centres), ("Covariance", covariances), ("Status", status.astype(np.int32)),
                         ("Diameter", np.full(len(times), diameter))):
        add_array(data.GetPointData(), name, values)
    smoother, errors = vtkTrajectorySmoother(), Errors()
    errors.watch(smoother)
    smoother.SetLargestPredictionSigma(0.5 * diameter)  # as the locator's Trajectory
    smoother.SetInputData(data)
    for wall in walls:
        smoother.AddInputDataObject(1, wall)
    smoother.Update()
    errors.check()
    output = smoother.GetOutput().GetPointData()
    return {name: vtk_to_numpy(output.GetArray(name)).copy()
            for name in ("Centre", "Velocity", "Acceleration", "Covariance", "VelocitySigma", "AccelerationSigma", "AngularVelocity",
                         "AngularVelocitySigma", "Status")}


def body(trajectory, row):
    """One row of the trajectory as a Body (field data); without `Centre` where the sphere is lost, without `Velocity` where no other
    snapshot tells it. Acceleration and rotation come with their standard deviations: the filters follow what is significant."""
    data = vtkPolyData()
    add_array(data.GetFieldData(), "Time", np.array([trajectory.time[row]]))
    add_array(data.GetFieldData(), "Status", np.array([int(trajectory.status[row])], np.int32))
    if trajectory.status[row] != LOST:
        motion = [("Velocity", trajectory.velocity), ("VelocitySigma", trajectory.velocity_sigma),
                  ("Acceleration", trajectory.acceleration), ("AccelerationSigma", trajectory.acceleration_sigma),
                  ("AngularVelocity", trajectory.rotation), ("AngularVelocitySigma", trajectory.rotation_sigma)]
        alone = np.count_nonzero(trajectory.status != LOST) == 1  # one place is no motion
        for name, values in [("Centre", trajectory.centre), ("Covariance", trajectory.covariance)] + ([] if alone else motion):
            add_array(data.GetFieldData(), name, values[row][None, :])
        add_array(data.GetFieldData(), "Diameter", np.array([trajectory.diameter]))
    return data


def sphere(body_data):
    """The body's surface, with the body's field data; empty where the sphere is lost."""
    surface = vtkPolyData()
    centre = body_data.GetFieldData().GetArray("Centre")
    if centre:
        source = vtkSphereSource()
        source.SetCenter(*centre.GetTuple3(0))
        source.SetRadius(0.5 * body_data.GetFieldData().GetArray("Diameter").GetValue(0))
        source.SetThetaResolution(64)
        source.SetPhiResolution(33)
        source.Update()
        surface.ShallowCopy(source.GetOutput())
    surface.SetFieldData(body_data.GetFieldData())
    return surface


def polyline(trajectory):
    """The smoothed trajectory as one line through the snapshots where the sphere is known."""
    known = trajectory.status != LOST
    data, lines = vtkPolyData(), vtkCellArray()
    data.SetPoints(vtk_points(trajectory.centre[known]))
    lines.InsertNextCell(int(known.sum()))
    for i in range(int(known.sum())):
        lines.InsertCellPoint(i)
    data.SetLines(lines)
    for name, values in (("Time", trajectory.time), ("Snapshot", trajectory.snapshot), ("Velocity", trajectory.velocity),
                         ("Acceleration", trajectory.acceleration), ("Covariance", trajectory.covariance),
                         ("AngularVelocity", trajectory.rotation), ("AngularVelocitySigma", trajectory.rotation_sigma), ("Status", trajectory.status.astype(np.int32)), ("RawCentre", trajectory.raw)):
        add_array(data.GetPointData(), name, values[known])
    return data


def write_sphere_trajectory(path, trajectory, density_ratio):
    """The smoothed places as the text file of the Sphere Trajectory Reader, NaN where the sphere is lost. density_ratio: 0 where not known."""
    data = vtkPolyData()
    data.SetPoints(vtk_points(np.nan_to_num(trajectory.centre)))
    for name, values in (("Time", trajectory.time), ("Centre", trajectory.centre), ("Status", trajectory.status.astype(np.int32))):
        add_array(data.GetPointData(), name, values)
    writer, errors = vtkSphereTrajectoryWriter(), Errors()
    errors.watch(writer)
    with files.replacing(path) as temporary:
        writer.SetFileName(temporary)
        writer.SetDiameter(trajectory.diameter)
        writer.SetDensityRatio(density_ratio)
        writer.SetInputData(data)
        writer.Write()
        if errors.messages:
            raise OSError(None, "; ".join(errors.messages), path)


def read_polydata(path):
    reader = vtkXMLPolyDataReader()
    reader.SetFileName(path)
    reader.Update()
    return reader.GetOutput()


def surface_pressure(path):
    """Points (n, 3) and pressure (n,) of a sphere's file; None where it has none, or is not there."""
    surface = read_polydata(path) if os.path.exists(path) else None
    if not surface or not surface.GetPointData().HasArray("Pressure"):
        return None
    return vtk_to_numpy(surface.GetPoints().GetData()).astype(float), vtk_to_numpy(surface.GetPointData().GetArray("Pressure")).astype(float)


def write_polydata(path, data, compressed=True):
    _write(vtkXMLPolyDataWriter(), path, data, compressed)


def write_image(path, data):
    _write(vtkXMLImageDataWriter(), path, data)


def _write(writer, path, data, compressed=True):
    errors = Errors()
    errors.watch(writer)
    with files.replacing(path) as temporary:
        writer.SetFileName(temporary)
        writer.SetInputData(data)
        writer.SetHeaderTypeToUInt64()
        writer.SetDataModeToAppended()
        writer.EncodeAppendedDataOff()
        if not compressed:
            writer.SetCompressorTypeToNone()
        done = writer.Write()
        if not done or errors.messages:
            raise OSError(None, "could not be written, is the disk full? " + "; ".join(errors.messages), path)
        files.space_before_appended_data(temporary)


def version():
    from rimflow import __version__

    return __version__


def paraview_version():
    from paraview import servermanager

    return servermanager.vtkSMProxyManager.GetParaViewSourceVersion().split()[-1]


def vtk_version():
    return vtkVersion.GetVTKVersion()


def run(main):
    """Runs main(arguments) -> exit status as the whole program."""
    try:
        status = main(sys.argv[1:])
    except Exception:  # a defect of ours: say so, and do not leave other ranks waiting
        traceback.print_exc()
        status = 1
    sys.stdout.flush()
    sys.stderr.flush()
    leave(status)


def answered(command, work, speaks=True):
    """The exit status of work(); what goes wrong in it becomes a message for the user. speaks: not where another rank says the same."""
    try:
        work()
        return 0
    except SystemExit as error:  # argparse has printed its message
        return int(error.code or 0)
    except UsageError as error:
        if speaks:
            print(f"rimflow {command}: {error}", file=sys.stderr)
        return 2
    except PipelineError as error:
        print(f"rimflow {command}: {error}", file=sys.stderr)
    except OSError as error:
        print(f"rimflow {command}: {files.reason(error)}", file=sys.stderr)
    return 1


def leave(status):
    """Ends this process with the exit status, which pvbatch would turn into 0. Under MPI a failure ends all ranks."""
    if status == 0 and WORLD and WORLD.GetNumberOfProcesses() > 1:
        WORLD.Finalize()
    # pvbatch prints through C's stdout, which keeps the text back when it is a file or a pipe, and which os._exit forgets.
    ctypes.CDLL(None).fflush(None)
    os._exit(status)
