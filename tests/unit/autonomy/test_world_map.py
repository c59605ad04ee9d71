"""The map of all water above the vehicle."""

import os
from math import inf
from typing import Any

import pytest

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
