"""One topic that a client has subscribed to, once or several times: when what of it is sent."""

from collections import deque
from typing import Any, NamedTuple

from hil.common.clock import NS_PER_MS
from hil.common.errors import ConfigError

COMPRESSIONS = ("none", "cbor", "cbor-raw")
LONGEST_THROTTLE_MS, LONGEST_QUEUE = 3_600_000, 1000


class SubscriptionOptions(NamedTuple):
    """Request of one `subscribe`: least time between messages, how many wait meanwhile, and the encoding."""

    throttle_ns: int
    queue_length: int
    compression: str


def read_options(message: dict[str, Any]) -> SubscriptionOptions:
    """Return what a `subscribe` asks for. Raises ConfigError."""
    throttle = _number(message, "throttle_rate", LONGEST_THROTTLE_MS)
    queue = _number(message, "queue_length", LONGEST_QUEUE)
    compression = message.get("compression") or "none"
    if compression not in COMPRESSIONS:
        raise ConfigError(f"compression: {str(compression)[:20]!r} is none of {', '.join(COMPRESSIONS)}")
    return SubscriptionOptions(round(throttle * NS_PER_MS), round(queue), compression)


def _number(message: dict[str, Any], key: str, most: int) -> float:
    value = message.get(key) or 0
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not value >= 0:
        raise ConfigError(f"{key}: expected a number from 0 on")
    return min(value, most)


class Subscription:
    """A client's subscriptions to one topic, by their ids: a message is sent once, for the one that wants most."""

    def __init__(self) -> None:
        self._options: dict[str, SubscriptionOptions] = {}
        self._waiting: deque[Any] = deque(maxlen=1)
        self._next_ns = 0  # when the next may be sent

    def add(self, ident: str, options: SubscriptionOptions) -> None:
        """Add one, or change it."""
        self._options[ident] = options
        self._waiting = deque(self._waiting, maxlen=max(1, self._longest))

    def remove(self, ident: str | None) -> bool:
        """Remove one, or all; return whether none is left."""
        if ident is None:
            self._options.clear()
        self._options.pop(ident or "", None)
        return not self._options

    @property
    def compression(self) -> str:
        """The encoding that was asked for last."""
        return next(reversed(self._options.values())).compression

    @property
    def _longest(self) -> int:
        return max([options.queue_length for options in self._options.values()], default=0)

    def admit(self, item: Any, now: int) -> Any:
        """Return a message if it is to be sent now (ns); else it waits, if there is a queue, or is left out."""
        if now >= self._next_ns and not self._waiting:
            self._next_ns = now + min([options.throttle_ns for options in self._options.values()])
            return item
        if self._longest:
            self._waiting.append(item)
        return None

    @property
    def due_ns(self) -> int | None:
        """Time when the next that waits is to be sent (ns); None if nothing waits."""
        return self._next_ns if self._waiting else None

    def take_waiting(self, now: int) -> Any:
        """Return what waits longest, if it is due."""
        if not self._waiting or now < self._next_ns:
            return None
        self._next_ns = now + min([options.throttle_ns for options in self._options.values()])
        return self._waiting.popleft()
