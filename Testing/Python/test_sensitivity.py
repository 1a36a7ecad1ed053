"""Breaks when `rimflow sensitivity` leaves a study or a limit out of its table, when the baseline moves or a changed parameter does not
reach the locator, when jitter, drift or the choice of weights are not what they are defined as, or when bad input ends in anything but
a clear message."""
import csv
import json
import os
import shutil
import subprocess
import tempfile
import unittest

import numpy as np
import rimflow_testing
from rimflow import sensitivity

TRACKS = os.path.join(rimflow_testing.SOURCE, "Examples", "demo", "sphere.dat.gz")


def command(*arguments, tracks=TRACKS):
    script = os.path.join(os.environ["PYTHONPATH"].split(":")[0], "rimflow", "sensitivity.py")
    return subprocess.run(["pvbatch", script, tracks, *arguments], capture_output=True, text=True, timeout=500)


def table(folder, name):
    with open(os.path.join(folder, name), newline="") as f:
        return list(csv.DictReader(f))


def track(centre):
    n = len(centre)
    return sensitivity.Track(np.asarray(centre, float), np.ones((n, 6)), np.zeros(n), np.zeros(n), np.zeros((n, 3)), np.ones(n, int),
                             np.zeros(n, int), ["found"] * n)


class TestSensitivity(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        """One run on three snapshots for the tests of the tables."""
        cls.folder = tempfile.mkdtemp(prefix="rimflow-test-")
        cls.addClassCleanup(shutil.rmtree, cls.folder)
        cls.result = command("--out", cls.folder, "--diameter", "9.53mm", "--viscosity", "2.3825e-5", "--spacing", "1.5mm", "--steps", "4:13",
                          "--snapshots", "3", "--studies", "step,search,drop,calibration")

    def test_every_study_stands_in_the_table_with_its_limit(self):
        self.assertEqual(self.result.returncode, 0, self.result.stderr)
        self.assertIn("likelihood: ", self.result.stdout)
        rows = table(self.folder, "sensitivity.csv")
        self.assertEqual(list(rows[0]), sensitivity.COLUMNS)
        self.assertEqual({(r["method"], r["study"]) for r in rows},
                         {("likelihood", s) for s in ("baseline", "search", "drop", "stated uncertainty")} |
                         {("published", s) for s in ("baseline", "step", "search", "single criterion", "stated uncertainty")})
        for r in rows:
            self.assertEqual((r["snapshots"], r["found"]), ("3", "3"), r)
            if r["study"] == "baseline":
                self.assertEqual(float(r["max_shift_d"]), 0)
            else:
                self.assertIn(r["holds"], ("yes", "no"), r)
                self.assertTrue(r["limit_mean_d"] or r["limit_max_d"], r)
            if r["study"] in ("step", "drop"):
                self.assertGreater(float(r["mean_shift_d"]), 1e-6, r)
                self.assertLess(float(r["max_shift_d"]), 0.5, r)
        step = [r for r in rows if r["study"] == "step"]
        self.assertEqual({(r["published_mean_d"], r["published_max_d"]) for r in step}, {("0.005", "0.096")})
        self.assertEqual(len(step), 6)
        drop = [r for r in rows if r["study"] == "drop"]
        self.assertLess(max(float(r["mean_shift_d"]) for r in drop), 5 * float(drop[0]["expected_shift_d"]))

    def test_the_baseline_is_told_snapshot_by_snapshot(self):
        rows = [r for r in table(self.folder, "snapshots.csv") if r["method"] == "published"]
        self.assertEqual([r["snapshot"] for r in rows], ["4", "8", "12"])
        self.assertTrue(all(float(r["offset_velocity_d"]) >= 0 and float(r["gradient_norm_1_m"]) > 0 for r in rows))

    def test_the_weights_are_calibrated(self):
        rows = table(self.folder, "weights.csv")
        self.assertEqual(len(rows), len(sensitivity.WEIGHT_FACTORS) ** 2)
        chosen = [r for r in rows if r["chosen"] == "1"]
        self.assertEqual([r["retained"] for r in chosen], ["1"])
        published = [r for r in rows if (r["w1"], r["w2"]) == ("3.077", "4.415")]
        self.assertEqual([float(r["mean_shift_d"]) for r in published], [0])
        self.assertGreater(len({r["mean_shift_d"] for r in rows}), 10)
        with open(os.path.join(self.folder, "run.json")) as f:
            self.assertAlmostEqual(json.load(f)["chosen_weights"][0], float(chosen[0]["w1"]), places=4)

    def test_the_report_shows_everything(self):
        with open(os.path.join(self.folder, "report", "index.html")) as f:
            page = f.read()
        for name in ("shifts-likelihood", "shifts-published", "snapshots-likelihood", "snapshots-published", "weights"):
            self.assertIn(name + ".png", page)
            self.assertGreater(os.path.getsize(os.path.join(self.folder, "report", name + ".png")), 10000)

    def test_jitter_is_the_scatter_of_single_centres(self):
        random = np.random.default_rng(5)
        times = np.cumsum(random.uniform(0.5, 1.5, 4000))
        path = np.stack([np.sin(times), times, times ** 2], axis=1)  # the sphere's own motion
        scatter = random.normal(0, 0.02, path.shape)
        slow = 0.1 * times[:, None] / times[-1]
        self.assertAlmostEqual(sensitivity.jitter(times, track(path + scatter + slow), track(path), 1.0), 0.02, delta=0.001)
        self.assertAlmostEqual(sensitivity.jitter(times, track(path + slow), track(path), 1.0), 0, delta=1e-9)

    def test_drift_is_what_grows(self):
        random = np.random.default_rng(6)
        times = np.linspace(3, 4, 200)
        still = np.zeros((200, 3))
        scatter = random.normal(0, 0.01, still.shape)
        grown, sigma = sensitivity.drift(times, track(still + scatter), track(still), 1.0)
        self.assertLess(grown, 3 * sigma)
        grown, sigma = sensitivity.drift(times, track(scatter + np.outer(times, [0, 0.3, 0])), track(still), 1.0)
        self.assertAlmostEqual(grown, 0.3, delta=3 * sigma)
        self.assertLess(sigma, 0.01)

    def test_weights_are_chosen_in_a_steady_region_where_all_converge(self):
        steadiness = np.full((5, 5), 0.03)
        steadiness[2:5, 0:3] = 0.01   # a region ...
        steadiness[0, 4] = 0.002      # ... and a lucky spot
        converged = np.ones((5, 5))
        retained, chosen = sensitivity.choose_weights(converged, steadiness)
        self.assertEqual(chosen, (3, 0))
        self.assertFalse(retained[0, 4])
        self.assertTrue(retained[3, 1])
        converged[3:, :] = 0.9
        retained, chosen = sensitivity.choose_weights(converged, steadiness)
        self.assertFalse(retained[3:].any())
        self.assertEqual(chosen[0], 2)
        retained, chosen = sensitivity.choose_weights(0 * converged, steadiness)
        self.assertIsNone(chosen)
        self.assertFalse(retained.any())

    def test_bad_input_ends_in_a_message(self):
        for arguments, expected in ((["--diameter", "9.53"], "has no unit"), (["--diameter", "9.53mm", "--steps", "3:5"], "selects 2 of the 16"),
                                    (["--diameter", "9.53mm", "--studies", "step,weight"], "names weight; there are step"),
                                    (["--diameter", "9.53mm", "--snapshots", "2"], "from 3 on"),
                                    (["--diameter", "60mm", "--method", "likelihood", "--steps", "5:8"], "found in none of the 3")):
            result = command("--out", os.path.join(self.folder, "bad"), *arguments)
            self.assertNotEqual(result.returncode, 0, arguments)
            self.assertIn(expected, result.stderr, arguments)
            self.assertNotIn("Traceback", result.stderr)
            self.assertFalse(os.path.exists(os.path.join(self.folder, "bad")))
        self.assertIn("cannot be found", command("--out", self.folder, "--diameter", "9mm", tracks="missing.dat").stderr)


if __name__ == "__main__":
    rimflow_testing.main()
