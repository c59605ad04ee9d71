"""Write a scenario with changed values, and its world, to files for slave and master."""

import os
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from hil.common.errors import ConfigError
from hil.common.schema import find_preset
from hil.common.tables import read_table
from hil.scenario.config import SCENARIOS

Table = dict[str, Any]


def write_variant(
    scenario: str, folder: str, changes: Mapping[str, Any], world: Mapping[str, Sequence[Table]] | None = None
) -> str:
    """Write the scenario (a preset or a file) with `changes` ({"slave.listen": ...}) to `folder`; return its path.

    `world`: obstacles to add to its world, by kind: {"cylinder": [...]}; the world is then written beside it. Raises
    ConfigError.
    """
    source = find_preset(SCENARIOS, scenario)
    table = _copy(read_table(source))
    for key, value in changes.items():
        *sections, last = key.split(".")
        place = table
        for section in sections:
            place = place.setdefault(section, {})
        place[last] = value
    for key, ending in (("vehicle", ".toml"), ("world", ".toml")):
        if str(table[key]).endswith(ending):
            table[key] = os.path.join(os.path.abspath(os.path.dirname(source)), table[key])
    if str(table.get("link", {}).get("frame", "")).endswith(".toml"):
        table["link"]["frame"] = os.path.join(os.path.abspath(os.path.dirname(source)), table["link"]["frame"])
    if world:
        table["world"] = _write_world(table["world"], folder, world)
    path = os.path.join(folder, "scenario.toml")
    write_toml(path, table)
    return path


def _write_world(name: str, folder: str, more: Mapping[str, Sequence[Table]]) -> str:
    table = _copy(read_table(find_preset("sim/worlds", name)))
    for kind, things in more.items():
        table[kind] = [*table.get(kind, []), *things]
    write_toml(os.path.join(folder, "world.toml"), table)
    return "world.toml"


def write_toml(path: str, table: Table) -> None:
    """Write a table as TOML. Raises ConfigError if the file cannot be written, or a value has no form in TOML."""
    try:
        with open(path, "w", encoding="utf-8") as file:
            file.writelines(f"{line}\n" for line in _lines(table, ""))
    except OSError as error:
        raise ConfigError(f"{path}: cannot be written: {error.strerror}") from None


def _lines(table: Table, name: str) -> Iterator[str]:
    """Yield the lines of a table, plain values first, because lines after the header of a section belong to it."""
    tables = {key: value for key, value in table.items() if isinstance(value, dict)}
    arrays = {key: value for key, value in table.items() if _is_array_of_tables(value)}
    for key, value in table.items():
        if key not in tables and key not in arrays:
            yield f"{key} = {_text(value)}"
    for key, value in tables.items():
        yield f"\n[{name}{key}]"
        yield from _lines(value, f"{name}{key}.")
    for key, rows in arrays.items():
        for row in rows:
            yield f"\n[[{name}{key}]]"
            yield from _lines(row, f"{name}{key}.")


def _is_array_of_tables(value: Any) -> bool:
    return isinstance(value, list) and bool(value) and all(isinstance(row, dict) for row in value)


def _text(value: Any) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        escaped = value.replace("\\", "\\\\").replace('"', '\\"').replace("\n", "\\n")
        return f'"{escaped}"'
    if isinstance(value, (list, tuple)):
        return f"[{', '.join(map(_text, value))}]"
    if isinstance(value, (int, float)):
        return repr(value)
    raise ConfigError(f"{value!r} cannot be written as TOML")


def _copy(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _copy(item) for key, item in value.items()}
    return [_copy(item) for item in value] if isinstance(value, list) else value
