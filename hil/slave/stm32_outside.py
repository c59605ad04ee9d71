"""An STM32 that is seen only through its link: a real one, or the firmware in another process."""

import os
from collections.abc import Callable, Sequence
from typing import Protocol

from hil.clock import NS_PER_US, now_ns, seconds_ns
from hil.config import Link
from hil.errors import ConfigError
from hil.links.address import open_address, parse_address
from hil.links.contract import PWM_NEUTRAL_US, ThrusterLink, ThrusterTelemetry, Wire
from hil.slave.stm32 import ThrusterDriver, host_end, telemetry_of


class Process(Protocol):
    """A process that plays an STM32: firmware_stub's Child, NativeStm32, QemuStm32."""

    pid: int

    def close(self) -> object:
        """End it."""


class OnWire(ThrusterDriver):
    """What is at the other end of `wire`; `process` plays it, unless it is a real one.

    Silent for longer than its watchdog, it is taken to have gone to neutral, which is what the watchdog
    does. `applied_ns` is an upper bound: it includes the way of the telemetry back.
    """

    def __init__(self, wire: Wire, link: Link, channels: int, seed: int, process: Process | None = None) -> None:
        self.port = wire.name
        self.host: ThrusterLink = host_end(wire, link, channels, seed)
        self.children = (process.pid,) if process else ()
        self._process = process
        self._descriptors = [self.host.wire.fileno()]
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
        """When its silence has to be noticed, or the protocol has something to say."""
        return min(self._heard_ns + self._silence_ns, self.host.protocol.deadline_ns)

    def descriptors(self) -> list[int]:
        """The host's end."""
        return self._descriptors

    def service(self, now: int) -> list[ThrusterTelemetry]:
        """Read telemetry, or notice its absence."""
        self.host.tick(now)
        heard = [t for t in telemetry_of(self.host) if len(t.pwm_us) == len(self._neutral)]
        if heard:
            self._pwm_us = heard[-1].pwm_us
            self._heard_ns = now
        elif now - self._heard_ns > self._silence_ns:
            self._pwm_us = self._neutral
            self._heard_ns = now  # to be noticed again a watchdog's time later, not at once
        return heard

    def applied_ns(self, telemetry: ThrusterTelemetry, now: int) -> int:
        """Received, minus the age the STM32 gives."""
        return now - telemetry.age_us * NS_PER_US

    def close(self) -> None:
        """Close the wire, and end the process."""
        self.host.close()
        if self._process:
            self._process.close()


def open_device(link: Link, channels: int, seed: int, host: bool) -> ThrusterDriver:
    """A real STM32 at the link's address. Raises ConfigError, DeviceError, MissingExtraError."""
    if parse_address(link.port).kind == "pty":
        raise ConfigError('no device: set [link] port = "/dev/..." or another address, or name the board with --board')
    return OnWire(open_address(link.port, "host", link.baud, link.bitrate), link, channels, seed)


def open_process(link: Link, channels: int, seed: int, host: bool) -> ThrusterDriver:
    """The Python twin as a process of its own. Raises DeviceError."""
    import sys

    from firmware_stub.child import Child

    port = link.port if parse_address(link.port).place else f"pty:{_private_path()}"
    command = [sys.executable, "-m", "firmware_stub.serve", "--port", port, "--protocol", link.protocol, "--quiet"]
    command += ["--frame", link.frame, "--baud", str(link.baud), "--bitrate", str(link.bitrate)]
    command += ["--channels", str(channels), "--watchdog", f"{link.watchdog} s"]
    for key, value in link.options.items():
        command += ["--option", f"{key}={value}"]
    stm32 = Child(command)
    return _reached(stm32, lambda: open_address(port, "host", link.baud, link.bitrate), link, channels, seed)


def open_native(link: Link, channels: int, seed: int, host: bool) -> ThrusterDriver:
    """The firmware in C as a process of this machine, on a pty. Raises DeviceError."""
    from firmware_stub.native import NativeStm32

    path = parse_address(link.port).place or _private_path()
    stm32 = NativeStm32(path, channels, link.watchdog)
    return _reached(stm32, lambda: open_address(f"pty:{path}", "host"), link, channels, seed)


def open_qemu(link: Link, channels: int, seed: int, host: bool) -> ThrusterDriver:
    """The firmware's image on QEMU's STM32F405. Raises DeviceError."""
    from firmware_stub.qemu import QemuStm32

    stm32 = QemuStm32(channels, link.watchdog)
    return _reached(stm32, lambda: stm32.wire, link, channels, seed)


def _reached(stm32: Process, open_wire: Callable[[], Wire], link: Link, channels: int, seed: int) -> OnWire:
    """What that process plays; it is ended if it cannot be reached."""
    try:
        return OnWire(open_wire(), link, channels, seed, stm32)
    except BaseException:
        stm32.close()
        raise


def _private_path() -> str:
    return os.path.join(os.environ.get("XDG_RUNTIME_DIR", "/tmp"), f"uuv-hil-stm32-{os.getpid()}")
