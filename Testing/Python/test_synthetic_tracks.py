"""Breaks when the SyntheticTracks proxy, its properties, times or field data cannot be used from pvpython."""
import unittest

import numpy as np
from paraview import servermanager, simple
from rimflow.vtkRIMFlowReaders import vtkSyntheticTracks  # before GetClientSideObject, which else gives its base class
from vtkmodules.util.numpy_support import vtk_to_numpy

import rimflow_testing


def fetch(source):
    data = servermanager.Fetch(source)
    return data, {data.GetPointData().GetArrayName(i): vtk_to_numpy(data.GetPointData().GetArray(i)) for i in range(data.GetPointData().GetNumberOfArrays())}


class TestSyntheticTracks(unittest.TestCase):
    def test_defaults_give_a_moving_sphere_in_time_steps(self):
        tracks = simple.SyntheticTracks()
        tracks.UpdatePipelineInformation()
        times = list(tracks.TimestepValues)
        self.assertEqual(len(times), 40)
        self.assertAlmostEqual(times[-1], 0.039)
        centres = []
        for t in (times[30], times[0]):
            tracks.UpdatePipeline(t)
            data, arrays = fetch(tracks)
            self.assertGreater(data.GetNumberOfPoints(), 20000)
            self.assertEqual(data.GetNumberOfPoints(), data.GetNumberOfVerts())
            self.assertEqual(sorted(arrays), ["Acceleration", "TrackId", "Velocity"])
            centres.append(np.array(data.GetFieldData().GetArray("TrueCentre").GetTuple3(0)))
            self.assertAlmostEqual(data.GetFieldData().GetArray("TrueDiameter").GetValue(0), 0.01111)
            distance = np.linalg.norm(vtk_to_numpy(data.GetPoints().GetData()) - centres[-1], axis=1)
            self.assertGreater(distance.min(), 0.01111 / 2 - 1e-8)
        np.testing.assert_allclose(centres[0] - centres[1], [0, 0.35 * 0.03, 0], atol=1e-12)

    def test_every_property_reaches_the_class(self):
        settings = dict(
            Diameter=0.02, Centre=[1, 2, 3], Velocity=[4, 5, 6], Acceleration=[0.1, 0.2, 0.3], AngularVelocity=[0, 0, 0],
            Amplitude=0.2, Wavelength=0.03, Viscosity=1e-5, FluidDensity=1000, Density=1e8, Bounds=[0, 0.01, 0, 0.02, 0, 0.03],
            NumberOfSnapshots=7, FramePeriod=0.002, StartTime=5, PositionNoise=1e-5, VelocityNoise=1e-2, AccelerationNoise=1,
            DropOut=0.1, GhostFraction=0.02, MinimumTrackLength=3, WakeDepletion=0.1, WakeLength=3, Seed=9, AddTruth=1)
        tracks = simple.SyntheticTracks(Flow="ABC flow", **settings)
        tracks.UpdatePipeline(5.006)
        inside = tracks.SMProxy.GetClientSideObject()
        self.assertEqual(inside.GetFlow(), vtkSyntheticTracks.ABC)
        self.assertEqual(sorted([*settings, "Flow", "TimestepValues"]), sorted(tracks.ListProperties()))
        for name, value in settings.items():
            np.testing.assert_allclose(getattr(inside, "Get" + name)(), value, err_msg=name)
        _, arrays = fetch(tracks)
        for name in ("TrueVelocity", "TrueAcceleration", "TruePressure", "TrueTracerId"):
            self.assertIn(name, arrays)
        real = arrays["TrueTracerId"] >= 0
        self.assertAlmostEqual(np.std((arrays["Velocity"] - arrays["TrueVelocity"])[real]), 1e-2, delta=2e-3)

    def test_all_flows(self):
        for flow in simple.SyntheticTracks().GetProperty("Flow").GetAvailable():
            tracks = simple.SyntheticTracks(Flow=flow, Density=5e7)
            tracks.UpdatePipeline(0.02)
            data, _ = fetch(tracks)
            self.assertAlmostEqual(data.GetNumberOfPoints() / (5e7 * 6e-5), 1, delta=0.1)
            self.assertEqual(data.GetFieldData().HasArray("TrueCentre"), "Taylor" not in flow and "ABC" not in flow)

    def test_wrapped_class(self):
        tracks = vtkSyntheticTracks()
        tracks.SetFlow(vtkSyntheticTracks.TAYLOR_GREEN)
        tracks.Update()
        self.assertAlmostEqual(tracks.GetOutput().GetNumberOfPoints(), 24000, delta=800)


if __name__ == "__main__":
    rimflow_testing.main()
