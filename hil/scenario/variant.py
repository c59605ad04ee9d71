"""Write a scenario with changed values, and its world, to files for other processes."""

import os
from collections.abc import Iterator, Mapping, Sequence
from copy import deepcopy
from typing import Any

from hil.common.errors import ConfigError
from hil.common.schema import find_preset
from hil.common.tables import read_table, save_text
from hil.common.text import toml_key, toml_text
from hil.scenario.config import SCENARIOS, load_scenario

Table = dict[str, Any]
FILES = (("", "vehicle"), ("", "world"), ("link", "frame"))
FOLDERS = ("slave", "master", "router")  # paths in [security]


def write_variant(
    scenario: str, folder: str, changes: Mapping[str, Any], world: Mapping[str, Sequence[Table]] | None = None
) -> str:
    """Write the scenario (a preset or a file) with `changes` ({"slave.listen": ...}) to `folder`; return its path.

    A change to None removes its key. `world`: obstacles to add to its world, by kind: {"cylinder": [...]}; the world is
    then written beside it. Raises ConfigError, also when the changed scenario is invalid.
    """
    if None not in changes.values():
        load_scenario(scenario, dict(changes))  # so that an error names the original or the change
    source = find_preset(SCENARIOS, scenario)
    table = deepcopy(read_table(source))
    _make_paths_absolute(table, os.path.dirname(os.path.abspath(source)))
    for key, value in changes.items():
        _change(table, key, value)
    if world:
        table["world"] = _write_world(table["world"], folder, world)
    path = os.path.join(folder, "scenario.toml")
    write_toml(path, table)
    try:
        load_scenario(path)
    except ConfigError as error:  # a file that nobody knows
        raise ConfigError(str(error).replace(path, f"{scenario}, as changed")) from None
    return path


def _make_paths_absolute(table: Table, folder: str) -> None:
    for section, key in FILES:
        place = table.get(section, {}) if section else table
        if str(place.get(key, "")).endswith(".toml"):
            place[key] = os.path.join(folder, place[key])
    security = table.get("security", {})
    for key in FOLDERS:
        if security.get(key):
            security[key] = os.path.join(folder, security[key])


def _change(table: Table, key: str, value: Any) -> None:
    *sections, last = key.split(".")
    for section in sections:
        table = table.setdefault(section, {})
        if not isinstance(table, dict):
            raise ConfigError(f"{key}: {section!r} is a value, not a section")
    table[last] = value
    if value is None:
        del table[last]


def _write_world(name: str, folder: str, more: Mapping[str, Sequence[Table]]) -> str:
    table = deepcopy(read_table(find_preset("sim/worlds", name)))
    for kind, things in more.items():
        table[kind] = [*table.get(kind, []), *things]
    write_toml(os.path.join(folder, "world.toml"), table)
    return "world.toml"


def write_toml(path: str, table: Table) -> None:
    """Write a table as TOML. Raises ConfigError if the file cannot be written, or a value has no form in TOML."""
    save_text(path, "".join(f"{line}\n" for line in _lines(table, "")))


def _lines(table: Table, section: str) -> Iterator[str]:
    """Yield the lines of a table, plain values first, because lines after the header of a section belong to it."""
    sections = {key: value for key, value in table.items() if _is_section(value)}
    yield from (f"{toml_key(key)} = {toml_text(value)}" for key, value in table.items() if key not in sections)
    for key, value in sections.items():
        name = f"{section}.{toml_key(key)}" if section else toml_key(key)
        for item in value if isinstance(value, list) else [value]:
            yield from ("", f"[[{name}]]" if isinstance(value, list) else f"[{name}]", *_lines(item, name))


def _is_section(value: Any) -> bool:
    rows = isinstance(value, list) and bool(value) and all(isinstance(item, dict) for item in value)
    return isinstance(value, dict) or rows
