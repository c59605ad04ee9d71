"""Call services of a vehicle's slave: arm, reset, set its pose, let thrusters fail.

Each function calls a ROS 2 service of the slave (hil.slave.ros), waits for the response, and returns its text.
"""

from collections.abc import Mapping
from math import cos, sin
from typing import Any

from hil.client.parameters import set_parameter
from hil.client.vehicle_handle import Vehicle
from hil.common.errors import ConfigError, NetworkError
from hil.common.schema import nearest
from hil.network.services import call
from hil.ros import dialect
from hil.ros.encoders import swap_attitude, swap_world
from hil.ros.graph import plain_name
from sim.vehicle.failures import VALUES

SET_BOOL, TRIGGER, SET_STATE = (
    "std_srvs/srv/SetBool", "std_srvs/srv/Trigger", "simulation_interfaces/srv/SetEntityState",
)  # fmt: skip
KINDS = ("off", *VALUES, "repaired")


def arm(vehicle: Vehicle, on: bool = True) -> str:
    """Arm or disarm. A disarmed vehicle keeps its thrusters neutral and ignores commands. Raises NetworkError."""
    return _answer(_call(vehicle, "arm", SET_BOOL, {"data": on}))


def reset(vehicle: Vehicle) -> str:
    """Move the vehicle to its start, at rest, with sound thrusters. Raises NetworkError."""
    return _answer(_call(vehicle, "reset", TRIGGER, {}))


def fail_thruster(vehicle: Vehicle, thruster: str, kind: str = "off", value: float | None = None) -> str:
    """Replace a thruster's failures by this one; "repaired" ends them.

    `value` is the share of thrust for "efficiency", the pulse width (us) for "stuck" (default: the present one), the
    time (s) for "delayed", the standard deviation (share of thrust) for "noisy". Raises ConfigError, NetworkError.
    """
    if kind not in KINDS:
        raise ConfigError(f"kind: {kind!r} is none of {', '.join(KINDS)}{nearest(kind, list(KINDS))}")
    if value is not None and kind not in VALUES:
        raise ConfigError(f"value: {kind!r} has none; {', '.join(VALUES)} have one")
    text = "" if kind == "repaired" else f'kind = "{kind}"'
    if value is not None:
        text += f", {VALUES[kind]} = {value:g}"
    if reason := set_parameter(vehicle.client.session, vehicle.name, f"failures.{plain_name(thruster)}", text):
        raise ConfigError(f"{vehicle.name}: {reason}")
    return f"{thruster} is {kind}"


def set_pose(vehicle: Vehicle, north: float, east: float, depth: float, heading: float = 0.0) -> str:
    """Move the vehicle to a position (m, NED) and heading (rad), level and at rest. Raises NetworkError."""
    x, y, z = swap_world((north, east, depth))
    qw, qx, qy, qz = swap_attitude((cos(heading / 2), 0.0, 0.0, sin(heading / 2)))
    pose = {
        "position": {"x": x, "y": y, "z": z},
        "orientation": {"w": qw, "x": qx, "y": qy, "z": qz},
    }
    later = {"set_pose": True, "set_twist": True} if dialect.release() in dialect.LATER else {}
    response = _call(vehicle, "set_pose", SET_STATE, {"entity": vehicle.name, "state": {"pose": pose}, **later})
    result = response.get("result", {})
    if result.get("result") != 1:
        raise NetworkError(f"{vehicle.name}: set_pose: {result.get('error_message') or 'refused'}")
    return f"put at ({north:g}, {east:g}, {depth:g}) m"


def _call(vehicle: Vehicle, name: str, kind: str, request: Mapping[str, Any]) -> Mapping[str, Any]:
    return call(vehicle.client.session, f"/{vehicle.name}/{name}", kind, request)


def _answer(response: Mapping[str, Any]) -> str:
    if not response.get("success"):
        raise NetworkError(str(response.get("message") or "refused"))
    return str(response.get("message"))
