"""Write a scenario with some values changed to a file for other processes."""

import os
from collections.abc import Iterator
from typing import Any

from hil.bench.record import write_text
from hil.common.errors import ConfigError
from hil.common.schema import find_preset
from hil.common.tables import read_table
from hil.scenario.config import SCENARIOS, load_scenario

FOLDERS = ("slave", "master", "router")  # paths in [security]


def write_changed(name: str, changes: dict[str, Any], path: str) -> None:
    """Write scenario `name` to `path` with `changes` by dotted key: {"link.protocol": "vesc"}; None removes a key.

    Relative paths in it are resolved. Raises ConfigError, also when the changed scenario is invalid.
    """
    load_scenario(name, None if None in changes.values() else changes)  # so that errors name the original or the change
    source = find_preset(SCENARIOS, name)
    table = read_table(source)
    _make_paths_absolute(table, os.path.dirname(os.path.abspath(source)))
    for key, value in changes.items():
        _change(table, key, value)
    write_text(path, "\n".join(_lines(table, "")) + "\n")
    try:
        load_scenario(path)
    except ConfigError as error:  # there is no such file
        raise ConfigError(str(error).replace(path, f"{name}, as changed")) from None


def _make_paths_absolute(table: dict[str, Any], folder: str) -> None:
    for key in ("vehicle", "world"):
        if str(table.get(key, "")).endswith(".toml"):
            table[key] = os.path.join(folder, table[key])
    link, security = table.get("link", {}), table.get("security", {})
    if str(link.get("frame", "")).endswith(".toml"):
        link["frame"] = os.path.join(folder, link["frame"])
    for key in FOLDERS:
        if security.get(key):
            security[key] = os.path.join(folder, security[key])


def _change(table: dict[str, Any], key: str, value: Any) -> None:
    *sections, last = key.split(".")
    for section in sections:
        table = table.setdefault(section, {})
        if not isinstance(table, dict):
            raise ConfigError(f"{key}: {section!r} is a value, not a section")
    table[last] = value
    if value is None:
        del table[last]


def _lines(table: dict[str, Any], section: str) -> Iterator[str]:
    """Yield a table as TOML: its values, then its sections."""
    sections = {key: value for key, value in table.items() if _is_section(value)}
    yield from (f"{_key(key)} = {_value(value)}" for key, value in table.items() if key not in sections)
    for key, value in sections.items():
        name = f"{section}.{_key(key)}" if section else _key(key)
        for item in value if isinstance(value, list) else [value]:
            yield from ("", f"[[{name}]]" if isinstance(value, list) else f"[{name}]", *_lines(item, name))


def _is_section(value: Any) -> bool:
    rows = isinstance(value, list) and bool(value) and all(isinstance(item, dict) for item in value)
    return isinstance(value, dict) or rows


def _value(value: Any) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return '"' + "".join(_escaped(character) for character in value) + '"'
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(map(_value, value)) + "]"
    if isinstance(value, dict):
        return "{" + ", ".join(f"{_key(key)} = {_value(item)}" for key, item in value.items()) + "}"
    return repr(value)


def _escaped(character: str) -> str:
    return (
        f"\\u{ord(character):04X}" if character in '"\\' or ord(character) < 32 or ord(character) == 127 else character
    )


def _key(key: str) -> str:
    bare = key.isascii() and key.replace("_", "").replace("-", "").isalnum()
    return key if bare else _value(key)
