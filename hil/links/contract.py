"""Interfaces of every thruster link: messages, `Wire`, `Protocol`, and `ThrusterLink`, which joins them.

A link joins the vehicle's computer (the *host* end: it sends commands, it receives telemetry) to the
STM32 that drives the thrusters (the *device* end). Both ends use the same `Wire` and `Protocol`.
What comes off a wire never raises: it decodes, or it is counted in `Counters` and dropped.
"""

from abc import ABC, abstractmethod
from typing import NamedTuple

from hil.common.clock import NEVER_NS, NS_PER_MS, now_ns

MAX_THRUSTERS = 16
PWM_NEUTRAL_US = 1500
RETRY_NS = NS_PER_MS  # between two checks whether the wire is free for a stored command
PWM_MIN_US, PWM_MAX_US = 800, 2200  # a pulse outside is "no output", 0 included


class ThrusterCommand(NamedTuple):
    """Command from the host to the STM32: `pwm_us` are pulse widths in microseconds, one a thruster.

    `armed` false means neutral outputs whatever the value of `pwm_us`. `sequence` (0..65535, wraps) comes
    back in the telemetry; delay is measured by that.
    """

    sequence: int
    armed: bool
    pwm_us: tuple[int, ...]


class ThrusterTelemetry(NamedTuple):
    """Report of the STM32: the pulse widths that it applies now, and its counters.

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

_WRAP = 0x10000  # of `sequence` and `frames`
_MOST_READS = 256  # of unread bytes: more than any wire buffers, so that a flood does not block the caller
_AHEAD = 100  # commands that `frames` may be ahead of `sequence`, where the two are not of one message


def is_overtaken(report: ThrusterTelemetry, newest: ThrusterTelemetry) -> bool:
    """Return whether `report` is older than `newest`, which arrived first: UDP does not preserve the order.

    It echoes an older command and has counted fewer; what has just started has counted none, and is disarmed.
    """
    behind = (newest.sequence - report.sequence) % _WRAP, (newest.frames - report.frames) % _WRAP
    return all(0 < step < _WRAP // 2 for step in behind) and (report.armed or report.frames > 0)


def has_restarted(report: ThrusterTelemetry, newest: ThrusterTelemetry) -> bool:
    """Return whether the STM32 restarted between `newest` and `report`, which is not overtaken.

    From one report to the next it counts no more commands than were sent, unless it begins at 0 again. A report from
    before its first command has sequence 0 too, so that its sequence shows nothing.
    """
    counted, sent = (report.frames - newest.frames) % _WRAP, (report.sequence - newest.sequence) % _WRAP
    if report.frames == 0 and not report.armed:
        return counted > _AHEAD
    return counted > sent + _AHEAD


class Counters:
    """Counters of one end of a link since it was opened."""

    __slots__ = (
        "bytes_in",
        "bytes_out",
        "checksum_errors",
        "dropped_bytes",
        "malformed",
        "messages_in",
        "messages_out",
        "replaced",
    )

    def __init__(self) -> None:
        self.bytes_in = 0  # off the wire
        self.bytes_out = 0  # onto the wire
        self.messages_in = 0  # decoded
        self.messages_out = 0  # encoded
        self.replaced = 0  # commands that were not sent, because a newer one came while the wire was busy
        self.checksum_errors = 0  # frames whose checksum was wrong
        self.malformed = 0  # checksum right, contents not (unknown message, impossible count)
        self.dropped_bytes = 0  # bytes between frames, or refused by a full wire


class Wire(ABC):
    """A two-way stream of bytes. Never blocks: bytes that cannot be written now are dropped and counted."""

    name: str  # for messages to a person: a device path or an address
    record_size = 1  # bytes; it reads and writes multiples of this size

    @abstractmethod
    def fileno(self) -> int:
        """Return the descriptor to wait on for incoming bytes."""

    @abstractmethod
    def read(self) -> bytes:
        """Return the received bytes, b"" if there are none. Raises DeviceError when the device is lost."""

    @abstractmethod
    def write(self, data: bytes) -> int:
        """Write `data`; return the number of bytes accepted. Raises DeviceError when the device is lost."""

    def unsent(self) -> int:
        """Return how many bytes `write` accepted that are not sent yet; 0 where that cannot be known."""
        return 0

    def discard_unsent(self) -> None:
        """Discard the bytes that `unsent` counts, where that is possible; a message that is being sent is cut."""
        return

    def fault_counts(self) -> tuple[dict[str, float], dict[str, float]]:
        """Return how often each injected fault struck what was sent and what was received; empty without faults."""
        return {}, {}

    @abstractmethod
    def close(self) -> None:
        """Close the device. Closing twice is harmless."""


class Protocol(ABC):
    """Encoder and decoder of messages at one end of a link; stores the beginning of an unfinished frame."""

    counters: Counters
    deadline_ns = NEVER_NS  # when (monotonic ns) `tick` has to be called

    @abstractmethod
    def encode(self, message: Message) -> bytes:
        """Return the bytes of `message`."""

    def encode_settled(self, message: Message) -> bytes:
        """Return the bytes of `message` once both ends agree, without what only a disagreement needs."""
        return self.encode(message)

    @abstractmethod
    def feed(self, data: bytes) -> list[Message]:
        """Return the messages that `data`, or time, completes, in order. Never raises: noise is counted and dropped."""

    def replies(self) -> bytes:
        """Return the protocol's own answers since the last call, for example acknowledgements."""
        return b""

    def tick(self, now_ns: int) -> bytes:
        """Return what the protocol itself sends at `now_ns` (monotonic), for example heartbeats."""
        return b""

    def motor_values(self, thruster: int) -> dict[str, float]:
        """Return what the controller of a thruster, from 0, last reported of its motor, by unit; mostly nothing."""
        return {}


class SentCommands:
    """Find the command that a report answers, for protocols whose reports carry no sequence number.

    That is the newest command sent whose pulses the report shows. A report that shows none of the last `DEPTH`
    commands leaves the answer unchanged. Commands of equal pulses cannot be distinguished.
    """

    DEPTH = 64

    def __init__(self) -> None:
        self._sent: list[tuple[tuple[int, ...], int]] = []
        self.answered = 0  # sequence of the last command that a report has shown

    def add_sent(self, pulses: tuple[int, ...], sequence: int) -> None:
        """Record a command that is sent; `pulses` (us) are its pulses as a report rounds them."""
        self._sent.append((pulses, sequence))
        del self._sent[: -self.DEPTH]

    def match(self, pulses: tuple[int, ...]) -> int:
        """Return the sequence number of the command that a report of `pulses` (us) answers."""
        for place in range(len(self._sent) - 1, -1, -1):
            if self._sent[place][0] == pulses:
                self.answered = self._sent[place][1]
                del self._sent[:place]  # no later report answers an older one
                break
        return self.answered


class ThrusterLink:
    """One end of a thruster link: a protocol on a wire.

    At most one command is unsent at any time. While the wire still sends an older one, the newest is stored here and
    replaces any stored before; `tick` sends it when the wire is free. A command that disarms goes first: what is unsent
    is discarded. So an old command never resets the STM32's watchdog.
    """

    def __init__(self, wire: Wire, protocol: Protocol) -> None:
        self.wire = wire
        self.protocol = protocol
        self.counters = protocol.counters
        self._held: ThrusterCommand | None = None
        self._retry_ns = NEVER_NS  # when the wire may be free for the stored command
        self._is_armed = False  # `armed` of the last command that was written

    @property
    def deadline_ns(self) -> int:
        """Return when (monotonic ns) `tick` has to be called."""
        return min(self.protocol.deadline_ns, self._retry_ns)

    def send(self, message: Message) -> None:
        """Encode and write `message`, or store a command while an older one is unsent. Raises DeviceError."""
        if isinstance(message, ThrusterCommand) and not self._may_send(message):
            self._held, self._retry_ns = message, now_ns() + RETRY_NS
            return
        self.counters.messages_out += 1
        self._write(self.protocol.encode(message))

    def receive(self) -> list[Message]:
        """Return all received messages. Raises DeviceError when the wire is lost."""
        data = self.wire.read()  # fed even if empty: a protocol may wait for an instant
        counters, protocol = self.counters, self.protocol
        counters.bytes_in += len(data)
        messages = protocol.feed(data)
        counters.messages_in += len(messages)
        replies = protocol.replies()
        if replies:
            self._write(replies)
        return messages

    def discard_received(self) -> None:
        """Discard and count the bytes that were received but not read. Raises DeviceError when the wire is lost."""
        for _ in range(_MOST_READS):
            data = self.wire.read()
            if not data:
                return
            self.counters.dropped_bytes += len(data)

    def tick(self, now: int) -> None:
        """Send what is due at `now` (monotonic ns), stored commands first. Raises DeviceError when the wire is lost."""
        if self._held and now >= self._retry_ns:
            self.send(self._held)
        if now >= self.protocol.deadline_ns:
            self._write(self.protocol.tick(now))

    def close(self) -> None:
        """Close the wire."""
        self.wire.close()

    def _may_send(self, command: ThrusterCommand) -> bool:
        """Return whether `command` can be written now; discard what is unsent for one that disarms."""
        if command is not self._held:
            self._drop_held()
        if self._is_armed and not command.armed:
            self.wire.discard_unsent()
        elif self.wire.unsent():
            return False
        self._is_armed, self._held, self._retry_ns = command.armed, None, NEVER_NS
        return True

    def _drop_held(self) -> None:
        if self._held:
            self._held, self._retry_ns = None, NEVER_NS
            self.counters.replaced += 1

    def _write(self, data: bytes) -> None:
        taken = self.wire.write(data)
        self.counters.bytes_out += taken
        if taken < len(data):
            self.counters.dropped_bytes += len(data) - taken
