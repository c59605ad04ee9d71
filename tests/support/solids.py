"""Meshes of rays out of triangles that a test makes."""

from array import array
from collections.abc import Iterable
from math import hypot

from sim.rays.solids import MESH, Point, Solid


def mesh(triangles: Iterable[Iterable[Point]]) -> Solid:
    """Return a mesh of triangles, each with three corners (m) in its own axes."""
    corners = [corner for triangle in triangles for corner in triangle]
    upright = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)
    flat = array("d", [x for corner in corners for x in corner])
    return Solid(MESH, max(hypot(*corner) for corner in corners), (0.0, 0.0, 0.0), upright, (), flat)
