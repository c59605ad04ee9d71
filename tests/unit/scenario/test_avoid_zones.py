"""Zones on a planner's map: only those of the kinds that the scenario names, and only on a known map."""

from hil.autonomy.paths.occupancy import Extent, OccupancyGrid
from hil.scenario.records import Master
from hil.scenario.world_map import close, known_map
from sim.environment.things.zones import Zone
from sim.environment.world import World
from sim.vehicle.vehicle import load_vehicle

VEHICLE, _ = load_vehicle("paper_six")
HOOK = ((10.0, 10.0), (40.0, 10.0), (40.0, 20.0), (20.0, 20.0), (20.0, 40.0), (10.0, 40.0))
ZONES = (Zone("restricted", HOOK), Zone("anchorage", ((-40.0, -40.0), (-40.0, -20.0), (-20.0, -20.0))))
WORLD = World("sea", "test", (-50.0, 50.0, -50.0, 50.0), 20.0, zone=ZONES)


def test_only_zones_of_the_named_kinds_are_closed() -> None:
    free = known_map(Master(resolution=0.5), VEHICLE, WORLD)
    assert not free.cells.any(), "by default zones close no cells"
    grid = known_map(Master(resolution=0.5, avoid_zones=("restricted", "dumping")), VEHICLE, WORLD)
    assert not grid.is_free((15.0, 30.0))
    assert not grid.is_free((30.0, 15.0))
    assert grid.is_free((30.0, 30.0)), "between the arms of the hook"
    assert grid.is_free((-30.0, -25.0)), "anchorages are not named"
    assert abs(grid.cells.sum() * 0.25 - (30.0 * 10.0 + 20.0 * 10.0)) < 1.0
    unknown = known_map(Master(map="unknown", avoid_zones=("restricted",)), VEHICLE, WORLD)
    assert not unknown.cells.any()


def test_a_zone_off_the_map_closes_only_its_cells_on_the_map() -> None:
    grid = OccupancyGrid.empty(Extent(0.0, 0.0, 30.0, 30.0), 1.0)
    close(grid, ((100.0, 100.0), (120.0, 100.0), (110.0, 120.0)))
    assert not grid.cells.any()
    close(grid, ((-50.0, -50.0), (-50.0, 10.0), (10.0, 10.0), (10.0, -50.0)))
    assert grid.cells.sum() == 100
