"""The filters as a chain for headless runs, and what is written from their outputs. The wrapped VTK classes do the work."""
import ctypes
import os

import numpy as np
from vtkmodules.util.numpy_support import numpy_to_vtk, vtk_to_numpy
from vtkmodules.vtkCommonCore import VTK_STRING, vtkPoints, vtkVersion
from vtkmodules.vtkCommonDataModel import vtkCellArray, vtkPolyData
from vtkmodules.vtkCommonExecutionModel import vtkStreamingDemandDrivenPipeline
from vtkmodules.vtkFiltersSources import vtkSphereSource
from vtkmodules.vtkIOXML import vtkXMLImageDataWriter, vtkXMLPolyDataReader, vtkXMLPolyDataWriter
from vtkmodules.vtkParallelCore import vtkMultiProcessController

from rimflow import files
from rimflow.options import UsageError
from rimflow.vtkRIMFlowFilters import vtkInvisibleSphereLocator, vtkQCriterion, vtkTrajectorySmoother, vtkVICSharpResample
from rimflow.vtkRIMFlowReaders import vtkSTBTrackReader

FIELD_ARRAYS = ("Velocity", "MaterialAcceleration", "Vorticity", "QCriterion", "Mask", "vtkGhostType")


class PipelineError(Exception):
    """What the filters reported as an error."""


class Ranks:
    """The MPI processes that share the work; one when there is no MPI."""

    def __init__(self):
        self.controller = vtkMultiProcessController.GetGlobalController()
        self.count = self.controller.GetNumberOfProcesses() if self.controller else 1
        self.index = self.controller.GetLocalProcessId() if self.controller else 0
        self.first = self.index == 0

    def share(self, items):
        """This rank's contiguous part of a list."""
        n = len(items)
        return items[self.index * n // self.count:(self.index + 1) * n // self.count]

    def wait(self):
        if self.count > 1:
            self.controller.Barrier()


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


class Chain:
    """Tracks -> locator, and tracks + sphere -> VIC# -> Q-criterion, for any time of the file."""

    def __init__(self, options):
        self.options, self.errors = options, Errors()
        self.reader = vtkSTBTrackReader()
        for name in options.tracks:
            self.reader.AddFileName(name)
        if options.frame_period:
            self.reader.SetFramePeriod(options.frame_period)
        self.locator = vtkInvisibleSphereLocator()
        self.locator.SetInputConnection(0, self.reader.GetOutputPort())
        self.locator.SetDiameter(options.diameter)
        self.locator.JointTrajectoryOff()  # all ranks' snapshots are estimated together in the end
        self.locator.SetUpDirection(*(options.up or (0, 0, 0)))
        self.flow = self._flow()
        self.masked_flow = self._flow()
        if options.method == "published":
            self.locator.SetMethodToPublishedCost()
            self.locator.SetInputConnection(1, self.flow[1].GetOutputPort())
        self.errors.watch(self.reader, self.locator, *self.flow, *self.masked_flow)

    def _flow(self):
        resample, vortices = vtkVICSharpResample(), vtkQCriterion()
        resample.SetInputConnection(0, self.reader.GetOutputPort())
        resample.SetViscosity(self.options.viscosity)
        if self.options.spacing:
            resample.SetSpacing(self.options.spacing)
        vortices.SetInputConnection(resample.GetOutputPort())
        return resample, vortices

    def times(self):
        """The times of the snapshots in the files, s."""
        self.reader.UpdateInformation()
        try:
            self.errors.check()
        except PipelineError as error:
            raise UsageError(str(error)) from None
        steps = self.reader.GetOutputInformation(0).Get(vtkStreamingDemandDrivenPipeline.TIME_STEPS())
        if not steps:
            raise UsageError(f"{self.options.tracks[0]} holds no snapshot")
        return list(steps)

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
        return _kept(self.reader.GetOutput()), _kept(self.flow[1].GetOutput()) if flow else None

    def fields(self, time, body):
        """The flow around the sphere at one time: a vtkImageData with FIELD_ARRAYS."""
        resample, vortices = self.masked_flow
        if body.GetFieldData().GetArray("Centre"):
            resample.SetInputDataObject(1, body)
        else:
            resample.SetInputConnection(1, None)
        vortices.UpdateTimeStep(time)
        self.errors.check()
        image = vortices.GetOutput().NewInstance()
        image.ShallowCopy(vortices.GetOutput())
        points = image.GetPointData()
        for name in [points.GetArrayName(i) for i in range(points.GetNumberOfArrays())]:
            if name not in FIELD_ARRAYS:
                points.RemoveArray(name)
        return image


def _kept(data):
    copy = data.NewInstance()
    copy.ShallowCopy(data)
    return copy


def located(found):
    """One point of the locator's Centre output as plain numbers."""
    value = lambda name: _values(found, name)
    status = int(value("Status")[0])
    record = {"status": status, "status_text": _text(found, "StatusText")}
    if status != 2:
        record.update(centre_m=value("Centre"), covariance_m2=value("Covariance"), cost=value("Cost")[0],
                      gradient_norm=value("GradientNorm")[0], iterations=int(value("Iterations")[0]),
                      particles_inside=int(value("ParticlesInside")[0]), offset_void_m=value("OffsetVoid")[0],
                      offset_velocity_m=value("OffsetVelocity")[0], offset_vortex_m=value("OffsetVortex")[0])
    return {k: _plain(v) for k, v in record.items()}


QUALITY_ARRAYS = ("MisfitVelocity", "MisfitAcceleration", "VelocityNoise", "AccelerationNoise", "DivergenceNorm", "CurvatureWeight",
                  "ParticlesUsed", "Outliers", "Iterations", "ElapsedTime")


def quality(image):
    """How well the flow was reconstructed, as plain numbers by the names of vtkVICSharpResample's field data."""
    return {name: _plain(_values(image, name)[0]) for name in QUALITY_ARRAYS}


def _array(data, name):
    for attributes in (data.GetPointData(), data.GetFieldData()):
        array = attributes.GetAbstractArray(name)
        if array and array.GetNumberOfTuples():
            return array
    raise PipelineError(f"the locator gave no array {name}")


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
            for name in ("Centre", "Velocity", "Acceleration", "Covariance", "VelocitySigma", "AngularVelocity",
                         "AngularVelocitySigma", "Status")}


def body(trajectory, row):
    """One row of the trajectory as a Body (field data); without `Centre` where the sphere is lost."""
    data = vtkPolyData()
    add_array(data.GetFieldData(), "Time", np.array([trajectory.time[row]]))
    add_array(data.GetFieldData(), "Status", np.array([int(trajectory.status[row])], np.int32))
    if trajectory.status[row] != 2:
        for name, values in (("Centre", trajectory.centre), ("Velocity", trajectory.velocity), ("Acceleration", trajectory.acceleration),
                             ("Covariance", trajectory.covariance)):
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
    known = trajectory.status != 2
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


def read_polydata(path):
    reader = vtkXMLPolyDataReader()
    reader.SetFileName(path)
    reader.Update()
    return reader.GetOutput()


def write_polydata(path, data):
    _write(vtkXMLPolyDataWriter(), path, data)


def write_image(path, data):
    _write(vtkXMLImageDataWriter(), path, data)


def _write(writer, path, data):
    errors = Errors()
    errors.watch(writer)
    with files.replacing(path) as temporary:
        writer.SetFileName(temporary)
        writer.SetInputData(data)
        # Not appended: with the expat of Debian's security updates VTK 9.2 does not find appended data again.
        writer.SetDataModeToBinary()
        done = writer.Write()
        if not done or errors.messages:
            raise OSError(None, "could not be written, is the disk full? " + "; ".join(errors.messages), path)


def version():
    from rimflow import __version__

    return __version__


def paraview_version():
    from paraview import servermanager

    return servermanager.vtkSMProxyManager.GetParaViewSourceVersion().split()[-1]


def vtk_version():
    return vtkVersion.GetVTKVersion()


def leave(status):
    """Ends this process with the exit status, which pvbatch would turn into 0. Under MPI a failure ends all ranks."""
    controller = vtkMultiProcessController.GetGlobalController()
    if status == 0 and controller and controller.GetNumberOfProcesses() > 1:
        controller.Finalize()
    # pvbatch prints through C's stdout, which keeps the text back when it is a file or a pipe, and which os._exit forgets.
    ctypes.CDLL(None).fflush(None)
    os._exit(status)
