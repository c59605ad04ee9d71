"""One ground station, companion computer or router at the other end: its packets, rates, rights and queue."""

from collections import deque
from collections.abc import Callable
from typing import Any

from hil.gateways.mavlink.protocols.signing import SigningKey
from hil.gateways.mavlink.protocols.streams import MAX_HZ, StreamRates
from hil.links.contract import Counters
from hil.links.mavlink.stream import MavlinkStream

COMPONENT = 1  # the autopilot's
SLOW_BURST = 400  # bytes a turn: a serial line that does not carry all streams at their default rates
AT_ONCE = 60  # messages of lists in one turn: the buffer of a busy receiver takes some 200 datagrams
MAX_WAITING = 4000  # messages of lists that wait for a slow link

Write = Callable[[bytes, Any], None]  # the packet, and its message


class Peer:
    """A partner, known by `number`; packets go out by `write`, `burst` bytes of lists at most a turn.

    `counters` counts what came damaged, unsigned or cut; `may_command` whether it may change anything. With a secret in
    `signing` packets are signed, and unsigned ones refused.
    """

    def __init__(
        self,
        number: int,
        name: str,
        system: int,
        write: Write,
        may_command: bool,
        burst: int = 4_000,
        signing: SigningKey | None = None,
        wall_clock: Callable[[], int] = lambda: 0,
    ) -> None:
        self.number, self.name, self.may_command = number, name, may_command
        self.counters = Counters()
        self.rates = StreamRates(1.0 if burst < SLOW_BURST else MAX_HZ)
        self.received_ns = 0
        self.denied = 0
        self._write, self._burst = write, burst
        self._stream = MavlinkStream(system, COMPONENT, self.counters, takes_version_1=True)
        key = signing or SigningKey()
        self._stream.sign(key.secret, wall_clock, key.stamps, number)
        self._waiting: deque[Any] = deque(maxlen=MAX_WAITING)

    def unpack(self, data: bytes) -> list[Any]:
        """Return the messages that bytes complete. Never raises."""
        return self._stream.unpack(data)

    def send(self, *messages: Any) -> None:
        """Send messages now."""
        for message in messages:
            if packet := self._stream.pack(message):
                self._write(packet, message)

    def send_later(self, messages: list[Any]) -> None:
        """Send messages as fast as the link takes them, so that a list does not hold up what is urgent."""
        self._waiting.extend(messages)
        self.flush()

    def flush(self) -> None:
        """Send what waits, at most `burst` bytes and AT_ONCE messages."""
        left = self._burst
        for _ in range(AT_ONCE):
            if not self._waiting or left <= 0:
                return
            message = self._waiting.popleft()
            packet = self._stream.pack(message)
            if packet:
                self._write(packet, message)
            left -= len(packet)
