"""Where samples leave: simulator samples to ROS messages, each on its topic."""

import sys
from collections.abc import Sequence
from typing import Any

from hil.clock import now_ns, to_wall_ns
from hil.topics import TOPICS
from hil.transport import ros
from hil.transport.graph import Node
from hil.transport.session import Publisher, Session
from hil.transport.settings import BATCH

LARGE = BATCH - 1024  # bytes; a longer message may go out in parts, and wait for room for each


class Outbox:
    """Publishes what the slave has to say as one node.

    `epoch_ns` is the wall time (ns since 1970) of simulation time 0; message stamps count from it. `prefix` is set
    before the names of its frames; `silent` are topics that are left out. `graph` is the node as ROS sees it. A slow
    network holds up nobody who calls this, but who `waits`.
    """

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

    def sample(self, topic: str, sample: Any) -> None:
        """Publish one sensor sample (NED, FRD) under the simulator's name for it."""
        # What sample._replace(time_ns=...) gives, at half its price: each begins with its time.
        stamped = tuple.__new__(type(sample), (sample.time_ns + self.epoch_ns, *sample[1:]))
        for name, payload in ros.encoder(topic)(stamped, self._prefix):
            if name not in self._silent:
                self.put(name, payload)

    def trace(self, instants: tuple[int, ...]) -> None:
        """Publish the instants of one command's way, see `hil.slave.loop.Trace`."""
        self.put("trace", ros.encode_int64_array(instants))

    def diagnostics(self, name: str, level: int, message: str, values: dict[str, str]) -> None:
        """Publish the state of health; `level` 0 ok, 1 warning, 2 error."""
        now = to_wall_ns(now_ns())
        self.put("diagnostics", ros.encode_diagnostics(now, [(name, level, message, values)]))

    def put(self, name: str, payload: bytes) -> None:
        """Publish a message on a topic of `hil.topics`."""
        publisher = self._publishers.get(name) or self._declare(name)
        if len(payload) > self._whole and not publisher.aside:
            self._session.send_aside(publisher)
        publisher.put(payload, to_wall_ns(now_ns()))

    @property
    def published(self) -> int:
        """How many messages so far."""
        return sum([publisher.sequence for publisher in list(self._publishers.values())])

    def _declare(self, name: str) -> Publisher:
        publisher = self._publishers[name] = self._session.publisher(self._node, TOPICS[name])
        self.graph.publishes(TOPICS[name], self._node)
        return publisher
