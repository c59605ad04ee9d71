"""Write a vehicle's file with new gains; only its [control] table is changed."""

import os
from math import inf
from typing import Any

from hil.autonomy.control.controller import AxisGains, Gains, HoldGains
from hil.common.errors import ConfigError
from hil.common.tables import parse_toml
from sim.vehicle.vehicle import Vehicle


def control_text(gains: Gains) -> str:
    """Return `gains` as a [control] table; each loop has p and the keys that differ from their defaults."""
    rows = [f"{key} = {{ {_inline(row)} }}" for key, row in gains._asdict().items()]
    return "\n".join(["[control]", *rows, ""])


def with_gains(text: str, gains: Gains, note: str, where: str) -> str:
    """Return the vehicle file `text` with its gains replaced by `gains`, at its end after the comment `note`.

    Tables of other controllers are unchanged. Raises ConfigError if the old gains cannot be found in the text.
    """
    new_text = f"{_without_gains(text)}\n# {note}\n{control_text(gains)}"
    try:
        control = parse_toml(new_text)["control"]
    except ValueError as error:
        raise ConfigError(f"{where}: its gains are outside the [control] table: {error}; move them there") from None
    if {key for key in control if key in Gains._fields} != set(Gains._fields):
        raise ConfigError(f"{where}: its gains could not be replaced; move them under [control]")
    return new_text


def write_tuned(source: str, vehicle: Vehicle, gains: Gains, note: str, output: str) -> None:
    """Write the vehicle file `source` with `gains` to `output`. Raises ConfigError."""
    if vehicle.meshes and os.path.dirname(os.path.abspath(output)) != os.path.dirname(os.path.abspath(source)):
        raise ConfigError(f"{output}: the vehicle's meshes are beside {source}: write the new file to that folder")
    try:
        with open(source, encoding="utf-8") as file:
            new_text = with_gains(file.read(), gains, note, source)
        with open(output, "w", encoding="utf-8") as file:
            file.write(new_text)
    except OSError as error:
        raise ConfigError(f"{error.filename}: {error.strerror}") from None


def _without_gains(text: str) -> str:
    """Return `text` without [control], the tables of its gains, and the comments just above it."""
    remaining: list[str] = []
    own = {"[control]", *(f"[control.{key}]" for key in Gains._fields)}
    dropping = False
    for line in text.rstrip().split("\n"):
        header = line.partition("#")[0].strip()
        if header.startswith("["):
            dropping = header in own
            while dropping and remaining and remaining[-1].startswith("#"):
                remaining.pop()
        if not dropping:
            remaining.append(line)
    return "\n".join(remaining).rstrip() + "\n"


def _inline(row: AxisGains | HoldGains) -> str:
    defaults: dict[str, Any] = row._field_defaults
    pairs = {key: value for key, value in row._asdict().items() if key == "p" or value != defaults.get(key)}
    return ", ".join(f"{key} = {'inf' if value == inf else repr(float(value))}" for key, value in pairs.items())
