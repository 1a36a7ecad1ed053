"""Breaks when the STBTrackReader proxy, its properties, times or arrays cannot be used from pvpython, or when ParaView's own Open does not find it."""
import gzip
import os
import tempfile
import unittest

import numpy as np
from paraview import servermanager, simple
from rimflow.vtkRIMFlowReaders import vtkSTBTrackReader  # before GetClientSideObject, which else gives its base class
from vtkmodules.util.numpy_support import vtk_to_numpy

import rimflow_testing

DATA = os.path.join(os.environ["RIMFLOW_SOURCE"], "Testing", "Data", "davis")
ONE_FILE = os.path.join(DATA, "onefile_8zones_utf8.dat")
SERIES = [os.path.join(DATA, "latin1_14col", f"B0000{k}.dat") for k in range(1, 7)]
COUNTS = [7, 15, 19, 27, 35, 40, 43, 49]


def arrays(data):
    point_data = data.GetPointData()
    return {point_data.GetArrayName(i): vtk_to_numpy(point_data.GetArray(i)) for i in range(point_data.GetNumberOfArrays())}


class TestSTBTrackReader(unittest.TestCase):
    def check_particles(self, reader, snapshots):
        reader.UpdatePipelineInformation()
        times = list(reader.TimestepValues)
        np.testing.assert_allclose(times, 43.124719773 + 0.001 * np.arange(snapshots), atol=1e-9)
        for k in (snapshots - 1, 0, 3):
            reader.UpdatePipeline(times[k])
            data = servermanager.Fetch(reader)
            self.assertEqual(data.GetNumberOfPoints(), COUNTS[k])
            self.assertEqual(data.GetNumberOfVerts(), COUNTS[k])
            self.assertEqual(data.GetFieldData().GetArray("SnapshotIndex").GetValue(0), k)
            found = arrays(data)
            self.assertEqual(sorted(found), ["Absolute intensity", "Acceleration", "Intensity", "TrackId", "Velocity"])
            self.assertLess(np.abs(vtk_to_numpy(data.GetPoints().GetData())).max(), 0.1)
            self.assertEqual(found["TrackId"].dtype, np.int64)

    def test_one_file(self):
        self.check_particles(simple.STBTrackReader(FileNames=ONE_FILE), 8)

    def test_one_file_per_snapshot(self):
        self.check_particles(simple.STBTrackReader(FileNames=SERIES[::-1]), 6)

    def test_open_data_file_finds_the_reader_by_content(self):
        with tempfile.TemporaryDirectory() as folder:
            packed = os.path.join(folder, "tracks.dat.gz")
            with open(ONE_FILE, "rb") as plain, gzip.open(packed, "wb") as to:
                to.write(plain.read())
            for names, snapshots in ((ONE_FILE, 8), (SERIES, 6), (packed, 8)):
                reader = simple.OpenDataFile(names)
                self.assertEqual(reader.GetXMLName(), "STBTrackReader")
                self.check_particles(reader, snapshots)
            table = os.path.join(folder, "table.txt")
            with open(table, "w") as f:
                f.write("x,y,z\n1,2,3\n")
            self.assertEqual(vtkSTBTrackReader.CanReadFile(table), 0)
            self.assertEqual(vtkSTBTrackReader.CanReadFile(packed), 1)

    def test_open_data_file_takes_every_format_and_leaves_other_tables_alone(self):
        track = "TrackID,FrameID,WorldX,WorldY,WorldZ\n0,1,1.5,2,3\n0,2,1.5,2,3\n"
        files = {
            "LongTrackActive_9.csv": track,
            "ActiveLongTracks.txt": "0,1,1.5,2,3,0,2,1.5,2,3,",
            "smoothed_trajectories": "7\t1.5\t2\t3\t1.5\t1\t1\t1\t1\t1\t1.000\n7\t1.5\t2\t3\t1\t1\t1\t1\t1\t1\t2.000\n",
            "table.csv": "id;frame;x;y;z\n1;1;1.5;2;3\n1;2;1.5;2;3\n",
            "ptv_is.1": "1\n -1 -2 1.5 2 3\n",
        }
        with tempfile.TemporaryDirectory() as folder:
            for name, text in files.items():
                path = os.path.join(folder, name)
                with open(path, "w") as f:
                    f.write(text)
                self.assertEqual(vtkSTBTrackReader.CanReadFile(path), 1, name)
                reader = simple.STBTrackReader(FileNames=path, FramePeriod=0.5)
                reader.UpdatePipeline(0.5)
                self.assertEqual(list(reader.TimestepValues), [0.5] if name == "ptv_is.1" else [0.5, 1.0])
                data = servermanager.Fetch(reader)
                self.assertEqual(data.GetNumberOfPoints(), 1)
                self.assertAlmostEqual(data.GetPoint(0)[0], 0.0015)
                self.assertIn("TrackId", arrays(data))
                if not name.endswith((".csv", ".txt")):  # those are ParaView's own too, and its GUI asks
                    self.assertEqual(simple.OpenDataFile(path).GetXMLName(), "STBTrackReader")
            plain = os.path.join(folder, "plain.csv")
            with open(plain, "w") as f:
                f.write("a,b\n1,2\n")
            self.assertEqual(simple.OpenDataFile(plain).GetXMLName(), "CSVReader")

    def test_every_property_reaches_the_class(self):
        settings = dict(
            FramePeriod=0.5, TimeShift=2.0, ShiftTimeToZero=1, TrailLength=4, MinimumTrackLength=2, TrackIdRange=[3, 50], Stride=2, CacheSize=10,
            UseTimeRange=1, TimeRange=[2.0, 2.0065], TrackStatistics=1, PolynomialOrder=3, PolynomialWindow=7)
        reader = simple.STBTrackReader(
            FileNames=ONE_FILE, LengthUnit="um", OutputMode="Pathlines", EstimateVelocities="Always", **settings)
        reader.UpdatePipeline(2.006)
        inside = reader.SMProxy.GetClientSideObject()
        self.assertEqual(inside.GetLengthUnit(), vtkSTBTrackReader.MICROMETRE)
        self.assertEqual(inside.GetOutputMode(), vtkSTBTrackReader.PATHLINES)
        self.assertEqual(inside.GetEstimateVelocities(), vtkSTBTrackReader.ALWAYS)
        self.assertEqual(sorted([*settings, "EstimateVelocities", "FileNames", "LengthUnit", "OutputMode", "TimestepValues"]), sorted(reader.ListProperties()))
        for name, value in settings.items():
            np.testing.assert_allclose(getattr(inside, "Get" + name)(), value, err_msg=name)
        np.testing.assert_allclose(list(reader.TimestepValues), 2 + 0.001 * np.arange(7), atol=1e-9)
        data = servermanager.Fetch(reader)
        ids = arrays(data)["TrackId"]
        self.assertTrue(len(ids) and (ids % 2 == 0).all() and ids.min() >= 3 and ids.max() <= 50)
        self.assertGreater(data.GetNumberOfLines(), 0)
        self.assertEqual(data.GetCellData().GetArray("TrackId").GetNumberOfTuples(), data.GetNumberOfCells())

    def test_pathlines_after_a_jump(self):
        reader = simple.STBTrackReader(FileNames=ONE_FILE, OutputMode="Pathlines", TrailLength=3)
        reader.UpdatePipelineInformation()
        times = list(reader.TimestepValues)
        for k in (6, 1, 7):
            reader.UpdatePipeline(times[k])
            data = servermanager.Fetch(reader)
            self.assertEqual(data.GetNumberOfPoints(), sum(COUNTS[max(0, k - 2):k + 1]))
            time = arrays(data)["Time"]
            self.assertAlmostEqual(time.min(), times[max(0, k - 2)])
            self.assertAlmostEqual(time.max(), times[k])


if __name__ == "__main__":
    rimflow_testing.main()
