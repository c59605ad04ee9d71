"""Seabeds with relief: the surface between the nodes, rules, files, and the depths that a world reports."""

from array import array
from itertools import pairwise
from math import cos, exp, inf, nan, pi, sin, sqrt
from pathlib import Path
from statistics import fmean, pstdev

import pytest

from hil.common.errors import ConfigError
from sim.environment.relief import Fractal, Ridge, Sinusoid, Slope, Step
from sim.environment.shallows import distance_to_shallows
from sim.environment.terrain import NO_DATA, Terrain, covering
from sim.environment.terrain_grid import Grid
from sim.environment.world import load_world

WORLD = """
name = "mine"
source = "test"
extent = [-10, 30, -20, 20]
depth = 25
"""


def world_file(folder: Path, text: str) -> str:
    path = folder / "mine.toml"
    path.write_text(WORLD + text)
    return str(path)


def test_depths_between_the_nodes_are_bilinear() -> None:
    """A bilinear cell has d = 3 + 2 x + y + x y / 2 in rows and columns exactly; nodes are 2 m apart."""
    nodes = array("f", [3.0 + 2.0 * i + j + 0.5 * i * j for i in range(4) for j in range(5)])
    terrain = Terrain(Grid(10.0, -4.0, 2.0, 4, 5), nodes, 99.0)
    for i in range(25):
        for j in range(33):
            x, y = i / 8.0, j / 8.0
            north, east = 10.0 + 2.0 * x, -4.0 + 2.0 * y
            assert terrain.depth(north, east) == pytest.approx(3.0 + 2.0 * x + y + 0.5 * x * y, abs=1e-12)
            to_north, to_east = terrain.gradient(north, east)
            assert (to_north, to_east) == pytest.approx(((2.0 + 0.5 * y) / 2.0, (1.0 + 0.5 * x) / 2.0), abs=1e-12)
            normal = terrain.normal(north, east)
            assert sum(a * a for a in normal) == pytest.approx(1.0)
            assert [a / -normal[2] for a in normal[:2]] == pytest.approx([to_north, to_east])
    assert terrain.depth(9.99, 0.0) == terrain.depth(16.01, 0.0) == terrain.depth(12.0, 4.01) == 99.0
    assert terrain.normal(9.99, 0.0) == (0.0, 0.0, -1.0)


def test_a_node_without_data_is_a_wall() -> None:
    terrain = Terrain(Grid(0.0, 0.0, 1.0, 4, 4), array("f", [nan] + [20.0] * 15), 20.0)
    assert terrain.depth(0.5, 0.5) == NO_DATA
    assert terrain.gradient(0.5, 0.5) == (0.0, 0.0)
    assert terrain.depth(0.5, 1.5) == 20.0
    with pytest.raises(ValueError, match="3 depths for 2 x 2 nodes"):
        Terrain(Grid(0.0, 0.0, 1.0, 2, 2), array("f", [1.0] * 3), 1.0)


def test_the_shallowest_bound_is_never_deeper_than_the_terrain() -> None:
    grid = covering((-10.0, 10.0, -10.0, 10.0), 0.7)
    terrain = Terrain(grid, Fractal(15.0, 2.0, seed=4).depths(grid), 15.0)
    for north, east in ((0.0, 0.0), (-9.9, 3.0), (9.0, -9.0), (-30.0, 0.0), (4.4, 11.0)):
        least = terrain.shallowest(north, east, 2.5)
        places = [(north + 0.25 * i, east + 0.25 * j) for i in range(-10, 11) for j in range(-10, 11)]
        assert least <= min(terrain.depth(*place) for place in places)
        assert least >= terrain.shallowest(north, east, 4.0)
    assert terrain.shallowest(100.0, 0.0, 3.0) == 15.0
    grid = Grid(0.0, 0.0, 1.0, 9, 9)
    assert Terrain(grid, array("f", [5.0] * 40 + [nan] + [5.0] * 40), 5.0).shallowest(4.0, 4.0, 1.0) == NO_DATA


def test_the_distance_to_shallows_is_that_to_the_contour_a_wall_or_the_edge() -> None:
    """The bed falls to the east, or is 50 m deep around a node without data and in shallow surroundings."""
    grid = Grid(-20.0, -30.0, 2.0, 21, 31)
    plane = Terrain(grid, array("f", [j - 5.0 for _ in range(21) for j in range(31)]), 99.0)
    found = [
        distance_to_shallows(plane, 1.0, east, 11.0, within)
        for east, within in ((17.0, 50.0), (17.0, 14.9), (-4.0, 9.0))
    ]
    assert found == pytest.approx([15.0, inf, -3.0])
    holed = Terrain(grid, array("f", [nan if n == 5 * 31 + 20 else 50.0 for n in range(21 * 31)]), 3.0)
    places = [(-5.0, 10.0), (13.0, 0.0), (-14.0, -3.0), (1.0, 26.0), (1.0, -25.0)]
    assert [distance_to_shallows(holed, *place, 3.0, 50.0) for place in places] == pytest.approx(
        [3.0, 7.0, 6.0, 4.0, 5.0]
    )


# --- rules


@pytest.mark.parametrize("heading", [0.0, 0.7, -2.0])
def test_rules_give_the_depths_of_their_formulas(heading: float) -> None:
    grid = Grid(-20.0, -20.0, 1.0, 41, 41)
    common = {"heading": heading, "north": 3.0, "east": -2.0}
    slope, ridge = Slope(12.0, 0.2, **common), Ridge(12.0, 3.0, 4.0, **common)
    waves, step = Sinusoid(12.0, 0.5, 7.0, **common), Step(12.0, 5.0, **common)
    terrains = [Terrain(grid, rule.depths(grid), 12.0) for rule in (slope, ridge, waves, step)]
    for i in range(41):
        for j in range(41):
            north, east = i - 20.0, j - 20.0
            x = cos(heading) * (north - 3.0) + sin(heading) * (east + 2.0)
            expected = [12.0 + 0.2 * x, 12.0 - 3.0 * exp(-x * x / 32.0), 12.0 - 0.5 * sin(2.0 * pi * x / 7.0)]
            assert [terrain.depth(north, east) for terrain in terrains[:3]] == pytest.approx(expected, abs=1e-5)
            if abs(x) > 1e-9:
                assert terrains[3].depth(north, east) == (7.0 if x > 0.0 else 12.0)


def test_fractal_ground_has_its_mean_and_size_and_depends_on_its_seed() -> None:
    grid = covering((0.0, 100.0, 0.0, 60.0), 1.0)
    rule = Fractal(40.0, 2.5, seed=7)
    depths = rule.depths(grid)
    assert len(depths) == 101 * 61
    assert fmean(depths) == pytest.approx(40.0, abs=1e-4)
    assert pstdev(depths) == pytest.approx(2.5, rel=1e-5)
    assert depths == rule.depths(grid)
    assert depths != rule._replace(seed=8).depths(grid)
    assert set(Fractal(40.0, 0.0).depths(grid)) == {40.0}


def test_a_higher_hurst_exponent_is_smoother() -> None:
    """The depth changes by much less from node to node, though the whole is as high."""
    grid = covering((0.0, 128.0, 0.0, 128.0), 1.0)

    def roughness(hurst: float) -> float:
        nodes = Fractal(40.0, 2.0, hurst, 3).depths(grid)
        rows = [nodes[i * 129 : (i + 1) * 129] for i in range(129)]
        return sqrt(fmean((a - b) ** 2 for row in rows for a, b in pairwise(row)))

    assert roughness(1.0) < 0.5 * roughness(0.5) < 0.3 * roughness(0.0)


# --- worlds


FILE = '[terrain]\nfile = "bay.f32"\nnorth_min = -4\neast_min = 2\nresolution = 0.5\nrows = 3\ncolumns = 4\n'


def test_a_world_file_can_have_a_terrain_file(tmp_path: Path) -> None:
    """Rows go to the north, columns to the east; the file lies beside the world's."""
    (tmp_path / "bay.f32").write_bytes(array("f", [10.0 + i for i in range(12)]).tobytes())
    world = load_world(world_file(tmp_path, FILE))
    assert world.terrain is not None
    assert world.seabed(-4.0, 2.0) == 10.0
    assert world.seabed(-4.0, 2.5) == 11.0
    assert world.seabed(-3.5, 2.0) == 14.0
    assert world.seabed(-3.0, 3.5) == 21.0
    assert world.seabed(-3.25, 2.25) == 16.5
    assert isinstance(world.terrain.depths, memoryview)
    assert world.terrain.depths.readonly


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (FILE, "bay.f32: no such file"),
        (FILE.replace("terrain", "bottom_map"), "bay.f32: no such file"),
        (FILE.replace("bay.f32", "mine.toml"), " bytes, but 3 x 4 depths are 48"),
        (FILE.replace("terrain", "bottom_map").replace("bay.f32", "mine.toml"), " bytes, but 3 x 4 are 12"),
        ("[terrain]\n", "mine.toml: terrain: expected a table with either file"),
        ('terrain = "bay.f32"\n', "expected a table with either file"),
        ('[terrain]\nfile = "x"\nkind = "slope"\n', "expected a table with either file"),
        (
            '[terrain]\nkind = "slop"\n',
            "'slop' is not one of slope, step, ridge, sinusoid, fractal; did",
        ),
        ('[terrain]\nkind = "fractal"\ndepth = 9\ndeviation = 1\nresolution = 0.01\n', "4001 x 4001 nodes are"),
    ],
)
def test_wrong_terrain_tables_are_reported(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(ConfigError) as caught:
        load_world(world_file(tmp_path, text))
    assert message in str(caught.value)


def test_obstacles_stand_on_the_relief(tmp_path: Path) -> None:
    """A top at 26 m is in the flat seabed at 25 m, but not where the slope is 30 m deep; at 10 m it is."""
    pile = "[[cylinder]]\nnorth = {}\neast = 0\nradius = 1\ntop = 26\n"
    slope = '[terrain]\nkind = "slope"\ndepth = 20\nslope = 0.5\n'
    with pytest.raises(ConfigError, match=r"the obstacle at \(20, 0\) has its top in the seabed"):
        load_world(world_file(tmp_path, pile.format(20)))
    assert load_world(world_file(tmp_path, pile.format(20) + slope)).cylinder
    with pytest.raises(ConfigError, match=r"the obstacle at \(0, 0\) has its top in the seabed"):
        load_world(world_file(tmp_path, pile.format(0) + slope))


def test_depths_stay_equal_after_their_memory_was_released(tmp_path: Path) -> None:
    (tmp_path / "bay.f32").write_bytes(array("f", [10.0 + i for i in range(12)]).tobytes())
    world = load_world(world_file(tmp_path, FILE))
    assert world.terrain is not None
    before = [world.seabed(0.1 * k - 4.0, 0.05 * k + 2.0) for k in range(10)]
    world.terrain.unmap()
    assert [world.seabed(0.1 * k - 4.0, 0.05 * k + 2.0) for k in range(10)] == before
    assert len(set(before)) == 10
    Terrain(Grid(0.0, 0.0, 1.0, 2, 2), array("f", [1.0] * 4), 1.0).unmap()  # of no file: nothing to do
