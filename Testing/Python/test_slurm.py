"""Breaks when the Slurm example does not run its experiment with all its tasks, does not go on after an interruption, or takes another
experiment than its array index says. `srun` is mpirun here. Run by python3; it starts pvbatch itself."""
import json
import os
import shutil
import subprocess
import tempfile
import unittest

SOURCE = os.environ["RIMFLOW_SOURCE"]
SRUN = '#!/bin/sh\n[ "$1" = --kill-on-bad-exit=1 ] && shift || exit 9\nexec mpirun --oversubscribe -np "$SLURM_NTASKS" "$@"\n'


class TestSlurm(unittest.TestCase):
    def setUp(self):
        self.folder = tempfile.mkdtemp(prefix="rimflow-test-")
        self.addCleanup(shutil.rmtree, self.folder)
        srun = os.path.join(self.folder, "srun")
        with open(srun, "w") as f:
            f.write(SRUN)
        os.chmod(srun, 0o755)

    def submit(self, task, *tracks):
        environment = {**os.environ, "PATH": self.folder + ":" + os.environ["PATH"], "RIMFLOW": os.environ["RIMFLOW_BUILD"], "SLURM_NTASKS": "2",
                       "SLURM_ARRAY_TASK_ID": str(task), "DIAMETER": "9.53mm", "SETTINGS": "--steps 6:9 --no-forces"}
        return subprocess.run(["bash", os.path.join(SOURCE, "Examples", "slurm", "process.sbatch"), *tracks], cwd=self.folder, env=environment,
                              capture_output=True, text=True, timeout=300)

    def test_runs_goes_on_and_takes_its_own_experiment(self):
        demo = os.path.join(SOURCE, "Examples", "demo", "sphere.dat.gz")
        for _ in range(2):
            done = self.submit(1, "missing.dat", demo)
            self.assertEqual(done.returncode, 0, done.stdout + done.stderr)
            self.assertIn("3 snapshots: 3 found", done.stdout)
            with open(os.path.join(self.folder, "results", "sphere", "run.json")) as f:
                self.assertEqual(json.load(f)["ranks"], 2)
            record = os.path.join(self.folder, "results", "sphere", "snapshots", "000006.json")
            first = os.stat(record).st_mtime_ns
        self.assertEqual(os.stat(record).st_mtime_ns, first)
        twice = self.submit(1, "elsewhere/sphere.dat", demo)
        self.assertEqual(twice.returncode, 1)
        self.assertIn("would share results/sphere", twice.stderr)
        none = self.submit(2, "missing.dat", demo)
        self.assertNotEqual(none.returncode, 0)
        self.assertIn("there are 2 track files", none.stderr)


if __name__ == "__main__":
    unittest.main(verbosity=2)
