"""Where samples leave: simulator samples to ROS messages, each on its topic."""

import sys
from collections.abc import Sequence
from contextlib import suppress
from typing import Any

from hil.clock import now_ns, to_wall_ns
from hil.errors import ConfigError
from hil.topics import TOPICS
from hil.transport import ros
from hil.transport.graph import Node
from hil.transport.publisher import Publisher
from hil.transport.session import Session
from hil.transport.settings import BATCH

LARGE = BATCH - 1024  # bytes; a longer message may go out in parts, and wait for room for each


class Outbox:
    """Publishes what the slave has to say as one node.

    `epoch_ns` is the wall time (ns since 1970) of simulation time 0; message stamps count from it. `prefix` is set
    before the names of its frames; `silent` are topics that are left out. `graph` is the node as ROS sees it. A slow
    network holds up nobody who calls this, but who `waits`. What nobody listens to is not sent, but for
    latched topics; a sample is not even made into messages before somebody asks. With `sends_all` everything is sent.
    """

    sends_all = False

    def __init__(
        self,
        session: Session,
        node: str,
        epoch_ns: int,
        prefix: str = "",
        silent: Sequence[str] = (),
        waits: bool = False,
    ) -> None:
        self._session = session
        self._node = node
        self._prefix = prefix
        self._silent = silent
        self._whole = sys.maxsize if waits else LARGE  # bytes that are sent at once
        self.epoch_ns = epoch_ns
        self.graph = Node(session, node)
        self._publishers: dict[str, Publisher] = {}  # of the topics there was something to say on so far
        self._outlets: dict[str, list[Publisher]] = {}  # by the simulator's name for a sample: where it goes out
        self._kept: dict[str, tuple[Any, int]] = {}  # the newest of those that nobody listens to, and when it came

    def sample(self, topic: str, sample: Any) -> bool:
        """Publish one sensor sample (NED, FRD) under the simulator's name for it; False if nobody listens to it."""
        outlets = self._outlets.get(topic)
        if outlets is None:
            outlets = self._open(topic, sample)
        for publisher in outlets:
            if publisher.wanted:
                break
        else:
            self._kept[topic] = sample, now_ns()
            return False
        self._kept.pop(topic, None)
        for name, payload in self._messages(topic, sample):
            self.put(name, payload)
        return True

    def catch_up(self) -> None:
        """Make messages of what was kept, for those who ask what was said last; called in another thread."""
        for topic in list(self._kept):
            sample, came_ns = self._kept.pop(topic, (None, 0))
            if sample is None:  # there was a newer one, which has been sent
                continue
            with suppress(ConfigError):  # of a user's own sensor; told when it is to be sent
                for name, payload in self._messages(topic, sample):
                    self._publishers[name].keep(payload, to_wall_ns(came_ns))

    def trace(self, instants: tuple[int, ...]) -> None:
        """Publish the instants of one command's way, see `hil.slave.loop.Trace`."""
        self.put("trace", ros.encode_int64_array(instants))

    def diagnostics(self, name: str, level: int, message: str, values: dict[str, str]) -> None:
        """Publish the state of health; `level` 0 ok, 1 warning, 2 error."""
        now = to_wall_ns(now_ns())
        self.put("diagnostics", ros.encode_diagnostics(now, [(name, level, message, values)]))

    def put(self, name: str, payload: bytes) -> None:
        """Publish a message on a topic of `hil.topics`; it is kept as the last if nobody listens."""
        publisher = self._publishers.get(name) or self._declare(name)
        if len(payload) > self._whole and not publisher.aside:
            self._session.send_aside(publisher)
        now = to_wall_ns(now_ns())
        if publisher.wanted:
            publisher.put(payload, now)
        else:
            publisher.keep(payload, now)

    def wants(self, names: Sequence[str]) -> bool:
        """Whether anybody listens to one of these topics, or may: nothing was said on it yet."""
        publishers = [self._publishers.get(name) for name in names]
        return any(publisher is None or publisher.wanted for publisher in publishers)

    @property
    def sent(self) -> int:
        """How many messages were sent so far."""
        return sum([publisher.sequence for publisher in list(self._publishers.values())])

    def _messages(self, topic: str, sample: Any) -> list[tuple[str, bytes]]:
        # What sample._replace(time_ns=...) gives, at half its price: each begins with its time.
        stamped = tuple.__new__(type(sample), (sample.time_ns + self.epoch_ns, *sample[1:]))
        return [message for message in ros.encoder(topic)(stamped, self._prefix) if message[0] not in self._silent]

    def _open(self, topic: str, sample: Any) -> list[Publisher]:
        """Where a sample goes out, by what becomes of this one."""
        names = [name for name, _ in self._messages(topic, sample)]
        self._outlets[topic] = [self._publishers.get(name) or self._declare(name) for name in names]
        return self._outlets[topic]

    def _declare(self, name: str) -> Publisher:
        publisher = self._publishers[name] = self._session.publisher(self._node, TOPICS[name])
        self.graph.publishes(TOPICS[name], self._node)
        if not (self.sends_all or publisher.topic.qos.latched):
            self._session.watch_audience(publisher)
        return publisher
