"""Ray casting with each of the three engines, compared with known distances to shapes."""

import random
from array import array
from collections.abc import Callable, Iterator
from math import cos, inf, isnan, nan, pi, radians, sin, sqrt
from pathlib import Path
from typing import get_args

import pytest

from hil.common.vectors import Vector3
from sim.dynamics import State
from sim.environment.obstacles import Box, Cylinder
from sim.environment.relief import Fractal, Slope, Step
from sim.environment.terrain import Terrain, covering
from sim.environment.terrain_grid import Grid
from sim.environment.world import World
from sim.rays import solids
from sim.rays.scene import NOTHING, SEABED, Engine, RayScene
from sim.rays.solids import Solid
from sim.rotations import from_euler, matrix, rotate
from sim.vehicle.vehicle import load_vehicle
from tests.support.flights.twins import taken_from
from tests.support.solids import mesh

EXTENT = (-20.0, 20.0, -25.0, 25.0)
DEEP = World("deep", "test", EXTENT, 1000.0)
Make = Callable[[World], RayScene]


@pytest.fixture(params=[engine for engine in get_args(Engine) if engine])
def make(request: pytest.FixtureRequest, binaries: Path) -> Iterator[Make]:
    with taken_from(binaries):
        yield lambda world: RayScene(world, request.param)


def unit(*vector: float) -> Vector3:
    length = sqrt(sum(x * x for x in vector))
    x, y, z = (component / length for component in vector)
    return x, y, z


def relief(terrain: Terrain, depth: float = 30.0) -> World:
    return World("relief", "test", EXTENT, depth, terrain=terrain)


def by_rule(rule: Slope | Step | Fractal, outside: float = 30.0) -> World:
    grid = covering(EXTENT, rule.resolution)
    return relief(Terrain(grid, rule.depths(grid), outside))


def rays(*directions: Vector3) -> "array[float]":
    return array("d", [x for direction in directions for x in direction])


def random_directions(count: int, seed: int = 1) -> list[Vector3]:
    """Return directions all around, and along the axes."""
    chance = random.Random(seed)
    axes = [(1.0, 0.0, 0.0), (-1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, -1.0, 0.0), (0.0, 0.0, 1.0), (0.0, 0.0, -1.0)]
    return [*axes, *(unit(*(chance.gauss(0.0, 1.0) for _ in range(3))) for _ in range(count))]


# --- the seabed


def test_a_flat_seabed_gives_exact_ranges(make: Make) -> None:
    directions = random_directions(200)
    found = make(DEEP._replace(depth=12.5)).ranges((3.0, 4.0, 2.5), rays(*directions), 300.0)
    expected = [10.0 / z if z > 0.0 and 10.0 / z <= 300.0 else inf for _, _, z in directions]
    assert list(found) == pytest.approx(expected, abs=1e-9)


def test_a_plane_gives_exact_ranges(make: Make) -> None:
    """The depth is 10 + n / 4, which 32-bit floats hold exactly; cells have 2 m, and the grid's edge is far away."""
    world = by_rule(Slope(10.0, 0.25, resolution=2.0))
    directions = [d for d in random_directions(400) if 0.25 * d[0] < d[2]]
    hits = make(world).hits((1.3, -2.7, 5.0), rays(*directions), 12.0)
    for i, (x, _, z) in enumerate(directions):
        distance = (10.0 + 0.25 * 1.3 - 5.0) / (z - 0.25 * x)
        if distance > 12.0:
            assert hits.distances[i] == inf
            continue
        assert hits.distances[i] == pytest.approx(distance, abs=1e-9)
        assert hits.objects[i] == SEABED
        assert hits.normals[3 * i : 3 * i + 3].tolist() == pytest.approx(unit(0.25, 0.0, -1.0), abs=1e-12)
    assert sum(x < inf for x in hits.distances) > 100


def test_a_step_gives_exact_ranges(make: Make) -> None:
    """The bed rises from 10 m to 4 m between north = 4 and 5: the ray to the north at 7 m meets it half way."""
    world = by_rule(Step(10.0, 6.0, north=5.0))
    north, up_north, down = (1.0, 0.0, 0.0), unit(1.0, 0.0, -0.5), (0.0, 0.0, 1.0)
    found = make(world).hits((0.0, 0.0, 7.0), rays(north, up_north, down, (-1.0, 0.0, 0.0)), 30.0)
    assert list(found.distances) == pytest.approx([4.5, 27.0 / 5.5 * sqrt(1.25), 3.0, inf], abs=1e-9)
    assert found.normals[:3].tolist() == pytest.approx(unit(-6.0, 0.0, -1.0))
    over = make(world).ranges((0.0, 0.0, 3.0), rays(unit(10.0, 0.0, 1.0)), 30.0)
    assert over[0] == pytest.approx(sqrt(101.0), abs=1e-9)  # on the plateau


def test_ranges_to_rough_ground_match_marching_in_small_steps(make: Make) -> None:
    """The reference marches in steps of 5 mm until the ray is below the seabed, then bisects."""
    world = by_rule(Fractal(15.0, 1.5, 0.7, seed=3))
    origin, directions = (0.3, 0.7, 9.0), [d for d in random_directions(150, 5) if d[2] > -0.1]

    def march(x: float, y: float, z: float) -> float:
        def below(t: float) -> bool:
            return origin[2] + t * z >= world.seabed(origin[0] + t * x, origin[1] + t * y)

        steps = (i * 0.005 for i in range(1, 3001))
        far = next((t for t in steps if below(t)), inf)
        near = far - 0.005
        while near < far < inf and far - near > 1e-10:
            middle = 0.5 * (near + far)
            near, far = (near, middle) if below(middle) else (middle, far)
        return far

    expected = [march(*direction) for direction in directions]
    assert sum(distance < inf for distance in expected) > 30
    assert list(make(world).ranges(origin, rays(*directions), 15.0)) == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize("seed", range(3))
def test_ranges_to_a_single_twisted_cell_are_exact(make: Make, seed: int) -> None:
    """The hit is on the bilinear surface, and the ray before it is above the surface."""
    chance = random.Random(seed)
    corners = array("f", [chance.uniform(5.0, 9.0) for _ in range(4)])
    world = relief(Terrain(Grid(0.0, 0.0, 8.0, 2, 2), corners, 9.0))
    origin, directions = (3.0, 5.0, 4.0), [d for d in random_directions(100, seed) if d[2] > 0.05]
    hits = make(world).hits(origin, rays(*directions), 100.0)
    inside = 0
    for i, (x, y, z) in enumerate(directions):
        north, east, down = hits.points[3 * i : 3 * i + 3]
        if not (0.0 < north < 8.0 and 0.0 < east < 8.0):
            continue
        inside += 1
        assert down == pytest.approx(world.seabed(north, east), abs=1e-9)
        for share in [i / 50 for i in range(50)]:
            t = share * hits.distances[i]
            assert origin[2] + t * z < world.seabed(origin[0] + t * x, origin[1] + t * y)
    assert inside > 15


def test_the_edge_of_the_grid_is_a_step(make: Make) -> None:
    """The bed is 20 m deep in the grid, 8 m around it: from within the edge is a wall, from outside a drop."""
    grid = Grid(-10.0, -10.0, 1.0, 21, 21)
    scene = make(relief(Terrain(grid, array("f", [20.0] * 441), 8.0), 8.0))
    inside = scene.hits((0.0, 0.0, 12.0), rays((1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.0, 0.0, 1.0)), 50.0)
    assert list(inside.distances) == pytest.approx([10.0, 10.0, 8.0])
    assert list(inside.normals) == pytest.approx([-1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, -1.0])
    directions = rays((0.0, 0.0, 1.0), unit(-1.0, 0.0, 0.1), unit(-1.0, 0.0, 1.0))
    outside = scene.ranges((15.0, 0.0, 6.0), directions, 100.0)
    # straight down, across the basin to its far wall, on the flat before it
    assert list(outside) == pytest.approx([2.0, sqrt(25.0**2 + 2.5**2), 2.0 * sqrt(2.0)])


def test_cells_without_data_are_a_wall(make: Make) -> None:
    grid = Grid(-10.0, -10.0, 1.0, 21, 21)
    depths = array("f", [20.0] * 441)
    depths[15 * 21 + 10] = nan  # at north 5, east 0: four cells, 2 m x 2 m
    scene = make(relief(Terrain(grid, depths, 20.0), 20.0))
    found = scene.hits((0.0, 0.25, 10.0), rays((1.0, 0.0, 0.0), (-1.0, 0.0, 0.0), (0.0, 0.0, 1.0)), 50.0)
    assert list(found.distances) == pytest.approx([4.0, inf, 10.0])
    assert found.normals[:3].tolist() == [-1.0, 0.0, 0.0]


# --- solids


def test_a_sphere_gives_exact_ranges(make: Make) -> None:
    scene = make(DEEP)
    number = scene.add(solids.sphere((7.0, -3.0, 20.0), 2.5))
    for direction in random_directions(60):
        origin = [c - 9.0 * d for c, d in zip((7.0, -3.0, 20.0), direction, strict=True)]  # aims at its middle
        hits = scene.hits(origin, rays(direction), 100.0)
        assert hits.distances[0] == pytest.approx(6.5, abs=1e-9), direction
        assert hits.objects[0] == number == 1, direction
        assert hits.normals.tolist() == pytest.approx([-d for d in direction], abs=1e-9), direction


def test_rays_off_the_centre_of_a_sphere_give_exact_ranges(make: Make) -> None:
    scene = make(DEEP)
    scene.add(solids.sphere((10.0, 0.0, 5.0), 2.0))
    found = scene.ranges((0.0, 1.2, 5.0), rays((1.0, 0.0, 0.0), (-1.0, 0.0, 0.0)), 100.0)
    assert list(found) == pytest.approx([10.0 - 1.6, inf], abs=1e-9)
    assert list(scene.ranges((0.0, 2.0001, 5.0), rays((1.0, 0.0, 0.0)), 100.0)) == [inf]


def test_an_upright_cylinder_gives_exact_ranges(make: Make) -> None:
    """The cylinder reaches from 6 m down to the seabed at 12 m; rays come from beside, from above and past its top."""
    world = DEEP._replace(depth=12.0, cylinder=(Cylinder(10.0, 0.0, 2.0, top=6.0),))
    scene = make(world)
    beside = scene.hits((0.0, 1.2, 9.0), rays((1.0, 0.0, 0.0)), 100.0)
    assert beside.distances[0] == pytest.approx(8.4, abs=1e-9)
    assert beside.normals.tolist() == pytest.approx([-0.8, 0.6, 0.0], abs=1e-9)
    above = scene.hits((10.0, 1.0, 1.0), rays((0.0, 0.0, 1.0)), 100.0)
    assert above.distances[0] == pytest.approx(5.0)
    assert above.objects[0] == 1
    assert above.normals.tolist() == [0.0, 0.0, -1.0]
    past = scene.hits((0.0, 0.0, 5.0), rays((1.0, 0.0, 0.0), unit(1.0, 0.0, 0.2)), 100.0)
    assert past.distances[0] == inf
    assert past.distances[1] == pytest.approx(8.0 * sqrt(1.04))
    assert past.objects.tolist() == [NOTHING, 1]
    assert all(isnan(x) for x in (*past.points[:3], *past.normals[:3]))


def cube(half: float) -> Solid:
    """Return a box as twelve triangles."""
    triangles = []
    for axis in range(3):
        for side in (-half, half):
            square = [(-half, -half), (half, -half), (half, half), (-half, half)]
            corners = [(*pair[:axis], side, *pair[axis:]) for pair in square]
            triangles += [(corners[0], corners[1], corners[2]), (corners[0], corners[2], corners[3])]
    return mesh(triangles)


def test_a_rotated_box_and_the_same_mesh_give_equal_ranges(make: Make) -> None:
    """A mesh follows its state; a box with the position and attitude of that state is the same object."""
    state = State((8.0, 1.0, 6.0), from_euler(0.4, -0.7, 1.1))
    meshed, boxed = make(DEEP), make(DEEP)
    meshed.add(cube(1.5), state)
    boxed.add(solids.box(state.position, (3.0, 3.0, 3.0), matrix(state.quaternion)))
    origin = (-1.0, 0.0, 5.0)
    directions = rays(*[unit(9.0 + d[0], 3.0 * d[1], 3.0 * d[2]) for d in random_directions(300)])
    one, other = meshed.hits(origin, directions, 50.0), boxed.hits(origin, directions, 50.0)
    assert sum(x < inf for x in one.distances) > 80
    assert list(one.distances) == pytest.approx(list(other.distances), abs=1e-9)
    hit = [i for i in range(len(one.normals)) if one.distances[i // 3] < inf]
    assert [one.normals[i] for i in hit] == pytest.approx([other.normals[i] for i in hit], abs=1e-9)
    aimed = rotate(state.quaternion, (0.0, 0.0, 1.0))
    straight = boxed.ranges([p - 5.0 * a for p, a in zip(state.position, aimed, strict=True)], rays(aimed), 50.0)
    assert straight[0] == pytest.approx(3.5, abs=1e-9)


def test_another_vehicle_is_hit_at_its_present_position(make: Make) -> None:
    vehicle, _ = load_vehicle("bluerov2_heavy")
    length, width, _ = vehicle.dimensions
    scene, state = make(DEEP), State((10.0, 0.0, 5.0))
    number = scene.add(solids.hull(vehicle), state)
    forward = rays((1.0, 0.0, 0.0))
    assert scene.ranges((0.0, 0.0, 5.0), forward, 50.0)[0] == pytest.approx(10.0 - 0.5 * length)
    state.position, state.quaternion = [20.0, 0.1, 5.0], list(from_euler(0.0, 0.0, pi / 2.0))
    found = scene.hits((0.0, 0.0, 5.0), forward, 50.0)
    assert found.distances[0] == pytest.approx(20.0 - 0.5 * width)
    assert found.objects[0] == number
    state.position = [20.0, 0.0, 15.0]
    assert scene.ranges((0.0, 0.0, 5.0), forward, 50.0)[0] == inf


def test_walls_boxes_and_the_surface_give_exact_ranges(make: Make) -> None:
    world = World("pool", "test", EXTENT, 10.0, walls=True, box=(Box(6.0, 0.0, 2.0, 4.0, radians(90)),))
    scene = make(world)
    surface = scene.add(solids.half_space((0.0, 0.0, 1.0), 0.0))
    directions = rays((1.0, 0.0, 0.0), (-1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, -1.0, 0.0), (0.0, 0.0, -1.0))
    hits = scene.hits((0.0, 0.0, 4.0), directions, 100.0)
    assert list(hits.distances) == pytest.approx([4.0, 20.0, 25.0, 25.0, 4.0])
    assert hits.objects.tolist() == [1, 2, 5, 4, surface]
    assert hits.normals[-3:].tolist() == [0.0, 0.0, 1.0]


def test_directions_are_rotated_from_sensor_axes(make: Make) -> None:
    """The result equals that of directions that were rotated one by one."""
    world = by_rule(Fractal(15.0, 1.0, seed=2))._replace(cylinder=(Cylinder(4.0, 5.0, 1.0),))
    attitude, directions = from_euler(0.3, -0.2, 2.0), random_directions(100)
    turned = [rotate(attitude, direction) for direction in directions]
    one = make(world).ranges((0.0, 0.0, 8.0), rays(*directions), 40.0, matrix(attitude))
    assert list(one) == pytest.approx(list(make(world).ranges((0.0, 0.0, 8.0), rays(*turned), 40.0)), abs=1e-9)


def test_invalid_directions_are_refused(make: Make) -> None:
    scene = make(DEEP)
    for wrong in (array("f", [1.0, 0.0, 0.0]), array("d", [1.0, 0.0]), b"123"):
        with pytest.raises(ValueError, match="three doubles a ray"):
            scene.ranges((0.0, 0.0, 1.0), wrong, 10.0)
    assert len(scene.ranges((0.0, 0.0, 1.0), array("d"), 10.0)) == 0


def test_a_horizontal_scan_of_a_pool_matches_its_walls(make: Make) -> None:
    """A sonar of 360 beams is in a square of 40 m x 50 m: each range follows from the walls alone."""
    scene = make(World("pool", "test", EXTENT, 10.0, walls=True))
    angles = [radians(i + 0.5) for i in range(360)]
    found = scene.ranges((2.0, 3.0, 5.0), rays(*[(cos(a), sin(a), 0.0) for a in angles]), 100.0)
    for angle, distance in zip(angles, found, strict=True):
        to_north = (18.0 if cos(angle) > 0.0 else 22.0) / abs(cos(angle))
        to_east = (22.0 if sin(angle) > 0.0 else 28.0) / abs(sin(angle))
        assert distance == pytest.approx(min(to_north, to_east), abs=1e-9)
