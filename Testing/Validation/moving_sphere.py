"""The reference flow as a sphere in steady straight motion through fluid at rest, in laboratory coordinates and SI units; and on grids."""

from dataclasses import dataclass

import numpy as np

TINY = 1e-12  # sphere radii; keeps the radial direction defined on the axis


@dataclass
class MovingSphere:
    """A `flow` of axisymmetric_sphere.SphereFlow, dimensional: the fluid is at rest far away, pressure is the dynamic part."""

    flow: object
    diameter: float  # m
    speed: float  # m/s
    density: float  # kg/m3
    direction: np.ndarray  # of motion; normalised here
    centre: np.ndarray  # m, at time `reference_time`
    reference_time: float = 0.0  # s

    def __post_init__(self):
        self.direction = np.asarray(self.direction, float) / np.linalg.norm(self.direction)
        self.centre = np.asarray(self.centre, float)

    @property
    def radius(self):
        return self.diameter / 2

    @property
    def viscosity(self):
        """Kinematic, m2/s."""
        return self.speed * self.diameter / self.flow.reynolds

    @property
    def velocity_of_sphere(self):
        return self.speed * self.direction

    def centre_at(self, time):
        return self.centre + self.velocity_of_sphere * (time - self.reference_time)

    def forces(self):
        """Pressure and viscous force of the fluid on the sphere, N: two vectors."""
        scale = 0.5 * self.density * self.speed**2 * np.pi * self.radius**2
        return [-scale * part * self.direction for part in self.flow.drag_coefficients]

    def local(self, points, time):
        """Distance downstream of the centre, distance from the axis (both in radii) and the unit vector away from the axis."""
        relative = (np.asarray(points) - self.centre_at(time)) / self.radius
        x = -(relative @ self.direction)
        across = relative + x[..., None] * self.direction
        rho = np.maximum(np.linalg.norm(across, axis=-1), TINY)
        return x, rho, across / rho[..., None]

    def _vector(self, axial, radial, outward, scale):
        return scale * (radial[..., None] * outward - axial[..., None] * self.direction)

    def velocity(self, points, time):
        """At points (n, 3) outside the sphere, as for all fields that follow."""
        x, rho, outward = self.local(points, time)
        return self._vector(*self.flow.velocity_departure(x, rho), outward, self.speed)

    def pressure(self, points, time):
        x, rho, _ = self.local(points, time)
        return self.density * self.speed**2 * self.flow.pressure_at(x, rho)

    def pressure_gradient(self, points, time):
        x, rho, outward = self.local(points, time)
        return self._vector(*self.flow.pressure_gradient(x, rho), outward, self.density * self.speed**2 / self.radius)

    def acceleration_and_q(self, points, time):
        """Material acceleration and Q = (|W|^2 - |S|^2) / 2 of the velocity gradient's antisymmetric and symmetric parts."""
        x, rho, outward = self.local(points, time)
        axial, radial = self.flow.velocity_departure(x, rho)
        axial_x, axial_rho, radial_x, radial_rho, hoop = self.flow.gradient(x, rho)
        along = (1 + axial) * axial_x + radial * axial_rho
        across = (1 + axial) * radial_x + radial * radial_rho
        q = -0.5 * (axial_x**2 + radial_rho**2 + hoop**2 + 2 * axial_rho * radial_x)
        return self._vector(along, across, outward, self.speed**2 / self.radius), q * (self.speed / self.radius) ** 2


def grid_axes(bounds, spacing, offset=(0, 0, 0)):
    """Node positions along each axis: as many as fit into bounds ((low, high), ...), centred and then moved by `offset`."""
    axes = []
    for (low, high), shift in zip(bounds, offset):
        cells = int(np.floor((high - low) / spacing + 1e-9))
        axes.append((low + high) / 2 + spacing * (np.arange(cells + 1) - cells / 2) + shift)
    return axes


def fields_on_grid(sphere, axes, time):
    """The arrays of a truth file: fields indexed [x, y, z], mask true inside the sphere; there u = sphere velocity and p = a = Q = 0."""
    points = np.stack(np.meshgrid(*axes, indexing="ij"), -1)
    mask = np.linalg.norm(points - sphere.centre_at(time), axis=-1) <= sphere.radius
    fluid = points[~mask]
    velocity = np.broadcast_to(sphere.velocity_of_sphere, points.shape).copy()
    acceleration, pressure, q = np.zeros(points.shape), np.zeros(mask.shape), np.zeros(mask.shape)
    velocity[~mask], pressure[~mask] = sphere.velocity(fluid, time), sphere.pressure(fluid, time)
    acceleration[~mask], q[~mask] = sphere.acceleration_and_q(fluid, time)
    names = dict(zip("xyz", (1e3 * axis for axis in axes)))
    names.update(zip("uvw", np.moveaxis(velocity, -1, 0)), p=pressure, Q=q, mask=mask)
    names.update(zip(("ax", "ay", "az"), np.moveaxis(acceleration, -1, 0)))
    return names


def truth_of_sphere(sphere, time):
    """The scalars and vectors of a truth file."""
    pressure, viscous = sphere.forces()
    cd_pressure, cd_viscous = sphere.flow.drag_coefficients
    return {
        "centre_mm": 1e3 * sphere.centre_at(time),
        "t_s": time,
        "e": sphere.direction,
        "d_mm": 1e3 * sphere.diameter,
        "V": sphere.speed,
        "rho": sphere.density,
        "nu": sphere.viscosity,
        "Re": sphere.flow.reynolds,
        "Cd": np.array([cd_pressure, cd_viscous, cd_pressure + cd_viscous]),
        "Fp_N": pressure,
        "Fv_N": viscous,
        "F_N": pressure + viscous,
    }
