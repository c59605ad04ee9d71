"""Drive an STM32 in the slave's own process: the firmware in Python or C, or its image on an emulated processor."""

from hil.common.clock import NS_PER_US, now_ns, seconds_ns
from hil.common.errors import HilError
from hil.links.address import open_address, parse_address
from hil.links.contract import Counters, ThrusterLink, ThrusterTelemetry, Wire
from hil.scenario.records import Link
from hil.slave.drivers.driver import ThrusterDriver
from hil.slave.drivers.ends import DeviceEnd, Ends, end_protocol, host_end, telemetry_of, with_faults
from hil.slave.native.firmware import open_firmware


class InProcessDriver(ThrusterDriver):
    """Driver of the device's end and, with our own controller, of the host's end; a real wire connects the two."""

    @property
    def command_ns(self) -> int:  # type: ignore[override]
        """Monotonic time (ns) at which the firmware's outputs last applied a command."""
        return self.device.command_ns

    def applied_ns(self, telemetry: ThrusterTelemetry, now: int) -> int:
        """Return the monotonic time (ns) at which the outputs applied the echoed command.

        If they have applied a later command since, this is the receive time minus the age in the telemetry.
        """
        return min(self.device.command_ns, self._received_ns - telemetry.age_us * NS_PER_US)

    def _attach(self, ends: Ends) -> None:
        super()._attach(ends)
        assert ends.device is not None
        self.device = ends.device
        self._received_ns = 0

    def _due_ns(self) -> int:
        """Return the monotonic time (ns) at which the firmware or the host's protocol has to act next."""
        return min(self.device.deadline_ns, self.host.deadline_ns) if self.host else self.device.deadline_ns

    def _exchange(self, now: int) -> list[ThrusterTelemetry]:
        """Let the firmware read, apply and answer commands; then read its answer."""
        device, host = self.device, self.host
        device.service(now)
        self.pwm_us = tuple(device.pwm_us)
        if host is None:
            return []
        host.tick(now)
        telemetry = telemetry_of(host)
        self._received_ns = now_ns()
        return telemetry


def open_python(link: Link, channels: int, seed: int, host: bool) -> Ends:
    """Open the firmware in Python with its watchdog, or in C if possible. Raises DeviceError, MissingExtraError."""
    protocol = end_protocol(link, "device", channels)
    wire, faulty = _device_wire(link, seed, host, protocol.counters)
    watchdog_ns = seconds_ns(link.watchdog)
    end: DeviceEnd | None = open_firmware(protocol, faulty, channels, watchdog_ns)
    if end is None:
        from firmware_stub.stub import Stm32, Stm32End

        end = Stm32End(Stm32(channels, watchdog_ns), ThrusterLink(faulty, protocol))
    return _in_slave(end, wire, link, channels, seed, host)


def open_unicorn(link: Link, channels: int, seed: int, host: bool) -> Ends:
    """Open the firmware's image on an emulated processor. Raises DeviceError, MissingExtraError."""
    from firmware_stub.unicorn_board import UnicornBoard, UnicornEnd, shipped_image

    board = UnicornBoard(shipped_image(), channels, seconds_ns(link.watchdog))
    wire, faulty = _device_wire(link, seed, host, Counters())
    end = UnicornEnd(board, faulty, can=parse_address(link.port).carries_can)
    return _in_slave(end, wire, link, channels, seed, host)


def _in_slave(end: DeviceEnd, wire: Wire, link: Link, channels: int, seed: int, host: bool) -> Ends:
    """Return the open ends of a link whose device end is in this process; with the host's end if `host` is true."""
    try:
        return Ends(wire.name, _host(link, channels, seed, wire) if host else None, end)
    except HilError:
        end.close()
        raise


def _device_wire(link: Link, seed: int, host: bool, counters: Counters) -> tuple[Wire, Wire]:
    """Return the device's wire, and how the device's end reads it.

    Our host end applies the link's faults itself, and is suspended together with the device's end. Another program goes
    on sending meanwhile.
    """
    wire = open_address(link.port, "device", link.baud, link.bitrate)
    if host:
        return wire, wire
    from hil.links.wires.suspension import SuspendableWire  # most slaves do not need it

    return wire, SuspendableWire(with_faults(wire, link, seed), seconds_ns(link.watchdog), counters)


def _host(link: Link, channels: int, seed: int, device: Wire) -> ThrusterLink:
    """Open the host's end of the wire whose device end has just been opened."""
    path = getattr(device, "path", None)
    wire = open_address(f"pty:{path}" if path else device.name, "host", link.baud, link.bitrate)
    return host_end(wire, link, channels, seed)
