"""Play a recording to the network, as if its vehicles were present."""

from collections.abc import Callable, Iterable

from hil.common.clock import NS_PER_S, now_ns, to_wall_ns
from hil.common.errors import ConfigError
from hil.common.stop import is_stopped
from hil.network.presence import declare_presence
from hil.network.publisher import Publisher
from hil.network.session import Session
from hil.recording.mcap_file import Message
from hil.ros import types
from hil.ros.topics import TOPICS, Topic


def pace(messages: Iterable[Message], speed: float, stop_fd: int, use: Callable[[Message], None]) -> float:
    """Call `use` for each message at its time, `speed` times as fast as recorded (0: without waiting).

    Return the played duration in s of the recording. It ends early when `stop_fd` becomes readable.
    """
    first_ns = newest_ns = 0
    began = now_ns()
    for message in messages:
        first_ns = first_ns or message.logged_ns
        newest_ns = max(newest_ns, message.logged_ns)
        due = began + (round((message.logged_ns - first_ns) / speed) if speed else 0)
        if is_stopped(stop_fd, max(0, due - now_ns()) / NS_PER_S):
            break
        use(message)
    return (newest_ns - first_ns) / NS_PER_S


class Player:
    """Publishes recorded messages with `session`, on their topics, unchanged. They keep their recorded stamps.

    `sent` counts the published messages. `unknown` has the unknown message types, which are left out.
    """

    def __init__(self, session: Session) -> None:
        self._session = session
        self._publishers: dict[str, Publisher | None] = {}
        self._nodes: set[str] = set()
        self.sent = 0
        self.unknown: set[str] = set()

    def send(self, message: Message) -> None:
        """Publish the message now."""
        name = message.topic
        if name not in self._publishers:
            self._publishers[name] = self._declare(name, message.type)
        publisher = self._publishers[name]
        if publisher:
            publisher.put(message.data, to_wall_ns(now_ns()))
            self.sent += 1

    def _declare(self, name: str, kind: str) -> Publisher | None:
        """Return a publisher with the topic and QoS of the recorded one; None for an unknown type."""
        try:
            types.type_hash(kind)
        except ConfigError:
            self.unknown.add(kind)
            return None
        node, _, last = name.strip("/").rpartition("/")
        if node and node not in self._nodes:
            self._nodes.add(node)
            declare_presence(self._session, node, "slave")
        like = TOPICS.get(last) or TOPICS.get(name) or Topic(last, kind, 0, "data")
        return self._session.publisher(node, like._replace(name=name, type=kind), wait=True)  # complete, even if late
