"""Parameters of a DroneCAN node: values, limits, defaults and stored values.

A new value takes effect at once. ExecuteOpcode stores it, and a restart of the node reads the stored values. They are
stored in a file, or without one in memory as long as the process runs.
"""

import json
from math import isfinite
from typing import NamedTuple

from hil.common.errors import ConfigError
from hil.common.tables import write_atomically
from hil.links.dronecan.services import ERASE, SAVE, Description, GetSet, Value


class Parameter(NamedTuple):
    """One parameter, with the type of its default. A bool has no limits."""

    name: str
    default: int | float | bool
    limits: tuple[float, float] | None = None

    def convert(self, value: Value) -> int | float | bool | None:
        """Return a value converted to the parameter's type; None if it is invalid."""
        if isinstance(value, str) or value is None or not isfinite(value):
            return None
        if isinstance(self.default, bool):
            return bool(value) if value in (0, 1) else None
        if isinstance(self.default, int) and value != int(value):
            return None
        own = int(value) if isinstance(self.default, int) else float(value)
        return own if self.limits is None or self.limits[0] <= own <= self.limits[1] else None


class ParameterStore:
    """The parameters of a node, sorted by name. Raises ConfigError if the file of stored values is invalid."""

    def __init__(self, parameters: tuple[Parameter, ...] = (), path: str = "") -> None:
        self._parameters = {each.name: each for each in sorted(parameters)}
        self._path = path
        self._stored: dict[str, int | float | bool] = self._read() if path else {}
        self._values: dict[str, int | float | bool] = {}
        self.restart()

    def __getitem__(self, name: str) -> int | float | bool:
        return self._values[name]

    def restart(self) -> None:
        """Set each parameter to its stored value, or else its default."""
        self._values = {name: self._stored.get(name, each.default) for name, each in self._parameters.items()}

    def answer(self, request: GetSet) -> Description:
        """Set a parameter if the request has a valid value; return the description with its present value."""
        names = list(self._parameters)
        name = request.name or (names[request.number] if request.number < len(names) else "")
        parameter = self._parameters.get(name)
        if parameter is None:
            return Description()
        accepted = parameter.convert(request.value)
        if accepted is not None:
            self._values[name] = accepted
        least, most = parameter.limits or (None, None)
        return Description(name, self._values[name], parameter.default, most, least)

    def execute(self, opcode: int | None) -> bool:
        """Store all values, or delete the stored values and return to the defaults; return whether this succeeded."""
        if opcode == SAVE:
            stored = dict(self._values)
        elif opcode == ERASE:
            stored = {}
        else:
            return False
        if self._path and not self._write(stored):
            return False
        self._stored = stored
        self.restart()
        return True

    def _write(self, stored: dict[str, int | float | bool]) -> bool:
        try:
            write_atomically(self._path, json.dumps(stored))
        except OSError:
            return False
        return True

    def _read(self) -> dict[str, int | float | bool]:
        try:
            with open(self._path, encoding="utf-8") as file:
                stored = json.load(file)
        except FileNotFoundError:
            return {}
        except (OSError, ValueError, RecursionError) as error:
            raise ConfigError(f"stored: {self._path}: {error}; delete it, or name another file") from None
        accepted = {}
        for name, value in stored.items() if isinstance(stored, dict) else ():
            parameter = self._parameters.get(name)
            own = parameter.convert(value) if parameter and isinstance(value, (int, float)) else None
            if own is None:
                raise ConfigError(
                    f"stored: {self._path}: {name} cannot be {value!r}; correct the value, or delete the file"
                )
            accepted[name] = own
        return accepted
