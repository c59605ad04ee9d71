"""The interface between the slave and an STM32: commands go in, telemetry with pulse widths comes out.

Kinds of STM32, as named in the scenario:
"python"   the Python version of the firmware in this process; for its own frame protocol the C one, if compiled
"unicorn"  the firmware's binary image on an emulated STM32F405 in this process
"process"  the Python version in its own process
"native"   the firmware in C, compiled for this machine, in its own process
"device"   a real STM32; its telemetry reports the pulse widths that it applies
"""

import select
import threading
from abc import ABC, abstractmethod
from collections.abc import Callable
from contextlib import suppress
from importlib import import_module
from typing import TYPE_CHECKING

from hil.common.clock import NS_PER_S, now_ns, seconds_ns
from hil.common.errors import DeviceError, HilError
from hil.links.address import wire_kind
from hil.links.contract import PWM_NEUTRAL_US, ThrusterCommand, ThrusterTelemetry, has_restarted, is_overtaken
from hil.links.pace import LEAST_RATE, EchoPace
from hil.scenario.records import Link
from hil.slave.drivers.ends import Ends

if TYPE_CHECKING:
    from hil.ros.diagnostics import Diagnostics

# kind -> module, driver class, function that opens its link
DRIVERS = {
    "python": ("hil.slave.drivers.in_process", "InProcessDriver", "open_python"),
    "unicorn": ("hil.slave.drivers.in_process", "InProcessDriver", "open_unicorn"),
    "process": ("hil.slave.drivers.external", "ExternalDriver", "open_process"),
    "native": ("hil.slave.drivers.external", "ExternalDriver", "open_native"),
    "device": ("hil.slave.drivers.external", "ExternalDriver", "open_device"),
}
STARTED = ("process", "native")  # kinds for which a process is started
# At shutdown, the neutral command is repeated at this period until the STM32 confirms it or a timeout ends. The long
# timeout is for a busy machine, where the pty's carrier or the simulated STM32 waits for the processor. The short one
# is for an STM32 that does not answer.
REPEAT_NS, CONFIRM_NS, SETTLE_NS = NS_PER_S // 20, NS_PER_S, NS_PER_S // 10
CHECK_NS = NS_PER_S // 100  # polling period during shutdown and while a link is reopened
RETRY_S = 0.25  # between two attempts to reopen a lost link
# How long `close` waits for an attempt to reopen. What the attempt holds ends with this process, except for a process
# that it has started; that one needs time to be ended.
WIRE_END_S, PROCESS_END_S = 0.1, 20.0
SILENT_NS = NS_PER_S // 2  # without any answer to commands; after this the STM32 counts as silent

Report = Callable[[str], None]


class _Opening:
    """A thread that closes a lost link and tries to open it again until it succeeds.

    The loop cannot do this itself: to connect, to resolve a host name or to start a process may take seconds.
    """

    def __init__(self, lost: Ends, open_ends: Callable[[], Ends]) -> None:
        self._lost, self._open = lost, open_ends
        self._opened: Ends | None = None
        self._canceled = threading.Event()
        self._handing_over = threading.Lock()
        # The thread inherits the loop's real-time priority, and so does a process that it starts, as at the first
        # start.
        self._thread = threading.Thread(target=self._run, name="thruster link", daemon=True)
        self._thread.start()

    def opened_ends(self) -> Ends | None:
        """Return the link once it is open; None before."""
        return None if self._thread.is_alive() else self._opened

    def cancel(self, patience_s: float) -> None:
        """Stop trying. A link that is still being opened is closed when it is open; wait `patience_s` for that."""
        with self._handing_over:
            self._canceled.set()
        if self._opened:
            self._opened.close()
        self._thread.join(patience_s)

    def _run(self) -> None:
        with suppress(HilError, OSError):  # even the closing of a lost link may fail
            self._lost.close()
        while not self._canceled.wait(RETRY_S):
            try:
                opened = self._open()
            except (HilError, OSError):  # the loss was reported already; the retry is the only remedy
                continue
            with self._handing_over:
                if not self._canceled.is_set():
                    self._opened = opened
                    return
            opened.close()


class ThrusterDriver(ABC):
    """The STM32 at the end of the slave's link. A link that is lost is reopened until that succeeds.

    `open_ends` opens the link. An STM32 that gets no command goes to neutral after `watchdog_ns`. `report` is called
    once when the link is lost, with the reason, and once when it is back; likewise when the STM32 stops and resumes
    answering. `close` waits up to `end_s` seconds for an attempt to reopen the link.

    Attributes: `pwm_us`: pulse widths of the thrusters since the last `service`; neutral while the link is lost,
    because the STM32's watchdog then stops the thrusters. `descriptors`: what to wait on for incoming bytes; a new list
    when the link is lost or back. `port`, `host`: those of the current or last link, see `Ends`. `children`: ids of the
    link's processes. `losses`: how often the link was lost; `lost`: whether it is lost now. `is_silent`: whether the
    STM32 does not answer although the link is open. `command_ns`: when (monotonic) the outputs of an STM32 in this
    process last applied a command; 0 for any other STM32. `arming_refusal`: why commands must not arm the thrusters
    while the line is too slow for them; "" if they may. `newest`: the newest telemetry so far.
    """

    command_ns = 0
    losses = 0
    lost = False
    is_silent = False
    is_slow = False
    arming_refusal = ""
    newest: ThrusterTelemetry | None = None
    _lost_ns = _check_ns = 0
    children: tuple[int, ...]
    descriptors: list[int]
    pwm_us: tuple[int, ...]

    def __init__(
        self,
        open_ends: Callable[[], Ends],
        channels: int,
        watchdog_ns: int,
        report: Report,
        end_s: float = WIRE_END_S,
    ) -> None:
        self._open = open_ends
        self._watchdog_ns = watchdog_ns
        self._report = report
        self._end_s = end_s
        self._neutral = self.pwm_us = (PWM_NEUTRAL_US,) * channels
        self._opening: _Opening | None = None  # while the link is lost
        self._requested_ns = 0  # when the first unanswered command was sent; 0 if there is none
        self._attach(open_ends())

    @property
    def deadline_ns(self) -> int:
        """Time (monotonic ns) at which `service` has to be called even if no byte has arrived."""
        return self._check_ns if self.lost else self._due_ns()

    def service(self, now: int) -> list[ThrusterTelemetry]:
        """Do what is due at `now` (monotonic ns); return the telemetry that has reached the host's end."""
        if self.lost and not self._reopened(now):
            return []
        try:
            telemetry = self._exchange(now)
        except DeviceError as error:
            self._lose(error, now)
            return []
        if telemetry:
            if self.is_silent:
                self._answers(now)
            self._requested_ns = 0
            for report in telemetry:
                if self.newest is None or not is_overtaken(report, self.newest):
                    self._follow_stm32(report)
        elif self._requested_ns and now - self._requested_ns > SILENT_NS and not self.is_silent:
            self.is_silent = True
            self._report(
                f"{self.port}: the STM32 has not answered for {SILENT_NS / NS_PER_S:g} s; check wiring, baud, protocol"
            )
        if self.host and self.host.pace and self.host.pace.is_slow != self.is_slow:
            self._report_pace(self.host.pace)
        return telemetry

    def send(self, command: ThrusterCommand) -> None:
        """Send `command` from the host's end, which has to be ours; on a lost link it is dropped."""
        if self.lost:
            return
        self._requested_ns = self._requested_ns or now_ns()
        try:
            self._send(command)
        except DeviceError as error:
            self._lose(error, now_ns())

    @abstractmethod
    def applied_ns(self, telemetry: ThrusterTelemetry, now: int) -> int:
        """Return when (monotonic ns) the STM32 applied the command that this telemetry, received at `now`, echoes."""

    def problem(self) -> str:
        """Return why the STM32 cannot be reached, with the remedy; "" if it can."""
        if self.lost:
            return f"the thruster link {self.port} is lost, the STM32's watchdog stops the thrusters: connect it again"
        return f"the STM32 on {self.port} does not answer: check wiring, baud, protocol" if self.is_silent else ""

    def add_figures(self, figures: "Diagnostics") -> None:
        """Add the state of the link and its counters."""
        figures.link_port, figures.link_wire, figures.link_losses = self.port, wire_kind(self.port), self.losses
        figures.stm32_silent, figures.pwm_us = self.is_silent, self.pwm_us
        figures.watchdog_trips = self.newest.watchdog_trips if self.newest else 0
        if self.host:
            if self.host.pace:
                figures.link_slow, figures.link_rate_hz = self.is_slow, self.host.pace.rate
            counters = self.host.counters
            for name in counters.__slots__:
                figures[f"link_{name}"] = getattr(counters, name)
        end = self.host or self._ends.device
        sent, received = end.wire.fault_counts() if end else ({}, {})
        if sent:
            figures.link_faults_sent, figures.link_faults_received = sent, received

    def close(self) -> None:
        """Close the link, or stop trying to reopen it."""
        if self._opening:
            self._opening.cancel(self._end_s)
        else:
            self._ends.close()

    def _attach(self, ends: Ends) -> None:
        """Use a link that has just been opened."""
        self._ends = ends
        self.port, self.host = ends.port, ends.host
        self.children = ends.children
        self.descriptors = [end.fileno() for end in (ends.device, ends.host and ends.host.wire) if end]

    @abstractmethod
    def _due_ns(self) -> int:
        """Return the deadline (monotonic ns) while the link is open."""

    @abstractmethod
    def _exchange(self, now: int) -> list[ThrusterTelemetry]:
        """Do what is due while the link is open, and set `pwm_us`. Raises DeviceError when the link is lost."""

    def _send(self, command: ThrusterCommand) -> None:
        """Send while the link is open. Raises DeviceError when the link is lost."""
        assert self.host is not None
        self.host.send(command)

    def _report_pace(self, pace: EchoPace) -> None:
        """Report that the line has become slower than the commands, or fast enough."""
        self.is_slow, self.arming_refusal = pace.is_slow, ""
        if not pace.is_slow:
            self._report(f"{self.port}: the line carries all commands again")
            return
        self._report(
            f"{self.port}: the line carries {pace.rate:.0f} commands a second and not all: the newest are sent, others "
            "dropped; use a faster line or a longer control_period in [slave]"
        )
        if pace.rate < LEAST_RATE:
            self.arming_refusal = (
                f"{self.port}: the line carries {pace.rate:.0f} commands a second; at least {LEAST_RATE:g} are needed "
                "to arm the thrusters"
            )
            self._report(self.arming_refusal)

    def _follow_stm32(self, report: ThrusterTelemetry) -> None:
        """Store the newest telemetry; report a watchdog trip or a restart of the STM32."""
        if report.timed_out and not (self.newest and self.newest.timed_out):
            self._report("the STM32's watchdog tripped: thrusters neutral")
        if self.newest and has_restarted(report, self.newest):
            self._report("the STM32 has restarted")
        self.newest = report

    def _answers(self, now: int) -> None:
        self.is_silent = False
        self._report(f"{self.port}: the STM32 answers, after {(now - self._requested_ns) / NS_PER_S:.1f} s")

    def _lose(self, error: DeviceError, now: int) -> None:
        self._report(f"thruster link lost, the STM32's watchdog stops the thrusters: {error}")
        self.lost, self.is_silent, self._requested_ns = True, False, 0
        self.is_slow, self.arming_refusal = False, ""
        self.losses += 1
        self.children, self.descriptors, self.pwm_us = (), [], self._neutral
        self._lost_ns, self._check_ns = now, now + CHECK_NS
        self._opening = _Opening(self._ends, self._open)

    def _reopened(self, now: int) -> bool:
        """Return whether the link has been opened again."""
        self._check_ns = now + CHECK_NS
        ends = self._opening.opened_ends() if self._opening else None
        if ends is None:
            return False
        self.lost, self._opening = False, None
        self._attach(ends)
        self._report(f"thruster link back after {(now - self._lost_ns) / NS_PER_S:.1f} s: {ends.port}")
        return True


def open_driver(kind: str, link: Link, channels: int, host: bool, seed: int, report: Report) -> ThrusterDriver:
    """Return the driver of an STM32 of that kind (see the module) with `channels` outputs.

    If `host` is false, another program uses the host's end of the link; only kinds in this process allow that. `seed`
    is the seed of the link's faults. `report` is called when the link is lost or back.
    Raises DeviceError, MissingExtraError.
    """
    module, driver, opener = DRIVERS[kind]
    driver_class: type[ThrusterDriver] = getattr(import_module(module), driver)
    open_ends: Callable[[Link, int, int, bool], Ends] = getattr(import_module(module), opener)
    end_s = PROCESS_END_S if kind in STARTED else WIRE_END_S
    watchdog_ns = seconds_ns(link.watchdog)
    return driver_class(lambda: open_ends(link, channels, seed, host), channels, watchdog_ns, report, end_s)


def stop_thrusters(driver: ThrusterDriver, sequence: int) -> bool:
    """Disarm the thrusters; wait up to 1 s until all are neutral; return whether they are.

    With our own controller the STM32 has to confirm this by telemetry; a lost link counts as neutral, as the watchdog
    stops the thrusters. The wait is 0.1 s if the STM32 is lost, silent, or commanded by another program. `sequence` is
    the sequence number of the first command.
    """
    try:
        return _stop_thrusters(driver, sequence)
    except DeviceError:  # the link is lost: the STM32's watchdog stops the thrusters, but cannot confirm it
        return False


def _stop_thrusters(driver: ThrusterDriver, sequence: int) -> bool:
    neutral = ThrusterCommand(sequence & 0xFFFF, False, (PWM_NEUTRAL_US,) * len(driver.pwm_us))
    answers = bool(driver.host) and not (driver.lost or driver.is_silent)
    began = send_ns = now_ns()
    while True:
        now = now_ns()
        if driver.host and now >= send_ns:  # repeated, as a command may be lost
            driver.send(neutral)
            neutral = neutral._replace(sequence=neutral.sequence + 1 & 0xFFFF)
            send_ns = now + REPEAT_NS
        received = driver.service(now_ns())
        shown = [telemetry.pwm_us for telemetry in received] if driver.host else [driver.pwm_us]
        if shown and all(pulse == PWM_NEUTRAL_US for pulse in shown[-1]):
            return True
        left = began + (CONFIRM_NS if answers and not driver.lost else SETTLE_NS) - now_ns()
        if left <= 0:
            return False
        select.select(driver.descriptors, [], [], min(left, CHECK_NS) / NS_PER_S)
