"""Drive an STM32 in the slave's own process: the firmware in Python or C, or its image on an emulated processor."""

from collections.abc import Sequence
from typing import Protocol

from hil.common.clock import NS_PER_US, now_ns, seconds_ns
from hil.common.errors import HilError
from hil.links.address import open_address, parse_address
from hil.links.contract import ThrusterCommand, ThrusterLink, ThrusterTelemetry, Wire
from hil.scenario.records import Link
from hil.slave.drivers.driver import ThrusterDriver, end_protocol, host_end, telemetry_of, with_faults
from hil.slave.native.firmware import open_firmware


class DeviceEnd(Protocol):
    """The STM32's end of a link: firmware_stub's Stm32End, UnicornEnd; hil.slave.native's FirmwareEnd."""

    @property
    def deadline_ns(self) -> int:
        """When `service` has to be called even if no byte came."""

    @property
    def pwm_us(self) -> Sequence[int]:
        """Pulse widths in effect, us."""

    @property
    def command_ns(self) -> int:
        """When (monotonic ns) its outputs last took a command."""

    def fileno(self) -> int:
        """Return the descriptor to wait on."""

    def service(self, now_ns: int) -> int | None:
        """Let it read, apply and answer."""

    def close(self) -> None:
        """Outputs neutral, wire closed."""


class InProcessDriver(ThrusterDriver):
    """The device's end and, if the controller is ours, the host's end, on a real wire between them.

    With both ends ours on a bare pty nothing comes that was not written in `send` or `service`, and there is nothing to
    wait on: to look at a pty costs a loop that waits a tenth of its time.
    """

    def __init__(self, end: DeviceEnd, wire: Wire, host: ThrusterLink | None) -> None:
        self.end = end
        self.port = wire.name
        self.host = host
        self._received_ns = 0
        self._owing = False  # the host has said something that the device has not read
        self._descriptors = [] if _bare_pty(host) else [end.fileno()] + ([host.wire.fileno()] if host else [])

    @property
    def pwm_us(self) -> Sequence[int]:
        """Straight from the timers."""
        return self.end.pwm_us

    @property
    def command_ns(self) -> int:  # type: ignore[override]
        """Straight from the firmware."""
        return self.end.command_ns

    @property
    def deadline_ns(self) -> int:
        """Of the firmware, or of what the host's protocol says by itself; at once while the host has said something."""
        if self._owing:
            return 0
        return min(self.end.deadline_ns, self.host.deadline_ns) if self.host else self.end.deadline_ns

    def descriptors(self) -> list[int]:
        """Both ends of the wire, if what comes there has to be waited for."""
        return self._descriptors

    def send(self, command: ThrusterCommand) -> None:
        """As for any other; what is unread is read first: a pty would give that alone, the command a turn later."""
        if self._owing:
            self.end.service(now_ns())
        super().send(command)

    def service(self, now: int) -> list[ThrusterTelemetry]:
        """Let the firmware read, apply and answer; then read its answer."""
        self.end.service(now)
        host = self.host
        if host is None:
            return []
        bytes_before = host.counters.bytes_out
        host.tick(now)
        telemetry = telemetry_of(host)
        self._received_ns = now_ns()
        self._owing = host.counters.bytes_out != bytes_before
        return telemetry

    def applied_ns(self, telemetry: ThrusterTelemetry, now: int) -> int:
        """Return when the end's outputs took it.

        If they have taken another since: received, minus the telemetry's age.
        """
        return min(self.end.command_ns, self._received_ns - telemetry.age_us * NS_PER_US)

    def close(self) -> None:
        """Close both ends."""
        if self.host:
            self.host.close()
        self.end.close()


def _bare_pty(host: ThrusterLink | None) -> bool:
    if host is None:
        return False
    from hil.links.wires.terminal import PtyHostWire

    return isinstance(host.wire, PtyHostWire)


def open_python(link: Link, channels: int, seed: int, host: bool) -> ThrusterDriver:
    """Return the Python twin, with its watchdog, or its C where that can be. Raises DeviceError, MissingExtraError."""
    wire, faulty = _device_wire(link, seed, host)
    watchdog_ns, protocol = seconds_ns(link.watchdog), end_protocol(link, "device", channels)
    end: DeviceEnd | None = open_firmware(protocol, faulty, channels, watchdog_ns)
    if end is None:
        from firmware_stub.stub import Stm32, Stm32End

        end = Stm32End(Stm32(channels, watchdog_ns), ThrusterLink(faulty, protocol))
    return _in_slave(end, wire, link, channels, seed, host)


def open_unicorn(link: Link, channels: int, seed: int, host: bool) -> ThrusterDriver:
    """Return the firmware's image on an emulated processor. Raises DeviceError, MissingExtraError."""
    from firmware_stub.unicorn_board import UnicornBoard, UnicornEnd, shipped_image

    board = UnicornBoard(shipped_image(), channels, seconds_ns(link.watchdog))
    wire, faulty = _device_wire(link, seed, host)
    end = UnicornEnd(board, faulty, can=parse_address(link.port).carries_can)
    return _in_slave(end, wire, link, channels, seed, host)


def _in_slave(end: DeviceEnd, wire: Wire, link: Link, channels: int, seed: int, host: bool) -> InProcessDriver:
    """That end and the host's, if that is to be ours."""
    try:
        return InProcessDriver(end, wire, _host(link, channels, seed, wire) if host else None)
    except HilError:
        end.close()
        raise


def _device_wire(link: Link, seed: int, host: bool) -> tuple[Wire, Wire]:
    """Return the device's end, plain and as the firmware gets it: faults are at our host's end if we have one."""
    wire = open_address(link.port, "device", link.baud, link.bitrate)
    return wire, wire if host else with_faults(wire, link, seed)


def _host(link: Link, channels: int, seed: int, device: Wire) -> ThrusterLink:
    """Return the host's end of the wire that the device's end has just made."""
    path = getattr(device, "path", None)
    wire = open_address(f"pty:{path}" if path else device.name, "host", link.baud, link.bitrate)
    return host_end(wire, link, channels, seed)
