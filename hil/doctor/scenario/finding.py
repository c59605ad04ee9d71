"""The record of a finding about a scenario."""

from typing import NamedTuple


class ScenarioFinding(NamedTuple):
    """A finding about a scenario. `level` is "problem" (no flight succeeds) or "warning"; `text` names file and key."""

    level: str
    text: str
