"""Breaks when `rimflow process` does not find the demo's sphere where it is, when two ranks or a resumed run give other numbers
than one run, or when bad input ends in anything but a clear message. Run by python3; it starts pvbatch itself."""
import csv
import gzip
import json
import math
import os
import shutil
import subprocess
import sys
import tempfile
import unittest

SOURCE = os.environ["RIMFLOW_SOURCE"]
TRACKS = os.path.join(SOURCE, "Examples", "demo", "sphere.dat.gz")
DIAMETER = 9.53e-3
# Examples/demo/README.md
CENTRE, TIME, VELOCITY = (1.7e-3, 0.0, -0.9e-3), 43.1395, [0.25 * e for e in (-0.0734415, 0.9876883, 0.1381234)]


def process(*arguments, ranks=1, tracks=(TRACKS,)):
    """Runs the command through the launcher's own script, without building again."""
    script = os.path.join(os.environ["PYTHONPATH"].split(":")[0], "rimflow", "process.py")
    run = ["pvbatch"] if ranks == 1 else ["mpirun", "--oversubscribe", "-np", str(ranks), "pvbatch", "--sym"]
    environment = {k: v for k, v in os.environ.items() if k != "PYTHONUNBUFFERED"}  # it would hide lines that are lost in a buffer
    return subprocess.run([*run, script, *tracks, *arguments], capture_output=True, text=True, timeout=500, env=environment)


def rows(folder, name="trajectory.csv"):
    with open(os.path.join(folder, name), newline="") as f:
        return [{k: float(v) for k, v in row.items()} for row in csv.DictReader(f)]


def error(row, prefix=""):
    truth = [c + v * (row["time_s"] - TIME) for c, v in zip(CENTRE, VELOCITY)]
    return math.dist(truth, [row[f"{prefix}{a}_m"] for a in "xyz"]) / DIAMETER


class TestProcess(unittest.TestCase):
    def setUp(self):
        self.folder = tempfile.mkdtemp(prefix="rimflow-test-")
        self.addCleanup(shutil.rmtree, self.folder)

    def out(self, name):
        return os.path.join(self.folder, name)

    def run_demo(self, name, *arguments, ranks=1):
        result = process("--out", self.out(name), "--diameter", "9.53mm", "--viscosity", "2.3825e-5", *arguments, ranks=ranks)
        self.assertEqual(result.returncode, 0, result.stderr)
        return result

    def test_finds_the_sphere_in_every_snapshot_of_the_demo(self):
        self.assertIn("16 snapshots: 16 found", self.run_demo("all").stdout)
        table = rows(self.out("all"))
        self.assertEqual([r["snapshot"] for r in table], list(range(16)))
        self.assertEqual({r["status"] for r in table}, {0})
        self.assertLess(max(error(r) for r in table), 0.03)
        self.assertLess(sum(error(r) for r in table) / 16, 0.01)
        self.assertLess(max(error(r, "raw_") for r in table), 0.03)
        speed = [math.hypot(r["u_m_s"], r["v_m_s"], r["w_m_s"]) for r in table]
        self.assertLess(max(abs(v - 0.25) for v in speed), 0.01)
        with open(self.out("all/run.json")) as f:
            self.assertEqual(json.load(f)["snapshots"]["found"], 16)
        for name in ("sphere.pvd", "trajectory.vtp", "report/index.html", "report/trajectory.png", "report/motion.png", "report/quality.png"):
            self.assertGreater(os.path.getsize(self.out(f"all/{name}")), 500, name)
        self.assertFalse(os.path.exists(self.out("all/fields.pvd")))

    def test_two_ranks_and_a_resumed_run_give_the_numbers_of_one(self):
        self.run_demo("one", "--steps", "2:8")
        self.assertIn("6 snapshots: 6 found", self.run_demo("two", "--steps", "2:8", ranks=2).stdout)
        shutil.copytree(self.out("one"), self.out("resumed"))
        for k in (3, 6):
            os.remove(self.out(f"resumed/snapshots/{k:06d}.json"))
        os.remove(self.out("resumed/trajectory.csv"))
        self.run_demo("resumed", "--steps", "2:8", "--resume")
        one = rows(self.out("one"))
        self.assertEqual([r["snapshot"] for r in one], list(range(2, 8)))
        # a snapshot's estimate depends on where the search began by the sampling error of its posterior, some hundredths of a
        # micrometre (its standard deviation is 30 um)
        for name in ("two", "resumed"):
            for a, b in zip(one, rows(self.out(name)), strict=True):
                for axis in "xyz":
                    # the chain that samples the path turns the last digits of the single estimates into a fraction of its sigma
                    self.assertAlmostEqual(a[f"{axis}_m"], b[f"{axis}_m"], delta=1e-5)
                    self.assertAlmostEqual(a[f"raw_{axis}_m"], b[f"raw_{axis}_m"], delta=2e-7)

    def test_goes_back_to_snapshots_lost_before_the_first_find(self):
        # in the first two snapshots every 16th particle: too few to find the sphere without a hint
        thin, zone, seen = self.out("thin.dat"), 0, 0
        with gzip.open(TRACKS, "rt", encoding="latin-1") as whole, open(thin, "w", encoding="latin-1") as part:
            for line in whole:
                zone += line.startswith("ZONE")
                if line[0] in "-.0123456789":
                    seen += 1
                    if zone <= 2 and seen % 16:
                        continue
                elif line.startswith("I="):
                    line = "J=1, K=1, ZONETYPE=Ordered\n"
                part.write(line)
        # with two ranks, the find is another's
        for name, steps, ranks in (("serial", "1:6", 1), ("parallel", "1:3", 2)):
            result = process("--out", self.out(name), "--diameter", "9.53mm", "--steps", steps, tracks=[thin], ranks=ranks)
            self.assertEqual(result.returncode, 0, result.stderr)
            table = rows(self.out(name))
            self.assertEqual({r["status"] for r in table}, {0})
            self.assertLess(max(error(r, "raw_") for r in table), 0.25)
            if name == "serial":  # together they are nearly as good as dense ones
                self.assertLess(max(error(r) for r in table), 0.01)
        # alone, such a snapshot is lost
        process("--out", self.out("alone"), "--diameter", "9.53mm", "--steps", "1:2", tracks=[thin])
        self.assertEqual([r["status"] for r in rows(self.out("alone"))], [2])

    def test_the_demo_with_fields_and_pictures(self):
        self.run_demo("fields", "--steps", "7:9", "--fields", "vti", "--spacing", "1.5mm", "--images")
        with open(self.out("fields/fields.pvd")) as f:
            self.assertEqual(f.read().count("<DataSet"), 2)
        for k in (7, 8):
            with open(self.out(f"fields/fields/{k:06d}.vti"), "rb") as f:
                head = f.read().decode("latin-1")
            for name in ("Velocity", "MaterialAcceleration", "Vorticity", "QCriterion", "Mask"):
                self.assertIn(f'Name="{name}"', head)
        for name in ("tracks", "slice", "vortices"):
            self.assertGreater(os.path.getsize(self.out(f"fields/report/{name}.png")), 20000, name)
        with open(self.out("fields/report/index.html")) as f:
            page = f.read()
        self.assertIn("vortices.png", page)
        self.assertIn("reconstruction.png", page)
        with open(self.out("fields/run.json")) as f:
            for quality in json.load(f)["reconstruction"]:
                self.assertGreater(quality["MisfitVelocity"], 0.5)
                self.assertLess(quality["MisfitAcceleration"], 6)  # without the wall's points
                self.assertLess(quality["DivergenceNorm"], 0.05)
                self.assertGreater(quality["Outliers"], 0)  # the demo has ghosts

    def test_the_published_method_runs_with_the_published_weights(self):
        self.run_demo("published", "--steps", "7:9", "--method", "published", "--spacing", "1mm")
        table = rows(self.out("published"))
        self.assertEqual({r["status"] for r in table}, {0})
        # its minimum is not the true centre; see Documentation/methods-locator.md
        self.assertLess(max(error(r, "raw_") for r in table), 0.6)
        self.assertGreater(max(error(r, "raw_") for r in table), 0.01)

    def test_bad_input_ends_in_a_message_and_writes_nothing(self):
        empty, text = self.out("empty.dat"), self.out("text.dat")
        open(empty, "w").close()
        with open(text, "w") as f:
            f.write("these are no tracks\n" * 20)
        for arguments, tracks, expected in (
                (["--diameter", "9.53"], [TRACKS], "has no unit"),
                (["--diameter", "0mm"], [TRACKS], "greater than zero"),
                (["--diameter", "9.53mm"], [self.out("missing.dat")], "cannot be found"),
                (["--diameter", "9.53mm", "--steps", "100:"], [TRACKS], "selects none of the 16"),
                (["--diameter", "9.53mm", "--steps", "a:b"], [TRACKS], "no slice"),
                (["--diameter", "9.53mm"], [empty], "empty.dat"),
                (["--diameter", "9.53mm"], [text], "text.dat")):
            result = process("--out", self.out("bad"), *arguments, tracks=tracks)
            self.assertNotEqual(result.returncode, 0, arguments)
            self.assertIn(expected, result.stderr, arguments)
            self.assertNotIn("Traceback", result.stderr)
            self.assertFalse(os.path.exists(self.out("bad")))

    def test_resume_refuses_other_settings(self):
        self.run_demo("run", "--steps", "7")
        result = process("--out", self.out("run"), "--diameter", "10mm", "--viscosity", "2.3825e-5", "--steps", "7", "--resume")
        self.assertEqual(result.returncode, 2)
        self.assertIn("diameter_m", result.stderr)


if __name__ == "__main__":
    unittest.main(verbosity=2)
