"""Time and memory of VIC# against the number of nodes. Every grid is filled in a process of its own, so that the peak memory is its own.

A series of snapshots of one flow with fresh particles in each: the first solve includes the calibration, as for a user who opens the series;
the others start from its noise levels and smoothness (WarmStart).
"""
import json
import os
import subprocess
import sys
import tempfile
import time

import numpy as np

SIZES = (32, 48, 64, 96, 128, 192, 256)  # nodes per axis of the cubes, particles 2 h apart
PAPER = (160, 109, 36), 90000            # nodes and particles of the published experiment
NOISE = 0.02
LIMIT = 300  # s: larger grids are left out once a solve takes longer
CHECKED = 20000  # nodes where the velocity is compared with the truth
COLUMNS = ["case", "nx", "ny", "nz", "nodes", "particles", "snapshot", "calibration", "seconds", "processor_seconds", "peak_MB", "start_MB", "iterations",
           "velocity_error", "divergence_norm"]


def make_series(path, shape, count, snapshots, seed):
    """Tracks of the random flow, as far apart in units of its wavelength at every size (a larger box holds more of its periods)."""
    import cases  # a process that solves does without SciPy

    r = cases.SIDE / 18
    volume = np.prod(np.subtract(shape, 1.0))
    h = r * (count / volume) ** (1 / 3)
    flow, random = cases.random_flow(seed - 1, 10), np.random.default_rng([seed, 3])
    size = h * np.subtract(shape, 1)
    near = int(np.ceil(r / h))
    check = np.stack([random.integers(near, n - near, CHECKED) for n in shape], 1)
    content = {"shape": shape, "snapshots": snapshots, "spacing": h, "viscosity": flow.viscosity, "mean": flow.mean, "check": check, "truth": flow.velocity(check * h)}
    for i in range(snapshots):
        x = size * random.random((count, 3))
        u, a = flow.velocity(x), flow.acceleration(x)
        u, a = cases.add_noise(u, a, NOISE, cases.rms(u - flow.mean), cases.rms(a), seed + i)
        content.update({f"{name}{i}": value.astype(np.float32) for name, value in (("x", x), ("u", u), ("a", a))})
    np.savez(path, **content)


def memory(key):
    """Of this process, MB: VmHWM is its peak, VmRSS that of now. (ru_maxrss would count the process that started it.)"""
    with open("/proc/self/status") as f:
        return next(int(line.split()[1]) for line in f if line.startswith(key + ":")) / 1024


def solve(path):
    """In the process of its own: a line of JSON per snapshot."""
    sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "common"))
    from rimflow.vtkRIMFlowFilters import vtkVICSharpResample
    from tracks import Series, particle_data
    from vtkmodules.util.numpy_support import vtk_to_numpy

    with np.load(path) as file:
        content = {name: file[name] for name in file.files}

    h, shape, check, snapshots = float(content["spacing"]), content["shape"], content["check"], int(content["snapshots"])

    def snapshot(i):
        return particle_data(content[f"x{i}"], Velocity=content[f"u{i}"], Acceleration=content[f"a{i}"])

    series, f = Series(range(snapshots), snapshot), vtkVICSharpResample()
    f.SetInputConnection(series.GetOutputPort())
    f.SetSpacing(h)
    f.UseBoundsOn()
    f.SetBounds(sum(([0.0, h * (n - 1)] for n in shape.tolist()), []))
    f.SetViscosity(float(content["viscosity"]))
    start_memory = memory("VmRSS")
    middle = snapshots // 2  # the one that the calibration is made from
    for i in (middle, *(i for i in range(snapshots) if i != middle)):
        wall, processor = time.perf_counter(), time.process_time()
        f.UpdateTimeStep(i)
        wall, processor = time.perf_counter() - wall, time.process_time() - processor
        out = f.GetOutput()
        if out.GetDimensions() != tuple(shape):
            raise RuntimeError(f"VICSharpResample gave {out.GetDimensions()} nodes where {tuple(shape)} were asked for")
        peak = memory("VmHWM")
        u = vtk_to_numpy(out.GetPointData().GetArray("Velocity"))[(check[:, 2] * shape[1] + check[:, 1]) * shape[0] + check[:, 0]].astype(float)
        error = np.sqrt(((u - content["truth"]) ** 2).mean() / ((content["truth"] - content["mean"]) ** 2).mean())
        field = {name: out.GetFieldData().GetArray(name).GetTuple1(0) for name in ("Iterations", "DivergenceNorm")}
        print(json.dumps({"snapshot": i, "calibration": int(i == middle), "seconds": round(wall, 3), "processor_seconds": round(processor, 3),
                          "peak_MB": round(peak), "start_MB": round(start_memory), "iterations": int(field["Iterations"]),
                          "velocity_error": round(error, 4), "divergence_norm": float(f"{field['DivergenceNorm']:.2e}")}), flush=True)


def run(seed, largest):
    """The rows of scaling.csv."""
    rows = []
    series = [("paper", *PAPER)] + [("cube", (n,) * 3, round(((n - 1) / 2) ** 3)) for n in SIZES if n <= largest]
    for name, shape, count in series:
        with tempfile.TemporaryDirectory() as folder:
            path = os.path.join(folder, "series.npz")
            make_series(path, shape, count, 3 if np.prod(shape) < 3e6 else 2, seed)
            child = subprocess.run(["pvpython", os.path.abspath(__file__), path], stdout=subprocess.PIPE, text=True)
        text = " x ".join(map(str, shape))
        found = [dict(zip(COLUMNS, [name, *shape, int(np.prod(shape)), count]), **json.loads(line)) for line in child.stdout.splitlines() if line.startswith("{")]
        rows += found
        for r in found:
            print(f"{text} nodes, {count} particles: {r['seconds']:.1f} s{' with its calibration' if r['calibration'] else ''}, {r['peak_MB']} MB, "
                  f"{r['iterations']} iterations, velocity error {r['velocity_error']}", flush=True)
        if child.returncode != 0:
            print(f"{text} nodes: the process ended with status {child.returncode}; no larger grid is tried", flush=True)
            break
        if found[0]["seconds"] > LIMIT:
            print(f"{text} nodes took more than {LIMIT} s; no larger grid is tried", flush=True)
            break
    return rows


if __name__ == "__main__":
    solve(sys.argv[1])
