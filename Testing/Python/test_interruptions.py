"""Breaks when a run that was killed (kill -9 of any rank, at a random moment) and resumed is not complete, or differs from one that was
never interrupted; when two ranks give other numbers than one; or when files that cannot be written stop more than themselves.
RIMFLOW_KILLS: how many moments (default 3). Run by python3; it starts pvbatch itself."""
import contextlib
import json
import os
import pathlib
import random
import shutil
import signal
import subprocess
import tempfile
import time
import unittest

from test_process import without_particles

TRACKS = os.path.join(os.environ["RIMFLOW_SOURCE"], "Examples", "demo", "sphere.dat.gz")
SCRIPT = os.path.join(os.environ["PYTHONPATH"].split(":")[0], "rimflow", "process.py")
SETTINGS = ["--diameter", "9.53mm", "--viscosity", "2.3825e-5", "--spacing", "2.5mm", "--fields", "vti"]
TIMES = {"seconds", "started", "timings", "memory_peak_MB", "seconds_per_snapshot", "ranks", "ElapsedTime"}  # what may differ


# blocks of which there are several in eight snapshots
SMALL = """
from rimflow import pipeline, process
process.BLOCK = 3
pipeline.run(process.main)
"""

# no file above 180 kB, as if the disk were full for the larger ones: the fields, and some of the pictures
FULL = """
import resource, signal
from rimflow import pipeline, process
locate = process.Run.locate

def when_full(run):
    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (180000, 180000))
    locate(run)

process.Run.locate = when_full
pipeline.run(process.main)
"""


def command(out, ranks, *arguments, script=SCRIPT, tracks=TRACKS):
    run = ["pvbatch"] if ranks == 1 else ["mpirun", "--oversubscribe", "-np", str(ranks), "pvbatch", "--sym"]
    return [*run, script, tracks, "--out", out, *SETTINGS, *arguments]


def ranks_of(mpirun):
    """Process ids of pvbatch below an mpirun; none when it has ended."""
    with contextlib.suppress(FileNotFoundError, ProcessLookupError):
        children = pathlib.Path(f"/proc/{mpirun}/task/{mpirun}/children").read_text().split()
        return [int(child) for child in children if "pvbatch" in pathlib.Path(f"/proc/{child}/comm").read_text()]
    return []


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

    def path(self, name):
        return os.path.join(self.folder, name)

    def script(self, name, text):
        with open(self.path(name), "w", encoding="utf-8") as f:
            f.write(text)
        return self.path(name)

    def finished(self, name, *arguments, ranks=2, **others):
        result = subprocess.run(command(self.path(name), ranks, *arguments, **others), capture_output=True, text=True, timeout=1500,
                                env=self.environment)
        self.assertEqual(result.returncode, 0, result.stdout + result.stderr)
        return result

    def same(self, name, expected):
        found = content(os.path.join(self.folder, name))
        self.assertEqual(sorted(found), sorted(expected))
        self.assertEqual([path for path in expected if found[path] != expected[path]], [])

    def test_killed_and_resumed_is_as_never_interrupted(self):
        # all through the third block too few particles to find the sphere without a hint from the second
        thin = without_particles(TRACKS, self.path("thin.dat"), lambda zone: 16 if zone in (13, 15) else 1)
        steps, how = ["--steps", "0:16:2"], {"script": self.script("small.py", SMALL), "tracks": thin}
        start = time.monotonic()
        self.finished("whole", *steps, **how)
        duration = time.monotonic() - start
        expected = content(self.path("whole"))
        self.assertEqual(sum(path.startswith("fields/") for path in expected), 8)
        self.assertEqual([k for k in range(0, 16, 2) if expected[f"snapshots/{k:06d}.json"].get("looked_again")], [12, 14])
        self.finished("alone", *steps, ranks=1, **how)
        self.same("alone", expected)
        killed = 0
        for kill in range(int(os.environ.get("RIMFLOW_KILLS", 3))):
            moment = random.uniform(0.15, 0.95) * duration
            run = subprocess.Popen(command(self.path("killed"), 2, *steps, **how), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
                                   env=self.environment)
            time.sleep(moment)
            ranks = ranks_of(run.pid)
            if ranks:
                os.kill(random.choice(ranks), signal.SIGKILL)
            status = run.wait(60)
            killed += status != 0
            there = len(content(self.path("killed"))) if os.path.exists(self.path("killed")) else 0
            print(f"kill {kill + 1} after {moment:.1f} of {duration:.1f} s: exit {status}, {there} of {len(expected)} files", flush=True)
            with self.subTest(moment=moment, seconds=duration):
                self.finished("killed", *steps, "--resume", **how)
                self.same("killed", expected)
            shutil.rmtree(self.path("killed"))
        self.assertGreater(killed, 0)

    def test_what_cannot_be_written_is_said_and_the_rest_is_done(self):
        script, out, steps = self.script("full.py", FULL), self.path("full"), ["--steps", "4:8", "--spacing", "2mm"]
        result = subprocess.run(command(out, 2, *steps, script=script), capture_output=True, text=True, timeout=1500, env=self.environment)
        self.assertEqual(result.returncode, 1, result.stderr)
        self.assertNotIn("Traceback", result.stderr)
        self.assertIn("rimflow process: snapshot 4: ", result.stderr)
        self.assertIn("--resume", result.stderr)
        with open(os.path.join(out, "run.json"), encoding="utf-8") as f:
            run = json.load(f)
        self.assertEqual([k for k, _ in run["problems"]], [4, 5, 6, 7])
        self.assertIn("000004.vti", run["problems"][0][1])
        self.assertTrue(any(text.startswith("snapshot 7: ") for text in run["unwritten"]))  # the second rank's
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
        self.same("full", content(self.path("whole")))

    def test_ranks_that_do_not_know_of_each_other_are_refused(self):
        result = subprocess.run(command(self.path("ranks"), 1, "--ranks", "3"), capture_output=True, text=True, timeout=100, env=self.environment)
        self.assertEqual(result.returncode, 2)
        self.assertIn("MPI started 1", result.stderr)
        self.assertFalse(os.path.exists(self.path("ranks")))


if __name__ == "__main__":
    unittest.main(verbosity=2)
