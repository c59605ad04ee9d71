"""How the slave is doing: measured and told by a thread of low priority, so that the loop never waits for it."""

import gc
import os
import sys
import threading
from typing import TYPE_CHECKING

from boards.tree import Tree
from hil import process
from hil.clock import NS_PER_MS, NS_PER_S, NS_PER_US, Histogram, now_ns, to_wall_ns
from hil.config import Link
from hil.slave.contacts import Contacts
from hil.slave.log import Log
from hil.slave.loop import Loop
from hil.slave.machine_figures import machine_figures
from hil.slave.notify import Heartbeat

if TYPE_CHECKING:
    from boards import Board
    from hil.slave.imaging import Imaging

PERIOD_S = 1.0
LEAST_PERIOD_S = 0.1  # when there is news all the time
RECENT_NS = 900 * NS_PER_MS  # that recent figures are of: what there is each second, however often there is news
COLLECT_PERIOD_NS = 30 * NS_PER_S
OK, WARNING, ERROR = 0, 1, 2


def own_name() -> str:
    """What to call a machine that is no known board: "this one" says nothing elsewhere."""
    kernel = os.uname()
    return f"{kernel.machine} machine {kernel.nodename}"


class RecentLateness:
    """How late the loop was in the last second: a loop that degrades does not show in figures since its start."""

    def __init__(self) -> None:
        self._bins = Histogram().bins
        self._looked_ns = 0
        self._figures: dict[str, str] = {}

    def figures(self, lateness: Histogram, now: int) -> dict[str, str]:
        """Of the cycles since the last look; asked again within RECENT_NS of that, the same (`now`: monotonic ns)."""
        if now - self._looked_ns >= RECENT_NS:
            recent = lateness.since(self._bins)
            self._bins, self._looked_ns = list(lateness.bins), now
            self._figures = {
                "lateness_recent_p50_us": f"{recent.quantile(0.5) / NS_PER_US:.0f}",
                "lateness_recent_p99_us": f"{recent.quantile(0.99) / NS_PER_US:.0f}",
                "lateness_recent_max_us": f"{recent.maximum / NS_PER_US:.0f}",
            }
        return self._figures


class Health:
    """Writes the log and publishes a diagnostic status, when there is news and once a second.

    `startup` are monotonic instants by name, "exec" first. Use as a context: leaving it says the last word.
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
        self._fixed = {
            "board": board.name if board else own_name(),
            "boot_id": process.boot_id(),
            "cores": str(os.cpu_count()),
            "ram_mib": f"{process.ram_mib():.0f}",
            "python": sys.version.split()[0],
            "bytecode_compiled": str(process.bytecode_compiled("hil")).lower(),
            "exec_wall_ns": str(to_wall_ns(startup["exec"])),
            "realtime": "; ".join(notes),
            "link_protocol": link.protocol,
            "link_baud": str(link.baud),
            **{f"startup_{name}_ms": f"{(t - startup['exec']) / NS_PER_MS:.1f}" for name, t in startup.items()},
        }
        self._tree, self._board = Tree(), board
        self._recent = RecentLateness()
        self._memory = process.Memory()
        self._news = log.news  # the inbox's too
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="health", daemon=True)

    def __enter__(self) -> None:
        self._thread.start()

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        self._news.set()
        self._thread.join(1.0)  # it may be stuck in writing to a terminal that nobody reads
        self._publish()
        self._log.flush()

    def values(self) -> dict[str, str]:
        """The figures of this moment, as they are published."""
        loop = self._loop
        children = loop.driver.children + (self._imaging.children if self._imaging else ())
        lateness, skipped = loop.schedule.lateness, loop.schedule.skipped
        wall_ns = max(now_ns() - loop.started_ns, 1)
        values = self._fixed | {
            "uptime_s": f"{(now_ns() - self._startup['exec']) / NS_PER_S:.2f}",
            "cpu_s": f"{process.own_cpu_s(children):.4f}",
            "pss_mib": f"{self._memory.pss_mib(children):.2f}",
            "rss_mib": f"{process.resident_mib() + sum(map(process.resident_mib, children)):.2f}",
            "processes": str(1 + len(children)),
            "real_time_factor": f"{loop.schedule.due_total * loop.schedule.period_ns / wall_ns:.4f}",
            "loop_rate_hz": f"{NS_PER_S / loop.schedule.period_ns:.0f}",
            "lateness_p50_us": f"{lateness.quantile(0.5) / NS_PER_US:.0f}",
            "lateness_p99_us": f"{lateness.quantile(0.99) / NS_PER_US:.0f}",
            "lateness_p999_us": f"{lateness.quantile(0.999) / NS_PER_US:.0f}",
            "lateness_max_us": f"{lateness.maximum / NS_PER_US:.0f}",
            **self._recent.figures(lateness, now_ns()),
            "within_2ms": f"{lateness.share_within(2 * NS_PER_MS):.5f}",
            "behind_ms": f"{(wall_ns - (loop.schedule.due_total + skipped) * loop.schedule.period_ns) / NS_PER_MS:.2f}",
            "steps_skipped": str(skipped),
            "messages_sent": str(loop.outbox.sent),
            "contacts": str(loop.simulation.contacts),
        }
        values |= machine_figures(self._tree, self._board)
        pictures = self._imaging.figures() if self._imaging else {}
        return values | self._command_figures() | self._link_figures() | self._contacts.figures() | pictures

    def _command_figures(self) -> dict[str, str]:
        loop, inbox = self._loop, self._loop.inbox
        return {
            "commands_received": str(inbox.received),
            "commands_taken": str(loop.commands),
            "commands_malformed": str(inbox.malformed),
            "commands_stale": str(inbox.stale),
            "commands_disordered": str(inbox.disordered),
            "commands_superseded": str(inbox.superseded),
            "commands_refused": str(inbox.refused),
            "commands_flooded": str(inbox.flooded),
            "commands_fault": inbox.fault,
            "controller": "builtin" if loop.pilot else "external",
            "armed": str(loop.armed).lower(),
            "thrusters": str(inbox.thrusters),
            "commands_unanswered": str(loop.unanswered),
            "deadman_trips": str(loop.pilot.deadman_trips if loop.pilot else 0),
            "watchdog_trips": str(loop.watchdog_trips),
        }

    def _link_figures(self) -> dict[str, str]:
        driver = self._loop.driver
        figures = {
            "link_port": driver.port,
            "link_losses": str(driver.losses),
            "stm32_silent": str(driver.silent).lower(),
            "pwm_us": " ".join(map(str, driver.pwm_us)),
        }
        if driver.host:
            counters = driver.host.counters
            figures |= {f"link_{name}": str(getattr(counters, name)) for name in counters.__slots__}
        return figures

    def _publish(self) -> None:
        self._loop.outbox.diagnostics("slave", *self._state(), self.values())

    def _state(self) -> tuple[int, str]:
        """The level of the status, and its words."""
        driver, pilot = self._loop.driver, self._loop.pilot
        if driver.lost:
            return ERROR, f"the thruster link {driver.port} is gone, thrusters neutral: connect it again"
        if driver.silent:
            return ERROR, f"the STM32 on {driver.port} does not answer: check wiring, baud, protocol"
        if pilot and not pilot.active:
            return WARNING, "waiting for commands, thrusters neutral"
        return OK, "running"

    def _run(self) -> None:
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
        self._fixed |= _labels(self._tree)
        collect_due_ns, heart = now_ns() + COLLECT_PERIOD_NS, Heartbeat()
        while not self._stop.wait(LEAST_PERIOD_S):
            self._news.wait(PERIOD_S - LEAST_PERIOD_S)
            self._news.clear()
            self._log.flush()
            heart.beat(self._loop.schedule.due_total)
            self._publish()
            if now_ns() >= collect_due_ns:
                gc.collect()  # the loop has switched automatic collection off
                collect_due_ns = now_ns() + COLLECT_PERIOD_NS


def _labels(tree: Tree) -> dict[str, str]:
    """What makes the figures of this machine stand for something else; asked for when the start is over."""
    from boards.emulation import labels

    found = labels(tree, os.uname().machine)
    return {"labels": "; ".join(found)} if found else {}
