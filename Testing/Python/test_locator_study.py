"""Breaks when the locator's benchmark (Testing/Benchmarks/locator_study) judges by a wrong truth or wrong statistics, or makes no page of its
rows; or when the void likelihood is far off, or states a far too small or large uncertainty, on clouds and on the CFD tracks."""
import os
import subprocess
import sys
import tempfile
import unittest

import numpy as np

import rimflow_testing

sys.path[:0] = [os.path.join(rimflow_testing.SOURCE, "Testing", "Benchmarks", folder) for folder in ("locator_study", "common")]

import clouds
import locate
import page
import studies
import tables


def case_of(study, value, frames=20, **wanted):
    return next(c for c in studies.all_cases(frames, 1) if c.study == study and c.value == value and all(getattr(c, k) == v for k, v in wanted.items()))


class TestClouds(unittest.TestCase):
    def test_tracers_lie_where_the_case_says(self):
        cloud = clouds.Cloud(noise=0, ghosts=0.02, wake_depth=0.95, wake_width=0.8, edge=(0.5,))
        s = clouds.poisson_snapshot(cloud, "test", 3)
        radius = cloud.diameter / 2
        self.assertAlmostEqual(s.centre[0], 0.5 * cloud.box[0] - 0.5 * radius)
        r = np.linalg.norm(s.x - s.centre, axis=1)
        cut = np.pi * (2 * radius / 3 + radius / 2 - (radius / 2) ** 3 / (3 * radius**2)) * radius**2  # of the ball, inside the face
        self.assertAlmostEqual((r < radius).sum(), 0.02 * cut * cloud.density, delta=4 * np.sqrt(0.02 * cut * cloud.density))
        below = (r > radius) & (s.x[:, 1] < s.centre[1] - radius) & (np.hypot(s.x[:, 0] - s.centre[0], s.x[:, 2] - s.centre[2]) < 0.2 * radius)
        above = (r > radius) & (s.x[:, 1] > s.centre[1] + radius) & (np.hypot(s.x[:, 0] - s.centre[0], s.x[:, 2] - s.centre[2]) < 0.2 * radius)
        self.assertGreater(above.sum(), 3 * below.sum() + 3)
        np.testing.assert_array_equal(s.x, clouds.poisson_snapshot(cloud, "test", 3).x)

    def test_stokes_tracks_leave_the_ball_free(self):
        s = clouds.stokes_snapshot(clouds.Cloud(noise=0, ghosts=0), "test", 1)
        r = np.linalg.norm(s.x - s.centre, axis=1)
        self.assertGreater(r.min(), 0.499 * clouds.Cloud().diameter)
        self.assertLess(r.min(), 0.55 * clouds.Cloud().diameter)
        near = s.velocity[r < 0.52 * clouds.Cloud().diameter]
        np.testing.assert_allclose(near.mean(0), clouds.SPEED, atol=0.05)


class TestStatistics(unittest.TestCase):
    def test_gaussian_errors_are_covered_as_stated(self):
        random, covariance = np.random.default_rng(1), np.diag([1e-8, 4e-8, 9e-8])
        truth, records = np.array([1e-3, 2e-3, 3e-3]), []
        for _ in range(2000):
            found = locate.Estimate(truth + random.multivariate_normal(np.zeros(3), covariance), covariance)
            records.append(studies.record("single", [found], truth, 0.01, blind=False))
        row = studies.row(case_of("noise", 0, tracks="cloud"), records)
        self.assertAlmostEqual(float(row["chi2_per_dof"]), 1, delta=0.06)
        self.assertAlmostEqual(float(row["within68"]), 0.68, delta=0.04)
        self.assertAlmostEqual(float(row["within95"]), 0.95, delta=0.02)
        self.assertAlmostEqual(float(row["stated_mean"]), np.sqrt(14e-8) / 0.01, delta=1e-5)

    def test_wrong_lost_and_false_finds_are_told_apart(self):
        covariance, truth = 1e-8 * np.eye(3), np.zeros(3)
        near, far = locate.Estimate(np.array([1e-4, 0, 0]), covariance), locate.Estimate(np.array([0, 0, 9e-3]), covariance)
        records = [studies.record("single", found, truth, 0.01, blind=True) for found in ([near], [near, far], [far], [])]
        row = studies.row(case_of("noise", 0, tracks="cloud"), records)
        self.assertEqual([row[k] for k in ("snapshots", "found", "wrong", "extra", "blind", "blind_found")], [4, 2, 1, 1, 4, 2])
        self.assertEqual(studies.record("single", [near], None, 0.01)["extra"], 1)


class TestStudy(unittest.TestCase):
    def measured(self, case, *arguments):
        return studies.rows(case, studies.RUNS[case.tracks](case, *arguments))

    def test_rows_make_a_page(self):
        base = self.measured(case_of("noise", 5, tracks="cloud"), 10, 22)
        self.assertEqual(base[0]["found"], 12)
        self.assertLess(float(base[0]["mean_error"]), 0.006)  # measured 0.003
        self.assertGreater(float(base[0]["chi2_per_dof"]), 0.3)
        self.assertLess(float(base[0]["chi2_per_dof"]), 2.5)
        none = self.measured(next(c for c in studies.all_cases(2, 1) if c.label == "elliptic beam"), 0, 2)
        self.assertEqual((none[0]["found"], none[0]["extra"]), (0, 0))
        cfd = self.measured(case_of("part of the tracks", 1, method=locate.VOID), 0)
        self.assertEqual([r["estimate"] for r in cfd], ["single", "smoothed", "velocity"])
        self.assertEqual({r["found"] for r in cfd}, {16})
        self.assertLess(float(cfd[1]["mean_error"]), 0.006)
        self.assertLess(float(cfd[2]["mean_error"]), 0.03)
        published = self.measured(case_of("diameter", 9.53, method=locate.PUBLISHED), 0, 1)
        self.assertEqual(published[0]["found"], 1)
        self.assertGreater(float(published[0]["grid_spacing_m"]), 1e-4)
        with tempfile.TemporaryDirectory() as folder:
            path = os.path.join(folder, "results.csv")
            seeding = [{**base[0], "study": "seeding", "value": "0.4"}]
            tables.write_rows(path, studies.COLUMNS, base + seeding + none + cfd + published)
            made = page.write(folder, tables.read_rows(path))
            self.assertEqual(set(made), {"single", "both", "none", "paper", "weak"})
            self.assertIn("| elliptic beam | 2 | 0 |", made["none"])
            self.assertGreater(os.path.getsize(os.path.join(folder, "coverage.png")), 5000)
        with open(os.path.join(rimflow_testing.SOURCE, "Documentation", "validation-locator.md"), encoding="utf-8") as f:
            text = f.read()
        for name in page.MADE:
            self.assertEqual(text.count(f"<!-- table:{name} -->"), 1, name)

    def test_a_part_of_the_run_replaces_only_its_rows(self):
        script = os.path.join(rimflow_testing.SOURCE, "Testing", "Benchmarks", "locator_study", "run.py")
        with tempfile.TemporaryDirectory() as folder:
            path = os.path.join(folder, "results.csv")
            old = [dict(dict.fromkeys(studies.COLUMNS, "1"), study=study, tracks="cloud", method=locate.VOID, case="old") for study in ("noise", "thin side")]
            tables.write_rows(path, studies.COLUMNS, old)
            done = subprocess.run(["pvpython", script, "--out", folder, "--frames", "2", "--slow-frames", "0", "--jobs", "2", "--studies", "thin side"],
                                  capture_output=True, text=True, timeout=300)
            rows = tables.read_rows(path)
            self.assertEqual([(r["study"], r["snapshots"]) for r in rows], [("noise", "1"), ("thin side", "2"), ("thin side", "2")], done.stdout + done.stderr)


if __name__ == "__main__":
    rimflow_testing.main()
