"""The planner's map of a world: obstacles and relief at its depth, hidden obstacles left out, map files oriented."""

from array import array
from math import hypot, inf, sqrt
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hil.autonomy.paths.occupancy import OccupancyGrid
from hil.cases.simulated import SimulatedVehicle, fly
from hil.common.errors import ConfigError
from hil.master.flight import prepare
from hil.scenario.config import load_scenario
from hil.scenario.records import Master
from hil.scenario.variant import write_toml
from hil.scenario.world_map import known_map, map_at
from sim.environment.obstacles import Box, Cylinder
from sim.environment.shallows import distance_to_shallows
from sim.environment.terrain import Terrain
from sim.environment.terrain_grid import Grid
from sim.environment.world import World, load_world
from sim.vehicle.vehicle import load_vehicle
from tests.support.examples import examples

SIX, _ = load_vehicle("paper_six")
ROWS, COLUMNS, STEP = 61, 51, 1.0


def hill(north: float, east: float) -> float:
    """Return a hill of 10 m at (20, 32) in water 15 m deep, long to the east, which no mirror image equals."""
    return 15.0 - 10.0 * float(np.exp(-(((north - 20.0) / 5.0) ** 2) - ((east - 32.0) / 9.0) ** 2))


def hilly(folder: Path) -> Path:
    depths = array("f", [hill(i * STEP, j * STEP) for i in range(ROWS) for j in range(COLUMNS)])
    (folder / "mound.f32").write_bytes(depths.tobytes())
    terrain = {
        "file": "mound.f32",
        "north_min": 0.0,
        "east_min": 0.0,
        "resolution": STEP,
        "rows": ROWS,
        "columns": COLUMNS,
    }
    world = {"name": "mound", "source": "made up", "extent": [0.0, 60.0, 0.0, 50.0], "depth": 15.0, "terrain": terrain}
    write_toml(str(folder / "mound.toml"), world)
    return folder / "mound.toml"


def test_relief_that_is_too_shallow_is_on_the_map(tmp_path: Path) -> None:
    world = load_world(str(hilly(tmp_path)))
    for depth in (4.0, 8.0, 12.0):
        grid = map_at(world, depth, 0.5, 0.5)
        for row, column in np.ndindex(grid.cells.shape):
            assert bool(grid.cells[row, column]) == (world.seabed(*grid.centre((row, column))) <= depth + 0.5)
    deep = map_at(world, 8.0, 0.5, 0.5)
    assert not deep.is_free((20.0, 37.0))
    assert deep.is_free((37.0, 20.0))  # not turned
    assert deep.is_free((40.0, 37.0))  # not mirrored
    assert map_at(world, 4.0, 0.5, 0.5).is_free((20.0, 32.0))  # the vehicle passes over it


def test_every_worlds_map_agrees_with_its_clearance() -> None:
    for name, depth in (("harbour", 4.0), ("paper_field", 5.0), ("pool", 1.0), ("ridge", 14.0)):
        world = load_world(name)
        world = world._replace(cylinder=tuple(pile for pile in world.cylinder if pile.radius > 1.0))
        grid = map_at(world, depth, 0.0, 1.3)
        for row, column in np.ndindex(grid.cells.shape):
            north, east = grid.centre((row, column))
            assert bool(grid.cells[row, column]) == (world.clearance(north, east, depth, 0.0) <= 0.0)


def test_clearance_over_relief_is_the_distance_to_its_contour() -> None:
    """The distance to the straight contours of a plane is known. Beyond `within` the clearance is infinite."""
    slope = load_world("slope")
    (to_north, to_east), depth = slope.terrain.gradient(3.3, -7.1), slope.seabed(3.3, -7.1)  # type: ignore[union-attr]
    steep = hypot(to_north, to_east)
    for up in (0.2, 1.0, 2.5):
        assert slope.clearance(3.3, -7.1, depth - up) == pytest.approx(up / steep, rel=1e-4)
        assert slope.clearance(3.3, -7.1, depth - up, within=0.9 * up / steep) == inf
    assert slope.clearance(3.3, -7.1, depth + 2.0) == pytest.approx(-2.0)
    assert slope.clearance(3.3, -7.1) == inf


@examples(60)
@given(
    st.lists(st.floats(5.0, 20.0, width=32), min_size=30, max_size=30),
    st.floats(0.0, 8.0),
    st.floats(0.0, 10.0),
    st.floats(6.0, 19.0),
    st.sampled_from([4.0, 30.0]),
)
def test_no_shallow_point_is_nearer_than_the_reported_distance(
    depths: list[float], north: float, east: float, depth: float, outside: float
) -> None:
    """Nothing too shallow is nearer on any terrain, looked at densely, but for a contour's bend within a cell.

    Where the seabed of a cell is too shallow anywhere, it is at a corner: no further from there than the diagonal.
    """
    terrain = Terrain(Grid(0.0, 0.0, 2.0, 5, 6), array("f", depths), outside)
    reported = distance_to_shallows(terrain, north, east, depth, 6.0)
    neighbours = [
        (n, e) for n in np.arange(north - 6.0, north + 6.1, 0.25) for e in np.arange(east - 6.0, east + 6.1, 0.25)
    ] + [(2.0 * row, 2.0 * column) for row in range(5) for column in range(6)]
    nearest = min((hypot(n - north, e - east) for n, e in neighbours if terrain.depth(n, e) <= depth), default=inf)
    if terrain.depth(north, east) <= depth:
        assert reported == terrain.depth(north, east) - depth
    elif nearest <= 4.0:  # beyond, the other may be out of reach
        assert nearest - 2.0 * sqrt(2.0) - 1e-6 < reported <= nearest + 2.0  # a cell


def test_a_path_goes_round_a_hill(tmp_path: Path) -> None:
    """The path is planned, flown in simulated time, and judged by the terrain itself."""
    scenario = {
        "vehicle": "paper_six",
        "world": str(hilly(tmp_path)),
        "start": {"north": 4.0, "east": 30.0, "depth": 9.0},
        "master": {"goal": [40.0, 34.0], "depth": 9.0, "speed": 0.8, "resolution": 0.5, "time_limit": 120.0},
    }
    write_toml(str(tmp_path / "round.toml"), scenario)
    loaded = load_scenario(str(tmp_path / "round.toml"))
    plan = prepare(loaded)
    vehicle = SimulatedVehicle(loaded, plan.world)
    outcome, _ = fly(loaded, plan, vehicle)
    assert outcome.reached
    assert vehicle.simulation.contacts == 0
    assert outcome.path_length > 39.0  # straight on it is 36.2 m, over the hill
    assert 0.24 < outcome.least_clearance < 1.6


def test_hidden_obstacles_are_not_on_the_map() -> None:
    pile, block = Cylinder(5.0, 5.0, 1.0, hidden=True), Box(15.0, 5.0, 2.0, 2.0)
    world = World("some", "made up", (0.0, 20.0, 0.0, 10.0), 10.0, cylinder=(pile,), box=(block,))
    known_grid, unknown = (known_map(Master(depth=5.0, map=text), SIX, world) for text in ("known", "unknown"))
    assert known_grid.is_free((5.0, 5.0))
    assert not known_grid.is_free((15.0, 5.0))
    assert not unknown.cells.any()
    assert known_grid.cells.shape == unknown.cells.shape
    assert world.clearance(5.0, 5.0, 5.0) == -1.0  # it exists in the world


def test_a_path_is_planned_on_a_map_from_a_file(tmp_path: Path) -> None:
    """A map that is written, named in a scenario and read gives the same path, round all that the file shows."""
    field = load_scenario("paper_field")
    straight = prepare(field)
    straight.request.map.write_pgm(str(tmp_path / "field.pgm"))
    table = {"vehicle": "paper_six", "world": "paper_field", "master": {"goal": [50.0, 50.0], "map": "field.yaml"}}
    write_toml(str(tmp_path / "from_file.toml"), table)
    again = prepare(load_scenario(str(tmp_path / "from_file.toml")))
    assert np.array_equal(again.request.map.cells, straight.request.map.cells)
    assert again.planner.path == straight.planner.path
    wall = OccupancyGrid(straight.request.map.cells.copy(), 0.25, (-3.0, -3.0))
    wall.cells[100:104, :190] = True
    wall.write_pgm(str(tmp_path / "field.pgm"))
    walled = prepare(load_scenario(str(tmp_path / "from_file.toml")))
    assert max(east for _, east, _ in walled.planner.path) > -3.0 + 190 * 0.25
    with pytest.raises(ConfigError, match=r"neither \"known\", \"unknown\" nor a file"):
        load_scenario("paper_field", {"master.map": "knwon"})
    with pytest.raises(ConfigError, match=r"nowhere.yaml: no such file"):
        prepare(load_scenario("paper_field", {"master.map": "nowhere.yaml"}))


def test_thin_obstacles_always_occupy_a_cell() -> None:
    """A pile of 8 cm and a plate of 4 cm occupy cells of 1 m wherever they stand."""
    for shift in np.linspace(0.0, 1.0, 21):
        pile = Cylinder(5.0 + shift, 5.0 + 0.7 * shift, 0.04)
        plate = Box(14.0, 5.0 + shift, 6.0, 0.04, heading=0.3)
        grid = map_at(
            World("some", "made up", (0.0, 20.0, 0.0, 10.0), 10.0, cylinder=(pile,), box=(plate,)), 5.0, 0.3, 1.0
        )
        assert not grid.inflate(1.0).is_free(pile[:2])
        assert not grid.line_is_free((14.0, 1.0), (14.0, 9.0)), "the plate is a wall"
        assert grid.cells.sum() < 25


def test_hanging_obstacles_are_on_the_map_at_the_depths_they_reach() -> None:
    pontoon = Box(10.0, 5.0, 4.0, 4.0, bottom=2.0)
    world = World("some", "made up", (0.0, 20.0, 0.0, 10.0), 10.0, box=(pontoon,))
    assert not map_at(world, 1.0, 0.3, 0.5).is_free((10.0, 5.0))
    assert not map_at(world, 2.2, 0.3, 0.5).is_free((10.0, 5.0)), "0.3 m of clearance is required"
    assert map_at(world, 2.4, 0.3, 0.5).is_free((10.0, 5.0))
