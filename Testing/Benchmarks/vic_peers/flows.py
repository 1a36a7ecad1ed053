"""Flows with a known answer: velocity, material acceleration and vorticity at any place, at one time. Metres and seconds."""
import numpy as np
from scipy import fft
from scipy.ndimage import map_coordinates, spline_filter


class RandomFlow:
    """Random solenoidal flow, periodic in the unit box, carried along by a mean velocity.

    Gaussian Fourier modes, made solenoidal by projection; each shell of wave numbers kmin <= k <= kmax (periods per box) holds the energy
    k^(-5/3); rms 1 m/s per component. The flow obeys Navier-Stokes at this instant, so Du/Dt = -grad p + nu lap u with
    lap p = -(d_j u_i)(d_i u_j), all of it spectral; between the nodes by quintic splines.
    """

    def __init__(self, kmax=20, kmin=2, viscosity=1e-4, mean=(1.0, 0.0, 0.0), seed=0, nodes=160):
        if 4 * kmax >= 2 * nodes:  # products of two modes reach 2 kmax and must stay below nodes/2
            raise ValueError(f"{nodes} nodes are too few for kmax = {kmax}: more than {2 * kmax} are needed")
        self.nodes, self.viscosity, self.mean = nodes, viscosity, np.asarray(mean, float)
        k1, kz = np.fft.fftfreq(nodes, 1 / nodes), np.fft.rfftfreq(nodes, 1 / nodes)
        self.k = np.array(np.meshgrid(k1, k1, kz, indexing="ij"))
        self.k2 = np.maximum((self.k**2).sum(0), 1e-300)
        wave_number = np.sqrt((self.k**2).sum(0))
        modes = self.project(self.forward(np.random.default_rng(seed).standard_normal((3, nodes, nodes, nodes))))
        shell = np.rint(wave_number).astype(int)
        energy = np.bincount(shell.ravel(), weights=(np.abs(modes) ** 2).sum(0).ravel())
        band = (wave_number >= kmin) & (wave_number <= kmax)
        wanted = np.where(band, np.maximum(wave_number, 1) ** (-5 / 3), 0.0)
        modes *= np.sqrt(wanted / np.maximum(energy[shell], 1e-300))
        self.modes = modes / np.sqrt((self.inverse(modes) ** 2).mean())
        self._splines = {}

    def forward(self, field):
        return fft.rfftn(field, axes=(-3, -2, -1), workers=2)

    def inverse(self, modes):
        return fft.irfftn(modes, s=(self.nodes,) * 3, axes=(-3, -2, -1), workers=2)

    def project(self, modes):
        """The solenoidal part."""
        return modes - self.k * (self.k * modes).sum(0) / self.k2

    def derivative(self, modes, axis):
        return 2j * np.pi * self.k[axis] * modes

    def gradient(self):
        """d_j u_i on the nodes, as [i][j]."""
        return [[self.inverse(self.derivative(self.modes[i], j)) for j in range(3)] for i in range(3)]

    def _field(self, quantity):
        if quantity == "velocity":
            return self.inverse(self.modes)
        g = self.gradient()
        if quantity == "vorticity":
            return np.array([g[2][1] - g[1][2], g[0][2] - g[2][0], g[1][0] - g[0][1]])
        source = -sum(g[i][j] * g[j][i] for i in range(3) for j in range(3))
        pressure = -self.forward(source) / ((2 * np.pi) ** 2 * self.k2)
        pressure[0, 0, 0] = 0
        friction = -self.viscosity * (2 * np.pi) ** 2 * self.k2 * self.modes
        return self.inverse(friction - np.array([self.derivative(pressure, i) for i in range(3)]))

    def _sample(self, quantity, x):
        if quantity not in self._splines:
            self._splines[quantity] = [spline_filter(c, 5, mode="grid-wrap") for c in self._field(quantity)]
        x = np.asarray(x, float)
        places = (x.reshape(-1, 3) * self.nodes).T
        values = [map_coordinates(c, places, order=5, mode="grid-wrap", prefilter=False) for c in self._splines[quantity]]
        return np.stack(values, -1).reshape(x.shape)

    def velocity(self, x):
        return self._sample("velocity", x) + self.mean

    def acceleration(self, x):
        return self._sample("acceleration", x)

    def vorticity(self, x):
        return self._sample("vorticity", x)


class ABCFlow:
    """Arnold-Beltrami-Childress flow as of SyntheticTracks, A : B : C = sqrt 3 : sqrt 2 : 1, at its reference time."""
    mean = np.zeros(3)

    def __init__(self, amplitude, wavelength, viscosity):
        self.k, self.viscosity = 2 * np.pi / wavelength, viscosity
        self.a, self.b, self.c = amplitude * np.sqrt([1, 2 / 3, 1 / 3])

    def velocity(self, x):
        sx, sy, sz = np.moveaxis(np.sin(self.k * x), -1, 0)
        cx, cy, cz = np.moveaxis(np.cos(self.k * x), -1, 0)
        return np.stack([self.a * sz + self.c * cy, self.b * sx + self.a * cz, self.c * sy + self.b * cx], -1)

    def vorticity(self, x):
        return self.k * self.velocity(x)  # Beltrami

    def acceleration(self, x):
        """(u . grad) u = grad u^2/2, and du/dt = -nu k^2 u."""
        sx, sy, sz = np.moveaxis(np.sin(self.k * x), -1, 0)
        cx, cy, cz = np.moveaxis(np.cos(self.k * x), -1, 0)
        u = self.velocity(x)
        g = self.k * np.stack([u[..., 1] * self.b * cx - u[..., 2] * self.b * sx,
                               u[..., 2] * self.c * cy - u[..., 0] * self.c * sy,
                               u[..., 0] * self.a * cz - u[..., 1] * self.a * sz], -1)
        return g - self.viscosity * self.k**2 * u


class TaylorGreenFlow:
    """Taylor-Green vortices in the x-y plane as of SyntheticTracks, at their reference time."""
    mean = np.zeros(3)

    def __init__(self, amplitude, wavelength, viscosity):
        self.amplitude, self.k, self.viscosity = amplitude, 2 * np.pi / wavelength, viscosity

    def velocity(self, x):
        x, y = self.k * x[..., 0], self.k * x[..., 1]
        return self.amplitude * np.stack([np.sin(x) * np.cos(y), -np.cos(x) * np.sin(y), 0 * x], -1)

    def vorticity(self, x):
        x, y = self.k * x[..., 0], self.k * x[..., 1]
        return self.amplitude * self.k * np.stack([0 * x, 0 * x, 2 * np.sin(x) * np.sin(y)], -1)

    def acceleration(self, x):
        a, b = self.k * x[..., 0], self.k * x[..., 1]
        carried = 0.5 * self.amplitude**2 * self.k * np.stack([np.sin(2 * a), np.sin(2 * b), 0 * a], -1)
        return carried - 2 * self.viscosity * self.k**2 * self.velocity(x)


class StokesSphereFlow:
    """Creeping flow around a sphere at the origin that moves with a constant velocity, as of SyntheticTracks; rigid motion inside."""
    mean = np.zeros(3)

    def __init__(self, diameter, velocity):
        self.radius, self.body_velocity = diameter / 2, np.asarray(velocity, float)

    def _parts(self, x):
        r = np.maximum(np.linalg.norm(x, axis=-1, keepdims=True), self.radius)
        along = (x * self.body_velocity).sum(-1, keepdims=True)
        return r, along, self.radius / r

    def velocity(self, x):
        r, along, s = self._parts(x)
        u = (0.75 * s + 0.25 * s**3) * self.body_velocity + 0.75 * (s - s**3) / r**2 * along * x
        inside = np.linalg.norm(x, axis=-1, keepdims=True) < self.radius
        return np.where(inside, self.body_velocity, u)

    def vorticity(self, x):
        """w = (3 R/2) V x r / r^3."""
        r, _, _ = self._parts(x)
        w = 1.5 * self.radius * np.cross(self.body_velocity, x) / r**3
        return np.where(np.linalg.norm(x, axis=-1, keepdims=True) < self.radius, 0.0, w)

    def acceleration(self, x):
        """((u - V) . grad) u, as the field moves along with the sphere."""
        r, along, s = self._parts(x)
        w = self.velocity(x) - self.body_velocity
        outward = (w * x).sum(-1, keepdims=True)
        first = -0.75 * (s + s**3) / r**2 * outward * self.body_velocity
        f, slope = 0.75 * (s - s**3) / r**2, (-2.25 * s + 3.75 * s**3) / r**4
        second = f * ((w * self.body_velocity).sum(-1, keepdims=True) * x + along * w) + slope * along * outward * x
        return np.where(np.linalg.norm(x, axis=-1, keepdims=True) < self.radius, 0.0, first + second)
