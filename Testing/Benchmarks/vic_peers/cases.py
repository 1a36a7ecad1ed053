"""One case: tracks at one instant, a grid, and what is true on its nodes."""
import numpy as np

import flows
from grids import Nodes, curl, divergence_ratio, gradient, rms

NEAR = 1.5  # "near" the wall: up to so many grid spacings


class Case:
    """Tracks x, u, a (with noise), the nodes to fill, and the truth on the window of nodes that peers are asked for.

    The window holds the nodes that are judged, at least one particle spacing r from the faces of the particles' box, and two more
    on each side for differences.
    """

    def __init__(self, name, x, u, a, r, nodes, box, viscosity, truth, mean=(0, 0, 0), body=None):
        self.name, self.x, self.u, self.a, self.r = name, x, u, a, r
        self.nodes, self.viscosity, self.body, self.mean = nodes, viscosity, body, np.asarray(mean, float)
        places = nodes.places()
        box = np.asarray(box, float).reshape(3, 2)
        inner = np.all((places >= box[:, 0] + r * (1 - 1e-9)) & (places <= box[:, 1] - r * (1 - 1e-9)), axis=-1)
        if not inner.any():
            raise ValueError(f"{name}: the box has no node one particle spacing ({r:g} m) from its faces")
        index = np.argwhere(inner)
        low, high = np.maximum(index.min(0) - 2, 0), np.minimum(index.max(0) + 3, nodes.shape)
        self.window = tuple(slice(*p) for p in zip(low, high))
        self.part = nodes.part(low, high)
        self.truth_u, self.truth_a, self.truth_w = (t[self.window] for t in truth(places))
        if body:
            self.distance = np.linalg.norm(self.part.places() - body["centre"], axis=-1) - body["diameter"] / 2
            self.fluid = self.distance > 0
        else:
            self.distance, self.fluid = None, np.ones(self.part.shape, bool)
        self.chosen = inner[self.window] & self.fluid & np.isfinite(self.truth_w).all(-1) & np.isfinite(self.truth_u).all(-1)

    def regions(self):
        if self.body is None:
            return {"all": self.chosen}
        limit = NEAR * self.nodes.spacing
        return {"near": self.chosen & (self.distance <= limit), "far": self.chosen & (self.distance > limit)}

    def prepare(self, result):
        """Adds the derivatives that a method does not give itself: of second and fourth order, never across the wall."""
        g = {order: gradient(result.velocity, self.part.spacing, self.fluid & np.isfinite(result.velocity).all(-1), order) for order in (2, 4)}
        result.gradients = g
        result.vorticities = {0: result.vorticity} if result.vorticity is not None else {order: curl(g[order]) for order in g}
        finite = np.isfinite(result.velocity).all(-1)
        for w in result.vorticities.values():
            finite &= np.isfinite(w).all(-1)
        if result.acceleration is not None:
            finite &= np.isfinite(result.acceleration).all(-1)
        result.finite = finite
        return result

    def errors(self, result, region):
        """rms error over rms value on the region's nodes; the vorticity of the order that is truer."""
        def relative(value, truth, mean=0):
            return rms(value[region] - truth[region]) / rms(truth[region] - mean)

        vorticity = {order: relative(w, self.truth_w) for order, w in result.vorticities.items()}
        best = min(vorticity, key=vorticity.get)
        return {"velocity": relative(result.velocity, self.truth_u, self.mean), "vorticity": vorticity[best], "order": best,
                "vorticity_order2": vorticity.get(2, vorticity[best]),
                "acceleration": relative(result.acceleration, self.truth_a) if result.acceleration is not None else np.nan,
                "divergence": divergence_ratio(result.gradients[2], region), "divergence_order4": divergence_ratio(result.gradients[4], region)}


def add_noise(case_u, case_a, noise, reference_u, reference_a, seed):
    """`noise` of the rms velocity per component, and four times that part of the rms acceleration."""
    random = np.random.default_rng([seed, 7])
    return (case_u + noise * reference_u * random.standard_normal(case_u.shape),
            case_a + 4 * noise * reference_a * random.standard_normal(case_a.shape))


_random_flows = {}


def random_flow(seed, kmax):
    if (seed, kmax) not in _random_flows:
        _random_flows.clear()  # one at a time: each takes 300 MB
        _random_flows[seed, kmax] = flows.RandomFlow(kmax=kmax, seed=seed)
    return _random_flows[seed, kmax]


def truth_of(flow):
    return lambda places: (flow.velocity(places), flow.acceleration(places), flow.vorticity(places))


SIDE, LOW = 0.5, 0.21  # of the box that the particles of the random flow fill


def random_case(count, noise=0.0, seed=1, kmax=20, cells=None):
    """`count` particles in a cube of half the period. Without `cells` 48 nodes per axis are judged, which reach to one particle spacing
    off the faces; with it `cells` spacings span the cube."""
    flow = random_flow(seed - 1, kmax)
    x = LOW + SIDE * np.random.default_rng(seed).random((count, 3))
    r = SIDE / count ** (1 / 3)
    if cells:
        nodes = Nodes([LOW] * 3, SIDE / cells, [cells + 1] * 3)
    else:
        h = (SIDE - 2 * r) / 47
        more = int(np.ceil(r / h))
        nodes = Nodes([LOW + r - more * h] * 3, h, [48 + 2 * more] * 3)
    u, a = flow.velocity(x), flow.acceleration(x)
    u, a = add_noise(u, a, noise, rms(u - flow.mean), rms(a), seed)
    return Case("random", x, u, a, r, nodes, [LOW, LOW + SIDE] * 3, flow.viscosity, truth_of(flow), flow.mean)


H = 0.689e-3   # grid spacing of the analytic flows, m; that of the published experiment
CELLS = 36     # of their box, per axis
DIAMETER, SPEED, AMPLITUDE, VISCOSITY = 0.01111, 0.35, 0.1, 1.1e-6


def analytic_flow(name):
    wavelength = 20 * H
    return {"abc": lambda: flows.ABCFlow(AMPLITUDE, wavelength, VISCOSITY),
            "taylor-green": lambda: flows.TaylorGreenFlow(AMPLITUDE, wavelength, VISCOSITY),
            "stokes": lambda: flows.StokesSphereFlow(DIAMETER, (0, SPEED, 0))}[name]()


def synthetic_tracks(name, density, bounds, seed, truth=False):
    """The particles of RIMFlow's SyntheticTracks at its reference time, without noise."""
    from rimflow.vtkRIMFlowReaders import vtkSyntheticTracks
    from vtkmodules.util.numpy_support import vtk_to_numpy

    source = vtkSyntheticTracks()
    source.SetFlow({"abc": vtkSyntheticTracks.ABC, "taylor-green": vtkSyntheticTracks.TAYLOR_GREEN, "stokes": vtkSyntheticTracks.STOKES_SPHERE}[name])
    source.SetDiameter(DIAMETER)
    source.SetVelocity(0, SPEED, 0)
    source.SetAmplitude(AMPLITUDE)
    source.SetWavelength(20 * H)
    source.SetViscosity(VISCOSITY)
    source.SetDensity(density)
    source.SetBounds(bounds)
    source.SetNumberOfSnapshots(1)
    source.SetSeed(seed)
    source.SetAddTruth(truth)
    source.Update()
    data = source.GetOutput()
    arrays = {n: vtk_to_numpy(data.GetPointData().GetArray(n)).astype(float) for n in ("Velocity", "Acceleration")}
    return vtk_to_numpy(data.GetPoints().GetData()).astype(float), arrays["Velocity"], arrays["Acceleration"]


def analytic_case(name, ratio, noise=0.0, seed=1):
    """Particles `ratio` grid spacings apart."""
    half = CELLS * H / 2
    bounds = [-half, half] * 3
    flow = analytic_flow(name)
    x, u, a = synthetic_tracks(name, 1 / (ratio * H) ** 3, bounds, seed)
    nodes = Nodes([-half] * 3, H, [CELLS + 1] * 3)
    body = {"diameter": DIAMETER, "centre": [0.0, 0.0, 0.0], "velocity": [0.0, SPEED, 0.0]} if name == "stokes" else None
    places = nodes.places().reshape(-1, 3)
    if body:
        places = places[np.linalg.norm(places, axis=1) > DIAMETER / 2]
    u, a = add_noise(u, a, noise, rms(flow.velocity(places)), rms(flow.acceleration(places)), seed)
    return Case(name, x, u, a, ratio * H, nodes, bounds, VISCOSITY, truth_of(flow), body=body)


class SphereTracks:
    """Measured or simulated tracks around a sphere with a truth on a grid: what --tracks, --truth and the options beside them name."""

    def __init__(self, tracks, truth, diameter, velocity, viscosity):
        from rimflow.vtkRIMFlowReaders import vtkSTBTrackReader
        from vtkmodules.util.numpy_support import vtk_to_numpy

        with np.load(truth) as t:
            axes = [1e-3 * t[c].astype(float) for c in "xyz"]
            self.u = np.stack([t[c].astype(float) for c in ("u", "v", "w")], -1)
            self.a = np.stack([t[c].astype(float) for c in ("ax", "ay", "az")], -1)
            self.time, centre = float(t["t_s"]), 1e-3 * t["centre_mm"].astype(float)
        self.body = {"diameter": diameter, "centre": list(centre), "velocity": list(velocity)}
        self.viscosity = viscosity
        reader = vtkSTBTrackReader()
        reader.AddFileName(tracks)
        reader.UpdateInformation()
        reader.UpdateTimeStep(self.time)
        data = reader.GetOutput()
        self.x = vtk_to_numpy(data.GetPoints().GetData()).astype(float)
        if data.GetPointData().GetArray("Acceleration") is None:
            raise ValueError(f"{tracks} holds no accelerations at t = {self.time} s")
        self.v, self.w = (vtk_to_numpy(data.GetPointData().GetArray(n)).astype(float) for n in ("Velocity", "Acceleration"))
        # The grid goes on as far as there are particles, so that all of them count; the truth is unknown there.
        h = np.mean([np.diff(c).mean() for c in axes])
        more = [(max(int((c[0] - lowest) / h), 0), max(int((highest - c[-1]) / h), 0))
                for c, lowest, highest in zip(axes, self.x.min(0), self.x.max(0))]
        self.nodes = Nodes([c[0] - h * m[0] for c, m in zip(axes, more)], h, [len(c) + sum(m) for c, m in zip(axes, more)])
        self.u, self.a = (np.pad(f, more + [(0, 0)], constant_values=np.nan) for f in (self.u, self.a))

    def case(self, ratio=None, seed=1):
        """The tracks, or as many of them as make their spacing `ratio` grid spacings."""
        box = np.stack([self.x.min(0), self.x.max(0)], 1)
        volume = np.prod(np.ptp(box, axis=1)) - np.pi / 6 * self.body["diameter"] ** 3
        keep = np.arange(len(self.x))
        if ratio:
            count = int(volume / (ratio * self.nodes.spacing) ** 3)
            if count > len(keep):
                raise ValueError(f"the tracks are {(volume / len(keep)) ** (1 / 3) / self.nodes.spacing:.2f} grid spacings apart, more than {ratio}")
            keep = np.random.default_rng([seed, 11]).permutation(len(keep))[:count]
        r = (volume / len(keep)) ** (1 / 3)
        fluid = np.linalg.norm(self.nodes.places() - self.body["centre"], axis=-1) > self.body["diameter"] / 2
        fluid &= np.isfinite(self.u).all(-1)

        def truth(places):
            return self.u, self.a, curl(gradient(self.u, self.nodes.spacing, fluid))

        return Case("cfd", self.x[keep], self.v[keep], self.w[keep], r, self.nodes, box, self.viscosity, truth, body=self.body)
