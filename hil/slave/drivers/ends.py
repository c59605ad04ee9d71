"""The ends of a thruster link that the slave has opened, and functions that open them."""

from collections.abc import Sequence
from contextlib import ExitStack
from typing import NamedTuple, Protocol

from hil.common.clock import seconds_ns
from hil.common.errors import ConfigError, HilError
from hil.links.address import parse_address
from hil.links.contract import Protocol as LinkProtocol
from hil.links.contract import ThrusterLink, ThrusterTelemetry, Wire
from hil.links.pace import EchoPace
from hil.links.protocols import Role, open_protocol
from hil.scenario.records import Link


class DeviceEnd(Protocol):
    """The STM32's end of a link: `Stm32End` and `UnicornEnd` of firmware_stub, `FirmwareEnd` of hil.slave.native."""

    wire: Wire

    @property
    def deadline_ns(self) -> int:
        """Monotonic time (ns) at which `service` has to be called even if no byte has arrived."""

    @property
    def pwm_us(self) -> Sequence[int]:
        """Pulse widths in effect, us."""

    @property
    def command_ns(self) -> int:
        """Monotonic time (ns) at which the outputs last applied a command."""

    def fileno(self) -> int:
        """Return the descriptor to wait on."""

    def service(self, now_ns: int) -> int | None:
        """Read commands, apply them, and answer."""

    def close(self) -> None:
        """Set the outputs to neutral and close the wire."""


class Process(Protocol):
    """A process that simulates an STM32: `Child` or `NativeStm32` of firmware_stub."""

    pid: int

    def close(self) -> object:
        """End the process."""


class Ends(NamedTuple):
    """Open resources of one thruster link.

    `port` is the path or address at which another program may command the thrusters. `host` is the end that sends
    commands; None if another program does. `device` is the STM32's end if that is in this process. `started` ends the
    process that simulates the STM32, whose id is in `children`, if there is one.
    """

    port: str
    host: ThrusterLink | None
    device: DeviceEnd | None = None
    children: tuple[int, ...] = ()
    started: ExitStack | None = None

    def close(self) -> None:
        """Close the host's end first and the simulated STM32 last."""
        for end in (self.host, self.device, self.started):
            if end:
                end.close()


def end_protocol(link: Link, role: Role, channels: int) -> LinkProtocol:
    """Return the link's protocol for the end `role`. Raises ConfigError, MissingExtraError."""
    if link.protocol != "frame":
        try:
            return open_protocol(link.protocol, role, channels, **link.options)
        except ConfigError as error:
            raise ConfigError(f"link: {error}") from None
    if link.options:
        names = ", ".join(link.options)
        raise ConfigError(f'link: options: {names}: protocol = "frame" has none; its layout is [link] frame')
    from hil.links.frame.protocol import open_frame

    return open_frame(role, channels, link.frame)


def check_line_rate(link: Link, channels: int, rate: float) -> None:
    """Raise ConfigError if the link is too slow for `rate` commands a second. Imports nothing if it has no speed."""
    address = parse_address(link.port)
    if link.faults is None and address.kind not in ("uart", "rs485", "can"):
        return
    from hil.links.line_rate import line_speed, validate_rate

    speed, key = line_speed(address, link.baud, link.bitrate, link.faults.baud if link.faults else 0)
    problem = validate_rate(end_protocol(link, "host", channels), channels, address, speed, rate) if speed else None
    if problem:
        raise ConfigError(f"link: {key}: {problem}")


def with_faults(wire: Wire, link: Link, seed: int) -> Wire:
    """Return `wire` with the scenario's link faults; unchanged if it has none."""
    if link.faults is None:
        return wire
    from hil.links.wires.faults import FaultyWire

    return FaultyWire(wire, link.faults, seed)


def host_end(wire: Wire, link: Link, channels: int, seed: int, reports_each: bool = True) -> ThrusterLink:
    """Return the host's end of the link on `wire`, with the link's faults. On an error `wire` is closed.

    `reports_each`: whether the STM32 is known to report each command, as our firmware does.
    Raises ConfigError, DeviceError, MissingExtraError.
    """
    try:
        protocol = end_protocol(link, "host", channels)
        pace = EchoPace(protocol.echoes_sequence, reports_each, seconds_ns(link.watchdog))
        return ThrusterLink(with_faults(wire, link, seed), protocol, pace)
    except HilError:
        wire.close()
        raise


def telemetry_of(link: ThrusterLink) -> list[ThrusterTelemetry]:
    """Return the telemetry messages that have arrived. Raises DeviceError."""
    return [message for message in link.receive() if isinstance(message, ThrusterTelemetry)]
