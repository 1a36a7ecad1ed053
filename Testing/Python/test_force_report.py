"""Breaks when forces.csv, the means in run.json or the report's sentences do not follow from the forces per snapshot, or when the wall
of a sphere turns although its rotation is noise."""
import types
import unittest

import numpy as np
import rimflow_testing

from rimflow import force_report, forces, pipeline

DENSITY, DIAMETER, SPEED = 1000.0, 0.01, 0.2
MOTION = np.array([0.6, 0.8, 0.0])
REFERENCE = 0.5 * DENSITY * SPEED**2 * np.pi / 4 * DIAMETER**2


def trajectory(n):
    rows = lambda v: np.tile(np.asarray(v, float), (n, 1))
    return types.SimpleNamespace(
        diameter=DIAMETER, snapshot=np.arange(5, 5 + n), time=0.1 * np.arange(n), status=np.zeros(n, int), centre=rows([0, 0, 0]),
        velocity=rows(SPEED * MOTION), velocity_sigma=rows([1e-3] * 3), acceleration=rows([0, 0, 0]), acceleration_sigma=rows([1, 1, 1]),
        covariance=rows([1e-10] * 3 + [0] * 3), rotation=rows([0, 0, 0]), rotation_sigma=rows([1, 1, 1]))


def record(cd, cl=0.0, volume=None, sigma=0.01):
    """What vtkSurfaceForce would say of a force with these coefficients, two fifths of the drag from friction; volume: Cd of the control volume."""
    numbers = dict.fromkeys(forces.COLUMNS + forces.FURTHER)
    drag, lift = -cd * REFERENCE * MOTION, cl * REFERENCE * np.array([0, 0, 1])
    for name, force in (("Fp", 0.6 * drag + lift), ("Fv", 0.4 * drag), ("Fcv", -(cd if volume is None else volume) * REFERENCE * MOTION)):
        numbers.update({f"{name}_{a}_N": force[i] for i, a in enumerate("xyz")})
        numbers.update({f"sigma_{name}_{a}_N": sigma * REFERENCE for a in "xyz"})
    numbers.update(drag_N=cd * REFERENCE, lift_N=cl * REFERENCE, Cd=cd, Cl=cl)
    numbers.update({name: sigma * REFERENCE for name in ("sigma_drag_N", "sigma_lift_N", "sigma_drag_cv_N", "sigma_lift_cv_N")})
    return {"forces": numbers}


def assembled(*records):
    return forces.assembled(records, trajectory(len(records)), DENSITY)


def sentences(f):
    return " ".join(force_report.conclusions({"forces": forces.summary(f), "reynolds": 100.0}))


class TestForces(unittest.TestCase):
    def test_a_row_per_snapshot_and_nan_where_nothing_is_known(self):
        f = assembled(record(1.1, 0.2), {"forces": None}, record(1.3))
        rows = [dict(zip(forces.COLUMNS + forces.FURTHER, row)) for row in f.rows()]
        self.assertEqual([row["snapshot"] for row in rows], [5, 6, 7])
        self.assertEqual({v for k, v in rows[1].items() if k not in ("snapshot", "time_s")}, {"nan"})
        self.assertAlmostEqual(float(rows[0]["Fp_y_N"]), -0.6 * 1.1 * REFERENCE * 0.8, places=12)
        self.assertEqual(rows[2]["Fin_x_N"], "nan")
        self.assertEqual(list(f.known), [True, False, True])

    def test_means_over_time(self):
        s = forces.summary(assembled(*(record(cd, 0.2, volume=2 * cd) for cd in (1.0, 1.2, 1.0, 1.2)), {"forces": None}))
        self.assertEqual(set(s), {"surface", "control_volume"})
        self.assertEqual(s["surface"]["snapshots"], 4)
        self.assertAlmostEqual(s["surface"]["Cd_mean"], 1.1)
        self.assertAlmostEqual(s["surface"]["Cd_std"], 0.1)
        self.assertAlmostEqual(s["surface"]["Cd_step"], 0.2 / np.sqrt(2))
        self.assertAlmostEqual(s["surface"]["Cl_mean"], 0.2)
        self.assertAlmostEqual(s["surface"]["Cl_noise"], 0.01 * np.sqrt(np.pi / 2))
        self.assertAlmostEqual(s["control_volume"]["Cd_mean"], 2.2)
        self.assertAlmostEqual(s["control_volume"]["Cl_mean"], 0.0)
        self.assertEqual(forces.summary(assembled({"forces": None})), {})

    def test_sentences_tell_agreement_from_difference_and_change_from_noise(self):
        steady = [record(1.1 + 0.005 * (-1)**k) for k in range(12)]
        self.assertIn("within two standard deviations", sentences(assembled(*steady)))
        self.assertIn("no change of the drag", sentences(assembled(*steady)))
        self.assertIn("more than two standard deviations", sentences(assembled(*[record(1.1, volume=1.3)] * 4)))
        self.assertIn("the drag changes over the recording", sentences(assembled(*(record(1 + 0.05 * k) for k in range(12)))))
        self.assertIn("The change may be real", sentences(assembled(*(record(1 + 0.002 * k) for k in range(12)))))
        self.assertIn("this is noise", sentences(assembled(*(record(1.1 + 0.1 * (-1)**k) for k in range(12)))))

    def test_notes_are_gathered(self):
        self.assertEqual(force_report.grouped([(1, "a"), (2, "b"), (4, "a")]), [("a", "2 snapshots: 1, 4"), ("b", "1 snapshot: 2")])

    def test_standard_drag(self):
        # Stokes, the wake at Re = 100 (1.09 in direct simulations), the range of constant drag
        self.assertAlmostEqual(forces.standard_drag(1e-3) / 24e3, 1, delta=0.01)
        self.assertAlmostEqual(forces.standard_drag(100.0), 1.09, delta=0.03)
        self.assertAlmostEqual(forces.standard_drag(1e5), 0.46, delta=0.05)

    def test_one_snapshot_alone_tells_no_velocity(self):
        self.assertTrue(pipeline.body(trajectory(2), 0).GetFieldData().HasArray("Velocity"))
        self.assertTrue(pipeline.body(trajectory(2), 0).GetFieldData().HasArray("VelocitySigma"))
        self.assertFalse(pipeline.body(trajectory(1), 0).GetFieldData().HasArray("Velocity"))


if __name__ == "__main__":
    rimflow_testing.main()
