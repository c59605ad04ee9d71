"""Receive all messages from and to vehicles at low cost, for recorders and displays.

A tap connects to each slave (or to a router), and so also receives the commands that others send to a slave. Many
vehicles send thousands of messages a second. A thread that wakes for each message would take most of the processor
time, so messages are fetched in batches, and the library stamps each with its time of arrival.
"""

import os
import threading
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from operator import attrgetter
from typing import TYPE_CHECKING, Any

import zenoh
from zenoh.ext import HistoryConfig, declare_advanced_subscriber

from hil.common.clock import NS_PER_S, now_ns, to_wall_ns, use_one_arena
from hil.network.publisher import close_session
from hil.network.settings import Network, settings
from hil.network.sockets import free_sockets
from hil.network.stall import StallDetector
from hil.network.unread_links import CHECK_NS, UnreadLinks
from hil.recording.mcap_file import Message
from hil.ros import dialect
from hil.ros import encoders as ros
from hil.ros.topics import TOPICS

if TYPE_CHECKING:
    from hil.network.security import Security

# By default one thread of the library polls and wakes another for each message; with this setting one thread does both.
ONE_THREAD = "(app: (worker_threads: 1), rx: (handover: app), net: (handover: app), tx: (handover: app))"
DEPTH = 1 << 14  # queued messages of one endpoint; beyond it the oldest are dropped, and counted as missed
MAX_NAMES = 4096  # limit of stored publishers, keys and topics, because anybody can invent names; the oldest goes
LINKS = 64  # queued events of links
RETRY_S = 0.2
PATIENCE_NS = 5 * NS_PER_S  # until the first report that an endpoint does not answer
COMPLAINT_PERIOD_NS = 60 * NS_PER_S


def save_resources() -> None:
    """Reduce this process's processor time for receiving by a third, and its memory. Call it before the first session.

    Messages wait in the library while other programs have the processors; it would keep that memory for each thread.
    """
    use_one_arena()
    os.environ["ZENOH_RUNTIME"] = ONE_THREAD  # replaces the setting of a slave that started this process
    if hasattr(os, "sched_setscheduler"):  # Linux
        os.sched_setscheduler(0, os.SCHED_BATCH, os.sched_param(0))  # runs less often, and longer each time


class _Publisher:
    """One publisher of one topic: its name and type, and the number of the last message."""

    __slots__ = ("last", "topic", "type")

    def __init__(self, topic: str, kind: str, last: int) -> None:
        self.topic = topic
        self.type = kind
        self.last = last


class _Connection:
    """The session with one endpoint.

    Each of `receivers` returns the next message of a subscription, or None. `link_events` has the events of links.
    """

    def __init__(self, session: zenoh.Session, endpoint: str, lease: float) -> None:
        self.session = session
        self.endpoint = endpoint
        self.count = 0  # received messages
        self.unread, self._stall, self._checked_ns = UnreadLinks(lease), StallDetector(lease), 0
        self.link_events = session.info.declare_link_events_listener(zenoh.handlers.RingChannel(LINKS), history=True)
        history = HistoryConfig(detect_late_publishers=True)
        latched = [topic.full_name("*") for topic in TOPICS.values() if topic.qos.latched]
        self._subscribers: list[Any] = [  # their type does not declare `try_recv`
            session.declare_subscriber(f"{dialect.domain()}/**", zenoh.handlers.RingChannel(DEPTH)),
            # A message that arrives by both subscriptions is dropped once, by its sequence number.
            *[
                declare_advanced_subscriber(session, f"{dialect.domain()}{name}/*/*", _channel(), history=history)
                for name in latched
            ],
        ]
        self.receivers = [subscriber.try_recv for subscriber in self._subscribers]
        self._known: dict[str, Any] = {}  # by key its declarations, which end when they are deleted

    def links(self) -> list[tuple[str, str, str]]:
        """Return for each link the peer's identity, our address, and the peer's address."""
        return [(str(link.zid), link.src, link.dst) for link in self.session.info.links()]

    def is_stalled(self, now: int) -> bool:
        """Return whether messages have stopped although the link is open."""
        if now - self._checked_ns < CHECK_NS or not self.count:
            return False
        self._checked_ns = now
        return self._stall.is_stalled(now, 0, self.count, is_unanswered=bool(self.links()))

    def learn(self, key: str) -> None:
        """Reduce the cost of messages with this key, on the wire and here.

        The library caches the subscribers of a declared key; otherwise it searches them for each message. A declared
        publisher, although it sends nothing, makes the peer send a number in place of the key's text: 140 bytes instead
        of 240.
        """
        if key not in self._known and len(self._known) < MAX_NAMES:
            self._known[key] = self.session.declare_keyexpr(key), self.session.declare_publisher(key)

    def close(self) -> None:
        """Close the session, after undeclaring its publishers, which the library does not free with the session.

        Subscribers are not undeclared: the session frees them, and undeclaring lets the peer's memory grow.
        """
        with suppress(zenoh.ZError):
            for _, publisher in self._known.values():
                publisher.undeclare()
        self._known.clear()
        close_session(self.session)


class Tap:
    """Subscribe to all topics at `endpoints`, with the last messages of latched topics. Use as a context.

    It waits for endpoints that are not reachable yet, or are lost. `missed` counts messages that were sent and not
    received, by the gaps in each publisher's sequence numbers. `reconnections` counts links that the library did not
    read, and sessions that were reopened because messages had stopped (`hil.network.unread_links`,
    `hil.network.stall`). Raises NetworkError for an invalid endpoint.
    """

    def __init__(self, endpoints: list[str], network: Network = Network(), security: "Security | None" = None) -> None:
        texts = [settings("client", (), (endpoint,), network, security) for endpoint in endpoints]
        self._settings = dict(zip(endpoints, texts, strict=True))
        self.connected: set[str] = set()
        self.missed = self.reconnections = self._reported = 0
        self._lease = network.lease
        # By the publisher's gid and the key: a master has one gid for all topics, and separate numbers for each topic.
        self._publishers: dict[tuple[bytes, str], _Publisher | None] = {}
        self._topics: dict[str, tuple[str, str] | None] = {}
        self._connections: list[_Connection] = []
        self._threads: list[threading.Thread] = []
        self._closing = threading.Event()
        self._complaint_ns = 0

    def __enter__(self) -> "Tap":
        self._complaint_ns = now_ns() + PATIENCE_NS
        for endpoint, text in self._settings.items():
            self._start(endpoint, partial(self._open, endpoint, text))
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def receive(self) -> list[Message]:
        """Return the messages received since the last call, in the order of their arrival."""
        messages = []
        for connection in tuple(self._connections):
            if connection.link_events.try_recv() is not None:  # a new link; see hil.network.sockets
                free_sockets()
            self.reconnections += connection.unread.close_faulty(connection)
            for receive in connection.receivers:
                while (sample := receive()) is not None:
                    connection.count += 1
                    if message := self._message(connection, sample):
                        messages.append(message)
            if connection.is_stalled(now_ns()):
                self._reopen(connection)
        messages.sort(key=_logged_time)
        return messages

    def complaint(self) -> str:
        """Return a text about endpoints that do not answer, or a link that was cut, if a report is due; else ""."""
        if self.reconnections > self._reported:
            self._reported = self.reconnections
            return "no message arrived although the link is open; connecting again"
        missing = [endpoint for endpoint in self._settings if endpoint not in self.connected]
        if not missing or now_ns() < self._complaint_ns:
            return ""
        self._complaint_ns = now_ns() + COMPLAINT_PERIOD_NS
        return f"still no answer from {', '.join(missing)}; waiting"

    def close(self) -> None:
        """Close all sessions; this may take as long as an attempt to connect. Closing twice is harmless."""
        self._closing.set()
        for thread in self._threads:  # a thread that is inside the library when the interpreter ends aborts the process
            thread.join()
        for connection in self._connections:
            connection.close()
        self._connections.clear()

    def _reopen(self, connection: _Connection) -> None:
        """Close a session and open it again, in a thread, because both may take a while.

        The new session is not reopened before it has received a message, as there may be no publisher.
        """
        self.reconnections += 1
        self._connections.remove(connection)

        def reopen() -> None:
            connection.close()
            self._open(connection.endpoint, self._settings[connection.endpoint])

        self._start(connection.endpoint, reopen)

    def _start(self, endpoint: str, work: Callable[[], None]) -> None:
        thread = threading.Thread(target=work, name=f"tap {endpoint}", daemon=True)
        thread.start()
        self._threads = [*[thread for thread in self._threads if thread.is_alive()], thread]

    def _open(self, endpoint: str, text: str) -> None:
        """Try until the endpoint answers. After that the library reconnects by itself after each loss."""
        config = zenoh.Config.from_json5(text)
        config.insert_json5("timestamping/enabled", "true")  # stamp received messages with their time of arrival
        while not self._closing.is_set():
            with suppress(zenoh.ZError):
                self._connections.append(_Connection(zenoh.open(config), endpoint, self._lease))
                self.connected.add(endpoint)
                return
            self._closing.wait(RETRY_S)

    def _message(self, connection: _Connection, sample: zenoh.Sample) -> Message | None:
        stamp = sample.timestamp
        came_ns = stamp.get_time_as_ntp64().as_nanos() if stamp else to_wall_ns(now_ns())
        key, attachment = str(sample.key_expr), sample.attachment
        stamp_fields = ros.unpack_attachment(attachment.to_bytes()) if attachment is not None else None
        if stamp_fields is None:
            topic = self._topic(key)
            return Message(*topic, 0, came_ns, came_ns, sample.payload.to_bytes()) if topic else None
        sequence, sent_ns, gid = stamp_fields
        try:
            publisher = self._publishers[gid, key]
        except KeyError:
            publisher = self._add_publisher(connection, key, sequence, gid)
        if publisher is None or sequence <= publisher.last:  # received already, by another path
            return None
        self.missed += sequence - publisher.last - 1
        publisher.last = sequence
        return Message(publisher.topic, publisher.type, sequence, sent_ns, came_ns, sample.payload.to_bytes())

    def _add_publisher(self, connection: _Connection, key: str, sequence: int, gid: bytes) -> _Publisher | None:
        topic = self._topic(key)
        connection.learn(key)
        while len(self._publishers) >= MAX_NAMES:
            del self._publishers[next(iter(self._publishers))]
        self._publishers[gid, key] = publisher = _Publisher(*topic, sequence - 1) if topic else None
        return publisher

    def _topic(self, key: str) -> tuple[str, str] | None:
        if key not in self._topics:
            self._topics[key] = _read_key(key)
        return self._topics[key]


def _channel() -> Any:
    return zenoh.handlers.RingChannel(DEPTH)


_logged_time = attrgetter("logged_ns")


def _read_key(key: str) -> tuple[str, str] | None:
    """Return topic and type of a key, the inverse of `ros.data_key`; None if it is no topic's key."""
    parts = key.split("/")
    package, _, name = parts[-2].partition("::") if len(parts) > 3 else ("", "", "")
    kind, _, last = name.partition("::dds_::")
    if not (parts[-1].startswith("RIHS01_") and last.endswith("_")):
        return None
    return "/" + "/".join(parts[1:-2]), f"{package}/{kind}/{last[:-1]}"
