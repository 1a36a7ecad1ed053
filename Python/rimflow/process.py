"""`rimflow process`: tracks in, the sphere's trajectory, the flow around it and the forces on it out. Runs under pvbatch, alone or with MPI.

Three passes; in the first and the last each rank has a contiguous share:
1. every snapshot by itself: find the sphere            -> snapshots/NNNNNN.json (what --resume goes on from), NNNNNN.wall.vtp
2. all snapshots together: the path, on the first rank  -> trajectory.csv, trajectory.dat
3. every snapshot with the smoothed sphere: flow, forces -> sphere/, fields/, snapshots/NNNNNN.flow.json (what --resume goes on from)
In the end the first rank writes what concerns all snapshots: forces.csv, run.json, report/.
The results do not depend on the number of ranks, nor on when a run was interrupted: what one snapshot learns from another is fixed by BLOCK.
"""
import hashlib
import itertools
import json
import os
import platform
import resource
import shutil
import sys
import time
from dataclasses import dataclass

import numpy as np

from rimflow import files, forces, options as command_line, pipeline
from rimflow.options import UsageError
from rimflow.pipeline import FOUND, LOST, PREDICTED
from rimflow.progress import ProgressBar

# Snapshots through which the sphere is followed; at the first one of each block the search knows nothing. A search from elsewhere ends
# some hundredths of a micrometre away, so the blocks must be the same for any number of ranks, and are searched anew as a whole.
BLOCK = 10

TRAJECTORY_COLUMNS = (
    "snapshot,time_s,x_m,y_m,z_m,u_m_s,v_m_s,w_m_s,ax_m_s2,ay_m_s2,az_m_s2,cov_xx_m2,cov_yy_m2,cov_zz_m2,cov_xy_m2,cov_yz_m2,cov_xz_m2,"
    "status,particles_inside,cost,raw_x_m,raw_y_m,raw_z_m,omega_x_rad_s,omega_y_rad_s,omega_z_rad_s,"
    "sigma_omega_x_rad_s,sigma_omega_y_rad_s,sigma_omega_z_rad_s").split(",")


@dataclass
class Trajectory:
    """The smoothed trajectory and what each snapshot said by itself; arrays over the snapshots, SI, NaN where the sphere is lost."""
    diameter: float
    snapshot: np.ndarray        # index in the file's series
    time: np.ndarray
    status: np.ndarray          # 0 found, 1 predicted, 2 lost
    centre: np.ndarray          # (n, 3)
    velocity: np.ndarray        # (n, 3)
    acceleration: np.ndarray    # (n, 3)
    covariance: np.ndarray      # (n, 6): xx yy zz xy yz xz, of the smoothed centre
    velocity_sigma: np.ndarray  # (n, 3)
    acceleration_sigma: np.ndarray  # (n, 3)
    rotation: np.ndarray        # (n, 3), angular velocity, rad/s
    rotation_sigma: np.ndarray  # (n, 3); -1: the rotation is not known
    raw: np.ndarray             # (n, 3), the single-snapshot estimate
    raw_sigma: np.ndarray       # (n, 3)
    particles_inside: np.ndarray
    cost: np.ndarray

    @property
    def sigma(self):
        return np.sqrt(self.covariance[:, :3])

    def digest(self, row):
        """Tells whether what was computed around the sphere of a snapshot still holds."""
        motion = (self.centre, self.velocity, self.acceleration, self.covariance, self.velocity_sigma, self.acceleration_sigma,
                  self.rotation, self.rotation_sigma)
        return hashlib.sha1(b"".join(np.ascontiguousarray(values[row]).tobytes() for values in motion)).hexdigest()


def main(arguments):
    """Runs the command; returns the exit status."""
    ranks = pipeline.Ranks()
    return pipeline.answered("process", lambda: Run(command_line.parse(arguments), ranks).execute(), speaks=ranks.first)


class Run:
    def __init__(self, options, ranks):
        self.options, self.ranks = options, ranks
        if options.ranks not in (1, ranks.count):
            raise UsageError(f"--ranks is {options.ranks}, but MPI started {ranks.count}: start with mpirun -np {options.ranks} or an srun that fits the MPI")
        self.started, self.clock = time.strftime("%Y-%m-%d %H:%M:%S"), time.monotonic()
        self.chain = pipeline.Chain(options)
        self.times = self.chain.times()
        self.selected = list(range(len(self.times)))[options.steps]
        if not self.selected:
            raise UsageError(f"--steps selects none of the {len(self.times)} snapshots in {options.tracks[0]}")
        self.selected.sort()
        self.blocks = [self.selected[i:i + BLOCK] for i in range(0, len(self.selected), BLOCK)]
        self.unwritten = []  # messages about files that could not be written: this rank's, in the end on the first rank all of them
        self.timings = {}
        self.with_forces, self.with_fields = not options.no_forces, options.fields != "none"
        self.with_wake = options.movie and not self.with_fields  # else the movie takes it from the fields
        self.with_flow = self.with_forces or self.with_fields or self.with_wake

    def execute(self):
        if self.ranks.first:
            self.prepare_folder()
        self.ranks.wait()
        self.timed("locate", self.locate)
        trajectory = self.timed("smooth", self.smooth)
        self.timed("flow" if self.with_flow else "write", lambda: self.write(trajectory))
        self.memory = round(self.ranks.largest(memory_peak()))
        self.unwritten = self.ranks.gathered(self.unwritten)
        if self.ranks.first:
            self.finish(trajectory)
        self.ranks.wait()  # a rank that fails ends the others
        if self.unwritten:
            raise pipeline.PipelineError(f"{len(self.unwritten)} results could not be written, the last is {self.unwritten[-1]}; "
                                         "make room, and run the same with --resume")

    def timed(self, name, step):
        start = time.monotonic()
        result = step()
        self.ranks.wait()
        self.timings[f"{name}_s"] = round(time.monotonic() - start, 3)
        return result

    # Folder ------------------------------------------------------------------------------------------------------

    def path(self, *names):
        return os.path.join(self.options.out, *names)

    def record_path(self, k):
        return self.path("snapshots", f"{k:06d}.json")

    def wall_path(self, k):
        return self.path("snapshots", f"{k:06d}.wall.vtp")

    def flow_record_path(self, k):
        return self.path("snapshots", f"{k:06d}.flow.json")

    def sphere_path(self, k):
        return self.path("sphere", f"{k:06d}.vtp")

    def wake_path(self, k):
        return self.path("wake", f"{k:06d}.vtp")

    def image_path(self, k):
        return self.path("fields", f"{k:06d}.vti")

    def prepare_folder(self):
        """A fresh folder, or the one of the interrupted run when it was made with the same settings."""
        os.makedirs(self.options.out, exist_ok=True)
        settings = command_line.settings(self.options)
        earlier = self.path("settings.json")
        if self.options.resume and os.path.exists(earlier):
            command_line.check_same_settings(self.options.out, settings, "a run")
            files.remove_parts(self.options.out)
        else:
            for folder in ("snapshots", "sphere", "fields", "wake", "report"):
                shutil.rmtree(self.path(folder), ignore_errors=True)
            for name in ("trajectory.csv", "forces.csv", "sphere.pvd", "fields.pvd", "run.json", "trajectory.vtp", "trajectory.dat"):
                files.remove(self.path(name))
        for folder in ("snapshots", "sphere", "report") + ("fields",) * self.with_fields + ("wake",) * self.with_wake:
            os.makedirs(self.path(folder), exist_ok=True)
        files.write_json(earlier, settings)

    # Passes ------------------------------------------------------------------------------------------------------

    def locate(self):
        mine = self.ranks.share(self.blocks)
        bar = ProgressBar("sphere", sum(map(len, mine))) if self.ranks.first else None
        done = 0
        for block in mine:
            if not self.located(block):
                self.forget(block)
                self.chain.begin()
                for i, k in enumerate(block):
                    if bar:
                        bar.show(done + i)
                    self.keep(k, self.attempt(k, lambda: self.chain.locate(self.times[k])))
            done += len(block)
        if bar:
            bar.show(done)
        self.ranks.wait()
        for run in self.ranks.share(self.lost_runs(self.read_records())):
            self.look_again(*run)

    def located(self, block):
        """Whether an interrupted run had searched these snapshots; where one failed they are tried again."""
        paths = [self.record_path(k) for k in block]
        return self.options.resume and all(os.path.exists(path) and not read_json(path).get("failed") for path in paths)

    def forget(self, block):
        """A block is searched as a whole, or not at all."""
        for k in block:
            files.remove(self.record_path(k))

    def lost_runs(self, records):
        """What was lost when nothing else was known yet, at the beginnings of blocks: (the last find before, neighbouring snapshots, the
        first find after), finds as records or None. What an interrupted run found by looking again counts as lost, as it did there."""
        failed = lambda k: records[k].get("failed", False)  # also: not written; it is searched when the run is resumed
        lost = lambda k: records[k]["status"] == LOST or records[k].get("looked_again", False)
        blind = {k for block in self.blocks for k in itertools.takewhile(lost, block) if not failed(k)}
        runs, before = [], None
        for is_blind, group in itertools.groupby(self.selected, lambda k: k in blind):
            group = list(group)
            if is_blind:
                runs.append([before, group, None])
                continue
            finds = [records[k] for k in group if not lost(k)]
            for run in runs:
                run[2] = run[2] or next(iter(finds), None)
            before = finds[-1] if finds else before
        return [run for run in runs if run[0] or run[2]]

    def look_again(self, before, lost, after):
        """Along the lost snapshots from the find after them, and for what is still lost from the find before them."""
        for find, order in ((after, lost[::-1]), (before, lost)):
            if not find:
                continue
            self.chain.begin(find["centre_m"])
            self.attempt(find["snapshot"], lambda: self.chain.locate(find["time_s"]))
            for k in order:
                record = self.attempt(k, lambda: self.chain.locate(self.times[k]))
                if record["status"] != LOST:
                    self.keep(k, {**record, "looked_again": True})
                    lost = [other for other in lost if other != k]
            if not lost:
                return

    def keep(self, k, record):
        """The wall first: a snapshot that has its record is done."""
        def write():
            if record["status"] != LOST:
                pipeline.write_polydata(self.wall_path(k), self.chain.wall())
            files.write_json(self.record_path(k), record)

        self.written(write, f"snapshot {k}")

    def written(self, write, what, failures=OSError):
        """Runs write(). A file that cannot be written is a line in the log, and the run goes on; returns the reason, or an empty text.
        failures: the exceptions that are no more than that."""
        try:
            write()
            return ""
        except failures as error:
            reason = files.reason(error) if isinstance(error, OSError) else f"{type(error).__name__}: {error}"
            self.unwritten.append(f"{what}: {reason}")
            print(f"rimflow process: {self.unwritten[-1]}", file=sys.stderr, flush=True)
            return reason

    def read_records(self):
        missing = {"status": LOST, "status_text": "what was found could not be written, see the log", "failed": True, "seconds": 0.0}
        return {k: read_json(self.record_path(k)) if os.path.exists(self.record_path(k)) else {"snapshot": k, "time_s": self.times[k], **missing}
                for k in self.selected}

    def attempt(self, k, step):
        """The snapshot's record; a snapshot that fails is a record with the reason, and the run goes on."""
        start = time.monotonic()
        try:
            record = step()
        except pipeline.PipelineError as error:
            record = {"status": LOST, "status_text": str(error), "failed": True}
        return {"snapshot": k, "time_s": self.times[k], "seconds": round(time.monotonic() - start, 4), **record}

    def smooth(self):
        """The first rank estimates the path and tells it to the others."""
        records = self.records = list(self.read_records().values())
        smoothed = None
        if self.ranks.first:
            walls = [pipeline.read_polydata(self.wall_path(k)) for k in self.selected if os.path.exists(self.wall_path(k))]
            smoothed = smooth(records, self.options.diameter, walls)
        trajectory = assembled(records, self.options.diameter, self.ranks.shared(smoothed))
        if self.ranks.first:
            ratio = (self.options.body_density or 0) / self.options.density
            self.written(lambda: files.write_csv(self.path("trajectory.csv"), TRAJECTORY_COLUMNS, trajectory_rows(trajectory)), "trajectory.csv")
            self.written(lambda: pipeline.write_sphere_trajectory(self.path("trajectory.dat"), trajectory, ratio), "trajectory.dat")
        return trajectory

    def write(self, trajectory):
        """The sphere and the flow around it, for every snapshot of this rank's share."""
        row_of, mine = {k: i for i, k in enumerate(self.selected)}, self.ranks.share(self.selected)
        flow = pipeline.FlowChain(self.chain) if self.with_flow else None
        wake = self.wake_of(trajectory) if self.with_wake else None
        bar = ProgressBar("flow" if flow else "files", len(mine)) if self.ranks.first else None
        for done, k in enumerate(mine):
            if bar:
                bar.show(done)
            body = pipeline.body(trajectory, row_of[k])
            known = trajectory.status[row_of[k]] != LOST
            if not flow or not (known or self.with_fields):
                self.written(lambda: pipeline.write_polydata(self.sphere_path(k), pipeline.sphere(body)), f"snapshot {k}")
            elif not self.flow_done(k, trajectory.digest(row_of[k])):
                self.keep_flow(k, body, flow.compute(self.times[k], body), trajectory.digest(row_of[k]), wake)
        if bar:
            bar.show(len(mine))

    def flow_done(self, k, sphere):
        """Whether an interrupted run had finished this snapshot around the same sphere (its digest); one that failed is tried again."""
        needed = [self.flow_record_path(k)] + [self.wake_path(k)] * self.with_wake
        if not (self.options.resume and all(map(os.path.exists, needed))):
            return False
        record = read_json(needed[0])
        return not record["failed"] and record.get("sphere") == sphere

    def wake_of(self, trajectory):
        """A function from a flow to what the movie shows of it."""
        from rimflow import movie

        level = movie.wake_level(trajectory)
        return lambda image: movie.wake(image, level)

    def keep_flow(self, k, body, flow, sphere, wake=None):
        """The record last: a snapshot that has it is done."""
        self.written(lambda: files.remove(self.wake_path(k)), f"snapshot {k}")  # of another path; without --movie no new one replaces it
        surface = pipeline.sphere(body) if flow.surface is None else flow.surface
        reasons = [flow.failed, self.written(lambda: pipeline.write_polydata(self.sphere_path(k), surface), f"snapshot {k}")]
        if self.with_fields and flow.image is not None:
            reasons.append(self.written(lambda: pipeline.write_image(self.image_path(k), flow.image), f"snapshot {k}"))
        if wake and flow.image is not None:
            reasons.append(self.written(lambda: pipeline.write_polydata(self.wake_path(k), wake(flow.image)), f"snapshot {k}"))
        self.written(lambda: files.write_json(self.flow_record_path(k), {
            "snapshot": k, "sphere": sphere, "quality": flow.quality, "forces": flow.forces, "note": flow.note,
            "failed": "; ".join(filter(None, reasons)), "seconds": flow.seconds}), f"snapshot {k}")

    def read_flow_records(self, trajectory):
        """One per selected snapshot; of a lost snapshot without fields nothing was computed."""
        nothing = {"quality": None, "forces": None, "note": "", "failed": "", "seconds": {}}
        missing = {**nothing, "failed": "the results could not be written, see the log"}
        for row, k in enumerate(self.selected):
            there = os.path.exists(self.flow_record_path(k))
            record = read_json(self.flow_record_path(k)) if there else {}
            wanted = self.with_flow and (trajectory.status[row] != LOST or self.with_fields)
            yield record if record.get("sphere") == trajectory.digest(row) else {"snapshot": k, **(missing if wanted else nothing)}

    def finish(self, trajectory):
        """What one rank writes when all the others have written theirs."""
        from rimflow.report import write_report

        options, flows = self.options, list(self.read_flow_records(trajectory))
        there = lambda path_of: [k for k in self.selected if os.path.exists(path_of(k))]
        series = lambda name, path_of: files.write_pvd(
            self.path(name), [(self.times[k], os.path.relpath(path_of(k), options.out)) for k in there(path_of)])
        self.written(lambda: series("sphere.pvd", self.sphere_path), "sphere.pvd")
        self.written(lambda: pipeline.write_polydata(self.path("trajectory.vtp"), pipeline.polyline(trajectory)), "trajectory.vtp")
        if self.with_fields:
            self.written(lambda: series("fields.pvd", self.image_path), "fields.pvd")
        loads = None
        if self.with_forces:
            loads = forces.assembled(flows, trajectory, options.density)
            self.written(lambda: files.write_csv(self.path("forces.csv"), forces.COLUMNS + forces.FURTHER, loads.rows()), "forces.csv")
            surfaces = {row: pipeline.surface_pressure(self.sphere_path(self.selected[row])) for row in loads.instants}
            loads.surfaces = {row: surface for row, surface in surfaces.items() if surface}
        run = self.summary(trajectory, flows, loads)
        self.written(lambda: files.write_json(self.path("run.json"), run), "run.json")
        self.written(lambda: write_report(self.path("report"), trajectory, run, loads), "report")
        if options.images or options.movie:  # last: without a working display ParaView ends the process
            self.draw(trajectory, loads)
            self.written(lambda: write_report(self.path("report"), trajectory, run, loads), "report")
        if self.unwritten:
            run["unwritten"] = self.unwritten
            self.written(lambda: files.write_json(self.path("run.json"), run), "run.json")
        self.say(run)

    def draw(self, trajectory, loads):
        from rimflow import images, movie

        up = self.options.up or (0, 1, 0)
        if self.options.images:
            self.written(lambda: images.draw(self.options.out, trajectory, self.options.tracks, up, loads), "pictures", Exception)
        if self.options.movie:
            self.written(lambda: self.draw_movie(movie, trajectory, loads, up), "movie", Exception)

    def draw_movie(self, movie, trajectory, loads, up):
        for k, reason in movie.draw(self.options.out, trajectory, loads, up):
            print(f"rimflow process: snapshot {k} is not in the movie: {reason}", file=sys.stderr)

    def summary(self, trajectory, flows, loads):
        """What stands in run.json."""
        problems = [(r["snapshot"], r["status_text"]) for r in self.records if r["status"] == LOST]
        problems += [(r["snapshot"], f"{self.missing(r)}: {r['failed']}") for r in flows if r["failed"]]
        return {
            "settings": command_line.settings(self.options),
            "versions": {"rimflow": pipeline.version(), "paraview": pipeline.paraview_version(), "vtk": pipeline.vtk_version(),
                         "python": platform.python_version(), "numpy": np.__version__},
            "started": self.started, "seconds": round(time.monotonic() - self.clock, 3), "ranks": self.ranks.count,
            "memory_peak_MB": self.memory, "timings": self.timings,
            "snapshots": {"selected": len(self.selected), **{name: int(np.sum(trajectory.status == value))
                          for name, value in (("found", FOUND), ("predicted", PREDICTED), ("lost", LOST))},
                          "with_forces": int(loads.known.sum()) if loads else 0},
            "seconds_per_snapshot": {str(r["snapshot"]): {"locate": r["seconds"], **f["seconds"]} for r, f in zip(self.records, flows)},
            "reconstruction": [{"snapshot": r["snapshot"], **r["quality"]} for r in flows if r["quality"]],
            "reynolds": reynolds(trajectory, self.options.viscosity),
            "forces": forces.summary(loads) if loads else {},
            "notes": [[r["snapshot"], r["note"]] for r in flows if r["note"]],
            "problems": [list(p) for p in sorted(problems)],
        }

    def missing(self, record):
        """What a snapshot whose flow failed has not."""
        if record["forces"]:
            return "not all of its files"
        if not record["quality"]:
            return "no flow" if self.with_fields else "no forces"
        return "no forces" if self.with_forces else "no pressure"

    def say(self, run):
        counts, found = run["snapshots"], run["forces"]
        if found:
            print("Drag coefficient, mean and standard deviation over time: " + ", ".join(
                f"{found[key]['Cd_mean']:.3f} +- {found[key]['Cd_std']:.3f} ({name})"
                for key, name in (("surface", "surface"), ("control_volume", "control volume"), ("motion", "motion and buoyancy")) if key in found))
        print(f"{counts['selected']} snapshots: {counts['found']} found, {counts['predicted']} predicted, {counts['lost']} lost. "
              f"See {self.path('report', 'index.html')}")
        for k, text in run["problems"]:
            print(f"snapshot {k}: {text}", file=sys.stderr)


def read_json(name):
    with open(name, encoding="utf-8") as f:
        return json.load(f)


def memory_peak():
    """The largest resident memory of this process so far, MB."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024e-6


def reynolds(trajectory, viscosity):
    """V d/nu with the mean speed; None where the sphere is lost throughout."""
    speed = np.linalg.norm(trajectory.velocity[trajectory.status != LOST], axis=1)
    return float(speed.mean() * trajectory.diameter / viscosity) if len(speed) else None


def smooth(records, diameter, walls):
    """The joint path of the per-snapshot records, by the same smoother as in the locator's Trajectory output."""
    times = np.array([r["time_s"] for r in records], float)
    status = np.array([r["status"] for r in records])
    raw, covariance = raw_centres(records)
    return pipeline.smooth(times, raw, covariance, status, diameter, walls)


def raw_centres(records):
    """Single-snapshot centres (n, 3) and covariances (n, 6); NaN where lost."""
    n = len(records)
    raw = np.array([r.get("centre_m") or [np.nan] * 3 for r in records], float).reshape(n, 3)
    return raw, np.array([r.get("covariance_m2") or [np.nan] * 6 for r in records], float).reshape(n, 6)


def assembled(records, diameter, smoothed):
    raw, raw_covariance = raw_centres(records)
    return Trajectory(
        diameter=diameter, snapshot=np.array([r["snapshot"] for r in records]), time=np.array([r["time_s"] for r in records], float),
        status=smoothed["Status"], centre=smoothed["Centre"], velocity=smoothed["Velocity"], acceleration=smoothed["Acceleration"],
        covariance=smoothed["Covariance"], velocity_sigma=smoothed["VelocitySigma"], acceleration_sigma=smoothed["AccelerationSigma"],
        rotation=smoothed["AngularVelocity"], rotation_sigma=smoothed["AngularVelocitySigma"], raw=raw, raw_sigma=np.sqrt(raw_covariance[:, :3]),
        particles_inside=np.array([r.get("particles_inside", -1) for r in records]),
        cost=np.array([r.get("cost", np.nan) for r in records], float))


def trajectory_rows(t):
    for i in range(len(t.time)):
        numbers = [*t.centre[i], *t.velocity[i], *t.acceleration[i], *t.covariance[i]]
        yield [int(t.snapshot[i]), repr(float(t.time[i])), *(f"{v:.10g}" for v in numbers), int(t.status[i]), int(t.particles_inside[i]),
               f"{t.cost[i]:.10g}", *(f"{v:.10g}" for v in (*t.raw[i], *t.rotation[i], *t.rotation_sigma[i]))]


if __name__ == "__main__":
    pipeline.run(main)
