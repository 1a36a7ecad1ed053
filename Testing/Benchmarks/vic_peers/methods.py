"""The methods that stand side by side. Each takes a Case and gives Result(velocity, acceleration, vorticity or None) on the case's window."""
import functools
import multiprocessing
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field

import numpy as np
from rimflow.vtkRIMFlowFilters import vtkVICSharpResample
from scipy.interpolate import LinearNDInterpolator, RBFInterpolator
from scipy.spatial import cKDTree
from vtkmodules.util.numpy_support import vtk_to_numpy
from vtkmodules.vtkCommonCore import vtkDoubleArray
from vtkmodules.vtkCommonDataModel import vtkImageData, vtkPolyData
from vtkmodules.vtkFiltersCore import vtkDelaunay3D, vtkProbeFilter
from vtkmodules.vtkFiltersPoints import vtkGaussianKernel, vtkPointInterpolator, vtkShepardKernel

from tracks import particle_data

WIDTHS = (0.4, 0.5, 0.6, 0.8)  # of the Gaussian windows: standard deviation in particle spacings
SMOOTHINGS = (0.1, 1.0)  # of the radial basis functions


@dataclass
class Result:
    velocity: np.ndarray
    acceleration: np.ndarray = None
    vorticity: np.ndarray = None
    seconds: float = 0
    setting: str = ""
    notes: dict = field(default_factory=dict)


def particles(case, acceleration=True):
    return particle_data(case.x, Velocity=case.u, **({"Acceleration": case.a} if acceleration else {}))


def body_data(body):
    data = vtkPolyData()
    for name, value in (("Diameter", [body["diameter"]]), ("Centre", body["centre"]), ("Velocity", body["velocity"])):
        array = vtkDoubleArray()
        array.SetName(name)
        array.SetNumberOfComponents(len(value))
        array.InsertNextTuple([float(v) for v in value])
        data.GetFieldData().AddArray(array)
    return data


def image(nodes):
    data = vtkImageData()
    data.SetOrigin(nodes.origin)
    data.SetSpacing([nodes.spacing] * 3)
    data.SetDimensions(nodes.shape)
    return data


def on_grid(data, name, shape):
    """The point array as [x, y, z, component]."""
    values = vtk_to_numpy(data.GetPointData().GetArray(name)).astype(float)
    return values.reshape(shape[2], shape[1], shape[0], -1).transpose(2, 1, 0, 3)


def vic_sharp(case, acceleration=True, body=False):
    """RIMFlow's filter as a user meets it: default options, the noise not told, no warm start."""
    f = vtkVICSharpResample()
    f.SetInputData(0, particles(case, acceleration))
    if body:
        f.SetInputData(1, body_data(case.body))
    f.SetSpacing(case.nodes.spacing)
    f.UseBoundsOn()
    f.SetBounds(case.nodes.bounds)
    f.SetViscosity(case.viscosity)
    f.SetUseAcceleration(acceleration)
    f.WarmStartOff()
    start = time.perf_counter()
    f.Update()
    seconds = time.perf_counter() - start
    out = f.GetOutput()
    if out.GetDimensions() != case.nodes.shape:
        raise RuntimeError(f"VICSharpResample gave {out.GetDimensions()} nodes where {case.nodes.shape} were asked for")
    u, a, w = (on_grid(out, name, case.nodes.shape)[case.window] for name in ("Velocity", "MaterialAcceleration", "Vorticity"))
    numbers = {}
    for name in ("Iterations", "DivergenceNorm", "ParticlesUsed"):
        array = out.GetFieldData().GetArray(name)
        if array:
            numbers[name] = array.GetTuple1(0)
    return Result(u, a, w, seconds, f"{numbers.get('Iterations', 0):.0f} iterations", numbers)


def _split(values, case, seconds, setting=""):
    values = values.reshape(case.part.shape + (6,))
    return Result(values[..., :3], values[..., 3:], None, seconds, setting)


def _places(case):
    return case.part.places().reshape(-1, 3)


def delaunay(case, wall=False):
    """SciPy's Delaunay linear; with `wall`, particles that move with the sphere are spread over its surface, as far apart as the others:
    more of them make thin tetrahedra and larger errors."""
    x, values = case.x, np.hstack([case.u, case.a])
    start = time.perf_counter()
    if wall:
        surface = wall_points(case.body, case.r)
        outside = np.linalg.norm(x - case.body["centre"], axis=1) > case.body["diameter"] / 2
        x = np.vstack([x[outside], surface])
        at_wall = np.hstack([np.tile(case.body["velocity"], (len(surface), 1)), np.zeros((len(surface), 3))])
        values = np.vstack([values[outside], at_wall])
    out = LinearNDInterpolator(x, values)(_places(case))
    return _split(out, case, time.perf_counter() - start)


def wall_points(body, spacing):
    """Points spread evenly over the sphere (a Fibonacci lattice)."""
    n = max(int(np.pi * body["diameter"] ** 2 / spacing**2), 12)
    i = np.arange(n) + 0.5
    polar, azimuth = np.arccos(1 - 2 * i / n), np.pi * (1 + 5**0.5) * i
    unit = np.stack([np.cos(azimuth) * np.sin(polar), np.sin(azimuth) * np.sin(polar), np.cos(polar)], 1)
    return np.asarray(body["centre"]) + body["diameter"] / 2 * unit


def rbf(case, smoothing=0.0):
    """SciPy's local radial basis functions, cubic, 50 neighbours; the smoothing in r^3, the unit of the cubic kernel."""
    start = time.perf_counter()
    interpolator = RBFInterpolator(case.x, np.hstack([case.u, case.a]), neighbors=min(50, len(case.x)), kernel="cubic", smoothing=smoothing * case.r**3)
    out = interpolator(_places(case))
    return _split(out, case, time.perf_counter() - start, f"smoothing {smoothing:g} r^3" if smoothing else "")


def rbf_smoothed(case):
    """The same with the smoothing whose velocity is truest, of those in SMOOTHINGS."""
    with ProcessPoolExecutor(2, multiprocessing.get_context("fork")) as pool:
        return _truest(case, list(pool.map(functools.partial(rbf, case), SMOOTHINGS)))


def gaussian(case):
    """Gaussian weighting of the 40 nearest particles; of several widths the one whose velocity is truest (no user could know it better)."""
    tree, values, places = cKDTree(case.x), np.hstack([case.u, case.a]), _places(case)

    def at(width):
        start = time.perf_counter()
        out = np.empty((len(places), 6))
        for i in range(0, len(places), 20000):
            distance, index = tree.query(places[i:i + 20000], min(40, len(case.x)), workers=2)
            nearest = distance[:, :1]
            weight = np.exp((nearest**2 - distance**2) / (2 * (width * case.r) ** 2))
            out[i:i + 20000] = np.einsum("nk,nkc->nc", weight / weight.sum(1, keepdims=True), values[index])
        return _split(out, case, time.perf_counter() - start, f"width {width} r")

    return _truest(case, [at(w) for w in WIDTHS])


def vtk_interpolator(case, kernel, setting):
    f = vtkPointInterpolator()
    f.SetInputData(image(case.part))
    f.SetSourceData(particles(case))
    f.SetKernel(kernel)
    f.SetNullPointsStrategyToClosestPoint()
    start = time.perf_counter()
    f.Update()
    seconds = time.perf_counter() - start
    u, a = (on_grid(f.GetOutput(), name, case.part.shape) for name in ("Velocity", "Acceleration"))
    return Result(u, a, None, seconds, setting)


def vtk_gaussian(case):
    results = []
    for width in WIDTHS:
        kernel = vtkGaussianKernel()
        kernel.SetKernelFootprintToRadius()
        radius = max(3 * width, 1.2) * case.r
        kernel.SetRadius(radius)
        kernel.SetSharpness(radius / (np.sqrt(2) * width * case.r))  # the weight is exp(-(sharpness d/radius)^2)
        results.append(vtk_interpolator(case, kernel, f"width {width} r"))
    return _truest(case, results)


def vtk_shepard(case):
    results = []
    for neighbours, power in ((8, 2), (8, 3), (16, 4)):
        kernel = vtkShepardKernel()
        kernel.SetKernelFootprintToNClosest()
        kernel.SetNumberOfPoints(neighbours)
        kernel.SetPowerParameter(power)
        results.append(vtk_interpolator(case, kernel, f"{neighbours} nearest, power {power}"))
    return _truest(case, results)


def vtk_delaunay(case):
    mesh, probe = vtkDelaunay3D(), vtkProbeFilter()
    mesh.SetInputData(particles(case))
    probe.SetInputData(image(case.part))
    probe.SetSourceConnection(mesh.GetOutputPort())
    start = time.perf_counter()
    probe.Update()
    seconds = time.perf_counter() - start
    out = probe.GetOutput()
    u, a = (on_grid(out, name, case.part.shape) for name in ("Velocity", "Acceleration"))
    missed = on_grid(out, probe.GetValidPointMaskArrayName(), case.part.shape)[..., 0] == 0
    u[missed], a[missed] = np.nan, np.nan
    return Result(u, a, None, seconds)


def _truest(case, results):
    chosen = case.chosen

    def error(result):
        return np.nanmean((result.velocity[chosen] - case.truth_u[chosen]) ** 2)

    return min(results, key=error)
