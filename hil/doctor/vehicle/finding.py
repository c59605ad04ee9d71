"""The record of a finding about a vehicle or a scenario."""

from typing import NamedTuple


class Finding(NamedTuple):
    """A finding about a file. `text` names the key, what is wrong and what to change.

    `level` is "problem" (absurd, or no flight succeeds), "warning" (probably a mistake) or "note" (unusual, but right
    for some vehicles).
    """

    level: str
    text: str
