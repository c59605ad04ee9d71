"""Rows of the campaign's table: the fault, the measured figures, and the judgement."""

from collections.abc import Callable
from math import isfinite
from typing import NamedTuple

from tools.faults.links import USUAL, Link
from tools.faults.rig import Rig

RECOVERY_S = 15.0  # the longest that a vehicle may take to obey again: a slave restarts, a session is opened


class Fault(NamedTuple):
    """One fault. `strike` makes it, `mend` ends it.

    cuts: control is lost by the fault alone; else the vehicle obeys on until the planner falls silent while the fault
    lasts, and has to stop for that. links: what it is crossed with. extra_s: by how much the fault itself delays a
    command. hold_s: how long it lasts, beyond the time until the outputs are neutral. after_mend: the time until
    neutral counts from the end of the fault, as a stopped STM32 cannot do anything before. steady: without a cut the
    outputs may never fall to neutral before the planner is silent; else the fault may end the slave. quick: it is in
    the quick selection. unavailable: why it cannot be made on this machine, "" where it can.
    """

    room: str
    name: str
    strike: Callable[[Rig], None]
    mend: Callable[[Rig], None]
    cuts: bool = True
    links: tuple[Link, ...] = (USUAL,)
    extra_s: float = 0.0
    hold_s: float = 1.0
    after_mend: bool = False
    steady: bool = True
    quick: bool = False
    unavailable: Callable[[Rig], str] = lambda _: ""


class Row(NamedTuple):
    """Result of one fault on one link. Times in s; nan where it never came, or where nothing moves (a file).

    stale: commands executed later than the limit after they were given; of a planner that is not to be obeyed: any.
    reported: the line for a person. leaked: what was there afterwards and not before, "" nothing. attempts: how often
    it was measured, as a machine that others use too may be late.
    """

    room: str
    fault: str
    link: str
    neutral_s: float
    limit_s: float
    recovery_s: float
    stale: int
    reported: str
    leaked: str
    problems: tuple[str, ...]
    attempts: int = 1

    @property
    def passed(self) -> bool:
        """True if the row has no problem."""
        return not self.problems


def judge(row: Row) -> Row:
    """Return the row with its faults added to its problems. Without a limit (nan) nothing turns, as with a file."""
    problems = list(row.problems)
    if isfinite(row.limit_s) and not row.neutral_s <= row.limit_s:
        problems.append(f"the outputs were neutral after {row.neutral_s:.2f} s, the limit is {row.limit_s:.2f} s")
    if not row.recovery_s <= RECOVERY_S:
        reported = f"after {row.recovery_s:.1f} s" if isfinite(row.recovery_s) else "not at all"
        problems.append(f"the vehicle obeyed again {reported}, the limit is {RECOVERY_S:g} s")
    if row.stale:
        problems.append(f"{row.stale} old commands were executed")
    if row.leaked:
        problems.append(f"left behind: {row.leaked}")
    return row._replace(problems=tuple(problems))
