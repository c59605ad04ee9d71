"""Interpolate scattered depths by a smooth surface: radial basis functions on overlapping patches.

On each patch the surface passes exactly through the points. The kernel is a power of the distance (conditionally
positive definite of order one; Wendland, Scattered Data Approximation, 2005, chapter 8), from the linear kernel almost
to the smoothness of a thin plate. Rough beds need a lower power than smooth ones, so the data select it
(hil.charts.held_out). Distances along the contours count less than distances across, because a bed changes less along
the strike of its slopes. How much less follows from how well the contours of a patch agree in direction (geometric
anisotropy; Chiles and Delfiner, Geostatistics, 2012, 2.5.2).

The patches are blended with weights that are continuous in slope and curvature (partition of unity, Wendland 15.4).
This leaves no creases, which a sonar would show.

The expected error between the points follows from kriging with this kernel as variogram (Chiles and Delfiner,
chapter 3). The scale of the variogram of each patch is estimated by leaving out one sounding at a time, as the
geometric mean: few soundings beside steep shores must not make a level bed uncertain.
"""

from collections.abc import Callable, Iterator
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hil.autonomy.paths.polygons import Mask
from hil.common.errors import ConfigError

Array = NDArray[np.float64]
Indices = NDArray[np.intp]
Progress = Callable[[float], None]  # called with the share that is done, 0 to 1

BOX_POINTS = 20  # greatest number of points in a box, from which a patch is made by widening it
OVERLAP = 1.0  # by which a box is widened on each side, as a multiple of its size
MIN_OVERLAP = 0.5  # to which the overlap is reduced if the patch has too many points
MAX_PATCH_POINTS = 300  # above which the overlap is reduced
# Beside dense data a large box around stray points takes in thousands, and the matrices of a patch grow by the square.
MOST_PATCH_POINTS, LEAST_OVERLAP = 1200, 0.05
MIN_PATCH_POINTS = 12  # below which a patch is widened further
MAX_STRETCH = 3.0  # greatest ratio of distances across and along contours
MIN_SEGMENTS = 4  # of contours, below which distances of a patch are not stretched
MIN_WEIGHT = 1e-4  # subtracted from weights, so that a patch ends where its weight is small
POWERS = (1.0, 1.25, 1.5, 1.75)  # of the distance, in the kernel
MIN_SOUNDINGS = 4  # of a patch, below which the scale is estimated from all of its points
MIN_ERROR = 0.05  # m; half of the decimetre to which charts give depths
CHI_SQUARED = 3.56  # inverse geometric mean of squares of a standard normal distribution, 2 exp(Euler's constant)
MIN_ERROR_WEIGHT = 0.02  # as MIN_WEIGHT, for the expected error, which need not be as smooth
CHUNK = 500  # nodes evaluated at once: the intermediate matrices fit into the processor's cache


class Patch(NamedTuple):
    """A rectangle: its centre and half sizes (north, east; m), and the points in it as indices."""

    centre: Array
    half: Array
    inside: Indices


class Model(NamedTuple):
    """Statistics of a bed.

    - `power` of the distance in the kernel, one of POWERS.
    - `spread`: its standard deviation, as a multiple of the robust estimate of each patch.
    - `shift`: the mean difference of the bed from its expected depth, in standard deviations; negative if shoaler.
    """

    power: float = 1.5
    spread: float = 1.0
    shift: float = 0.0


class Uncertainty(NamedTuple):
    """Expected error of a bed: `variance` (m^2), and `roughness`, its increase with distance (m^2 / m^`power`)."""

    variance: Array
    roughness: Array
    power: float

    def deviation(self, away: Array) -> Array:
        """Return the standard deviation (m) at `away` m from where the bed is known.

        It is the lesser of the deviation by `variance` and the expected change of the bed over that distance.
        """
        nearby = np.isfinite(away)
        change = np.where(nearby, self.roughness * np.where(nearby, away, 0.0) ** self.power, np.inf)
        return np.asarray(np.sqrt(np.minimum(self.variance, change)))


class Surface:
    """Depth as a function of position, exact at every data point.

    `points`: (n, 2) north, east in m, without duplicates; `depths`: (n,) in m; `strikes`: (k, 4) segments of contours:
    centres and vectors, north and east in m. The first `soundings` of the points, all by default, are soundings.
    Raises ConfigError for fewer than three points.
    """

    def __init__(
        self, points: Array, depths: Array, strikes: Array | None = None, soundings: int | None = None,
        model: Model = Model(),
    ) -> None:  # fmt: skip
        if len(points) < 3:
            raise ConfigError(
                f"gridding: a surface needs at least three depths, found {len(points)}: use a file with more soundings"
            )
        self._points, self._depths = points, depths
        self._soundings = len(points) if soundings is None else soundings
        self._strikes = np.empty((0, 4)) if strikes is None else strikes[np.argsort(strikes[:, 0])]
        self._low, self._high = points.min(axis=0), points.max(axis=0)
        order = np.argsort(points[:, 0])
        boxes = _split_box(points, np.arange(len(points)), self._low, self._high)
        self._patches = [_widen_box(points, order, *box) for box in boxes]
        self.model = model

    def evaluate(self, north: Array, east: Array, mask: Mask, report: Progress = lambda share: None) -> Array:
        """Return the depths at the crossings of the increasing arrays `north` and `east` (m): (len(north), len(east)).

        Only where `mask` (same shape) is true; nan elsewhere.
        """
        return self._blend(north, east, mask, lambda fit, nodes: fit.at(nodes)[:, None], 1, report=report)[..., 0]

    def uncertainty(self, north: Array, east: Array, mask: Mask) -> Uncertainty:
        """Return the expected error of `evaluate` with the same arguments, nan where `mask` is false."""
        found = self._blend(north, east, mask, _PatchFit.uncertainties, 2, least=MIN_ERROR_WEIGHT)
        return Uncertainty(found[..., 0], found[..., 1], self.model.power)

    def _blend(
        self, north: Array, east: Array, mask: Mask, find: Callable[["_PatchFit", Array], Array], count: int,
        least: float = MIN_WEIGHT, report: Progress = lambda share: None,
    ) -> Array:  # fmt: skip
        """Return the values that `find` computes at the nodes, blended over the patches: (rows, columns, `count`).

        `find` is called with the fit of a patch and nodes (n, 2), and returns (n, `count`) values.
        """
        total, weights = np.zeros((*mask.shape, count)), np.zeros(mask.shape)
        for done, patch in enumerate(self._patches):
            report(done / len(self._patches))
            patch_nodes = self._nodes_of_patch(north, 0, patch), self._nodes_of_patch(east, 1, patch)
            rows, columns = np.nonzero(mask[patch_nodes])
            if not len(rows):
                continue
            rows, columns = rows + patch_nodes[0].start, columns + patch_nodes[1].start
            nodes = np.column_stack([north[rows], east[columns]])
            weight = self._weight(nodes, patch, least)
            heavy = weight > 0.0
            rows, columns, nodes, weight = rows[heavy], columns[heavy], nodes[heavy], weight[heavy]
            total[rows, columns] += weight[:, None] * find(self._fit(patch), nodes)
            weights[rows, columns] += weight
        report(1.0)
        weights[weights == 0.0] = np.nan
        return np.asarray(total / weights[..., None])

    def at(self, points: Array) -> Array:
        """Return the depths (m) at `points` (n, 2)."""
        total, weights = np.zeros(len(points)), np.zeros(len(points))
        for patch in self._patches:
            weight = self._weight(points, patch)
            near = np.flatnonzero(weight)
            if len(near):
                total[near] += weight[near] * self._fit(patch).at(points[near])
                weights[near] += weight[near]
        return np.asarray(total / weights)

    def cross_validate(
        self, folds: Indices, model: Model | None = None, most: int | None = None
    ) -> tuple[Array, Uncertainty]:
        """Return, at the first n data points, the depth and its expected error from a fit without those of its fold.

        `folds`: the fold of each point, (n,), or (n, k) for k independent divisions; nan is returned where it is
        negative. `model` replaces that of the surface. `most`: about how many patches to use, if there are more; nan is
        returned outside them. Exact and as cheap as one fit: blocks of the inverse of a system give the errors of
        leaving out its unknowns (Rippa, Adv. Comput. Math. 11, 1999, for one point; the same elimination for several).
        """
        model, divisions = model or self.model, folds.reshape(len(folds), -1)
        total, weights = np.zeros((len(self._points), divisions.shape[1], 3)), np.zeros(len(self._points))
        divisions = np.vstack([divisions, np.full((len(self._points) - len(folds), divisions.shape[1]), -1)])
        for patch in self._patches[:: 1 + len(self._patches) // most if most else 1]:
            if not (divisions[patch.inside] >= 0).any():
                continue
            weight, fit = self._weight(self._points[patch.inside], patch), self._fit(patch, model)
            found = np.stack([fit.without(division) for division in divisions[patch.inside].T], axis=1)
            total[patch.inside] += weight[:, None, None] * found
            weights[patch.inside] += weight
        weights[weights == 0.0] = np.nan
        mean = total[: len(folds)] / weights[: len(folds), None, None]
        mean[divisions[: len(folds)] < 0] = np.nan
        depths, variance, roughness = (part.reshape(folds.shape) for part in np.moveaxis(mean, 2, 0))
        return depths, Uncertainty(variance, roughness, model.power)

    def _fit(self, patch: Patch, model: Model | None = None) -> "_PatchFit":
        return _PatchFit(
            self._points[patch.inside], self._depths[patch.inside], patch.inside < self._soundings,
            patch, _stretch(self._strikes, patch), model or self.model,
        )  # fmt: skip

    def _nodes_of_patch(self, axis: Array, k: int, patch: Patch) -> slice:
        """Return the range of nodes along one axis that `patch` covers; at the edge of the data it extends beyond."""
        clipped = np.clip(axis, self._low[k], self._high[k])
        ends = patch.centre[k] - patch.half[k], patch.centre[k] + patch.half[k]
        return slice(int(np.searchsorted(clipped, ends[0], "right")), int(np.searchsorted(clipped, ends[1], "left")))

    def _weight(self, nodes: Array, patch: Patch, least: float = MIN_WEIGHT) -> Array:
        """Return the weight of `patch` at `nodes` (n, 2): the product of Wendland's C2 functions along both axes.

        It is 1 - `least` in the centre of the patch, and 0 at its edge and where the product is below `least`.
        """
        clipped = np.clip(nodes, self._low, self._high)
        t = np.minimum(np.abs(clipped - patch.centre) / patch.half, 1.0)
        rest = (1.0 - t) * (1.0 - t)
        weights = rest * rest * (4.0 * t + 1.0)
        return np.maximum(weights[:, 0] * weights[:, 1] - least, 0.0)


def _split_box(points: Array, inside: Indices, low: Array, high: Array) -> Iterator[tuple[Array, Array]]:
    """Yield the boxes (low, high) made by cutting a box at the median of its longer side down to BOX_POINTS points."""
    if len(inside) <= BOX_POINTS:
        yield low, high
        return
    axis = int(np.argmax(high - low))
    values = points[inside, axis]
    margin = 0.25 * (high[axis] - low[axis])  # no slivers
    cut = float(np.clip(np.median(values), low[axis] + margin, high[axis] - margin))
    below, above = high.copy(), low.copy()
    below[axis] = above[axis] = cut
    yield from _split_box(points, inside[values <= cut], low, below)
    yield from _split_box(points, inside[values > cut], above, high)


def _widen_box(points: Array, order: Indices, low: Array, high: Array) -> Patch:
    """Return the patch made by widening a box; `order`: indices of the points from south to north."""
    centre, size = 0.5 * (low + high), np.maximum(high - low, 1e-3)
    norths = points[order, 0]

    def inside(half: Array) -> Indices:
        near = order[slice(*np.searchsorted(norths, (centre[0] - half[0], centre[0] + half[0])))]
        return np.sort(near[(np.abs(points[near] - centre) < half).all(axis=1)])

    half = (0.5 + OVERLAP) * size
    for most, overlap in ((MAX_PATCH_POINTS, MIN_OVERLAP), (MOST_PATCH_POINTS, LEAST_OVERLAP)):
        while len(inside(half)) > most and half[0] > (0.5 + overlap) * size[0]:
            half = np.maximum(0.9 * half, (0.5 + overlap) * size)
    while len(inside(half)) < min(MIN_PATCH_POINTS, len(points)):
        half = 1.3 * half
    return Patch(centre, half, inside(half))


def _stretch(strikes: Array, patch: Patch) -> Array:
    """Return the matrix (2, 2) that scales offsets from the patch's centre, to shorter distances along the contours.

    The length of contours is proportional to the gradient (coarea formula), so the sum of the outer products of their
    normals is the structure tensor of the bed. It contains no depth, so holding out a sounding does not change it.
    """
    scale: Array = np.eye(2) / patch.half.max()
    ends = patch.centre[0] - patch.half[0], patch.centre[0] + patch.half[0]
    pieces = strikes[slice(*np.searchsorted(strikes[:, 0], ends))]  # they are sorted from south to north
    pieces = pieces[np.abs(pieces[:, 1] - patch.centre[1]) < patch.half[1]]
    if len(pieces) < MIN_SEGMENTS:
        return scale
    normals = np.column_stack([-pieces[:, 3], pieces[:, 2]])
    lengths = np.maximum(np.hypot(*normals.T), 1e-9)
    sizes, directions = np.linalg.eigh((normals / lengths[:, None]).T @ normals)
    stretch = min(MAX_STRETCH, float(np.sqrt(sizes[1] / max(sizes[0], 1e-9 * sizes[1]))))
    stretched: Array = scale @ directions @ np.diag([stretch**-0.5, stretch**0.5])
    return stretched


class _PatchFit:
    """Interpolant of the points of one patch."""

    def __init__(
        self, points: Array, depths: Array, soundings: Mask, patch: Patch, stretch: Array, model: Model
    ) -> None:
        self._centre, self._stretch, self._power, self._spread = patch.centre, stretch, model.power, model.spread
        self._unit = 1.0 / patch.half.max()  # scaled distance per m, on average: the stretch preserves areas
        self._points, self._depths, self._soundings = self._scaled(points), depths, soundings
        size = len(points) + 1
        self._system = np.ones((size, size))
        self._system[:-1, :-1] = _kernel(self._points, self._points, self._power)
        self._system[-1, -1] = 0.0
        self._right = np.append(depths, 0.0)

    def at(self, nodes: Array) -> Array:
        """Return the depths at `nodes` (n, 2)."""
        solution = np.linalg.solve(self._system, self._right)
        return np.concatenate([
            _kernel(self._scaled(part), self._points, self._power) @ solution[:-1] + solution[-1]
            for part in (nodes[start : start + CHUNK] for start in range(0, max(1, len(nodes)), CHUNK))
        ])  # fmt: skip

    @cached_property
    def _inverse(self) -> Array:
        return np.asarray(np.linalg.inv(self._system))

    def uncertainties(self, nodes: Array) -> Array:
        """Return variance and roughness at `nodes` (n, 2): (n, 2)."""
        inverse, some = self._inverse, self._representative(np.arange(len(self._points)))
        sill = self._sill((inverse @ self._right)[some], np.diag(inverse)[some])
        found = np.full((len(nodes), 2), sill * self._unit**self._power)
        for start in range(0, len(nodes), CHUNK):
            part = self._scaled(nodes[start : start + CHUNK])
            to = np.column_stack([_kernel(part, self._points, self._power), np.ones(len(part))])
            found[start : start + CHUNK, 0] = sill * np.maximum(0.0, -((to @ inverse) * to).sum(axis=1))
        return found

    def without(self, folds: Indices) -> Array:
        """Return depth, variance and roughness at each point, fitted without the points of its fold: (n, 3)."""
        inverse = self._inverse
        solution, diagonal = inverse @ self._right, np.diag(inverse)
        results = np.column_stack([self._depths, np.zeros((len(self._points), 2))])
        for fold in np.unique(folds[folds >= 0]):
            left_out, some = np.flatnonzero(folds == fold), self._representative(np.flatnonzero(folds != fold))
            variances = np.linalg.inv(inverse[np.ix_(left_out, left_out)])
            errors = variances @ solution[left_out]
            across = inverse[np.ix_(some, left_out)]  # eliminates the points that are left out
            sill = self._sill(
                solution[some] - across @ errors, diagonal[some] - (across @ variances * across).sum(axis=1)
            )
            results[left_out, 0] -= errors
            results[left_out, 1] = sill * np.maximum(0.0, np.diag(variances))
            results[left_out, 2] = sill * self._unit**self._power
        return results

    def _representative(self, points: Indices) -> Indices:
        """Return those of `points` by which the variogram is scaled: the soundings, or all if they are too few."""
        soundings = points[self._soundings[points]]
        return soundings if len(soundings) >= MIN_SOUNDINGS else points

    def _sill(self, solution: Array, diagonal: Array) -> float:
        """Return the scale of the variogram (m^2) from the errors of leaving out one of n points at a time.

        `solution`: coefficients of the interpolant; `diagonal`: of the inverse of its system, both (n,). An error is
        the ratio of the two, its variance the inverse diagonal (Rippa, Adv. Comput. Math. 11, 1999).
        """
        diagonal = np.maximum(diagonal, 1e-12)
        squares = np.maximum(solution * solution / diagonal, MIN_ERROR * MIN_ERROR * diagonal)
        return float(self._spread**2 * CHI_SQUARED * np.exp(np.log(squares).mean()))

    def _scaled(self, points: Array) -> Array:
        return np.asarray((points - self._centre) @ self._stretch)


def _kernel(a: Array, b: Array, power: float) -> Array:
    """Return minus the distances to one of POWERS, (len(a), len(b)), by square roots, which are faster than powers."""
    from scipy.spatial.distance import cdist

    distances = cdist(a, b)
    if power > 1.0:
        root = np.sqrt(distances)  # the factor of a power of 1.5
        if power == 1.25:
            np.sqrt(root, out=root)
        elif power == 1.75:
            root *= np.sqrt(root)
        distances *= root
    return np.asarray(np.negative(distances, out=distances))
