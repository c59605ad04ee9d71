"""Interpolate scattered depths by a smooth surface: radial basis functions on overlapping patches.

On each patch two surfaces go exactly through the points, and their mean is taken: a thin-plate spline, which is
smooth, and the linear kernel, which does not overshoot (Wendland, Scattered Data Approximation, 2005, chapters 8
and 15). Blending with weights that have no jump in slope or curvature (partition of unity, the same, 15.4) leaves
no creases, which switching from one set of neighbours to the next would, and which a sonar would see.
"""

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hil.charts.polygons import Mask
from hil.common.errors import ConfigError

Array = NDArray[np.float64]
Indices = NDArray[np.intp]
Progress = Callable[[float], None]  # takes the share that is done, 0 to 1

LEAF = 80  # points in a patch before it is widened
OVERLAP = 0.35  # how far a patch is widened to each side, in its own size
LEAST = 12  # points that a widened patch must have: it grows until then
FLAT = 1e-3  # points this near to one line, in their spread, have no thin plate
CHUNK = 2000  # nodes evaluated at once: the matrices in between stay in the processor's cache


class Patch(NamedTuple):
    """A rectangle: its centre and half sizes (north, east; m), and the points in it as indices."""

    centre: Array
    half: Array
    inside: Indices


class Surface:
    """Depth as a function of place, exact in every data point.

    `points`: (n, 2) north, east in m, no two of them alike; `depths`: (n,) in m. Raises ConfigError for fewer
    than three points.
    """

    def __init__(self, points: Array, depths: Array) -> None:
        if len(points) < 3:
            raise ConfigError(f"gridding: a surface needs three depths or more, and there are {len(points)}")
        self._points, self._depths = points, depths
        self._low, self._high = points.min(axis=0), points.max(axis=0)
        boxes = _split(points, np.arange(len(points)), self._low, self._high)
        self._patches = [_widen(points, *box) for box in boxes]

    def evaluate(self, north: Array, east: Array, wanted: Mask, report: Progress = lambda share: None) -> Array:
        """Depths at the crossings of the growing arrays `north` and `east` in m: (len(north), len(east)).

        Only where `wanted` (of that shape) is true; nan elsewhere.
        """
        total, weights = np.zeros(wanted.shape), np.zeros(wanted.shape)
        for done, patch in enumerate(self._patches):
            report(done / len(self._patches))
            part = self._reached(north, 0, patch), self._reached(east, 1, patch)
            rows, columns = np.nonzero(wanted[part])
            if not len(rows):
                continue
            rows, columns = rows + part[0].start, columns + part[1].start
            nodes = np.column_stack([north[rows], east[columns]])
            weight = self._weight(nodes, patch)
            total[rows, columns] += weight * self._fit(patch).at(nodes)
            weights[rows, columns] += weight
        report(1.0)
        return np.where(weights > 0.0, total / np.where(weights > 0.0, weights, 1.0), np.nan)

    def held_out(self, folds: Indices) -> Array:
        """Return the surface at each data point fitted without the points of its fold; nan where the fold is < 0.

        Exact and as cheap as one fit: blocks of a system's inverse tell the errors that leaving out its unknowns
        would make (Rippa, Adv. Comput. Math. 11, 1999, for one point; the same elimination for several).
        """
        total, weights = np.zeros(len(self._points)), np.zeros(len(self._points))
        for patch in self._patches:
            weight = self._weight(self._points[patch.inside], patch)
            total[patch.inside] += weight * self._fit(patch).without(folds[patch.inside])
            weights[patch.inside] += weight
        return np.where(folds < 0, np.nan, total / weights)

    def _fit(self, patch: Patch) -> "_Fit":
        return _Fit(self._points[patch.inside], self._depths[patch.inside], patch)

    def _reached(self, axis: Array, k: int, patch: Patch) -> slice:
        """Return which of the nodes along one axis `patch` has a say in; beyond the data its border stretches on."""
        clipped = np.clip(axis, self._low[k], self._high[k])
        ends = patch.centre[k] - patch.half[k], patch.centre[k] + patch.half[k]
        return slice(int(np.searchsorted(clipped, ends[0], "right")), int(np.searchsorted(clipped, ends[1], "left")))

    def _weight(self, nodes: Array, patch: Patch) -> Array:
        """Wendland's C2 function along both axes: 1 in the middle of the patch, 0 on its rim."""
        clipped = np.clip(nodes, self._low, self._high)
        t = np.minimum(np.abs(clipped - patch.centre) / patch.half, 1.0)
        return np.asarray(np.prod((1.0 - t) ** 4 * (4.0 * t + 1.0), axis=1))


def _split(points: Array, inside: Indices, low: Array, high: Array) -> Iterator[tuple[Array, Array]]:
    """Cut the box from `low` to `high` near the median of its longer side until its parts hold few points."""
    if len(inside) <= LEAF:
        yield low, high
        return
    axis = int(np.argmax(high - low))
    values = points[inside, axis]
    margin = 0.25 * (high[axis] - low[axis])  # no slivers
    cut = float(np.clip(np.median(values), low[axis] + margin, high[axis] - margin))
    below, above = high.copy(), low.copy()
    below[axis] = above[axis] = cut
    yield from _split(points, inside[values <= cut], low, below)
    yield from _split(points, inside[values > cut], above, high)


def _widen(points: Array, low: Array, high: Array) -> Patch:
    centre, half = 0.5 * (low + high), (0.5 + OVERLAP) * np.maximum(high - low, 1e-3)
    wanted = min(LEAST, len(points))
    while len(inside := np.flatnonzero((np.abs(points - centre) < half).all(axis=1))) < wanted:
        half *= 1.3
    return Patch(centre, half, inside)


class _Fit:
    """Both surfaces through the points of one patch."""

    def __init__(self, points: Array, depths: Array, patch: Patch) -> None:
        self._centre, self._scale = patch.centre, float(patch.half.max())
        self._points, self._depths = self._scaled(points), depths
        spread = np.linalg.svd(self._points - self._points.mean(axis=0), compute_uv=False)
        kernels: list[_Kernel] = [_linear] if spread[1] < FLAT * spread[0] else [_linear, _thin_plate]
        self._kernels = kernels

    def at(self, nodes: Array) -> Array:
        """Return the mean of the surfaces at `nodes` (n, 2)."""
        solved = [np.linalg.solve(self._system(kernel), self._right(kernel)) for kernel in self._kernels]
        parts = []
        for start in range(0, len(nodes), CHUNK):
            chunk = self._scaled(nodes[start : start + CHUNK])
            squares = _squares(chunk, self._points)
            surfaces = [
                kernel(squares) @ solution[: len(self._points)] + _tail(kernel, chunk) @ solution[len(self._points) :]
                for kernel, solution in zip(self._kernels, solved, strict=True)
            ]
            parts.append(np.mean(surfaces, axis=0))
        return np.concatenate(parts)

    def without(self, folds: Indices) -> Array:
        """Return the mean of the surfaces at each point, had the points of its fold not been there."""
        return np.asarray(self._depths - np.mean([self._errors(kernel, folds) for kernel in self._kernels], axis=0))

    def _errors(self, kernel: "_Kernel", folds: Indices) -> Array:
        inverse = np.linalg.inv(self._system(kernel))
        solution = inverse @ self._right(kernel)
        errors = np.zeros(len(self._points))
        for fold in np.unique(folds[folds >= 0]):
            left_out = np.flatnonzero(folds == fold)
            errors[left_out] = np.linalg.solve(inverse[np.ix_(left_out, left_out)], solution[left_out])
        return errors

    def _system(self, kernel: "_Kernel") -> Array:
        tail = _tail(kernel, self._points)
        corner = np.zeros((tail.shape[1], tail.shape[1]))
        return np.block([[kernel(_squares(self._points, self._points)), tail], [tail.T, corner]])

    def _right(self, kernel: "_Kernel") -> Array:
        return np.concatenate([self._depths, np.zeros(_tail(kernel, self._points).shape[1])])

    def _scaled(self, points: Array) -> Array:
        return (points - self._centre) / self._scale


_Kernel = Callable[[Array], Array]  # of squared distances


def _linear(squares: Array) -> Array:
    return -np.sqrt(squares)


def _thin_plate(squares: Array) -> Array:
    return np.asarray(squares * np.log(np.maximum(squares, 1e-300)))


def _tail(kernel: _Kernel, points: Array) -> Array:
    """Return the polynomial a kernel comes with: a constant, for the thin plate a plane."""
    one = np.ones((len(points), 1))
    return one if kernel is _linear else np.hstack([one, points])


def _squares(a: Array, b: Array) -> Array:
    """Squared distances, (len(a), len(b))."""
    from scipy.spatial.distance import cdist

    return np.asarray(cdist(a, b, "sqeuclidean"))
