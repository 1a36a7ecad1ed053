"""Breaks when a sphere's trajectory from a file is another Body than the same numbers given by hand, when File > Open or Save Data do not
know the format, or when a path that is saved and read again is another one."""
import math
import os
import shutil
import tempfile
import unittest

from paraview import simple
from vtkmodules.util.numpy_support import vtk_to_numpy
from vtkmodules.vtkCommonDataModel import vtkPolyData

import rimflow_testing
from rimflow import pipeline
from rimflow.vtkRIMFlowFilters import vtkOmni3DPressure, vtkSurfaceForce, vtkVICSharpResample
from rimflow.vtkRIMFlowReaders import vtkSphereTrajectoryReader, vtkSyntheticTracks

import numpy as np

DIAMETER = 0.01111


def true_path(reader):
    """Times, centres and velocity of the synthetic sphere."""
    reader.UpdateInformation()
    times = reader.GetOutputInformation(0).Get(pipeline.vtkStreamingDemandDrivenPipeline.TIME_STEPS())
    centres = []
    for time in times:
        reader.UpdateTimeStep(time)
        field = reader.GetOutput().GetFieldData()
        centres.append(field.GetArray("TrueCentre").GetTuple3(0))
    return list(times), centres


def write(path, times, centres, header=""):
    with open(path, "w", encoding="ascii") as f:
        f.write(f'TITLE = "test"\nVARIABLES = "Time" "x" "y" "z"\nDIAMETER={1e3 * DIAMETER!r}[mm]\n{header}')
        for time, centre in zip(times, centres):
            f.write(f"{time!r} " + " ".join(repr(1e3 * float(c)) for c in centre) + "\n")


def arrays(data):
    return {name: vtk_to_numpy(data.GetArray(name)) for name in (data.GetArrayName(i) for i in range(data.GetNumberOfArrays())) if data.GetArray(name)}


class TestSphereTrajectory(unittest.TestCase):
    def setUp(self):
        self.folder = tempfile.mkdtemp(prefix="rimflow-test-")
        self.addCleanup(shutil.rmtree, self.folder)

    def file(self, name):
        return os.path.join(self.folder, name)

    def test_is_the_same_body_as_one_made_by_hand(self):
        tracks = vtkSyntheticTracks()
        tracks.SetDensity(4e7)
        tracks.SetNumberOfSnapshots(6)
        times, centres = true_path(tracks)
        write(self.file("sphere.dat"), times, centres)
        reader = vtkSphereTrajectoryReader()
        reader.SetFileName(self.file("sphere.dat"))
        reader.UpdateTimeStep(times[3])
        motion = arrays(reader.GetOutput().GetFieldData())
        hand = vtkPolyData()
        for name, value in (("Diameter", [DIAMETER]), ("Centre", [centres[3]]), ("Velocity", [[0.0, 0.35, 0.0]]), ("Acceleration", [[0.0, 0.0, 0.0]])):
            pipeline.add_array(hand.GetFieldData(), name, np.array(value))
            np.testing.assert_allclose(motion[name], value, rtol=1e-12, atol=1e-5 if name == "Acceleration" else 1e-8)
        results = []
        for body in ("file", "hand"):
            flow, pressure, force = vtkVICSharpResample(), vtkOmni3DPressure(), vtkSurfaceForce()
            flow.SetInputConnection(0, tracks.GetOutputPort())
            flow.SetMaximumIterations(5)
            flow.SetSpacing(0.0015)
            pressure.SetInputConnection(0, flow.GetOutputPort())
            force.SetInputConnection(0, pressure.GetOutputPort())
            for step in (flow, pressure, force):
                if body == "file":
                    step.SetInputConnection(1, reader.GetOutputPort(0))
                else:
                    step.SetInputDataObject(1, hand)
            force.UpdateTimeStep(times[3])
            results.append((arrays(flow.GetOutput().GetPointData()), pipeline.force_row(force.GetOutputDataObject(1))[0]))
        (fields, numbers), (fields_by_hand, numbers_by_hand) = results
        self.assertGreater(fields["Mask"].sum(), 100)
        np.testing.assert_array_equal(fields["Mask"], fields_by_hand["Mask"])
        np.testing.assert_allclose(fields["Velocity"], fields_by_hand["Velocity"], atol=1e-6)
        names = [f"{force}_{axis}_N" for force in ("Fp", "Fv", "Fcv") for axis in "xyz"] + ["drag_N", "lift_N"]
        size = max(abs(numbers_by_hand[name]) for name in names)
        self.assertGreater(size, 0)
        for name in names:
            self.assertAlmostEqual(numbers[name], numbers_by_hand[name], delta=1e-4 * size, msg=name)

    def test_what_is_saved_reads_back_the_same(self):
        tracks = simple.SyntheticTracks(Density=8e7, NumberOfSnapshots=8, PositionNoise=5e-6, Seed=3)
        locator = simple.InvisibleSphereLocator(Particles=tracks, Diameter=DIAMETER, ProcessAllTimes=1)
        locator.UpdatePipeline(tracks.TimestepValues[2])
        self.save_and_compare(simple.OutputPort(locator, 2), 8)
        smoother = simple.TrajectorySmoother(Input=simple.OutputPort(locator, 2))
        smoother.UpdatePipeline(tracks.TimestepValues[2])
        self.save_and_compare(smoother, 8)

    def save_and_compare(self, trajectory, rows):
        path = self.file("saved.dat")
        simple.SaveData(path, proxy=trajectory, DensityRatio=0.65)
        with open(path, encoding="ascii") as f:
            self.assertIn("SOLID/FLUID DENSITY RATIO=0.65", f.read())
        again = simple.OpenDataFile(path)
        self.assertEqual(again.GetXMLName(), "SphereTrajectoryReader")
        again.UpdatePipeline()
        port = getattr(trajectory, "Port", 0)
        saved, read = simple.servermanager.Fetch(trajectory, idx=port), simple.servermanager.Fetch(again, idx=2)
        self.assertEqual(read.GetNumberOfPoints(), rows)
        self.assertEqual(read.GetCell(0).GetNumberOfPoints(), rows)
        one, two = arrays(saved.GetPointData()), arrays(read.GetPointData())
        order = np.argsort(one["Time"])
        np.testing.assert_array_equal(one["Time"][order], two["Time"])
        np.testing.assert_allclose(one["Centre"][order], two["Centre"], atol=1e-11)
        np.testing.assert_allclose(two["Diameter"], DIAMETER, rtol=1e-14)
        self.assertEqual(read.GetFieldData().GetArray("DensityRatio").GetValue(0), 0.65)
        self.assertEqual(list(again.TimestepValues), list(two["Time"]))
        # what was read is saved as the same text
        simple.SaveData(self.file("again.dat"), proxy=simple.OutputPort(again, 2))
        with open(path, encoding="ascii") as f, open(self.file("again.dat"), encoding="ascii") as g:
            self.assertEqual(f.read(), g.read())

    def test_lost_rows_are_saved_as_nan(self):
        times = [43 + 1e-3 * k for k in range(60)]
        nowhere = [math.nan] * 3
        centres = [nowhere if 20 <= k < 40 else (0.001, 0.2 * (t - 43), 0) for k, t in enumerate(times)]
        write(self.file("sphere.dat"), times, centres, "SOLID/FLUID DENSITY RATIO=0.5\n")
        reader = simple.SphereTrajectoryReader(FileName=self.file("sphere.dat"))
        self.assertEqual(list(reader.TimestepValues), times)
        simple.SaveData(self.file("saved.dat"), proxy=simple.OutputPort(reader, 2))
        with open(self.file("saved.dat"), encoding="ascii") as f:
            lines = f.read().splitlines()
        self.assertEqual(lines[3], "SOLID/FLUID DENSITY RATIO=0.5")
        self.assertEqual([float(line.split()[0]) for line in lines[4:]], times)
        for k in (19, 20, 30, 39, 40):
            self.assertEqual("NaN" in lines[4 + k], 20 <= k < 40)

    def test_the_window_opens_each_file_with_its_reader(self):
        write(self.file("sphere.dat"), [0.1, 0.2], [(0, 0, 0), (0, 0.01, 0)])
        self.assertEqual(simple.OpenDataFile(self.file("sphere.dat")).GetXMLName(), "SphereTrajectoryReader")
        davis = os.path.join(rimflow_testing.SOURCE, "Testing", "Data", "davis")
        name = next(n for n in sorted(os.listdir(davis)) if n.endswith(".dat"))
        self.assertEqual(simple.OpenDataFile(os.path.join(davis, name)).GetXMLName(), "STBTrackReader")

    def test_looks_right_at_first_sight(self):
        times = [43 + 1e-3 * k for k in range(30)]
        write(self.file("sphere.dat"), times, [(0.001, 0.2 * (t - 43), 0) for t in times])
        reader = simple.SphereTrajectoryReader(FileName=self.file("sphere.dat"))
        reader.UpdatePipeline(times[10])
        info = reader.GetDataInformation()
        np.testing.assert_allclose(np.diff(info.GetBounds())[::2], 0.01111, rtol=0.01)
        self.assertIsNotNone(reader.PointData["Normals"])
        self.assertEqual(simple.servermanager.Fetch(reader, idx=1).GetNumberOfPoints(), 1)


if __name__ == "__main__":
    rimflow_testing.main()
