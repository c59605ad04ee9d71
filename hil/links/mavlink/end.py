"""Common part of both ends of a MAVLink thruster link: decode packets, queue answers, answer TIMESYNC."""

from collections.abc import Callable
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as dialect

from hil.common.clock import NS_PER_S, NS_PER_US
from hil.links.contract import PWM_MAX_US, PWM_MIN_US, Counters, Message, Protocol
from hil.links.mavlink.settings import MavlinkSettings
from hil.links.mavlink.stream import MavlinkStream, signing_secret

BEAT_NS = NS_PER_S
SERVOS = 16  # in one SERVO_OUTPUT_RAW
PORT = 0  # the group of outputs of this link; others belong to other boards
U32 = 0xFFFF_FFFF
NO_PULSE_US = 0

Handler = Callable[[Any], Message | None]


class MavlinkEnd(Protocol):
    """One end. A subclass fills `handlers` (message id -> function for such a message) and sends its heartbeat."""

    handlers: dict[int, Handler]

    def __init__(
        self,
        channels: int,
        settings: MavlinkSettings,
        component: int,
        clock: Callable[[], int],
        wall_clock: Callable[[], int],
    ) -> None:
        self.channels = channels
        self.counters = Counters()
        self.deadline_ns = 0
        self.settings = settings
        self.component = component
        self._clock = clock
        self._stream = MavlinkStream(settings.system, component, self.counters)
        if settings.signing_key:
            self._stream.sign(signing_secret(settings.signing_key), wall_clock)
        self._replies = b""

    def feed(self, data: bytes) -> list[Message]:
        """Return the messages that `data` completes, in order. Never raises."""
        messages = []
        for packet in self._stream.unpack(data):
            handle = self.handlers.get(packet.get_msgId())
            if handle and sender(packet) != (self.settings.system, self.component):  # not our own echo
                message = handle(packet)
                if message:
                    messages.append(message)
        return messages

    def replies(self) -> bytes:
        """Return acknowledgements and answers since the last call."""
        replies, self._replies = self._replies, b""
        return replies

    def pack(self, message: Any) -> bytes:
        """Return the packet of a message of the dialect."""
        return self._stream.pack(message)

    def reply(self, message: Any) -> None:
        """Queue a message for the next call of `replies`."""
        self._replies += self.pack(message)

    def timesync(self, packet: Any) -> None:
        """Answer a request for our clock (ns); answers to others, which have tc1, are ignored."""
        if packet.tc1 == 0:
            self.reply(dialect.MAVLink_timesync_message(self._clock(), packet.ts1))

    def servo_output_raw(self, pulses: list[int]) -> bytes:
        """Return a SERVO_OUTPUT_RAW packet with these pulse widths (us), stamped with this end's clock (us, wraps)."""
        servos = pulses + [NO_PULSE_US] * (SERVOS - len(pulses))
        return self._stream.pack_servos(self._clock() // NS_PER_US & U32, PORT, servos)

    def check_channels(self, pulses: tuple[int, ...]) -> None:
        """Raise ValueError unless there is one pulse width for each thruster."""
        if len(pulses) != self.channels:
            raise ValueError(f"this link carries {self.channels} channels, not {len(pulses)}")


def sender(packet: Any) -> tuple[int, int]:
    """Return system and component that sent a packet."""
    return packet.get_srcSystem(), packet.get_srcComponent()


def is_pulse(width_us: float) -> bool:
    """Return whether this is a valid pulse width (us) for an ESC; any other means no output."""
    return PWM_MIN_US <= width_us <= PWM_MAX_US


def next_due(due_ns: int, period_ns: int, now_ns: int) -> int:
    """Return the next time (ns) of a schedule; after a delay the schedule restarts from `now_ns`."""
    return due_ns + period_ns if now_ns < due_ns + period_ns else now_ns + period_ns
