"""The table of a vehicle's MAVLink parameters: their types, ranges and values.

Parameters of the gateway (speeds of the sticks, mission, failsafes) are stored in a file on this machine. Parameters of
the slave (gains of its controller, failures of its thrusters) belong to the slave and last as long as it runs.
"""

import math
import os
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

from pymavlink.dialects.v20 import ardupilotmega as dialect

from hil.common.tables import parse_toml, read_table, write_atomically

INT8, INT16, INT32, REAL32 = (
    dialect.MAV_PARAM_TYPE_INT8,
    dialect.MAV_PARAM_TYPE_INT16,
    dialect.MAV_PARAM_TYPE_INT32,
    dialect.MAV_PARAM_TYPE_REAL32,
)


class Parameter(NamedTuple):
    """One parameter of the gateway: its type, default and range, its unit ("": none), and what it means.

    `group` is "effective", "fixed" (it cannot be set) or "stored" (it changes nothing in this vehicle).
    """

    kind: int
    default: float
    least: float
    most: float
    unit: str
    meaning: str
    group: str


KINDS = {"int8": INT8, "int16": INT16, "int32": INT32, "real32": REAL32}
LONGEST_NAME = 16
SI = {"cm": 0.01, "cm/s": 0.01, "deg/s": math.pi / 180.0}  # what a unit is in m, m/s, rad/s


def expand(text: str) -> list[str]:
    """Return the names that one of the file stands for: each list in braces is expanded, from the left."""
    before, brace, rest = text.partition("{")
    if not brace:
        return [text]
    listed, _, after = rest.partition("}")
    first, _, last = listed.partition("..")
    words = [str(number) for number in range(int(first), int(last) + 1)] if last else listed.split(",")
    return [before + word + tail for word in words for tail in expand(after)]


def load_parameters() -> dict[str, Parameter]:
    """Return the parameters in parameters.toml by name."""
    found = {}
    for group, rows in read_table(os.path.join(os.path.dirname(__file__), "parameters.toml")).items():
        for text, (kind, default, least, most, unit, meaning) in rows.items():
            names = expand(text)
            defaults = default if isinstance(default, list) else [default] * len(names)
            for name, value in zip(names, defaults, strict=True):
                found[name] = Parameter(KINDS[kind], float(value), least, most, unit, meaning, group)
    return found


GATEWAY = load_parameters()


class ParameterTable:
    """All parameters by name. `slave` gives those of the slave, `set_slave` begins to set one of them.

    `path` is the file of stored ones ("": none). What does not fit there is left at its default, and `faults` names it.
    """

    def __init__(
        self,
        path: str = "",
        slave: Callable[[], Mapping[str, float]] = dict,
        set_slave: Callable[[str, float], None] = lambda _name, _value: None,
        defaults: Mapping[str, float] | None = None,
    ) -> None:
        self._path, self._slave, self._set_slave = path, slave, set_slave
        self._values = {name: parameter.default for name, parameter in GATEWAY.items()} | dict(defaults or {})
        self._defaults = dict(self._values)
        self.faults: list[str] = []
        self._load()

    def __getitem__(self, name: str) -> float:
        """Return the value of a parameter of the gateway in SI units."""
        return self._values[name] * SI.get(GATEWAY[name].unit, 1.0)

    def names(self) -> list[str]:
        """Return the names of all, sorted: their places are their indices."""
        return sorted({*self._values, *self._slave()})

    def kind(self, name: str) -> int:
        """Return the MAV_PARAM_TYPE of a parameter."""
        return GATEWAY[name].kind if name in GATEWAY else int(REAL32)

    def value(self, name: str) -> float | None:
        """Return the value of any parameter, None if there is none of that name."""
        return self._slave().get(name, self._values.get(name))

    def is_of_slave(self, name: str) -> bool:
        """Return whether the slave has this parameter, which then counts instead of one of the gateway."""
        return name in self._slave()

    def set(self, name: str, value: float) -> str:
        """Set a parameter, or begin to, in its own unit; return why that cannot be, "" if it can."""
        if self.value(name) is None:
            return f"{name}: no such parameter"
        if not math.isfinite(value):
            return f"{name}: not a finite number"
        if self.is_of_slave(name):
            self._set_slave(name, value)
            return ""
        parameter = GATEWAY[name]
        if parameter.group == "fixed":
            return f"{name}: cannot be set, as it follows from the vehicle's file"
        if not parameter.least <= value <= parameter.most:
            return f"{name}: {value:g} is not between {parameter.least:g} and {parameter.most:g}"
        self._values[name] = value if parameter.kind == REAL32 else float(round(value))
        return self._store()

    def messages(self, *wanted: str) -> list[Any]:
        """Return PARAM_VALUE of those that there are, of all without names. Values travel as floats, as ArduPilot's do.

        A name may end with zeros, as in a packet.
        """
        names = self.names()
        places = {name: index for index, name in enumerate(names)}
        chosen = [name.partition("\0")[0] for name in wanted] or names
        return [
            dialect.MAVLink_param_value_message(
                name.encode("ascii", "replace")[:LONGEST_NAME], self.value(name) or 0.0, self.kind(name), len(names),
                places[name],
            )
            for name in chosen if name in places
        ]  # fmt: skip

    def _load(self) -> None:
        if not self._path or not os.path.exists(self._path):
            return
        try:
            with open(self._path, encoding="utf-8") as file:
                stored = parse_toml(file.read())
        except (OSError, ValueError) as error:
            self.faults.append(f"parameters: {self._path}: {error}; defaults are used")
            return
        for name, value in stored.items():
            parameter = GATEWAY.get(name)
            is_number = isinstance(value, (int, float)) and not isinstance(value, bool)
            if parameter and parameter.group != "fixed" and is_number and parameter.least <= value <= parameter.most:
                self._values[name] = float(value)
            else:
                self.faults.append(f"parameters: {self._path}: {name}: {value!r} is left out")

    def _store(self) -> str:
        """Write what differs from the defaults; return why it could not be written, else ""."""
        if not self._path:
            return ""
        changed = [(name, value) for name, value in sorted(self._values.items()) if value != self._defaults[name]]
        text = "".join([f"{name} = {value!r}\n" for name, value in changed])
        try:
            write_atomically(self._path, text)
        except OSError as error:
            return f"not stored: {error.strerror}"
        return ""
