"""What each key of each file means, record by record."""

from functools import cache
from pathlib import Path
from typing import Any

from hil.common.tables import read_table

MEANINGS = Path(__file__).parent / "meanings.toml"


@cache
def meanings() -> dict[str, dict[str, str]]:
    """Return record -> key -> what the key means."""
    return read_table(str(MEANINGS))


def meaning_of(record: Any, key: str) -> str:
    """Return what a key of a record means. Raises KeyError for a key without a meaning."""
    own = meanings().get(record.__name__, {})
    if key not in own and key not in meanings()["common"]:
        raise KeyError(f"{record.__name__}.{key} has no meaning: write it into {MEANINGS}")
    return own.get(key) or meanings()["common"][key]
