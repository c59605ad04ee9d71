"""A tree of bounding boxes over a mesh, so that a ray tests only few triangles.

A node has eight children, and 56 floats of 32 bits, eight of each kind: the least x, y, z of the children's boxes,
their greatest x, y, z, and the children. A child is the number of a node, or -1 - the number of a group, or 0 for none.
A group begins with memory that only C uses, for its triangles in floats, with which it excludes most. Then follow eight
triangles of nine numbers: x, y, z of a corner, and of the two edges from there; the last group of a mesh is filled with
zeros. Meshes are flat arrays, with nine numbers a triangle.

The triangles of a node are divided, and always the part with the largest box again, until there are eight parts. A
division is where the areas of the boxes of both sides, times their groups, are least, of the boundaries of equal
bins along each axis (MacDonald & Booth 1990, Visual Computer 6(3)); but so that all groups except the last are full.
Below a few levels it is in the middle of the longest axis, so that no mesh has a deep tree.
"""

from array import array
from collections.abc import Iterator, Sequence
from math import inf
from typing import NamedTuple

from hil.common.vectors import Vector3
from sim.native import has_native

WIDTH = 8  # children of a node, and triangles of a group
_FLOATS = 37  # doubles that hold a group in floats
NODE, GROUP = 7 * WIDTH, _FLOATS + 9 * WIDTH
_PAD = 1e-6  # of the greatest coordinate, by which boxes are larger, so that no rounding excludes a triangle
_FAR = 1e30  # position of a box that no ray hits
_BINS = 16
_TINY = 1e-300
_MAX_DEPTH = 10  # of nodes whose division is not in the middle
_KEPT = 1000  # forests

Bounds = tuple[list[float], list[float]]  # the least and the greatest x, y, z


class Forest(NamedTuple):
    """Nodes and triangles of the trees of several meshes, and the root of each."""

    nodes: "array[float]"
    triangles: "array[float]"
    roots: tuple[int, ...]


_latest: "dict[tuple[int, ...], tuple[tuple[array[float], ...], Forest]]" = {}


def forest(meshes: "Sequence[array[float]]") -> Forest:
    """Return the trees of these meshes.

    Sensors with the same meshes share them: a tree is built once in a process, and its memory is not copied.
    """
    key = tuple(map(id, meshes))
    if key not in _latest:
        distinct = {id(mesh): mesh for mesh in meshes}
        sizes = [_groups(len(mesh) // 9) for mesh in distinct.values()]
        nodes, triangles = (array(kind, (0.0,)) * (count * sum(sizes)) for kind, count in (("f", NODE), ("d", GROUP)))
        roots, root, group = dict[int, int](), 0, 0
        for mesh, size in zip(distinct.values(), sizes, strict=True):
            roots[id(mesh)] = root
            root, group = grow(mesh, nodes, triangles, root, group), group + size
        del nodes[NODE * root :]
        while len(_latest) >= _KEPT:
            del _latest[next(iter(_latest))]
        _latest[key] = tuple(meshes), Forest(nodes, triangles, tuple(roots[each] for each in key))
    return _latest[key][1]


def boxes(nodes: "array[float]", number: int) -> Iterator[tuple[int, Vector3, Vector3]]:
    """Yield of each child of a node its number, and the centre and half the sides of its box."""
    node = nodes[number * NODE : (number + 1) * NODE]
    for lane in range(WIDTH):
        x, y, z, to_x, to_y, to_z, child = node[lane::WIDTH]
        if child:
            middle = 0.5 * (x + to_x), 0.5 * (y + to_y), 0.5 * (z + to_z)
            yield int(child), middle, (to_x - middle[0], to_y - middle[1], to_z - middle[2])


def group(triangles: "array[float]", child: int) -> "array[float]":
    """Return the triangles of a child that is a group, nine numbers each."""
    found = array("d")
    for number in range(WIDTH * (-1 - child), WIDTH * -child):
        x, y, z, *edges = triangle(triangles, number)
        if any(edges):
            found.extend((x, y, z, x + edges[0], y + edges[1], z + edges[2], x + edges[3], y + edges[4], z + edges[5]))
    return found


def triangle(triangles: "array[float]", number: int) -> "array[float]":
    """Return nine numbers: a corner of a triangle and the two edges from there."""
    first = number // WIDTH * GROUP + _FLOATS + number % WIDTH * 9
    return triangles[first : first + 9]


def grow(
    mesh: "array[float]", nodes: "array[float]", triangles: "array[float]", root: int, group: int, engine: str = ""
) -> int:
    """Write the tree of a mesh from node `root` and group `group` on, which are 0 before; return the next node."""
    if engine != "python" and has_native("sim.native._rays"):
        from sim.native._rays import grow as grow_native

        return grow_native(mesh, nodes, triangles, root, group)
    grower = _Grower(mesh, nodes, triangles, group)
    return grower.node(list(range(len(mesh) // 9)), root, 0)


class _Grower:
    """Builds one tree: the specification of that in sim/native/rays_tree.h."""

    def __init__(self, mesh: "array[float]", nodes: "array[float]", triangles: "array[float]", group: int) -> None:
        self._mesh, self._nodes, self._triangles, self._group = mesh, nodes, triangles, group
        rounded = array("f", mesh)
        self._corners = [[rounded[9 * n + 3 * i : 9 * n + 3 * i + 3] for i in range(3)] for n in range(len(mesh) // 9)]
        self._pad = _PAD * max(map(abs, rounded))

    def node(self, numbers: list[int], number: int, depth: int) -> int:
        """Write the node `number` of these triangles, and all below; return the number of the next node."""
        parts, end = [numbers], number + 1
        while len(parts) < WIDTH and any(len(part) > WIDTH for part in parts):
            areas = [_area(self._bounds(part)) if len(part) > WIDTH else -1.0 for part in parts]
            largest = areas.index(max(areas))
            parts[largest : largest + 1] = self._divided(parts[largest], depth)
        for lane in range(WIDTH):
            place = NODE * number + lane
            part = parts[lane] if lane < len(parts) else []
            low, high = self._bounds(part)
            for axis in range(3):
                self._nodes[place + WIDTH * axis] = low[axis] - self._pad if part else _FAR
                self._nodes[place + WIDTH * (3 + axis)] = high[axis] + self._pad if part else _FAR
            if len(part) > WIDTH:
                self._nodes[place + WIDTH * 6] = end
                end = self.node(part, end, depth + 1)
            elif part:
                self._nodes[place + WIDTH * 6] = -1 - self._group
                self._write_group(sorted(part))
        return end

    def _divided(self, numbers: list[int], depth: int) -> tuple[list[int], list[int]]:
        boxes = [self._bounds([number]) for number in numbers]
        centres = [[low[axis] + high[axis] for low, high in boxes] for axis in range(3)]
        sizes = [max(along) - min(along) for along in centres]
        groups, axis = _groups(len(numbers)), sizes.index(max(sizes))
        first = groups - groups // 2
        if depth < _MAX_DEPTH and sizes[axis] > 0.0:
            axis, first = self._find_split(numbers, centres, sizes)
            first = (first + WIDTH // 2) // WIDTH
        first = WIDTH * min(max(first, 1), groups - 1)
        ordered = [number for _, number in sorted(zip(centres[axis], numbers, strict=True))]
        return ordered[:first], ordered[first:]

    def _find_split(self, numbers: list[int], centres: list[list[float]], sizes: list[float]) -> tuple[int, int]:
        """Return the axis and the number of triangles before the best boundary of bins."""
        best, least = (0, 0), inf
        for axis, along in enumerate(centres):
            bins: list[list[int]] = [[] for _ in range(_BINS)]
            low, scale = min(along), _BINS / max(sizes[axis], _TINY)
            for number, place in zip(numbers, along, strict=True):
                bins[int(min((place - low) * scale, _BINS - 1.0))].append(number)
            for end in range(1, _BINS):
                one, other = ([number for part in side for number in part] for side in (bins[:end], bins[end:]))
                if one and other:
                    costs = [_area(self._bounds(side)) * _groups(len(side)) for side in (one, other)]
                    cost = costs[0] + costs[1]
                    if cost < least:
                        best, least = (axis, len(one)), cost
        return best

    def _bounds(self, numbers: list[int]) -> Bounds:
        columns = list(zip(*(corner for number in numbers for corner in self._corners[number]), strict=True))
        return [min(column) for column in columns], [max(column) for column in columns]

    def _write_group(self, numbers: list[int]) -> None:
        for lane, number in enumerate(numbers):
            place, corners = GROUP * self._group + _FLOATS + 9 * lane, self._mesh[9 * number : 9 * number + 9]
            for i, x in enumerate(corners):
                self._triangles[place + i] = x - corners[i % 3] if i > 2 else x
        self._group += 1


def _groups(count: int) -> int:
    """Return how many groups hold this many triangles."""
    return -(-count // WIDTH)


def _area(bounds: Bounds) -> float:
    x, y, z = (high - low for low, high in zip(*bounds, strict=True))
    return x * y + y * z + z * x
