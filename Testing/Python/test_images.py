"""Breaks when a filter's first picture changes. Each picture has a numeric twin on the same pipeline, because the comparison of pictures
is blunt: the twin fails where a field is wrong by a few per cent."""
import gzip
import math
import os
import tempfile
import unittest

import numpy as np
from paraview import simple
from vtkmodules.util.numpy_support import numpy_to_vtk, vtk_to_numpy
from vtkmodules.vtkCommonCore import vtkPoints
from vtkmodules.vtkCommonDataModel import vtkPolyData

import rimflow_testing
from rimflow_testing import compare_image, render_view

DEMO = os.path.join(rimflow_testing.SOURCE, "Examples", "demo", "sphere.dat.gz")
DIAMETER, SPEED = 0.01111, 0.35  # of the synthetic sphere, which rises


def array(source, name, port=0):
    return vtk_to_numpy(simple.servermanager.Fetch(source, idx=port).GetPointData().GetArray(name))


def points(source, port=0):
    return vtk_to_numpy(simple.servermanager.Fetch(source, idx=port).GetPoints().GetData())


def producer(data):
    source = simple.TrivialProducer()
    source.GetClientSideObject().SetOutput(data)
    return source


def add(where, name, values):
    added = numpy_to_vtk(np.ascontiguousarray(values), deep=True)
    added.SetName(name)
    where.AddArray(added)


def show(view, source, name=None, low=0.0, high=1.0, component=None, **properties):
    """Shows the source in ten bands of colour from low to high, so that a picture tells a scaled field; without a name: in one colour."""
    shown = simple.Show(source, view)
    if name is None:
        shown.ColorArrayName = ["POINTS", ""]
    else:
        simple.ColorBy(shown, ("POINTS", name) + (() if component is None else (component,)), separate=True)
        shown.LookupTable.RescaleTransferFunction(low, high)
        shown.LookupTable.Discretize, shown.LookupTable.NumberOfTableValues = 1, 10
        shown.SetScalarBarVisibility(view, False)
    for key, value in properties.items():
        setattr(shown, key, value)
    return shown


def show_body(view, source, **properties):
    """A translucent ball."""
    return show(view, source, Opacity=0.35, DiffuseColor=[0.9, 0.6, 0.2], **properties)


def show_tube(view, path, radius, *colours, **properties):
    tube = simple.Tube(Input=path, Radius=radius)
    tube.Scalars, tube.Vectors = ["POINTS", ""], ["POINTS", ""]
    return show(view, tube, *colours, **properties)


def look(view, centre, height, direction=(0, 0, 1), up=(0, 1, 0)):
    """Parallel projection on the centre, from where the direction points to; height: of what is seen."""
    view.CameraParallelProjection, view.CameraParallelScale = 1, height / 2
    view.CameraFocalPoint, view.CameraViewUp = list(centre), list(up)
    view.CameraPosition = [c + 10 * height * d / np.linalg.norm(direction) for c, d in zip(centre, direction)]


def slab(source, depth, z=0.0):
    """What lies within `depth` of the plane z."""
    distance = simple.Calculator(Input=source, ResultArrayName="depth", Function=f"abs(coordsZ-({z}))")
    return simple.Threshold(Input=distance, Scalars=["POINTS", "depth"], ThresholdMethod="Below Lower Threshold", LowerThreshold=depth, AllScalars=1)


def demo_snapshots(first, last):
    """Snapshots of the demo's file, read by other code than ours: per snapshot positions (m), velocities (m/s) and track ids."""
    with gzip.open(DEMO, "rt") as file:
        zones = file.read().split("ZONE ")[1 + first:2 + last]
    for zone in zones:
        rows = np.array([line.split() for line in zone.splitlines()[4:] if line], float)
        yield 1e-3 * rows[:, :3], rows[:, 4:7], rows[:, 8].astype(int)


class TestReader(unittest.TestCase):
    SNAPSHOT, TRAIL = 12, 8

    def reader(self, **options):
        reader = simple.STBTrackReader(FileNames=[DEMO], **options)
        time = reader.TimestepValues[self.SNAPSHOT]
        reader.UpdatePipeline(time)
        view = render_view()
        view.ViewTime = time
        look(view, (0, -0.003, 0), 0.055)
        return reader, view

    def test_particles(self):
        reader, view = self.reader()
        (position, velocity, ids), = demo_snapshots(self.SNAPSHOT, self.SNAPSHOT)
        found = np.argsort(array(reader, "TrackId"))
        expected = np.argsort(ids)
        np.testing.assert_array_equal(array(reader, "TrackId")[found], ids[expected])
        np.testing.assert_allclose(points(reader)[found], position[expected], atol=1e-8)
        np.testing.assert_allclose(array(reader, "Velocity")[found], velocity[expected], atol=1e-7)
        show(view, slab(reader, 0.003), "Velocity", 0, 0.25, "Magnitude", PointSize=5)
        compare_image(self, view, "track_reader_particles")

    def test_pathlines(self):
        reader, view = self.reader(OutputMode="Pathlines", TrailLength=self.TRAIL)
        window = [dict(zip(ids, position)) for position, _, ids in demo_snapshots(self.SNAPSHOT - self.TRAIL + 1, self.SNAPSHOT)]
        steps = [(i, before[i], after[i]) for before, after in zip(window, window[1:]) for i in after if i in before]
        length = sum(math.dist(a, b) for _, a, b in steps)
        lines = simple.servermanager.Fetch(reader)
        x = points(reader)
        offsets, ids = (vtk_to_numpy(a) for a in (lines.GetLines().GetOffsetsArray(), lines.GetLines().GetConnectivityArray()))
        pieces = [x[ids[a:b]] for a, b in zip(offsets, offsets[1:])]
        self.assertEqual(sum(len(p) - 1 for p in pieces), len(steps))
        self.assertAlmostEqual(sum(np.linalg.norm(np.diff(p, axis=0), axis=1).sum() for p in pieces) / length, 1, delta=1e-4)
        show(view, slab(reader, 0.003), "Velocity", 0, 0.25, "Magnitude", LineWidth=2.5)
        compare_image(self, view, "track_reader_pathlines")


class TestSynthetic(unittest.TestCase):
    def test_synthetic_tracks(self):
        tracks = simple.SyntheticTracks(Density=2e7, AddTruth=1, VelocityNoise=0.001)
        time = tracks.TimestepValues[5]
        tracks.UpdatePipeline(time)
        # the twin: as many tracers as the density says, as fast as the flow is there, and none faster than the sphere
        low, high = tracks.Bounds[0::2], tracks.Bounds[1::2]
        volume = (high[0] - low[0]) * (high[1] - low[1]) * (high[2] - low[2])
        self.assertLess(abs(tracks.GetDataInformation().GetNumberOfPoints() / (2e7 * volume) - 1), 0.1)
        velocity, truth = array(tracks, "Velocity"), array(tracks, "TrueVelocity")
        self.assertAlmostEqual((velocity - truth).std() / 0.001, 1, delta=0.05)
        self.assertLess(np.linalg.norm(velocity, axis=1).max(), SPEED + 0.006)
        centre = simple.servermanager.Fetch(tracks).GetFieldData().GetArray("TrueCentre").GetTuple3(0)
        np.testing.assert_allclose(centre, (0, SPEED * (time - 0.0195), 0), atol=1e-9)
        view = render_view()
        view.ViewTime = time
        show(view, tracks, "Velocity", 0, SPEED, "Magnitude", PointSize=4)
        look(view, (0, 0, 0), 0.07)
        compare_image(self, view, "synthetic_tracks")


class TestSphereInItsFlow(unittest.TestCase):
    """Locator, VIC#: a sphere that rises in creeping flow, among tracers with noise and ghosts."""

    @classmethod
    def setUpClass(cls):
        cls.tracks = simple.SyntheticTracks(Density=2e8, Diameter=DIAMETER, NumberOfSnapshots=12, FramePeriod=0.003, PositionNoise=5e-6,
                                            GhostFraction=0.005, AddTruth=1)
        cls.times = list(cls.tracks.TimestepValues)
        cls.time = cls.times[9]
        cls.locator = simple.InvisibleSphereLocator(Particles=cls.tracks, Diameter=DIAMETER, ProcessAllTimes=1)
        cls.locator.UpdatePipeline(cls.time)
        cls.truth = simple.servermanager.Fetch(cls.tracks).GetFieldData().GetArray("TrueCentre").GetTuple3(0)

    def view(self, height, **camera):
        view = render_view()
        view.ViewTime = self.time
        look(view, self.truth, height, **camera)
        return view

    def test_located_sphere(self):
        # the twin: where it is, how large it is drawn, and how long the path is
        centre = array(self.locator, "Centre", 1)[0]
        self.assertLess(math.dist(centre, self.truth), 0.02 * DIAMETER)
        bounds = simple.servermanager.Fetch(self.locator, idx=0).GetBounds()
        for a in range(3):
            # as the whole path has it, which is truer than the snapshot
            self.assertAlmostEqual((bounds[2 * a] + bounds[2 * a + 1]) / 2, self.truth[a], delta=0.005 * DIAMETER)
            self.assertAlmostEqual(bounds[2 * a + 1] - bounds[2 * a], DIAMETER, delta=0.01 * DIAMETER)
        path = points(self.locator, 2)
        self.assertEqual(len(path), len(self.times))
        self.assertAlmostEqual(math.dist(path[0], path[-1]), SPEED * (self.times[-1] - self.times[0]), delta=0.02 * DIAMETER)
        # particles in a thin slab around its middle, the ball and its path
        view = self.view(0.034)
        show(view, slab(self.tracks, 0.0008), "Velocity", 0, SPEED, "Magnitude", PointSize=5)
        show_body(view, simple.OutputPort(self.locator, 0))
        show_tube(view, simple.OutputPort(self.locator, 2), 0.0002, DiffuseColor=[0.1, 0.1, 0.1])
        compare_image(self, view, "located_sphere")

    def test_wall_and_uncertainty(self):
        # the twin: the tracers at the wall are as far from it as they say, and the ellipsoid is as large as the covariance
        centre = array(self.locator, "Centre", 1)[0]
        wall = simple.OutputPort(self.locator, 3)
        distance = array(self.locator, "Distance", 3)
        near = distance < DIAMETER / 10
        self.assertGreater(near.sum(), 50)
        np.testing.assert_allclose(distance, np.linalg.norm(points(self.locator, 3) - centre, axis=1) - DIAMETER / 2, atol=1e-3 * DIAMETER)
        enlarged = 30
        ellipsoid = simple.TensorGlyph(Input=simple.OutputPort(self.locator, 1), Tensors=["POINTS", "SigmaTensor"], GlyphType="Sphere", ExtractEigenvalues=1,
                                       ColorGlyphs=0, LimitScalingByEigenvalues=0, ScaleFactor=2 * enlarged)
        ellipsoid.GlyphType.ThetaResolution = ellipsoid.GlyphType.PhiResolution = 48
        ellipsoid.UpdatePipeline(self.time)
        bounds = np.array(simple.servermanager.Fetch(ellipsoid).GetBounds())
        sigma = np.sqrt(array(self.locator, "Covariance", 1)[0][:3])
        np.testing.assert_allclose((bounds[1::2] - bounds[::2]) / 2, enlarged * sigma, rtol=0.02)
        np.testing.assert_allclose((bounds[1::2] + bounds[::2]) / 2, centre, atol=0.02 * enlarged * sigma.max())
        view = self.view(0.02, direction=(0.5, 0.3, 1))
        within = simple.Threshold(Input=wall, Scalars=["POINTS", "Distance"], ThresholdMethod="Below Lower Threshold", LowerThreshold=DIAMETER / 10)
        show(view, within, "Distance", 0, DIAMETER / 10, PointSize=7, RenderPointsAsSpheres=1)
        show_body(view, simple.OutputPort(self.locator, 0))
        show(view, ellipsoid, DiffuseColor=[0.2, 0.35, 0.6])
        compare_image(self, view, "wall_and_uncertainty")

    def test_vic_sharp(self):
        flow = simple.VICSharpResample(Particles=self.tracks, Body=simple.OutputPort(self.locator, 0), Spacing=0.0015, Viscosity=1.1e-6)
        flow.UpdatePipeline(self.time)
        # the twin: the flow at the tracers is the true one, in size too
        probe = simple.ResampleWithDataset(SourceDataArrays=flow, DestinationMesh=self.tracks, PassPointArrays=1)
        probe.UpdatePipeline(self.time)
        inside = (array(probe, "vtkValidPointMask") == 1) & (array(probe, "TrueTracerId") >= 0)
        found, truth = array(probe, "Velocity")[inside], array(probe, "TrueVelocity")[inside]
        self.assertGreater(inside.sum(), 0.8 * len(inside))
        self.assertAlmostEqual((found * truth).sum() / (truth**2).sum(), 1, delta=0.02)
        self.assertLess(np.sqrt(((found - truth)**2).sum() / (truth**2).sum()), 0.05)
        view = self.view(0.05)
        section = simple.Slice(Input=flow, SliceType="Plane")
        section.SliceType.Origin, section.SliceType.Normal = list(self.truth), [0, 0, 1]
        show(view, section, "Velocity", 0, SPEED, "Magnitude")
        show(view, simple.OutputPort(self.locator, 0), DiffuseColor=[0.9, 0.6, 0.2])
        compare_image(self, view, "vic_sharp_speed")


class TestVortices(unittest.TestCase):
    def test_vortices(self):
        # A ring: solid rotation that fades with the distance from a circle; Q at its core is known.
        box = simple.Wavelet(WholeExtent=[-15, 15, -15, 15, -10, 10])
        flow = simple.Calculator(Input=box, ResultArrayName="Velocity",
                                 Function="exp(-((sqrt(coordsX^2+coordsY^2)-8)^2+coordsZ^2)/8)*"
                                          "(coordsZ*(coordsX*iHat+coordsY*jHat)/max(sqrt(coordsX^2+coordsY^2),1)-(sqrt(coordsX^2+coordsY^2)-8)*kHat)")
        q = simple.QCriterion(Input=flow, Order=4)
        q.UpdatePipeline()
        # at the core the rotation is 1 rad/s: Q = 1, less what the grid smooths away
        self.assertAlmostEqual(q.PointData["QCriterion"].GetRange()[1], 1.0, delta=0.05)
        contour = simple.Contour(Input=q, ContourBy=["POINTS", "QCriterion"], Isosurfaces=[0.3])
        contour.UpdatePipeline()
        # R = 8; the surface of a thin torus of minor radius r has the area 4 pi^2 R r
        area = simple.IntegrateVariables(Input=contour)
        area.UpdatePipeline()
        self.assertAlmostEqual(area.CellData["Area"].GetRange()[0] / (4 * math.pi**2 * 8), 1.5, delta=0.4)
        view = render_view()
        show(view, contour)
        look(view, (0, 0, 0), 24, direction=(20, -50, 40), up=(0, 0, 1))
        compare_image(self, view, "vortices")


class TestPressureAndForce(unittest.TestCase):
    """p = x^2/10 + y, integrated around a sphere."""

    @classmethod
    def setUpClass(cls):
        cls.centre, cls.diameter = (3.0, 1.0, 0.0), 10.0
        box = simple.Wavelet(WholeExtent=[-15, 15, -15, 15, -10, 10])
        at_rest = simple.Calculator(Input=box, ResultArrayName="Velocity", Function="0*coordsX*iHat")
        flow = simple.Calculator(Input=at_rest, ResultArrayName="MaterialAcceleration", Function="-coordsX/5*iHat-jHat")
        data = vtkPolyData()
        add(data.GetFieldData(), "Diameter", np.array([cls.diameter]))
        add(data.GetFieldData(), "Centre", np.array([cls.centre]))
        body = producer(data)
        fluid = {"Density": 1, "Viscosity": 0}
        cls.pressure = simple.Omni3DPressure(Input=flow, Body=body, **fluid)
        cls.force = simple.SurfaceForce(Input=cls.pressure, Body=body, **fluid)
        cls.force.UpdatePipeline()
        image = simple.servermanager.Fetch(cls.pressure)
        x = np.array([image.GetPoint(p) for p in range(image.GetNumberOfPoints())])
        cls.fluid = array(cls.pressure, "Mask") == 0
        cls.difference = (array(cls.pressure, "Pressure") - x[:, 0]**2 / 10 - x[:, 1])[cls.fluid]

    def test_pressure(self):
        # the twin: the pressure but for a constant
        self.assertLess(self.difference.std(), 0.01)
        self.assertFalse(array(self.pressure, "Pressure")[~self.fluid].any())
        view = render_view()
        section = simple.Slice(Input=self.pressure, SliceType="Plane")
        section.SliceType.Origin, section.SliceType.Normal = self.centre, [0, 0, 1]
        show(view, section, "Pressure", -20, 25)
        show(view, simple.OutputPort(self.force, 0), "Pressure", -20, 25)
        look(view, (0, 0, 0), 36)
        compare_image(self, view, "pressure")

    def test_surface_force(self):
        # the twin: the pressure on the surface, and the force, -grad p integrated over the sphere
        x, on_surface = points(self.force).astype(float), array(self.force, "Pressure")
        self.assertLess(np.abs(on_surface - x[:, 0]**2 / 10 - x[:, 1] - self.difference.mean()).max(), 0.1)
        np.testing.assert_allclose(array(self.force, "Traction"), -on_surface[:, None] * array(self.force, "Normals"), atol=1e-4)
        row = simple.servermanager.Fetch(self.force, idx=1)
        volume = math.pi / 6 * self.diameter**3
        for name, expected in (("Fp_x_N", -0.2 * self.centre[0] * volume), ("Fp_y_N", -volume), ("Fp_z_N", 0)):
            self.assertAlmostEqual(row.GetColumnByName(name).GetValue(0), expected, delta=0.01 * volume)
        view = render_view()
        surface = simple.OutputPort(self.force, 0)
        show(view, surface, "Pressure", -20, 5)
        arrows = simple.Glyph(Input=surface, GlyphType="Arrow", OrientationArray=["POINTS", "Traction"], ScaleArray=["POINTS", "Traction"],
                              ScaleFactor=0.15, GlyphMode="Every Nth Point", Stride=40)
        show(view, arrows, DiffuseColor=[0.2, 0.2, 0.2])
        look(view, self.centre, 18, direction=(0.4, 0.3, 1))
        compare_image(self, view, "surface_force")


class TestPaths(unittest.TestCase):
    """A climb along two turns of a helix of radius 4 mm in 0.6 s, 60 snapshots."""

    def setUp(self):
        self.time = np.linspace(0, 0.6, 60)
        rate = 2 * math.pi / 0.3
        c, s = np.cos(rate * self.time), np.sin(rate * self.time)
        self.path = np.column_stack([0.004 * c, 0.03 * self.time, 0.004 * s])
        self.velocity = np.column_stack([-0.004 * rate * s, np.full(60, 0.03), 0.004 * rate * c])
        self.speed = np.linalg.norm(self.velocity[0])
        self.view = render_view()
        look(self.view, (0, 0.009, 0), 0.026, direction=(0.3, 0.25, 1))

    def test_smoother(self):
        sigma = 3e-4
        raw = self.path + sigma * np.random.default_rng(1).standard_normal(self.path.shape)
        data = vtkPolyData()
        data.SetPoints(vtkPoints())
        data.GetPoints().SetData(numpy_to_vtk(raw, deep=True))
        add(data.GetPointData(), "Time", self.time)
        add(data.GetPointData(), "Centre", raw)
        add(data.GetPointData(), "Covariance", np.tile([sigma**2] * 3 + [0.0] * 3, (60, 1)))
        smoother = simple.TrajectorySmoother(Input=producer(data))
        smoother.UpdatePipeline()
        # the twin: nearer to the path than the raw points, and as fast as the truth in the middle
        error = array(smoother, "Centre") - self.path
        self.assertLess(error.std(), 0.6 * sigma)
        middle = slice(10, -10)
        found = array(smoother, "Velocity")[middle]
        self.assertAlmostEqual((found * self.velocity[middle]).sum() / (self.velocity[middle]**2).sum(), 1, delta=0.04)
        show_tube(self.view, smoother, 0.0002, "Velocity", 0, 0.12, "Magnitude")
        raw_points = simple.Calculator(Input=smoother, Function="RawCentre", CoordinateResults=1)
        dots = simple.Glyph(Input=raw_points, GlyphType="Sphere", GlyphMode="All Points", ScaleFactor=0.0006)
        dots.OrientationArray, dots.ScaleArray = ["POINTS", "No orientation array"], ["POINTS", "No scale array"]
        show(self.view, dots, DiffuseColor=[0.25, 0.25, 0.25])
        compare_image(self, self.view, "trajectory_smoother")

    def test_trajectory_reader(self):
        with tempfile.TemporaryDirectory(prefix="rimflow-test-") as folder:
            name = os.path.join(folder, "path.dat")
            with open(name, "w", encoding="ascii") as file:
                file.write('VARIABLES = "Time[s]" "x[mm]" "y[mm]" "z[mm]"\nDIAMETER=6[mm]\n')
                for t, x in zip(self.time, 1e3 * self.path):
                    file.write(f"{t!r} {x[0]!r} {x[1]!r} {x[2]!r}\n")
            reader = simple.SphereTrajectoryReader(FileName=name)
            reader.UpdatePipeline(self.time[42])
            # the twin: place, size and motion
            np.testing.assert_allclose(array(reader, "Centre", 1)[0], self.path[42], atol=1e-9)
            np.testing.assert_allclose(array(reader, "Velocity", 1)[0], self.velocity[42], atol=0.01 * self.speed)
            np.testing.assert_allclose(np.linalg.norm(points(reader) - self.path[42], axis=1), 0.003, rtol=1e-3)
            np.testing.assert_allclose(array(reader, "Centre", 2), self.path, atol=1e-9)
            self.view.ViewTime = self.time[42]
            show_tube(self.view, simple.OutputPort(reader, 2), 0.0002, "Velocity", 0, 0.12, "Magnitude")
            show_body(self.view, simple.OutputPort(reader, 0))
            arrow = simple.Glyph(Input=simple.OutputPort(reader, 1), GlyphType="Arrow", OrientationArray=["POINTS", "Velocity"],
                                 ScaleArray=["POINTS", "Velocity"], ScaleFactor=0.07, GlyphMode="All Points")
            show(self.view, arrow, DiffuseColor=[0.2, 0.35, 0.6])
            compare_image(self, self.view, "trajectory_reader")


if __name__ == "__main__":
    rimflow_testing.main()
