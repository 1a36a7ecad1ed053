"""Breaks when a filter's first picture changes; each image has a numeric twin on the same pipeline."""
import math
import unittest

import numpy as np
from paraview import simple
from vtkmodules.util.numpy_support import numpy_to_vtk, vtk_to_numpy
from vtkmodules.vtkCommonDataModel import vtkPolyData

import rimflow_testing
from rimflow_testing import compare_image, render_view

DIAMETER = 0.01111


class TestImages(unittest.TestCase):
    def test_synthetic_tracks(self):
        tracks = simple.SyntheticTracks(Density=2e7)
        time = tracks.TimestepValues[5]
        tracks.UpdatePipeline(time)
        # the twin: as many tracers as the density says, none faster than the sphere
        low, high = tracks.Bounds[0::2], tracks.Bounds[1::2]
        volume = (high[0] - low[0]) * (high[1] - low[1]) * (high[2] - low[2])
        self.assertLess(abs(tracks.GetDataInformation().GetNumberOfPoints() / (2e7 * volume) - 1), 0.1)
        self.assertLess(tracks.PointData["Velocity"].GetRange(-1)[1], 0.36)
        view = render_view()
        view.ViewTime = time
        shown = simple.Show(tracks, view)
        shown.PointSize = 4
        simple.ColorBy(shown, ("POINTS", "Velocity", "Magnitude"))
        shown.LookupTable.RescaleTransferFunction(0, 0.35)
        simple.ResetCamera(view)
        compare_image(self, view, "synthetic_tracks")

    def test_located_sphere(self):
        # a sphere that rises at 0.35 m/s; particles in a thin slab around its middle, and the path behind it
        tracks = simple.SyntheticTracks(Density=2e8, Diameter=DIAMETER, NumberOfSnapshots=12, PositionNoise=5e-6, GhostFraction=0.005)
        time = tracks.TimestepValues[9]
        locator = simple.InvisibleSphereLocator(Particles=tracks, Diameter=DIAMETER, ProcessAllTimes=1)
        locator.UpdatePipeline(time)
        # the twin: where it is, how large it is drawn, and how long the path is
        truth = simple.servermanager.Fetch(tracks).GetFieldData().GetArray("TrueCentre").GetTuple3(0)
        centre = simple.servermanager.Fetch(locator, idx=1).GetPointData().GetArray("Centre").GetTuple3(0)
        self.assertLess(math.dist(centre, truth), 0.02 * DIAMETER)
        bounds = simple.servermanager.Fetch(locator, idx=0).GetBounds()
        for a in range(3):
            self.assertAlmostEqual((bounds[2 * a] + bounds[2 * a + 1]) / 2, centre[a], delta=0.005 * DIAMETER)
            self.assertAlmostEqual(bounds[2 * a + 1] - bounds[2 * a], DIAMETER, delta=0.01 * DIAMETER)
        path = simple.servermanager.Fetch(locator, idx=2)
        self.assertEqual(path.GetNumberOfPoints(), 12)
        length = math.dist(path.GetPoint(0), path.GetPoint(11))
        self.assertAlmostEqual(length, 0.35 * (tracks.TimestepValues[11] - tracks.TimestepValues[0]), delta=0.02 * DIAMETER)
        view = render_view()
        view.ViewTime = time
        slab = simple.Threshold(Input=simple.Calculator(Input=tracks, ResultArrayName="depth", Function="abs(coordsZ)"),
                                Scalars=["POINTS", "depth"], ThresholdMethod="Below Lower Threshold", LowerThreshold=5e-4)
        shown = simple.Show(slab, view)
        shown.PointSize = 5
        simple.ColorBy(shown, ("POINTS", "Velocity", "Magnitude"))
        shown.LookupTable.RescaleTransferFunction(0, 0.35)
        ball = simple.Show(simple.OutputPort(locator, 0), view)
        ball.Opacity, ball.DiffuseColor = 0.6, [0.9, 0.6, 0.2]
        ball.ColorArrayName = ["POINTS", ""]
        line = simple.Show(simple.OutputPort(locator, 2), view)
        line.DiffuseColor, line.AmbientColor, line.LineWidth = [0, 0, 0], [0, 0, 0], 3
        line.ColorArrayName = ["POINTS", ""]
        view.CameraPosition, view.CameraFocalPoint, view.CameraViewUp = [*truth[:2], 0.2], [*truth[:2], 0], [0, 1, 0]
        view.CameraParallelProjection, view.CameraParallelScale = 1, 0.012
        compare_image(self, view, "located_sphere")

    def test_vortices(self):
        # A ring: solid rotation that fades with the distance from a circle; Q at its core is known.
        box = simple.Wavelet(WholeExtent=[-15, 15, -15, 15, -10, 10])
        flow = simple.Calculator(Input=box, ResultArrayName="Velocity",
                                 Function="exp(-((sqrt(coordsX^2+coordsY^2)-8)^2+coordsZ^2)/8)*"
                                          "(coordsZ*(coordsX*iHat+coordsY*jHat)/max(sqrt(coordsX^2+coordsY^2),1)-(sqrt(coordsX^2+coordsY^2)-8)*kHat)")
        q = simple.QCriterion(Input=flow, Order=4)
        q.UpdatePipeline()
        # at the core the rotation is 1 rad/s: Q = 1, less what the grid smooths away
        self.assertAlmostEqual(q.PointData["QCriterion"].GetRange()[1], 1.0, delta=0.08)
        contour = simple.Contour(Input=q, ContourBy=["POINTS", "QCriterion"], Isosurfaces=[0.3])
        contour.UpdatePipeline()
        # R = 8; the surface of a thin torus of minor radius r has the area 4 pi^2 R r
        area = simple.IntegrateVariables(Input=contour)
        area.UpdatePipeline()
        self.assertAlmostEqual(area.CellData["Area"].GetRange()[0] / (4 * 3.1416**2 * 8), 1.5, delta=0.4)
        view = render_view()
        simple.ColorBy(simple.Show(contour, view), None)
        view.CameraPosition, view.CameraFocalPoint, view.CameraViewUp = [20, -50, 40], [0, 0, 0], [0, 0, 1]
        view.CameraParallelProjection, view.CameraParallelScale = 1, 12
        compare_image(self, view, "vortices")

    def test_pressure_on_the_sphere(self):
        # p = x^2/10 + y, integrated around a sphere, as a section and on the sphere itself
        centre, diameter = (3.0, 1.0, 0.0), 10.0
        box = simple.Wavelet(WholeExtent=[-15, 15, -15, 15, -10, 10])
        at_rest = simple.Calculator(Input=box, ResultArrayName="Velocity", Function="0*coordsX*iHat")
        flow = simple.Calculator(Input=at_rest, ResultArrayName="MaterialAcceleration", Function="-coordsX/5*iHat-jHat")
        data = vtkPolyData()
        for name, values in (("Diameter", [diameter]), ("Centre", [centre])):
            array = numpy_to_vtk(np.array(values), deep=True)
            array.SetName(name)
            data.GetFieldData().AddArray(array)
        body = simple.TrivialProducer()
        body.GetClientSideObject().SetOutput(data)
        fluid = {"Density": 1, "Viscosity": 0}
        pressure = simple.Omni3DPressure(Input=flow, Body=body, **fluid)
        force = simple.SurfaceForce(Input=pressure, Body=body, **fluid)
        force.UpdatePipeline()
        # the twin: the pressure but for a constant, and the force, -grad p integrated over the sphere
        image = simple.servermanager.Fetch(pressure)
        found = vtk_to_numpy(image.GetPointData().GetArray("Pressure"))
        fluid_there = vtk_to_numpy(image.GetPointData().GetArray("Mask")) == 0
        x = np.array([image.GetPoint(p) for p in range(image.GetNumberOfPoints())])
        difference = (found - x[:, 0]**2 / 10 - x[:, 1])[fluid_there]
        self.assertLess(difference.std(), 0.01)
        self.assertFalse(found[~fluid_there].any())
        row = simple.servermanager.Fetch(force, idx=1)
        volume = math.pi / 6 * diameter**3
        for name, expected in (("Fp_x_N", -0.2 * centre[0] * volume), ("Fp_y_N", -volume), ("Fp_z_N", 0)):
            self.assertAlmostEqual(row.GetColumnByName(name).GetValue(0), expected, delta=0.01 * volume)
        view = render_view()
        section = simple.Slice(Input=pressure, SliceType="Plane")
        section.SliceType.Origin, section.SliceType.Normal = centre, [0, 0, 1]
        for shown in (simple.Show(section, view), simple.Show(simple.OutputPort(force, 0), view)):
            simple.ColorBy(shown, ("POINTS", "Pressure"))
        shown.LookupTable.RescaleTransferFunction(-20, 25)
        view.CameraPosition, view.CameraFocalPoint, view.CameraViewUp = [30, -40, 60], [0, 0, 0], [0, 1, 0]
        view.CameraParallelProjection, view.CameraParallelScale = 1, 18
        compare_image(self, view, "pressure")


if __name__ == "__main__":
    rimflow_testing.main()
