"""What every thruster link is made of: the messages, the wire, the protocol.

A link joins the vehicle's computer (the *host* end: it sends commands, it receives telemetry) to the
STM32 that drives the thrusters (the *device* end). Both ends use the same `Wire` and `Protocol`.
What comes off a wire never raises: it decodes, or it is counted in `Counters` and dropped.
"""

from abc import ABC, abstractmethod
from typing import NamedTuple

from hil.clock import NEVER_NS

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
    record_size = 1  # bytes; it reads and takes multiples of this many

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
    deadline_ns = NEVER_NS  # when (monotonic ns) `tick` wants to be called

    @abstractmethod
    def encode(self, message: Message) -> bytes:
        """The bytes of `message`."""

    @abstractmethod
    def feed(self, data: bytes) -> list[Message]:
        """The messages that `data`, or time, completes, in order. Never raises: noise is counted and dropped."""

    def replies(self) -> bytes:
        """What the protocol itself answers to what it was fed since the last call: acknowledgements and the like."""
        return b""

    def tick(self, now_ns: int) -> bytes:
        """What the protocol itself has to say at `now_ns` (monotonic): heartbeats and the like."""
        return b""


class SentCommands:
    """Which command a report answers, for protocols whose reports do not say.

    It is the youngest command sent whose pulses the report shows; a report that shows none of the last
    `DEPTH` leaves the answer at what it was. Commands of equal pulses cannot be told apart.
    """

    DEPTH = 64

    def __init__(self) -> None:
        self._sent: list[tuple[tuple[int, ...], int]] = []
        self.answered = 0  # sequence of the last command that a report has shown

    def remember(self, pulses: tuple[int, ...], sequence: int) -> None:
        """A command that shows as `pulses` (us, as the report rounds them) goes out."""
        self._sent.append((pulses, sequence))
        del self._sent[: -self.DEPTH]

    def match(self, pulses: tuple[int, ...]) -> int:
        """The sequence of the command that a report of `pulses` (us) answers."""
        for place in range(len(self._sent) - 1, -1, -1):
            if self._sent[place][0] == pulses:
                self.answered = self._sent[place][1]
                del self._sent[:place]  # older ones will not be seen any more
                break
        return self.answered


class ThrusterLink:
    """One end of a link: a protocol on a wire."""

    def __init__(self, wire: Wire, protocol: Protocol) -> None:
        self.wire = wire
        self.protocol = protocol
        self.counters = protocol.counters

    def send(self, message: Message) -> None:
        """Encode `message` and write it. Raises DeviceError when the wire is gone."""
        self.counters.messages_out += 1
        self._write(self.protocol.encode(message))

    def receive(self) -> list[Message]:
        """All messages that have come in. Raises DeviceError when the wire is gone."""
        data = self.wire.read()  # fed even if it is nothing: a protocol may be waiting for an instant
        counters, protocol = self.counters, self.protocol
        counters.bytes_in += len(data)
        messages = protocol.feed(data)
        counters.messages_in += len(messages)
        replies = protocol.replies()
        if replies:
            self._write(replies)
        return messages

    def tick(self, now_ns: int) -> None:
        """Let the protocol say what is due at `now_ns` (monotonic). Raises DeviceError when the wire is gone."""
        if now_ns >= self.protocol.deadline_ns:
            self._write(self.protocol.tick(now_ns))

    def close(self) -> None:
        """Close the wire."""
        self.wire.close()

    def _write(self, data: bytes) -> None:
        taken = self.wire.write(data)
        self.counters.bytes_out += taken
        if taken < len(data):
            self.counters.dropped_bytes += len(data) - taken
