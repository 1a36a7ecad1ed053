"""Breaks when the report of a run is more than one file, leaves out a result, a problem or a file of the run, or fails where things are lost."""
import json
import os
import re
import tempfile
import unittest
import unittest.mock

import matplotlib.pyplot as plt
import numpy as np
import rimflow_testing

from rimflow import report
from rimflow.process import Trajectory

DIAMETER, SPEED = 0.01, 0.2


def trajectory(status, rotation=0.0, rotation_sigma=-1.0):
    n, lost = len(status), np.array(status) == 2
    rows = lambda v: np.where(lost[:, None], np.nan, np.tile(np.asarray(v, float), (n, 1)))
    time = 0.001 * np.arange(n)
    return Trajectory(
        diameter=DIAMETER, snapshot=np.arange(n), time=time, status=np.array(status), centre=np.where(lost[:, None], np.nan, np.outer(time, [0, SPEED, 0])),
        velocity=rows([0, SPEED, 0]), acceleration=rows([0, 0.5, 0]), covariance=rows([1e-10] * 3 + [0] * 3), velocity_sigma=rows([1e-3] * 3),
        acceleration_sigma=rows([0.12] * 3), rotation=rows([0, rotation, 0]), rotation_sigma=rows([rotation_sigma] * 3), raw=rows([0, 0, 0]),
        raw_sigma=rows([1e-5] * 3), particles_inside=np.zeros(n), cost=np.zeros(n))


def run(problems=(), reconstruction=(), **settings):
    s = {"tracks": ["/data/B1.dat", "/data/B2 <new>.dat"], "diameter_m": DIAMETER, "density_kg_m3": 1820.0, "viscosity_m2_s": 2e-5,
         "body_density_kg_m3": None, "up": None, "method": "likelihood", "fields": "none", "forces": False, **settings}
    return {"settings": s, "versions": {"rimflow": "1.2.3", "paraview": "5.11.0"}, "started": "today", "seconds": 1.0, "ranks": 1,
            "timings": {"locate_s": 0.5}, "reconstruction": list(reconstruction), "reynolds": 100.0, "forces": {}, "notes": [],
            "problems": [list(p) for p in problems]}


class TestReport(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory(prefix="rimflow-report-")
        self.addCleanup(folder.cleanup)
        self.folder = folder.name

    def page(self, t, run, plots=False):
        """plots: the real ones, which take seconds."""
        if not plots:
            for name in [n for n in dir(report) if n.startswith("plot_")]:
                self.enterContext(unittest.mock.patch.object(report, name, lambda t, run: plt.figure(figsize=(1, 1))))
        names = report.write_report(self.folder, t, run)
        for name in names:
            self.assertGreater(os.path.getsize(os.path.join(self.folder, name)), 100, name)
        with open(os.path.join(self.folder, "index.html"), encoding="utf-8") as f:
            return f.read()

    def test_one_file_holds_everything(self):
        page = self.page(trajectory([0, 0, 1, 0], rotation=1.0, rotation_sigma=1.0), run(), plots=True)
        sources = re.findall(r'src="([^"]{0,30})', page)
        self.assertEqual(len(sources), 4)
        for source in sources:
            self.assertTrue(source.startswith("data:image/png;base64,"), source)
        self.assertNotRegex(page, r"https?://|<script|<link")
        for anchor in re.findall(r'href="#(\w+)"', page):
            self.assertIn(f'id="{anchor}"', page)
        for text in ("B1.dat and 1 more files", "B2 &lt;new&gt;.dat", "trajectory.dat", "3 found, 1 predicted", "0.00 ± 0.12 m/s2",
                     "0.50 ± 0.12 m/s2", "y 1.0 ± 1.0 rad/s", "rimflow 1.2.3", "2e-05 m2/s", "1 ms apart"):
            self.assertIn(text, page)
        self.assertNotIn("forces.csv", page)

    def test_rotation_is_shown_where_it_is_known(self):
        page = self.page(trajectory([0, 0, 2], rotation=8.0, rotation_sigma=1.0), run())
        self.assertIn("rotation.png", page)
        self.assertIn("y 8.0 ± 1.0 rad/s", page)
        self.assertIn("in 2 of 2 snapshots", page)
        self.assertIn("Rotation</th><td>not known", self.page(trajectory([0, 0]), run()))

    def test_problems_are_gathered_and_shown(self):
        page = self.page(trajectory([0, 2, 2, 2, 0]), run([(1, "no <particles>"), (2, "no <particles>"), (3, "no <particles>"), (4, "no forces: why")]))
        self.assertIn("Problems in 4 snapshots", page)
        self.assertIn("Snapshots 1 to 3: no &lt;particles&gt;", page)
        self.assertIn("Snapshot 4: no forces: why", page)

    def test_nothing_found_is_said(self):
        page = self.page(trajectory([2, 2]), run([(0, "lost"), (1, "lost")]))
        self.assertIn("found in no snapshot", page)
        self.assertNotIn("<img", page)

    def test_quality_in_numbers(self):
        row = {"snapshot": 0, "MisfitVelocity": 0.9, "MisfitAcceleration": 1.1, "VelocityNoise": 0.002, "AccelerationNoise": 0.05, "ParticlesUsed": 990.0,
               "Outliers": 10.0, "Iterations": 40.0, "PressureCurlResidual": None}
        page = self.page(trajectory([0]), run(reconstruction=[row, {**row, "snapshot": 1, "PressureCurlResidual": 0.12}], fields="vti", forces=True))
        for text in ("velocity 0.90, acceleration 1.10", "1.00 %", "12 % of its rms", "reconstruction.png", "fields.pvd", "forces.csv"):
            self.assertIn(text, page)

    def test_the_movie_says_what_it_left_out(self):
        os.mkdir(os.path.join(self.folder, "movie"))
        with open(os.path.join(self.folder, "movie", "preview.webp"), "wb") as f:
            f.write(b"RIFF")
        with open(os.path.join(self.folder, "movie", "movie.json"), "w") as f:
            json.dump({"frames": 2, "frames_with_wake": 2, "rate_per_s": 4, "video": "movie.avi", "preview": "preview.webp",
                       "left_out": [[2, "the sphere is lost"], [3, "the sphere is lost"], [9, "sphere/000009.vtp is missing"]]}, f)
        page = self.page(trajectory([0, 0]), run())
        self.assertIn('src="data:image/webp;base64,UklGRg=="', page)
        self.assertIn("snapshots 2, 3, the sphere is lost", page)
        self.assertIn("snapshot 9, sphere/000009.vtp is missing", page)
        self.assertIn("movie/movie.avi", page)

    def test_the_same_problem_with_other_numbers_is_one_problem(self):
        self.assertEqual(report.gathered([(5, "the ball holds 31 of 90.5"), (4, "the ball holds 30 of 90.5"), (6, "no flow")]),
                         [([4, 5], "the ball holds 30 of 90.5", True), ([6], "no flow", False)])

    def test_ranges(self):
        self.assertEqual(report.ranges([7, 1, 2, 3, 9, 10]), "1 to 3, 7, 9, 10")


if __name__ == "__main__":
    rimflow_testing.main()
