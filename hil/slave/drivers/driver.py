"""The interface between the slave and an STM32: commands go in, telemetry with pulse widths comes out.

"python"   the firmware's Python twin in this process; on its own frame its C, where that was compiled
"unicorn"  the firmware's own image on an emulated STM32F405 in this process
"process"  the Python twin in a process of its own
"native"   the firmware in C as a process of this machine
"qemu"     the firmware's own image on QEMU's STM32F405
"device"   a real STM32; the pulse widths are what its telemetry says it applies
"""

import select
import threading
from abc import ABC, abstractmethod
from collections.abc import Callable
from contextlib import suppress
from importlib import import_module

from hil.common.clock import NS_PER_S, now_ns, seconds_ns
from hil.common.errors import DeviceError, HilError
from hil.links.contract import PWM_NEUTRAL_US, ThrusterCommand, ThrusterTelemetry, Wire
from hil.scenario.records import Link
from hil.slave.drivers.ends import Ends

# the word in the scenario -> the driver, and what opens its link
DRIVERS = {
    "python": ("hil.slave.drivers.in_process", "InProcessDriver", "open_python"),
    "unicorn": ("hil.slave.drivers.in_process", "InProcessDriver", "open_unicorn"),
    "process": ("hil.slave.drivers.external", "ExternalDriver", "open_process"),
    "native": ("hil.slave.drivers.external", "ExternalDriver", "open_native"),
    "qemu": ("hil.slave.drivers.external", "ExternalDriver", "open_qemu"),
    "device": ("hil.slave.drivers.external", "ExternalDriver", "open_device"),
}
STARTED = ("process", "native", "qemu")  # those for which a process is started
# At the end the neutral command is repeated so often, and the STM32 has so long to confirm it: on a busy machine what
# carries bytes through a pty, or plays the STM32, waits for the processor. One that does not answer has less time.
REPEAT_NS, CONFIRM_NS, SETTLE_NS = NS_PER_S // 20, NS_PER_S, NS_PER_S // 10
CHECK_NS = NS_PER_S // 100  # between two looks while they settle, and while a link is opened again
RETRY_S = 0.25  # between two attempts to open a link that went away
# An attempt under way is waited for so long at the end: what it holds ends with us, but for a process it has started.
WIRE_END_S, PROCESS_END_S = 0.1, 20.0
SILENT_NS = NS_PER_S // 2  # without any answer to commands: then the STM32 counts as silent

Report = Callable[[str], None]


class _Opening:
    """A thread that closes a lost link and opens it again until that works.

    The loop cannot: a connection, the name of a machine or the start of a process may take seconds.
    """

    def __init__(self, lost: Ends, open_ends: Callable[[], Ends]) -> None:
        self._lost, self._open = lost, open_ends
        self._opened: Ends | None = None
        self._canceled = threading.Event()
        self._handing_over = threading.Lock()
        # As real-time as the loop that makes it, and so then is a process that it starts, as the lost one was.
        self._thread = threading.Thread(target=self._run, name="thruster link", daemon=True)
        self._thread.start()

    def opened_ends(self) -> Ends | None:
        """Return the link, once it is open."""
        return None if self._thread.is_alive() else self._opened

    def cancel(self, patience_s: float) -> None:
        """Open none any more; what is being opened is closed as soon as it comes, which is waited for so long."""
        with self._handing_over:
            self._canceled.set()
        if self._opened:
            self._opened.close()
        self._thread.join(patience_s)

    def _run(self) -> None:
        with suppress(HilError, OSError):  # what is lost may not even close
            self._lost.close()
        while not self._canceled.wait(RETRY_S):
            try:
                opened = self._open()
            except (HilError, OSError):  # it has been reported; the reason may change, the remedy does not
                continue
            with self._handing_over:
                if not self._canceled.is_set():
                    self._opened = opened
                    return
            opened.close()


class ThrusterDriver(ABC):
    """The STM32 at the end of the slave's link, which may go away: it is opened again until that works.

    `open_ends` opens the link; an STM32 that gets no command goes to neutral after `watchdog_ns`. `report` is called
    once when the link is lost, with the reason, and once when it is back; likewise for an STM32 that does not answer.
    `end_s`: how long `close` waits for an attempt to open it that is under way.

    `pwm_us` is what the thrusters get since the last `service`: neutral while there is no link, which is what the
    STM32's watchdog does with a silent one. `descriptors` is what to wait on for incoming bytes: another list once the
    link is lost or back. `port` and `host` are those of the link there is, or was last, see `Ends`; `children` the
    process ids that belong to it; `losses` how often it has gone away, `lost` whether it is away; `is_silent` whether
    the STM32 does not answer although its link is there; `command_ns` when (monotonic) its outputs last took a command,
    0 where that is not known: it is for an STM32 in this process.
    """

    command_ns = 0
    losses = 0
    lost = False
    is_silent = False
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
        self._lost_ns = self._check_ns = 0
        self._requested_ns = 0  # when the first command was sent that has had no answer yet; 0 if there is none
        self._attach(open_ends())

    @property
    def wire(self) -> Wire | None:
        """Our end of the link's wire, with its faults: the host's, else the device's; None if neither is ours."""
        end = self.host or self._ends.device
        return end.wire if end else None

    @property
    def deadline_ns(self) -> int:
        """Return when (monotonic ns) `service` has to be called even if no byte came."""
        return self._check_ns if self.lost else self._due_ns()

    def service(self, now: int) -> list[ThrusterTelemetry]:
        """Do what is due at `now` (monotonic ns); the telemetry that has reached the host end."""
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
        elif self._requested_ns and now - self._requested_ns > SILENT_NS and not self.is_silent:
            self.is_silent = True
            self._report(
                f"{self.port}: the STM32 has not answered for {SILENT_NS / NS_PER_S:g} s; check wiring, baud, protocol"
            )
        return telemetry

    def send(self, command: ThrusterCommand) -> None:
        """Send `command` from the host's end, where that is ours; a command for a lost link is lost."""
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

    def close(self) -> None:
        """Give the devices back, or open none any more."""
        if self._opening:
            self._opening.cancel(self._end_s)
        else:
            self._ends.close()

    def _attach(self, ends: Ends) -> None:
        """Begin with what has been opened."""
        self._ends = ends
        self.port, self.host = ends.port, ends.host
        self.children = (ends.process.pid,) if ends.process else ()
        self.descriptors = [end.fileno() for end in (ends.device, ends.host and ends.host.wire) if end]

    @abstractmethod
    def _due_ns(self) -> int:
        """Return the deadline while the link is there."""

    @abstractmethod
    def _exchange(self, now: int) -> list[ThrusterTelemetry]:
        """Do what is due while the link is there, and set `pwm_us`. Raises DeviceError when it is lost."""

    def _send(self, command: ThrusterCommand) -> None:
        """Send while the link is there. Raises DeviceError when it is lost."""
        assert self.host is not None
        self.host.send(command)

    def _answers(self, now: int) -> None:
        self.is_silent = False
        self._report(f"{self.port}: the STM32 answers, after {(now - self._requested_ns) / NS_PER_S:.1f} s")

    def _lose(self, error: DeviceError, now: int) -> None:
        self._report(f"thruster link lost, the STM32's watchdog stops the thrusters: {error}")
        self.lost, self.is_silent, self._requested_ns = True, False, 0
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
    """Return the STM32 of that kind (see the module) for so many channels. Raises DeviceError, MissingExtraError.

    With `host` false the host's end of the link is left to another program; only what runs in this process can
    do that. `seed` is that of the link's faults, if it has any. `report` is called when the link goes and comes.
    """
    module, driver, opener = DRIVERS[kind]
    driver_class: type[ThrusterDriver] = getattr(import_module(module), driver)
    open_ends: Callable[[Link, int, int, bool], Ends] = getattr(import_module(module), opener)
    end_s = PROCESS_END_S if kind in STARTED else WIRE_END_S
    watchdog_ns = seconds_ns(link.watchdog)
    return driver_class(lambda: open_ends(link, channels, seed, host), channels, watchdog_ns, report, end_s)


def stop_thrusters(driver: ThrusterDriver, sequence: int) -> bool:
    """Disarm and wait up to 1 s until every thruster is neutral; return whether all are.

    Where the controller is ours, the STM32 has to say so: it may not be there, and a lost link counts as neutral. One
    that is lost or silent, or obeys another program, is given 0.1 s. `sequence` is that of the first command.
    """
    try:
        return _stop_thrusters(driver, sequence)
    except DeviceError:  # the link is gone: the STM32's watchdog does it, unseen
        return False


def _stop_thrusters(driver: ThrusterDriver, sequence: int) -> bool:
    neutral = ThrusterCommand(sequence & 0xFFFF, False, (PWM_NEUTRAL_US,) * len(driver.pwm_us))
    answers = bool(driver.host) and not (driver.lost or driver.is_silent)
    began = send_ns = now_ns()
    while True:
        now = now_ns()
        if driver.host and now >= send_ns:  # again and again: a command may be lost on its way
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
