"""Who plays the STM32, as the slave sees it: something on a link that turns commands into pulse widths.

"python"   the firmware's Python twin in this process, on a pty
"process"  the same in a process of its own
"device"   a real STM32 on a UART; the pulse widths are what its telemetry says it applies
"""

import os
import select
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence

from hil.clock import NS_PER_S, NS_PER_US, now_ns, seconds_ns
from hil.config import Link
from hil.errors import DeviceError
from hil.links.contract import PWM_NEUTRAL_US, Protocol, ThrusterCommand, ThrusterLink, ThrusterTelemetry
from hil.links.protocols import Role, open_protocol
from hil.links.wires import PtyHostWire, PtyWire, UartWire


class ThrusterDriver(ABC):
    """The STM32 at the end of the slave's link.

    `pwm_us` is what the thrusters get now; `port` the path another program may open to command them;
    `children` the process ids that belong to it.
    """

    port: str
    host: ThrusterLink | None
    children: tuple[int, ...] = ()

    @property
    @abstractmethod
    def pwm_us(self) -> Sequence[int]:
        """Pulse widths in effect, microseconds, one a thruster."""

    @property
    @abstractmethod
    def deadline_ns(self) -> int:
        """When (monotonic ns) `service` has to be called even if no byte came."""

    @abstractmethod
    def descriptors(self) -> list[int]:
        """What to wait on for incoming bytes."""

    @abstractmethod
    def service(self, now: int) -> list[ThrusterTelemetry]:
        """Do what is due at `now` (monotonic ns); the telemetry that has reached the host end."""

    @abstractmethod
    def applied_ns(self, telemetry: ThrusterTelemetry, now: int) -> int:
        """When (monotonic ns) the STM32 applied the command that this telemetry, received at `now`, echoes."""

    def send(self, command: ThrusterCommand) -> None:
        """Send `command` from the host's end. Only where the controller is ours."""
        assert self.host is not None
        self.host.send(command)

    @abstractmethod
    def close(self) -> None:
        """End it and give the devices back."""


def _protocol(link: Link, role: Role, channels: int) -> Protocol:
    return open_protocol(link.protocol, role, channels, **({"frame": link.frame} if link.protocol == "frame" else {}))


def _telemetry(link: ThrusterLink) -> list[ThrusterTelemetry]:
    return [message for message in link.receive() if isinstance(message, ThrusterTelemetry)]


class InSlave(ThrusterDriver):
    """The STM32's Python twin in this process. With `host` false the port is left to another program."""

    def __init__(self, link: Link, channels: int, host: bool = True) -> None:
        from firmware_stub.stub import Stm32, Stm32End

        wire = PtyWire(link.device)
        self.end = Stm32End(
            Stm32(channels, seconds_ns(link.watchdog)), ThrusterLink(wire, _protocol(link, "device", channels))
        )
        self.port = wire.name
        self.host = ThrusterLink(PtyHostWire(wire.path), _protocol(link, "host", channels)) if host else None

    @property
    def pwm_us(self) -> Sequence[int]:
        """Straight from the timers."""
        return self.end.stm32.pwm_us

    @property
    def deadline_ns(self) -> int:
        """Watchdog or telemetry of the firmware."""
        return self.end.deadline_ns

    def descriptors(self) -> list[int]:
        """Both ends of the pty."""
        fds = [self.end.fileno()]
        return [*fds, self.host.wire.fileno()] if self.host else fds

    def service(self, now: int) -> list[ThrusterTelemetry]:
        """Let the firmware read, apply and answer; then read its answer."""
        self.end.service(now)
        return _telemetry(self.host) if self.host else []

    def applied_ns(self, telemetry: ThrusterTelemetry, now: int) -> int:
        """The twin knows the instant itself, for its last command."""
        stm32 = self.end.stm32
        return stm32.applied_ns if telemetry.sequence == stm32.sequence else now - telemetry.age_us * NS_PER_US

    def close(self) -> None:
        """Close both ends; the link to the pty is removed."""
        if self.host:
            self.host.close()
        self.end.close()


class OnWire(ThrusterDriver):
    """An STM32 that is seen only through its link: a real one, or the twin in another process.

    Silent for longer than its watchdog, it is taken to have gone to neutral, which is what the watchdog
    does. `applied_ns` is an upper bound: it includes the way of the telemetry back.
    """

    def __init__(self, host: ThrusterLink, link: Link, channels: int) -> None:
        self.host: ThrusterLink = host
        self.port = host.wire.name
        self._neutral = (PWM_NEUTRAL_US,) * channels
        self._pwm_us: tuple[int, ...] = self._neutral
        self._silence_ns = seconds_ns(link.watchdog)
        self._heard_ns = now_ns()

    @property
    def pwm_us(self) -> Sequence[int]:
        """As the last telemetry said."""
        return self._pwm_us

    @property
    def deadline_ns(self) -> int:
        """When its silence has to be noticed."""
        return self._heard_ns + self._silence_ns

    def descriptors(self) -> list[int]:
        """The host's end."""
        return [self.host.wire.fileno()]

    def service(self, now: int) -> list[ThrusterTelemetry]:
        """Read telemetry, or notice its absence."""
        heard = [t for t in _telemetry(self.host) if len(t.pwm_us) == len(self._neutral)]
        if heard:
            self._pwm_us = heard[-1].pwm_us
            self._heard_ns = now
        elif now - self._heard_ns > self._silence_ns:
            self._pwm_us = self._neutral
        return heard

    def applied_ns(self, telemetry: ThrusterTelemetry, now: int) -> int:
        """Received, minus the age the STM32 gives."""
        return now - telemetry.age_us * NS_PER_US

    def close(self) -> None:
        """Close the wire."""
        self.host.close()


class InProcess(OnWire):
    """The STM32's Python twin as a process of its own, reached by a pty it makes."""

    def __init__(self, link: Link, channels: int) -> None:
        import subprocess
        import sys

        path = link.device or os.path.join(os.environ.get("XDG_RUNTIME_DIR", "/tmp"), f"uuv-hil-stm32-{os.getpid()}")
        command = [sys.executable, "-m", "firmware_stub.serve", "--device", path, "--frame", link.frame]
        command += ["--channels", str(channels), "--watchdog", f"{link.watchdog} s"]
        self._process = subprocess.Popen(command, stdout=subprocess.PIPE, start_new_session=True)
        self.children = (self._process.pid,)
        if not self._first_line():
            self._process.wait()
            raise DeviceError("the STM32 process ended before it served; its message stands above")
        super().__init__(ThrusterLink(PtyHostWire(path), _protocol(link, "host", channels)), link, channels)

    def _first_line(self) -> bytes:
        assert self._process.stdout is not None
        line: bytes = self._process.stdout.readline()
        return line

    def close(self) -> None:
        """Close the wire and end the process."""
        super().close()
        self._process.terminate()
        self._process.wait(5)
        if self._process.stdout:
            self._process.stdout.close()


def _on_uart(link: Link, channels: int) -> ThrusterDriver:
    if not link.device:
        raise DeviceError('no serial device: set [link] device = "/dev/..." or name the board with --board')
    return OnWire(ThrusterLink(UartWire(link.device, link.baud), _protocol(link, "host", channels)), link, channels)


# the word in the scenario -> who then plays the STM32
DRIVERS: dict[str, Callable[[Link, int], ThrusterDriver]] = {
    "python": InSlave,
    "process": InProcess,
    "device": _on_uart,
}


def open_driver(kind: str, link: Link, channels: int, host: bool) -> ThrusterDriver:
    """The STM32 of that kind (see the module) for `channels` thrusters. Raises DeviceError.

    With `host` false the host's end of the link is left to another program; only "python" can do that.
    """
    return DRIVERS[kind](link, channels) if host else InSlave(link, channels, host=False)


SETTLE_NS = NS_PER_S // 10


def stop_thrusters(driver: ThrusterDriver, sequence: int) -> bool:
    """Disarm and wait up to 0.1 s until every thruster is neutral; whether it came to that."""
    try:
        return _stop_thrusters(driver, sequence)
    except DeviceError:  # the link is gone: the STM32's watchdog does it, unseen
        return False


def _stop_thrusters(driver: ThrusterDriver, sequence: int) -> bool:
    channels = len(driver.pwm_us)
    deadline = now_ns() + SETTLE_NS
    if driver.host:
        driver.send(ThrusterCommand(sequence & 0xFFFF, False, (PWM_NEUTRAL_US,) * channels))
    while any(pulse != PWM_NEUTRAL_US for pulse in driver.pwm_us):
        left = deadline - now_ns()
        if left <= 0:
            return False
        select.select(driver.descriptors(), [], [], left / NS_PER_S)
        driver.service(now_ns())
    return True
