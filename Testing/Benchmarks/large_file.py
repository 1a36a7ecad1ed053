"""Opening a large track file in ParaView: time to the first snapshot and picture, time of later snapshots at random, peak memory.

    ./rimflow bench large [--format tecplot|openlpt] [--size 2.0] [--snapshots 200] [--runs 5] [--threads 2] [--convert]

A file of SIZE GB (12 columns in Tecplot files; in OpenLPT files, 13 columns, the rows stand track by track) is written into TMPDIR
unless it is there already; --file FILE measures a file of your own. Each run is a fresh pvpython that reads it through the plugin's reader, the file being in the page
cache if the memory suffices. Times start with the creation of the reader: ParaView itself and the plugin are loaded by then. Snapshots
after random jumps are compared with what was written: exit status 1 when a number is wrong.
"""
import argparse
import json
import os
import shutil
import statistics
import subprocess
import sys
import tempfile
import time

import numpy as np

JUMPS, BLOCKS = 30, 7
HEADER = ('TITLE = "B00001"\nVARIABLES = "x[mm]" "y[mm]" "z[mm]" "I" "Vx[m/s]" "Vy[m/s]" "Vz[m/s]" "|V|[m/s]" "trackID" "Ax[m/s^2]" '
          '"Ay[m/s^2]" "Az[m/s^2]"\n')
ROW = "%.6f %.6f %.6f %.4f %.6f %.6f %.6f %.6f %d %.5g %.5g %.5g\n"
BYTES_PER_ROW = 103.4
CAMERAS = ",".join(f"cam{c}_{x}" for c in range(4) for x in ("x(col)", "y(row)"))
LPT_BYTES_PER_ROW = 122.6


class Tecplot:
    """Snapshot k is block k % BLOCKS, begun at row 911 k: quick to write, and no two snapshots are the same."""
    name = "tracks.dat"

    def __init__(self, size, snapshots):
        self.snapshots, self.particles = snapshots, round(size * 1e9 / snapshots / BYTES_PER_ROW)

    def block(self, b):
        u = np.random.default_rng(b).uniform(-1, 1, (self.particles, 11)) * [55, 37, 12, 400, .4, .4, .4, .5, 60, 60, 60]
        return np.insert(u.round(6), 8, np.arange(self.particles) + b, axis=1)

    def write(self, path):
        texts = [[ROW % tuple(row) for row in self.block(b)] for b in range(BLOCKS)]
        with open(path, "w", encoding="ascii") as f:
            f.write(HEADER)
            for k in range(self.snapshots):
                rows, first = texts[k % BLOCKS], 911 * k % self.particles
                f.write(f'ZONE T="Snapshot {k}"\nSTRANDID=1, SOLUTIONTIME={self.time(k)!r}\nI={self.particles}, J=1, K=1, ZONETYPE = Ordered\n'
                        "DATAPACKING = POINT\n")
                f.writelines(rows[first:])
                f.writelines(rows[:first])

    def time(self, k):
        return round(43 + 0.001 * k, 3)

    def settings(self):
        return {}

    def expected(self, k):
        """TrackId and positions in m, in the file's order."""
        rows = np.roll(self.block(k % BLOCKS), -(911 * k % self.particles), axis=0)
        return rows[:, 8].astype(np.int64), rows[:, :3] * 1e-3


class OpenLPT:
    """Track t is pattern t % BLOCKS under its own id; all tracks live in all frames."""
    name = "tracks.csv"

    def __init__(self, size, snapshots):
        self.snapshots, self.particles = snapshots, round(size * 1e9 / snapshots / LPT_BYTES_PER_ROW)

    def pattern(self, p):
        return np.random.default_rng(p).uniform(-50, 50, (self.snapshots, 11)).round(6)

    def write(self, path):
        patterns = ["".join("@,%d,%s\n" % (f, ",".join("%.6f" % v for v in row)) for f, row in enumerate(self.pattern(p))) for p in range(BLOCKS)]
        with open(path, "w", encoding="ascii") as out:
            out.write(f"TrackID,FrameID,WorldX,WorldY,WorldZ,{CAMERAS}\n")
            for t in range(self.particles):
                out.write(patterns[t % BLOCKS].replace("@", str(t)))

    def time(self, k):
        return 0.001 * k

    def settings(self):
        return {"FramePeriod": 0.001}

    def expected(self, k):
        tracks = np.arange(self.particles)
        rows = np.array([self.pattern(p)[k, :3] for p in range(BLOCKS)])
        return tracks, rows[tracks % BLOCKS] * 1e-3


FORMATS = {"tecplot": Tecplot, "openlpt": OpenLPT}


def memory():
    """The most that this process has held so far, MB; getrusage would count the parent's too."""
    with open("/proc/self/status", encoding="ascii") as f:
        return next(int(line.split()[1]) for line in f if line.startswith("VmHWM")) / 1024


def measure(path, data, render):
    """One run in this process: seconds and MB by name, and whether all numbers were right."""
    from paraview import simple
    from vtkmodules.util.numpy_support import vtk_to_numpy

    if not hasattr(simple, "STBTrackReader"):
        sys.exit("the plugin is not loaded: run it by ./rimflow bench large")
    if render:
        view = simple.CreateRenderView(ViewSize=[800, 600])
        simple.Render(view)  # the window is there, as it is when a user opens a file
    idle, start = memory(), time.perf_counter()
    if path.endswith(".pvd"):
        reader = simple.PVDReader(FileName=path)
    else:
        reader = simple.STBTrackReader(**(data.settings() if data else {}), FileNames=[path])
    if render:
        simple.Show(reader, view)
        view.ResetCamera()
        simple.Render(view)
    else:
        reader.UpdatePipeline()
    found = {"first": time.perf_counter() - start, "later": [], "idle_MB": idle, "first_MB": memory()}
    times = list(reader.TimestepValues)
    order = np.random.default_rng(3).integers(0, len(times), JUMPS)
    for k in map(int, order):
        start = time.perf_counter()
        if render:
            view.ViewTime = times[k]
            simple.Render(view)
        else:
            reader.UpdatePipeline(times[k])
        found["later"].append(time.perf_counter() - start)
    found["peak_MB"] = memory()
    right = not data or times == [data.time(k) for k in range(data.snapshots)]
    for k in map(int, order[:8] if data else ()):
        reader.UpdatePipeline(times[k])
        output = reader.GetClientSideObject().GetOutputDataObject(0)
        ids, position = data.expected(k)
        right = (right and output.GetFieldData().GetArray("SnapshotIndex").GetValue(0) == k
                 and np.array_equal(vtk_to_numpy(output.GetPointData().GetArray("TrackId")), ids)
                 and np.allclose(vtk_to_numpy(output.GetPoints().GetData()), position, rtol=3e-7, atol=1e-9))
    return {**found, "right": bool(right)}


def spread(values, unit, digits):
    return f"median {statistics.median(values):.{digits}f} {unit}, {min(values):.{digits}f} to {max(values):.{digits}f}"


def runs(path, options, render):
    command = ["pvpython", os.path.abspath(__file__), "--format", options.format, "--size", repr(options.size),
               "--snapshots", str(options.snapshots), "--measure", path, *(["--file", options.file] if options.file else [])]
    if render:
        command = [os.path.join(os.path.dirname(__file__), "..", "..", "rimflow"), "with-display", *command, "--render"]
    environment = {**os.environ, "OMP_NUM_THREADS": str(options.threads)}
    results = []
    for _ in range(options.runs):
        output = subprocess.run(command, stdout=subprocess.PIPE, text=True, env=environment, check=True).stdout
        results.append(json.loads(output.strip().split("\n")[-1]))
    print(f"{'with rendering' if render else 'reader alone'}, {options.runs} runs, load {os.getloadavg()[0]:.1f}"
          f"{'' if all(r['right'] for r in results) else ', WRONG NUMBERS'}")
    print("  first", "picture: " if render else "snapshot:", spread([r["first"] for r in results], "s", 3))
    print("  later ones:    ", spread([t for r in results for t in r["later"]], "s", 4))
    print("  peak memory:   ", spread([r["peak_MB"] for r in results], "MB", 0),
          f"(before the file was opened {statistics.median([r['idle_MB'] for r in results]):.0f}, at the first {statistics.median([r['first_MB'] for r in results]):.0f})",
          flush=True)
    return all(r["right"] for r in results)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--format", choices=FORMATS, default="tecplot")
    parser.add_argument("--size", type=float, default=2.0, help="GB")
    parser.add_argument("--snapshots", type=int, default=200)
    parser.add_argument("--file", help="this file instead; its numbers are not checked")
    parser.add_argument("--runs", type=int, default=5)
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--no-render", action="store_true", help="only the reader")
    parser.add_argument("--convert", action="store_true", help="also the series that `rimflow convert` makes of the file")
    parser.add_argument("--measure", metavar="FILE", help=argparse.SUPPRESS)
    parser.add_argument("--render", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args()
    data = None if options.file else FORMATS[options.format](options.size, options.snapshots)
    if options.measure:
        print("\n" + json.dumps(measure(options.measure, data, options.render)), flush=True)
        return 0
    path = options.file or os.path.join(tempfile.gettempdir(), f"rimflow-large-{options.size:g}-{options.snapshots}-{data.name}")
    if not os.path.exists(path):
        start = time.perf_counter()
        data.write(path + ".part")
        os.replace(path + ".part", path)
        print(f"written in {time.perf_counter() - start:.0f} s")
    print(f"{path}: {os.path.getsize(path) / 1e9:.4g} GB{f', {data.snapshots} snapshots of {data.particles} particles' if data else ''}; {options.threads} threads, {os.cpu_count()} cores",
          flush=True)
    paths, right = [path], True
    if options.convert:
        folder = tempfile.mkdtemp(prefix="rimflow-series-")
        series, start = os.path.join(folder, "series.pvd"), time.perf_counter()
        script = os.path.join(os.environ["PYTHONPATH"].split(":")[0], "rimflow", "convert.py")
        period = ["--frame-period", "0.001"] if options.format == "openlpt" and data else []
        subprocess.run(["pvbatch", script, path, series, *period], stderr=subprocess.DEVNULL, check=True)
        size = sum(entry.stat().st_size for entry in os.scandir(os.path.join(folder, "series")))
        print(f"converted in {time.perf_counter() - start:.1f} s to {size / 1e9:.4g} GB")
        paths.append(series)
    for name in paths:
        print("==", os.path.basename(name))
        for render in (False,) if options.no_render else (False, True):
            right = runs(name, options, render) and right
    if options.convert:
        shutil.rmtree(folder)
    return 0 if right else 1


if __name__ == "__main__":
    status = main()
    sys.stdout.flush()
    os._exit(status)
