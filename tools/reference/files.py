"""Parts of the pages of the file formats: scenario, sensors, vehicle, world, board, frame."""

from collections.abc import Iterable

from hil.common.schema import NOUNS, preset_folder, preset_names
from hil.common.tables import read_table
from hil.common.units import SPELLINGS, UNITS
from hil.doctor.vehicle.rules import RULES, words
from sim.sensors.sensor_set import DEFAULT_SENSORS, DEVICES
from tools.reference.records import rows

NUMBERS = (
    "A number whose unit is in [this table](scenario.md#units) is written as an SI number (`0.2`) or as text with a "
    'unit (`"200 ms"`, `"200ms"`). All other numbers are written without a unit. '
    "Where an array has no fixed length, one value stands for an array of one. "
    "A key that is not in these tables is an error. A path is relative to the file that names it. "
    "This page is made by `python -m tools.reference` from the schema that reads the file."
)


def numbers() -> str:
    """Return the text that all these pages begin with."""
    return NUMBERS


def presets(folder: str) -> str:
    """Return the names of the installed files of a folder."""
    return f"Installed {NOUNS[folder]} files: {_words(preset_names(folder))}."


def default_sensors() -> str:
    """Return the names of the sensors that are always fitted."""
    return _words(DEFAULT_SENSORS)


def units() -> str:
    """Return the rows of the units in which numbers may be written."""
    by_unit: dict[str, list[str]] = {}
    for name, (unit, _) in UNITS.items():
        other = f" ({_words(SPELLINGS[name])})" if name in SPELLINGS else ""
        by_unit.setdefault(unit, []).append(f"`{name}`{other}")
    return rows((unit, ", ".join(names)) for unit, names in by_unit.items())


def devices() -> str:
    """Return the rows of the values for `device`."""
    tables = {name: read_table(f"{preset_folder(DEVICES)}/{name}.toml") for name in preset_names(DEVICES)}
    return rows((f"`{name}`", f"`{table['sensor']}`", table["source"]) for name, table in tables.items())


def findings() -> str:
    """Return the rows of the rules for a vehicle."""
    return rows((r.key, r.quantity, words(r.sane, r.unit), r.level, words(r.absurd, r.unit), r.remedy) for r in RULES)


def _words(names: Iterable[str]) -> str:
    return ", ".join(f"`{name}`" for name in names)
