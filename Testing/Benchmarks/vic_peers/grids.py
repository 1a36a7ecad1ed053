"""Regular grids as arrays indexed [x, y, z, component], and differences on them."""
import numpy as np


class Nodes:
    """A regular grid: origin (m), spacing (m), number of nodes along x, y and z."""

    def __init__(self, origin, spacing, shape):
        self.origin, self.spacing, self.shape = np.asarray(origin, float), float(spacing), tuple(int(n) for n in shape)

    @property
    def bounds(self):
        end = self.origin + self.spacing * (np.array(self.shape) - 1)
        return [v for pair in zip(self.origin, end) for v in pair]

    def places(self):
        axes = [self.origin[i] + self.spacing * np.arange(self.shape[i]) for i in range(3)]
        return np.stack(np.meshgrid(*axes, indexing="ij"), -1)

    def part(self, low, high):
        """The nodes from index `low` to below `high`."""
        return Nodes(self.origin + self.spacing * np.asarray(low), self.spacing, np.asarray(high) - np.asarray(low))


def gradient(field, spacing, valid=None, order=4):
    """d_j u_i as [..., i, j]. Central differences of `order` where the valid neighbours allow it, else of second order, else one-sided
    ones of second order, else of first; NaN where there is no neighbour. Invalid nodes are never touched."""
    valid = np.ones(field.shape[:-1], bool) if valid is None else valid
    out = np.full(field.shape + (3,), np.nan)
    for axis in range(3):
        f, v = _padded(field, axis, np.nan), _padded(valid, axis, False)
        n = field.shape[axis]

        def at(array, shift):
            return array[tuple(slice(2 + shift, 2 + shift + n) if i == axis else slice(None) for i in range(array.ndim))]

        def use(condition, difference):
            todo = condition & valid & np.isnan(out[..., 0, axis])
            out[todo, :, axis] = difference[todo] / spacing

        ok = {s: at(v, s) for s in (-2, -1, 1, 2)}
        value = {s: at(f, s) for s in (-2, -1, 0, 1, 2)}
        if order == 4:
            use(ok[-2] & ok[-1] & ok[1] & ok[2], (8 * (value[1] - value[-1]) - (value[2] - value[-2])) / 12)
        use(ok[-1] & ok[1], (value[1] - value[-1]) / 2)
        for s in (1, -1):
            use(ok[s] & ok[2 * s], s * (4 * value[s] - 3 * value[0] - value[2 * s]) / 2)
        for s in (1, -1):
            use(ok[s], s * (value[s] - value[0]))
    return out


def _padded(array, axis, fill):
    width = [(2, 2) if i == axis else (0, 0) for i in range(array.ndim)]
    return np.pad(array, width, constant_values=fill)


def curl(g):
    return np.stack([g[..., 2, 1] - g[..., 1, 2], g[..., 0, 2] - g[..., 2, 0], g[..., 1, 0] - g[..., 0, 1]], -1)


def divergence_ratio(g, chosen):
    """rms div u over rms |grad u| on the chosen nodes."""
    g = g[chosen]
    return float(np.sqrt((np.trace(g, axis1=-2, axis2=-1) ** 2).mean() / (g**2).sum((-2, -1)).mean()))


def rms(a):
    return float(np.sqrt(np.mean(np.square(a, dtype=float))))
