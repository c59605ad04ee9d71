"""Measure and publish the slave's health in a thread of low priority, so that the loop never waits for it."""

import gc
import os
import sys
import threading
from collections.abc import Sequence
from typing import TYPE_CHECKING, Protocol

from boards.tree import Tree
from hil.common.clock import (
    NS_PER_MS,
    NS_PER_S,
    NS_PER_US,
    Histogram,
    boot_id,
    now_ns,
    schedule_below_loop,
    to_wall_ns,
    wall_offset_ns,
)
from hil.ros.diagnostics import Diagnostics
from hil.scenario.records import Link
from hil.slave import usage
from hil.slave.contacts import Contacts
from hil.slave.health.machine_figures import add_machine_figures
from hil.slave.log import Log
from hil.slave.loop import Loop
from hil.slave.notify import Heartbeat

if TYPE_CHECKING:
    from boards import Board
    from hil.slave.imaging.sensors import Imaging

PERIOD_S = 1.0
MIN_PERIOD_S = 0.1  # between two messages while log lines arrive all the time
RECENT_NS = 900 * NS_PER_MS  # window of the recent figures; they change once a second, even with more messages
COLLECT_PERIOD_NS = 30 * NS_PER_S
SKIPPED_PERIOD_NS = 60 * NS_PER_S  # between two log lines about skipped steps
OK, WARNING, ERROR = 0, 1, 2


class Part(Protocol):
    """A part of the slave that reports its own figures."""

    def add_figures(self, figures: Diagnostics) -> None:
        """Add the present figures; called in the thread of the health."""


def own_name() -> str:
    """Return a name for a machine that is no known board; "this one" would mean nothing elsewhere."""
    kernel = os.uname()
    return f"{kernel.machine} machine {kernel.nodename}"


class RecentLateness:
    """Lateness of the loop in the last second. Figures since the start would hide a loop that becomes slower."""

    def __init__(self) -> None:
        self._bins = Histogram().bins
        self._computed_ns = 0
        self._recent = Histogram()

    def add_figures(self, figures: Diagnostics, lateness: Histogram, now: int) -> None:
        """Add the lateness since the last update, which is at least RECENT_NS earlier. `now`: monotonic ns."""
        if now - self._computed_ns >= RECENT_NS:
            self._recent = lateness.since(self._bins)
            self._bins, self._computed_ns = list(lateness.bins), now
        figures.lateness_recent_p50_us = self._recent.quantile(0.5) / NS_PER_US
        figures.lateness_recent_p99_us = self._recent.quantile(0.99) / NS_PER_US
        figures.lateness_recent_max_us = self._recent.maximum / NS_PER_US


class SkippedSteps:
    """Report in the log that the loop skipped steps because it was late: at once, then at most once a minute."""

    def __init__(self) -> None:
        self._reported = 0
        self._due_ns = 0

    def line(self, skipped: int, worst_ns: int, now: int) -> str:
        """Return the log line if `skipped` (steps since the start) has grown; else "". `now`: monotonic ns."""
        more = skipped - self._reported
        if more <= 0 or now < self._due_ns:
            return ""
        self._reported, self._due_ns = skipped, now + SKIPPED_PERIOD_NS
        return (
            f"WARNING: the loop did not get the processor in time: {more} steps skipped, {skipped} since the start, at "
            f"most {worst_ns / NS_PER_MS:.0f} ms late; end other programs, or see `uuv-hil doctor`"
        )


class Health:
    """Write the log and publish the diagnostics, on each new log line and once a second.

    `parts` report their figures, besides the loop with its ends, `contacts` and `imaging`. `startup` maps names of
    start-up stages to monotonic times (ns), with "exec" among them. Use as a context manager: it publishes a last time
    at the end.
    """

    def __init__(
        self,
        loop: Loop,
        parts: Sequence[Part],
        log: Log,
        startup: dict[str, int],
        notes: list[str],
        board: "Board | None",
        link: Link,
        contacts: Contacts,
        imaging: "Imaging | None" = None,
    ) -> None:
        self._loop = loop
        self._parts: tuple[Part, ...] = loop, loop.source, loop.driver, loop.sample_publisher, contacts, *parts
        if imaging:
            self._parts += (imaging,)
        self._imaging = imaging
        self._contacts = contacts
        self._log = log
        self._startup = startup
        self._fixed = _fixed_figures(startup, notes, board, link)
        self._tree, self._board = Tree(), board
        self._recent, self._skipped = RecentLateness(), SkippedSteps()
        self._memory, self._returned = usage.Memory(), usage.ReturnedMemory()
        self._wakeup = log.wakeup  # the command receiver sets the same event
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="health", daemon=True)

    def __enter__(self) -> None:
        self._thread.start()

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        self._wakeup.set()
        self._thread.join(1.0)  # it may hang in a write to a terminal that nobody reads
        self._publish()
        self._log.flush()

    def values(self) -> Diagnostics:
        """Return the present figures, as they are published."""
        figures = Diagnostics(self._fixed.raw)
        figures.uptime_s = (now_ns() - self._startup["exec"]) / NS_PER_S
        self._memory.add_figures(
            figures, self._loop.driver.children + (self._imaging.children if self._imaging else ())
        )
        self._recent.add_figures(figures, self._loop.schedule.lateness, now_ns())
        add_machine_figures(figures, self._tree, self._board)
        for part in self._parts:
            part.add_figures(figures)
        return figures

    def _publish(self) -> None:
        self._loop.sample_publisher.publish_diagnostics("slave", *self._state(), self.values().raw)

    def _state(self) -> tuple[int, str]:
        """Return the level of the status, and its text."""
        if problem := self._loop.driver.problem():
            return ERROR, problem
        problem = self._loop.source.problem()
        return (WARNING, problem) if problem else (OK, "running")

    def _run(self) -> None:
        schedule_below_loop()
        self._add_labels()
        self._returned.check()
        collect_due_ns, heart = now_ns() + COLLECT_PERIOD_NS, Heartbeat()
        while not self._stop.wait(MIN_PERIOD_S):
            self._wakeup.wait(PERIOD_S - MIN_PERIOD_S)
            self._wakeup.clear()
            self._check_clock()
            schedule = self._loop.schedule
            skipped = self._skipped.line(schedule.skipped, schedule.lateness.maximum, now_ns())
            if skipped:
                self._log.write_line(skipped)
            self._log.flush()
            heart.beat(self._loop.schedule.due_total)
            self._publish()
            self._contacts.close_unread_links()
            if now_ns() >= collect_due_ns:
                gc.collect()  # the loop has switched automatic collection off
                self._returned.check()
                collect_due_ns = now_ns() + COLLECT_PERIOD_NS

    def _check_clock(self) -> None:
        """Detect that the wall clock was set; the stamps follow from the next step on."""
        set_by_ns = self._loop.sample_publisher.stamps.check_clock(wall_offset_ns())
        if set_by_ns:
            self._log.write_line(f"the machine's clock was set by {set_by_ns / NS_PER_S:+.3f} s: stamps follow it")

    def _add_labels(self) -> None:
        """Add the labels that limit what this machine's figures mean, such as emulation; called after the start."""
        from boards.emulation import labels

        texts = labels(self._tree, os.uname().machine)
        if texts:
            self._fixed.labels = texts


def _fixed_figures(startup: dict[str, int], notes: list[str], board: "Board | None", link: Link) -> Diagnostics:
    """Return the figures that stay constant while the slave runs."""
    figures = Diagnostics()
    figures.board = board.name if board else own_name()
    figures.boot_id = boot_id()
    figures.cores = os.cpu_count() or 1
    figures.ram_mib = usage.ram_mib()
    figures.python = sys.version.split()[0]
    figures.bytecode_compiled = bytecode_compiled("hil")
    figures.exec_wall_ns = to_wall_ns(startup["exec"])
    figures.realtime = "; ".join(notes)
    figures.link_protocol = link.protocol
    figures.link_baud = link.baud
    figures.link_held_baud = link.faults.baud if link.faults else 0
    for name, instant in startup.items():
        if name != "exec":
            figures[f"startup_{name}_ms"] = (instant - startup["exec"]) / NS_PER_MS
    return figures


def bytecode_compiled(package: str) -> bool:
    """Return whether every loaded module of `package` came from cached bytecode on disk or is compiled C."""
    modules = [m for name, m in sys.modules.items() if name == package or name.startswith(package + ".")]
    python = [module for module in modules if not (getattr(module, "__file__", None) or "").endswith(".so")]
    cached = [getattr(module, "__cached__", None) for module in python]
    return bool(cached) and all(path is not None and os.path.exists(path) for path in cached)
