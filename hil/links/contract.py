"""Interfaces of every thruster link: messages, `Wire`, `Protocol`, and `ThrusterLink`, which joins them.

A link connects the vehicle's computer (the *host* end: sends commands, receives telemetry) with the STM32 that drives
the thrusters (the *device* end). Both ends use the same `Wire` and `Protocol`. Bytes from a wire never raise an error:
they are decoded, or counted in `Counters` and dropped.
"""

import itertools
from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import NamedTuple

from hil.common.clock import NEVER_NS, NS_PER_MS, now_ns
from hil.links.pace import EchoPace

MAX_THRUSTERS = 16
LEAST_US, PWM_NEUTRAL_US, MOST_US = 1100, 1500, 1900  # full output, and none, of usual motor controllers and servos
RETRY_NS = NS_PER_MS  # between two checks whether the wire can take a stored command
PWM_MIN_US, PWM_MAX_US = 800, 2200  # a pulse outside is "no output", 0 included


class ThrusterCommand(NamedTuple):
    """Command from the host to the STM32. `pwm_us` has one pulse width (us) for each thruster.

    With `armed` false the outputs are neutral, whatever `pwm_us` is. The telemetry echoes `sequence` (0..65535, wraps),
    which serves to measure the delay.
    """

    sequence: int
    armed: bool
    pwm_us: tuple[int, ...]


class ThrusterTelemetry(NamedTuple):
    """Report of the STM32: the pulse widths that it applies now, and its counters.

    `sequence` is the sequence number of the last command applied, `age_us` the time from its application to the sending
    of this message. `watchdog_trips`, `frames` and `errors` count since power-up and wrap at 65536.
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

_WRAP = 0x10000  # modulus of `sequence` and `frames`
_MAX_READS = 256  # reads to discard what was received: more than any wire buffers, yet limited in a flood
_AHEAD = 100  # commands by which `frames` may be ahead of `sequence`, where the two come in different messages


def is_overtaken(report: ThrusterTelemetry, newest: ThrusterTelemetry) -> bool:
    """Return whether `report` is older than `newest`, which arrived first; UDP does not preserve the order.

    An older report echoes an older command and has a lower count. After a start the count is 0 and the STM32 disarmed.
    """
    behind = (newest.sequence - report.sequence) % _WRAP, (newest.frames - report.frames) % _WRAP
    return all(0 < step < _WRAP // 2 for step in behind) and (report.armed or report.frames > 0)


def has_restarted(report: ThrusterTelemetry, newest: ThrusterTelemetry) -> bool:
    """Return whether the STM32 restarted between `newest` and the later `report`.

    Without a restart, its count grows by at most the number of commands sent. The sequence number of a report from
    before the first command is 0 and is not used.
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
        self.bytes_in = 0  # read from the wire
        self.bytes_out = 0  # written to the wire
        self.messages_in = 0  # decoded
        self.messages_out = 0  # encoded
        self.replaced = 0  # commands that were not sent, because a newer one came while the wire was busy
        self.checksum_errors = 0  # frames with a wrong checksum
        self.malformed = 0  # frames with a right checksum but invalid content (unknown message, impossible count)
        self.dropped_bytes = 0  # bytes between frames, refused by a full wire, or discarded because they had waited


def count_read(read: Callable[[], bytes]) -> int:
    """Call `read` until it returns no byte, but only so often that a flood ends it too; return how many bytes came."""
    return sum(map(len, itertools.islice(iter(read, b""), _MAX_READS)))


class Wire(ABC):
    """A two-way stream of bytes. Never blocks: bytes that cannot be written now are dropped and counted."""

    name: str  # for messages to a person: a device path or an address
    record_size = 1  # bytes; reads and writes are multiples of this size

    @abstractmethod
    def fileno(self) -> int:
        """Return the descriptor to wait on for incoming bytes."""

    @abstractmethod
    def read(self) -> bytes:
        """Return the received bytes, b"" if there are none. Raises DeviceError if the device is lost."""

    def discard_received(self) -> int:
        """Discard all that arrived and was not read, wherever it waits; return how many bytes.

        May wait for the kernel. Raises DeviceError if the device is lost.
        """
        return count_read(self.read)

    @abstractmethod
    def write(self, data: bytes) -> int:
        """Write `data`; return the number of bytes accepted. Raises DeviceError if the device is lost."""

    def unsent(self) -> int:
        """Return how many accepted bytes are not sent yet; 0 if this is unknown."""
        return 0

    def discard_unsent(self) -> None:
        """Discard the bytes that `unsent` counts, if possible; this may cut a message that is being sent."""
        return

    def fault_counts(self) -> tuple[dict[str, float], dict[str, float]]:
        """Return how often each injected fault affected sent and received data; empty without faults."""
        return {}, {}

    @abstractmethod
    def close(self) -> None:
        """Close the device. May be called twice."""


class Protocol(ABC):
    """Encoder and decoder of messages at one end of a link; it stores the start of an incomplete frame."""

    counters: Counters
    deadline_ns = NEVER_NS  # monotonic time at which `tick` has to be called
    echoes_sequence = True  # False: reports carry no sequence number; the answered command is found by its pulses

    @abstractmethod
    def encode(self, message: Message) -> bytes:
        """Return the bytes of `message`."""

    def encode_settled(self, message: Message) -> bytes:
        """Return the bytes of `message` without optional parts, which are needed only until both ends agree."""
        return self.encode(message)

    @abstractmethod
    def feed(self, data: bytes) -> list[Message]:
        """Return the messages that are complete with `data`, in order. Never raises: noise is counted and dropped."""

    def replies(self) -> bytes:
        """Return the protocol's own answers since the last call, for example acknowledgements."""
        return b""

    def tick(self, now_ns: int) -> bytes:
        """Return the bytes that the protocol itself sends at `now_ns` (monotonic), for example heartbeats."""
        return b""

    def motor_values(self, thruster: int) -> dict[str, float]:
        """Return the last values that a thruster's (from 0) controller has reported, by unit; often empty."""
        return {}


class SentCommands:
    """Find the command that a report answers, for protocols whose reports carry no sequence number.

    It is the newest command whose pulse widths equal those of the report. A report that matches none of the last
    `DEPTH` commands leaves the answer unchanged. Commands with equal pulse widths cannot be distinguished.
    """

    DEPTH = 64

    def __init__(self) -> None:
        self._sent: list[tuple[tuple[int, ...], int]] = []
        self.answered = 0  # sequence number of the last command that a report has matched

    def add_sent(self, pulses: tuple[int, ...], sequence: int) -> None:
        """Record a command that is sent; `pulses` are its pulse widths (us), rounded as in a report."""
        self._sent.append((pulses, sequence))
        del self._sent[: -self.DEPTH]

    def match(self, pulses: tuple[int, ...]) -> int:
        """Return the sequence number of the command that a report with these pulse widths (us) answers."""
        for place in range(len(self._sent) - 1, -1, -1):
            if self._sent[place][0] == pulses:
                self.answered = self._sent[place][1]
                del self._sent[:place]  # no later report can answer an older command
                break
        return self.answered


class ThrusterLink:
    """One end of a thruster link: a protocol on a wire; at the host's end with a `pace` for its commands.

    At most one command is unsent at any time. While the wire is still sending a command, or the line has as many
    unanswered ones as it carries (`pace`), the newest further one is stored here and replaces any before it; it is sent
    when there is room. A command that disarms goes first: unsent bytes are discarded. So an old command never resets
    the STM32's watchdog.
    """

    def __init__(self, wire: Wire, protocol: Protocol, pace: EchoPace | None = None) -> None:
        self.wire = wire
        self.protocol = protocol
        self.counters = protocol.counters
        self.pace = pace
        self._held: ThrusterCommand | None = None
        self._retry_ns = NEVER_NS  # when to check again whether the wire is free for the stored command
        self._is_armed = False  # `armed` of the last command that was written

    @property
    def deadline_ns(self) -> int:
        """Monotonic time (ns) at which `tick` has to be called."""
        return min(self.protocol.deadline_ns, self._retry_ns)

    def send(self, message: Message) -> None:
        """Encode and write `message`; store a command instead while an older one is unsent. Raises DeviceError."""
        if isinstance(message, ThrusterCommand):
            now = now_ns()
            if not self._may_send(message, now):
                return
            if self.pace:
                self.pace.add_sent(message.sequence, now)
        self.counters.messages_out += 1
        self._write(self.protocol.encode(message))

    def receive(self) -> list[Message]:
        """Return all received messages. Raises DeviceError if the wire is lost."""
        counters, protocol = self.counters, self.protocol
        data = self.wire.read()
        counters.bytes_in += len(data)
        messages = protocol.feed(data)  # even if empty, because a protocol may act by time
        counters.messages_in += len(messages)
        if self.pace and messages:
            self._count_answers(self.pace, messages)
        replies = protocol.replies()
        if replies:
            self._write(replies)
        return messages

    def tick(self, now: int) -> None:
        """Send what is due at `now` (monotonic ns), a stored command first. Raises DeviceError if the wire is lost."""
        if self._held and now >= self._retry_ns:
            self.send(self._held)
        if now >= self.protocol.deadline_ns:
            self._write(self.protocol.tick(now))

    def close(self) -> None:
        """Close the wire."""
        self.wire.close()

    def _count_answers(self, pace: EchoPace, messages: list[Message]) -> None:
        now = now_ns()
        for message in messages:
            if isinstance(message, ThrusterTelemetry):
                pace.add_answer(message.sequence, now)
        if self._held:
            self.send(self._held)

    def _may_send(self, command: ThrusterCommand, now: int) -> bool:
        """Return whether `command` can be written now, or store it; discard unsent bytes if it disarms."""
        if command is not self._held:
            self._drop_held()
            if self.pace:
                self.pace.add_offered(now)
        due_ns = self.pace.due_ns(now) if self.pace else now
        if self._is_armed and not command.armed:
            self.wire.discard_unsent()
        elif due_ns > now or self.wire.unsent():
            self._held, self._retry_ns = command, max(due_ns, now + RETRY_NS)
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
