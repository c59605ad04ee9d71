"""Call services of a vehicle's slave: arm, reset, set its pose, let thrusters fail.

Each function calls a ROS 2 service of the slave (hil.slave.ros), waits for the response, and returns its text.
"""

from collections.abc import Collection, Mapping
from math import cos, sin
from typing import Any

from hil.client.vehicle_handle import Vehicle
from hil.common.errors import ConfigError, NetworkError
from hil.common.schema import nearest
from hil.network.services import call
from hil.network.session import Session
from hil.ros.encoders import swap_attitude, swap_world
from hil.ros.graph import plain_name
from sim.vehicle.failures import VALUES

SET_BOOL, TRIGGER, SET_STATE = (
    "std_srvs/srv/SetBool", "std_srvs/srv/Trigger", "simulation_interfaces/srv/SetEntityState",
)  # fmt: skip
FIELDS = {1: "bool_value", 2: "integer_value", 3: "double_value", 4: "string_value"}  # rcl_interfaces/ParameterType
BOOL, _, DOUBLE, STRING = FIELDS
AT_ONCE = 30  # parameters of one request
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


def read_parameters(session: Session, node: str, wanted: Collection[str] | None = None) -> dict[str, Any]:
    """Return the parameters of a vehicle by name: all, or those in `wanted`. Raises NetworkError."""
    listed = _call_parameters(session, node, "ListParameters", {"prefixes": [], "depth": 0})["result"]["names"]
    names = [name for name in listed if wanted is None or name in wanted]
    by_name: dict[str, Any] = {}
    for start in range(0, len(names), AT_ONCE):
        chunk = names[start : start + AT_ONCE]
        values = _call_parameters(session, node, "GetParameters", {"names": chunk})["values"]
        pairs = zip(chunk, values, strict=False)
        by_name |= {name: value[FIELDS[value["type"]]] for name, value in pairs if value["type"]}
    return by_name


def set_parameter(session: Session, node: str, name: str, value: Any) -> str:
    """Set a parameter of a vehicle; return why it is refused, "" if it is set. Raises ConfigError, NetworkError.

    Numbers are sent as floats, which all numbers of a slave are.
    """
    kind = BOOL if isinstance(value, bool) else DOUBLE if isinstance(value, (int, float)) else STRING
    if kind == STRING and not isinstance(value, str):
        raise ConfigError(f"{name}: expected a number or a text")
    typed = {"type": kind, FIELDS[kind]: float(value) if kind == DOUBLE else value}
    request = {"parameters": [{"name": name, "value": typed}]}
    result = _call_parameters(session, node, "SetParameters", request)["results"][0]
    return "" if result["successful"] else str(result["reason"])


def set_pose(vehicle: Vehicle, north: float, east: float, depth: float, heading: float = 0.0) -> str:
    """Move the vehicle to a position (m, NED) and heading (rad), level and at rest. Raises NetworkError."""
    x, y, z = swap_world((north, east, depth))
    qw, qx, qy, qz = swap_attitude((cos(heading / 2), 0.0, 0.0, sin(heading / 2)))
    pose = {
        "position": {"x": x, "y": y, "z": z},
        "orientation": {"w": qw, "x": qx, "y": qy, "z": qz},
    }
    response = _call(vehicle, "set_pose", SET_STATE, {"entity": vehicle.name, "state": {"pose": pose}})
    result = response.get("result", {})
    if result.get("result") != 1:
        raise NetworkError(f"{vehicle.name}: set_pose: {result.get('error_message') or 'refused'}")
    return f"put at ({north:g}, {east:g}, {depth:g}) m"


def _call_parameters(session: Session, node: str, kind: str, request: Mapping[str, Any]) -> Mapping[str, Any]:
    name = kind.replace("Parameters", "_parameters").lower()
    return call(session, f"/{node}/{name}", f"rcl_interfaces/srv/{kind}", request)


def _call(vehicle: Vehicle, name: str, kind: str, request: Mapping[str, Any]) -> Mapping[str, Any]:
    return call(vehicle.client.session, f"/{vehicle.name}/{name}", kind, request)


def _answer(response: Mapping[str, Any]) -> str:
    if not response.get("success"):
        raise NetworkError(str(response.get("message") or "refused"))
    return str(response.get("message"))
