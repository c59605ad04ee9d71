"""The horizontal distance to a mesh, by the tree of its triangles."""

from heapq import heappop, heappush
from math import inf, sqrt

from hil.common.vectors import off_line
from sim.environment.mesh import MeshObstacle, Triangle, place
from sim.rays.tree import boxes, forest, group


def distance_to_mesh(mesh: MeshObstacle, north: float, east: float, highest: float, lowest: float) -> float:
    """Return the horizontal distance (m) to the nearest triangle between two depths; 0 above or below one."""
    nodes, triangles, (root,) = forest((mesh.triangles,))
    a, b, c, d, e, f, g, h, i = mesh.rotation
    best, waiting = inf, [(0.0, root)]
    while waiting and waiting[0][0] < best:
        child = heappop(waiting)[1]
        if child < 0:
            placed = place(mesh.keys, mesh.rotation, group(triangles, child))
            corners = zip(placed[0::3], placed[1::3], placed[2::3], strict=True)
            for triangle in zip(corners, corners, corners, strict=True):
                depths = [down for _, _, down in triangle]
                if min(depths) < lowest and max(depths) > highest:
                    best = min(best, _to_triangle(north, east, triangle))
            continue
        for inner, (x, y, z), (wide, long, high) in boxes(nodes, child):
            away_north = abs(mesh.north + a * x + b * y + c * z - north) - abs(a * wide) - abs(b * long) - abs(c * high)
            away_east = abs(mesh.east + d * x + e * y + f * z - east) - abs(d * wide) - abs(e * long) - abs(f * high)
            depth, half = mesh.keys.depth + g * x + h * y + i * z, abs(g * wide) + abs(h * long) + abs(i * high)
            if depth - half < lowest and depth + half > highest:
                heappush(waiting, (sqrt(max(0.0, away_north) ** 2 + max(0.0, away_east) ** 2), inner))
    return best


def _to_triangle(north: float, east: float, triangle: Triangle) -> float:
    """Return the horizontal distance (m) of a position from a triangle; 0 above or below it."""
    least, turns = inf, []
    for (x, y, _), (to_x, to_y, _) in zip(triangle, (*triangle[1:], triangle[0]), strict=True):
        off_x, off_y = off_line(north, east, x, y, to_x, to_y)
        least = min(least, off_x * off_x + off_y * off_y)
        turns.append((to_x - x) * (east - y) - (to_y - y) * (north - x))
    is_inside = min(turns) > 0.0 or max(turns) < 0.0
    return 0.0 if is_inside else sqrt(least)
