"""Topics and services of the vehicles' network in a node of rclpy. Their bytes are CDR in both networks."""

import os
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from typing import Any, NamedTuple

import zenoh

from hil.client.topics import topic_of
from hil.common.clock import now_ns, to_wall_ns
from hil.common.errors import ConfigError
from hil.network.publisher import Declared, Publisher
from hil.network.reception import ReaderThread
from hil.network.services import call_bytes
from hil.network.session import Session
from hil.ros import dialect, encoders
from hil.ros.graph import Entity, Node
from hil.ros.topics import Qos

QUEUE = 256  # messages of one topic that may wait; beyond it the oldest are dropped
MOST = 1000  # messages that a publisher of "keep all" keeps, which otherwise would wait for slow readers
MANY = 64  # last messages of a latched topic that several vehicles share


class Source:
    """A session with a slave or a router, and this bridge's node in the graph there."""

    def __init__(self, session: Session, name: str) -> None:
        self.session, self.name = session, name
        self.node = Node(session, name)
        self.entities: dict[str, Entity] = {}  # by their tokens
        self._master = os.urandom(16)  # to a vehicle, the bridge is one
        self._publishers: dict[str, Publisher] = {}

    def put(self, entity: Entity, payload: bytes) -> None:
        """Publish on a topic that a vehicle subscribes to, with the key of the vehicle's release."""
        key = _key(entity)
        if key not in self._publishers:
            topic = topic_of(entity.topic, entity.type)
            self._publishers[key] = publisher = self.session.publisher("", topic, key=key)
            publisher.master = self._master
            with suppress(ConfigError):  # a type of the user's own has no hash here
                publisher.gid = self.node.publishes(topic, "")
        self._publishers[key].put(payload, to_wall_ns(now_ns()))


class Mirror(NamedTuple):
    """What stands for an entity in ROS. `check` is to be called some times a second, `close` at its end."""

    entity: Entity
    close: Callable[[], object]
    check: Callable[[], object] = lambda: None


class _PublishedTopic:
    """A topic for subscribers in ROS, received only while there are any; a latched one is kept.

    The publisher is reliable, which readers of either kind accept. `reader` is the thread that publishes.
    """

    def __init__(self, rclpy: Any, node: Any, source: Source, entity: Entity, kind: Any, reader: ReaderThread) -> None:
        self._node, self._source, self._entity = node, source, entity
        self._closed: type[Exception] = rclpy.exceptions.InvalidHandle
        qos = Qos(True, entity.qos.latched, MANY if is_shared(entity) and entity.qos.latched else entity.qos.depth)
        self._publisher = node.create_publisher(kind, entity.topic, _profile(rclpy, qos))
        self._last: deque[bytes] = deque(maxlen=qos.depth if qos.latched else 0)
        self._queue = reader.open_queue(self._publish, QUEUE)
        self._received: tuple[Node, Declared] | None = None

    def check(self) -> None:
        is_wanted = self._publisher.get_subscription_count() > 0
        if not is_wanted and not self._entity.qos.latched:
            self._end()
        elif is_wanted and self._received is None:
            source, entity = self._source, self._entity
            listener = Node(source.session, source.name, source.node.identity)
            channel = source.session.collect(_key(entity), QUEUE, entity.qos.latched, self._queue.callback)
            self._received = listener, channel
            with suppress(ConfigError):
                listener.subscribes(topic_of(entity.topic, entity.type)._replace(qos=entity.qos), "")

    def close(self) -> None:
        self._end()
        self._node.destroy_publisher(self._publisher)

    def _end(self) -> None:
        if self._received is not None:
            listener, channel = self._received
            self._source.session.withdraw(channel)
            listener.leave()
            self._received = None

    def _publish(self, sample: zenoh.Sample) -> None:
        payload = sample.payload.to_bytes()
        if payload not in self._last:  # else ROS keeps it already
            self._last.append(payload)
            with suppress(self._closed):  # meanwhile
                self._publisher.publish(payload)


def mirror(rclpy: Any, node: Any, source: Source, entity: Entity, kind: Any, reader: ReaderThread) -> Mirror:
    """Offer to ROS what an entity publishes, subscribes to or answers; `kind` is its class in ROS.

    `reader` is the thread that publishes. Raises what rclpy does for a name that ROS forbids.
    """
    if entity.kind == "MP":
        topic = _PublishedTopic(rclpy, node, source, entity, kind, reader)
        return Mirror(entity, topic.close, topic.check)
    if entity.kind == "MS":
        profile = _profile(rclpy, entity.qos)
        end = node.create_subscription(kind, entity.topic, partial(source.put, entity), profile, raw=True)
        return Mirror(entity, lambda: node.destroy_subscription(end))

    def answer(request: Any, _: Any) -> Any:
        """Wait for the vehicle's response. Raises NetworkError; the client then gets none."""
        payload = rclpy.serialization.serialize_message(request)
        response = call_bytes(source.session, _key(entity), entity.topic, payload)
        return rclpy.serialization.deserialize_message(response, kind.Response)

    group = rclpy.callback_groups.ReentrantCallbackGroup()
    service = node.create_service(kind, entity.topic, answer, callback_group=group)
    return Mirror(entity, lambda: node.destroy_service(service))


def is_shared(entity: Entity) -> bool:
    """Return whether several vehicles use its topic, such as /tf."""
    return entity.topic.count("/") == 1


def _key(entity: Entity) -> str:
    return encoders.data_key(dialect.domain(), entity.topic, entity.type, entity.type_hash)


def _profile(rclpy: Any, qos: Qos) -> Any:
    reliability, durability = rclpy.qos.ReliabilityPolicy, rclpy.qos.DurabilityPolicy
    return rclpy.qos.QoSProfile(
        depth=qos.depth or MOST,
        reliability=reliability.RELIABLE if qos.reliable else reliability.BEST_EFFORT,
        durability=durability.TRANSIENT_LOCAL if qos.latched else durability.VOLATILE,
    )
