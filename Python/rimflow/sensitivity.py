"""`rimflow sensitivity`: how far the found centre moves when the method's parameters and the data change a little.

The studies are those of section "Detection Metrics and Sensitivity Analysis" of Jose et al. (2025), with their limits, and for the void
likelihood those of them that apply to it, with a fifth of these limits. The flow of a snapshot is reconstructed once; then the locator
runs on the same snapshots for every variation, in the order of time, as in a recording. Runs under pvbatch.
"""
import itertools
import os
import platform
import time
from dataclasses import dataclass, field

import numpy as np
from vtkmodules.util.numpy_support import vtk_to_numpy
from vtkmodules.util.vtkAlgorithm import VTKPythonAlgorithmBase
from vtkmodules.vtkCommonDataModel import vtkDataObject, vtkImageData, vtkPolyData
from vtkmodules.vtkCommonExecutionModel import vtkStreamingDemandDrivenPipeline as Pipeline

from rimflow import files, options as command_line, pipeline
from rimflow.options import UsageError
from rimflow.progress import ProgressBar
from rimflow.vtkRIMFlowFilters import vtkInvisibleSphereLocator

LIKELIHOOD, PUBLISHED = "likelihood", "published"
PUBLISHED_WEIGHTS = (3.077, 4.415)
# Table "tab:uncertainties" of the paper: diameter [m], mean and largest deviation [d]
PUBLISHED_UNCERTAINTY = ((7.93e-3, 0.011, 0.081), (9.53e-3, 0.012, 0.077), (11.11e-3, 0.007, 0.040))
SEEDS = (1, 2, 3)

COLUMNS = ("method,study,variation,snapshots,found,converged,mean_shift_d,max_shift_d,drift_d,drift_sigma_d,expected_shift_d,"
           "limit_mean_d,limit_max_d,published_mean_d,published_max_d,holds").split(",")
WEIGHT_COLUMNS = "w1,w2,snapshots,found,converged_share,jitter_d,mean_shift_d,to_likelihood_d,retained,chosen".split(",")
SNAPSHOT_COLUMNS = ("method,snapshot,time_s,found,converged,x_m,y_m,z_m,sigma_x_m,sigma_y_m,sigma_z_m,cost,gradient_norm_1_m,iterations,"
                    "particles_inside,offset_void_d,offset_velocity_d,offset_vortex_d,status_text").split(",")


class Series(VTKPythonAlgorithmBase):
    """Data sets by time, kept in memory, as the source of a pipeline."""

    def __init__(self, times, data):
        super().__init__(nInputPorts=0, nOutputPorts=1, outputType=data[0].GetClassName())
        self.times, self.data = list(times), data

    def RequestInformation(self, request, inputs, outputs):
        info = outputs.GetInformationObject(0)
        info.Set(Pipeline.TIME_STEPS(), self.times, len(self.times))
        info.Set(Pipeline.TIME_RANGE(), [self.times[0], self.times[-1]], 2)
        if isinstance(self.data[0], vtkImageData):
            info.Set(Pipeline.WHOLE_EXTENT(), self.data[0].GetExtent(), 6)
            info.Set(vtkDataObject.SPACING(), self.data[0].GetSpacing(), 3)
            info.Set(vtkDataObject.ORIGIN(), self.data[0].GetOrigin(), 3)
        return 1

    def RequestData(self, request, inputs, outputs):
        info = outputs.GetInformationObject(0)
        wanted = info.Get(Pipeline.UPDATE_TIME_STEP()) if info.Has(Pipeline.UPDATE_TIME_STEP()) else self.times[0]
        k = int(np.argmin(np.abs(np.array(self.times) - wanted)))
        output = info.Get(vtkDataObject.DATA_OBJECT())
        output.ShallowCopy(self.data[k])
        output.GetInformation().Set(vtkDataObject.DATA_TIME_STEP(), self.times[k])
        return 1


@dataclass
class Track:
    """What the locator said of every snapshot; arrays over the snapshots, SI, NaN where nothing was found."""
    centre: np.ndarray         # (n, 3)
    covariance: np.ndarray     # (n, 6): xx yy zz xy yz xz
    cost: np.ndarray
    gradient_norm: np.ndarray  # 1/m
    offsets: np.ndarray        # (n, 3): of the void's, the velocity's and the vortices' own minimiser, m; NaN: not computed
    iterations: np.ndarray
    particles_inside: np.ndarray
    texts: list

    @property
    def found(self):
        return np.isfinite(self.centre[:, 0])

    @property
    def converged(self):
        """Found, at a minimum (not at the largest number of iterations), and with a positive definite Hessian."""
        return self.found & np.array(["largest number" not in t and "not positive definite" not in t for t in self.texts])

    @property
    def sigma(self):
        return np.sqrt(self.covariance[:, :3])

    @classmethod
    def of(cls, records):
        get = lambda name, otherwise: np.array([r.get(name, otherwise) for r in records], float)
        offsets = np.stack([get(f"offset_{c}_m", -1.0) for c in ("void", "velocity", "vortex")], axis=1)
        return cls(get("centre_m", [np.nan] * 3), get("covariance_m2", [np.nan] * 6), get("cost", np.nan), get("gradient_norm", np.nan),
                   np.where(offsets < 0, np.nan, offsets), get("iterations", 0).astype(int), get("particles_inside", -1).astype(int),
                   [r["status_text"] for r in records])


@dataclass
class Recording:
    """The snapshots that are studied."""
    times: list
    particles: list
    flows: list          # None where no study needs them
    diameter: float
    up: tuple
    first_guess: np.ndarray = None  # for the first snapshot; None: the whole volume is searched

    def locate(self, method, particles=None, flows=None, guesses=None, **properties):
        """A fresh locator, with these properties, on all snapshots in the order of time. Without guesses a snapshot says where to look in
        the next, and first_guess in the first; with guesses (n, 3) each stands for itself."""
        series = [Series(self.times, particles or self.particles)]
        if method == PUBLISHED:
            series.append(Series(self.times, flows or self.flows))
        errors, records, locator = pipeline.Errors(), [], None
        for k, moment in enumerate(self.times):
            if locator is None or guesses is not None:
                locator = vtkInvisibleSphereLocator()
                for port, source in enumerate(series):
                    locator.SetInputConnection(port, source.GetOutputPort())
                locator.SetDiameter(self.diameter)
                locator.SetUpDirection(*self.up)
                locator.SetMethod(locator.PUBLISHED_COST if method == PUBLISHED else locator.VOID_LIKELIHOOD)
                for name, value in properties.items():
                    getattr(locator, "Set" + name)(value)
                guess = self.first_guess if guesses is None else guesses[k]
                if guess is not None:
                    locator.UseInitialGuessOn()
                    locator.SetInitialGuess(*guess)
                errors.watch(locator)
            locator.UpdateTimeStep(moment)
            try:
                errors.check()
                records.append(pipeline.located(locator.GetOutputDataObject(1)))
            except pipeline.PipelineError as error:  # this snapshot is lost, the others are not
                records.append({"status": 2, "status_text": str(error)})
        return Track.of(records)


# What the variations are compared by ------------------------------------------------------------------------------------------------


def shifts(track, baseline, diameter):
    """Distance from the baseline per snapshot, in diameters; NaN where one of the two is not found."""
    return np.linalg.norm(track.centre - baseline.centre, axis=1) / diameter


def drift(times, track, baseline, diameter):
    """How far the shift from the baseline grows over the recording, in diameters, and the standard deviation of that: the slope of a
    straight line through each component of the shift, times the duration."""
    both = track.found & baseline.found
    if both.sum() < 3:
        return np.nan, np.nan
    t = np.array(times)[both]
    t = (t - t.mean()) / np.ptp(t)
    shift = (track.centre - baseline.centre)[both] / diameter
    slope = t @ shift / (t @ t)
    residual = shift - shift.mean(0) - np.outer(t, slope)
    sigma = np.sqrt((residual ** 2).sum() / (len(t) - 2) / (t @ t))
    return float(np.linalg.norm(slope)), float(sigma)


def jitter(times, track, reference, diameter):
    """Frame-to-frame jitter per component, in diameters: rms distance of the centre from the straight line between its two neighbours in
    time, over the factor by which that line adds scatter, so that independent errors of standard deviation s give s.

    The sphere's own motion is taken out first by subtracting `reference`, the void likelihood's centre of the same snapshot: neither a
    curved path nor snapshots that are far apart count as jitter. (The reference's own scatter, some thousandths of d, is in it.)
    """
    both = np.flatnonzero(track.found & reference.found)
    t, x = np.array(times)[both], (track.centre - reference.centre)[both] / diameter
    if len(t) < 3:
        return np.nan
    left = (t[2:] - t[1:-1]) / (t[2:] - t[:-2])  # weight of the earlier neighbour
    bend = x[1:-1] - left[:, None] * x[:-2] - (1 - left)[:, None] * x[2:]
    return float(np.sqrt(np.mean(bend ** 2 / (1 + left ** 2 + (1 - left) ** 2)[:, None])))


@dataclass
class Limit:
    """Largest allowed mean and single shift, in diameters; the published ones and those that are asked of this method."""
    published_mean: float = None
    published_max: float = None
    mean: float = None
    max: float = None

    @classmethod
    def published(cls, mean, most=None):
        return cls(mean, most, mean, most)


@dataclass
class Row:
    """One line of sensitivity.csv."""
    method: str
    study: str
    variation: str
    snapshots: int
    found: int
    converged: int
    mean: float
    max: float
    drift: float = np.nan
    drift_sigma: float = np.nan
    expected: float = np.nan
    limit: Limit = field(default_factory=Limit)
    shift: np.ndarray = None  # per snapshot

    @property
    def holds(self):
        """Whether the row keeps its limit; '' without a limit. A lost snapshot keeps none."""
        if self.limit.mean is None and self.limit.max is None:
            return ""
        fine = self.found == self.snapshots and all(limit is None or value <= limit
                                                    for value, limit in ((self.mean, self.limit.mean), (self.max, self.limit.max)))
        return "yes" if fine else "no"

    def values(self):
        numbers = [self.mean, self.max, self.drift, self.drift_sigma, self.expected]
        limits = [self.limit.mean, self.limit.max, self.limit.published_mean, self.limit.published_max]
        return [self.method, self.study, self.variation, self.snapshots, self.found, self.converged,
                *("" if v is None or not np.isfinite(v) else f"{v:.6g}" for v in numbers),
                *("" if v is None else f"{v:g}" for v in limits), self.holds]


# The data, changed --------------------------------------------------------------------------------------------------------------------


def rms(vectors):
    """Root mean square per component."""
    return float(np.sqrt(np.mean(np.square(vectors, dtype=float))))


def noisy_flow(flow, share, random):
    """The flow with Gaussian noise on Velocity and QCriterion: per node and component, `share` of the field's rms."""
    copy = flow.NewInstance()
    copy.ShallowCopy(flow)
    for name in ("Velocity", "QCriterion"):
        values = vtk_to_numpy(flow.GetPointData().GetArray(name))
        noise = random.normal(0, share * rms(values), values.shape)
        pipeline.add_array(copy.GetPointData(), name, (values + noise).astype(np.float32))
    return copy


def changed_particles(particles, keep=None, position_noise=0.0, velocity_noise=0.0, random=None):
    """The particles for which `keep` is true, with Gaussian noise on positions (m) and velocities (m/s), per component."""
    position = vtk_to_numpy(particles.GetPoints().GetData())
    keep = np.ones(len(position), bool) if keep is None else keep
    moved = position[keep] + (random.normal(0, position_noise, (int(keep.sum()), 3)) if position_noise else 0)
    copy = vtkPolyData()
    copy.SetPoints(pipeline.vtk_points(moved.astype(np.float32)))
    velocity = particles.GetPointData().GetArray("Velocity")
    if velocity:
        values = vtk_to_numpy(velocity)[keep]
        if velocity_noise:
            values = values + random.normal(0, velocity_noise, values.shape)
        pipeline.add_array(copy.GetPointData(), "Velocity", values.astype(np.float32))
    return copy


def mean_spacing(particles):
    """Mean distance between particles, m: the cube root of the volume per particle; the box of the middle 99.9 % per axis."""
    position = vtk_to_numpy(particles.GetPoints().GetData())
    return float(np.cbrt(np.prod(np.quantile(position, 0.9995, axis=0) - np.quantile(position, 0.0005, axis=0)) / max(1, len(position))))


# The studies ----------------------------------------------------------------------------------------------------------------------------


class Study:
    """All variations of one method against its baseline."""

    def __init__(self, recording, method, frame_period, on_run):
        self.recording, self.method, self.frame_period, self.on_run = recording, method, frame_period, on_run
        self.rows, self.d = [], recording.diameter
        self.baseline = self.run()
        self.add("baseline", "all as set", self.baseline)

    def run(self, **changes):
        track = self.recording.locate(self.method, **changes)
        self.on_run()
        return track

    def add(self, study, variation, track, limit=None, expected=np.nan):
        shift = shifts(track, self.baseline, self.d)
        known = np.isfinite(shift)
        self.rows.append(Row(self.method, study, variation, len(shift), int(track.found.sum()), int(track.converged.sum()),
                             float(shift[known].mean()) if known.any() else np.nan, float(shift[known].max()) if known.any() else np.nan,
                             *drift(self.recording.times, track, self.baseline, self.d), expected, limit or Limit(), shift))

    def vary(self, study, variation, limit, expected=np.nan, **changes):
        self.add(study, variation, self.run(**changes), limit, expected)

    def guess(self, limit):
        """Every snapshot by itself, from a guess 0.1 d away from what the baseline found."""
        start = np.where(self.baseline.found[:, None], self.baseline.centre, 0.0)
        for axis, sign in itertools.product(range(3), (-1, 1)):
            offset = np.zeros(3)
            offset[axis] = 0.1 * self.d * sign
            self.vary("guess", f"0.1 d off along {'-+'[sign > 0]}{'xyz'[axis]}", limit, guesses=start + offset)

    def search(self, limit):
        for factor in (0.75, 1.25):
            self.vary("search", f"R_search {factor:g} d", limit, SearchRadius=0.5 * factor * self.d)


def published_studies(s, wanted):
    """The published cost function under the published studies."""
    spacing = float(np.mean(s.recording.flows[0].GetSpacing()))
    w1, w2 = PUBLISHED_WEIGHTS
    if "step" in wanted:
        for factor in (0.25, 0.4, 0.55, 0.7, 0.85, 1.1):
            s.vary("step", f"{factor:g} grid spacings", Limit.published(0.005, 0.096), FiniteDifferenceStep=factor * spacing)
    if "weights" in wanted:
        for f1, f2 in ((0.9, 1), (1.1, 1), (1, 0.9), (1, 1.1), (0.9, 0.9), (0.9, 1.1), (1.1, 0.9), (1.1, 1.1)):
            changed = [f"w{i} {100 * (f - 1):+.0f} %" for i, f in ((1, f1), (2, f2)) if f != 1]
            s.vary("weights", ", ".join(changed), Limit.published(0.05), WeightVelocity=f1 * w1, WeightVortex=f2 * w2)
    if "shells" in wanted:
        # a shell from b = 2 to c = 2 is empty, so b ends before it
        for name, values in (("a", (1.2, 1.3, 1.5)), ("b", (1.6, 1.75, 1.9)), ("c", (2.25, 2.5, 3)), ("e", (2, 2.25, 2.75, 3))):
            for value in values:
                s.vary("shells", f"{name} = {value:g}", Limit.published(0.05), **{"Shell" + name.upper(): value})
    if "search" in wanted:
        s.search(Limit(mean=0.001))  # published as "negligible", without a number
    if "guess" in wanted:
        s.guess(Limit())
    if "noise" in wanted:
        for seed in SEEDS:
            random = np.random.default_rng(seed)
            s.vary("noise", f"10 % rms on velocity and Q, seed {seed}", Limit.published(0.03),
                   flows=[noisy_flow(f, 0.1, random) for f in s.recording.flows])
    b = s.baseline
    for i, name in enumerate(("void density", "velocity", "vortices")):
        offset = b.offsets[:, i] / s.d
        s.rows.append(Row(s.method, "single criterion", name, len(offset), int(b.found.sum()), int(b.converged.sum()), _mean(offset),
                          _max(offset), limit=Limit.published(0.05), shift=offset))
    s.rows.append(uncertainty_row(s, b.converged))


def likelihood_studies(s, wanted):
    """The void likelihood under those that apply to it, with a fifth of the published limits."""
    r, d = s.recording, s.d
    numerical = Limit(mean=0.001, max=0.0192)  # a fifth of the step's; the paper has no number for search and guess
    model = Limit(0.05, None, 0.01)
    noise, dropped = Limit(0.03, None, 0.006), Limit(mean=0.006)
    if "search" in wanted:
        s.search(numerical)
    if "guess" in wanted:
        s.guess(numerical)
    if "model" in wanted:
        r0 = mean_spacing(r.particles[len(r.particles) // 2])
        for part in (400, 100):
            s.vary("model", f"position noise {1e6 * r0 / part:.1f} um", model, PositionNoise=r0 / part)
        for rate in (0.0025, 0.01, 0.02):
            s.vary("model", f"ghost rate {100 * rate:g} %", model, GhostRate=rate)
    if "noise" in wanted:
        u = rms(np.concatenate([vtk_to_numpy(p.GetPointData().GetArray("Velocity")) for p in r.particles])) if all(
            p.GetPointData().GetArray("Velocity") for p in r.particles) else 0.0
        # the positions whose differences over a frame have that noise
        own = 0.1 * u * s.frame_period / np.sqrt(2)
        for name, position in (("10 % rms on velocity", own), ("0.001 d on positions", 1e-3 * d)):
            for seed in SEEDS:
                random = np.random.default_rng(seed)
                s.vary("noise", f"{name} ({1e6 * position:.1f} um), seed {seed}", noise,
                       particles=[changed_particles(p, None, position, 0.1 * u, random) for p in r.particles])
    if "drop" in wanted:
        # a bound by the nearest particles: its error goes as 1/n, so 1/0.9^2 - 1 of the variance is new
        expected = np.sqrt(1 / 0.9 ** 2 - 1) * _mean(np.linalg.norm(s.baseline.sigma, axis=1)) / d
        for seed in SEEDS:
            random = np.random.default_rng(seed)
            s.vary("drop", f"10 % of the particles, seed {seed}", dropped, expected,
                   particles=[changed_particles(p, random.random(p.GetNumberOfPoints()) >= 0.1) for p in r.particles])
    s.rows.append(uncertainty_row(s, s.baseline.found))


def uncertainty_row(s, known):
    """The stated standard deviation per component, beside the paper's for the nearest diameter."""
    nearest = min(PUBLISHED_UNCERTAINTY, key=lambda row: abs(row[0] - s.d))
    sigma = s.baseline.sigma[known] / s.d
    b = s.baseline
    return Row(s.method, "stated uncertainty", "standard deviation per axis", len(b.found), int(b.found.sum()), int(b.converged.sum()),
               _mean(sigma), _max(sigma), limit=Limit(nearest[1], nearest[2], nearest[1], nearest[2]),
               shift=np.where(known, b.sigma.mean(1) / s.d, np.nan))


def _mean(values):
    return float(np.nanmean(values)) if np.isfinite(values).any() else np.nan


def _max(values):
    return float(np.nanmax(values)) if np.isfinite(values).any() else np.nan


# Weights --------------------------------------------------------------------------------------------------------------------------------

WEIGHT_FACTORS = (0.25, 0.5, 1, 2, 4)  # of the published weights


@dataclass
class Calibration:
    """The published cost over a grid of weights; arrays (w1, w2)."""
    w1: np.ndarray
    w2: np.ndarray
    converged: np.ndarray  # share of the snapshots
    found: np.ndarray
    jitter: np.ndarray     # d
    shift: np.ndarray      # mean distance from the baseline (the published weights), d
    distance: np.ndarray   # mean distance from the void likelihood's centre, d
    retained: np.ndarray   # bool
    chosen: tuple          # indices, or None


def calibrate(s, reference):
    """Every pair of weights on the grid: how many snapshots converge, and how steadily?"""
    w1, w2 = (np.array([f * w for f in WEIGHT_FACTORS]) for w in PUBLISHED_WEIGHTS)
    shape = (len(w1), len(w2))
    converged, found, steadiness, shift, distance = (np.full(shape, np.nan) for _ in range(5))
    for i, j in itertools.product(range(shape[0]), range(shape[1])):
        track = s.run(WeightVelocity=w1[i], WeightVortex=w2[j])
        converged[i, j], found[i, j] = track.converged.mean(), track.found.sum()
        steadiness[i, j] = jitter(s.recording.times, track, reference, s.d)
        shift[i, j] = _mean(shifts(track, s.baseline, s.d))
        distance[i, j] = _mean(shifts(track, reference, s.d))
    return Calibration(w1, w2, converged, found, steadiness, shift, distance, *choose_weights(converged, steadiness))


def choose_weights(converged, steadiness):
    """Retained: the pairs with as many converged snapshots as any pair has, whose jitter, averaged over the pair and its neighbours on the
    grid, is at most 1.25 times the least such average. Chosen: that with the least. The average keeps a lucky spot from being chosen."""
    best = (converged == converged.max()) & (converged > 0) & np.isfinite(steadiness)
    around = np.full(best.shape, np.inf)
    for i, j in zip(*np.nonzero(best)):
        around[i, j] = np.nanmean(steadiness[max(0, i - 1):i + 2, max(0, j - 1):j + 2])
    chosen = tuple(int(k) for k in np.unravel_index(np.argmin(around), best.shape)) if best.any() else None
    return best & (around <= 1.25 * around.min()), chosen


# The command ------------------------------------------------------------------------------------------------------------------------------


def main(arguments):
    """Runs the command; returns the exit status."""
    return pipeline.answered("sensitivity", lambda: Run(command_line.parse_sensitivity(arguments)).execute())


class Run:
    def __init__(self, options):
        self.options, self.clock, self.started = options, time.monotonic(), time.strftime("%Y-%m-%d %H:%M:%S")
        self.methods = [LIKELIHOOD, PUBLISHED] if options.method == "both" else [options.method]
        self.chain = pipeline.Chain(options)
        self.times = self.chain.times()
        selected = sorted(range(len(self.times))[options.steps])
        if len(selected) < 3:
            raise UsageError(f"--steps selects {len(selected)} of the {len(self.times)} snapshots in {options.tracks[0]}; give 3 or more")
        spread = np.linspace(0, len(selected) - 1, min(options.snapshots, len(selected)))
        self.snapshots = [selected[int(round(k))] for k in spread]

    def execute(self):
        from rimflow.sensitivity_report import write_report

        recording = self.read()
        period = float(np.median(np.diff(self.times))) if len(self.times) > 1 else 0.0
        tracks, rows, calibration = {}, [], None
        bar = ProgressBar("variations", self.count_runs())
        done = itertools.count(1)
        on_run = lambda: bar.show(next(done))
        reference = Study(recording, LIKELIHOOD, period, on_run)  # cheap, and the calibration's reference
        self.require_a_find(reference.baseline)
        if reference.baseline.found[0]:  # so that not every variation has to search the whole volume
            recording.first_guess = reference.baseline.centre[0]
        if LIKELIHOOD in self.methods:
            likelihood_studies(reference, self.options.studies)
            tracks[LIKELIHOOD], rows = reference.baseline, rows + reference.rows
        if PUBLISHED in self.methods:
            study = Study(recording, PUBLISHED, period, on_run)
            self.require_a_find(study.baseline)
            published_studies(study, self.options.studies)
            tracks[PUBLISHED], rows = study.baseline, rows + study.rows
            if "calibration" in self.options.studies:
                calibration = calibrate(study, reference.baseline)
        run = self.write(recording, rows, tracks, calibration)
        write_report(os.path.join(self.options.out, "report"), run, rows, tracks, calibration, recording)
        self.say(rows, calibration)

    def require_a_find(self, baseline):
        if not baseline.found.any():
            raise UsageError(f"the sphere was found in none of the {len(self.snapshots)} snapshots: {baseline.texts[0]}")

    def count_runs(self):
        likelihood = {"search": 2, "guess": 6, "model": 5, "noise": 6, "drop": 3}
        published = {"step": 6, "weights": 8, "shells": 13, "search": 2, "guess": 6, "noise": 3, "calibration": len(WEIGHT_FACTORS) ** 2}
        counts = {LIKELIHOOD: likelihood, PUBLISHED: published}
        return 1 + (PUBLISHED in self.methods) + sum(counts[m].get(study, 0) for m in self.methods for study in self.options.studies)

    def read(self):
        """The particles of every snapshot and, for the published method, the flow around them."""
        flow = PUBLISHED in self.methods
        bar, particles, flows = ProgressBar("flow" if flow else "particles", len(self.snapshots)), [], []
        for done, k in enumerate(self.snapshots):
            bar.show(done)
            snapshot = self.chain.snapshot(self.times[k], flow)
            particles.append(snapshot[0])
            flows.append(snapshot[1])
        bar.show(len(self.snapshots))
        return Recording([self.times[k] for k in self.snapshots], particles, flows, self.options.diameter, self.options.up or (0, 0, 0))

    def write(self, recording, rows, tracks, calibration):
        out, d = self.options.out, self.options.diameter
        os.makedirs(out, exist_ok=True)
        files.write_csv(os.path.join(out, "sensitivity.csv"), COLUMNS, [row.values() for row in rows])
        table = []
        for method, t in tracks.items():
            for k, snapshot in enumerate(self.snapshots):
                numbers = [*t.centre[k], *t.sigma[k], t.cost[k], t.gradient_norm[k]]
                table.append([method, snapshot, repr(recording.times[k]), int(t.found[k]), int(t.converged[k]), *(f"{v:.10g}" for v in numbers),
                              t.iterations[k], t.particles_inside[k], *(f"{v / d:.6g}" for v in t.offsets[k]), t.texts[k]])
        files.write_csv(os.path.join(out, "snapshots.csv"), SNAPSHOT_COLUMNS, table)
        if calibration:
            files.write_csv(os.path.join(out, "weights.csv"), WEIGHT_COLUMNS, weight_rows(calibration, len(self.snapshots)))
        o = self.options
        run = {
            "settings": {"tracks": o.tracks, "diameter_m": d, "viscosity_m2_s": o.viscosity, "spacing_m": o.spacing,
                         "up": list(o.up) if o.up else None, "methods": self.methods, "studies": o.studies,
                         "snapshots": self.snapshots, "frame_period_s": o.frame_period},
            "versions": {"rimflow": pipeline.version(), "paraview": pipeline.paraview_version(), "vtk": pipeline.vtk_version(),
                         "python": platform.python_version(), "numpy": np.__version__},
            "grid_spacing_m": [float(v) for v in recording.flows[0].GetSpacing()] if recording.flows[0] else None,
            "chosen_weights": chosen_weights(calibration), "chosen_weights_on_edge": on_edge(calibration),
            "cost": {method: spread(t.cost) for method, t in tracks.items()},
            "gradient_norm_1_m": {method: spread(t.gradient_norm) for method, t in tracks.items()},
            "started": self.started, "seconds": round(time.monotonic() - self.clock, 3),
        }
        files.write_json(os.path.join(out, "run.json"), run)
        return run

    def say(self, rows, calibration):
        for method in self.methods:
            judged = [r for r in rows if r.method == method and r.holds]
            print(f"{method}: {sum(r.holds == 'yes' for r in judged)} of {len(judged)} variations keep their limits")
        if calibration:
            chosen = chosen_weights(calibration)
            print(f"weights: w1 = {chosen[0]:.4g}, w2 = {chosen[1]:.4g} converge most steadily" + ("; they lie on the edge of the grid that was searched" if on_edge(calibration) else "")
                  if chosen else "weights: no pair on the grid converges in any snapshot")
        print(f"See {os.path.join(self.options.out, 'report', 'index.html')}")


def spread(values):
    """Mean and variability over the snapshots; None where nothing is known."""
    known = values[np.isfinite(values)]
    return {name: float(f(known)) for name, f in (("mean", np.mean), ("std", np.std), ("min", np.min), ("max", np.max))} if len(known) else None


def chosen_weights(calibration):
    if not calibration or not calibration.chosen:
        return None
    i, j = calibration.chosen
    return [float(calibration.w1[i]), float(calibration.w2[j])]


def on_edge(calibration):
    """Whether the chosen weights lie on the grid's edge, which does not show where their region ends."""
    return bool(calibration and calibration.chosen and any(k in (0, n - 1) for k, n in zip(calibration.chosen, calibration.retained.shape)))


def weight_rows(c, snapshots):
    for i, j in itertools.product(range(len(c.w1)), range(len(c.w2))):
        yield [f"{c.w1[i]:.6g}", f"{c.w2[j]:.6g}", snapshots, int(c.found[i, j]), f"{c.converged[i, j]:.4g}", f"{c.jitter[i, j]:.6g}",
               f"{c.shift[i, j]:.6g}", f"{c.distance[i, j]:.6g}", int(c.retained[i, j]), int((i, j) == c.chosen)]


if __name__ == "__main__":
    pipeline.run(main)
