"""Breaks when the pipeline that a user builds by clicking (tracks, locator, VIC# with the sphere as Body, Q-criterion, contour)
does not work through its proxies, at several times and in any order."""
import math
import types
import unittest

from paraview import simple
from rimflow import pipeline as headless
from rimflow.vtkRIMFlowReaders import vtkSyntheticTracks
from vtkmodules.vtkCommonDataModel import vtkPolyData

import rimflow_testing

DIAMETER = 0.01111


def pipeline():
    tracks = simple.SyntheticTracks(Density=8e7, NumberOfSnapshots=8, PositionNoise=5e-6, VelocityNoise=2e-3, AccelerationNoise=0.2, Seed=3)
    locator = simple.InvisibleSphereLocator(Particles=tracks, Diameter=DIAMETER)
    flow = simple.VICSharpResample(Particles=tracks, Body=simple.OutputPort(locator, 0), MaximumIterations=20)
    return tracks, locator, flow, simple.QCriterion(Input=flow)


class TestPipeline(unittest.TestCase):
    def test_from_tracks_to_vortices_at_several_times(self):
        tracks, locator, flow, vortices = pipeline()
        contour = simple.Contour(Input=vortices, ContourBy=["POINTS", "QCriterion"], Isosurfaces=[20])
        times = list(tracks.TimestepValues)
        for time in (times[5], times[1], times[6]):
            contour.UpdatePipeline(time)
            info = vortices.GetDataInformation()
            self.assertGreater(info.GetNumberOfPoints(), 1000)
            for name in ("Velocity", "Vorticity", "MaterialAcceleration", "Mask", "QCriterion"):
                self.assertIsNotNone(vortices.PointData[name], name)
            # the sphere is blanked, and moves with 0.35 m/s inside
            self.assertEqual(vortices.PointData["Mask"].GetRange(), (0.0, 1.0))
            self.assertAlmostEqual(vortices.PointData["Velocity"].GetRange(1)[1], 0.35, delta=0.08)
            tracks.UpdatePipeline(time)
            locator.UpdatePipeline(time)
            truth = simple.servermanager.Fetch(tracks).GetFieldData().GetArray("TrueCentre").GetTuple3(0)
            found = simple.servermanager.Fetch(locator, idx=1).GetPointData().GetArray("Centre").GetTuple3(0)
            self.assertLess(math.dist(truth, found), 0.05 * DIAMETER)
            self.assertGreater(contour.GetDataInformation().GetNumberOfPoints(), 50)

    def test_trajectory_of_the_whole_recording(self):
        tracks, locator, _, _ = pipeline()
        locator.ProcessAllTimes = 1
        locator.UpdatePipeline(tracks.TimestepValues[0])
        trajectory = simple.servermanager.Fetch(locator, idx=2)
        self.assertEqual(trajectory.GetNumberOfPoints(), 8)
        velocity = trajectory.GetPointData().GetArray("Velocity").GetTuple3(4)
        self.assertAlmostEqual(velocity[1], 0.35, delta=0.03)

    def test_smoother_on_the_trajectory(self):
        tracks, locator, _, _ = pipeline()
        locator.ProcessAllTimes = 1
        smoother = simple.TrajectorySmoother(Input=simple.OutputPort(locator, 2), JerkIntensity=1.0)
        smoother.UpdatePipeline(tracks.TimestepValues[0])
        self.assertEqual(smoother.PointData["Status"].GetRange(), (0.0, 0.0))

    def test_a_flow_that_misses_the_particles_is_noted_headless(self):
        tracks = vtkSyntheticTracks()  # ABC flow, 1.5 nodes per wavelength
        tracks.SetFlow(4)
        tracks.SetWavelength(0.006)
        tracks.SetDensity(1.5e9)
        tracks.SetBounds(0, 0.02, 0, 0.02, 0, 0.02)
        tracks.SetNumberOfSnapshots(3)
        settings = types.SimpleNamespace(density=1000.0, viscosity=1e-6, body_density=None, up=None, no_forces=True, spacing=0.004)
        chain = types.SimpleNamespace(options=settings, errors=headless.Errors(), reader=tracks)
        flow = headless.FlowChain(chain).compute(0.0, vtkPolyData())
        self.assertEqual(flow.failed, "")
        self.assertIn("of the variance of the particles' velocities", flow.note)
        self.assertLess(flow.quality["ExplainedVariance"], 0.7)

    def test_fixed_grid(self):
        tracks, _, _, _ = pipeline()
        flow = simple.VICSharpResample(Particles=tracks, Spacing=0.002, UseBounds=1, Bounds=[-0.01, 0.01, -0.02, 0.02, -0.01, 0.01], MaximumIterations=5)
        flow.UpdatePipeline(tracks.TimestepValues[2])
        self.assertEqual(simple.servermanager.Fetch(flow).GetDimensions(), (11, 21, 11))
        self.assertEqual(tuple(round(b, 6) for b in flow.GetDataInformation().GetBounds()), (-0.01, 0.01, -0.02, 0.02, -0.01, 0.01))


if __name__ == "__main__":
    rimflow_testing.main()
