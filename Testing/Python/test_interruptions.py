"""Breaks when a run that was killed (kill -9 of any rank, at a random moment) and resumed is not complete, or differs from one that was
never interrupted; when two ranks give other numbers than one; or when files that cannot be written stop more than themselves.
RIMFLOW_KILLS: how many moments (default 3). Run by python3; it starts pvbatch itself."""
import json
import os
import random
import shutil
import signal
import subprocess
import tempfile
import time
import unittest

TRACKS = os.path.join(os.environ["RIMFLOW_SOURCE"], "Examples", "demo", "sphere.dat.gz")
SCRIPT = os.path.join(os.environ["PYTHONPATH"].split(":")[0], "rimflow", "process.py")
SETTINGS = ["--diameter", "9.53mm", "--viscosity", "2.3825e-5", "--spacing", "2.5mm", "--fields", "vti"]
TIMES = {"seconds", "started", "timings", "memory_peak_MB", "seconds_per_snapshot", "ranks", "ElapsedTime"}  # what may differ


# no file above 180 kB, as if the disk were full for the larger ones: the fields, and some of the pictures
FULL = """
import resource, signal
from rimflow import pipeline, process
prepared = process.Run.prepare_folder

def then_full(run):
    prepared(run)
    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (180000, 180000))

process.Run.prepare_folder = then_full
pipeline.run(process.main)
"""


def command(out, ranks, *arguments, script=SCRIPT):
    run = ["pvbatch"] if ranks == 1 else ["mpirun", "--oversubscribe", "-np", str(ranks), "pvbatch", "--sym"]
    return [*run, script, TRACKS, "--out", out, *SETTINGS, *arguments]


def ranks_of(mpirun):
    """Process ids of pvbatch below an mpirun."""
    listing = subprocess.run(["ps", "--ppid", str(mpirun), "-o", "pid=,comm="], capture_output=True, text=True).stdout
    return [int(line.split()[0]) for line in listing.splitlines() if "pvbatch" in line]


def plain(value):
    """Without times."""
    if isinstance(value, dict):
        return {k: plain(v) for k, v in value.items() if k not in TIMES}
    return [plain(v) for v in value] if isinstance(value, list) else value


def content(folder):
    """Every file below the folder: tables, fields and pictures to the bit, JSON without times; of the page only that it is there."""
    found = {}
    for parent, _, names in os.walk(folder):
        for name in names:
            path = os.path.join(parent, name)
            with open(path, "rb") as f:
                data = f.read()
            data = plain(json.loads(data)) if name.endswith(".json") else len(data) > 0 if name.endswith(".html") else data
            found[os.path.relpath(path, folder)] = data
    return found


class TestInterruptions(unittest.TestCase):
    def setUp(self):
        self.folder = tempfile.mkdtemp(prefix="rimflow-test-")
        self.addCleanup(shutil.rmtree, self.folder)
        self.environment = {**os.environ, "OMP_NUM_THREADS": "1"}

    def finished(self, name, *arguments, ranks=2):
        result = subprocess.run(command(os.path.join(self.folder, name), ranks, *arguments), capture_output=True, text=True, timeout=600,
                                env=self.environment)
        self.assertEqual(result.returncode, 0, result.stdout + result.stderr)
        return result

    def same(self, name, expected):
        found = content(os.path.join(self.folder, name))
        self.assertEqual(sorted(found), sorted(expected))
        self.assertEqual([path for path in expected if found[path] != expected[path]], [])

    def test_killed_and_resumed_is_as_never_interrupted(self):
        steps = ["--steps", "0:16:2"]
        start = time.monotonic()
        self.finished("whole", *steps)
        duration = time.monotonic() - start
        expected = content(os.path.join(self.folder, "whole"))
        self.assertEqual(sum(path.startswith("fields/") for path in expected), 8)
        self.finished("alone", *steps, ranks=1)
        self.same("alone", expected)
        for kill in range(int(os.environ.get("RIMFLOW_KILLS", 3))):
            moment = random.uniform(0.15, 0.98) * duration
            run = subprocess.Popen(command(os.path.join(self.folder, "killed"), 2, *steps), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
                                   env=self.environment)
            time.sleep(moment)
            ranks = ranks_of(run.pid)
            if ranks:
                os.kill(random.choice(ranks), signal.SIGKILL)
            status = run.wait(60)
            there = len(content(os.path.join(self.folder, "killed")))
            print(f"kill {kill + 1} after {moment:.1f} of {duration:.1f} s: exit {status}, {there} of {len(expected)} files", flush=True)
            with self.subTest(moment=moment, seconds=duration):
                self.finished("killed", *steps, "--resume")
                self.same("killed", expected)
            shutil.rmtree(os.path.join(self.folder, "killed"))

    def test_what_cannot_be_written_is_said_and_the_rest_is_done(self):
        script, out, steps = os.path.join(self.folder, "full.py"), os.path.join(self.folder, "full"), ["--steps", "4:8", "--spacing", "2mm"]
        with open(script, "w") as f:
            f.write(FULL)
        result = subprocess.run(command(out, 1, *steps, script=script), capture_output=True, text=True, timeout=600, env=self.environment)
        self.assertEqual(result.returncode, 1, result.stderr)
        self.assertNotIn("Traceback", result.stderr)
        self.assertIn("rimflow process: snapshot 4: ", result.stderr)
        self.assertIn("--resume", result.stderr)
        with open(os.path.join(out, "run.json"), encoding="utf-8") as f:
            run = json.load(f)
        self.assertEqual([k for k, _ in run["problems"]], [4, 5, 6, 7])
        self.assertIn("000004.vti", run["problems"][0][1])
        self.assertEqual(run["snapshots"]["with_forces"], 4)  # small enough
        self.assertEqual([path for path in content(out) if ".part" in path or path.startswith("fields/")], [])
        # as if the record of the sphere, too, could not have been written: then the path was another, and so was the flow
        os.remove(os.path.join(out, "snapshots", "000005.json"))
        spoilt = os.path.join(out, "snapshots", "000006.flow.json")
        with open(spoilt, encoding="utf-8") as f:
            record = json.load(f)
        with open(spoilt, "w", encoding="utf-8") as f:
            json.dump({**record, "failed": "", "sphere": "another", "forces": {**record["forces"], "drag_N": 1.0}}, f)
        self.finished("full", *steps, "--resume", ranks=1)
        self.finished("whole", *steps, ranks=1)
        self.same("full", content(os.path.join(self.folder, "whole")))


if __name__ == "__main__":
    unittest.main(verbosity=2)
