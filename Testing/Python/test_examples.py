"""Breaks when an example no longer runs as its first lines say, or does not find the demo's sphere. Run by python3."""
import csv
import os
import re
import subprocess
import tempfile
import unittest

SOURCE = os.environ["RIMFLOW_SOURCE"]
TRACKS = os.path.join(SOURCE, "Examples", "demo", "sphere.dat.gz")
# Examples/demo/README.md
CENTRE, TIME, VELOCITY = (1.7e-3, 0.0, -0.9e-3), 43.1395, [0.25 * e for e in (-0.0734415, 0.9876883, 0.1381234)]
FLUID, CD = ("1820", "2.3825e-5"), 1.09  # Re = 100

READ_PATH = """
import sys
from vtkmodules.vtkIOXML import vtkXMLPolyDataReader
reader = vtkXMLPolyDataReader()
reader.SetFileName(sys.argv[1])
reader.Update()
points = reader.GetOutput().GetPointData()
for k in range(reader.GetOutput().GetNumberOfPoints()):
    print(points.GetArray("Time").GetValue(k), int(points.GetArray("Status").GetTuple1(k)), *points.GetArray("Centre").GetTuple3(k),
          *points.GetArray("Velocity").GetTuple3(k))
"""


class TestExamples(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory(prefix="rimflow-examples-")
        self.addCleanup(folder.cleanup)
        self.folder = folder.name

    def run_example(self, *command):
        result = subprocess.run(command, cwd=self.folder, capture_output=True, text=True, timeout=1500)
        self.assertEqual(result.returncode, 0, result.stderr)
        self.assertNotIn("Traceback", result.stderr)
        self.assertNotIn("ERR|", result.stderr)
        return result.stdout

    def check_place(self, time, centre):
        for a in range(3):
            self.assertAlmostEqual(centre[a], CENTRE[a] + VELOCITY[a] * (time - TIME), delta=0.03 * 9.53e-3)

    def path(self):
        """The rows of trajectory.vtp: time, status, centre, velocity."""
        return [[float(v) for v in line.split()] for line in self.run_example(
            "pvpython", "-c", f"import sys; sys.argv = ['', 'trajectory.vtp']\n{READ_PATH}").splitlines() if line]

    def test_pvpython_locate_sphere(self):
        printed = self.run_example("pvpython", os.path.join(SOURCE, "Examples", "pvpython", "locate_sphere.py"), TRACKS, "0.00953")
        rows = re.findall(r"^([\d.]+) s: \((\S+), (\S+), (\S+)\) mm", printed, re.MULTILINE)
        self.assertEqual(len(rows), 16)
        for row in rows:
            self.check_place(float(row[0]), [1e-3 * float(v) for v in row[1:]])
        self.assertGreater(os.path.getsize(os.path.join(self.folder, "trajectory.vtp")), 1000)

    def test_pvpython_uncertainty(self):
        picture = os.path.join(self.folder, "uncertainty.png")
        self.run_example(os.path.join(SOURCE, "rimflow"), "with-display", "pvpython",
                         os.path.join(SOURCE, "Examples", "pvpython", "uncertainty.py"), TRACKS, "0.00953", picture)
        self.assertGreater(os.path.getsize(picture), 20000)

    def test_pvpython_pathlines(self):
        picture = os.path.join(self.folder, "pathlines.png")
        printed = self.run_example(os.path.join(SOURCE, "rimflow"), "with-display", "pvpython",
                                   os.path.join(SOURCE, "Examples", "pvpython", "pathlines.py"), "12", picture, TRACKS)
        self.assertRegex(printed, r"[1-9]\d{3} lines in 16 snapshots, the longest with 16 points")
        noise = dict(re.findall(r"(\w+Noise) (\S+?)(?:,|$)", printed, re.MULTILINE))
        self.assertAlmostEqual(float(noise["PositionNoise"]), 5e-6, delta=0.5e-6)
        self.assertAlmostEqual(float(noise["VelocityNoise"]), 0.01 * 0.25, delta=0.1 * 0.0025)
        self.assertGreater(os.path.getsize(picture), 50000)

    def test_pvpython_forces_of_known_path(self):
        # the true path, in other times than those of the tracks, and lost for a while
        with open(os.path.join(self.folder, "path.dat"), "w", encoding="ascii") as f:
            f.write('TITLE = "from another program"\nVARIABLES = "Time[ms]" "x" "y" "z"\nDIAMETER=0.953[cm]\nSOLID/FLUID DENSITY RATIO=0.65\n')
            for k in range(60):
                t = 43.1248 + 5e-4 * k
                place = [1e3 * (CENTRE[a] + VELOCITY[a] * (t - TIME)) for a in range(3)] if k not in (25, 26) else [float("nan")] * 3
                f.write(f"{1e3 * t:.4f}\t" + "\t".join(f"{v:.6f}" for v in place) + "\r\n")
        printed = self.run_example("pvpython", os.path.join(SOURCE, "Examples", "pvpython", "forces_of_known_path.py"), TRACKS, "path.dat", *FLUID, "16")
        row = re.search(r"^ *([\d.]+) +([\d.]+) \+- ([\d.]+) +([\d.]+) +([\d.]+) \+- ([\d.]+) +([\d.]+) +([\d.]+)", printed, re.MULTILINE)
        self.assertIsNotNone(row, printed)
        time, drag, sigma, lift, cd, cd_sigma, cl, momentum = map(float, row.groups())
        self.assertAlmostEqual(cd, CD, delta=0.12)
        self.assertAlmostEqual(momentum, CD, delta=0.06)
        self.assertLess(cl, 0.06)

    def test_pvpython_forces(self):
        picture = os.path.join(self.folder, "forces.png")
        printed = self.run_example(os.path.join(SOURCE, "rimflow"), "with-display", "pvpython",
                                   os.path.join(SOURCE, "Examples", "pvpython", "forces.py"), TRACKS, "0.00953", *FLUID, picture, "16")
        row = re.search(r"^ *([\d.]+) +([\d.]+) \+- ([\d.]+) +([\d.]+) +([\d.]+) \+- ([\d.]+) +([\d.]+) +([\d.]+) +100%", printed, re.MULTILINE)
        self.assertIsNotNone(row, printed)
        time, drag, sigma, lift, cd, cd_sigma, cl, momentum = map(float, row.groups())
        self.assertAlmostEqual(cd, CD, delta=0.12)
        self.assertAlmostEqual(momentum, CD, delta=0.06)
        self.assertLess(cl, 0.06)
        self.assertAlmostEqual(1e-3 * drag, cd * 1820 / 2 * 0.25**2 * 3.14159 / 4 * 0.00953**2, delta=1e-4)
        self.assertGreater(os.path.getsize(picture), 20000)

    def test_pvpython_flow_fields(self):
        picture = os.path.join(self.folder, "flow.png")
        printed = self.run_example(os.path.join(SOURCE, "rimflow"), "with-display", "pvpython",
                                   os.path.join(SOURCE, "Examples", "pvpython", "flow_fields.py"), TRACKS, "0.00953", *FLUID, picture)
        value = {name: float(number) for name, number in re.findall(r"^(.+): (\S+)", printed, re.MULTILINE)}
        self.assertAlmostEqual(value["noise of the velocities, m/s"], 0.01 * 0.25, delta=0.1 * 0.0025)
        self.assertLess(abs(value["misfit of the velocities, noise levels"] - 1), 0.3)
        self.assertLess(value["pressure gradient that no pressure explains"], 25)
        self.assertGreater(os.path.getsize(picture), 50000)

    def test_pvpython_path_as_file(self):
        printed = self.run_example("pvpython", os.path.join(SOURCE, "Examples", "pvpython", "path_as_file.py"), TRACKS, "0.00953", "path.png", "path.dat")
        single, sigma, apart = map(float, re.search(r"single ones are (\S+) um .* is (\S+) um\n.* differs by (\S+) nm", printed).groups())
        self.assertLess(sigma, single)
        self.assertLess(apart, 0.01)
        self.assertGreater(os.path.getsize(os.path.join(self.folder, "path.png")), 20000)
        with open(os.path.join(self.folder, "path.dat"), encoding="ascii") as f:
            self.assertIn("DIAMETER=9.53[mm]", f.read())

    def test_pvpython_known_answer(self):
        picture = os.path.join(self.folder, "known.png")
        printed = self.run_example(os.path.join(SOURCE, "rimflow"), "with-display", "pvpython",
                                   os.path.join(SOURCE, "Examples", "pvpython", "known_answer.py"), picture)
        rows = re.findall(r"^\S+ s: (\S+) um from the truth \((\S+) % of d\), stated (\S+) um", printed, re.MULTILINE)
        self.assertEqual(len(rows), 12)
        for distance, percent, stated in rows:
            self.assertLess(float(distance), 4 * float(stated))
            self.assertAlmostEqual(1e-6 * float(distance), 0.01 * float(percent) * 0.01111, delta=1e-6)
            self.assertLess(float(percent), 2)
        self.assertGreater(os.path.getsize(picture), 50000)

    def test_every_example_has_a_line_in_the_index(self):
        with open(os.path.join(SOURCE, "Examples", "README.md"), encoding="utf-8") as f:
            index = f.read()
        with open(__file__, encoding="utf-8") as f:
            tests = f.read()
        for folder, _, names in os.walk(os.path.join(SOURCE, "Examples")):
            for name in names:
                path = os.path.relpath(os.path.join(folder, name), os.path.join(SOURCE, "Examples"))
                if name.endswith((".py", ".cxx", ".sbatch")):
                    self.assertIn(f"({path})", index)
                if path.startswith("pv"):
                    self.assertIn(f'"{name}"', tests, "it is not run here")

    def test_pvbatch_forces_in_parallel(self):
        script = os.path.join(SOURCE, "Examples", "pvbatch", "forces_in_parallel.py")
        tables = []
        for ranks in (1, 2):
            self.run_example("mpirun", "--oversubscribe", "-np", str(ranks), "pvbatch", "--sym", script, TRACKS, "0.00953", *FLUID, "forces.csv", "8")
            with open(os.path.join(self.folder, "forces.csv"), newline="") as file:
                tables.append(list(csv.DictReader(file)))
            self.assertEqual(len(tables[-1]), 2)
            for row in tables[-1]:
                self.assertAlmostEqual(float(row["Cd"]), CD, delta=0.12)
        for one, two in zip(*tables):
            self.assertEqual(one["Time"], two["Time"])
            self.assertAlmostEqual(float(one["drag_N"]), float(two["drag_N"]), delta=0.01 * float(one["drag_N"]))

    def test_pvbatch_locate_in_parallel(self):
        script = os.path.join(SOURCE, "Examples", "pvbatch", "locate_in_parallel.py")
        for ranks in (1, 3):
            self.run_example("mpirun", "--oversubscribe", "-np", str(ranks), "pvbatch", "--sym", script, TRACKS, "0.00953", "trajectory.vtp")
            rows = self.path()
            self.assertEqual(len(rows), 16)
            self.assertEqual([r[0] for r in rows], sorted(r[0] for r in rows))
            for time, status, *state in rows:
                self.assertEqual(status, 0)
                self.check_place(time, state[:3])
                for a in range(3):
                    self.assertAlmostEqual(state[3 + a], VELOCITY[a], delta=0.01)
            os.remove(os.path.join(self.folder, "trajectory.vtp"))


if __name__ == "__main__":
    unittest.main(verbosity=2)
