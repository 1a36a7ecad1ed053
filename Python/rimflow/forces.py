"""The forces on the sphere over a recording: the columns of forces.csv, and what they say on average."""
from dataclasses import dataclass, field

import numpy as np

COLUMNS = "snapshot,time_s,Fp_x_N,Fp_y_N,Fp_z_N,Fv_x_N,Fv_y_N,Fv_z_N,Fcv_x_N,Fcv_y_N,Fcv_z_N,Fin_x_N,Fin_y_N,Fin_z_N,drag_N,lift_N,Cd,Cl".split(",")
# further numbers of vtkSurfaceForce's table
FURTHER = [f"sigma_{force}_{axis}_N" for force in ("Fp", "Fv", "Fcv", "Fin") for axis in "xyz"] + (
    "sigma_drag_N,sigma_lift_N,lift_x_N,lift_y_N,lift_z_N,drag_cv_N,sigma_drag_cv_N,lift_cv_N,sigma_lift_cv_N,Cd_cv,Cl_cv,torque_x_N_m,torque_y_N_m,torque_z_N_m,"
    "coverage,control_volume_radius_m").split(",")


@dataclass
class Forces:
    """Arrays over the selected snapshots by the names of forces.csv, NaN where the forces are not known."""
    values: dict           # name -> (n,)
    reference: np.ndarray  # rho V^2/2 pi d^2/4, which the coefficients are relative to, N
    motion: np.ndarray     # (n, 3), unit vector of the sphere's velocity
    surfaces: dict = field(default_factory=dict)  # row -> (points, pressure), of the instants

    def __getitem__(self, name):
        return self.values[name]

    @property
    def known(self):
        """Where there is a force, and a motion that it can be related to."""
        return np.isfinite(self["drag_N"]) & (self.reference > 0)

    @property
    def instants(self):
        """Rows of up to four snapshots whose pressure is shown, evenly spread and not at the ends, where the flow is known least."""
        known = np.flatnonzero(self.known)
        n = min(4, len(known))
        return [int(known[int((i + 0.5) * len(known) / n)]) for i in range(n)]

    def vector(self, name):
        """(n, 3): 'Fcv' -> Fcv_x_N, Fcv_y_N, Fcv_z_N."""
        return np.stack([self[f"{name}_{axis}_N"] for axis in "xyz"], axis=1)

    def drag(self, force):
        """The part of a force (n, 3) against the motion, N."""
        return -np.sum(force * self.motion, axis=1)

    def lift(self, force):
        """The rest of a force (n, 3), N, as vectors."""
        return force + self.drag(force)[:, None] * self.motion

    def rows(self):
        """The lines of forces.csv."""
        for i, (snapshot, time) in enumerate(zip(self["snapshot"], self["time_s"])):
            yield [int(snapshot), repr(float(time)), *(f"{self[name][i]:.10g}" for name in (COLUMNS + FURTHER)[2:])]


def assembled(records, trajectory, density):
    """Forces from the snapshots' records ({"snapshot", "forces": numbers by name or None}); trajectory: of the same snapshots."""
    numbers = [r["forces"] or {} for r in records]
    values = {name: np.array([np.nan if n.get(name) is None else n[name] for n in numbers], float) for name in (COLUMNS + FURTHER)[2:]}
    values.update(snapshot=trajectory.snapshot, time_s=trajectory.time)
    speed = np.linalg.norm(trajectory.velocity, axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        motion = trajectory.velocity / speed[:, None]
    return Forces(values, 0.5 * density * speed**2 * 0.25 * np.pi * trajectory.diameter**2, motion)


@dataclass
class Estimate:
    """The force by one method; arrays over the snapshots."""
    name: str
    key: str                # in run.json
    force: np.ndarray       # (n, 3), N
    drag_sigma: np.ndarray  # standard deviation as stated, N; NaN where it is not
    lift_sigma: np.ndarray  # of each of the two components of lift, N


def estimates(f):
    """What each method says of the same force."""
    return [Estimate("surface, pressure and friction", "surface", f.vector("Fp") + f.vector("Fv"), f["sigma_drag_N"], f["sigma_lift_N"]),
            Estimate("control volume", "control_volume", f.vector("Fcv"), f["sigma_drag_cv_N"], f["sigma_lift_cv_N"]),
            Estimate("motion and buoyancy", "motion", f.vector("Fin"), *projected(f.vector("sigma_Fin"), f.motion))]


def projected(sigma, motion):
    """Standard deviations along the motion, and per component across it, from those along the axes (n, 3)."""
    along = np.sum((sigma * motion)**2, axis=1)
    return np.sqrt(along), np.sqrt(0.5 * (np.sum(sigma**2, axis=1) - along))


def coefficients(f, estimate):
    """Cd, Cl and the stated standard deviation of Cd by one method, over the snapshots."""
    with np.errstate(invalid="ignore", divide="ignore"):
        return (f.drag(estimate.force) / f.reference, np.linalg.norm(f.lift(estimate.force), axis=1) / f.reference,
                estimate.drag_sigma / f.reference)


# mean length of a vector of two normal components in units of their standard deviation (Rayleigh)
LENGTH_OF_NOISE = np.sqrt(0.5 * np.pi)


def summary(f):
    """Means over time as plain numbers, by the key of the method; a method that knows nothing is not in it."""
    result = {}
    for e in estimates(f):
        cd, cl, sigma = coefficients(f, e)
        noise = LENGTH_OF_NOISE * e.lift_sigma / f.reference
        known = np.isfinite(cd)
        mean = lambda values: float(values[known].mean()) if np.isfinite(values[known]).all() else None
        if known.any():
            result[e.key] = {"snapshots": int(known.sum()), "drag_mean_N": mean(f.drag(e.force)),
                             "Cd_mean": mean(cd), "Cd_std": float(cd[known].std()), "Cd_step": step_scatter(cd[known]), "Cd_sigma": mean(sigma),
                             "Cl_mean": mean(cl), "Cl_std": float(cl[known].std()), "Cl_noise": mean(noise)}
    return result


def step_scatter(values):
    """Scatter from snapshot to snapshot, without what changes slowly: rms difference of neighbours over the root of two (von Neumann)."""
    return float(np.sqrt(0.5 * np.mean(np.diff(values)**2))) if len(values) > 1 else None


def standard_drag(reynolds):
    """Drag coefficient of a fixed sphere in steady flow (Brown & Lawler 2003, "Sphere drag and settling velocity revisited", eq. 19)."""
    return 24 / reynolds * (1 + 0.150 * reynolds**0.681) + 0.407 / (1 + 8710 / reynolds)
