"""Interpolate scattered depths by a smooth surface: radial basis functions on overlapping patches.

On each patch a surface goes exactly through the points: a sum of r^1.75 (a conditionally positive kernel of order one;
Wendland, Scattered Data Approximation, 2005, chapter 8), smoother than the linear kernel and stiffer than a thin plate.
Distances are stretched along the contours: a bed changes less along its slopes' strike than across, and how much less
shows in how well the contours of a patch agree in direction (geometric anisotropy, as geostatistics has it: Chiles and
Delfiner, Geostatistics, 2012, 2.5.2). Blending with weights that have no jump in slope or curvature (partition of
unity, Wendland 15.4) leaves no creases, which switching from one set of neighbours to the next would, and which a sonar
would see.

How far the bed may be off between its points follows from kriging with that kernel as variogram (Chiles and Delfiner,
chapter 3); the variogram's size is estimated from the depths of each patch.
"""

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hil.autonomy.paths.polygons import Mask
from hil.common.errors import ConfigError

Array = NDArray[np.float64]
Indices = NDArray[np.intp]
Progress = Callable[[float], None]  # takes the share that is done, 0 to 1

LEAF = 20  # points in a patch before it is widened
OVERLAP = 1.0  # how far a patch is widened to each side, in its own size
LEAST_OVERLAP = 0.5  # down to which that is reduced where it makes too large a patch
MOST = 300  # points in such a patch
LEAST = 12  # points that a widened patch must have: it grows until then
MOST_STRETCH = 3.0  # along contours, of a patch
FEWEST_PIECES = 4  # of contours, below which a patch has no direction
LEAST_WEIGHT = 1e-4  # of a patch, below which it does not count
POWER = 1.75  # of the distance, in the kernel
MAIN_WEIGHT = 0.02  # the same for how far it may be off, which need not be as smooth
CHUNK = 500  # nodes evaluated at once: the matrices in between stay in the processor's cache


class Patch(NamedTuple):
    """A rectangle: its centre and half sizes (north, east; m), and the points in it as indices."""

    centre: Array
    half: Array
    inside: Indices


class Doubt(NamedTuple):
    """Expected error of a bed: `variance` in m^2, and `roughness`, the part of it a unit of distance, m^2 / m^1.75."""

    variance: Array
    roughness: Array

    def deviation(self, away: Array) -> Array:
        """Return the standard deviation in m, where the bed is known in `away` m: less than it changes till there."""
        nearby = np.isfinite(away)
        change = np.where(nearby, self.roughness * np.where(nearby, away, 0.0) ** POWER, np.inf)
        return np.asarray(np.sqrt(np.minimum(self.variance, change)))


class Surface:
    """Depth as a function of place, exact in every data point.

    `points`: (n, 2) north, east in m, no two of them alike; `depths`: (n,) in m; `strikes`: (k, 4) pieces of contours,
    their middles and their vectors, north and east in m. Raises ConfigError for fewer than three points.
    """

    def __init__(self, points: Array, depths: Array, strikes: Array | None = None) -> None:
        if len(points) < 3:
            raise ConfigError(f"gridding: a surface needs three depths or more, and there are {len(points)}")
        self._points, self._depths = points, depths
        self._strikes = np.empty((0, 4)) if strikes is None else strikes[np.argsort(strikes[:, 0])]
        self._low, self._high = points.min(axis=0), points.max(axis=0)
        order = np.argsort(points[:, 0])
        boxes = _split(points, np.arange(len(points)), self._low, self._high)
        self._patches = [_widen(points, order, *box) for box in boxes]

    def evaluate(self, north: Array, east: Array, wanted: Mask, report: Progress = lambda share: None) -> Array:
        """Return the depths at the crossings of the growing arrays `north` and `east` in m: (len(north), len(east)).

        Only where `wanted` (of that shape) is true; nan elsewhere.
        """
        return self._blend(north, east, wanted, lambda fit, nodes: fit.at(nodes)[:, None], 1, report=report)[..., 0]

    def doubt(self, north: Array, east: Array, wanted: Mask) -> Doubt:
        """Return how far `evaluate` may be off there, nan where it is not wanted."""
        found = self._blend(north, east, wanted, _Fit.doubts, 2, least=MAIN_WEIGHT)
        return Doubt(found[..., 0], found[..., 1])

    def _blend(
        self, north: Array, east: Array, wanted: Mask, find: Callable[["_Fit", Array], Array], count: int,
        least: float = LEAST_WEIGHT, report: Progress = lambda share: None,
    ) -> Array:  # fmt: skip
        """Return what `find` computes of nodes (n, 2), blended over the patches: `count` values of each.

        `find` gives (n, count) values, this (len(north), len(east), count).
        """
        total, weights = np.zeros((*wanted.shape, count)), np.zeros(wanted.shape)
        for done, patch in enumerate(self._patches):
            report(done / len(self._patches))
            part = self._reached(north, 0, patch), self._reached(east, 1, patch)
            rows, columns = np.nonzero(wanted[part])
            if not len(rows):
                continue
            rows, columns = rows + part[0].start, columns + part[1].start
            nodes = np.column_stack([north[rows], east[columns]])
            weight = self._weight(nodes, patch, least)
            heavy = weight > 0.0
            rows, columns, nodes, weight = rows[heavy], columns[heavy], nodes[heavy], weight[heavy]
            total[rows, columns] += weight[:, None] * find(self._fit(patch), nodes)
            weights[rows, columns] += weight
        report(1.0)
        weights[weights == 0.0] = np.nan
        return np.asarray(total / weights[..., None])

    def at(self, places: Array) -> Array:
        """Return the depths at `places` (n, 2)."""
        total, weights = np.zeros(len(places)), np.zeros(len(places))
        for patch in self._patches:
            weight = self._weight(places, patch)
            near = np.flatnonzero(weight)
            if len(near):
                total[near] += weight[near] * self._fit(patch).at(places[near])
                weights[near] += weight[near]
        return np.asarray(total / weights)

    def held_out(self, folds: Indices) -> tuple[Array, Doubt]:
        """Return the surface at each data point fitted without the points of its fold; nan where the fold is < 0.

        And how far it may be off there, which is estimated without them too.
        Exact and as cheap as one fit: blocks of a system's inverse give the errors that leaving out its unknowns
        would make (Rippa, Adv. Comput. Math. 11, 1999, for one point; the same elimination for several).
        """
        total, weights = np.zeros((len(self._points), 3)), np.zeros(len(self._points))
        for patch in self._patches:
            if not (folds[patch.inside] >= 0).any():
                continue
            weight = self._weight(self._points[patch.inside], patch)
            total[patch.inside] += weight[:, None] * self._fit(patch).without(folds[patch.inside])
            weights[patch.inside] += weight
        weights[folds < 0] = np.nan
        depths, variance, roughness = total.T / weights
        return depths, Doubt(variance, roughness)

    def _fit(self, patch: Patch) -> "_Fit":
        return _Fit(self._points[patch.inside], self._depths[patch.inside], patch, _stretch(self._strikes, patch))

    def _reached(self, axis: Array, k: int, patch: Patch) -> slice:
        """Return which of the nodes along one axis `patch` has a weight at; beyond the data its border stretches on."""
        clipped = np.clip(axis, self._low[k], self._high[k])
        ends = patch.centre[k] - patch.half[k], patch.centre[k] + patch.half[k]
        return slice(int(np.searchsorted(clipped, ends[0], "right")), int(np.searchsorted(clipped, ends[1], "left")))

    def _weight(self, nodes: Array, patch: Patch, least: float = LEAST_WEIGHT) -> Array:
        """Return Wendland's C2 function along both axes: 1 in the patch's middle, 0 on its rim, and below `least`."""
        clipped = np.clip(nodes, self._low, self._high)
        t = np.minimum(np.abs(clipped - patch.centre) / patch.half, 1.0)
        rest = (1.0 - t) * (1.0 - t)
        weights = rest * rest * (4.0 * t + 1.0)
        return np.maximum(weights[:, 0] * weights[:, 1] - least, 0.0)


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


def _widen(points: Array, order: Indices, low: Array, high: Array) -> Patch:
    """Return the patch around a box; `order`: the points' from south to north."""
    centre, size = 0.5 * (low + high), np.maximum(high - low, 1e-3)
    norths = points[order, 0]

    def inside(half: Array) -> Indices:
        near = order[slice(*np.searchsorted(norths, (centre[0] - half[0], centre[0] + half[0])))]
        return np.sort(near[(np.abs(points[near] - centre) < half).all(axis=1)])

    half = (0.5 + OVERLAP) * size
    while len(inside(half)) > MOST and half[0] > (0.5 + LEAST_OVERLAP) * size[0]:
        half = np.maximum(0.9 * half, (0.5 + LEAST_OVERLAP) * size)
    while len(inside(half)) < min(LEAST, len(points)):
        half = 1.3 * half
    return Patch(centre, half, inside(half))


def _stretch(strikes: Array, patch: Patch) -> Array:
    """Return the matrix (2, 2) to multiply offsets from the patch's centre with: no unit, nearer along the contours.

    The contours' length is what a gradient's size is (the coarea formula), so the sum of the squares of their normals
    is the structure tensor of the bed. No depth is in it: to hold out a sounding leaves it as it is.
    """
    scale: Array = np.eye(2) / patch.half.max()
    ends = patch.centre[0] - patch.half[0], patch.centre[0] + patch.half[0]
    pieces = strikes[slice(*np.searchsorted(strikes[:, 0], ends))]  # which grow to the north
    pieces = pieces[np.abs(pieces[:, 1] - patch.centre[1]) < patch.half[1]]
    if len(pieces) < FEWEST_PIECES:
        return scale
    normals = np.column_stack([-pieces[:, 3], pieces[:, 2]])
    lengths = np.maximum(np.hypot(*normals.T), 1e-9)
    sizes, directions = np.linalg.eigh((normals / lengths[:, None]).T @ normals)
    stretch = min(MOST_STRETCH, float(np.sqrt(sizes[1] / max(sizes[0], 1e-9 * sizes[1]))))
    stretched: Array = scale @ directions @ np.diag([stretch**-0.5, stretch**0.5])
    return stretched


class _Fit:
    """The surface through the points of one patch."""

    def __init__(self, points: Array, depths: Array, patch: Patch, stretch: Array) -> None:
        self._centre, self._stretch = patch.centre, stretch
        self._unit = 1.0 / patch.half.max()  # of scaled distances, as the stretch keeps areas
        self._points, self._depths = self._scaled(points), depths
        size = len(points) + 1
        self._system = np.ones((size, size))
        self._system[:-1, :-1] = _kernel(self._points, self._points)
        self._system[-1, -1] = 0.0
        self._right = np.append(depths, 0.0)

    def at(self, nodes: Array) -> Array:
        """Return the surface at `nodes` (n, 2)."""
        solution = np.linalg.solve(self._system, self._right)
        return np.concatenate([
            _kernel(self._scaled(nodes[start : start + CHUNK]), self._points) @ solution[:-1] + solution[-1]
            for start in range(0, max(1, len(nodes)), CHUNK)
        ])  # fmt: skip

    def doubts(self, nodes: Array) -> Array:
        """Return the variance and the roughness at `nodes` (n, 2) as columns."""
        inverse = np.linalg.inv(self._system)
        sill = self._sill(float(self._right @ inverse @ self._right), len(self._points))
        found = np.full((len(nodes), 2), sill * self._unit**POWER)
        for start in range(0, len(nodes), CHUNK):
            part = self._scaled(nodes[start : start + CHUNK])
            to = np.column_stack([_kernel(part, self._points), np.ones(len(part))])
            found[start : start + CHUNK, 0] = sill * np.maximum(0.0, -((to @ inverse) * to).sum(axis=1))
        return found

    def without(self, folds: Indices) -> Array:
        """Return the surface at each point, had the points of its fold not been there, its variance and roughness."""
        inverse = np.linalg.inv(self._system)
        solution = inverse @ self._right
        whole = float(self._right @ solution)
        found = np.column_stack([self._depths, np.zeros((len(self._points), 2))])
        for fold in np.unique(folds[folds >= 0]):
            left_out = np.flatnonzero(folds == fold)
            block = inverse[np.ix_(left_out, left_out)]
            errors = np.linalg.solve(block, solution[left_out])
            sill = self._sill(whole - float(solution[left_out] @ errors), len(self._points) - len(left_out))
            found[left_out, 0] -= errors
            found[left_out, 1] = sill * np.maximum(0.0, np.diag(np.linalg.inv(block)))
            found[left_out, 2] = sill * self._unit**POWER
        return found

    @staticmethod
    def _sill(energy: float, count: int) -> float:
        """Return the size of the variogram in m^2 by `count` depths, whose quadratic form `energy` is (REML)."""
        return max(0.0, energy) / max(1, count - 1)

    def _scaled(self, points: Array) -> Array:
        return np.asarray((points - self._centre) @ self._stretch)


def _kernel(a: Array, b: Array) -> Array:
    """Return minus the distances to the power 1.75, (len(a), len(b)): by roots, which are faster than powers."""
    from scipy.spatial.distance import cdist

    distances = cdist(a, b)
    roots = np.sqrt(distances)
    distances *= -roots
    distances *= np.sqrt(roots, out=roots)
    return np.asarray(distances)
