"""A tree of bounding boxes over a mesh, so that a ray tests only few triangles.

A node has eight numbers: the least and the greatest x, y, z of its box, an index and a count. If the count is not 0 it
is a leaf, and the index is that of its first triangle; else its children are the next node and the node at the index. A
triangle has nine numbers: a corner and the two edges from there.
"""

from array import array
from collections.abc import Sequence
from functools import lru_cache
from operator import itemgetter

from sim.rays.solids import Triangle

NODE, TRIANGLE = 8, 9
_LEAF = 4  # triangles at most


def append_tree(triangles: tuple[Triangle, ...], nodes: "array[float]", corners: "array[float]") -> int:
    """Append the tree of these triangles to `nodes` and `corners`; return the number of its root.

    A tree is built once in a process, because each sensor has its own scene and most meshes are in all of them.
    """
    own_nodes, own_corners = _tree(triangles)
    root, first = len(nodes) // NODE, len(corners) // TRIANGLE
    moved = own_nodes[:]
    for place in range(0, len(moved), NODE):
        moved[place + 6] += first if moved[place + 7] else root
    nodes.extend(moved)
    corners.extend(own_corners)
    return root


@lru_cache(maxsize=32)
def _tree(triangles: tuple[Triangle, ...]) -> "tuple[array[float], array[float]]":
    nodes, corners = array("d"), array("d")
    grow(triangles, nodes, corners)
    return nodes, corners


def grow(triangles: Sequence[Triangle], nodes: "array[float]", corners: "array[float]") -> int:
    """Append the tree of these triangles to `nodes` and `corners`; return the number of its root node."""
    root = len(nodes) // NODE
    low = [min(corner[axis] for triangle in triangles for corner in triangle) for axis in range(3)]
    high = [max(corner[axis] for triangle in triangles for corner in triangle) for axis in range(3)]
    if len(triangles) <= _LEAF:
        nodes.extend((*low, *high, len(corners) // TRIANGLE, len(triangles)))
        for a, b, c in triangles:
            corners.extend(
                (*a, *(y - x for x, y in zip(a, b, strict=True)), *(y - x for x, y in zip(a, c, strict=True)))
            )
        return root
    nodes.extend((*low, *high, 0.0, 0.0))
    sizes = [b - a for a, b in zip(low, high, strict=True)]
    axis = itemgetter(sizes.index(max(sizes)))
    ordered = sorted(triangles, key=lambda triangle: sum(map(axis, triangle)))
    middle = len(ordered) // 2
    grow(ordered[:middle], nodes, corners)
    nodes[root * NODE + 6] = grow(ordered[middle:], nodes, corners)
    return root
