"""Topics of any node by their names: who publishes them, their messages as they arrive, and the rate of these."""

import os
import select
import statistics
from collections.abc import Collection, Sequence
from typing import NamedTuple

from hil.common.clock import NS_PER_S, now_ns
from hil.common.errors import NetworkError
from hil.common.schema import nearest
from hil.common.stop import Wakeup
from hil.network.buffered import join_publishers
from hil.network.presence import fetch_last, watch_nodes
from hil.network.reception import MessageQueue
from hil.network.session import Session
from hil.ros import dialect, encoders, graph, types
from hil.ros.diagnostics import Diagnostics
from hil.ros.graph import Entity, Node
from hil.ros.topics import TOPICS, Topic

QUEUE = 1000
Arrival = tuple[int, str, bytes]  # instant (monotonic ns), key, payload


def entities(session: Session) -> list[Entity]:
    """Return the publishers, subscribers, servers and clients that nodes have declared."""
    return [entity for key in session.tokens(graph.ALL) if (entity := graph.read_token(key))]


def published_topics(session: Session) -> dict[str, Entity]:
    """Return a publisher of each published topic, by the topic's full name."""
    return {entity.topic: entity for entity in entities(session) if entity.kind == "MP"}


class Arrivals:
    """Queue of a topic's received messages; a loop can wait on it."""

    def __init__(self, session: Session, topic: str, latched: bool) -> None:
        self._event = Wakeup()
        self._waiting = waiting = MessageQueue(self._event.set, QUEUE)
        keys = f"{dialect.domain()}/{topic.strip('/')}/*/*"
        join_publishers(session, keys, f"uuv_hil_topic_{os.getpid()}")
        session.subscribe_keys(keys, lambda key, data, _: waiting.put((now_ns(), key, data)), QUEUE, latched)

    def receive(self, stop_fd: int, seconds: float) -> list[Arrival]:
        """Return the messages received so far; wait for one up to `seconds` if there is none.

        Raises KeyboardInterrupt when `stop_fd` becomes readable.
        """
        ready = select.select((stop_fd, self._event.fileno()), (), (), seconds)[0]
        if stop_fd in ready:
            raise KeyboardInterrupt
        if ready:
            self._event.clear()
        received: list[Arrival] = []
        self._waiting.take(received.append)
        return received


def first_arrivals(session: Session, name: str, wait: float, stop_fd: int) -> tuple[Arrivals, list[Arrival]]:
    """Return the arrivals of a topic by its full name, and the first of them.

    Raises NetworkError if there is none within `wait` s, KeyboardInterrupt when `stop_fd` becomes readable.
    """
    published = published_topics(session)
    latched = name in published and published[name].qos.latched
    watch_nodes(session)
    arrivals = Arrivals(session, name, latched)
    if name in published:  # a node in the graph: without one, descriptions of a vehicle are not made
        listener = Node(session, f"uuv_hil_topic_{os.getpid()}")
        listener.joins(published[name])
    received = arrivals.receive(stop_fd, wait)
    if not received:
        published = published_topics(session)  # topics declared since
        if name in published:
            raise NetworkError(f"{name} is published, but nothing was received within {wait:g} s; raise --wait")
        if sensor := _starting(session, name, published):
            raise NetworkError(
                f"nothing was received on {name} within {wait:g} s: the process of the pictures of {sensor} is "
                "still starting; ask again, or raise --wait"
            )
        raise NetworkError(f"nobody publishes {name}; {there_are(name, published)}")
    return arrivals, received


def _starting(session: Session, name: str, published: Collection[str]) -> str:
    """Return the sensor of a topic if it makes pictures and has not published any yet; else ""."""
    node, _, topic = name[1:].partition("/")
    sensor = topic.partition("/")[0]
    if any(each.startswith(f"/{node}/{sensor}/") for each in published):
        return ""
    received: list[bytes] = []
    fetch_last(session, node, lambda _topic, payload, *_: received.append(payload), "diagnostics")
    for payload in received:
        statuses = encoders.decode_diagnostics(payload)
        if statuses and sensor in (Diagnostics(statuses[0][3]).imaging_requested or {}):
            return sensor
    return ""


def there_are(name: str, known: Collection[str]) -> str:
    """Return the known names as text, for an error about an unknown one."""
    return f"there are: {', '.join(sorted(known)) or 'none'}{nearest(name, list(known))}"


class Rate(NamedTuple):
    """Rate of messages; there is none before the second one."""

    messages: int
    rate_hz: float | None = None
    least_gap_s: float | None = None
    greatest_gap_s: float | None = None
    gap_deviation_s: float | None = None


def rate(instants: Sequence[int]) -> Rate:
    """Return the mean rate of arrivals (ns), and how their gaps differ."""
    gaps = [(b - a) / NS_PER_S for a, b in zip(list(instants), list(instants)[1:], strict=False)]
    if not gaps:
        return Rate(len(instants))
    mean = len(gaps) / max(sum(gaps), 1e-9)
    return Rate(len(instants), mean, min(gaps), max(gaps), statistics.pstdev(gaps))


def topic_of(name: str, type_name: str) -> Topic:
    """Return the topic of a full name, with the priority of our topic of that name and type."""
    known = TOPICS.get(name) or TOPICS.get(name.rpartition("/")[2])
    if known and known.type == type_name:
        return known._replace(name=name)
    return Topic(name, type_name, 0, "data")


def whole_type(name: str) -> str:
    """Return "geometry_msgs/msg/Twist", also of "geometry_msgs/Twist". Raises ConfigError for an unknown one."""
    package, _, last = name.rpartition("/")
    whole = name if "/" in package else f"{package}/msg/{last}"
    types.definition(whole)
    return whole
