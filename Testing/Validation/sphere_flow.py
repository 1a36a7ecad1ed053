#!/usr/bin/env python3
"""Makes exact data of the flow around a sphere in steady motion, to judge pressure and force filters by: grids and particle tracks.

    sphere_flow.py --reynolds 250 --out DIR                 the flow alone: DIR/flow_re250.npz (kept and used again)
    sphere_flow.py --reynolds 250 --out DIR --grid 0.6mm    also DIR/truth_re250.npz
    sphere_flow.py --reynolds 250 --out DIR --tracks        also DIR/re250_clean.dat.gz, _noisy.dat.gz, _truth.csv, _ids.npz

Truth file: x y z [mm], u v w [m/s], p [Pa, dynamic part], ax ay az [m/s2, material acceleration], Q [1/s2], arrays [x, y, z]; mask
(true inside the sphere), centre_mm, t_s, direction of motion e, d_mm, V, rho, nu, Re, Cd and the force of the fluid on the sphere in
N, laboratory axes: Fp_N, Fv_N, F_N (pressure, viscous, total); Cd likewise. Needs NumPy and SciPy.
"""

import argparse
import os
import sys

import numpy as np

from axisymmetric_sphere import Mesh, SphereFlow, solve_sphere_flow
from moving_sphere import MovingSphere, fields_on_grid, grid_axes, truth_of_sphere
from sphere_tracks import Recording, write_tracks

BOX_MM = ((-16, 16), (-26, 20), (-14, 14))
FRAME_RATE = 1000.0  # Hz
SNAPSHOTS = 40
FIRST_TIME = 12.0  # s
NODES = 141, 121  # of the solver's mesh, radial and polar: Cd to 0.1 %


def recording_times():
    return FIRST_TIME + np.arange(SNAPSHOTS) / FRAME_RATE


def millimetres(text):
    """A length with its unit, in mm."""
    for unit, factor in (("mm", 1.0), ("m", 1000.0)):
        if text.endswith(unit):
            return factor * float(text[: -len(unit)])
    raise argparse.ArgumentTypeError(f"'{text}': expected a length with its unit, as 0.6mm")


def vector(text):
    numbers = [float(part) for part in text.split(",")]
    if len(numbers) != 3:
        raise argparse.ArgumentTypeError(f"'{text}': expected three numbers, as 0,1,0")
    return np.array(numbers)


def options(arguments):
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--reynolds", type=float, required=True, help="V d / nu, up to 300")
    parser.add_argument("--out", required=True, help="folder of the results")
    parser.add_argument("--name", help="of the files (default re<Reynolds number>)")
    parser.add_argument("--grid", type=millimetres, metavar="LENGTH", help="write a truth grid of this spacing")
    parser.add_argument("--offset", type=vector, default=np.zeros(3), metavar="X,Y,Z", help="move the grid's nodes by this, in mm (default 0,0,0)")
    parser.add_argument("--tracks", action="store_true", help="write particle tracks, with and without noise")
    parser.add_argument("--seeding", type=float, default=0.4, help="particles per mm3 (default 0.4)")
    parser.add_argument("--eddy-seeding", type=float, default=1.0, help="share of the particles in the closed wake eddy that exist (default 1)")
    parser.add_argument("--seed", type=int, default=1, help="of the random numbers (default 1)")
    parser.add_argument("--diameter", type=millimetres, default=9.53, metavar="LENGTH", help="default 9.53mm")
    parser.add_argument("--speed", type=float, default=0.25, help="m/s (default 0.25)")
    parser.add_argument("--density", type=float, default=1820.0, help="of the fluid, kg/m3 (default 1820)")
    parser.add_argument("--direction", type=vector, default=np.array([0.17, 0.95, -0.21]), metavar="X,Y,Z", help="of motion (default 0.17,0.95,-0.21)")
    parser.add_argument("--centre", type=vector, default=np.array([-1.1, 0.8, 0.6]), metavar="X,Y,Z", help="of the sphere half way through the recording, in mm")
    parser.add_argument("--nodes", type=int, nargs=2, default=NODES, metavar=("R", "THETA"), help="of the solver's mesh (default 141 121)")
    return parser.parse_args(arguments)


def stored_flow(path, reynolds, nodes):
    """The flow from `path`, solved and written there if it is missing or of another mesh."""
    if os.path.exists(path):
        stored = np.load(path)
        if stored["departure"].shape == tuple(nodes):
            return SphereFlow(Mesh(*nodes, stored["outer_radius"]), float(stored["reynolds"]), stored["departure"].ravel(), stored["g"].ravel())
    flow = solve_sphere_flow(reynolds, *nodes, report=lambda text: print(text, flush=True))
    np.savez(path, reynolds=reynolds, departure=flow.departure, g=flow.g, outer_radius=np.exp(flow.mesh.s[-1]))
    return flow


def describe(flow):
    pressure, viscous = flow.drag_coefficients
    return (
        f"Re = {flow.reynolds:g}: Cd = {pressure + viscous:.4f} (pressure {pressure:.4f}, viscous {viscous:.4f}), "
        f"separation {flow.separation_angle:.1f} deg, eddy {flow.recirculation_length:.3f} d"
    )


def main(arguments=None):
    settings = options(arguments)
    os.makedirs(settings.out, exist_ok=True)
    label = f"re{settings.reynolds:g}"
    name = settings.name or label
    flow = stored_flow(os.path.join(settings.out, f"flow_{label}.npz"), settings.reynolds, settings.nodes)
    print(describe(flow))
    bounds = 1e-3 * np.array(BOX_MM)
    times = recording_times()
    sphere = MovingSphere(
        flow, 1e-3 * settings.diameter, settings.speed, settings.density, settings.direction, 1e-3 * settings.centre, times.mean()
    )
    if settings.grid:
        time = times[SNAPSHOTS // 2]
        axes = grid_axes(bounds, 1e-3 * settings.grid, 1e-3 * settings.offset)
        np.savez_compressed(os.path.join(settings.out, f"truth_{name}.npz"), **fields_on_grid(sphere, axes, time), **truth_of_sphere(sphere, time))
    if settings.tracks:
        recording = Recording(times, bounds, 1e9 * settings.seeding, settings.eddy_seeding)
        write_tracks(os.path.join(settings.out, name), sphere, recording, np.random.default_rng(settings.seed))
    return 0


if __name__ == "__main__":
    sys.exit(main())
