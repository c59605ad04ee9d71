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
from collections.abc import Callable, Sequence
from contextlib import suppress
from importlib import import_module

from hil.common.clock import NS_PER_S, now_ns
from hil.common.errors import ConfigError, DeviceError, HilError
from hil.links.address import parse_address
from hil.links.contract import PWM_NEUTRAL_US, Protocol, ThrusterCommand, ThrusterLink, ThrusterTelemetry, Wire
from hil.links.protocols import Role, open_protocol
from hil.scenario.records import Link

# the word in the scenario -> what opens it, given the link, the number of channels, the seed, and whether the host's
# end of the link is ours
DRIVERS = {
    "python": "hil.slave.drivers.in_process:open_python",
    "unicorn": "hil.slave.drivers.in_process:open_unicorn",
    "process": "hil.slave.drivers.external:open_process",
    "native": "hil.slave.drivers.external:open_native",
    "qemu": "hil.slave.drivers.external:open_qemu",
    "device": "hil.slave.drivers.external:open_device",
}
STARTED = ("process", "native", "qemu")  # those for which a process is started
SETTLE_NS = NS_PER_S // 10
CHECK_NS = NS_PER_S // 100  # between two looks while they settle, and while a link is opened again
RETRY_S = 0.25  # between two attempts to open a link that went away
# An attempt under way is waited for so long at the end: what it holds ends with us, but for a process it has started.
WIRE_END_S, PROCESS_END_S = 0.1, 20.0
SILENT_NS = NS_PER_S // 2  # without any answer to commands: then the STM32 counts as silent

Report = Callable[[str], None]


class ThrusterDriver(ABC):
    """The STM32 at the end of the slave's link.

    `pwm_us` is what the thrusters get now; `port` the path or address at which another program may command
    them; `children` the process ids that belong to it; `losses` how often its link has gone away, `lost` whether it
    is away; `silent` whether the STM32 does not answer although its link is there; `command_ns` when (monotonic) its
    outputs last took a command, 0 where that is not known: it is for an STM32 in this process.
    """

    command_ns = 0
    losses = 0
    lost = False
    is_silent = False

    port: str
    host: ThrusterLink | None
    children: tuple[int, ...] = ()

    @property
    @abstractmethod
    def pwm_us(self) -> Sequence[int]:
        """Pulse widths in effect, microseconds, one a channel."""

    @property
    @abstractmethod
    def deadline_ns(self) -> int:
        """When (monotonic ns) `service` has to be called even if no byte came."""

    @abstractmethod
    def descriptors(self) -> list[int]:
        """Return what to wait on for incoming bytes; it changes when a lost link comes back."""

    @abstractmethod
    def service(self, now: int) -> list[ThrusterTelemetry]:
        """Do what is due at `now` (monotonic ns); the telemetry that has reached the host end."""

    @abstractmethod
    def applied_ns(self, telemetry: ThrusterTelemetry, now: int) -> int:
        """Return when (monotonic ns) the STM32 applied the command that this telemetry, received at `now`, echoes."""

    def send(self, command: ThrusterCommand) -> None:
        """Send `command` from the host's end. Only where the controller is ours."""
        assert self.host is not None
        self.host.send(command)

    @abstractmethod
    def close(self) -> None:
        """End it and give the devices back."""


class _Opening:
    """A thread that closes a lost driver and opens it again until that works.

    The loop cannot: a connection, the name of a machine or the start of a process may take seconds.
    """

    def __init__(self, lost: ThrusterDriver, open_driver: Callable[[], ThrusterDriver]) -> None:
        self._lost, self._open = lost, open_driver
        self._opened: ThrusterDriver | None = None
        self._canceled = threading.Event()
        self._handing_over = threading.Lock()
        # As real-time as the loop that makes it, and so then is a process that it starts, as the lost one was.
        self._thread = threading.Thread(target=self._run, name="thruster link", daemon=True)
        self._thread.start()

    def opened_driver(self) -> ThrusterDriver | None:
        """Return the driver, once there is one."""
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


class ReconnectingDriver(ThrusterDriver):
    """A driver whose link may go away: then the thrusters are neutral, and it is opened again until that works.

    `report` is called once when the link is lost, with the reason, and once when it is back; likewise for an STM32 that
    does not answer.
    `end_s`: how long `close` waits for an attempt to open it that is under way.
    """

    def __init__(
        self, open_driver: Callable[[], ThrusterDriver], channels: int, report: Report, end_s: float = WIRE_END_S
    ) -> None:
        self._open = open_driver
        self._neutral = (PWM_NEUTRAL_US,) * channels
        self._report = report
        self._end_s = end_s
        self._driver: ThrusterDriver | None = open_driver()
        self._last = self._driver
        self._opening: _Opening | None = None  # while there is no driver
        self._lost_ns = self._check_ns = 0
        self._requested_ns = 0  # when the first command was sent that has had no answer yet; 0 if there is none

    @property
    def port(self) -> str:  # type: ignore[override]
        """Of the driver there is, or was last."""
        return self._last.port

    @property
    def host(self) -> ThrusterLink | None:  # type: ignore[override]
        """Of the driver there is, or was last."""
        return self._last.host

    @property
    def command_ns(self) -> int:  # type: ignore[override]
        """Of the driver there is, or was last."""
        return self._last.command_ns

    @property
    def children(self) -> tuple[int, ...]:  # type: ignore[override]
        """Of the driver there is."""
        driver = self._driver  # another thread asks
        return driver.children if driver else ()

    @property
    def lost(self) -> bool:  # type: ignore[override]
        """Whether there is no driver."""
        return self._driver is None

    @property
    def pwm_us(self) -> Sequence[int]:
        """Neutral while there is no link: that is what the STM32's watchdog does with a silent one."""
        driver = self._driver  # another thread asks too
        return driver.pwm_us if driver else self._neutral

    @property
    def deadline_ns(self) -> int:
        """The driver's, or that of the next look for one."""
        return self._driver.deadline_ns if self._driver else self._check_ns

    def descriptors(self) -> list[int]:
        """Return the driver's."""
        return self._driver.descriptors() if self._driver else []

    def service(self, now: int) -> list[ThrusterTelemetry]:
        """Return what the driver does, if there is one, or again one."""
        driver = self._driver or self._found(now)
        if driver is None:
            return []
        try:
            telemetry = driver.service(now)
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
        """To the driver if there is one; a command for a lost link is lost."""
        if self._driver is None:
            return
        self._requested_ns = self._requested_ns or now_ns()
        try:
            self._driver.send(command)
        except DeviceError as error:
            self._lose(error, now_ns())

    def applied_ns(self, telemetry: ThrusterTelemetry, now: int) -> int:
        """As the driver has it."""
        return self._last.applied_ns(telemetry, now)

    def close(self) -> None:
        """Close the driver, if there is one, and look for none any more."""
        if self._driver:
            self._driver.close()
        if self._opening:
            self._opening.cancel(self._end_s)

    def _answers(self, now: int) -> None:
        self.is_silent = False
        self._report(f"{self.port}: the STM32 answers, after {(now - self._requested_ns) / NS_PER_S:.1f} s")

    def _lose(self, error: DeviceError, now: int) -> None:
        assert self._driver is not None
        self._report(f"thruster link lost, the STM32's watchdog stops the thrusters: {error}")
        self.losses += 1
        self.is_silent, self._requested_ns = False, 0
        self._lost_ns, self._check_ns = now, now + CHECK_NS
        lost, self._driver = self._driver, None
        self._opening = _Opening(lost, self._open)

    def _found(self, now: int) -> ThrusterDriver | None:
        """Return the driver that has been opened again, if so."""
        self._check_ns = now + CHECK_NS
        found = self._opening.opened_driver() if self._opening else None
        if found:
            self._driver = self._last = found
            self._opening = None
            self._report(f"thruster link back after {(now - self._lost_ns) / NS_PER_S:.1f} s: {found.port}")
        return found


def open_driver(kind: str, link: Link, channels: int, host: bool, seed: int, report: Report) -> ThrusterDriver:
    """Return the STM32 of that kind (see the module) for so many channels. Raises DeviceError, MissingExtraError.

    With `host` false the host's end of the link is left to another program; only what runs in this process can
    do that. `seed` is that of the link's faults, if it has any. `report` is called when the link goes and comes.
    """
    module, _, name = DRIVERS[kind].partition(":")
    opener: Callable[[Link, int, int, bool], ThrusterDriver] = getattr(import_module(module), name)
    end_s = PROCESS_END_S if kind in STARTED else WIRE_END_S
    return ReconnectingDriver(lambda: opener(link, channels, seed, host), channels, report, end_s)


def end_protocol(link: Link, role: Role, channels: int) -> Protocol:
    """That end's protocol of the link. Raises ConfigError, MissingExtraError."""
    if link.protocol != "frame":
        return open_protocol(link.protocol, role, channels, **link.options)
    from hil.links.frame.protocol import open_frame

    return open_frame(role, channels, link.frame)


def check_line_rate(link: Link, channels: int, rate: float) -> None:
    """Raises ConfigError if the link's line cannot carry `rate` commands a second. Loads nothing if it has no speed."""
    address = parse_address(link.port)
    if link.faults is None and address.kind not in ("uart", "rs485", "can"):
        return
    from hil.links.line_rate import line_speed, validate_rate

    speed, key = line_speed(address, link.baud, link.bitrate, link.faults.baud if link.faults else 0)
    problem = validate_rate(end_protocol(link, "host", channels), channels, address, speed, rate) if speed else None
    if problem:
        raise ConfigError(f"link: {key}: {problem}")


def with_faults(wire: Wire, link: Link, seed: int) -> Wire:
    """`wire` with the faults that the scenario has in mind for the link."""
    if link.faults is None:
        return wire
    from hil.links.wires.faults import FaultyWire

    return FaultyWire(wire, link.faults, seed)


def host_end(wire: Wire, link: Link, channels: int, seed: int) -> ThrusterLink:
    """Return the host's end of the link, with its faults, on `wire`, which is closed if that cannot be.

    Raises ConfigError, DeviceError, MissingExtraError.
    """
    try:
        return ThrusterLink(with_faults(wire, link, seed), end_protocol(link, "host", channels))
    except HilError:
        wire.close()
        raise


def telemetry_of(link: ThrusterLink) -> list[ThrusterTelemetry]:
    """Return the telemetry among what has come in. Raises DeviceError."""
    return [message for message in link.receive() if isinstance(message, ThrusterTelemetry)]


def stop_thrusters(driver: ThrusterDriver, sequence: int) -> bool:
    """Disarm and wait up to 0.1 s until every thruster is neutral; whether it came to that.

    Where the controller is ours, the STM32 has to say so: it may not be there, and a lost link counts as neutral.
    """
    try:
        return _stop_thrusters(driver, sequence)
    except DeviceError:  # the link is gone: the STM32's watchdog does it, unseen
        return False


def _stop_thrusters(driver: ThrusterDriver, sequence: int) -> bool:
    channels = len(driver.pwm_us)
    deadline = now_ns() + SETTLE_NS
    if driver.host:
        driver.send(ThrusterCommand(sequence & 0xFFFF, False, (PWM_NEUTRAL_US,) * channels))
    while True:
        received = driver.service(now_ns())
        shown = [telemetry.pwm_us for telemetry in received] if driver.host else [driver.pwm_us]
        if shown and all(pulse == PWM_NEUTRAL_US for pulse in shown[-1]):
            return True
        left = deadline - now_ns()
        if left <= 0:
            return False
        select.select(driver.descriptors(), [], [], min(left, CHECK_NS) / NS_PER_S)
