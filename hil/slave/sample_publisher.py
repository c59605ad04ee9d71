"""Publish simulator samples as ROS messages, each on its topic."""

import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, NamedTuple

from hil.common.clock import now_ns, to_wall_ns
from hil.common.errors import ConfigError
from hil.network.publisher import Publisher
from hil.network.session import Session
from hil.network.settings import BATCH
from hil.recording.stamps import Stamps
from hil.ros import encoders as ros
from hil.ros.graph import Identity, Node
from hil.ros.topics import TOPICS, Topic, sample_topics
from hil.slave.publishing import PublishingThread

if TYPE_CHECKING:
    from hil.ros.diagnostics import Diagnostics

LARGE = BATCH - 1024  # bytes; a longer message may be sent in fragments, each of which may have to wait


def _call(call: Callable[..., None], *arguments: Any) -> None:
    """Make a call in the caller's own thread."""
    call(*arguments)


class MessageContent(NamedTuple):
    """Contents of messages: `prefix` begins the frame names, `variances` are those of `sim.sensors.variances`.

    `excluded_topics` are not published.
    """

    prefix: str = ""
    excluded_topics: Sequence[str] = ()
    variances: Mapping[str, tuple[float, ...]] = MappingProxyType({})


class SamplePublisher:
    """Publish the samples of the slave as one node.

    `epoch_ns` is the initial wall time (ns since 1970) of simulation time 0; `stamps` converts simulation time to
    message stamps. `of` is the identity of a node in another process, whose samples this one publishes.
    `graph` is the node in the ROS graph.

    With a `thread`, that thread publishes, and no method waits for the network except `diagnostics`, which the loop
    must not call. Without one the caller publishes, and waits for a slow network if `waits` is true.

    Without subscribers nothing is sent, except on latched topics; a sample is not even encoded until it is requested.
    With `record` everything is sent, and `record` gets each message after that: topic, payload, sequence number.
    """

    def __init__(
        self,
        session: Session,
        node: str,
        epoch_ns: int,
        content: MessageContent = MessageContent(),
        waits: bool = False,
        of: Identity | None = None,
        thread: PublishingThread | None = None,
        record: Callable[[Topic, bytes, int], None] | None = None,
    ) -> None:
        self._record = record
        self._thread = thread
        self._defer: Callable[..., None] = thread.append if thread else _call
        self._session = session
        self._node = node
        self._content = content
        self._max_foreground_bytes = sys.maxsize if waits else LARGE  # longer messages are sent in the background
        self.stamps = Stamps(epoch_ns)
        self.graph = Node(session, node, of)
        self._publishers: dict[str, Publisher] = {}  # topic -> publisher, for topics used so far
        self._outlets: dict[str, list[Publisher]] = {}  # the simulator's name of a sample -> its publishers
        self._encoded: set[str] = set()  # names of samples that have been encoded at least once
        self._unsent: dict[str, tuple[Any, int]] = {}  # newest sample without subscribers, and its time (ns)

    def declare(self, names: Iterable[str]) -> None:
        """Declare the publishers for samples with these names, so that ROS sees their topics from the start."""
        self._defer(self._declare_outlets, tuple(names))

    def publish_sample(self, topic: str, sample: Any) -> bool:
        """Publish a sensor sample (NED, FRD) with the simulator's name for it; False if it has no subscribers."""
        received_ns = now_ns()
        outlets = self._outlets.get(topic)
        for publisher in outlets or ():
            if publisher.has_subscribers:
                break
        else:
            if topic in self._encoded:  # the first sample is always encoded, to find errors of a user's own sensor
                self._unsent[topic] = sample, received_ns
                return False
        self._unsent.pop(topic, None)
        self._defer(self._send_sample, topic, sample, self.stamps.stamp(sample.time_ns), received_ns)
        return True

    def encode_unsent(self) -> None:
        """Encode the stored samples, for late joiners that request the last messages; called in another thread."""
        for topic in list(self._unsent):
            sample, received_ns = self._unsent.pop(topic, (None, 0))
            if sample is None:  # a newer one was sent meanwhile
                continue
            with suppress(ConfigError):  # from a user's own sensor; reported when a sample is sent
                for name, payload in self._messages(topic, sample, self.stamps.stamp(sample.time_ns)):
                    self._publishers[name].store_last(payload, to_wall_ns(received_ns))

    def publish_trace(self, instants: tuple[int, ...]) -> None:
        """Publish the times of one command, see `hil.slave.pilot_source.Trace`."""
        self._defer(self._send_trace, instants)

    def publish_diagnostics(self, name: str, level: int, message: str, values: dict[str, str]) -> None:
        """Publish the health status in the caller's thread; `level`: 0 ok, 1 warning, 2 error."""
        now = self.stamps.wall_ns(now_ns())
        self._send("diagnostics", ros.encode_diagnostics(now, [(name, level, message, values)]), now_ns())
        if self.has_subscribers(("/diagnostics",)):  # the topic on which ROS tools expect all nodes
            status = f"{self._node}: {name}", level, message, values
            self._send("/diagnostics", ros.encode_diagnostics(now, [status]), now_ns())

    def publish(self, name: str, payload: bytes) -> None:
        """Publish a message on a topic of `hil.ros.topics`; without subscribers it is stored as the last one."""
        self._defer(self._send, name, payload, now_ns())

    def wake_publisher(self) -> None:
        """Let the thread publish what is queued; call once a step. Raises ConfigError for an invalid sample."""
        if self._thread:
            self._thread.wake()

    def has_subscribers(self, names: Sequence[str]) -> bool:
        """Return whether one of these topics has subscribers, or is not declared yet and so may have some."""
        publishers = [self._publishers.get(name) for name in names]
        return any(publisher is None or publisher.has_subscribers for publisher in publishers)

    @property
    def sent(self) -> int:
        """Number of messages sent so far."""
        return sum([publisher.sequence for publisher in list(self._publishers.values())])

    def add_figures(self, figures: "Diagnostics") -> None:
        """Add the number of messages sent, and of samples and messages dropped because the network blocked."""
        figures.messages_sent = self.sent
        figures.messages_dropped = self._thread.dropped if self._thread else 0

    def _send_sample(self, topic: str, sample: Any, stamp_ns: int, received_ns: int) -> None:
        """Send the messages of a sample. `stamp_ns`: ns since 1970. `received_ns`: monotonic time of the sample."""
        messages = self._messages(topic, sample, stamp_ns)
        self._encoded.add(topic)
        if topic not in self._outlets:  # not declared: the first messages show its topics
            self._outlets[topic] = [self._publishers.get(name) or self._declare(name) for name, _ in messages]
        for name, payload in messages:
            self._send(name, payload, received_ns)

    def _send_trace(self, instants: tuple[int, ...]) -> None:
        self._send("trace", ros.encode_int64_array(instants), now_ns())  # time of sending: used to compare clocks

    def _send(self, name: str, payload: bytes, received_ns: int) -> None:
        publisher = self._publishers.get(name) or self._declare(name)
        if len(payload) > self._max_foreground_bytes and not publisher.background:
            self._session.publish_in_background(publisher)
        if publisher.has_subscribers:
            publisher.put(payload, to_wall_ns(received_ns))
        else:
            publisher.store_last(payload, to_wall_ns(received_ns))
        if self._record:
            self._record(publisher.topic, payload, publisher.sequence)

    def _messages(self, topic: str, sample: Any, stamp_ns: int) -> list[tuple[str, bytes]]:
        # Same result as sample._replace(time_ns=...), in half the time: the first field of each sample is time_ns.
        stamped = tuple.__new__(type(sample), (stamp_ns, *sample[1:]))
        messages = ros.encoder(topic)(stamped, self._content.prefix, *self._content.variances.get(topic, ()))
        return [message for message in messages if message[0] not in self._content.excluded_topics]

    def _declare_outlets(self, samples: tuple[str, ...]) -> None:
        for sample in samples:
            names = [name for name in sample_topics(sample) if name not in self._content.excluded_topics]
            if names:
                self._outlets[sample] = [self._publishers.get(name) or self._declare(name) for name in names]

    def _declare(self, name: str) -> Publisher:
        publisher = self._publishers[name] = self._session.publisher(self._node, TOPICS[name])
        publisher.gid = self.graph.publishes(TOPICS[name], self._node)
        if not (self._record or publisher.topic.qos.latched):
            self._session.watch_subscribers(publisher)
        return publisher
