"""Breaks when the movie of a run lacks a frame, its colours or camera change from frame to frame, the wake is not shown, or a missing or
damaged file ends it. Draws with ParaView."""
import json
import os
import tempfile
import types
import unittest

import numpy as np
import rimflow_testing
from PIL import Image
from vtkmodules.util.numpy_support import numpy_to_vtk, vtk_to_numpy
from vtkmodules.vtkCommonDataModel import vtkImageData

from rimflow import movie, pipeline
from rimflow.process import Run, Trajectory

DIAMETER, SPEED, STEP = 0.01, 0.2, 0.01
SNAPSHOTS = np.arange(3, 8)  # 3, 4, 5 are whole, 6 is missing, 7 damaged, and 8 would be lost


def trajectory(status):
    n = len(status)
    rows = lambda v: np.tile(np.asarray(v, float), (n, 1))
    time = STEP * np.arange(n)
    return Trajectory(
        diameter=DIAMETER, snapshot=3 + np.arange(n), time=time, status=np.array(status), centre=np.outer(time, [0, SPEED, 0]),
        velocity=rows([0, SPEED, 0]), acceleration=rows([0, 0, 0]), covariance=rows([1e-10] * 3 + [0] * 3), velocity_sigma=rows([1e-3] * 3),
        acceleration_sigma=rows([1, 1, 1]), rotation=rows([0, 0, 0]), rotation_sigma=rows([-1, -1, -1]), raw=rows([0, 0, 0]),
        raw_sigma=rows([1e-5] * 3), particles_inside=np.zeros(n), cost=np.zeros(n))


def ring(centre):
    """A vortex ring behind the sphere: Q = 2 (V/d)^2 in a torus."""
    image, n, h = vtkImageData(), 41, DIAMETER / 10
    image.SetDimensions(n, n, n)
    image.SetSpacing(h, h, h)
    image.SetOrigin(*(centre - 0.5 * (n - 1) * h))
    x, y, z = (image.GetPoint(0)[a] + h * np.indices((n, n, n))[2 - a] - centre[a] for a in range(3))
    distance = np.hypot(np.hypot(x, z) - 0.4 * DIAMETER, y + 0.9 * DIAMETER)
    array = numpy_to_vtk(np.where(distance < 0.2 * DIAMETER, 2 * (SPEED / DIAMETER)**2, 0.0).ravel().astype(np.float32), deep=True)
    array.SetName("QCriterion")
    image.GetPointData().AddArray(array)
    return image


def colours(picture, box):
    return np.asarray(picture.crop(box)).reshape(-1, 3).astype(float).mean(axis=0)


class TestMovie(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        folder = tempfile.TemporaryDirectory(prefix="rimflow-movie-")
        cls.addClassCleanup(folder.cleanup)
        cls.out, cls.trajectory = folder.name, trajectory([0, 1, 0, 0, 0, 2])
        for name in ("sphere", "fields", "wake", "report"):
            os.mkdir(os.path.join(cls.out, name))
        t = cls.trajectory
        for row in range(3):
            surface = pipeline.sphere(pipeline.body(t, row))
            points = vtk_to_numpy(surface.GetPoints().GetData())
            # high at the front, low at the rear; in the second frame half as much
            pressure = (10 if row != 1 else 5) * (points[:, 1] - t.centre[row, 1]) / (0.5 * DIAMETER)
            pipeline.add_array(surface.GetPointData(), "Pressure", pressure)
            pipeline.write_polydata(movie.sphere_path(cls.out, t.snapshot[row]), surface)
        pipeline.write_image(os.path.join(cls.out, "fields", "000003.vti"), ring(t.centre[0]))
        pipeline.write_polydata(os.path.join(cls.out, "wake", "000004.vtp"), movie.wake(ring(t.centre[1]), movie.wake_level(t)))
        with open(movie.sphere_path(cls.out, 7), "w") as f:
            f.write("<VTKFile type='PolyData'>")
        pipeline.write_polydata(os.path.join(cls.out, "trajectory.vtp"), pipeline.polyline(t))
        with open(os.path.join(cls.out, "sphere.pvd"), "w") as f:
            f.write('<VTKFile type="Collection"><Collection><DataSet timestep="0" file="sphere/000003.vtp"/></Collection></VTKFile>')
        cls.left_out = movie.draw(cls.out, t, None, (0, 1, 0))
        cls.frames = [Image.open(cls.file(f"{k:06d}.png")).convert("RGB") for k in (3, 4, 5)]

    @classmethod
    def file(cls, *names):
        return os.path.join(cls.out, "report", "movie", *names)

    def test_a_frame_per_snapshot_and_the_reason_where_there_is_none(self):
        self.assertEqual([k for k, _ in self.left_out], [6, 7, 8])
        self.assertIn("sphere/000006.vtp is missing", self.left_out[0][1])
        self.assertIn("damaged", self.left_out[1][1])
        self.assertIn("lost", self.left_out[2][1])
        self.assertEqual(sorted(f for f in os.listdir(self.file()) if f.endswith(".png")), ["000003.png", "000004.png", "000005.png"])
        with open(self.file("movie.json")) as f:
            made = json.load(f)
        self.assertEqual((made["frames"], made["frames_with_wake"]), (3, 2))
        self.assertEqual([k for k, _ in made["left_out"]], [6, 7, 8])

    def test_the_camera_follows_and_the_colours_mean_the_same(self):
        # 900 pixels are 3.4 d, the sphere's middle is 0.65 d above the picture's
        d = 900 / 3.4
        middle = (450, 450 - 0.65 * d)
        at = lambda up: tuple(int(v) for v in (middle[0] - 8, middle[1] - up * d - 8, middle[0] + 8, middle[1] - up * d + 8))
        whole, half, again = (colours(f, at(0.42)) for f in self.frames)
        self.assertGreater(whole[0], whole[2] + 100)  # red: high pressure at the front
        self.assertLess(np.abs(whole - again).max(), 12)
        self.assertGreater(half[2], whole[2] + 40)  # paler
        self.assertGreater(colours(self.frames[2], at(-0.42))[2], colours(self.frames[2], at(-0.42))[0] + 60)  # blue at the rear
        for frame in self.frames:
            np.testing.assert_array_equal(colours(frame, at(0.62)) > 150, True)  # nothing ahead of it but the path's line

    def test_the_wake_is_behind_the_sphere(self):
        d = 900 / 3.4
        box = (450 - int(0.45 * d), int(450 + 0.2 * d), 450 + int(0.45 * d), int(450 + 0.3 * d))  # where the ring is
        from_fields, from_surface, without = (colours(f, box) for f in self.frames)
        self.assertLess(from_fields.max(), 240)
        self.assertLess(np.abs(from_fields - from_surface).max(), 3)
        self.assertGreater(without.min(), 240)

    def test_numbers_differ_from_frame_to_frame(self):
        first, second = (np.asarray(f.crop((900, 0, 1440, 100))) for f in self.frames[:2])
        self.assertTrue((first != second).any())

    def test_players_and_browsers_have_their_files(self):
        with open(self.file("movie.avi"), "rb") as f:
            head = f.read(4096)
        self.assertEqual((head[:4], head[8:12]), (b"RIFF", b"AVI "))
        self.assertIn(b"MJPG", head)
        with Image.open(self.file("preview.webp")) as preview:
            self.assertEqual((preview.n_frames, preview.size), (3, (800, 500)))

    def test_the_wake_of_another_path_does_not_stay(self):
        with tempfile.TemporaryDirectory() as out:
            for name in ("sphere", "wake", "snapshots"):
                os.mkdir(os.path.join(out, name))
            run = Run.__new__(Run)
            run.options, run.with_fields, run.unwritten = types.SimpleNamespace(out=out), False, []
            t = self.trajectory
            pipeline.write_polydata(run.wake_path(3), movie.wake(ring(t.centre[1]), movie.wake_level(t)))
            run.keep_flow(3, pipeline.body(t, 0), pipeline.Flow(), t.digest(0))  # resumed without --movie
            self.assertTrue(os.path.exists(run.flow_record_path(3)))
            self.assertFalse(os.path.exists(run.wake_path(3)))

    def test_another_uncertainty_of_the_velocity_is_another_sphere(self):
        other = trajectory([0, 0])
        other.velocity_sigma = 2 * other.velocity_sigma
        self.assertNotEqual(other.digest(0), trajectory([0, 0]).digest(0))

    def test_without_a_sphere_there_is_no_movie(self):
        with tempfile.TemporaryDirectory() as out:
            self.assertEqual(movie.draw(out, trajectory([2, 2]), None, (0, 1, 0)), [(3, "the sphere is lost"), (4, "the sphere is lost")])


if __name__ == "__main__":
    rimflow_testing.main()
