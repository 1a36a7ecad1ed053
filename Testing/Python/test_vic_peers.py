"""Breaks when the benchmark of VIC# and its peers (Testing/Benchmarks/vic_peers) judges by a wrong truth: a random flow that is not
solenoidal or whose acceleration is not Du/Dt, analytic flows other than SyntheticTracks', differences across the wall; or when VIC# is
no better than linear interpolation there."""
import os
import sys
import tempfile
import unittest

import numpy as np

import rimflow_testing

sys.path[:0] = [os.path.join(rimflow_testing.SOURCE, "Testing", "Benchmarks", folder) for folder in ("vic_peers", "common")]

import cases
import flows
import grids
import methods
import page
import run
import tables


def rms(a):
    return np.sqrt(np.mean(np.square(a)))


def advanced(flow, step):
    """The same flow `step` later, by one Runge-Kutta step of the projected momentum equation: no pressure, unlike the flow's own acceleration."""
    def slope(modes):
        u = flow.inverse(modes) + flow.mean[:, None, None, None]
        carried = [sum(u[j] * flow.inverse(flow.derivative(modes[i], j)) for j in range(3)) for i in range(3)]
        return flow.project(-flow.forward(np.array(carried))) - flow.viscosity * (2 * np.pi) ** 2 * flow.k2 * modes

    later = flows.RandomFlow.__new__(flows.RandomFlow)
    later.__dict__.update(flow.__dict__, _splines={})
    half = flow.modes + 0.5 * step * slope(flow.modes)
    later.modes = flow.modes + step * slope(half)
    return later


class TestRandomFlow(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.flow = flows.RandomFlow(kmax=8, viscosity=2e-3, seed=5, nodes=64)
        cls.x = np.random.default_rng(2).random((400, 3))

    def differences(self, step=2e-3):
        """d_j u_i at the places, fourth order."""
        out = np.empty((len(self.x), 3, 3))
        for j in range(3):
            e = step * np.eye(3)[j]
            u = {k: self.flow.velocity(self.x + k * e) for k in (-2, -1, 1, 2)}
            out[:, :, j] = (8 * (u[1] - u[-1]) - (u[2] - u[-2])) / (12 * step)
        return out

    def test_is_solenoidal_and_has_its_vorticity(self):
        g = self.differences()
        self.assertLess(rms(np.trace(g, axis1=1, axis2=2)), 2e-3 * rms(g))
        w = self.flow.vorticity(self.x)
        self.assertLess(rms(grids.curl(g) - w), 2e-3 * rms(w))
        self.assertAlmostEqual(rms(self.flow.velocity(np.random.default_rng(1).random((20000, 3))) - self.flow.mean), 1, delta=0.02)

    def test_acceleration_is_the_change_along_the_path(self):
        a, u, dt = self.flow.acceleration(self.x), self.flow.velocity(self.x), 2e-4
        later, earlier = advanced(self.flow, dt), advanced(self.flow, -dt)
        bend = 0.5 * dt**2 * a
        along = (later.velocity(self.x + dt * u + bend) - earlier.velocity(self.x - dt * u + bend)) / (2 * dt)
        self.assertLess(rms(along - a), 5e-3 * rms(a))


class TestTruth(unittest.TestCase):
    def test_analytic_flows_are_those_of_the_source(self):
        for name in ("abc", "taylor-green", "stokes"):
            x, u, a = cases.synthetic_tracks(name, 2e8, [-0.012, 0.012] * 3, 4)
            flow = cases.analytic_flow(name)
            np.testing.assert_allclose(flow.velocity(x), u, atol=1e-5 * np.abs(u).max(), err_msg=name)
            np.testing.assert_allclose(flow.acceleration(x), a, atol=1e-5 * np.abs(a).max(), err_msg=name)
            step = 1e-5
            g = np.stack([(flow.velocity(x + step * e) - flow.velocity(x - step * e)) / (2 * step) for e in np.eye(3)], -1)
            off_wall = np.linalg.norm(x, axis=1) > cases.DIAMETER / 2 + 2 * step
            w = flow.vorticity(x)
            np.testing.assert_allclose(grids.curl(g)[off_wall], w[off_wall], atol=1e-4 * np.abs(w).max(), err_msg=name)

    def test_differences_never_cross_the_wall(self):
        places = grids.Nodes([0, 0, 0], 0.1, [12, 12, 12]).places()
        field = np.stack([places[..., 0] ** 2, places[..., 1] * places[..., 2], 3 * places[..., 2]], -1)
        solid = np.linalg.norm(places - 0.55, axis=-1) < 0.3
        field[solid] = 1e9
        g = grids.gradient(field, 0.1, ~solid)
        x, y, z = np.moveaxis(places, -1, 0)
        zero = 0 * x
        truth = np.stack([np.stack([2 * x, zero, zero], -1), np.stack([zero, z, y], -1), np.stack([zero, zero, zero + 3], -1)], -2)
        self.assertTrue(np.isfinite(g[~solid]).all())
        np.testing.assert_allclose(g[~solid], truth[~solid], atol=1e-9)  # second order is exact here, and 12 nodes leave room for it
        self.assertTrue(np.isnan(g[solid]).all())

    def test_committed_sphere(self):
        a = run.parse([])
        sphere = cases.SphereTracks(a.tracks, a.truth, a.diameter, a.velocity, a.viscosity)
        case = sphere.case()
        inside = case.distance < -case.nodes.spacing
        np.testing.assert_allclose(case.truth_u[inside], np.tile(a.velocity, (inside.sum(), 1)), atol=2e-4)
        linear = case.prepare(methods.delaunay(case))
        far = case.errors(linear, case.regions()["far"] & linear.finite)
        self.assertLess(far["velocity"], 0.2)
        self.assertLess(far["acceleration"], 0.4)


class TestComparison(unittest.TestCase):
    def test_vic_sharp_beats_linear_interpolation(self):
        case = cases.random_case(3000, 0.05, seed=3, kmax=10, cells=30)
        errors = {}
        for name, method in (("ours", methods.vic_sharp), ("linear", methods.delaunay), ("weighted", methods.gaussian)):
            result = case.prepare(method(case))
            errors[name] = case.errors(result, case.chosen & result.finite)
        for quantity in page.QUANTITIES:
            self.assertLess(errors["ours"][quantity], 0.8 * errors["linear"][quantity], quantity)
            self.assertLess(errors["linear"][quantity], errors["weighted"][quantity], quantity)

    def test_page_takes_its_tables_at_their_marks(self):
        with tempfile.TemporaryDirectory() as folder:
            path = os.path.join(folder, "page.md")
            with open(path, "w") as f:
                f.write("before\n<!-- table:peers -->\nold\n<!-- /table:peers -->\nafter\n")
            tables.fill(path, {"peers": "| new |"})
            with open(path) as f:
                self.assertEqual(f.read(), "before\n<!-- table:peers -->\n| new |\n<!-- /table:peers -->\nafter\n")
            with self.assertRaises(ValueError):
                tables.fill(path, {"unknown": "| new |"})


if __name__ == "__main__":
    rimflow_testing.main()
