"""Bounding boxes of the solids of a scene, with which `splitting` finds small objects."""

from array import array
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim.rays.geometry import Geometry
from sim.rays.solids import BOX, CYLINDER, KIND, MESH, POSITION, REACH, ROOT, ROTATION, ROW, SIZES, SPHERE
from sim.rays.tree import NODE, WIDTH

_MAX_BOXES = 256  # of a mesh


class Boxes(NamedTuple):
    """Boxes: the object of each (n), one of its corners (NED, m; n x 3), and its three edges from there (n x 3 x 3)."""

    object: NDArray[np.int64]
    corner: NDArray[np.float64]
    sides: NDArray[np.float64]


def boxes_within(geometry: Geometry, trees: dict[int, NDArray[np.float64]], centre: Any, reach: float) -> Boxes:
    """Return the boxes of all solids except half spaces, clipped to about `reach` m around `centre` (NED, m).

    `trees` is a cache of the boxes of meshes, by the number of their root node.
    """
    rows = np.frombuffer(geometry.solids).reshape(-1, ROW) if len(geometry.solids) else np.empty((0, ROW))
    north, east = rows[:, POSITION] - centre[0], rows[:, POSITION + 1] - centre[1]
    within = np.flatnonzero(north**2 + east**2 <= (rows[:, REACH] + reach) ** 2)
    rows = rows[within]
    turns = rows[:, ROTATION:SIZES].reshape(-1, 3, 3)
    own = np.einsum("nij,ni->nj", turns, np.asarray(centre) - rows[:, POSITION:ROTATION])
    numbers: list[int] = []
    lows, highs = [np.empty((0, 3))], [np.empty((0, 3))]
    for number, row in enumerate(rows):
        found = _extent(row, geometry.nodes, trees)
        if found is None:
            continue
        low, high = np.maximum(found[:, :3], own[number] - reach), np.minimum(found[:, 3:], own[number] + reach)
        near = (low < high).all(axis=1)
        numbers += [number] * int(near.sum())
        lows.append(low[near])
        highs.append(high[near])
    index, low, high = np.array(numbers, int), np.concatenate(lows), np.concatenate(highs)
    corner = rows[index, POSITION:ROTATION] + np.einsum("nij,nj->ni", turns[index], low)
    sides = (high - low)[:, :, None] * turns[index].transpose(0, 2, 1)
    owners = np.where(rows[:, KIND] == MESH, 0.0, rows[:, ROOT]).astype(np.int64)  # of pieces
    return Boxes(np.where(owners > 0, owners, within + 1)[index], corner, sides)


def _extent(
    row: NDArray[np.float64], nodes: "array[float]", trees: dict[int, NDArray[np.float64]]
) -> NDArray[np.float64] | None:
    """Return rows of least and greatest x, y, z of a solid's parts, in its own axes; None for a half space."""
    kind, sizes = int(row[KIND]), row[SIZES:ROOT]
    if kind == SPHERE:
        return np.repeat([[-sizes[0], sizes[0]]], 3, axis=1)
    if kind == CYLINDER:
        return np.array([[-sizes[0], -sizes[0], sizes[1], sizes[0], sizes[0], sizes[2]]])
    if kind == BOX:
        return sizes[None, [0, 2, 4, 1, 3, 5]]
    if kind != MESH:
        return None
    root = int(row[ROOT])
    if root not in trees:
        trees[root] = _parts(nodes, root)
    return trees[root]


def _parts(nodes: "array[float]", root: int) -> NDArray[np.float64]:
    """Return the boxes of a tree, level by level, down to `_MAX_BOXES` of them or to its leaves."""
    level, finished = [root], list[list[float]]()
    while True:
        rows = np.concatenate([nodes[NODE * node : NODE * (node + 1)] for node in level]).reshape(-1, 7, WIDTH)
        children = rows.transpose(0, 2, 1).reshape(-1, 7)
        children = children[children[:, 6] != 0.0]
        below = children[:, 6] > 0.0
        if not below.any() or len(finished) + (~below).sum() + WIDTH * below.sum() > _MAX_BOXES:
            return np.array([*finished, *children[:, :6].tolist()])
        finished += children[~below, :6].tolist()
        level = children[below, 6].astype(int).tolist()
