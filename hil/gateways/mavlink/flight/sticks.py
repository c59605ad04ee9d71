"""Joystick of a ground station: MANUAL_CONTROL of one sender at a time, forgotten when it falls silent."""

from typing import Any, NamedTuple

INVALID = 0x7FFF  # an axis that the sender does not have
FULL = 1000.0
PITCH_EXTENSION, ROLL_EXTENSION = 1, 2  # bits of enabled_extensions

Sender = tuple[int, int, int]  # peer, system, component


class Sticks(NamedTuple):
    """Stick positions, -1 to 1: x ahead, y to starboard, z up, r turns to starboard, k rolls, m pitches up."""

    x: float = 0.0
    y: float = 0.0
    z: float = 0.0
    r: float = 0.0
    k: float = 0.0
    m: float = 0.0


CENTRED = Sticks()


class Joystick:
    """Store the newest sticks. Of several senders the first one counts until it has been silent for `timeout_ns`.

    Counts packets of others (`refused`) and those that waited too long before they were read (`stale`).
    """

    def __init__(self) -> None:
        self._sticks = CENTRED
        self._sender: Sender | None = None
        self._received_ns = 0
        self.refused = 0
        self.stale = 0

    def receive(self, packet: Any, sender: Sender, now: int, timeout_ns: int, is_stale: bool = False) -> bool:
        """Take a MANUAL_CONTROL; return whether it counts. z is 0 to 1000 with 500 neutral, as ArduSub has it."""
        if is_stale:
            self.stale += 1
            return False
        if self.is_alive(now, timeout_ns) and sender != self._sender:
            self.refused += 1
            return False
        extensions = packet.enabled_extensions
        self._sticks = Sticks(
            _axis(packet.x),
            _axis(packet.y),
            0.0 if packet.z == INVALID else (min(max(packet.z, 0), 1000) - 500) / 500.0,
            _axis(packet.r),
            _axis(packet.t) if extensions & ROLL_EXTENSION else 0.0,
            _axis(packet.s) if extensions & PITCH_EXTENSION else 0.0,
        )
        self._sender, self._received_ns = sender, now
        return True

    def is_alive(self, now: int, timeout_ns: int) -> bool:
        """Return whether somebody holds the sticks."""
        return self._sender is not None and now - self._received_ns <= timeout_ns

    def sticks(self, now: int, timeout_ns: int, dead_zone: float) -> Sticks:
        """Return the sticks, centred if nobody holds them; what is within `dead_zone` is 0."""
        if not self.is_alive(now, timeout_ns):
            return CENTRED
        return Sticks(*[0.0 if abs(axis) <= dead_zone else axis for axis in self._sticks])

    def release(self) -> None:
        """Forget the sticks and who held them."""
        self._sticks, self._sender = CENTRED, None


def _axis(value: int) -> float:
    return 0.0 if value == INVALID else min(max(value / FULL, -1.0), 1.0)
