"""Meanings of the keys of all TOML files, by record."""

import re
from functools import cache
from pathlib import Path
from typing import Any

from hil.common.tables import read_table

_UNIT = re.compile(r"\[([^\]]+)\] (?!\()")
MEANINGS = Path(__file__).parent / "meanings.toml"


@cache
def meanings() -> dict[str, dict[str, str]]:
    """Return the meanings: record -> key -> text."""
    return read_table(str(MEANINGS))


def meaning_of(record: Any, key: str) -> str:
    """Return the meaning of a record's key, without its unit. Raises KeyError if it has none."""
    return _UNIT.sub("", _text(record, key))


def unit_of(record: Any, key: str) -> str:
    """Return the unit that a key's meaning begins with: "-" for a pure number, "" if there is none."""
    match = _UNIT.match(_text(record, key))
    return match[1] if match else ""


def _text(record: Any, key: str) -> str:
    own = meanings().get(record.__name__, {})
    if key not in own and key not in meanings()["common"]:
        raise KeyError(f"{record.__name__}.{key} has no meaning: add one to {MEANINGS}")
    return own.get(key) or meanings()["common"][key]
