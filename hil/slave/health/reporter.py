"""Measure and publish the slave's health in a thread of low priority, so that the loop never waits for it."""

import gc
import os
import sys
import threading
from typing import TYPE_CHECKING

from boards.tree import Tree
from hil.common.clock import NS_PER_MS, NS_PER_S, NS_PER_US, Histogram, boot_id, now_ns, schedule_below_loop, to_wall_ns
from hil.links.address import wire_kind
from hil.links.contract import PWM_NEUTRAL_US
from hil.recording.stamps import wall_offset_ns
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
DRIVEN_NS = NS_PER_S  # thrusters that got no command for this time count as not driven
COLLECT_PERIOD_NS = 30 * NS_PER_S
SKIPPED_PERIOD_NS = 60 * NS_PER_S  # between two log lines about skipped steps
OK, WARNING, ERROR = 0, 1, 2


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

    `startup` maps names of start-up stages to monotonic times (ns), with "exec" among them. Use as a context manager:
    it publishes a last time at the end.
    """

    def __init__(
        self,
        loop: Loop,
        log: Log,
        startup: dict[str, int],
        notes: list[str],
        board: "Board | None",
        link: Link,
        contacts: Contacts,
        imaging: "Imaging | None" = None,
    ) -> None:
        self._loop = loop
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
        loop, figures = self._loop, Diagnostics(self._fixed.raw)
        children = loop.driver.children + (self._imaging.children if self._imaging else ())
        figures.uptime_s = (now_ns() - self._startup["exec"]) / NS_PER_S
        figures.cpu_s = usage.own_cpu_s(children)
        figures.pss_mib = self._memory.pss_mib(children)
        figures.rss_mib = usage.resident_mib() + sum(map(usage.resident_mib, children))
        figures.processes = 1 + len(children)
        figures.messages_sent = loop.sample_publisher.sent
        figures.messages_dropped = loop.sample_publisher.dropped
        figures.contacts = loop.simulation.contacts
        self._add_run_events(figures)
        self._add_loop_figures(figures)
        self._add_command_figures(figures)
        self._add_link_figures(figures)
        add_machine_figures(figures, self._tree, self._board)
        self._contacts.add_figures(figures)
        if self._imaging:
            self._imaging.add_figures(figures)
        return figures

    def _add_loop_figures(self, figures: Diagnostics) -> None:
        loop, schedule = self._loop, self._loop.schedule
        lateness, wall_ns = schedule.lateness, max(now_ns() - loop.started_ns, 1)
        figures.loop_rate_hz = NS_PER_S / schedule.period_ns
        figures.real_time_factor = schedule.due_total * schedule.period_ns / wall_ns
        figures.lateness_p50_us = lateness.quantile(0.5) / NS_PER_US
        figures.lateness_p99_us = lateness.quantile(0.99) / NS_PER_US
        figures.lateness_p999_us = lateness.quantile(0.999) / NS_PER_US
        figures.lateness_max_us = lateness.maximum / NS_PER_US
        self._recent.add_figures(figures, lateness, now_ns())
        figures.within_2ms = lateness.share_within(2 * NS_PER_MS)
        figures.behind_ms = (wall_ns - (schedule.due_total + schedule.skipped) * schedule.period_ns) / NS_PER_MS
        figures.steps_skipped = schedule.skipped

    def _add_run_events(self, figures: Diagnostics) -> None:
        """Add the events of the run so far, with wall times."""
        log = self._loop.simulation.events
        epoch_ns = to_wall_ns(now_ns()) - self._loop.simulation.time_ns
        figures.run_events = len(log) + log.dropped
        figures.run_event_list = tuple([event._replace(start_ns=event.start_ns + epoch_ns) for event in log.events()])

    def _add_command_figures(self, figures: Diagnostics) -> None:
        loop, command_receiver = self._loop, self._loop.command_receiver
        figures.commands_received = command_receiver.received
        figures.commands_taken = loop.commands
        figures.commands_malformed = command_receiver.malformed
        figures.commands_stale = command_receiver.stale
        figures.commands_disordered = command_receiver.disordered
        figures.commands_superseded = command_receiver.superseded
        figures.commands_refused = command_receiver.refused
        figures.commands_flooded = command_receiver.flooded
        figures.commands_fault = command_receiver.fault
        figures.controller = "builtin" if loop.pilot else "autopilot" if loop.autopilot else "external"
        if loop.autopilot:
            loop.autopilot.add_figures(figures)
        elif loop.pilot is None:
            figures.thrusters_driven = now_ns() - loop.driver.command_ns < DRIVEN_NS
        if loop.ros:
            loop.ros.add_figures(figures)
        figures.armed = loop.armed
        figures.thrusters = command_receiver.thrusters
        figures.commands_unanswered = loop.unanswered
        figures.deadman_trips = loop.pilot.deadman_trips if loop.pilot else 0
        figures.watchdog_trips = loop.watchdog_trips

    def _add_link_figures(self, figures: Diagnostics) -> None:
        driver = self._loop.driver
        figures.link_port = driver.port
        figures.link_wire = wire_kind(driver.port)
        figures.link_losses = driver.losses
        figures.stm32_silent = driver.is_silent
        figures.pwm_us = driver.pwm_us
        if driver.host:
            if driver.host.pace:
                figures.link_slow, figures.link_rate_hz = driver.is_slow, driver.host.pace.rate
            counters = driver.host.counters
            for name in counters.__slots__:
                figures[f"link_{name}"] = getattr(counters, name)
        if wire := driver.wire:
            sent, received = wire.fault_counts()
            if sent:
                figures.link_faults_sent, figures.link_faults_received = sent, received

    def _publish(self) -> None:
        self._loop.sample_publisher.publish_diagnostics("slave", *self._state(), self.values().raw)

    def _state(self) -> tuple[int, str]:
        """Return the level of the status, and its text."""
        driver, pilot = self._loop.driver, self._loop.pilot
        if driver.lost:
            return (
                ERROR,
                f"the thruster link {driver.port} is lost, the STM32's watchdog stops the thrusters: connect it again",
            )
        if driver.is_silent:
            return ERROR, f"the STM32 on {driver.port} does not answer: check wiring, baud, protocol"
        waiting = self._loop.autopilot.state() if self._loop.autopilot else ""
        if waiting:
            return WARNING, waiting
        if pilot and not pilot.active:
            neutral = all(pulse == PWM_NEUTRAL_US for pulse in driver.pwm_us)
            return WARNING, "waiting for commands, thrusters " + ("neutral" if neutral else "not neutral yet")
        return OK, "running"

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
