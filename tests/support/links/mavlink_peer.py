"""A plain pymavlink peer of the link ends, and a clock that a test sets."""

from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as dialect

from firmware_stub.stub import Stm32
from hil.links.contract import Message, ThrusterCommand
from hil.links.mavlink.device import MavlinkDevice
from hil.links.mavlink.host import MavlinkHost
from hil.links.mavlink.link import open_mavlink

MS = 1_000_000
KEY = bytes(range(32))


class Clock:
    """`now` is the time in ns."""

    def __init__(self, now: int = 0) -> None:
        self.now = now

    def __call__(self) -> int:
        return self.now


class Peer:
    """A packer and parser that uses only pymavlink."""

    def __init__(self, system: int = 255, component: int = 190) -> None:
        self.mavlink = dialect.MAVLink(None, system, component)
        self.mavlink.robust_parsing = True

    def pack(self, message: Any) -> bytes:
        packet: bytes = message.pack(self.mavlink)
        self.mavlink.seq = (self.mavlink.seq + 1) % 256
        return packet

    def parse(self, data: bytes) -> list[Any]:
        return list(self.mavlink.parse_buffer(data) or []) if data else []

    def names(self, data: bytes) -> list[str]:
        return [message.get_type() for message in self.parse(data)]

    def long(self, command: int, *params: float, system: int = 1, component: int = 1) -> bytes:
        """Return a COMMAND_LONG to the device."""
        seven = [*params, *[0.0] * (7 - len(params))]
        return self.pack(dialect.MAVLink_command_long_message(system, component, command, 0, *seven))

    def arm(self, armed: bool = True) -> bytes:
        return self.long(dialect.MAV_CMD_COMPONENT_ARM_DISARM, float(armed))

    def servos(self, pulses: list[int], port: int = 0) -> bytes:
        return self.pack(dialect.MAVLink_servo_output_raw_message(0, port, *pulses, *[0] * (16 - len(pulses))))


def host_end(channels: int = 4, **settings: Any) -> MavlinkHost:
    end = open_mavlink("host", channels, **settings)
    assert isinstance(end, MavlinkHost)
    return end


def device_end(channels: int = 4, **settings: Any) -> MavlinkDevice:
    end = open_mavlink("device", channels, **settings)
    assert isinstance(end, MavlinkDevice)
    return end


class Board:
    """An STM32 with the device's end, without a wire; served as by `Stm32End`, and also at its deadlines."""

    def __init__(self, channels: int = 4, watchdog_ms: int = 200, **settings: Any) -> None:
        self.clock = Clock()
        self.end = device_end(channels, clock=self.clock, **settings)
        self.stm32 = Stm32(channels, watchdog_ms * MS, 10**12)
        self.take()  # the report of power-up
        self.end.tick(0)  # the first heartbeat

    @property
    def pwm_us(self) -> list[int]:
        return self.stm32.pwm_us

    def take(self, data: bytes = b"") -> bytes:
        """Feed bytes; return its answers and reports."""
        output = b""
        messages: list[Message] = self.end.feed(data)
        output += self.end.replies()
        for message in messages:
            assert isinstance(message, ThrusterCommand)
            if self.stm32.command(message, self.clock.now):
                output += self.end.encode(self.stm32.telemetry(self.clock.now))
        if self.stm32.tick(self.clock.now):
            output += self.end.encode(self.stm32.telemetry(self.clock.now))
        return output

    def wait(self, ms: int) -> bytes:
        """Advance the time with wake-ups only at deadlines; return its output."""
        output = b""
        ends = self.clock.now + ms * MS
        while self.clock.now < ends:
            self.clock.now = min(ends, max(self.clock.now + 1, min(self.end.deadline_ns, self.stm32.deadline_ns)))
            output += self.take()
            if self.clock.now >= self.end.deadline_ns:
                output += self.end.tick(self.clock.now)
        return output
