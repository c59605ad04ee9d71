"""Rows of the campaign's table: the fault, the measured figures, and the judgement."""

from collections.abc import Callable
from math import isfinite
from typing import NamedTuple

from tools.faults.links import USUAL, Link
from tools.faults.rig import Rig

RECOVERY_S = 15.0  # limit until the vehicle executes commands again: a slave restarts, a session is opened


class Fault(NamedTuple):
    """One fault: `apply` makes it, `remove` ends it.

    cuts: the fault alone ends control; otherwise the vehicle executes commands until the planner becomes silent during
    the fault, and has to stop then. links: the links that get the fault. extra_s: delay that the fault itself adds to a
    command. hold_s: duration, beyond the time until the outputs are neutral. after_removal: the time until neutral
    counts from the end of the fault, because a stopped STM32 cannot do anything before. steady: if control is not cut,
    the outputs must not become neutral before the planner is silent; otherwise the fault may end the slave. quick: in
    the quick selection. unavailable: why the fault cannot be made on this machine; "" if it can.
    """

    room: str
    name: str
    apply: Callable[[Rig], None]
    remove: Callable[[Rig], None]
    cuts: bool = True
    links: tuple[Link, ...] = (USUAL,)
    extra_s: float = 0.0
    hold_s: float = 1.0
    after_removal: bool = False
    steady: bool = True
    quick: bool = False
    unavailable: Callable[[Rig], str] = lambda _: ""


class Row(NamedTuple):
    """Result of one fault on one link. Times in s; nan if it never happened, or if nothing moves (a file).

    stale: commands executed later than the limit after they were sent; of a planner that must not command: any.
    reported: the line that the slave logged. leaked: resources left behind, "" none. attempts: number of measurements,
    because a busy machine may be late.
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
        problems.append(f"the vehicle executed commands again {reported}, the limit is {RECOVERY_S:g} s")
    if row.stale:
        problems.append(f"{row.stale} old commands were executed")
    if row.leaked:
        problems.append(f"left behind: {row.leaked}")
    return row._replace(problems=tuple(problems))
