"""Rays that may pass by a small thing are split, so that no target is lost between them.

A ray stands for a cell of a fan. What is smaller than some cells is within a window of them; each cell of that window
gives way to `across` x `down` smaller ones with rays of their own, so that their sum still is the whole: nothing is
counted twice, and shadows are right. A window is that of the corners of a box around a thing; long things are cut into
pieces, meshes are taken by the boxes of their tree.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim.rays.scene import RayScene

Floats = NDArray[np.floating[Any]]

_WANTED = 3.0  # rays across a thing, each way
_MOST = (8, 16)  # parts of a cell, across and down
_PIECES = 32  # of a long thing
_LARGEST = 8.0  # cells; larger windows are not split
_CORNERS = np.array([(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)], float)


class Lattice(NamedTuple):
    """Cells of a fan about z: edges (rad) of its columns, from x to y, and of its rows, from x to z; both growing."""

    across: Floats
    down: Floats

    def unit(self, across: Any, down: Any) -> Floats:
        """Return unit vectors in the sensor's axes."""
        return np.stack([np.cos(down) * np.cos(across), np.cos(down) * np.sin(across), np.sin(down)], axis=-1)


class Cells(NamedTuple):
    """Smaller cells: the column they are of, their middles and halves (rad), and the number of the cell they part."""

    column: NDArray[np.int64]
    across: Floats
    down: Floats
    half_across: Floats
    half_down: Floats
    parent: NDArray[np.int64]


def split(
    lattice: Lattice, scene: RayScene, place: Any, rotation: Floats, reach: float, hit: NDArray[np.int32]
) -> Cells | None:
    """Return the smaller cells of a ping from `place` (NED, m), None for none.

    `rotation` (3 x 3) turns the sensor's axes into NED; `hit` are the objects that the cells' own rays have met.
    """
    boxes = scene.boxes(place, reach)
    if not len(boxes.object):
        return None
    which, count, corner, sides = _pieces(boxes.corner, boxes.sides)
    seen, low, high = _windows(corner, sides, np.asarray(place), rotation, reach)
    objects, count = boxes.object[which[seen]], count[which[seen]]
    columns, rows = len(lattice.across) - 1, len(lattice.down) - 1
    sizes = np.array([lattice.across[1] - lattice.across[0], lattice.down[1] - lattice.down[0]])
    start = np.array([lattice.across[0], lattice.down[0]])
    first, last = np.floor((low - start) / sizes).astype(int), np.floor((high - start) / sizes).astype(int)
    spans = np.maximum((high - low) / sizes, 1e-3)
    spans *= np.where(spans == spans.max(axis=1, keepdims=True), count[:, None], 1)  # a piece of a long thing is long
    parts = np.clip(np.ceil(_WANTED / spans), 1, _MOST).astype(int)
    wanted = (parts > 1).any(axis=1) & (last >= 0).all(axis=1) & (first < (columns, rows)).all(axis=1)
    wanted &= spans.min(axis=1) < _LARGEST
    numbers = np.ones((2, columns, rows), int)
    owners = np.full((columns, rows), -2)  # no object
    for i in np.nonzero(wanted)[0]:
        (left, top), (right, bottom) = np.maximum(first[i], 0), last[i] + 1
        part = numbers[:, left:right, top:bottom]
        np.maximum(part, parts[i][:, None, None], out=part)
        owner = owners[left:right, top:bottom]
        owner[...] = np.where((owner == -2) | (owner == objects[i]), objects[i], -3)  # of several
    divided = (numbers > 1).any(axis=0) & ~_filled(hit.reshape(columns, rows), owners)
    return _cells(lattice, numbers, divided)


def _filled(hit: NDArray[np.int32], owners: NDArray[np.int64]) -> NDArray[np.bool_]:
    """True where the thing itself is all around: it is larger than a cell there."""
    same = hit == owners
    padded = np.pad(same, 1, mode="edge")
    filled: NDArray[np.bool_] = same & padded[:-2, 1:-1] & padded[2:, 1:-1] & padded[1:-1, :-2] & padded[1:-1, 2:]
    return filled


def _cells(lattice: Lattice, numbers: NDArray[np.int64], divided: NDArray[np.bool_]) -> Cells | None:
    parent = np.flatnonzero(divided)
    if not len(parent):
        return None
    across, down = numbers.reshape(2, -1)[:, parent]
    while (across * down).sum() > divided.size:  # a ping stays as quick as it should be
        across, down = (across + 1) // 2, (down + 1) // 2
        if (across * down == 1).all():
            return None
    count = across * down
    column, row = np.divmod(np.repeat(parent, count), divided.shape[1])
    within = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
    across, down = np.repeat(across, count), np.repeat(down, count)
    half_across = 0.5 * (lattice.across[column + 1] - lattice.across[column]) / across
    half_down = 0.5 * (lattice.down[row + 1] - lattice.down[row]) / down
    return Cells(
        column,
        lattice.across[column] + (2 * (within % across) + 1) * half_across,
        lattice.down[row] + (2 * (within // across) + 1) * half_down,
        half_across,
        half_down,
        parent,
    )


def _pieces(corner: Floats, sides: Floats) -> tuple[NDArray[np.int64], NDArray[np.int64], Floats, Floats]:
    """Cut boxes, a corner and three sides each, across their longest side into pieces that are about as long as thick.

    The corners of a long box show little of where it is seen. Returns which box each piece is of, how many pieces
    each box has, and the pieces.
    """
    lengths = np.sqrt((sides**2).sum(axis=2))
    order = np.sort(lengths, axis=1)
    count = np.clip(np.ceil(order[:, 2] / np.maximum(2.0 * order[:, 1], 0.1)), 1, _PIECES).astype(int)
    which = np.repeat(np.arange(len(count)), count)
    number = np.arange(len(which)) - np.repeat(np.cumsum(count) - count, count)
    longest = lengths.argmax(axis=1)
    step = sides[np.arange(len(count)), longest] / count[:, None]
    cut = sides.copy()
    cut[np.arange(len(count)), longest] = step
    return which, count, corner[which] + number[:, None] * step[which], cut[which]


def _windows(
    corner: Floats, sides: Floats, place: Floats, rotation: Floats, reach: float
) -> tuple[NDArray[np.int64], Floats, Floats]:
    """Return which boxes may be seen, and the least and greatest angles (across, down) of their corners."""
    own = (corner[:, None] + _CORNERS @ sides - place) @ rotation
    ranges = np.maximum(np.sqrt((own**2).sum(axis=2)), 1e-9)
    across, down = np.arctan2(own[..., 1], own[..., 0]), np.arcsin(own[..., 2] / ranges)
    # What is behind as well is all around: too large to be lost.
    ahead = (own[..., 0].max(axis=1) > 0.0) & (ranges.min(axis=1) < reach) & (np.ptp(across, axis=1) < np.pi)
    seen, angles = np.flatnonzero(ahead), np.stack([across[ahead], down[ahead]], axis=1)
    return seen, angles.min(axis=2), angles.max(axis=2)
