"""Rays in C have exactly the results of those in plain Python."""

import random
import sys
from array import array
from itertools import product
from math import nan, sqrt
from struct import pack

import numpy as np
import pytest

from hil.common.errors import ConfigError
from sim.dynamics import State
from sim.environment.obstacles import Box, Cylinder
from sim.environment.relief import Fractal
from sim.environment.terrain import Terrain, covering
from sim.environment.things.pipelines import Pipeline
from sim.environment.things.primitives import quad
from sim.environment.world import World
from sim.rays import single, solids
from sim.rays.geometry import Hits
from sim.rays.scene import Engine, RayScene
from sim.rays.tree import GROUP, NODE, grow, triangle
from sim.rotations import matrix, normalise
from tests.support.solids import mesh as mesh_of

pytestmark = pytest.mark.usefixtures("native")

ENGINES: tuple[Engine, ...] = ("C", "python")
EXTENT = (-20.0, 20.0, -25.0, 30.0)
UPRIGHT = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)


def attitude(rng: random.Random) -> tuple[float, ...]:
    return normalise([rng.gauss(0.0, 1.0) for _ in range(4)])


def random_world(seed: int) -> World:
    """Return a world that is rough or flat, coarse or fine, deeper or shallower than what is around it, with holes."""
    rng = random.Random(seed)
    depth = rng.choice([12.0, 5.0, 30.0])
    world = World(
        "random", "test", EXTENT, depth, walls=seed % 4 == 0,
        pipeline=(Pipeline(((-15.0, -20.0), (2.0, -2.0), (15.0, 20.0)), 1.5, -0.3), Pipeline(((9.0, 0.0), (9.0, 5.0)))),
        cylinder=(Cylinder(3.0, 4.0, 2.0), Cylinder(-9.0, 4.0, 1.0, 8.0)), box=(Box(0.0, -10.0, 3.0, 8.0, 0.4, 6.0),),
    )  # fmt: skip
    if seed % 5 == 0:
        return world
    grid = covering(EXTENT, rng.choice([0.5, 1.0, 2.0, 3.3]))
    depths = Fractal(12.0, rng.choice([0.0, 0.5, 2.0, 6.0]), rng.random(), seed).depths(grid)
    for _ in range(5 if seed % 3 == 0 else 0):
        depths[rng.randrange(len(depths))] = nan
    return world._replace(terrain=Terrain(grid, depths, depth))


def random_scene(seed: int, engine: Engine) -> RayScene:
    rng, scene = random.Random(f"{seed}/solids"), RayScene(random_world(seed), engine)
    for _ in range(2):
        origin = [rng.uniform(-15.0, 15.0), rng.uniform(-15.0, 15.0), rng.uniform(0.0, 12.0)]
        rotation = matrix(attitude(rng))
        scene.add(solids.sphere(origin, rng.uniform(0.3, 3.0)))
        scene.add(solids.box((origin[1], origin[0], origin[2]), (4.0, 3.0, 7.0), rotation))
        scene.add(solids.cylinder((-origin[0], origin[1], origin[2]), 2.0, 2.5, rotation))
    crumpled = [[[rng.gauss(0.0, 1.0) for _ in range(3)] for _ in range(3)] for _ in range(60)]
    scene.add(mesh_of(crumpled), State((5.0, 5.0, 5.0), attitude(rng)))
    net = mesh_of(quad(*[(7.0 * x, 4.2 * y, 5.6 * y) for x, y in ((0, 0), (1, 0), (1, 1), (0, 1))]))
    scene.add(net._replace(sizes=(0.7, 0.2)), State((-5.0, -9.0, 5.0), attitude(rng)))
    scene.add(solids.half_space((0.0, 0.0, 1.0), -2.0))
    return scene


def random_rays(rng: random.Random) -> "array[float]":
    """Return rays along the axes, nearly level, and all around."""
    rays = array("d")
    for ray in range(60):
        if ray < 6:
            direction = [0.0, 0.0, 0.0]
            direction[ray // 2] = 1.0 if ray % 2 else -1.0
        else:
            direction = [rng.gauss(0.0, 1.0), rng.gauss(0.0, 1.0), rng.gauss(0.0, 0.05 if ray < 20 else 1.0)]
        length = sqrt(sum(x * x for x in direction))
        rays.extend(x / length for x in direction)
    return rays


def assert_equal_hits(one: Hits, other: Hits) -> None:
    for values, others in zip(one, other, strict=True):
        np.testing.assert_array_equal(np.array(values), np.array(others))


@pytest.mark.parametrize("seed", range(4))
def test_hits_in_c_and_python_are_equal(seed: int) -> None:
    """Distances, points, normals and objects are equal from points in water, in obstacles, on nodes, off the grid."""
    rng = random.Random(f"{seed}/rays")
    scenes, kinds = [random_scene(seed, engine) for engine in ENGINES], set[int]()
    for shot in range(16):
        span = 30.0 if shot % 2 else 12.0
        origin = [rng.uniform(-span, span), rng.uniform(-span, span), rng.uniform(-2.0, 14.0)]
        if shot % 4 == 2:
            origin = [float(round(x)) for x in origin]
        rotation = matrix(attitude(rng)) if shot % 4 else UPRIGHT
        rays, reach = random_rays(rng), rng.choice([5.0, 50.0, 1000.0])
        native, python = (scene.hits(origin, rays, reach, rotation) for scene in scenes)
        assert_equal_hits(native, python)
        assert native.distances == scenes[0].ranges(origin, rays, reach, rotation)
        kinds.update(python.objects)
    assert len(kinds) > 1


def test_hits_at_exact_limits_are_equal() -> None:
    """Rays along the axes begin, pass and end at corners, edges, faces, axes, and the centre of a ball."""
    axes = array("d", (1, 0, 0, -1, 0, 0, 0, 1, 0, 0, -1, 0, 0, 0, 1, 0, 0, -1))
    grid = covering((-1.0, 5.0, -1.0, 5.0), 1.0)
    steps = Terrain(grid, array("f", [4.0 + 2 * (i // 3 % 2) for i in range(grid.rows * grid.columns)]), 5.0)
    for terrain in (None, steps):
        native, python = (RayScene(World("w", "test", EXTENT, 4.0, terrain=terrain), engine) for engine in ENGINES)
        for scene in (native, python):
            scene.add(solids.sphere((0.0, 0.0, 0.0), 1.0))
            scene.add(solids.box((4.0, 0.0, 0.0), (2.0, 2.0, 2.0)))
            scene.add(solids.cylinder((0.0, 4.0, 0.0), 1.0, 1.0))
            scene.add(mesh_of([[(3.0, 3.0, 1.0), (5.0, 3.0, 1.0), (3.0, 5.0, 1.0)]]))
            scene.add(solids.half_space((0.0, 0.0, 1.0), -3.0))
        for origin in product(range(-2, 7), range(-2, 7), (-3, -1, 0, 1, 4)):
            assert_equal_hits(*(scene.hits(origin, axes, 3.0) for scene in (native, python)))


def test_rays_hit_the_ends_of_lying_solids_and_both_ends_of_hanging_ones() -> None:
    """The circle around a solid, seen from above, has to hold all of it. They lie along the direction (0.8, 0.6)."""
    block, pile = Box(0.0, 0.0, 9.0, 8.0, top=2.0, bottom=3.0), Cylinder(-9.0, 0.0, 3.0, 2.0, bottom=3.0)
    scene = RayScene(World("w", "test", EXTENT, 30.0, box=(block,), cylinder=(pile,)))
    lying = (0.0, 0.6, 0.8, 0.0, -0.8, 0.6, 1.0, 0.0, 0.0)
    scene.add(solids.box((0.0, 30.0, 5.0), (6.0, 2.0, 20.0), lying))
    scene.add(solids.cylinder((0.0, 60.0, 5.0), 3.0, 10.0, lying))
    up, down = array("d", (0.0, 0.0, -1.0)), array("d", (0.0, 0.0, 1.0))
    for north, east in ((4.4, 3.9), (-11.9, 0.0), (8.46, 35.22), (7.92, 65.94)):
        assert scene.ranges((north, east, 0.0), down, 50.0)[0] == pytest.approx(2.0)
        assert scene.ranges((north, east, 15.0), up, 50.0)[0] == pytest.approx(7.0 if east > 30.0 else 12.0)


def test_trees_in_c_and_python_are_equal() -> None:
    """Random triangles, rows of equal ones, and a mesh that shrinks geometrically, of one to some hundred."""
    rng = random.Random(1)
    for count in (1, 4, 5, 9, 17, 250):
        free = [rng.gauss(0.0, 1.0) for _ in range(9 * count)]
        for mesh in (free, [round(x) for x in free], [0.5 ** (i // 9) for i in range(9 * count)], [1.0] * 9 * count):
            made = []
            for engine in ("", "python"):
                nodes, triangles = array("f", (0.0,)) * (NODE * count), array("d", (0.0,)) * (GROUP * count)
                end = grow(array("d", mesh), nodes, triangles, 0, 0, engine)
                made.append((end, nodes, [triangle(triangles, number) for number in range(count)]))
            assert made[0] == made[1]


def test_a_ray_hits_the_nearest_of_all_triangles() -> None:
    """The answer is that of trying each triangle, for rays along the axes and through edges too."""
    rng = random.Random(2)
    step = 0.25
    corners, places = ((0, 0), (1, 0), (1, 1), (0, 1)), product(range(-9, 9), range(-9, 9))
    squares = [quad(*[(step * (i + a), step * (j + b), 3.0 + i * j % 3) for a, b in corners]) for i, j in places]
    mesh = mesh_of([triangle for square in squares for triangle in square])
    scene = RayScene(World("w", "test", EXTENT, 100.0), "C")
    scene.add(mesh)
    origin, rays = (0.0, 0.0, 0.0), random_rays(rng)
    flat = mesh.triangles
    edges = [[*flat[i : i + 3], *(flat[i + 3 + k] - flat[i + k % 3] for k in range(6))] for i in range(0, len(flat), 9)]
    for ray, distance in enumerate(scene.ranges(origin, rays, 50.0)):
        along = rays[3 * ray], rays[3 * ray + 1], rays[3 * ray + 2]
        assert distance == min(single._intersect_triangle(corner, origin, along) for corner in edges)


def test_a_triangle_seen_from_its_edge_is_hit_in_its_box_or_not_at_all() -> None:
    """Rays in the plane of a square have a determinant near 0, with which rounding gives any distance."""
    rng, hits = random.Random(6), 0
    for _ in range(20):
        rotation = matrix(attitude(rng))
        corners = [single.rotate_to_world(rotation, 5.0 + x, y, 0.0) for x, y in ((0, -1), (1, -1), (1, 1), (0, 1))]
        scenes = [RayScene(World("w", "test", EXTENT, 100.0), engine) for engine in ENGINES]
        rays = array("d")
        for k in range(50):
            length = sqrt(1.0 + (0.003 * k) ** 2)
            rays.extend(single.rotate_to_world(rotation, 1.0 / length, 0.003 * k / length, 0.0))
        for scene in scenes:
            scene.add(mesh_of(quad(*corners)))
        native, python = (scene.ranges((0.0, 0.0, 0.0), rays, 50.0) for scene in scenes)
        assert native == python
        along = np.array(rays).reshape(-1, 3)[np.array(native) < 50.0]
        points = along * np.array(native)[np.array(native) < 50.0, None]
        assert (points > np.min(corners, axis=0) - 1e-4).all()
        assert (points < np.max(corners, axis=0) + 1e-4).all()
        hits += len(points)
    assert hits


def rows_of_pixels(width: float, across: int, down: int) -> "array[float]":
    """Return rays of a camera, row after row: neighbours go about the same way."""
    rays = array("d")
    for i in range(across * down):
        x, y = (2.0 * (i % across) / across - 1.0) * width, (2.0 * (i // across) / down - 1.0) * width
        length = sqrt(1.0 + x * x + y * y)
        rays.extend((1.0 / length, x / length, y / length))
    return rays


@pytest.mark.parametrize("seed", range(7))
def test_skipping_free_space_for_bundles_of_rays_changes_nothing(seed: int) -> None:
    """The C begins narrow bundles of rays where none of them can have met anything, wide ones not."""
    rng = random.Random(f"{seed}/pixels")
    native, python = random_scene(seed, "C"), random_scene(seed, "python")
    for shot in range(6):
        origin = [rng.uniform(-22.0, 22.0), rng.uniform(-27.0, 30.0), rng.uniform(0.5, 11.0)]
        rotation = matrix(attitude(rng)) if shot else UPRIGHT
        rays, reach = rows_of_pixels((0.02, 0.8, 3.0)[shot % 3], 33, 9), rng.choice([6.0, 30.0, 500.0])
        hits, expected = (scene.hits(origin, rays, reach, rotation) for scene in (native, python))
        assert_equal_hits(hits, expected)


def test_bundles_of_rays_hit_a_mesh_like_single_rays() -> None:
    """Rays of a picture begin with common subtrees of a mesh, a few rays with its root."""
    rng, scene, hit = random.Random(8), RayScene(World("w", "test", EXTENT, 100.0), "C"), 0
    scraps = [
        [[5.0 * x + rng.gauss(0.0, 0.2) for x in at] for _ in range(3)]
        for at in np.random.default_rng(8).normal(size=(9000, 3))
    ]
    scene.add(mesh_of(scraps))
    for shot in range(30):
        origin = [rng.uniform(-9.0, 9.0) for _ in range(3)]
        rotation, rays = matrix(attitude(rng)) if shot else UPRIGHT, rows_of_pixels((0.05, 0.5, 3.0)[shot % 3], 40, 16)
        together = scene.hits(origin, rays, 50.0, rotation)
        few = [scene.hits(origin, rays[i : i + 21], 50.0, rotation) for i in range(0, len(rays), 21)]
        for name in together._fields:
            assert b"".join([getattr(hits, name).tobytes() for hits in few]) == getattr(together, name).tobytes()
        hit += sum(number == 1 for number in together.objects)
    assert 1000 < hit < 19000


@pytest.mark.parametrize("depth", [6.0, 18.0])
def test_rays_from_the_edge_of_the_world_are_equal(depth: float) -> None:
    """The rays start at an edge of the grid or beyond it, in and below the water, also with a reach of zero."""
    grid = covering((0.0, 40.0, 0.0, 40.0), 1.0)
    terrain = Terrain(grid, Fractal(12.0, 1.0, 0.5, seed=2).depths(grid), 12.0)
    world = World("edge", "test", (0.0, 40.0, 0.0, 40.0), 12.0, terrain=terrain)
    native, python = RayScene(world, "C"), RayScene(world, "python")
    for north, east in ((40.0, 20.0), (0.0, 0.0), (20.0, 40.0), (20.0, 20.0), (15.0, -6.0)):
        for reach in (0.0, 1e-9, 30.0):
            for turn in (
                (0.0, 0.0, 0.0, 1.0),
                (1.0, 0.0, 0.0, 0.0),
                (1.0, 0.0, -0.3, 0.4),
            ):  # back, ahead, aside and down
                rays = rows_of_pixels(0.02, 16, 4)
                hits, expected = (
                    scene.hits((north, east, depth), rays, reach, matrix(normalise(turn))) for scene in (native, python)
                )
                assert_equal_hits(hits, expected)


def test_skipping_blocks_of_a_large_grid_changes_nothing() -> None:
    """The C skips blocks of 16 x 16 and 4 x 4 cells, also where those end at an edge, at a hole or at land."""
    grid = covering((0.0, 333.0, 0.0, 275.0), 1.0)
    deep = Fractal(20.0, 3.0, 0.6, seed=5).depths(grid)
    land = array("f", [max(0.0, depth - 16.0) for depth in deep])  # 0 m is what a block without a number has
    land[7000] = nan
    rng = random.Random(4)
    for depths, down in ((deep, 9.0), (land, 0.4)):
        world = World("large", "test", EXTENT, 20.0, terrain=Terrain(grid, depths, 20.0))
        native, python = RayScene(world, "C"), RayScene(world, "python")
        for _ in range(4):
            origin = (rng.uniform(0.0, 333.0), rng.uniform(0.0, 275.0), down)
            rays = random_rays(rng)
            assert native.ranges(origin, rays, 500.0) == python.ranges(origin, rays, 500.0)


def test_obstacles_out_of_reach_change_nothing() -> None:
    """A sensor with a reach of 15 m meets only the near ones of 400 piles, with the numbers that they have."""
    rng = random.Random(7)
    piles = tuple(Cylinder(rng.uniform(-200.0, 200.0), rng.uniform(-200.0, 200.0), 3.0) for _ in range(400))
    world = World("piles", "test", (-200.0, 200.0, -200.0, 200.0), 20.0, cylinder=piles)
    native, python = RayScene(world, "C"), RayScene(world, "python")
    hit_kinds = set[int]()
    for _ in range(5):
        origin, rays = (rng.uniform(-150.0, 150.0), rng.uniform(-150.0, 150.0), 5.0), random_rays(rng)
        hits, expected = native.hits(origin, rays, 15.0), python.hits(origin, rays, 15.0)
        assert (hits.distances, hits.objects) == (expected.distances, expected.objects)
        hit_kinds.update(hits.objects)
    assert len(hit_kinds) > 5


def test_casting_rays_leaks_no_memory() -> None:
    scene, rays = random_scene(1, "C"), random_rays(random.Random(1))
    counts = []
    for _ in range(3):
        for _ in range(300):
            scene.hits((0.0, 0.0, 3.0), rays, 50.0)
        for _ in range(20):
            scene.add(solids.sphere((0.0, 0.0, 9.0), 0.1))
            scene.ranges((0.0, 0.0, 3.0), rays, 50.0)
            scene._added.pop()
        counts.append((sys.getrefcount(rays), sys.getallocatedblocks()))
    assert counts[2][0] == counts[1][0]
    assert abs(counts[2][1] - counts[1][1]) < 100


def test_the_c_module_checks_its_buffers() -> None:
    caster = sys.modules["sim.native._rays"].Caster
    bounds, empty = (0, 0, 0.0, 0.0, 1.0, 10.0), array("d")
    with pytest.raises(ValueError, match="depths: 8 bytes are not 2 x 2 of 4"):
        caster((2, 2, 0.0, 0.0, 1.0, 10.0), array("f", [1.0, 2.0]), empty, empty, empty)
    with pytest.raises(ValueError, match="solids: 8 bytes are no records of 168 bytes"):
        caster(bounds, b"", pack("d", 1.0), empty, empty)
    cast = caster(bounds, b"", empty, empty, empty).cast
    down, out = array("d", (0.0, 0.0, 1.0)), array("d", (0.0,))
    cast((0.0, 0.0, 1.0), UPRIGHT, down, 100.0, out)
    assert out[0] == 9.0
    with pytest.raises(ValueError, match="buffer 1 has 16 bytes, 8 a ray are needed"):
        cast((0.0, 0.0, 1.0), UPRIGHT, down, 100.0, array("d", (0.0, 0.0)))
    with pytest.raises(ValueError, match="3 numbers are needed, found 2"):
        cast((0.0, 0.0), UPRIGHT, down, 100.0, out)
    with pytest.raises(BufferError):
        cast((0.0, 0.0, 1.0), UPRIGHT, down, 100.0, bytes(8))
    for wrong in (("x", 0.0, 1.0), ("x" * 3)):
        with pytest.raises(TypeError):
            cast(wrong, UPRIGHT, down, 100.0, out)
    with pytest.raises(TypeError, match="all or none"):
        cast((0.0, 0.0, 1.0), UPRIGHT, down, 100.0, out, out)


def test_without_c_rays_are_computed_in_python(monkeypatch: pytest.MonkeyPatch) -> None:
    """The engine is then not reported as C."""
    monkeypatch.setenv("UUV_HIL_NATIVE", "0")
    world, rays = random_world(1), random_rays(random.Random(2))
    origin = (0.0, 0.0, 3.0)
    plain = RayScene(world, "python").ranges(origin, rays, 50.0)
    assert RayScene(world).ranges(origin, rays, 50.0) == plain
    with pytest.raises(ConfigError, match=r"python c_extensions\.py"):
        RayScene(world, "C").ranges(origin, rays, 50.0)


@pytest.mark.parametrize(
    ("rows", "columns"),
    [(1 << 32, 1 << 32), (1 << 62, 4), (4, 1 << 62), (1 << 31, 2), ((1 << 63) - 1, 2), (-1, -1), (2, 0), (3, 2)],
)
def test_a_grid_larger_than_its_buffer_is_refused(rows: int, columns: int) -> None:
    """It is refused also where rows times columns overflows 64 bits to the size of the buffer."""
    caster = pytest.importorskip("sim.native._rays").Caster
    for depths in (b"", bytes(16)):
        with pytest.raises(ValueError, match=f"are not {rows} x {columns} of 4"):
            caster((rows, columns, 0.0, 0.0, 1.0, 5.0), depths, b"", b"", b"")
