"""Drive an STM32 that is reached only through its link: a real one, or the firmware in another process."""

import os
from collections.abc import Callable
from contextlib import ExitStack

from hil.common.clock import NS_PER_US, now_ns
from hil.common.errors import ConfigError
from hil.common.scratch import ScratchFolder
from hil.links.address import open_address, parse_address
from hil.links.contract import ThrusterLink, ThrusterTelemetry, is_overtaken
from hil.scenario.records import Link
from hil.slave.drivers.driver import ThrusterDriver
from hil.slave.drivers.ends import Ends, Process, host_end, telemetry_of


class ExternalDriver(ThrusterDriver):
    """Driver of an STM32 at the other end of a wire: a real one, or a process that simulates it.

    If no telemetry arrives for the watchdog time, the outputs count as neutral, because the STM32's watchdog stops
    them. `applied_ns` is an upper bound: it includes the transport time of the telemetry.
    """

    host: ThrusterLink

    def applied_ns(self, telemetry: ThrusterTelemetry, now: int) -> int:
        """Return the time of reception minus the age that the STM32 reports."""
        return now - telemetry.age_us * NS_PER_US

    def _attach(self, ends: Ends) -> None:
        super()._attach(ends)
        self._newest: ThrusterTelemetry | None = None
        self._received_ns = now_ns()

    def _due_ns(self) -> int:
        """Return the monotonic time (ns) at which the watchdog expires or the protocol has something to send."""
        return min(self._received_ns + self._watchdog_ns, self.host.deadline_ns)

    def _exchange(self, now: int) -> list[ThrusterTelemetry]:
        """Read telemetry, or detect that none has arrived for the watchdog time."""
        self.host.tick(now)
        received = [t for t in telemetry_of(self.host) if len(t.pwm_us) == len(self._neutral)]
        for telemetry in received:
            if self._newest is None or not is_overtaken(telemetry, self._newest):
                self._newest = telemetry
                self.pwm_us = telemetry.pwm_us
        if received:
            self._received_ns = now
        elif now - self._received_ns > self._watchdog_ns:
            self.pwm_us = self._neutral
            self._received_ns = now  # the next check is due one watchdog time later, not at once
        return received


def open_device(link: Link, channels: int, seed: int, host: bool) -> Ends:
    """Open the link to a real STM32 at the link's address. Raises ConfigError, DeviceError, MissingExtraError."""
    if parse_address(link.port).kind == "pty":
        raise ConfigError('no device: set [link] port = "/dev/..." or another address, or name the board with --board')
    wire = open_address(link.port, "host", link.baud, link.bitrate)
    return Ends(wire.name, host_end(wire, link, channels, seed, reports_each=False))


def open_process(link: Link, channels: int, seed: int, host: bool) -> Ends:
    """Start the Python version of the firmware in its own process, and open the link to it. Raises DeviceError."""
    from firmware_stub.child import Child
    from hil.common.children import module_command, package_environment

    command = module_command("firmware_stub.serve", "--protocol", link.protocol, "--quiet")
    command += ["--frame", link.frame, "--baud", str(link.baud), "--bitrate", str(link.bitrate)]
    command += ["--channels", str(channels), "--watchdog", f"{link.watchdog} s"]
    for key, value in link.options.items():
        command += ["--option", f"{key}={value}"]
    return _start(link, channels, seed, lambda port: Child([*command, "--port", port], package_environment()))


def open_native(link: Link, channels: int, seed: int, host: bool) -> Ends:
    """Start the firmware in C as a process of this machine, and open the link to it on a pty. Raises DeviceError."""
    from firmware_stub.native import NativeStm32

    return _start(link, channels, seed, lambda port: NativeStm32(parse_address(port).target, channels, link.watchdog))


def _start(link: Link, channels: int, seed: int, start: Callable[[str], Process]) -> Ends:
    """Start the simulated STM32 at an address, and open the link to it; end all that was started if that fails.

    Without a path in the link's port that is a pty in a new scratch folder.
    """
    with ExitStack() as started:
        port = link.port
        if not parse_address(port).target:
            runtime = os.environ.get("XDG_RUNTIME_DIR", "")
            folder = ScratchFolder("stm32", runtime if os.access(runtime, os.W_OK) else "")
            started.callback(folder.close)
            port = f"pty:{folder.file('stm32')}"
        stm32 = start(port)
        started.callback(stm32.close)
        wire = open_address(port, "host", link.baud, link.bitrate)
        host = host_end(wire, link, channels, seed)
        return Ends(wire.name, host, children=(stm32.pid,), started=started.pop_all())
