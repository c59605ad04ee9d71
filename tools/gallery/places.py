"""Worlds and poses of the gallery's pictures, and the record of one of its entries."""

from collections.abc import Callable
from math import radians
from typing import Any, NamedTuple

from matplotlib.figure import Figure

from sim.dynamics import State
from sim.environment.obstacles import Box, Cylinder
from sim.environment.world import World, load_world
from sim.rotations import from_euler
from sim.simulation import Simulation
from sim.vehicle.vehicle import load_vehicle

VEHICLE, _ = load_vehicle("bluerov2_heavy")
INK, MARK = "#1f2937", "#b45309"
ECHO = "copper"  # colour map of echo strength
SEED = 1


class Entry(NamedTuple):
    """A sensor of the gallery: its name in a scenario, and its pictures. The docstring of a picture is its caption."""

    sensor: str
    title: str
    pictures: tuple[Callable[[Figure], None], ...] = ()
    size: tuple[float, float] = (8.0, 4.0)  # of the first picture, in inches; `heights` has the heights of the others
    heights: tuple[float, ...] = ()


def harbour() -> World:
    """Return the installed world `harbour`: a basin with quays and piers on piles."""
    return load_world("harbour")


def rough_ground() -> World:
    """Return the installed world `fractal` with a wall, a block and a bollard on its seabed."""
    world = load_world("fractal")
    wall = Box(-12.0, -26.0, 10.0, 1.5, 0.25, top=world.seabed(-12.0, -26.0) - 2.0)
    block = Box(8.0, 24.0, 4.0, 7.0, 0.5, top=world.seabed(8.0, 24.0) - 2.5)
    bollard = Cylinder(14.0, -18.0, 1.0, top=world.seabed(14.0, -18.0) - 4.0)
    return world._replace(box=(wall, block), cylinder=(bollard,))


def make_simulation(world: World) -> Simulation:
    """Return a simulation of the world for sensors that are sampled one by one."""
    return Simulation(VEHICLE, world, {}, position=(30.0, 0.0, 2.0), seed=SEED)


def at(north: float, east: float, depth: float, heading: float = 0.0, pitch: float = 0.0) -> State:
    """Return a state at rest: position in m, heading and pitch in degrees."""
    return State((north, east, depth), from_euler(0.0, radians(pitch), radians(heading)))


def set_axes_ahead_up(axes: Any, reach: float) -> None:
    """Set up axes in m, up to `reach`: ahead is up, starboard is right, the vehicle is in the middle."""
    axes.set(aspect="equal", xlim=(-reach, reach), ylim=(-reach, reach))
    axes.set(xlabel="to starboard, m", ylabel="ahead, m")
    axes.plot(0.0, 0.0, "^", color=MARK, markersize=7)
