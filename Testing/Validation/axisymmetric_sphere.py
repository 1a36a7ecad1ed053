"""Steady axisymmetric flow of an incompressible fluid around a fixed sphere: a reference solution for the pressure and force filters.

Lengths in sphere radii, velocities in the speed of the free stream, pressure in rho V^2. Spherical coordinates (r, theta) around
the centre, theta = 0 downstream, s = ln r. Stream function and vorticity are written as

    psi = r^2 sin^2(theta) phi,    omega = r sin(theta) g,

so that phi and g are smooth and even at the axis, where they need no boundary condition. The Navier-Stokes equations become

    L phi = -r^2 g,    r (u_r dg/ds + u_theta dg/dtheta) = nu L g,    L = d2/ds2 + 3 d/ds + d2/dtheta2 + 3 cot(theta) d/dtheta,
    u_r = 2 cos(theta) phi + sin(theta) dphi/dtheta,    u_theta = -sin(theta) (2 phi + dphi/ds),    nu = 2 / Re

(from the equations for psi and omega, Batchelor 1967, appendix 2). Finite differences on seven nodes, Newton's method with a sparse
LU, continuation in the Reynolds number. Above Re = 212 the real flow is planar symmetric and beyond Re = 270 unsteady: the solution
is then the unstable axisymmetric branch, still an exact solution of the equations.
"""

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sparse
from scipy.interpolate import RectBivariateSpline
from scipy.optimize import brentq
from scipy.sparse.linalg import splu

STENCIL = 7  # nodes per derivative: sixth order inside
REACH = STENCIL // 2
WAKE_CLUSTERING = 0.6  # nodes on the downstream axis are (1 - this) times as far apart as on average
WALL_CLUSTERING = 3.0  # the radial spacing grows from the wall outwards like cosh(this * position)
WAKE_SECTOR = 1.0  # rad; the wake leaves through the outer boundary within this angle to the axis
SPONGE_START, SPONGE_END = 12.0, 30.0  # between these radii the viscosity grows, if it is smaller, to
SPONGE_VISCOSITY = 0.24  # (Re = 8): the mesh is too coarse there for a thin wake; measured effect on Cd below 0.1 %
CONTINUATION = (1, 15, 50, 90, 140, 190, 220, 250, 280, 300)  # Reynolds numbers from which Newton's method reaches the next


def difference_weights(nodes, at, order):
    """Weights of the derivatives 0..order at `at` for the values at `nodes`: shape (order + 1, nodes). Fornberg 1988."""
    weights = np.zeros((order + 1, len(nodes)))
    weights[0, 0] = 1
    product, offset = 1.0, nodes[0] - at
    for i in range(1, len(nodes)):
        previous_product, product = product, 1.0
        previous_offset, offset = offset, nodes[i] - at
        last = weights[:, i - 1].copy()
        for j in range(i):
            gap = nodes[i] - nodes[j]
            product *= gap
            lower = np.append(0, np.arange(1, order + 1) * weights[:-1, j])
            weights[:, j] = (offset * weights[:, j] - lower) / gap
        lower = np.append(0, np.arange(1, order + 1) * last[:-1])
        weights[:, i] = previous_product / product * (lower - previous_offset * last)
    return weights


def derivative_matrices(positions, nodes, columns):
    """First and second derivative at `positions` from the stencils `nodes` (n, STENCIL); columns: which unknown each node is."""
    weights = np.array([difference_weights(stencil, at, 2) for stencil, at in zip(nodes, positions)])
    rows = np.repeat(np.arange(len(positions)), STENCIL)
    shape = 2 * (len(positions),)
    return [sparse.csr_matrix((weights[:, order].ravel(), (rows, columns.ravel())), shape) for order in (1, 2)]


def radial_derivatives(s):
    """d/ds and d2/ds2, one-sided near both ends."""
    first = np.clip(np.arange(len(s)) - REACH, 0, len(s) - STENCIL)
    columns = first[:, None] + np.arange(STENCIL)
    return derivative_matrices(s, s[columns], columns)


def unfolded(theta, reach):
    """`theta` (0..pi) continued evenly over both ends of the axis, and which node each of the entries mirrors."""
    last = len(theta) - 1
    mirror = np.abs(np.arange(-reach, last + reach + 1))
    mirror = np.where(mirror > last, 2 * last - mirror, mirror)
    sign = np.where(np.arange(-reach, last + reach + 1) < 0, -1, 1)
    beyond = np.arange(-reach, last + reach + 1) > last
    return np.where(beyond, 2 * np.pi - theta[mirror], sign * theta[mirror]), mirror


def polar_derivatives(theta):
    """d/dtheta and d2/dtheta2 of a function that is even at the axis."""
    angles, mirror = unfolded(theta, REACH)
    stencil = np.arange(len(theta))[:, None] + np.arange(STENCIL)
    return derivative_matrices(theta, angles[stencil], mirror[stencil])


@dataclass
class Mesh:
    """Nodes s (n), theta (m) and the derivatives of a field stored as array (n, m), flattened row by row."""

    s: np.ndarray
    theta: np.ndarray
    polar_weight: np.ndarray  # trapezoidal rule in the mapped angle: integral over theta = sum(weight * values)

    def __init__(self, radial_nodes, polar_nodes, outer_radius):
        position = np.linspace(0, 1, radial_nodes)
        self.s = np.log(outer_radius) * np.sinh(WALL_CLUSTERING * position) / np.sinh(WALL_CLUSTERING)
        even = np.linspace(0, np.pi, polar_nodes)
        self.theta = even - WAKE_CLUSTERING * np.sin(even)
        self.polar_weight = (1 - WAKE_CLUSTERING * np.cos(even)) * even[1]
        self.polar_weight[[0, -1]] /= 2
        (ds, dss), (dt, dtt) = radial_derivatives(self.s), polar_derivatives(self.theta)
        in_s, in_theta = sparse.identity(radial_nodes), sparse.identity(polar_nodes)
        self.d_s, self.d_ss = sparse.kron(ds, in_theta, "csr"), sparse.kron(dss, in_theta, "csr")
        self.d_theta = sparse.kron(in_s, dt, "csr")
        self._polar, self._in_s = (dt, dtt), in_s
        radius, angle = np.meshgrid(np.exp(self.s), self.theta, indexing="ij")
        self.r, self.angle = radius.ravel(), angle.ravel()
        self.sin, self.cos = np.sin(self.angle), np.cos(self.angle)
        self.sin[self.angle == self.theta[-1]] = 0
        row = np.arange(radial_nodes * polar_nodes) // polar_nodes
        self.wall, self.outer = row == 0, row == radial_nodes - 1
        self.interior = ~(self.wall | self.outer)

    def laplacian(self, dimension):
        """r^2 times the Laplacian of fields in `dimension` (3 or 5) dimensions that depend on r and theta only."""
        first, second = self._polar
        inside = slice(1, -1)
        factor = np.zeros(len(self.theta))
        factor[inside] = (dimension - 2) / np.tan(self.theta[inside])
        on_axis = np.ones(len(self.theta))
        on_axis[[0, -1]] = dimension - 1  # cot(theta) d/dtheta tends to d2/dtheta2
        polar = sparse.diags(on_axis) @ second + sparse.diags(factor) @ first
        return self.d_ss + (dimension - 2) * self.d_s + sparse.kron(self._in_s, polar, "csr")

    def shape(self, values):
        return values.reshape(len(self.s), len(self.theta))


def select(mask, matrix):
    """The rows of `matrix` where mask holds, zero elsewhere."""
    return sparse.diags(mask.astype(float)) @ matrix


def viscosity_at(r, reynolds):
    """nu around the sphere; far out at least SPONGE_VISCOSITY, which keeps the wake as wide as the mesh can resolve."""
    rise = np.clip((r - SPONGE_START) / (SPONGE_END - SPONGE_START), 0, 1)
    viscosity = 2 / reynolds
    return viscosity + max(SPONGE_VISCOSITY - viscosity, 0) * rise**2 * (3 - 2 * rise)


class FlowSolver:
    """Newton's method for the departure of phi from the free stream (1/2) and for g on one mesh."""

    def __init__(self, mesh):
        self.mesh = mesh
        self.laplacian = mesh.laplacian(5)
        one = sparse.identity(len(mesh.r))
        downstream = mesh.outer & (mesh.angle < WAKE_SECTOR)
        upstream = mesh.outer & ~downstream
        # In the far wake r phi' and r^2 g are functions of r (1 - cos(theta)) alone (Oseen's solution, Batchelor 1967, section 4.10);
        # outside it the flow is that of a source, phi' ~ 1/r^2, without vorticity.
        along_paraboloid = mesh.d_s - sparse.diags(np.where(downstream, np.tan(mesh.angle / 2), 0)) @ mesh.d_theta
        self.phi_rows = select(mesh.interior, self.laplacian) + select(mesh.wall, one)
        self.phi_rows += select(downstream, along_paraboloid + one) + select(upstream, mesh.d_s + 2 * one)
        self.phi_from_g = sparse.diags(np.where(mesh.interior, mesh.r**2, 0))
        self.g_boundary_phi = select(mesh.wall, mesh.d_s)  # no slip takes the place of an equation for g at the wall
        self.g_boundary = select(downstream, along_paraboloid + 2 * one) + select(upstream, one)

    def velocity(self, phi):
        mesh = self.mesh
        radial = 2 * mesh.cos * phi + mesh.sin * (mesh.d_theta @ phi)
        return radial, -mesh.sin * (2 * phi + mesh.d_s @ phi)

    def residual_and_jacobian(self, departure, g, reynolds):
        mesh, inside = self.mesh, self.mesh.interior
        viscosity = sparse.diags(viscosity_at(mesh.r, reynolds))
        radial, polar = self.velocity(departure + 0.5)
        g_s, g_theta = mesh.d_s @ g, mesh.d_theta @ g
        transport = sparse.diags(mesh.r * radial) @ mesh.d_s + sparse.diags(mesh.r * polar) @ mesh.d_theta - viscosity @ self.laplacian
        by_phi = sparse.diags(mesh.r * (2 * mesh.cos * g_s - 2 * mesh.sin * g_theta))
        by_phi += sparse.diags(mesh.r * mesh.sin * g_s) @ mesh.d_theta - sparse.diags(mesh.r * mesh.sin * g_theta) @ mesh.d_s
        phi_equation = self.phi_rows @ departure + self.phi_from_g @ g + 0.5 * mesh.wall
        g_equation = np.where(inside, transport @ g, self.g_boundary_phi @ departure + self.g_boundary @ g)
        jacobian = sparse.bmat(
            [[self.phi_rows, self.phi_from_g], [select(inside, by_phi) + self.g_boundary_phi, select(inside, transport) + self.g_boundary]]
        )
        return np.concatenate([phi_equation, g_equation]), jacobian

    def solve(self, reynolds, departure, g, tolerance=1e-9, most_steps=12):
        """Newton's method from a given start; raises RuntimeError if it does not converge."""
        count = len(departure)
        interleave = np.arange(2 * count).reshape(2, count).T.ravel()  # both unknowns of a node side by side
        for _ in range(most_steps):
            residual, jacobian = self.residual_and_jacobian(departure, g, reynolds)
            factors = splu(jacobian.tocsc()[interleave][:, interleave], permc_spec="COLAMD")
            step = np.empty(2 * count)
            step[interleave] = factors.solve(-residual[interleave])
            departure, g = departure + step[:count], g + step[count:]
            if np.abs(step[:count]).max() < tolerance:
                return departure, g
        raise RuntimeError(f"Newton's method did not converge at Re = {reynolds}: last step {np.abs(step[:count]).max():.1e}")


class SphereFlow:
    """The flow at one Reynolds number. Fields phi (departure from 1/2), g and pressure are arrays (radial, polar) on the mesh."""

    def __init__(self, mesh, reynolds, departure, g):
        self.mesh, self.reynolds = mesh, reynolds
        self.departure, self.g = mesh.shape(departure), mesh.shape(g)
        self._integrate_forces()
        self.pressure = self._solve_pressure()
        self.pressure_drag = self._drag_of_wall_pressure(self.pressure[0])
        self._fit_splines()

    # --- forces, in rho V^2 a^2 -------------------------------------------------------------------------------------

    def _integrate_forces(self):
        """Wall pressure from the momentum equation along the wall, dp/dtheta = nu d(r omega)/dr, and the drag of both stresses."""
        mesh, viscosity = self.mesh, 2 / self.reynolds
        sin = np.sin(mesh.theta)
        g_s = mesh.shape(mesh.d_s @ self.g.ravel())[0]
        slope = viscosity * sin * (2 * self.g[0] + g_s)
        # drag = -int p cos(theta) 2 pi sin(theta) dtheta, by parts with sin^2 / 2 (no reference pressure needed)
        self.wall_pressure_drag = np.pi * np.sum(mesh.polar_weight * slope * sin**2)
        self.viscous_drag = -2 * np.pi * viscosity * np.sum(mesh.polar_weight * self.g[0] * sin**3)

    def _drag_of_wall_pressure(self, pressure):
        return -2 * np.pi * np.sum(self.mesh.polar_weight * pressure * np.sin(self.mesh.theta) * np.cos(self.mesh.theta))

    @property
    def drag_coefficients(self):
        """Pressure and viscous part of Cd; the wall pressure is that of the field."""
        return np.array([self.pressure_drag, self.viscous_drag]) / (np.pi / 2)

    # --- pressure ---------------------------------------------------------------------------------------------------

    def _solve_pressure(self):
        """Total head H = p + u^2/2 from div grad H = div(u x omega), with the momentum equation as condition at the wall."""
        mesh, viscosity = self.mesh, 2 / self.reynolds
        phi, g = self.departure.ravel() + 0.5, self.g.ravel()
        radial, polar = FlowSolver.velocity(self, phi)
        from_polar = mesh.d_s @ (mesh.r**3 * mesh.sin * polar * g) / mesh.r
        from_radial = mesh.r**2 * (2 * mesh.cos * radial * g + mesh.sin * (mesh.d_theta @ (radial * g)))
        wall_slope = -viscosity * (2 * mesh.cos * g + mesh.sin * (mesh.d_theta @ g))
        source = (self.wall_pressure_drag + self.viscous_drag) / (4 * np.pi)  # the wake draws in what the far field feeds
        outer_head = -source * mesh.cos / mesh.r**2 + (radial**2 + polar**2) / 2
        matrix = select(mesh.interior, mesh.laplacian(3)) + select(mesh.wall, mesh.d_s) + sparse.diags(mesh.outer.astype(float))
        right = np.where(mesh.interior, from_polar - from_radial, np.where(mesh.wall, wall_slope, outer_head))
        head = splu(matrix.tocsc()).solve(right)
        return mesh.shape(head - (radial**2 + polar**2) / 2)

    # --- evaluation anywhere ----------------------------------------------------------------------------------------

    def _fit_splines(self):
        angles, mirror = unfolded(self.mesh.theta, 8)
        self._phi, self._pressure = (RectBivariateSpline(self.mesh.s, angles, f[:, mirror], kx=5, ky=5) for f in (self.departure, self.pressure))

    def _phi_derivative(self, s, theta, in_s, in_theta):
        return self._phi.ev(s, theta, dx=in_s, dy=in_theta)

    def velocity_departure(self, x, rho):
        """(u_x - 1, u_rho) at axial and radial distances x, rho from the centre (x downstream)."""
        r, sin, cos, s, theta = polar_coordinates(x, rho)
        phi, phi_s, phi_theta = (self._phi_derivative(s, theta, *order) for order in ((0, 0), (1, 0), (0, 1)))
        return 2 * phi + sin * cos * phi_theta + sin**2 * phi_s, sin * (sin * phi_theta - cos * phi_s)

    def gradient(self, x, rho):
        """du_x/dx, du_x/drho, du_rho/dx, du_rho/drho and u_rho/rho."""
        r, sin, cos, s, theta = polar_coordinates(x, rho)
        orders = ((1, 0), (0, 1), (2, 0), (1, 1), (0, 2))
        f_s, f_t, f_ss, f_st, f_tt = (self._phi_derivative(s, theta, *order) for order in orders)
        axial_s = 2 * f_s + sin * cos * f_st + sin**2 * f_ss
        axial_t = 2 * f_t + (cos**2 - sin**2) * f_t + sin * cos * f_tt + 2 * sin * cos * f_s + sin**2 * f_st
        radial = sin * f_t - cos * f_s
        radial_s = sin * (sin * f_st - cos * f_ss)
        radial_t = cos * radial + sin * (cos * f_t + sin * f_tt + sin * f_s - cos * f_st)
        along = lambda by_s, by_t: (cos * by_s - sin * by_t) / r
        across = lambda by_s, by_t: (sin * by_s + cos * by_t) / r
        return along(axial_s, axial_t), across(axial_s, axial_t), along(radial_s, radial_t), across(radial_s, radial_t), radial / r

    def stream_function(self, x, rho):
        """psi, negative in the closed eddy behind the sphere."""
        _, _, _, s, theta = polar_coordinates(x, rho)
        return rho**2 * (0.5 + self._phi.ev(s, theta))

    def pressure_at(self, x, rho):
        _, _, _, s, theta = polar_coordinates(x, rho)
        return self._pressure.ev(s, theta)

    def pressure_gradient(self, x, rho):
        """dp/dx, dp/drho."""
        r, sin, cos, s, theta = polar_coordinates(x, rho)
        p_s, p_theta = (self._pressure.ev(s, theta, dx=in_s, dy=1 - in_s) for in_s in (1, 0))
        return (cos * p_s - sin * p_theta) / r, (sin * p_s + cos * p_theta) / r

    # --- figures to compare with the literature -----------------------------------------------------------------------

    @property
    def separation_angle(self):
        """Degrees from the front stagnation point; 180 where the flow stays attached."""
        wall = RectBivariateSpline(self.mesh.s, self.mesh.theta, self.g, kx=5, ky=5)
        angles = np.radians(np.linspace(1, 120, 400))
        vorticity = wall.ev(np.zeros(400), angles)
        crossing = np.flatnonzero(np.diff(np.sign(vorticity)))
        if not len(crossing):
            return 180.0
        first = crossing[-1]
        return 180 - np.degrees(brentq(lambda angle: wall.ev(0, angle), angles[first], angles[first + 1]))

    @property
    def recirculation_length(self):
        """From the rear of the sphere to the stagnation point of the wake, in diameters; 0 where the flow stays attached."""
        radii = np.linspace(1.001, 12, 4000)
        axial = 1 + self.velocity_departure(radii, 0 * radii)[0]
        crossing = np.flatnonzero((axial[:-1] < 0) & (axial[1:] >= 0))
        if not len(crossing):
            return 0.0
        axial_at = lambda r: 1 + self.velocity_departure(np.array([r]), np.zeros(1))[0][0]
        return (brentq(axial_at, radii[crossing[-1]], radii[crossing[-1] + 1]) - 1) / 2


def polar_coordinates(x, rho):
    """r, sin, cos, s = ln r, theta of axial and radial distances."""
    r = np.hypot(x, rho)
    return r, rho / r, x / r, np.log(r), np.arctan2(rho, x)


def stokes_departure(r):
    """phi - 1/2 of Stokes' solution."""
    return 0.5 * (0.5 / r**3 - 1.5 / r)


def solve_sphere_flow(reynolds, radial_nodes=141, polar_nodes=121, outer_radius=40, report=lambda text: None):
    """The flow at Re = V d / nu in 0.1..300, up to `outer_radius` sphere radii."""
    if not 0 < reynolds <= CONTINUATION[-1]:
        raise ValueError(f"Reynolds number {reynolds}: expected up to {CONTINUATION[-1]}")
    fine = Mesh(radial_nodes, polar_nodes, outer_radius)
    coarse = Mesh(min(65, radial_nodes), min(65, polar_nodes), outer_radius)
    departure, g = stokes_departure(coarse.r), np.zeros_like(coarse.r)
    solver = FlowSolver(coarse)
    for step in [re for re in CONTINUATION if re < reynolds] + [reynolds]:
        departure, g = solver.solve(step, departure, g, tolerance=1e-3)
        report(f"continuation: Re = {step:g}")
    start = [interpolated(coarse, field, fine) for field in (departure, g)]
    return SphereFlow(fine, reynolds, *FlowSolver(fine).solve(reynolds, *start))


def interpolated(source, field, target):
    spline = RectBivariateSpline(source.s, source.theta, source.shape(field))
    return spline(target.s, target.theta).ravel()
