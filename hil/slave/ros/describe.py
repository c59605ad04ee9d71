"""Make one message that describes the vehicle or its world: the program that hil.slave.ros.descriptions starts.

    python -m hil.slave.ros.describe NAME

Reads the scenario from standard input, writes the message to standard output, and ends. It is a separate process, so
that the loop does not wait for it and does not keep the modules that it loads.
"""

import os
import pickle
import sys
from collections.abc import Callable

from hil.common.clock import now_ns, to_wall_ns
from hil.common.errors import HilError, MissingExtraError
from hil.common.lifeline import die_with_parent
from hil.scenario.config import Scenario
from sim.environment.world import load_world
from sim.vehicle.vehicle import load_vehicle

NICE = 10
IN, OUT, ERRORS = 0, 1, 2


def main() -> int:
    """Write the message that the command line names; return the exit code."""
    die_with_parent()
    os.nice(NICE)
    output = os.dup(OUT)
    os.dup2(ERRORS, OUT)  # so that a library that prints does not write into the message
    with open(IN, "rb") as setup:
        scenario = pickle.load(setup)
    try:
        payload = MAKERS[sys.argv[1]](scenario)
    except HilError as error:
        print(error, file=sys.stderr)
        return error.exit_code
    with open(output, "wb") as file:
        file.write(payload)
    return 0


def robot_description(scenario: Scenario) -> bytes:
    """Encode std_msgs/String: the vehicle as URDF."""
    from hil.ros.message import encode
    from sim.vehicle.urdf.writer import urdf_of

    text = urdf_of(load_vehicle(scenario.vehicle)[0], scenario.ros.frame_prefix)
    return encode("std_msgs/msg/String", {"data": text})


def known_map(scenario: Scenario) -> bytes:
    """Encode nav_msgs/OccupancyGrid: the initial map of this scenario's planner."""
    try:
        from hil.scenario import world_map
    except ImportError:
        raise MissingExtraError("the map needs numpy where the slave runs: pip install 'uuv-hil[master]'") from None
    from hil.ros.world import GridMap, encode_map

    master, world = scenario.master, load_world(scenario.world)
    part = world_map.parts_of(world, master, scenario.start)[0]
    grid = world_map.known_map(master, load_vehicle(scenario.vehicle)[0], world, part)
    cells = grid.cells.astype("u1")
    south, west = grid.origin
    return encode_map(to_wall_ns(now_ns()), GridMap(cells.tobytes(), cells.shape[1], grid.resolution, south, west))


def obstacles(scenario: Scenario) -> bytes:
    """Encode visualization_msgs/MarkerArray: the obstacles of the world."""
    from hil.ros.world import encode_obstacles

    return encode_obstacles(to_wall_ns(now_ns()), load_world(scenario.world))


MAKERS: dict[str, Callable[[Scenario], bytes]] = {
    "robot_description": robot_description,
    "map": known_map,
    "obstacles": obstacles,
}

if __name__ == "__main__":
    sys.exit(main())
