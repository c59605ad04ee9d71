"""Write the scenario of a dive over the seabed of a chart: the world, a path, and a vehicle with sensors."""

import os
from collections.abc import Iterator
from math import atan2
from typing import NamedTuple

import numpy as np

from hil.charts.describe import Facts, facts
from hil.charts.grid import Extent, Grid, grid_of, write_file
from hil.charts.gridding import Progress
from hil.charts.projection import LocalPlane
from hil.charts.seabed_cache import WholeSeabed, cut_seabed, load_or_build_seabed
from hil.charts.site import Point, Site, depth_between, find_sites
from hil.charts.sources.sign import Declared
from hil.charts.world_file import write_world
from hil.common.errors import ConfigError, MissionError
from hil.master.flight import prepare
from hil.scenario.config import load_scenario
from sim.environment.world import World, load_world

WORLD_MARGIN = 150.0  # m of the world around the path
SPEED = 0.7  # m/s; this vehicle's maximum is 0.85 m/s

SCENARIO = """\
# Made by `uuv-hil demo --world`; fly it again with `uuv-hil demo {name}.toml`.
description = "{description}"
vehicle = "bluerov2_heavy"
world = "{world}"
seed = 1

[start]
north = {start[0]:.2f}
east = {start[1]:.2f}
depth = {depth:.2f}
heading = {heading:.4f}

[slave]
listen = "{listen}"

[ros]
images = "raw" # both ends are here

[sensors.altimeter]

[sensors.laser]
position = [0.25, 0.0, -0.1]

[sensors.camera] # looks down ahead
position = [0.25, 0.0, 0.05]
orientation = ["0 deg", "-35 deg", "0 deg"]
rate = 4.0
water = "IB" # of a clear ocean, so that the bed is seen; of coasts "1C" to "9C"

[sensors.forward_sonar]
position = [0.25, 0.0, 0.0]
orientation = ["0 deg", "-12 deg", "0 deg"]
rate = 4.0

[master]
goal = [{goal[0]:.2f}, {goal[1]:.2f}]
depth = {depth:.2f}
speed = {speed}
lookahead = "3 m"
tolerance = "1.5 m"
resolution = "1 m"
margin = "1 m"
seabed_margin = "0.8 m"
time_limit = {limit:.0f}
"""


class DiveOptions(NamedTuple):
    """Options of a dive.

    `start` and `goal`: latitude and longitude, degrees. `depth`, `length`, and `resolution` of a chart's grid: m.
    `declared`: what the user says of the values of soundings and rasters.
    """

    start: Point | None = None
    goal: Point | None = None
    depth: float | None = None
    length: float = 70.0
    listen: str = "tcp/127.0.0.1:7447"
    resolution: float | None = None
    declared: Declared = Declared()

    def validate(self) -> str | None:
        """Return the error in the options, None if there is none."""
        return "--start and --goal go together" if (self.start is None) != (self.goal is None) else None


class PreparedDive(NamedTuple):
    """The path of a dive's scenario file, and facts on the chart's bed for the report."""

    path: str
    facts: Facts = ()


def prepare_dive(
    world: str, options: DiveOptions, folder: str, progress: Progress = lambda share: None
) -> PreparedDive:
    """Write the scenario of a dive into `folder`.

    `world` is a chart (.000), another file that `uuv-hil world build` accepts, a world's .toml, or a world's name.
    Raises ConfigError, MissingExtraError, and MissionError if there is no free path.
    """
    if problem := options.validate():
        raise ConfigError(problem)
    if not world.endswith(".toml") and os.path.splitext(world)[1]:
        name = os.path.splitext(os.path.basename(world))[0]
        seabed = load_or_build_seabed(world, options.resolution, progress, options.declared, options.start)
        path = _prepare(name, f"{name}_world.toml", seabed.model.grid, seabed, options, folder)
        return PreparedDive(path, facts(seabed.model.grid, seabed.report))
    if options.resolution:
        raise ConfigError("--resolution is for charts and soundings: a world already has a grid; leave it out")
    known = load_world(world)
    where = os.path.abspath(world) if world.endswith(".toml") else world
    return PreparedDive(_prepare(known.name, where, grid_of(known), known, options, folder))


def _prepare(name: str, world: str, grid: Grid, source: WholeSeabed | World, options: DiveOptions, folder: str) -> str:
    """Write the scenario of the best site with a free path, in the world or on a part of the seabed `source`."""
    failure: MissionError | None = None
    for site in _requested_sites(grid, source.origin, options):
        if isinstance(source, WholeSeabed):
            part = cut_seabed(source.model, _around(site))
            notes = ("The part of a seabed around a dive.",)
            write_world(os.path.join(folder, world), part, source.source, source.origin, notes)
        path = _write_scenario(site, world, name, options, folder)
        try:
            prepare(load_scenario(path))
            return path
        except MissionError as error:
            failure = error
    assert failure is not None  # there is at least one site
    raise failure


def _requested_sites(grid: Grid, origin: tuple[float, float] | None, options: DiveOptions) -> Iterator[Site]:
    """Yield the requested path, or else the best ones found. Raises ConfigError."""
    if options.start is None or options.goal is None:
        yield from find_sites(grid, options.length, options.depth)
        return
    if origin is None:
        raise ConfigError(
            "--start and --goal are latitude and longitude, but this world has no `origin`: leave them out, or add "
            "an origin to the world"
        )
    plane = LocalPlane(*origin)
    start, goal = (_local(plane, place) for place in (options.start, options.goal))
    yield Site(start, goal, depth_between(grid, start, goal) if options.depth is None else options.depth)


def _local(plane: LocalPlane, position: Point) -> Point:
    north, east = plane.to_local(np.array(position[0]), np.array(position[1]))
    return float(north), float(east)


def _around(site: Site) -> Extent:
    (south, north), (west, east) = (sorted(pair) for pair in zip(site.start, site.goal, strict=True))
    return south - WORLD_MARGIN, north + WORLD_MARGIN, west - WORLD_MARGIN, east + WORLD_MARGIN


def _write_scenario(site: Site, world: str, name: str, options: DiveOptions, folder: str) -> str:
    (north, east), (to_north, to_east) = site.start, site.goal
    length = float(np.hypot(to_north - north, to_east - east))
    text = SCENARIO.format(
        name=name, description=f"A dive over the seabed of {name}", world=world, start=site.start, goal=site.goal,
        depth=site.depth, heading=atan2(to_east - east, to_north - north), listen=options.listen, speed=SPEED,
        limit=60.0 + 3.0 * length / SPEED,
    )  # fmt: skip
    path = os.path.join(folder, f"{name}.toml")
    write_file(path, text.encode())
    return path
