"""Areas with rules, such as restricted areas, for maps and planners: the `[[zone]]` tables of a world's file.

[[zone]]
kind = "restricted"
outline = [[-40.0, 0.0], [0.0, 10.0], [60.0, -10.0]]   # north and east of its corners
name = "reserve"

Worlds made from charts have their zones in a separate file with such tables, which the key `zones` names; it is read
when zones are needed. A zone does not stop a vehicle: planners avoid the kinds that `avoid_zones` in a scenario's
`[master]` lists.
"""

import os
from functools import lru_cache
from typing import NamedTuple

from hil.common.errors import ConfigError
from hil.common.schema import parse_rows
from hil.common.tables import read_table
from sim.environment.obstacles import Coordinate, ZoneKind


class Zone(NamedTuple):
    """An area: its `kind`, the corners of its `outline` (north, east), its `name`, and its `rule` as text."""

    kind: ZoneKind
    outline: tuple[tuple[Coordinate, Coordinate], ...]
    name: str = ""
    rule: str = ""

    def validate(self) -> str | None:
        """Return what is wrong with the combination of the keys, or None."""
        return None if len(self.outline) > 2 else "outline: give three corners or more"

    @property
    def label(self) -> str:
        """Name for maps."""
        area = f"{self.kind} area"
        return f"{area}: {self.name or self.rule}" if self.name or self.rule else area


def read_file(path: str) -> tuple[Zone, ...]:
    """Return the zones in a file, cached until the file changes. Raises ConfigError."""
    try:
        changed_ns = os.stat(path).st_mtime_ns
    except OSError as error:
        raise ConfigError(f"{path}: the zones of a world cannot be read: {error.strerror}") from None
    return _read(path, changed_ns)


@lru_cache(maxsize=4)
def _read(path: str, _changed_ns: int) -> tuple[Zone, ...]:
    return parse_rows(read_table(path).get("zone", []), Zone, f"{path}: zone")
