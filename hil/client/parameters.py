"""Parameters of a vehicle's slave: list, read and set them by ROS 2's services."""

from collections.abc import Collection, Mapping
from typing import Any

from hil.common.errors import ConfigError
from hil.network.services import call
from hil.network.session import Session
from hil.ros.message import decode
from hil.ros.topics import TOPICS

FIELDS = {1: "bool_value", 2: "integer_value", 3: "double_value", 4: "string_value"}  # rcl_interfaces/ParameterType
BOOL, _, DOUBLE, STRING = FIELDS
AT_ONCE = 30  # parameters of one request


def read_parameters(session: Session, node: str, wanted: Collection[str] | None = None) -> dict[str, Any]:
    """Return the parameters of a vehicle by name: all, or those in `wanted`. Raises NetworkError."""
    listed = _call(session, node, "ListParameters", {"prefixes": [], "depth": 0})["result"]["names"]
    names = [name for name in listed if wanted is None or name in wanted]
    by_name: dict[str, Any] = {}
    for start in range(0, len(names), AT_ONCE):
        chunk = names[start : start + AT_ONCE]
        values = _call(session, node, "GetParameters", {"names": chunk})["values"]
        pairs = zip(chunk, values, strict=False)
        by_name |= {name: value[FIELDS[value["type"]]] for name, value in pairs if value["type"]}
    return by_name


def changed_parameters(event: bytes) -> dict[str, Any]:
    """Return the new values in a message of /parameter_events, by names such as "/uuv1/gains.surge.p"."""
    message = decode(TOPICS["/parameter_events"].type, event) or {"changed_parameters": []}
    rows = [(row["name"], row["value"]) for row in message["changed_parameters"] if row["value"]["type"] in FIELDS]
    return {f"{message['node']}/{name}": value[FIELDS[value["type"]]] for name, value in rows}


def set_parameter(session: Session, node: str, name: str, value: Any) -> str:
    """Set a parameter of a vehicle; return why it is refused, "" if it is set. Raises ConfigError, NetworkError.

    Numbers are sent as floats, which all numbers of a slave are.
    """
    kind = BOOL if isinstance(value, bool) else DOUBLE if isinstance(value, (int, float)) else STRING
    if kind == STRING and not isinstance(value, str):
        raise ConfigError(f"{name}: expected a number or a text")
    typed = {"type": kind, FIELDS[kind]: float(value) if kind == DOUBLE else value}
    request = {"parameters": [{"name": name, "value": typed}]}
    result = _call(session, node, "SetParameters", request)["results"][0]
    return "" if result["successful"] else str(result["reason"])


def _call(session: Session, node: str, kind: str, request: Mapping[str, Any]) -> Mapping[str, Any]:
    name = kind.replace("Parameters", "_parameters").lower()
    return call(session, f"/{node}/{name}", f"rcl_interfaces/srv/{kind}", request)
