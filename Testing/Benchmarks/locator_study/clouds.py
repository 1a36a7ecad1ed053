"""Snapshots of tracers around a sphere that is or is not there, with the true centre: random clouds, or tracks of the Stokes flow."""
import zlib
from dataclasses import dataclass

import numpy as np
from rimflow.vtkRIMFlowReaders import vtkSyntheticTracks
from vtkmodules.util.numpy_support import vtk_to_numpy

SPEED = (0.0, 0.35, 0.0)  # of the sphere in the Stokes flow, m/s
ACCELERATION_NOISE = 1.0  # m/s2: a twentieth of V^2/R
NEAREST = 1e-3            # the clouds' sphere lies anywhere within so far of where the case wants it, per axis, m


@dataclass(frozen=True)
class Cloud:
    """One kind of snapshot. Lengths in m; the sphere rises along about +y, so its wake is below."""
    diameter: float = 11.11e-3
    density: float = 0.4e9        # tracers per m3
    noise: float = 5e-6           # of a position, standard deviation per component
    ghosts: float = 0.005         # density inside the sphere over density outside
    box: tuple = (36e-3, 36e-3, 25e-3)  # the visible volume, about the origin
    wake_depth: float = 0.0       # share of the tracers that is missing in the wake, a cylinder that starts at the centre ...
    wake_width: float = 0.8       # ... and has this radius, R; its axis is up to 30 degrees off the vertical
    edge: tuple = None            # distance of the centre from the faces +x, +y, +z, R; None: about the middle of the box
    edges: int = 0                # the same at random from 0 to R, for so many faces
    sheet: float = 0.0            # standard deviation along z of a light sheet's Gaussian profile; 0: none
    sheet_offset: float = 0.0     # of the sheet's middle from the sphere's along z
    thin_side: float = 1.0        # seeding above the centre's z over that below
    background: str = "uniform"   # seeding of the volume itself: a key of BACKGROUNDS
    sphere: bool = True

    def centre(self, random):
        c = NEAREST * random.uniform(-1, 1, 3)
        for axis in range(self.edges):
            c[axis] = self.box[axis] / 2 - self.diameter / 2 * random.uniform(0, 1)
        for axis, distance in enumerate(self.edge or ()):
            if distance is not None:
                c[axis] = self.box[axis] / 2 - self.diameter / 2 * distance
        return c

    def share(self, x, centre, random):
        """Seeding at x relative to `density`, outside the sphere."""
        out = BACKGROUNDS[self.background](x, self, random)
        r = x - centre
        if self.wake_depth:
            angle, tilt = random.uniform(0, 2 * np.pi), np.radians(30) * np.sqrt(random.uniform())
            axis = np.array([np.sin(tilt) * np.cos(angle), -np.cos(tilt), np.sin(tilt) * np.sin(angle)])
            along = r @ axis
            off_axis = np.sqrt(np.maximum((r**2).sum(1) - along**2, 0))
            out = np.where((along > 0) & (off_axis < self.wake_width * self.diameter / 2), 1 - self.wake_depth, 1) * out
        if self.sheet:
            out = out * np.exp(-0.5 * ((r[:, 2] - self.sheet_offset) / self.sheet) ** 2)
        if self.thin_side != 1:
            out = np.where(r[:, 2] > 0, self.thin_side, 1) * out
        return out


def uniform(x, cloud, random):
    return np.ones(len(x))


def clustered(x, cloud, random):
    """Clusters of 3 mm (standard deviation), one in a ball's volume of 5.5 mm radius, which leave gaps."""
    count = round(np.prod(cloud.box) / (4 / 3 * np.pi * 5.5e-3**3))
    middles = random.uniform(-0.5, 0.5, (count, 3)) * np.add(cloud.box, 6e-3)
    return np.minimum(1, 0.6 * sum(np.exp(-0.5 * ((x - m) ** 2).sum(1) / 3e-3**2) for m in middles))


def vortex_cores(x, cloud, random):
    """Six straight vortices, whose cores of 3 mm radius have thrown out 70 % of their tracers."""
    out = np.ones(len(x))
    for _ in range(6):
        through, axis = random.uniform(-0.5, 0.5, 3) * cloud.box, random.standard_normal(3)
        r = x - through
        along = r @ (axis / np.linalg.norm(axis))
        out[(r**2).sum(1) - along**2 < 3e-3**2] = 0.3
    return out


def rounded(x, cloud, random):
    """An elliptic beam along y: the corners of the box are dark."""
    return np.where((2 * x[:, 0] / cloud.box[0]) ** 2 + (2 * x[:, 2] / cloud.box[2]) ** 2 < 1, 1.0, 0.0)


BACKGROUNDS = {"uniform": uniform, "clustered": clustered, "vortex cores": vortex_cores, "rounded": rounded}


@dataclass
class Snapshot:
    x: np.ndarray                    # m
    centre: np.ndarray               # m; None: no sphere
    velocity: np.ndarray = None      # m/s
    acceleration: np.ndarray = None  # m/s2


def generator(name, i):
    """Random numbers of snapshot i of a case, whatever else is run."""
    return np.random.default_rng([zlib.crc32(name.encode()), i])


def poisson_snapshot(cloud, name, i):
    """Tracers as the void likelihood supposes them (Testing/Kernels/TracerCloud.h): independent of each other, without a flow."""
    random = generator(name, i)
    centre = cloud.centre(random)
    x = random.uniform(-0.5, 0.5, (random.poisson(cloud.density * np.prod(cloud.box)), 3)) * cloud.box
    share = cloud.share(x, centre, random)
    if cloud.sphere:
        share = np.where(np.linalg.norm(x - centre, axis=1) < cloud.diameter / 2, cloud.ghosts, share)
    x = x[random.uniform(size=len(x)) < share]
    return Snapshot(x + cloud.noise * random.standard_normal(x.shape), centre if cloud.sphere else None)


def stokes_source(cloud, seed, centre=(0, 0, 0), snapshots=1):
    """Tracks of SyntheticTracks around a rising sphere with the cloud's seeding, noise and ghosts; 1 % of its speed as noise on velocities."""
    source = vtkSyntheticTracks()
    source.SetFlow(vtkSyntheticTracks.STOKES_SPHERE)
    source.SetDiameter(cloud.diameter)
    source.SetCentre(centre)
    source.SetVelocity(SPEED)
    source.SetDensity(cloud.density)
    source.SetBounds([s * side / 2 for side in cloud.box for s in (-1, 1)])
    source.SetNumberOfSnapshots(snapshots)
    source.SetPositionNoise(cloud.noise)
    source.SetVelocityNoise(0.01 * SPEED[1])
    source.SetAccelerationNoise(ACCELERATION_NOISE)
    source.SetGhostFraction(cloud.ghosts)  # ghosts are as dense inside as outside
    source.SetSeed(seed)
    return source


def stokes_snapshot(cloud, name, i):
    """The same clouds with the velocities of the Stokes flow. Ghosts lie outside too; the share of the seeding spares none of them."""
    random = generator(name, i)
    centre = cloud.centre(random)
    source = stokes_source(cloud, int(random.integers(1, 2**31)), centre)
    source.Update()
    data = source.GetOutput()
    x, u, a = (vtk_to_numpy(array).astype(float) for array in
               (data.GetPoints().GetData(), data.GetPointData().GetArray("Velocity"), data.GetPointData().GetArray("Acceleration")))
    keep = random.uniform(size=len(x)) < cloud.share(x, centre, random)
    return Snapshot(x[keep], centre, u[keep], a[keep])


SNAPSHOTS = {"cloud": poisson_snapshot, "Stokes": stokes_snapshot}
