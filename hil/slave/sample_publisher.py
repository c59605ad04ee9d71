"""Publish simulator samples as ROS messages, each on its topic."""

import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from types import MappingProxyType
from typing import Any

from hil.common.clock import now_ns, to_wall_ns
from hil.common.errors import ConfigError
from hil.common.stamps import Stamps
from hil.network.publisher import Publisher
from hil.network.session import Session
from hil.network.settings import BATCH
from hil.ros import encoders as ros
from hil.ros.graph import Identity, Node
from hil.ros.topics import TOPICS, sample_topics
from hil.slave.publishing import PublishingThread

LARGE = BATCH - 1024  # bytes; a longer message may go out in parts, and wait for room for each


def _call(call: Callable[..., None], *arguments: Any) -> None:
    """Make a call in the thread that asks for it."""
    call(*arguments)


class SamplePublisher:
    """Publish the samples of the slave as one node.

    `epoch_ns` is the wall time (ns since 1970) of simulation time 0 to begin with; `stamps` has what messages are
    stamped with. `prefix` is set before the names of its frames; `excluded_topics` are left out; `variances` are
    those of `sim.sensors.spread`; `of` is the node in another process for which this one speaks. `graph` is the node as
    ROS sees it. With a `thread` that one publishes, and no method waits for the network but `diagnostics`, which is not
    for the loop. Without one the caller publishes, and waits for a slow network if it `waits`. Without
    subscribers nothing is sent, but for latched topics; a sample is not even encoded before it is requested. With
    `sends_all` everything is sent.
    """

    sends_all = False

    def __init__(
        self,
        session: Session,
        node: str,
        epoch_ns: int,
        prefix: str = "",
        excluded_topics: Sequence[str] = (),
        waits: bool = False,
        variances: Mapping[str, tuple[float, ...]] = MappingProxyType({}),
        of: Identity | None = None,
        thread: PublishingThread | None = None,
    ) -> None:
        self._thread = thread
        self._defer: Callable[..., None] = thread.append if thread else _call
        self._session = session
        self._node = node
        self._prefix = prefix
        self._excluded_topics = excluded_topics
        self._variances = variances
        self._whole = sys.maxsize if waits else LARGE  # bytes that are sent at once
        self.stamps = Stamps(epoch_ns)
        self.graph = Node(session, node, of)
        self._publishers: dict[str, Publisher] = {}  # of the topics there was something to say on so far
        self._outlets: dict[str, list[Publisher]] = {}  # by the simulator's name for a sample: where it goes out
        self._made: set[str] = set()  # names of samples of which one was made into messages
        self._unsent: dict[str, tuple[Any, int]] = {}  # the newest of those without subscribers, and when it came

    def declare(self, names: Iterable[str]) -> None:
        """Declare the publishers of samples with these names, so that ROS sees their topics before the first one."""
        self._defer(self._declare_outlets, tuple(names))

    def sample(self, topic: str, sample: Any) -> bool:
        """Publish one sensor sample (NED, FRD) under the simulator's name for it; False if it has no subscribers."""
        received_ns = now_ns()
        outlets = self._outlets.get(topic)
        for publisher in outlets or ():
            if publisher.has_subscribers:
                break
        else:
            if topic in self._made:  # the first is made into messages, heard or not: one of the user's own may be wrong
                self._unsent[topic] = sample, received_ns
                return False
        self._unsent.pop(topic, None)
        self._defer(self._send_sample, topic, sample, self.stamps.stamp(sample.time_ns), received_ns)
        return True

    def catch_up(self) -> None:
        """Encode the stored samples, for late joiners that request the last messages; called in another thread."""
        for topic in list(self._unsent):
            sample, received_ns = self._unsent.pop(topic, (None, 0))
            if sample is None:  # there was a newer one, which has been sent
                continue
            with suppress(ConfigError):  # of a user's own sensor; told when it is to be sent
                for name, payload in self._messages(topic, sample, self.stamps.stamp(sample.time_ns)):
                    self._publishers[name].store_last(payload, to_wall_ns(received_ns))

    def trace(self, instants: tuple[int, ...]) -> None:
        """Publish the instants of one command's way, see `hil.slave.loop.Trace`."""
        self._defer(self._send_trace, instants)

    def diagnostics(self, name: str, level: int, message: str, values: dict[str, str]) -> None:
        """Publish the state of health, here and now; `level` 0 ok, 1 warning, 2 error."""
        now = self.stamps.wall_ns(now_ns())
        self._send("diagnostics", ros.encode_diagnostics(now, [(name, level, message, values)]), now_ns())
        if self.has_subscribers(("/diagnostics",)):  # where tools of ROS look for those of all nodes
            status = f"{self._node}: {name}", level, message, values
            self._send("/diagnostics", ros.encode_diagnostics(now, [status]), now_ns())

    def put(self, name: str, payload: bytes) -> None:
        """Publish a message on a topic of `hil.ros.topics`; it is stored if there are no subscribers."""
        self._defer(self._send, name, payload, now_ns())

    def wake_publisher(self) -> None:
        """Let the thread publish what it was given; once a step. Raises ConfigError of a sample that is none."""
        if self._thread:
            self._thread.wake()

    @property
    def dropped(self) -> int:
        """Number of samples and messages that were dropped because the network blocked the publishing thread."""
        return self._thread.dropped if self._thread else 0

    def has_subscribers(self, names: Sequence[str]) -> bool:
        """Return whether one of these topics has subscribers, or may have: it is not declared yet."""
        publishers = [self._publishers.get(name) for name in names]
        return any(publisher is None or publisher.has_subscribers for publisher in publishers)

    @property
    def sent(self) -> int:
        """Number of messages sent so far."""
        return sum([publisher.sequence for publisher in list(self._publishers.values())])

    def _send_sample(self, topic: str, sample: Any, stamp_ns: int, received_ns: int) -> None:
        """Send the messages of a sample with this stamp (ns since 1970), which came at that instant (monotonic ns)."""
        messages = self._messages(topic, sample, stamp_ns)
        self._made.add(topic)
        if topic not in self._outlets:  # it was not declared: its first messages show on which topics it goes out
            self._outlets[topic] = [self._publishers.get(name) or self._declare(name) for name, _ in messages]
        for name, payload in messages:
            self._send(name, payload, received_ns)

    def _send_trace(self, instants: tuple[int, ...]) -> None:
        self._send("trace", ros.encode_int64_array(instants), now_ns())  # a clock exchange: it is sent when it leaves

    def _send(self, name: str, payload: bytes, received_ns: int) -> None:
        publisher = self._publishers.get(name) or self._declare(name)
        if len(payload) > self._whole and not publisher.background:
            self._session.publish_in_background(publisher)
        if publisher.has_subscribers:
            publisher.put(payload, to_wall_ns(received_ns))
        else:
            publisher.store_last(payload, to_wall_ns(received_ns))

    def _messages(self, topic: str, sample: Any, stamp_ns: int) -> list[tuple[str, bytes]]:
        # What sample._replace(time_ns=...) gives, at half its price: each begins with its time.
        stamped = tuple.__new__(type(sample), (stamp_ns, *sample[1:]))
        messages = ros.encoder(topic)(stamped, self._prefix, *self._variances.get(topic, ()))
        return [message for message in messages if message[0] not in self._excluded_topics]

    def _declare_outlets(self, samples: tuple[str, ...]) -> None:
        for sample in samples:
            names = [name for name in sample_topics(sample) if name not in self._excluded_topics]
            if names:
                self._outlets[sample] = [self._publishers.get(name) or self._declare(name) for name in names]

    def _declare(self, name: str) -> Publisher:
        publisher = self._publishers[name] = self._session.publisher(self._node, TOPICS[name])
        self.graph.publishes(TOPICS[name], self._node)
        if not (self.sends_all or publisher.topic.qos.latched):
            self._session.watch_subscribers(publisher)
        return publisher
