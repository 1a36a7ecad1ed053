"""What is measured: the cases, how a case falls into jobs for several processes, and the row of results.csv that its records make."""
import math
import os
from dataclasses import dataclass, field, replace

import numpy as np
from rimflow.vtkRIMFlowReaders import vtkSTBTrackReader, vtkSyntheticTracks
from vtkmodules.util.numpy_support import vtk_to_numpy
from vtkmodules.vtkCommonExecutionModel import vtkStreamingDemandDrivenPipeline

from clouds import SNAPSHOTS, Cloud, generator, stokes_source
from locate import PUBLISHED, VOID, Chain
from tracks import Series, particle_data

SOURCE = os.path.normpath(os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "..", ".."))
COLUMNS = ["study", "case", "value", "tracks", "method", "estimate", "snapshots", "found", "wrong", "extra", "blind", "blind_found", "mean_error", "largest_error",
           "stated_mean", "stated_largest", "chi2_per_dof", "chi2_largest", "within68", "within95", "grid_spacing_m"]
LIMIT68, LIMIT95 = 3.5059, 7.8147  # of the chi-squared with 3 degrees of freedom
WRONG = 0.5                        # diameters: a find farther from the centre is of something else
CHUNK = 25                         # snapshots per job
BLIND = 10                         # of a case's snapshots so many per hundred are searched without a guess
GUESS = 1e-3                       # the others start from a guess this far off per axis at most, m
SMALL = (36e-3, 36e-3, 25e-3)      # box of the clouds and of the Stokes flow for single snapshots, m
CFD = {"file": os.path.join("Examples", "demo", "sphere.dat.gz"), "diameter": 9.53e-3, "viscosity": 2.3825e-5, "time": 43.1395,
       "centre": np.array([1.7e-3, 0, -0.9e-3]), "velocity": 0.25 * np.array([-0.0734415, 0.9876883, 0.1381234])}  # Examples/demo/README.md


@dataclass(frozen=True)
class Case:
    study: str
    label: str
    value: float
    tracks: str               # "cloud", "Stokes": single snapshots that know nothing of each other; "Stokes series", "CFD series"
    method: str
    cloud: Cloud = field(default_factory=Cloud)
    snapshots: int = 1        # in all, or per series
    series: int = 1           # so many series (seeds, random parts of the tracks)
    spacing: float = 1.0      # of the published cost's grid over the default
    part: float = 1.0         # of the CFD tracks
    acceleration: tuple = (0.0, 0.0, 0.0)  # of the Stokes sphere, m/s2

    @property
    def name(self):
        """Of the snapshots: the same for both methods and in all studies."""
        return f"{self.cloud} {self.part} {self.acceleration}"

    @property
    def subject(self):
        """What is measured: the same in several studies, whose usual case it is."""
        return replace(self, study="", label="", value=0)

    @property
    def on_cfd(self):
        return self.tracks.startswith("CFD")

    @property
    def diameter(self):
        return CFD["diameter"] if self.on_cfd else self.cloud.diameter

    def chain(self, guess=None):
        return Chain(self.method, self.diameter, CFD["viscosity"] if self.on_cfd else 1.1e-6, guess)


def record(estimate, found, truth, scale, **more):
    """Estimates of one thing against the truth (None: there is nothing to find), in units of `scale`. Of several the nearest counts."""
    out = {"estimate": estimate, "error": None, "stated": None, "chi2": None, "extra": len(found), **more}
    if found and truth is not None:
        best = min(found, key=lambda f: np.linalg.norm(f.value - truth))
        e = best.value - truth
        out.update(error=np.linalg.norm(e) / scale, stated=np.sqrt(np.trace(best.covariance)) / scale,
                   chi2=float(e @ np.linalg.solve(best.covariance, e)), extra=len(found) - 1)
    return out


def single_snapshots(case, start, stop):
    """Snapshots start to stop of the case, each by itself; some without a guess."""
    records = []
    for i in range(start, stop):
        snapshot = SNAPSHOTS[case.tracks](case.cloud, case.name, i)
        blind = snapshot.centre is None or i % 100 < BLIND
        chain = case.chain(None if blind else snapshot.centre + GUESS * generator(case.name + " guess", i).uniform(-1, 1, 3))
        arrays = {} if snapshot.velocity is None else {"Velocity": snapshot.velocity, "Acceleration": snapshot.acceleration}
        chain.set_particles(particle_data(snapshot.x, **arrays))
        chain.scale_spacing(case.spacing)
        chain.update()
        records.append(record("single", chain.centres(), snapshot.centre, case.diameter, blind=blind, spacing=chain.spacing()))
    return records


def times_of(source):
    source.UpdateInformation()
    return list(source.GetOutputInformation(0).Get(vtkStreamingDemandDrivenPipeline.TIME_STEPS()))


def stokes_series(case, seed):
    """A source of tracks, and the true centre and velocity at a time."""
    random = generator(case.name, seed)
    source = stokes_source(case.cloud, int(random.integers(1, 2**31)), case.cloud.centre(random), case.snapshots)
    source.SetAcceleration(case.acceleration)
    source.SetDropOut(0.1)
    source.SetMinimumTrackLength(4)  # as of Shake-The-Box
    source.SetWakeDepletion(case.cloud.wake_depth)

    def truth(time):
        source.UpdateTimeStep(time)
        fields = source.GetOutput().GetFieldData()
        return [np.array(fields.GetArray(name).GetTuple3(0)) for name in ("TrueCentre", "TrueVelocity")]

    return source, truth


def cfd_series(case, seed):
    """The demo's tracks, or a random part of them: whole tracks."""
    reader = vtkSTBTrackReader()
    reader.AddFileName(os.path.join(SOURCE, CFD["file"]))
    times, snapshots = times_of(reader), []
    for t in times:
        reader.UpdateTimeStep(t)
        data = reader.GetOutput()
        snapshots.append([vtk_to_numpy(a).copy() for a in (data.GetPoints().GetData(), *(data.GetPointData().GetArray(n) for n in ("Velocity", "Acceleration", "TrackId")))])
    ids = np.unique(np.concatenate([s[3] for s in snapshots]))
    kept = ids[generator(case.name, seed).uniform(size=len(ids)) < case.part]

    def snapshot(i):
        x, u, a, track = snapshots[i]
        keep = np.isin(track, kept)
        return particle_data(x[keep].astype(float), Velocity=u[keep], Acceleration=a[keep])

    return Series(times, snapshot), lambda time: (CFD["centre"] + CFD["velocity"] * (time - CFD["time"]), CFD["velocity"])


def whole_series(case, seed):
    """All snapshots of a series as ProcessAllTimes visits them: each by itself, smoothed, and the velocity."""
    source, truth = (cfd_series if case.on_cfd else stokes_series)(case, seed)
    chain = case.chain()
    chain.connect(source)
    chain.scale_spacing(case.spacing)
    chain.locator.ProcessAllTimesOn()
    times = times_of(source)
    chain.update(times[0])
    smoothed, velocities = chain.trajectory()
    records = []
    for time in times:
        chain.update(time)
        centre, velocity = truth(time)
        at = lambda line: [e for t, e in line if abs(t - time) < 1e-6]
        records += [record("single", chain.centres(), centre, case.diameter, spacing=chain.spacing()),
                    record("smoothed", at(smoothed), centre, case.diameter), record("velocity", at(velocities), velocity, np.linalg.norm(velocity))]
    return records


def empty_series(case, seed):
    """Snapshots of a flow without a sphere; one locator sees them all, as a user's does."""
    source = vtkSyntheticTracks()
    source.SetFlow(vtkSyntheticTracks.TAYLOR_GREEN)
    source.SetBounds([s * side / 2 for side in case.cloud.box for s in (-1, 1)])
    source.SetNumberOfSnapshots(case.snapshots)
    source.SetDropOut(0.1)
    source.SetPositionNoise(case.cloud.noise)
    source.SetSeed(seed + 1)
    chain = case.chain()
    chain.connect(source)
    records = []
    for time in times_of(source):
        chain.update(time)
        records.append(record("single", chain.centres(), None, case.diameter, blind=True))
    return records


RUNS = {"cloud": single_snapshots, "Stokes": single_snapshots, "Stokes series": whole_series, "CFD series": whole_series, "Taylor-Green series": empty_series}


def jobs(cases):
    """(index of the case, arguments of its run), those that take longest first."""
    found = []
    for k, case in enumerate(cases):
        if RUNS[case.tracks] is single_snapshots:
            chunk = CHUNK if case.method == VOID else 1
            found += [(k, (i, min(i + chunk, case.snapshots))) for i in range(0, case.snapshots, chunk)]
        else:
            found += [(k, (seed,)) for seed in range(case.series)]
    return sorted(found, key=lambda job: cases[job[0]].method == VOID)


def row(case, records):
    """A line of results.csv: records of one case and one estimate. Wrong finds count for nothing but `wrong`."""
    limit = WRONG if records[0]["estimate"] != "velocity" else np.inf
    good = [r for r in records if r["error"] is not None and r["error"] <= limit]
    blind = [r for r in records if r.get("blind")]
    chi2 = np.array([r["chi2"] for r in good])
    values = [case.study, case.label, f"{case.value:g}", case.tracks, case.method, records[0]["estimate"], len(records), len(good),
              sum(r["error"] is not None and r["error"] > limit for r in records), sum(r["extra"] for r in records), len(blind), sum(r in good for r in blind)]
    if good:
        error, stated = (np.array([r[key] for r in good]) for key in ("error", "stated"))
        values += [f"{v:.5f}" for v in (error.mean(), error.max(), stated.mean(), stated.max())]
        values += [f"{chi2.mean() / 3:.3f}", f"{chi2.max():.1f}", f"{(chi2 <= LIMIT68).mean():.4f}", f"{(chi2 <= LIMIT95).mean():.4f}"]
    else:
        values += [""] * 8
    spacings = [r["spacing"] for r in records if r.get("spacing")]
    return dict(zip(COLUMNS, values + [f"{np.mean(spacings):.3g}" if spacings else ""]))


def rows(case, records):
    return [row(case, [r for r in records if r["estimate"] == e]) for e in dict.fromkeys(r["estimate"] for r in records)]


def all_cases(frames, slow):
    """Every case of the page. frames: single snapshots per case of the void likelihood; slow: of the published cost, which needs VIC# for each."""
    base = Cloud(box=SMALL)
    sheet = replace(base, sheet=6e-3)
    kinds = [("seeding", f"{n:g} per mm3", n, replace(base, density=n * 1e9)) for n in (0.05, 0.1, 0.2, 0.4, 0.8)]
    kinds += [("noise", f"{n} um", n, replace(base, noise=n * 1e-6)) for n in (0, 5, 10, 20, 40)]
    kinds += [("ghosts", f"{100 * g:g} %", 100 * g, replace(base, ghosts=g)) for g in (0, 0.005, 0.02, 0.05, 0.1)]
    kinds += [("wake depth", f"{100 * w:g} %, radius 0.8 R", 100 * w, replace(base, wake_depth=w)) for w in (0, 0.25, 0.5, 0.8, 0.95)]
    kinds += [("wake width", f"95 %, radius {w:g} R", w, replace(base, wake_depth=0.95, wake_width=w)) for w in (0.5, 0.65, 0.8, 0.9)]
    kinds += [("edge", f"{e:g} R inside a face" if e else "on a face", e, replace(base, edge=(e,))) for e in (1, 0.75, 0.5, 0.25, 0.1, 0)]
    kinds += [("corner", f"0 to R from {n} faces", n, replace(base, edges=n)) for n in (2, 3)]
    kinds += [("light sheet", f"sheet of 6 mm, {1e3 * z:g} mm off its middle", 1e3 * z, replace(sheet, sheet_offset=z)) for z in (0, 4e-3, 8e-3)]
    kinds += [("thin side", f"in one half {100 * t:g} % of that in the other", 100 * t, replace(base, thin_side=t)) for t in (0.5, 0.2)]
    kinds += [("diameter", f"{d:g} mm", d, replace(base, diameter=d * 1e-3)) for d in (7.93, 9.53, 11.11)]
    cases = [Case(study, label, value, "cloud", VOID, cloud, frames) for study, label, value, cloud in kinds]

    both = {("seeding", 0.1), ("seeding", 0.2), ("seeding", 0.4), ("seeding", 0.8), ("noise", 0), ("noise", 20), ("noise", 40), ("ghosts", 0), ("ghosts", 2), ("ghosts", 10),
            ("wake depth", 50), ("wake depth", 95), ("edge", 1), ("edge", 0.5), ("edge", 0), ("diameter", 7.93), ("diameter", 9.53), ("diameter", 11.11)}
    cases += [Case(study, label, value, "Stokes", method, cloud, slow) for study, label, value, cloud in kinds if (study, value) in both for method in (VOID, PUBLISHED)]
    cases += [Case("grid", f"{h:g} of the default spacing", h, "Stokes", PUBLISHED, base, slow, spacing=h) for h in (0.5, 0.75, 1, 1.25, 1.5)]
    cases += [Case("grid", f"{h:g} of the default spacing", h, "CFD series", PUBLISHED, spacing=h) for h in (0.75, 1, 1.25, 1.5)]

    empty = replace(base, sphere=False)
    none = [("uniform", empty), ("clustered", replace(empty, background="clustered")), ("light sheet of 6 mm", replace(empty, sheet=6e-3)),
            ("vortex cores", replace(empty, background="vortex cores")), ("elliptic beam", replace(empty, background="rounded")),
            ("0.05 per mm3", replace(empty, density=0.05e9)), ("0.1 per mm3", replace(empty, density=0.1e9))]
    cases += [Case("no sphere", label, math.nan, "cloud", VOID, cloud, frames) for label, cloud in none]
    cases.append(Case("no sphere", "Taylor-Green flow", math.nan, "Taylor-Green series", VOID, empty, 40, series=max(frames // 40, 1)))

    path = replace(base, box=(40e-3, 44e-3, 25e-3))
    series = [("0.4 per mm3, 5 um", path, {}), ("20 um", replace(path, noise=20e-6), {}), ("2 % ghosts", replace(path, ghosts=0.02), {}),
              ("wake depleted by 80 %", replace(path, wake_depth=0.8), {}), ("0.1 per mm3", replace(path, density=0.1e9), {}),
              ("0.05 per mm3", replace(path, density=0.05e9), {}), ("accelerating by 2 m/s2", path, {"acceleration": (0.5, 1.9, -0.4)})]
    cases += [Case("series", label, math.nan, "Stokes series", VOID, cloud, 40, series=3, **more) for label, cloud, more in series]
    cases.append(Case("series", series[0][0], math.nan, "Stokes series", PUBLISHED, path, 10))
    cases += [Case("part of the tracks", f"{part:g} of the demo's tracks", part, "CFD series", VOID, series=1 if part == 1 else 5, part=part) for part in (1, 0.5, 0.25, 0.1)]
    cases += [Case("part of the tracks", f"{part:g} of the demo's tracks", part, "CFD series", PUBLISHED, part=part) for part in (1, 0.5, 0.25)]
    return cases
