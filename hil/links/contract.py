"""What every thruster link is made of: the messages, the wire, the protocol.

A link joins the vehicle's computer (the *host* end: it sends commands, it receives telemetry) to the
STM32 that drives the thrusters (the *device* end). Both ends use the same `Wire` and `Protocol`.
What comes off a wire never raises: it decodes, or it is counted in `Counters` and dropped.
"""

from abc import ABC, abstractmethod
from typing import NamedTuple

MAX_THRUSTERS = 16
PWM_NEUTRAL_US = 1500
PWM_MIN_US, PWM_MAX_US = 800, 2200  # a pulse outside is "no output", 0 included


class ThrusterCommand(NamedTuple):
    """What the host asks of the STM32: `pwm_us` pulse widths in microseconds, one a thruster.

    `armed` false asks for neutral outputs whatever `pwm_us` says. `sequence` (0..65535, wraps) comes
    back in the telemetry, which is how delay is measured.
    """

    sequence: int
    armed: bool
    pwm_us: tuple[int, ...]


class ThrusterTelemetry(NamedTuple):
    """What the STM32 reports: the pulse widths it now applies, and how it came to them.

    `sequence` is that of the last command applied; `age_us` the time between applying it and sending
    this message; `watchdog_trips`, `frames` and `errors` count since power-up and wrap at 65536.
    """

    sequence: int
    armed: bool
    timed_out: bool
    pwm_us: tuple[int, ...]
    age_us: int
    frames: int
    errors: int
    watchdog_trips: int


Message = ThrusterCommand | ThrusterTelemetry


class Counters:
    """What one end of a link has seen since it was opened."""

    __slots__ = (
        "bytes_in",
        "bytes_out",
        "checksum_errors",
        "dropped_bytes",
        "malformed",
        "messages_in",
        "messages_out",
    )

    def __init__(self) -> None:
        self.bytes_in = 0  # off the wire
        self.bytes_out = 0  # onto the wire
        self.messages_in = 0  # decoded
        self.messages_out = 0  # encoded
        self.checksum_errors = 0  # frames whose checksum was wrong
        self.malformed = 0  # checksum right, contents not (unknown message, impossible count)
        self.dropped_bytes = 0  # bytes between frames, or refused by a full wire


class Wire(ABC):
    """A two-way stream of bytes. Never blocks: what cannot be written now is dropped and counted."""

    name: str  # how a person calls it: a device path or an address

    @abstractmethod
    def fileno(self) -> int:
        """The descriptor to wait on for incoming bytes."""

    @abstractmethod
    def read(self) -> bytes:
        """The bytes that have come in, or b"" if none. Raises DeviceError when the device is gone."""

    @abstractmethod
    def write(self, data: bytes) -> int:
        """Send `data`; the number of bytes the wire took. Raises DeviceError when the device is gone."""

    @abstractmethod
    def close(self) -> None:
        """Give the device back. Closing twice is harmless."""


class Protocol(ABC):
    """One end's encoder and decoder of messages; keeps what is left of an unfinished frame."""

    counters: Counters

    @abstractmethod
    def encode(self, message: Message) -> bytes:
        """The bytes of `message`."""

    @abstractmethod
    def feed(self, data: bytes) -> list[Message]:
        """The messages completed by `data`, in order. Never raises: noise is counted and dropped."""


class ThrusterLink:
    """One end of a link: a protocol on a wire."""

    def __init__(self, wire: Wire, protocol: Protocol) -> None:
        self.wire = wire
        self.protocol = protocol
        self.counters = protocol.counters

    def send(self, message: Message) -> None:
        """Encode `message` and write it. Raises DeviceError when the wire is gone."""
        data = self.protocol.encode(message)
        taken = self.wire.write(data)
        counters = self.counters
        counters.messages_out += 1
        counters.bytes_out += taken
        counters.dropped_bytes += len(data) - taken

    def receive(self) -> list[Message]:
        """All messages that have come in. Raises DeviceError when the wire is gone."""
        data = self.wire.read()
        if not data:
            return []
        self.counters.bytes_in += len(data)
        messages = self.protocol.feed(data)
        self.counters.messages_in += len(messages)
        return messages

    def close(self) -> None:
        """Close the wire."""
        self.wire.close()
