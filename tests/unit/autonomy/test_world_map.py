"""The world's map at the vehicle's depth in map_server's layout: nothing mirrored, turned or at a wrong depth."""

import os
from math import inf
from typing import Any

import pytest

from hil.autonomy.paths.occupancy import Extent, OccupancyGrid
from hil.scenario.world_map import map_at
from sim.environment.obstacles import Box
from sim.environment.world import World, load_world

TEXT = """
name = "asymmetric"
source = "made up"
extent = [-5.0, 25.0, 10.0, 50.0]
depth = 20.0

[[cylinder]]
north = 18.0
east = 15.0
radius = 2.0

[[box]]
north = 2.0
east = 40.0
size_north = 2.0
size_east = 12.0
top = 8.0
"""


@pytest.fixture
def world(tmp_path: Any) -> World:
    path = os.path.join(tmp_path, "asymmetric.toml")
    with open(path, "w", encoding="utf-8") as file:
        file.write(TEXT)
    return load_world(path)


def map_of(world: World, depth: float, resolution: float = 0.25) -> OccupancyGrid:
    south, north, west, east = world.extent
    return OccupancyGrid.rasterise(
        lambda n, e: world.clearance(n, e, depth), Extent(south, west, north, east), resolution
    )


def test_every_cell_agrees_with_the_worlds_clearance(world: World) -> None:
    for depth in (5.0, 12.0):
        grid = map_of(world, depth, 0.5)
        for row in range(grid.cells.shape[0]):
            for column in range(grid.cells.shape[1]):
                north, east = grid.centre((row, column))
                assert bool(grid.cells[row, column]) == (world.clearance(north, east, depth) <= 0.0)


def test_only_obstacles_at_the_vehicles_depth_are_on_the_map(world: World) -> None:
    shallow, deep = map_of(world, 5.0), map_of(world, 12.0)
    assert shallow.is_free((2.0, 40.0))  # it passes over the box, whose top is at 8 m
    assert not deep.is_free((2.0, 40.0))
    assert not shallow.is_free((18.0, 15.0))
    mirrored = [(2.0, 15.0), (18.0, 45.0), (2.0, 45.0 - 30.0), (18.0, 40.0), (15.0, 18.0)]
    assert all(deep.is_free(point) for point in mirrored)


@pytest.mark.parametrize(("above", "is_free"), [(None, True), (inf, False)])
def test_a_map_of_all_water_above_has_what_floats_there(world: World, above: float | None, is_free: bool) -> None:
    """A vehicle at 5 m passes below a pontoon; water that is free down to 5 m has none, and no part of a pile."""
    afloat = world._replace(box=(Box(10.0, 30.0, 6.0, 6.0, bottom=2.0),))
    grid = map_at(afloat, 5.0, 0.0, 1.0, is_coarse=True, above=above)
    assert grid.is_free((12.5, 32.5)) == is_free
    assert not grid.is_free((18.5, 16.5))
    assert grid.is_free((18.5, 18.5))
    assert map_at(afloat, 20.0, 0.0, 1.0, above=above).cells.all(), "the bed"
    assert map_at(load_world("ridge"), 12.0, 0.0, 300.0, is_coarse=True, above=above).cells.shape == (1, 1)


def test_the_image_shows_north_up_and_east_right(world: World, tmp_path: Any) -> None:
    """Pixel (column, row from the top) is x = origin + column, y = origin + height - row, by map_server's own rule."""
    path = os.path.join(tmp_path, "asymmetric.pgm")
    map_of(world, 12.0, 0.5).write_pgm(path)
    with open(path, "rb") as file:
        image = file.read().split(b"\n255\n", 1)[1]
    width, height = 80, 60

    def pixel(north: float, east: float) -> int:
        x, y = int((east - 10.0) / 0.5), int((north + 5.0) / 0.5)
        return image[(height - 1 - y) * width + x]

    assert len(image) == width * height
    assert [pixel(18.0, 15.0), pixel(2.0, 35.0), pixel(2.0, 45.0)] == [0, 0, 0]
    assert [pixel(2.0, 15.0), pixel(18.0, 45.0), pixel(8.0, 40.0), pixel(2.0, 47.0)] == [254] * 4
    back = OccupancyGrid.read(os.path.join(tmp_path, "asymmetric.yaml"))
    assert not back.is_free((18.0, 15.0))
    assert back.is_free((18.0, 45.0))


def test_a_path_on_the_inflated_map_keeps_the_clearance(world: World) -> None:
    """The clearance along a path on the inflated map holds by the world's own measure, to half a cell's diagonal."""
    from itertools import pairwise
    from math import dist

    from hil.autonomy.paths.any_angle import plan_any_angle
    from hil.autonomy.paths.astar import plan, smooth

    inflated = map_of(world, 12.0).inflate(1.0)
    for path in (
        plan(inflated, (-3.0, 45.0), (20.0, 12.0)),
        smooth(inflated, plan(inflated, (-3.0, 45.0), (20.0, 12.0))),
        plan_any_angle(inflated, (-3.0, 45.0), (20.0, 12.0)),
    ):
        for a, b in pairwise(path):
            for part in range(int(dist(a, b) / 0.05) + 1):
                share = part * 0.05 / dist(a, b)
                north, east = (p + share * (q - p) for p, q in zip(a, b, strict=True))
                assert world.clearance(north, east, 12.0) > 1.0 - 0.25 * 2.0**0.5
