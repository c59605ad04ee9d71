"""Resample a grid whose positions have two dimensions, lat(y, x) and lon(y, x) by CF, to even degrees.

Each quadrilateral of four neighbours is two triangles, and values are linear in each. So holes stay holes, and nothing
is filled beyond the edge of the grid.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hil.charts.chart_survey import GeoBox
from hil.common.errors import ConfigError, MissingExtraError

Array = NDArray[np.float64]

_MAX_PLACES = 25_000_000  # of the even grid
_AT_ONCE = 200_000  # places
_NEAREST = 6  # nodes around a place whose triangles are searched
_EDGE = 1e-6  # share of a triangle by which a place on its edge may be outside
_HIGHEST = 88.0  # deg of latitude; beyond it, degrees of longitude are too short for an even grid


class EvenGrid(NamedTuple):
    """Values from north to south and west to east, nan where there are none; `west`, `north`, steps in deg."""

    values: NDArray[np.float32]
    west: float
    north: float
    east_step: float
    north_step: float


def resample(
    path: str, latitude: Array, longitude: Array, values: NDArray[np.float32], area: GeoBox | None = None
) -> EvenGrid:
    """Return values at even degrees, of an `area` only those; positions are in deg, nan where unknown.

    Raises ConfigError, MissingExtraError.
    """
    try:
        from scipy.spatial import cKDTree
    except ImportError:
        raise MissingExtraError(f"{path}: curved grids need scipy: pip install 'uuv-hil[chart]'") from None
    known = np.isfinite(latitude) & np.isfinite(longitude)
    if min(latitude.shape) < 2 or known.sum() < 4 or np.abs(latitude[known]).max() > 90.0:
        raise ConfigError(f"{path}: its positions of two dimensions are not latitudes and longitudes: warp it to them")
    turned = np.exp(1j * np.radians(longitude[known])).mean()
    middle = area.centre[1] if area else float(np.degrees(np.angle(turned)))
    longitude = middle + (longitude - middle + 180.0) % 360.0 - 180.0
    if area:
        known &= _are_near(area, latitude, longitude)
        if not known.any():
            raise ConfigError(f"{path}: has no positions in the area of --area: use another area")
        latitude, longitude = (np.where(known, each, np.nan) for each in (latitude, longitude))
    if np.abs(latitude[known]).max() > _HIGHEST or np.ptp(longitude[known]) > 180.0:
        raise ConfigError(f"{path}: is a curved grid over a pole or around the earth: use a part of it, by --area")
    short = float(np.cos(np.radians(latitude[known].mean())))
    nodes = np.stack([short * longitude, latitude], axis=-1)
    step = min(float(np.nanmedian(np.hypot(*np.diff(nodes, axis=axis).T))) for axis in (0, 1))
    (west, south), (east, north) = nodes[known].min(axis=0), nodes[known].max(axis=0)
    if not step > 0.0 or (east - west) * (north - south) / step**2 > _MAX_PLACES:
        raise ConfigError(f"{path}: its curved grid has more than {_MAX_PLACES} even positions: cut out a part")
    columns, rows = (1 + int(np.ceil(size / step)) for size in (east - west, north - south))
    x, y = np.linspace(west, east, max(columns, 2)), np.linspace(north, south, max(rows, 2))
    tree, index = cKDTree(nodes[known]), np.append(np.argwhere(known), [[0, 0]], axis=0)  # the last one: no node
    reach = _longest_sides(nodes)
    found = np.full(len(x) * len(y), np.nan, np.float32)
    for begin in range(0, len(found), _AT_ONCE):
        number = np.arange(begin, min(begin + _AT_ONCE, len(found)))
        places = np.stack([x[number % len(x)], y[number // len(x)]], axis=-1)
        distances, near = tree.query(places, _NEAREST, distance_upper_bound=float(reach.max()) + step)
        nearest = index[near]
        is_reached = distances <= reach[nearest[..., 0], nearest[..., 1]] + _EDGE * step
        found[number] = _at(places, nearest, is_reached, nodes, values)
    return EvenGrid(found.reshape(len(y), len(x)), west / short, north, (x[1] - x[0]) / short, y[0] - y[1])


def _are_near(area: GeoBox, latitude: Array, longitude: Array) -> NDArray[np.bool_]:
    """Return which positions are in `area`, or within two cells of it."""
    sides = [np.abs(np.diff(each, axis=axis)) for each in (latitude, longitude) for axis in (0, 1)]
    margin = 2.0 * max(float(np.nanmedian(side)) for side in sides)
    outside = [area.south - latitude, latitude - area.north, area.west - longitude, longitude - area.east]
    return np.asarray(np.fmax.reduce(outside) <= margin)


def _longest_sides(nodes: Array) -> Array:
    """Return the longest side (deg) of the triangles at each node; a place in one of them is no farther from it."""
    longest = np.zeros(nodes.shape[:2])
    before, after = slice(None, -1), slice(1, None)
    for one, other in (
        ((before,), (after,)), ((slice(None), before), (slice(None), after)), ((before, before), (after, after)),
        ((before, after), (after, before)),
    ):  # fmt: skip
        side = np.linalg.norm(nodes[one] - nodes[other], axis=-1)
        for end in (one, other):
            longest[end] = np.fmax(longest[end], side)
    return longest


def _at(
    places: Array, near: NDArray[np.intp], is_reached: NDArray[np.bool_], nodes: Array, values: NDArray[np.float32]
) -> NDArray[np.float32]:
    """Return the values at places, each in one of the triangles at the nodes `near` it (row, column) that reach it."""
    result = np.full(len(places), np.nan, np.float32)
    is_open = np.ones(len(places), bool)
    limits = np.array(nodes.shape[:2]) - 2
    for rank in range(near.shape[1]):
        left = np.flatnonzero(is_open & is_reached[:, rank])
        for corner in ((0, 0), (0, -1), (-1, 0), (-1, -1)):
            cell = near[left, rank] + corner
            for third in ((0, 1), (1, 0)):
                is_cell = ((cell >= 0) & (cell <= limits)).all(axis=1)
                row, column = np.clip(cell, 0, limits).T
                parts = [(row, column), (row + 1, column + 1), (row + third[0], column + third[1])]
                a, b, c = (nodes[part] for part in parts)
                across = _cross(b - a, c - a)
                with np.errstate(divide="ignore", invalid="ignore"):
                    second = _cross(places[left] - a, c - a) / across
                    last = _cross(b - a, places[left] - a) / across
                shares = 1.0 - second - last, second, last
                inside = is_cell & (np.minimum.reduce(shares) >= -_EDGE)
                weighted = sum(share * values[part] for share, part in zip(shares, parts, strict=True))
                result[left[inside]] = np.asarray(weighted)[inside]
                is_open[left[inside]] = False
                left, cell = left[~inside], cell[~inside]
    return result


def _cross(a: Array, b: Array) -> Array:
    return np.asarray(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])
