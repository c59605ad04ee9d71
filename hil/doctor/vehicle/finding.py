"""The record of a finding about a vehicle or a scenario."""

from collections.abc import Iterable
from functools import partial
from typing import NamedTuple


class Finding(NamedTuple):
    """A finding about a file. `text` names the key, what is wrong and what to change.

    `level` is "problem" (absurd, or no flight succeeds), "warning" (probably a mistake) or "note" (unusual, but right
    for some vehicles).
    """

    level: str
    text: str

    def __str__(self) -> str:
        """Return the finding as a line of a command's output."""
        return f"{self.level}: {self.text}"


problem, warning, note = partial(Finding, "problem"), partial(Finding, "warning"), partial(Finding, "note")


def exit_code(findings: Iterable[Finding], strict: bool) -> int:
    """Return the exit code of a check: 1 if a problem was found, with `strict` also for a warning, else 0."""
    return int(any(finding.level == "problem" or (strict and finding.level == "warning") for finding in findings))
