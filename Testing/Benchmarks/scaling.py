"""`rimflow process` over many snapshots: time and memory by the number of ranks, with the same results from each.

    ./rimflow bench scaling [--ranks 1,2] [--snapshots 40] [--particles 8000] [--runs 3] [--tracks FILE -- SETTINGS]

One thread per rank. The numbers of ranks take turns, so that what else the machine does hits all alike; medians count. Tracks of a sphere
in Stokes flow are written into TMPDIR unless they are there already; --tracks measures a file of your own, with the settings of
`rimflow process` after `--`. Exit status 1 when a trajectory differs by more than 1e-8 m from that of the first number of ranks, or
a field by more than 2 % of the noise of the velocity or acceleration.
"""
import argparse
import csv
import glob
import json
import os
import statistics
import subprocess
import sys
import tempfile
import time

import numpy as np
from vtkmodules.util.numpy_support import vtk_to_numpy
from vtkmodules.vtkIOXML import vtkXMLImageDataReader

from rimflow.vtkRIMFlowReaders import vtkSyntheticTracks

DIAMETER, SPEED, VISCOSITY, PERIOD = 9.53e-3, 0.02, 2e-3, 1e-3  # Re = 0.1
HALF_WIDTH = 0.015  # of the box across the motion, m
HEADER = 'TITLE = "B00001"\nVARIABLES = "x[mm]" "y[mm]" "z[mm]" "I" "Vx[m/s]" "Vy[m/s]" "Vz[m/s]" "trackID" "Ax[m/s^2]" "Ay[m/s^2]" "Az[m/s^2]"\n'


def write_tracks(path, snapshots, particles):
    """A sphere that rises through the middle of a box which is 2 diameters longer than its way."""
    way = SPEED * PERIOD * snapshots
    bounds = [-HALF_WIDTH, HALF_WIDTH, -0.5 * way - 2 * DIAMETER, 0.5 * way + 2 * DIAMETER, -HALF_WIDTH, HALF_WIDTH]
    source = vtkSyntheticTracks()
    source.SetDiameter(DIAMETER)
    source.SetVelocity(0, SPEED, 0)
    source.SetCentre(0, -0.5 * way, 0)
    source.SetViscosity(VISCOSITY)
    source.SetBounds(bounds)
    source.SetNumberOfSnapshots(snapshots)
    source.SetFramePeriod(PERIOD)
    source.SetDensity(particles / np.prod([bounds[1] - bounds[0], bounds[3] - bounds[2], bounds[5] - bounds[4]]))
    source.SetPositionNoise(5e-6)
    source.SetVelocityNoise(0.01 * SPEED)
    source.SetAccelerationNoise(0.05 * SPEED**2 / DIAMETER)
    with open(path + ".part", "w", encoding="ascii") as f:
        f.write(HEADER)
        for k in range(snapshots):
            source.UpdateTimeStep(k * PERIOD)
            data = source.GetOutput()
            array = lambda name: vtk_to_numpy(data.GetPointData().GetArray(name))
            x = vtk_to_numpy(data.GetPoints().GetData())
            f.write(f'ZONE T="Snapshot {k}"\nSTRANDID=1, SOLUTIONTIME={k * PERIOD!r}\nI={len(x)}, J=1, K=1, ZONETYPE = Ordered\nDATAPACKING = POINT\n')
            np.savetxt(f, np.column_stack([1e3 * x, np.ones(len(x)), array("Velocity"), array("TrackId"), array("Acceleration")]),
                       fmt="%.5f %.5f %.5f %.0f %.6g %.6g %.6g %d %.5g %.5g %.5g")
    os.replace(path + ".part", path)


def process(tracks, settings, ranks, out):
    """Runs the command; wall time in s and run.json."""
    script = os.path.join(os.environ["PYTHONPATH"].split(os.pathsep)[0], "rimflow", "process.py")
    run = ["pvbatch"] if ranks == 1 else ["mpirun", "--oversubscribe", "-np", str(ranks), "pvbatch", "--sym"]
    mine = ("PMIX_", "OMPI_MCA_", "OMPI_COMM_", "ORTE_")  # this process is an MPI job of its own
    environment = {k: v for k, v in os.environ.items() if not k.startswith(mine)}
    start = time.monotonic()
    done = subprocess.run([*run, script, tracks, "--out", out, *settings], env={**environment, "OMP_NUM_THREADS": "1"}, capture_output=True, text=True)
    if done.returncode:
        sys.exit(f"rimflow process with {ranks} ranks failed:\n{done.stdout}{done.stderr}")
    with open(os.path.join(out, "run.json"), encoding="utf-8") as f:
        return time.monotonic() - start, json.load(f)


def path_of(out):
    with open(os.path.join(out, "trajectory.csv"), newline="", encoding="utf-8") as f:
        return np.array([[float(r[f"{a}_m"]) for a in "xyz"] for r in csv.DictReader(f)])


def fields_of(path):
    reader = vtkXMLImageDataReader()
    reader.SetFileName(path)
    reader.Update()
    image = reader.GetOutput()
    number = lambda name: image.GetFieldData().GetArray(name).GetValue(0)
    return [(vtk_to_numpy(image.GetPointData().GetArray(name)), number(noise))
            for name, noise in (("Velocity", "VelocityNoise"), ("MaterialAcceleration", "AccelerationNoise"))]


def difference(one, other):
    """The largest distance of the paths in m, and the largest difference of fields over their noise; None where there are none."""
    path = float(np.nanmax(np.linalg.norm(path_of(one) - path_of(other), axis=1)))
    worst = None
    for image in sorted(glob.glob(os.path.join(one, "fields", "*.vti"))):
        for (a, noise), (b, _) in zip(fields_of(image), fields_of(image.replace(one, other, 1))):
            worst = max(worst or 0.0, float(np.abs(a - b).max() / noise))
    return path, worst


def main():
    parser = argparse.ArgumentParser(prog="rimflow bench scaling", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--ranks", default="1,2", help="numbers of ranks, compared with the first")
    parser.add_argument("--snapshots", type=int, default=40)
    parser.add_argument("--particles", type=int, default=8000, help="per snapshot")
    parser.add_argument("--runs", type=int, default=3)
    parser.add_argument("--tracks", help="a file of your own instead")
    parser.add_argument("settings", nargs="*", help="of `rimflow process`, after --")
    options = parser.parse_args()
    counts = [int(n) for n in options.ranks.split(",")]
    tracks, settings = options.tracks, options.settings
    if not tracks:
        tracks = os.path.join(tempfile.gettempdir(), f"rimflow-scaling-{options.snapshots}-{options.particles}.dat")
        settings = ["--diameter", f"{1e3 * DIAMETER:g}mm", "--viscosity", repr(VISCOSITY), "--body-density", "none", *settings]
        if not os.path.exists(tracks):
            write_tracks(tracks, options.snapshots, options.particles)
    with tempfile.TemporaryDirectory() as folder:
        outs = {n: os.path.join(folder, str(n)) for n in counts}
        measured = {n: [] for n in counts}
        for _ in range(options.runs):
            for n in counts:
                measured[n].append(process(tracks, settings, n, outs[n]))
                print(f"  {n} ranks: {measured[n][-1][0]:.1f} s", file=sys.stderr, flush=True)
        same = {n: difference(outs[counts[0]], outs[n]) for n in counts}
    first = statistics.median(wall for wall, _ in measured[counts[0]])
    print("| ranks | wall, s | times faster | find, s | path, s | flow and forces, s | start and report, s | peak memory per rank, MB | path differs by, m | fields differ by, noise |")
    print("|" + " --- |" * 10)
    for n in counts:
        wall = statistics.median(w for w, _ in measured[n])
        part = {k: statistics.median(run["timings"].get(k, 0) for _, run in measured[n]) for k in ("locate_s", "smooth_s", "flow_s")}
        memory = max(run["memory_peak_MB"] for _, run in measured[n])
        path, field = same[n]
        print(f"| {n} | {wall:.1f} | {first / wall:.2f} | " + " | ".join(f"{v:.1f}" for v in part.values())
              + f" | {wall - sum(part.values()):.1f} | {memory} | {path:.1g} | {'-' if field is None else f'{field:.2g}'} |")
    found = measured[counts[0]][0][1]["snapshots"]
    print(f"\n{found['selected']} snapshots, {found['found']} found; medians of {options.runs} runs, one thread per rank.")
    sys.exit(any(path > 1e-8 or (field or 0) > 0.02 for path, field in same.values()))


if __name__ == "__main__":
    main()
