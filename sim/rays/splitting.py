"""Split rays near small objects, so that no target is lost between the rays of a fan.

A ray represents a cell of a fan. A small object is within a window of a few cells; each cell of that window is replaced
by `across` x `down` smaller cells with their own rays. Together they cover the same solid angle, so nothing is counted
twice, and shadows are right. A window is that of the corners of an object's bounding box; long objects are cut into
pieces, and meshes are represented by the boxes of their tree.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim.rays.scene import RayScene

Floats = NDArray[np.floating[Any]]

_TARGET_RAYS = 3.0  # across an object, in each direction
_MAX_PARTS = (8, 16)  # of a cell, across and down
_MAX_PIECES = 32  # of a long object
_MAX_WINDOW = 8.0  # cells; larger windows are not split
_CORNERS = np.array([(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)], float)


class Lattice(NamedTuple):
    """Cells of a fan about z: edges (rad) of its columns, from x to y, and of its rows, from x to z; both growing."""

    across: Floats
    down: Floats

    def unit(self, across: Any, down: Any) -> Floats:
        """Return unit vectors in the sensor's axes."""
        return np.stack([np.cos(down) * np.cos(across), np.cos(down) * np.sin(across), np.sin(down)], axis=-1)


class Cells(NamedTuple):
    """Smaller cells: their column, their centres and half sizes (rad), and the number of the cell that each divides."""

    column: NDArray[np.int64]
    across: Floats
    down: Floats
    half_across: Floats
    half_down: Floats
    parent: NDArray[np.int64]


def split(
    lattice: Lattice, scene: RayScene, origin: Any, rotation: Floats, reach: float, hit: NDArray[np.int32]
) -> Cells | None:
    """Return the smaller cells of a ping from `origin` (NED, m), or None if there are none.

    `rotation` (3 x 3) converts the sensor's axes to NED; `hit` are the objects that the rays of the cells have hit.
    """
    boxes = scene.boxes(origin, reach)
    if not len(boxes.object):
        return None
    which, count, corner, sides = _pieces(boxes.corner, boxes.sides)
    seen, low, high = _windows(corner, sides, np.asarray(origin), rotation, reach)
    objects, count = boxes.object[which[seen]], count[which[seen]]
    columns, rows = len(lattice.across) - 1, len(lattice.down) - 1
    sizes = np.array([lattice.across[1] - lattice.across[0], lattice.down[1] - lattice.down[0]])
    start = np.array([lattice.across[0], lattice.down[0]])
    first, last = np.floor((low - start) / sizes).astype(int), np.floor((high - start) / sizes).astype(int)
    spans = np.maximum((high - low) / sizes, 1e-3)
    spans *= np.where(spans == spans.max(axis=1, keepdims=True), count[:, None], 1)  # a piece of a long thing is long
    divisions = np.clip(np.ceil(_TARGET_RAYS / spans), 1, _MAX_PARTS).astype(int)
    needed = (divisions > 1).any(axis=1) & (last >= 0).all(axis=1) & (first < (columns, rows)).all(axis=1)
    needed &= spans.min(axis=1) < _MAX_WINDOW
    numbers = np.ones((2, columns, rows), int)
    owners = np.full((columns, rows), -2)  # no object
    for i in np.nonzero(needed)[0]:
        (left, top), (right, bottom) = np.maximum(first[i], 0), last[i] + 1
        part = numbers[:, left:right, top:bottom]
        np.maximum(part, divisions[i][:, None, None], out=part)
        owner = owners[left:right, top:bottom]
        owner[...] = np.where((owner == -2) | (owner == objects[i]), objects[i], -3)  # of several
    divided = (numbers > 1).any(axis=0) & ~_filled(hit.reshape(columns, rows), owners)
    return _cells(lattice, numbers, divided)


def _filled(hit: NDArray[np.int32], owners: NDArray[np.int64]) -> NDArray[np.bool_]:
    """True where all neighbouring rays hit the same object: there it is larger than a cell."""
    same = hit == owners
    padded = np.pad(same, 1, mode="edge")
    filled: NDArray[np.bool_] = same & padded[:-2, 1:-1] & padded[2:, 1:-1] & padded[1:-1, :-2] & padded[1:-1, 2:]
    return filled


def _cells(lattice: Lattice, numbers: NDArray[np.int64], divided: NDArray[np.bool_]) -> Cells | None:
    parent = np.flatnonzero(divided)
    if not len(parent):
        return None
    across, down = numbers.reshape(2, -1)[:, parent]
    while (across * down).sum() > divided.size:  # limits the cost of a ping
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
    """Cut boxes, given by a corner and three sides, across their longest side into pieces about as long as thick.

    The corners of a long box do not represent where it is visible. Returns the box of each piece, the number of pieces
    of each box, and the corners and sides of the pieces.
    """
    lengths = np.sqrt((sides**2).sum(axis=2))
    order = np.sort(lengths, axis=1)
    count = np.clip(np.ceil(order[:, 2] / np.maximum(2.0 * order[:, 1], 0.1)), 1, _MAX_PIECES).astype(int)
    which = np.repeat(np.arange(len(count)), count)
    number = np.arange(len(which)) - np.repeat(np.cumsum(count) - count, count)
    longest = lengths.argmax(axis=1)
    step = sides[np.arange(len(count)), longest] / count[:, None]
    cut = sides.copy()
    cut[np.arange(len(count)), longest] = step
    return which, count, corner[which] + number[:, None] * step[which], cut[which]


def _windows(
    corner: Floats, sides: Floats, origin: Floats, rotation: Floats, reach: float
) -> tuple[NDArray[np.int64], Floats, Floats]:
    """Return the boxes that may be visible, and the least and greatest angles (across, down) of their corners."""
    own = (corner[:, None] + _CORNERS @ sides - origin) @ rotation
    ranges = np.maximum(np.sqrt((own**2).sum(axis=2)), 1e-9)
    across, down = np.arctan2(own[..., 1], own[..., 0]), np.arcsin(own[..., 2] / ranges)
    # A box that spans half a turn or more surrounds the sensor: it is too large to be lost.
    ahead = (own[..., 0].max(axis=1) > 0.0) & (ranges.min(axis=1) < reach) & (np.ptp(across, axis=1) < np.pi)
    seen, angles = np.flatnonzero(ahead), np.stack([across[ahead], down[ahead]], axis=1)
    return seen, angles.min(axis=2), angles.max(axis=2)
