"""Actions that a person may start from the view: services of the slave, and poses to go to."""

from collections.abc import Mapping, Sequence
from math import cos, sin
from typing import Any

from hil.client.vehicle_handle import Vehicle
from hil.common.errors import NetworkError
from hil.network.services import call
from hil.ros.encoders import swap_attitude, swap_world

SET_BOOL, TRIGGER, SET_STATE = (
    "std_srvs/srv/SetBool", "std_srvs/srv/Trigger", "simulation_interfaces/srv/SetEntityState"
)  # fmt: skip


def arm(vehicle: Vehicle, on: bool) -> str:
    """Arm or disarm; disarmed, thrusters are neutral and every command is refused. Raises NetworkError."""
    return _answer(_call(vehicle, "arm", SET_BOOL, {"data": on}))


def reset(vehicle: Vehicle) -> str:
    """Put the vehicle back to its start. Raises NetworkError."""
    return _answer(_call(vehicle, "reset", TRIGGER, {}))


def fail_thruster(vehicle: Vehicle, name: str, failing: bool) -> str:
    """Let a thruster give no output, or repair it. Raises NetworkError."""
    return _answer(_call(vehicle, f"thrusters/{name}/fail", SET_BOOL, {"data": failing}))


def set_pose(vehicle: Vehicle, position: Sequence[float], heading: float) -> str:
    """Put the vehicle at a place (m, NED) with a heading (rad), at rest. Raises NetworkError."""
    x, y, z = swap_world(position)
    qw, qx, qy, qz = swap_attitude((cos(heading / 2), 0.0, 0.0, sin(heading / 2)))
    pose = {
        "position": {"x": x, "y": y, "z": z},
        "orientation": {"w": qw, "x": qx, "y": qy, "z": qz},
    }
    response = _call(vehicle, "set_pose", SET_STATE, {"entity": vehicle.name, "state": {"pose": pose}})
    result = response.get("result", {})
    if result.get("result") != 1:
        raise NetworkError(f"{vehicle.name}: set_pose: {result.get('error_message') or 'refused'}")
    return f"put at ({position[0]:g}, {position[1]:g}, {position[2]:g}) m"


def unavailable_reason(vehicle: Vehicle | None, present: bool) -> str:
    """Return why a vehicle would not obey now, and the remedy; "" if it would as far as is known."""
    if vehicle is None:
        return "this view only observes"
    if not present:
        return f"{vehicle.name} is not there"
    return vehicle.client.unavailable_reason()


def _call(vehicle: Vehicle, name: str, kind: str, request: Mapping[str, Any]) -> Mapping[str, Any]:
    return call(vehicle.client.session, f"/{vehicle.name}/{name}", kind, request)


def _answer(response: Mapping[str, Any]) -> str:
    if not response.get("success"):
        raise NetworkError(str(response.get("message") or "refused"))
    return str(response.get("message"))
