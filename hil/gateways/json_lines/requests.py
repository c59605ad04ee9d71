"""Parse, check and call a request in JSON, and encode samples as JSON.

A picture, or a map, is bytes: they are text in base64, row after row.
"""

import json
from base64 import b64encode
from collections.abc import Callable, Mapping
from inspect import Parameter, signature
from itertools import pairwise
from math import hypot
from operator import sub
from typing import Any

from hil.client import services
from hil.client.action import Action
from hil.client.client import Stamped
from hil.client.vehicle_handle import Vehicle
from hil.common.errors import ConfigError
from hil.common.schema import nearest
from hil.common.text import json_text
from hil.ros.commands import MAX_FORCE, MAX_PLACE

COMMANDS = ("drive", "hold_depth", "hold_heading", "go_to", "follow", "push", "thrust", "stop", "release")
SERVICES: dict[str, Callable[..., str]] = {
    "arm": services.arm, "reset": services.reset, "set_pose": services.set_pose, "fail": services.fail_thruster
}  # fmt: skip
MOVED = ("reset", "set_pose")  # which end the command before
LONGEST_ECHO = 60  # characters of a refused value in an error
LONGEST_WAY = 1e4  # m: 5 s to plan, in which nobody sees that the connection has ended
MAX_NUMBER = max(MAX_PLACE, MAX_FORCE)  # in any unit: a larger number is an error
STATE_EXTRAS = ("depth", "heading", "roll", "pitch", "speed")
TYPES = {"smooth": bool, "on": bool, "thruster": str, "kind": str}  # of arguments; others are numbers, or arrays

Request = dict[str, Any]


class NotJsonError(ConfigError):
    """A line that is not JSON: the client speaks another protocol, such as HTTP."""


def read_request(line: bytes) -> Request:
    """Return the request of a line. Raises NotJsonError, ConfigError."""
    try:
        request = json.loads(line)
    except (ValueError, RecursionError):
        raise NotJsonError(f"not a line of JSON: {line[:LONGEST_ECHO].decode(errors='replace')!r}") from None
    if not isinstance(request, dict):
        raise ConfigError('a request is an object, like {"do": "vehicles"}')
    if isinstance(request.get("id"), (dict, list)):
        raise ConfigError("id: expected a text or a number")
    return request


def sensor_of(request: Request) -> str:
    """Return the topic that a request names."""
    sensor = str(request.get("sensor", "state"))
    return {"state": "odom"}.get(sensor, sensor)


def call(vehicle: Vehicle, what: str, arguments: Request) -> Action | None:
    """Call one of COMMANDS with checked arguments. Raises HilError."""
    method = getattr(vehicle, what)
    if what == "thrust":
        newtons = arguments.pop("newtons", [])
        _refuse(vehicle, what, arguments, [])
        return vehicle.thrust(*_array("newtons", newtons))
    parameters = {name: each for name, each in signature(method).parameters.items() if name != "limits"}
    _refuse(vehicle, what, arguments, list(parameters))
    if what == "follow":
        path = _points(arguments.pop("path", []))
        others = {name: _argument(name, value) for name, value in arguments.items()}
        if not others.get("lookahead") and _length([vehicle.state.position, *path]) > LONGEST_WAY:
            raise ConfigError(
                f"path: longer than {LONGEST_WAY:g} m; send its parts one after the other, or a lookahead"
            )
        return vehicle.follow(path, **others)
    action: Action | None = method(**_checked(vehicle, what, parameters, arguments))
    return action


def serve(vehicle: Vehicle, what: str, arguments: Request) -> str:
    """Call one of SERVICES with checked arguments; what was done. Raises HilError.

    Refused while another master commands, but for the disarming of a vehicle. One that is moved ends what it does.
    """
    service = SERVICES[what]
    parameters = dict(list(signature(service).parameters.items())[1:])
    checked = _checked(vehicle, what, parameters, arguments)
    if checked.get("on", True):
        vehicle.client.require_acceptance(vehicle.client.refusal)
    done = service(vehicle, **checked)
    if what in MOVED:
        vehicle.release()
    return done


def _checked(vehicle: Vehicle, what: str, parameters: Mapping[str, Parameter], arguments: Request) -> Request:
    """Return arguments of the right types by the names that there are; none without a default is missing."""
    _refuse(vehicle, what, arguments, list(parameters))
    missing = [name for name, each in parameters.items() if each.default is each.empty and name not in arguments]
    if missing:
        raise ConfigError(f"{vehicle.name}: {what} also needs {', '.join(missing)}")
    return {name: _argument(name, value) for name, value in arguments.items()}


def _refuse(vehicle: Vehicle, what: str, arguments: Request, names: list[str]) -> None:
    for name in arguments:
        if name not in names:
            raise ConfigError(f"{vehicle.name}: {what} has no {name!r}{nearest(name, names)}")


def _argument(name: str, value: Any) -> Any:
    kind = TYPES.get(name, float)
    if kind is not float:
        if not isinstance(value, kind):
            expected = "true or false" if kind is bool else "a text"
            raise ConfigError(f"{name}: {show(value)}: expected {expected}")
        return value
    if not is_number(value):
        raise ConfigError(f"{name}: {show(value)} is not a number from -{MAX_NUMBER:g} to {MAX_NUMBER:g}")
    return float(value)


def _array(name: str, values: Any) -> list[float]:
    """Return a row of numbers; MATLAB writes a single one without brackets."""
    values = values if isinstance(values, list) else [values]
    return [_argument(f"{name}[{number}]", value) for number, value in enumerate(values)]


def _points(path: Any) -> list[Any]:
    """Return the points of three numbers; MATLAB writes a single one without the outer brackets."""
    if isinstance(path, list) and path and not isinstance(path[0], list):
        path = [path]
    if not isinstance(path, list) or not path:
        raise ConfigError("path: expected an array of points [north, east, depth]")
    return [tuple(_array("path", point)) for point in path]


def _length(path: list[Any]) -> float:
    return sum(hypot(*map(sub, a, b)) for a, b in pairwise(path))


def is_number(value: Any) -> bool:
    """Return whether it is a number within ±MAX_NUMBER."""
    return isinstance(value, (int, float)) and not isinstance(value, bool) and abs(value) <= MAX_NUMBER


def show(value: Any) -> str:
    """Return the beginning of a value, for a message."""
    return f"{value!r:.{LONGEST_ECHO}}"


def encode(message: Request) -> bytes:
    """Return the line of a message."""
    return json_text(message).encode() + b"\n"


def describe(sample: Any) -> Request:
    """Return the age and the values of a sample."""
    if isinstance(sample, Stamped):  # no record: the figures of health, and messages
        value = sample.value
        return {"age": sample.age_s, "sample": value if isinstance(value, dict) else value.as_dict()}
    values = {name: b64encode(x).decode() if isinstance(x, bytes) else x for name, x in sample._asdict().items()}
    values |= {name: getattr(sample, name) for name in STATE_EXTRAS if hasattr(sample, name)}
    return {"age": sample.age, "sample": values}
