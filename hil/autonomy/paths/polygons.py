"""Test which points are inside areas, possibly with holes, that are defined by unordered edges."""

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Window = tuple[slice, slice]  # rows, columns
Edges = tuple[Array, ...]  # each (n, 2) north, east in m


def segments(edges: Iterable[Array]) -> tuple[Array, Array]:
    """Return the start and end points of all straight segments, (n, 2) each."""
    edges = list(edges)
    if not edges:
        return np.empty((0, 2)), np.empty((0, 2))
    return np.concatenate([edge[:-1] for edge in edges]), np.concatenate([edge[1:] for edge in edges])


def fill(edges: Edges, north: Array, east: Array) -> tuple[Window, Mask]:
    """Return which nodes of the grid of increasing `north` and `east` (m) are inside the area.

    The result is the window of rows and columns around the area, and a mask of its nodes.
    """
    start, end = segments(edges)
    if not len(start):
        return (slice(0, 0), slice(0, 0)), np.zeros((0, 0), bool)
    rows, columns = (_within(axis, start[:, k], end[:, k]) for k, axis in enumerate((north, east)))
    return (rows, columns), _crossed(start, end, north[rows], east[columns])


def _within(axis: Array, start: Array, end: Array) -> slice:
    low, high = np.minimum(start, end).min(), np.maximum(start, end).max()
    return slice(int(np.searchsorted(axis, low)), int(np.searchsorted(axis, high, "right")))


def _crossed(start: Array, end: Array, north: Array, east: Array) -> Mask:
    """Return the nodes where an odd number of edges has been crossed, coming from the west along a row."""
    first, last = np.sort([np.searchsorted(north, start[:, 0]), np.searchsorted(north, end[:, 0])], axis=0)
    counts = last - first  # number of rows that each edge crosses
    which = np.repeat(np.arange(len(start)), counts)
    rows = np.arange(len(which)) - np.repeat(np.cumsum(counts) - counts, counts) + first[which]
    share = (north[rows] - start[which, 0]) / (end[which, 0] - start[which, 0])
    crossing = start[which, 1] + share * (end[which, 1] - start[which, 1])
    columns = np.searchsorted(east, crossing)
    width = len(east) + 1
    flips = np.bincount(rows * width + columns, minlength=len(north) * width).reshape(len(north), width)
    return np.asarray(np.cumsum(flips[:, :-1], axis=1) % 2 == 1)


def edge_distance(start: Array, end: Array, north: Array, east: Array, reach: int = 2) -> tuple[Window, Array]:
    """Return the distances of grid nodes from straight segments; the grid spacing is `north[1] - north[0]` m.

    `start`, `end`: end points of the segments, (n, 2). The result is the window of rows and columns around them, and
    the distance of each of its nodes, in spacings, float32: exact below `reach` + 0.5, larger or inf elsewhere.
    """
    spacing, corner = north[1] - north[0], np.array([north[0], east[0]])
    start, along = (start - corner) / spacing, (end - start) / spacing
    counts = np.maximum(1, np.ceil(np.hypot(*along.T))).astype(np.intp)  # number of parts no longer than a spacing
    which = np.repeat(np.arange(len(start)), counts)
    part = (np.arange(len(which)) - np.repeat(np.cumsum(counts) - counts, counts))[:, None]
    along = (along / counts[:, None])[which]
    start = start[which] + part * along
    near = np.floor(start + 0.5 * along).astype(np.intp)
    on = ((near > -reach - 2) & (near < (len(north) + reach, len(east) + reach))).all(axis=1)
    if not on.any():
        return (slice(0, 0), slice(0, 0)), np.zeros((0, 0), np.float32)
    start, along, near = start[on], along[on], near[on]
    first, last = near.min(axis=0) - reach, near.max(axis=0) + reach + 2
    distances = np.full(last - first, np.inf, np.float32)
    lengths = np.maximum((along * along).sum(axis=1), 1e-12)
    for row in range(-reach, reach + 2):
        for column in range(-reach, reach + 2):
            node = near + np.array((row, column))
            apart = node - start
            share = np.clip((apart * along).sum(axis=1) / lengths, 0.0, 1.0)
            away = np.hypot(*(apart - share[:, None] * along).T).astype(np.float32)
            np.minimum.at(distances, tuple((node - first).T), away)
    low, high = np.maximum(first, 0), np.minimum(last, (len(north), len(east)))
    rows, columns = (slice(int(a), int(b)) for a, b in zip(low, high, strict=True))
    return (rows, columns), distances[tuple(slice(a, b) for a, b in zip(low - first, high - first, strict=True))]


def contains(edges: Edges, points: Array) -> Mask:
    """Return which of the `points` (n, 2), north and east, are inside: (n,)."""
    inside = np.zeros(len(points), bool)
    start, end = segments(edges)
    if not len(start):
        return inside
    low, high = np.minimum(start, end).min(axis=0), np.maximum(start, end).max(axis=0)
    near = np.flatnonzero(((points >= low) & (points <= high)).all(axis=1))
    near = near[np.argsort(points[near, 0])]  # so that few edges are in the rows of a chunk
    south, top = np.minimum(start, end)[:, 0], np.maximum(start, end)[:, 0]
    for chunk in np.array_split(near, 1 + len(near) * len(start) // 2_000_000):
        north, east = points[chunk, 0, None], points[chunk, 1, None]
        in_rows = (south <= north.max(initial=-np.inf)) & (top > north.min(initial=np.inf))
        one, other = start[in_rows], end[in_rows]
        spans = (one[:, 0] <= north) != (other[:, 0] <= north)
        rise = np.where(one[:, 0] == other[:, 0], 1.0, other[:, 0] - one[:, 0])
        crossing = one[:, 1] + (north - one[:, 0]) / rise * (other[:, 1] - one[:, 1])
        inside[chunk] = (spans & (crossing <= east)).sum(axis=1) % 2 == 1
    return inside
