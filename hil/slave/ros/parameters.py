"""Offer thruster failures and gains as ROS 2 parameters of the vehicle's node, for `ros2 param` and similar tools.

Each gain of the cascade (`[control]` of a vehicle file) is a number parameter "gains.LOOP.KEY":

    ros2 param set /uuv1 gains.surge.p 3.0

A new value applies from the next step until the slave ends; integrals stay as they are. A limit that the vehicle file
leaves open (such as `slew`) has no parameter, and neither have other control laws.

Each thruster has a text parameter "failures.NAME". It is empty for a sound thruster, else it has the keys of
[[failure]] tables of a scenario (sim.vehicle.failures.Failure) without thruster and time, separated by ";". Quotes may
be left out:

    ros2 param set /uuv1 failures.bow 'kind = "efficiency", efficiency = 0.5; kind = "delayed", delay = "100 ms"'
    ros2 param set /uuv1 failures.bow 'kind = off'
    ros2 param set /uuv1 failures.bow '""'

A tethered vehicle has "tether.length", the length (m) for the winch to pay out, and "tether.tension", the tension (N)
at the vehicle, which is read-only.

A new value replaces the thruster's failures at once. A value that is read gives the present failures, whether set by a
parameter, the thruster's service or the scenario. The services are those of rclcpp's nodes; invalid values are refused
with a reason. Changes by a parameter request are published on /parameter_events; those by a service or scenario are
not.
"""

from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import suppress
from math import isfinite
from typing import TYPE_CHECKING, Any

from hil.autonomy.control.controller import CascadedController
from hil.common.clock import now_ns
from hil.common.errors import ConfigError
from hil.common.schema import nearest, parse
from hil.network.services import Answer
from hil.ros.message import Message, encode, header
from hil.slave.loop import Loop
from sim.vehicle.failures import Failure

if TYPE_CHECKING:
    from sim.tether import Tether

EVENTS = "/parameter_events"
PREFIX = "failures"
LONGEST = 200  # characters of a value; it is parsed between two steps of the loop
MAX = 32  # parameters in one request; a vehicle has one for each thruster
GAINS = "gains"
TETHER, TENSION = "tether.length", "tether.tension"
_NOT_SET, _DOUBLE, _STRING = 0, 3, 4  # constants of rcl_interfaces/ParameterType
_RECURSIVE = 0  # ListParameters: depth without limit
_GIVEN = ("thruster", "time")  # keys that the parameter itself sets
_EXAMPLE = 'kind = "efficiency", efficiency = 0.5'


class _Gains:
    """The gains of a running loop's cascade."""

    type, expected = _DOUBLE, "a number with a decimal point, such as 1.0"

    def __init__(self, loop: Loop) -> None:
        self._loop = loop

    def names(self) -> list[str]:
        controller = self._controller()
        rows = controller.gains._asdict().items() if controller else ()
        return [f"{GAINS}.{axis}.{key}" for axis, row in rows for key in _finite(row)]

    def value(self, name: str) -> dict[str, Any]:
        _, axis, key = name.split(".")
        return {"double_value": float(_finite(self._row(axis))[key])}

    def descriptor(self, name: str) -> dict[str, Any]:
        _, axis, key = name.split(".")
        return {"description": f"{key} of the controller's loop {axis}"}

    def read(self, name: str, value: Message) -> float:
        _, axis, key = name.split(".")
        row, wanted = self._row(axis), float(value["double_value"])
        parse({**_finite(row), key: wanted}, type(row), f"{GAINS}.{axis}")
        return wanted

    def apply(self, name: str, change: float) -> str:
        _, axis, key = name.split(".")
        controller = self._controller()
        assert controller
        row = self._row(axis)._replace(**{key: change})
        controller.set_gains(controller.gains._replace(**{axis: row}))
        return f"{change:g}"

    def _row(self, axis: str) -> Any:
        controller = self._controller()
        assert controller
        return getattr(controller.gains, axis)

    def _controller(self) -> CascadedController | None:
        pilot = self._loop.source.pilot
        controller = pilot.controller if pilot else None
        return controller if isinstance(controller, CascadedController) else None


def _finite(row: Any) -> dict[str, float]:
    """Return the finite gains of a loop; limits that are open are inf."""
    return {key: value for key, value in row._asdict().items() if isfinite(value)}


class _TetherState:
    """The paid-out length of a tether, and its tension."""

    type, expected = _DOUBLE, "a number like 20.0"

    def __init__(self, tether: "Tether") -> None:
        self._tether = tether

    def names(self) -> tuple[str, ...]:
        return TETHER, TENSION

    def value(self, name: str) -> dict[str, Any]:
        return {"double_value": self._tether.length if name == TETHER else self._tether.tension}

    def descriptor(self, name: str) -> dict[str, Any]:
        what = "m that are paid out" if name == TETHER else "N of pull at the vehicle"
        return {"description": what, "read_only": name == TENSION}

    def read(self, name: str, value: Message) -> float:
        if name == TENSION:
            raise ConfigError(f"{name}: it is measured")
        self._tether.keys.require_length(value["double_value"])
        return float(value["double_value"])

    def apply(self, name: str, change: float) -> str:
        self._tether.set_length(change)
        return f"{change:g} m"


class _Failures:
    """The failures of thrusters; `thrusters` maps the last part of a parameter's name to the thruster."""

    type, expected = _STRING, f"a text, such as {_EXAMPLE}"

    def __init__(self, loop: Loop, thrusters: Mapping[str, str]) -> None:
        self._loop = loop
        self._thrusters = {f"{PREFIX}.{name}": thruster for name, thruster in thrusters.items()}

    def names(self) -> Collection[str]:
        return self._thrusters

    def value(self, name: str) -> dict[str, Any]:
        return {"string_value": failures_text(self._loop.simulation.failures(self._thrusters[name]))}

    def descriptor(self, name: str) -> dict[str, Any]:
        return {
            "description": f"what is wrong with the thruster {self._thrusters[name]!r}",
            "additional_constraints": f"empty, or the keys of a [[failure]]: {_EXAMPLE}; several are divided by ;",
        }

    def read(self, name: str, value: Message) -> list[Failure]:
        return read_failures(value["string_value"], self._thrusters[name], name)

    def apply(self, name: str, change: Sequence[Failure]) -> str:
        self._loop.fail(Failure(self._thrusters[name], "repaired"), *change)
        return str(self.value(name)["string_value"]) or "nothing is wrong"


# Parameters of one `type` (rcl_interfaces/ParameterType); `expected` describes a value in error messages. `value` and
# `descriptor` return a ParameterValue and a ParameterDescriptor without type and name. `read` checks a value of the
# right type and returns the argument for `apply`, which returns a text for the log.
_Group = _Failures | _Gains | _TetherState


class Parameters:
    """The parameters of a running loop's vehicle, whose node is called `node`.

    `thrusters` maps the last part of a failure parameter's name to the thruster.
    """

    def __init__(self, loop: Loop, node: str, thrusters: Mapping[str, str], report: Callable[[str], None]) -> None:
        self._loop = loop
        self._node = node
        self._report = report
        tether = loop.simulation.tether
        self._groups: list[_Group] = [_Failures(loop, thrusters), _Gains(loop)]
        if tether:
            self._groups.append(_TetherState(tether))

    def services(self) -> dict[str, tuple[str, Answer]]:
        """Return name, below the node's, of each service, with its type and answer."""
        answers: dict[str, tuple[str, Answer]] = {
            "list_parameters": ("ListParameters", self._list),
            "get_parameters": ("GetParameters", lambda request: {"values": self._each(request, self._value)}),
            "get_parameter_types": ("GetParameterTypes", lambda request: {"types": self._each(request, self._type)}),
            "describe_parameters": (
                "DescribeParameters",
                lambda request: {"descriptors": self._each(request, self._descriptor)},
            ),
            "set_parameters": (
                "SetParameters",
                lambda request: {"results": [self._set([one]) for one in request["parameters"][:MAX]]},
            ),
            "set_parameters_atomically": (
                "SetParametersAtomically",
                lambda request: {"result": self._set(request["parameters"])},
            ),
        }
        return {name: (f"rcl_interfaces/srv/{kind}", answer) for name, (kind, answer) in answers.items()}

    def _list(self, request: Message) -> dict[str, Any]:
        """List parameters as rclcpp does: `depth` counts the parts of a name after the prefix."""
        prefixes, depth = request["prefixes"][:MAX], request["depth"]
        names = [name for name in self._names() if _is_below(name, prefixes, depth)]
        parents = dict.fromkeys([name.rpartition(".")[0] for name in names])
        return {"result": {"names": names, "prefixes": list(parents)}}

    def _names(self) -> list[str]:
        return [name for group in self._groups for name in group.names()]

    def _group(self, name: str) -> _Group | None:
        """Return the group of a parameter; None if the name is unknown."""
        return next((group for group in self._groups if name in group.names()), None)

    def _each(self, request: Message, function: Callable[[str], Any]) -> list[Any]:
        return [function(name) for name in request["names"][:MAX]]

    def _value(self, name: str) -> dict[str, Any]:
        """Return a ParameterValue; one of type "not set" for an unknown name."""
        group = self._group(name)
        return {"type": group.type, **group.value(name)} if group else {}

    def _type(self, name: str) -> int:
        group = self._group(name)
        return group.type if group else _NOT_SET

    def _descriptor(self, name: str) -> dict[str, Any]:
        group = self._group(name)
        return {"name": name, "type": group.type, **group.descriptor(name)} if group else {"name": name}

    def _set(self, parameters: Sequence[Message]) -> dict[str, Any]:
        """Set all parameters, or none if one is invalid; return a SetParametersResult."""
        try:
            if len(parameters) > MAX:
                raise ConfigError(f"{len(parameters)} parameters at once, at most {MAX}")
            wanted = [(parameter["name"], *self._read(**parameter)) for parameter in parameters]
        except ConfigError as error:
            return {"successful": False, "reason": str(error)}
        for name, group, change in wanted:
            self._report(f"parameter: {name}: {group.apply(name, change)}")
        self._publish_event([name for name, *_ in wanted])
        return {"successful": True}

    def _publish_event(self, names: Sequence[str]) -> None:
        """Publish rcl_interfaces/ParameterEvent of the parameters that were set, with their present values."""
        now = self._loop.sample_publisher.stamps.wall_ns(now_ns())
        changed = [{"name": name, "value": self._value(name)} for name in names]
        event = {"stamp": header(now)["stamp"], "node": f"/{self._node}", "changed_parameters": changed}
        self._loop.sample_publisher.publish(EVENTS, encode("rcl_interfaces/msg/ParameterEvent", event))

    def _read(self, name: str, value: Message) -> tuple[_Group, Any]:
        """Return the group of a parameter and the argument for its `apply`. Raises ConfigError."""
        group = self._group(name)
        if group is None:
            raise ConfigError(f"no parameter {name!r}{nearest(name[:LONGEST], self._names())}")
        if value["type"] != group.type:
            raise ConfigError(f"{name}: expected {group.expected}")
        return group, group.read(name, value)


def read_failures(text: str, thruster: str, where: str) -> list[Failure]:
    """Return the failures in a parameter's text; `where` begins each error message. Raises ConfigError."""
    if len(text) > LONGEST:
        raise ConfigError(f"{where}: {len(text)} characters, at most {LONGEST}")
    return [_read_failure(part, thruster, where) for part in text.split(";") if part.strip()]


def failures_text(failures: Sequence[Failure]) -> str:
    """Return the failures of one thruster as text, which `read_failures` can read."""
    return "; ".join([_failure_text(failure) for failure in failures])


def _read_failure(text: str, thruster: str, where: str) -> Failure:
    table: dict[str, Any] = {}
    for pair in text.split(","):
        key, equals, value = map(str.strip, pair.partition("="))
        if not (key and equals and value):
            raise ConfigError(f"{where}: {pair.strip()!r} is not KEY = VALUE; write it as {_EXAMPLE}")
        if key in _GIVEN or key in table:
            raise ConfigError(f"{where}: key {key!r} {'is given twice' if key in table else 'is not for parameters'}")
        table[key] = _read_value(value)
    return parse({**table, "thruster": thruster}, Failure, where)


def _read_value(text: str) -> str | float:
    """Return the value as a number, or as a text without quotes.

    The TOML parser is not used, as its import would delay the loop.
    """
    for kind in (int, float):
        with suppress(ValueError):
            return kind(text)
    return text.strip('"')


def _failure_text(failure: Failure) -> str:
    words = [f'kind = "{failure.kind}"']
    for key, default in Failure._field_defaults.items():
        value = getattr(failure, key)
        if key not in _GIVEN and value != default:
            words.append(f"{key} = {value!r}")
    return ", ".join(words)


def _is_below(name: str, prefixes: Sequence[str], depth: int) -> bool:
    """Return whether a parameter is below one of the prefixes (none: all), at most `depth` parts deep."""
    if not prefixes:
        return depth == _RECURSIVE or name.count(".") < depth
    for prefix in prefixes:
        rest = name.removeprefix(f"{prefix}.")
        if name == prefix or (rest != name and (depth == _RECURSIVE or rest.count(".") < depth)):
            return True
    return False
