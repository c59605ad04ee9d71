"""The record of what a check of a scenario finds."""

from typing import NamedTuple


class ScenarioFinding(NamedTuple):
    """One thing about a scenario: `level` is "problem" (no flight succeeds) or "warning", `text` names file and key."""

    level: str
    text: str
