"""Particle tracks through the reference flow of a moving sphere, ideal and with measurement noise, as Tecplot text like DaVis writes it.

Tracers follow the flow, which is steady in the sphere's frame; each stays in its meridional plane. As the flow is free of divergence,
tracers that are uniform at one time stay so. Noise: white per component and snapshot; a share of the points is dropped, a gap ends the
track, tracks shorter than SHORTEST_TRACK are removed; ghost tracks are short straight lines anywhere in the box.
"""

import gzip
import re
from dataclasses import dataclass

import numpy as np

POSITION_NOISE = 5e-6  # m
VELOCITY_NOISE = 0.01  # of the sphere's speed
ACCELERATION_NOISE = 0.05  # of the rms component within ACCELERATION_RANGE diameters of the centre
ACCELERATION_RANGE = 1.5
DROP_OUT = 0.1
GHOSTS = 0.005  # of the rows
SHORTEST_TRACK = 4
NEAR, NEAR_STEPS, FAR_STEPS = 1.8, 4, 1  # Runge-Kutta steps per snapshot within and beyond 1.8 radii of the centre
VARIABLES = (
    '"x[mm]" "y[mm]" "z[mm]" "I" "Vx[m/s]" "Vy[m/s]" "Vz[m/s]" "|V|[m/s]" "trackID" '
    '"Ax[m/s^2]" "Ay[m/s^2]" "Az[m/s^2]" "|A|[m/s^2]"'
)


@dataclass
class Recording:
    times: np.ndarray  # s, equidistant
    bounds: np.ndarray  # m, (3, 2)
    seeding: float  # particles per m3
    eddy_seeding: float = 1.0  # share of them in the closed eddy of the wake


@dataclass
class Points:
    """Rows of a recording: one entry per particle and snapshot."""

    snapshot: np.ndarray
    track: np.ndarray
    position: np.ndarray  # m
    velocity: np.ndarray
    acceleration: np.ndarray
    source: np.ndarray = None  # track of the ideal recording, 0 = ghost

    def __getitem__(self, rows):
        return Points(*(None if field is None else field[rows] for field in vars(self).values()))


# --- ideal tracers ----------------------------------------------------------------------------------------------------


def seed_tracers(sphere, recording, random):
    """Positions at the first snapshot, uniform outside the sphere in the box and everything that can drift into it."""
    reach = sphere.speed * (recording.times[-1] - recording.times[0])
    low, high = recording.bounds[:, 0] - reach, recording.bounds[:, 1] + reach
    positions = random.uniform(low, high, (random.poisson(recording.seeding * np.prod(high - low)), 3))
    x, rho, _ = sphere.local(positions, recording.times[0])
    kept = np.hypot(x, rho) > 1
    if recording.eddy_seeding < 1:
        inside = (x > 0) & (np.hypot(x, rho) < 12)
        in_eddy = np.zeros(len(x), bool)
        in_eddy[inside & kept] = sphere.flow.stream_function(x[inside & kept], rho[inside & kept]) < 0
        kept &= ~in_eddy | (random.random(len(x)) < recording.eddy_seeding)
    return positions[kept]


def advected(flow, x, rho, time, steps):
    """Positions in the meridional plane after `time` (radii over speed), fourth-order Runge-Kutta."""

    def speed(at_x, at_rho):
        axial, radial = flow.velocity_departure(at_x, at_rho)
        return 1 + axial, radial

    step = time / steps
    for _ in range(steps):
        k1 = speed(x, rho)
        k2 = speed(x + step / 2 * k1[0], rho + step / 2 * k1[1])
        k3 = speed(x + step / 2 * k2[0], rho + step / 2 * k2[1])
        k4 = speed(x + step * k3[0], rho + step * k3[1])
        x, rho = (at + step / 6 * (a + 2 * b + 2 * c + d) for at, a, b, c, d in zip((x, rho), k1, k2, k3, k4))
    return x, rho


def ideal_points(sphere, recording, random):
    """All tracers in the box at every snapshot; a tracer that leaves and comes back is a new track."""
    start = seed_tracers(sphere, recording, random)
    x, rho, outward = sphere.local(start, recording.times[0])
    interval = (recording.times[1] - recording.times[0]) * sphere.speed / sphere.radius
    rows = []
    for snapshot, time in enumerate(recording.times):
        if snapshot:
            near = np.hypot(x, rho) < NEAR
            for part, steps in ((near, NEAR_STEPS), (~near, FAR_STEPS)):
                x[part], rho[part] = advected(sphere.flow, x[part], rho[part], interval, steps)
        position = sphere.centre_at(time) + sphere.radius * (rho[:, None] * outward - x[:, None] * sphere.direction)
        tracer = np.flatnonzero(((position >= recording.bounds[:, 0]) & (position <= recording.bounds[:, 1])).all(1))
        inside = position[tracer]
        acceleration, _ = sphere.acceleration_and_q(inside, time)
        rows.append((np.full(len(tracer), snapshot), tracer, inside, sphere.velocity(inside, time), acceleration))
    points = Points(*(np.concatenate(column) for column in zip(*rows)))
    return numbered(split_at_gaps(points), random)


def split_at_gaps(points, shortest=1):
    """Sorted by track and snapshot; a new track after every gap; tracks with fewer points removed."""
    points = points[np.lexsort((points.snapshot, points.track))]
    new = np.ones(len(points.track), bool)
    new[1:] = (np.diff(points.track) != 0) | (np.diff(points.snapshot) != 1)
    points.track = np.cumsum(new)
    return points[np.bincount(points.track)[points.track] >= shortest]


def numbered(points, random):
    """Tracks numbered from 1 in the order in which they appear, at random within a snapshot; rows by snapshot and track."""
    old, first_row, inverse = np.unique(points.track, return_index=True, return_inverse=True)
    first = np.full(len(old), np.iinfo(np.int64).max)
    np.minimum.at(first, inverse, points.snapshot)
    rank = np.empty(len(old), np.int64)
    rank[np.lexsort((random.random(len(old)), first))] = np.arange(1, len(old) + 1)
    points.track = rank[inverse]
    return points[np.lexsort((points.track, points.snapshot))]


# --- noise ------------------------------------------------------------------------------------------------------------


def acceleration_rms(points, sphere, recording):
    """Per component, within ACCELERATION_RANGE diameters of the centre."""
    centres = np.array([sphere.centre_at(time) for time in recording.times])
    near = np.linalg.norm(points.position - centres[points.snapshot], axis=1) < ACCELERATION_RANGE * sphere.diameter
    return np.sqrt(np.mean(points.acceleration[near] ** 2))


def ghost_points(count, first_track, sphere, recording, rms, random):
    """About `count` rows in straight tracks of 4 or 5 snapshots with a speed of at most half the sphere's."""
    tracks = []
    interval = recording.times[1] - recording.times[0]
    while sum(map(len, tracks)) < count:
        tracks.append(np.arange(random.integers(4, 6)))
    step, length = np.concatenate(tracks), np.array([len(track) for track in tracks])
    start = random.integers(0, len(recording.times) - length + 1)
    heading = random.normal(size=(len(tracks), 3))
    velocity = heading / np.linalg.norm(heading, axis=1)[:, None] * random.uniform(0, sphere.speed / 2, (len(tracks), 1))
    origin = random.uniform(*recording.bounds.T, (len(tracks), 3))
    of = np.repeat(np.arange(len(tracks)), length)
    position = origin[of] + velocity[of] * (interval * step)[:, None]
    acceleration = random.normal(scale=rms, size=position.shape)
    return Points(start[of] + step, first_track + of, position, velocity[of], acceleration, np.zeros(len(of), np.int64))


def noisy_points(ideal, sphere, recording, random):
    rms = acceleration_rms(ideal, sphere, recording)
    points = ideal[random.random(len(ideal.track)) >= DROP_OUT]
    points.source = points.track
    points = split_at_gaps(points, SHORTEST_TRACK)
    for field, sigma in (("position", POSITION_NOISE), ("velocity", VELOCITY_NOISE * sphere.speed), ("acceleration", ACCELERATION_NOISE * rms)):
        clean = getattr(points, field)
        setattr(points, field, clean + random.normal(scale=sigma, size=clean.shape))
    ghosts = ghost_points(GHOSTS * len(points.track), points.track.max() + 1, sphere, recording, rms, random)
    together = Points(*(np.concatenate(pair) for pair in zip(vars(points).values(), vars(ghosts).values())))
    return numbered(together, random)


# --- files ------------------------------------------------------------------------------------------------------------


def write_tecplot(path, points, recording, position_decimals, significant, random):
    """One zone per snapshot; trailing zeros dropped; `significant` digits of positions, five of everything else."""
    intensity = random.integers(100, 420, points.track.max() + 1)
    length = lambda vectors: np.linalg.norm(vectors, axis=1)[:, None]
    columns = [
        np.round(1e3 * points.position, position_decimals),
        intensity[points.track][:, None],
        np.round(np.hstack([points.velocity, length(points.velocity)]), 5),
        points.track[:, None],
        np.round(np.hstack([points.acceleration, length(points.acceleration)]), 3),
    ]
    table = np.hstack(columns) + 0.0  # no minus zero
    line = " ".join(3 * [f"%.{significant}g"] + ["%d"] + 4 * ["%.5g"] + ["%d"] + 4 * ["%.5g"]) + "\n"
    with gzip.GzipFile(path, "wb", compresslevel=6, mtime=0) as file:
        for snapshot, time in enumerate(recording.times):
            rows = table[points.snapshot == snapshot]
            header = f'TITLE = "B00001"\nVARIABLES = {VARIABLES}\n' if snapshot == 0 else ""
            header += f'ZONE T="Snapshot {snapshot:04d}"\nSTRANDID=1, SOLUTIONTIME={time:.6f}\n'
            header += f"I={len(rows)}, J=1, K=1, ZONETYPE = Ordered\nDATAPACKING = POINT\n"
            text = (line * len(rows)) % tuple(rows.ravel())
            file.write((header + re.sub(r"(\d)e-05", r"0.0000\1", text)).encode())


def write_truth_csv(path, sphere, recording):
    pressure, viscous = sphere.forces()
    constant = [*sphere.velocity_of_sphere, *pressure, *viscous, *(pressure + viscous), sphere.flow.drag_coefficients.sum(), 0.0]
    names = "t_s,xc_mm,yc_mm,zc_mm,u_m_s,v_m_s,w_m_s,Fpx_N,Fpy_N,Fpz_N,Fvx_N,Fvy_N,Fvz_N,Fx_N,Fy_N,Fz_N,Cd,Cl"
    rows = [[time, *(1e3 * sphere.centre_at(time)), *constant] for time in recording.times]
    formats = ["%.6f"] * 4 + ["%.8f"] * 3 + ["%.8e"] * 9 + ["%.6f"] * 2
    np.savetxt(path, rows, formats, ",", header=names, comments="")


def write_tracks(path, sphere, recording, random):
    """path_clean.dat.gz, path_noisy.dat.gz, path_truth.csv and path_ids.npz (`noisy`: index = track there, value = clean track, 0 = ghost)."""
    ideal = ideal_points(sphere, recording, random)
    noisy = noisy_points(ideal, sphere, recording, random)
    write_tecplot(f"{path}_clean.dat.gz", ideal, recording, 4, 6, random)
    write_tecplot(f"{path}_noisy.dat.gz", noisy, recording, 3, 5, random)
    write_truth_csv(f"{path}_truth.csv", sphere, recording)
    source = np.zeros(noisy.track.max() + 1, np.int64)
    source[noisy.track] = noisy.source
    np.savez_compressed(f"{path}_ids.npz", noisy=source)
