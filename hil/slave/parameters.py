"""Offer thruster failures as ROS 2 parameters of the vehicle's node, for `ros2 param` and similar tools.

Each thruster has one, "failures.NAME". It is a text: empty while nothing is wrong, else the keys of a [[failure]] of a
scenario (sim.vehicle.failures.Failure) without its thruster and time, with ; between several. Quotes may be left out:

    ros2 param set /uuv1 failures.bow 'kind = "efficiency", efficiency = 0.5; kind = "delayed", delay = "100 ms"'
    ros2 param set /uuv1 failures.bow 'kind = off'
    ros2 param set /uuv1 failures.bow '""'

What is set replaces what was wrong before, at once. What is read is what is wrong now, whoever said so: a parameter,
the thruster's service, a scenario. The services are those of rclcpp's nodes; values that cannot be are refused with the
reason. Not there: the topic /parameter_events.
"""

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from typing import Any

from hil.common.errors import ConfigError
from hil.common.schema import nearest, parse
from hil.network.services import Answer
from hil.ros.message import Message
from hil.slave.loop import Loop
from sim.vehicle.failures import Failure

PREFIX = "failures"
LONGEST = 200  # characters of a value, which is parsed between two steps
MOST = 32  # parameters that one request is answered for; a vehicle has a thruster for each
_NOT_SET, _STRING = 0, 4  # constants of rcl_interfaces/ParameterType
_RECURSIVE = 0  # of ListParameters
_GIVEN = ("thruster", "time")  # keys that the parameter stands for
_EXAMPLE = 'kind = "efficiency", efficiency = 0.5'


class Parameters:
    """The parameters of a running loop's vehicle; `thrusters` are its thrusters by the last part of their names."""

    def __init__(self, loop: Loop, thrusters: Mapping[str, str], report: Callable[[str], None]) -> None:
        self._loop = loop
        self._thrusters = {f"{PREFIX}.{name}": thruster for name, thruster in thrusters.items()}
        self._report = report

    def services(self) -> dict[str, tuple[str, Answer]]:
        """Type and answer of each service, by its name below the node's."""
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
                lambda request: {"results": [self._set([one]) for one in request["parameters"][:MOST]]},
            ),
            "set_parameters_atomically": (
                "SetParametersAtomically",
                lambda request: {"result": self._set(request["parameters"])},
            ),
        }
        return {name: (f"rcl_interfaces/srv/{kind}", answer) for name, (kind, answer) in answers.items()}

    def _list(self, request: Message) -> dict[str, Any]:
        """As rclcpp does: a depth counts the parts of a name behind the prefix."""
        prefixes, depth = request["prefixes"][:MOST], request["depth"]
        names = [name for name in self._thrusters if _is_below(name, prefixes, depth)]
        return {"result": {"names": names, "prefixes": [PREFIX] if names else []}}

    def _each(self, request: Message, answer: Callable[[str], Any]) -> list[Any]:
        return [answer(name) for name in request["names"][:MOST]]

    def _value(self, name: str) -> dict[str, Any]:
        """Return a ParameterValue, which is not set for a name that is none."""
        if name not in self._thrusters:
            return {}
        return {"type": _STRING, "string_value": failures_text(self._loop.simulation.failures(self._thrusters[name]))}

    def _type(self, name: str) -> int:
        return _STRING if name in self._thrusters else _NOT_SET

    def _descriptor(self, name: str) -> dict[str, Any]:
        if name not in self._thrusters:
            return {"name": name}
        return {
            "name": name,
            "type": _STRING,
            "description": f"what is wrong with the thruster {self._thrusters[name]!r}",
            "additional_constraints": f"empty, or the keys of a [[failure]]: {_EXAMPLE}; several are divided by ;",
        }

    def _set(self, parameters: Sequence[Message]) -> dict[str, Any]:
        """Set all of them or, where one cannot be, none; a SetParametersResult."""
        try:
            if len(parameters) > MOST:
                raise ConfigError(f"{len(parameters)} parameters at once, at most {MOST}")
            wanted = [(parameter["name"], self._read(**parameter)) for parameter in parameters]
        except ConfigError as error:
            return {"successful": False, "reason": str(error)}
        for name, failures in wanted:
            self._loop.fail(Failure(self._thrusters[name], "repaired"), *failures)
            now = failures_text(self._loop.simulation.failures(self._thrusters[name]))
            self._report(f"parameter: {name}: {now or 'nothing is wrong'}")
        return {"successful": True}

    def _read(self, name: str, value: Message) -> list[Failure]:
        if name not in self._thrusters:
            raise ConfigError(f"no parameter {name!r}{nearest(name[:LONGEST], list(self._thrusters))}")
        if value["type"] != _STRING:
            raise ConfigError(f"{name}: expected a text, such as {_EXAMPLE}")
        return read_failures(value["string_value"], self._thrusters[name], name)


def read_failures(text: str, thruster: str, where: str) -> list[Failure]:
    """Return the failures in a parameter's text; `where` opens every error message. Raises ConfigError."""
    if len(text) > LONGEST:
        raise ConfigError(f"{where}: {len(text)} characters, at most {LONGEST}")
    return [_read_failure(part, thruster, where) for part in text.split(";") if part.strip()]


def failures_text(failures: Sequence[Failure]) -> str:
    """Failures of one thruster as `read_failures` reads them."""
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
    """Return a number, or a text with or without its quotes.

    Without TOML's parser, whose loading the loop would notice.
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
    """If a parameter is among those of these prefixes (none: of all), so many parts deep."""
    if not prefixes:
        return depth == _RECURSIVE or name.count(".") < depth
    for prefix in prefixes:
        rest = name.removeprefix(f"{prefix}.")
        if name == prefix or (rest != name and (depth == _RECURSIVE or rest.count(".") < depth)):
            return True
    return False
