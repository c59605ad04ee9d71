"""The table of a vehicle's MAVLink parameters: their types, ranges and values.

Parameters of the gateway (speeds of the sticks, mission, failsafes) are stored in a file on this machine. Parameters of
the slave (gains of its controller, failures of its thrusters) belong to the slave and last as long as it runs.
"""

import math
import os
from collections.abc import Callable, Mapping
from typing import NamedTuple

from pymavlink.dialects.v20 import ardupilotmega as dialect

from hil.common.tables import parse_toml, write_atomically

INT8, INT16, INT32, REAL32 = (
    dialect.MAV_PARAM_TYPE_INT8,
    dialect.MAV_PARAM_TYPE_INT16,
    dialect.MAV_PARAM_TYPE_INT32,
    dialect.MAV_PARAM_TYPE_REAL32,
)


class Parameter(NamedTuple):
    """One parameter of the gateway: its type, default and range, its unit ("": none), and what it means."""

    kind: int
    default: float
    least: float
    most: float
    unit: str
    meaning: str


def _real(default: float, least: float, most: float, unit: str, meaning: str) -> Parameter:
    return Parameter(REAL32, default, least, most, unit, meaning)


GATEWAY: dict[str, Parameter] = {
    "SYSID_THISMAV": Parameter(INT16, 1, 1, 250, "", "MAVLink system id; takes effect at the next start"),
    "PILOT_SPEED": _real(0.5, 0.0, 5.0, "m/s", "speed ahead at full stick"),
    "PILOT_SPEED_SIDE": _real(0.4, 0.0, 5.0, "m/s", "speed sideways at full stick"),
    "PILOT_SPEED_UP": _real(0.3, 0.0, 5.0, "m/s", "speed up and down at full stick"),
    "PILOT_YAW_RATE": _real(30.0, 0.0, 360.0, "deg/s", "turn rate at full stick"),
    "MAN_FORCE_X": _real(40.0, 0.0, 1e5, "N", "force ahead at full stick in Manual"),
    "MAN_FORCE_Y": _real(40.0, 0.0, 1e5, "N", "force to starboard at full stick in Manual"),
    "MAN_FORCE_Z": _real(40.0, 0.0, 1e5, "N", "force up at full stick in Manual"),
    "MAN_MOMENT_K": _real(5.0, 0.0, 1e5, "N m", "moment about the roll axis at full stick in Manual"),
    "MAN_MOMENT_M": _real(5.0, 0.0, 1e5, "N m", "moment about the pitch axis at full stick in Manual"),
    "MAN_MOMENT_N": _real(8.0, 0.0, 1e5, "N m", "moment about the yaw axis at full stick in Manual"),
    "JS_DEADZONE": _real(0.03, 0.0, 0.5, "-", "dead zone of a stick, as a share of its deflection"),
    "WP_SPEED": _real(0.5, 0.05, 5.0, "m/s", "speed between waypoints and to guided positions"),
    "WP_RADIUS": _real(0.5, 0.1, 100.0, "m", "a waypoint is reached within this distance"),
    "WP_YAW_BEHAVE": Parameter(INT8, 1, 0, 1, "", "0: the heading is held; 1: the bow points to the next waypoint"),
    "NAV_STEER": Parameter(INT8, 0, 0, 1, "", "0: the vehicle can stop and move sideways; 1: it turns by fins"),
    "DEPTH_MAX": _real(100.0, 0.0, 11_000.0, "m", "deeper targets are limited to this depth"),
    "SURFACE_DEPTH": _real(0.2, 0.0, 10.0, "m", "depth to which the mode Surface rises"),
    "FS_PILOT_TOUT": _real(0.5, 0.1, 10.0, "s", "sticks count as centred if the joystick is silent for this long"),
    "FS_GCS_TIMEOUT": _real(3.0, 1.0, 120.0, "s", "FS_GCS_ENABLE acts if all ground stations are silent for this long"),
    "FS_GCS_ENABLE": Parameter(INT8, 2, 0, 4, "", "0: nothing; 1: warn; 2: disarm; 3: depth hold; 4: surface"),
    "FS_LEAK_ENABLE": Parameter(INT8, 1, 0, 2, "", "action at a leak. 0: nothing; 1: warn; 2: surface"),
    "GUIDED_TIMEOUT": _real(3.0, 0.1, 60.0, "s", "a velocity target ends after this time; then the position is held"),
}  # fmt: skip


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
        """Return the value of a parameter of the gateway."""
        return self._values[name]

    def names(self) -> list[str]:
        """Return the names of all, sorted: their places are their indices."""
        return sorted([*self._values, *self._slave()])

    def kind(self, name: str) -> int:
        """Return the MAV_PARAM_TYPE of a parameter."""
        if name in GATEWAY:
            return GATEWAY[name].kind
        return int(INT8 if name.endswith("_KIND") else REAL32)

    def value(self, name: str) -> float | None:
        """Return the value of any parameter, None if there is none of that name."""
        own = self._values.get(name)
        return self._slave().get(name) if own is None else own

    def set(self, name: str, value: float) -> str:
        """Set a parameter, or begin to; return why that cannot be, "" if it can."""
        if self.value(name) is None:
            return f"{name}: no such parameter"
        if not math.isfinite(value):
            return f"{name}: not a finite number"
        parameter = GATEWAY.get(name)
        if parameter is None:
            self._set_slave(name, value)
            return ""
        if not parameter.least <= value <= parameter.most:
            return f"{name}: {value:g} is not between {parameter.least:g} and {parameter.most:g}"
        self._values[name] = value if parameter.kind == REAL32 else float(round(value))
        return self._store()

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
            if parameter and is_number and parameter.least <= value <= parameter.most:
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
