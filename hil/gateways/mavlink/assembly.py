"""Settings of the gateway from a scenario: origin, camera, and parameters that suit the vehicle."""

import os
from math import degrees
from typing import Any

from hil.common.errors import ConfigError
from hil.gateways.mavlink.camera import CameraInfo, Stream
from hil.gateways.mavlink.snapshot import Origin
from hil.scenario.config import Scenario
from sim.environment.world import load_world
from sim.vehicle.thrusters.bank import wrench_matrix
from sim.vehicle.vehicle import load_vehicle

MAX_SHARE = 0.8  # of what the thrusters can do together, at full stick


def parameter_file(node: str) -> str:
    """Return where the parameters of a node are stored on this machine."""
    home = os.environ.get("XDG_STATE_HOME") or os.path.join(os.path.expanduser("~"), ".local", "state")
    return os.path.join(home, "uuv-hil", f"mavlink-{node}.toml")


def origin_of(scenario: Scenario | None) -> Origin | None:
    """Return the origin of the scenario's world, None if it has none. Raises ConfigError."""
    if scenario is None:
        return None
    world = load_world(scenario.world)
    return Origin(*world.origin, world.origin_altitude) if world.origin else None


def defaults_of(scenario: Scenario | None) -> dict[str, float]:
    """Return parameters that differ from one vehicle to the next: system id, forces, steering. Raises ConfigError."""
    if scenario is None:
        return {}
    vehicle, _ = load_vehicle(scenario.vehicle)
    defaults = {"NAV_STEER": float(bool(vehicle.fins))}
    if scenario.mavlink:
        defaults["SYSID_THISMAV"] = float(scenario.mavlink.system)
    rows = wrench_matrix(vehicle, torque=False)
    thrusts = [min(thruster.max_forward, thruster.max_reverse) for thruster in vehicle.thrusters]
    names = ("FORCE_X", "FORCE_Y", "FORCE_Z", "MOMENT_K", "MOMENT_M", "MOMENT_N")
    for name, row in zip(names, rows, strict=True):
        most = sum(abs(share) * thrust for share, thrust in zip(row, thrusts, strict=True))
        defaults[f"MAN_{name}"] = round(MAX_SHARE * most, 1)
    return defaults


def camera_of(scenario: Scenario | None, streams: tuple[Stream, ...], name: str = "camera") -> CameraInfo:
    """Return what is known of the camera called `name`, whose picture these `streams` have.

    Raises ConfigError for one that the scenario has not, unless it is the usual name.
    """
    fitted = scenario.sensors.get(name) if scenario else None
    if fitted is None or fitted.sensor.topic != "camera":
        if scenario and name != "camera":
            there = [each for each, spec in scenario.sensors.items() if spec.sensor.topic == "camera"]
            raise ConfigError(f"mavlink: camera: no camera {name!r}; there are: {', '.join(there) or 'none'}")
        return CameraInfo(streams)
    model: Any = fitted.model
    return CameraInfo(streams, model.width, model.height, model.rate, degrees(model.field_of_view))
