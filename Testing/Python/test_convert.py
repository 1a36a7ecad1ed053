"""Breaks when a series that `rimflow convert` wrote has another bit than its track files, when an interruption or a damaged snapshot costs
more than itself, or when `rimflow process` finds another sphere in the series than in the tracks. Run by pvpython; starts pvbatch itself."""
import contextlib
import glob
import io
import os
import re
import shutil
import signal
import subprocess
import tempfile
import time
import unittest

import rimflow_testing
from rimflow_testing import SOURCE, simple
from rimflow import convert
from vtkmodules.util.numpy_support import vtk_to_numpy

DEMO = os.path.join(SOURCE, "Examples", "demo", "sphere.dat.gz")
DAVIS = os.path.join(SOURCE, "Testing", "Data", "davis", "onefile_8zones_utf8.dat")
OPENLPT = sorted(glob.glob(os.path.join(SOURCE, "Testing", "Data", "openlpt", "*.csv")))


def command(name, *arguments):
    script = os.path.join(os.environ["PYTHONPATH"].split(":")[0], "rimflow", name + ".py")
    return ["pvbatch", script, *arguments]


def run(name, *arguments):
    return subprocess.run(command(name, *arguments), capture_output=True, text=True, timeout=300)


def arrays(attributes):
    """name -> (VTK type, components, bytes); of an array of text its values."""
    found = {}
    for i in range(attributes.GetNumberOfArrays()):
        a = attributes.GetAbstractArray(i)
        values = vtk_to_numpy(a).tobytes() if hasattr(a, "GetTuple1") else [a.GetValue(j) for j in range(a.GetNumberOfValues())]
        found[a.GetName()] = (a.GetDataTypeAsString(), a.GetNumberOfComponents(), values)
    return found


def everything(source, at):
    source.UpdatePipeline(at)
    data = source.GetClientSideObject().GetOutputDataObject(0)
    points = data.GetPoints()
    vertices = [vtk_to_numpy(a).tobytes() for a in (data.GetVerts().GetOffsetsArray(), data.GetVerts().GetConnectivityArray())]
    position = (points.GetData().GetDataTypeAsString(), vtk_to_numpy(points.GetData()).tobytes()) if points and points.GetNumberOfPoints() else None
    return {"points": position, "vertices": vertices if position else None, "data": arrays(data.GetPointData()), "field": arrays(data.GetFieldData()),
            "vectors": data.GetPointData().GetVectors() and data.GetPointData().GetVectors().GetName()}


def times(source):
    source.UpdatePipelineInformation()
    return list(source.TimestepValues)


class TestConvert(unittest.TestCase):
    def setUp(self):
        self.folder = tempfile.mkdtemp(prefix="rimflow-test-")
        self.addCleanup(shutil.rmtree, self.folder)
        self.addCleanup(simple.ResetSession)

    def out(self, *names):
        return os.path.join(self.folder, *names)

    def convert(self, *arguments, name="series.pvd", status=0):
        """What the command prints; in this process, which saves starting another."""
        text = io.StringIO()
        with contextlib.redirect_stderr(text), contextlib.redirect_stdout(text):
            returned = convert.main([*arguments, self.out(name)])
        self.assertEqual(returned, status, text.getvalue())
        return text.getvalue()

    def check_same(self, series, tracks, steps=slice(None), **settings):
        reader = simple.STBTrackReader(FileNames=tracks, **settings)
        expected, copy = times(reader)[steps], simple.PVDReader(FileName=series)
        self.assertGreater(len(expected), 0)
        self.assertEqual(times(copy), expected)
        for at in expected[::-1]:  # not the order of the file
            self.assertEqual(everything(copy, at), everything(reader, at))

    def test_every_array_is_the_same_to_the_bit(self):
        for tracks, settings, arguments in (([DAVIS], {}, ()), ([DEMO], {}, ()),
                                            (OPENLPT, {"FramePeriod": 1 / 3000}, ("--frame-period", repr(1 / 3000)))):
            name = os.path.basename(tracks[0]) + " & more.pvd"
            self.convert(*tracks, *arguments, name=name)
            self.check_same(self.out(name), tracks, **settings)

    def test_the_data_stand_behind_white_space_of_a_whole_buffer(self):
        # without it ParaView 5.11 cannot read the file with the expat of Debian's security updates
        self.convert(DEMO, "--steps", "0:2")
        for path in glob.glob(self.out("series", "*.vtp")):
            with open(path, "rb") as f:
                content = f.read()
            self.assertRegex(content, rb'<AppendedData encoding="raw">\s{4096,}_')
            self.assertIn(b'header_type="UInt64"', content[:200])
            self.assertNotIn(b"compressor", content[:200])

    def test_options_select_and_scale(self):
        self.convert(DEMO, "--steps", "1:12:5", "--stride", "7", "--min-length", "3")
        self.check_same(self.out("series.pvd"), [DEMO], slice(1, 12, 5), Stride=7, MinimumTrackLength=3)
        self.convert(DAVIS, "--length-unit", "m", name="metres.pvd")
        self.check_same(self.out("metres.pvd"), [DAVIS], LengthUnit="m")

    def test_a_killed_conversion_leaves_a_valid_list_and_goes_on(self):
        running = subprocess.Popen(command("convert", DEMO, self.out("series.pvd")), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        while running.poll() is None and len(glob.glob(self.out("series", "0*.vtp"))) < 3:
            time.sleep(0.005)
        running.send_signal(signal.SIGKILL)
        running.wait()
        self.check_list()
        kept = sorted(p for p in glob.glob(self.out("series", "??????.vtp")))[:-1]
        os.remove(kept.pop())
        with open(self.out("series", "000015.1.part.vtp"), "w"):
            pass
        before = [os.stat(p).st_mtime_ns for p in kept]
        self.convert(DEMO, "--resume")
        self.assertEqual([os.stat(p).st_mtime_ns for p in kept], before)
        self.assertEqual(glob.glob(self.out("series", "*.part*")), [])
        self.check_same(self.out("series.pvd"), [DEMO])

    def check_list(self):
        if os.path.exists(self.out("series.pvd")):
            with open(self.out("series.pvd"), encoding="utf-8") as f:
                text = f.read()
            self.assertTrue(text.endswith("</VTKFile>\n"))
            for name in re.findall('file="([^"]+)"', text):
                self.assertTrue(os.path.exists(self.out(name)), name)

    def test_an_interrupted_conversion_lists_what_it_has(self):
        running = subprocess.Popen(command("convert", DEMO, self.out("series.pvd")), stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        while running.poll() is None and len(glob.glob(self.out("series", "0*.vtp"))) < 3:
            time.sleep(0.005)
        running.send_signal(signal.SIGINT)
        message = running.communicate()[1]
        if running.returncode == 0:
            self.skipTest("it was done before the interruption")
        self.assertEqual(running.returncode, 130, message)
        self.assertIn("--resume", message)
        self.assertGreaterEqual(len(times(simple.PVDReader(FileName=self.out("series.pvd")))), 2)

    def test_a_damaged_snapshot_costs_only_itself(self):
        with open(DAVIS, encoding="latin-1") as f:
            zones = re.split("(?m)^(?=ZONE)", f.read())
        rows = zones[3].split("\n")
        rows[-3] = "1 2 three"
        with open(self.out("damaged.dat"), "w", encoding="latin-1") as f:
            f.write("".join([*zones[:3], "\n".join(rows), *zones[4:]]))
        result = self.convert(self.out("damaged.dat"), status=1)
        self.assertIn("1 of 8 snapshots could not be read", result)
        self.assertIn("snapshot 2: ", result)
        self.assertIn("three", result)
        self.assertIn("7 of 8 snapshots", result)
        self.assertEqual(len(times(simple.PVDReader(FileName=self.out("series.pvd")))), 7)

    def test_what_cannot_be_done_is_said_and_nothing_is_lost(self):
        for arguments, text in (((), "no track files"), ((self.out("none.dat"),), "cannot be found"), ((DEMO, "--steps", "99:"), "selects none"),
                                ((DEMO, "--stride", "0"), "whole number from 1"), ((SOURCE + "/README.md",), "README.md")):
            self.assertIn(text, self.convert(*arguments, status=2))
        self.assertIn("ends in .pvd", self.convert(DEMO, name="series.vtp", status=2))
        os.makedirs(self.out("series"))
        with open(self.out("series", "000001.vtp"), "w"):
            pass
        self.assertIn("holds something else", self.convert(DEMO, status=2))
        self.assertTrue(os.path.exists(self.out("series", "000001.vtp")))
        self.convert(DEMO, "--steps", "0:2", name="other.pvd")
        self.assertIn("other settings (stride)", self.convert(DEMO, "--steps", "0:2", "--stride", "2", "--resume", name="other.pvd", status=2))
        self.check_same(self.out("other.pvd"), [DEMO], slice(0, 2))
        self.convert(DEMO, "--steps", "3", name="other.pvd")
        self.check_same(self.out("other.pvd"), [DEMO], slice(3, 4))
        self.assertEqual([os.path.basename(p) for p in glob.glob(self.out("other", "*.vtp"))], ["000003.vtp"])

    def test_process_finds_the_same_sphere_in_the_series(self):
        self.convert(DEMO)
        tables = []
        for tracks, name in ((DEMO, "a"), (self.out("series.pvd"), "b")):
            result = run("process", tracks, "--out", self.out(name), "--diameter", "9.53mm", "--viscosity", "2.3825e-5", "--steps", "0:16:15",
                         "--no-forces")
            self.assertEqual(result.returncode, 0, result.stderr)
            with open(self.out(name, "trajectory.csv"), "rb") as f:
                tables.append(f.read())
        self.assertEqual(*tables)
        self.assertIn("must be the only file", self.convert(DEMO, self.out("series.pvd"), name="c.pvd", status=2))


if __name__ == "__main__":
    rimflow_testing.main()
