"""Receive everything that vehicles publish and are sent, at low cost, for recorders and displays.

A tap visits each slave (or a router), and so also gets the commands that others send a slave. Many vehicles send
thousands of messages a second; a thread that wakes for each would take more of the processor than all the rest, so they
are fetched in batches, and the library notes when each came.
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

from hil.common.clock import NS_PER_S, now_ns, to_wall_ns
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

# By default one thread of the library polls and wakes another for each message; so one does both.
ONE_THREAD = "(app: (worker_threads: 1), rx: (handover: app), net: (handover: app), tx: (handover: app))"
DEPTH = 1 << 14  # messages of one endpoint that may wait; beyond it the oldest are dropped, and counted as missed
MOST_NAMES = 4096  # publishers, keys and topics that are remembered; the oldest is forgotten: anybody can make names
LINKS = 64  # news of links that may wait
RETRY_S = 0.2
PATIENCE_NS = 5 * NS_PER_S  # until it is reported first that somebody is not there
COMPLAINT_PERIOD_NS = 60 * NS_PER_S


def save_processor() -> None:
    """Reduce this process's cost of receiving by a third; call it before the first session opens."""
    os.environ["ZENOH_RUNTIME"] = ONE_THREAD  # whatever a slave that started this process has chosen for itself
    if hasattr(os, "sched_setscheduler"):  # Linux
        os.sched_setscheduler(0, os.SCHED_BATCH, os.sched_param(0))  # lets others finish first, takes more at once


class _Publisher:
    """One publisher of one topic: its name and type, and the number of the last message."""

    __slots__ = ("last", "topic", "type")

    def __init__(self, topic: str, kind: str, last: int) -> None:
        self.topic = topic
        self.type = kind
        self.last = last


class _Line:
    """The session with one endpoint: `receivers` give the next message of a subscription, or None; `news` of links."""

    def __init__(self, session: zenoh.Session, endpoint: str, lease: float) -> None:
        self.session = session
        self.endpoint = endpoint
        self.count = 0  # of messages
        self.unread, self._stall, self._checked_ns = UnreadLinks(lease), StallDetector(lease), 0
        self.news = session.info.declare_link_events_listener(zenoh.handlers.RingChannel(LINKS), history=True)
        history = HistoryConfig(detect_late_publishers=True)
        latched = [topic.full_name("*") for topic in TOPICS.values() if topic.qos.latched]
        self._subscribers: list[Any] = [  # their type does not declare `try_recv`
            session.declare_subscriber(f"{dialect.domain()}/**", zenoh.handlers.RingChannel(DEPTH)),
            # What comes by both is dropped as the same.
            *[
                declare_advanced_subscriber(session, f"{dialect.domain()}{name}/*/*", _channel(), history=history)
                for name in latched
            ],
        ]
        self.receivers = [subscriber.try_recv for subscriber in self._subscribers]
        self._known: dict[str, Any] = {}  # a key is known as long as someone holds what declaring it gave

    def links(self) -> list[tuple[str, str, str]]:
        """Return of each link the identity of the peer and both addresses, ours and the peer's."""
        return [(str(link.zid), link.src, link.dst) for link in self.session.info.links()]

    def is_stalled(self, now: int) -> bool:
        """Return whether messages have come, and do not any more although there is a link."""
        if now - self._checked_ns < CHECK_NS or not self.count:
            return False
        self._checked_ns = now
        return self._stall.is_stalled(now, 0, self.count, is_deaf=bool(self.links()))

    def learn(self, key: str) -> None:
        """Make messages with this key cheaper, on the wire and here.

        Of a declared key the library remembers the subscribers, which it otherwise seeks again for each message. And a
        publisher, through which nothing is ever sent, gives the other end a number for the key, which then comes in
        place of the text: 100 bytes less of 240.
        """
        if key not in self._known and len(self._known) < MOST_NAMES:
            self._known[key] = self.session.declare_keyexpr(key), self.session.declare_publisher(key)

    def close(self) -> None:
        """Close the session, its publishers before it: the library never frees one of a session that was closed.

        Subscribers it frees; undeclared, they would let the other end's memory grow.
        """
        with suppress(zenoh.ZError):
            for _, publisher in self._known.values():
                publisher.undeclare()
        self._known.clear()
        close_session(self.session)


class Tap:
    """Subscribe to all topics at `endpoints`, with the last messages of latched topics. Use as a context.

    An endpoint that is not there yet, or goes away, is waited for. `missed` counts what was sent and did not come, by
    the gaps in the numbers of each publisher. `reconnections` counts links that the library did not read, and sessions
    that were opened again as nothing came over them any more (`hil.network.unread_links`, `hil.network.stall`). Raises
    NetworkError for an invalid endpoint.
    """

    def __init__(self, endpoints: list[str], network: Network = Network(), security: "Security | None" = None) -> None:
        texts = [settings("client", (), (endpoint,), network, security) for endpoint in endpoints]
        self._settings = dict(zip(endpoints, texts, strict=True))
        self.connected: set[str] = set()
        self.missed = self.reconnections = self._reported = 0
        self._lease = network.lease
        # By who publishes, and the key: all commands of a master have one gid, and each topic numbers of its own.
        self._publishers: dict[tuple[bytes, str], _Publisher | None] = {}
        self._topics: dict[str, tuple[str, str] | None] = {}
        self._lines: list[_Line] = []
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
        """Return what has come since the last call, in the order it came."""
        messages = []
        for line in tuple(self._lines):
            if line.news.try_recv() is not None:  # a new link; see hil.network.sockets
                free_sockets()
            self.reconnections += line.unread.mend(line)
            for receive in line.receivers:
                while (sample := receive()) is not None:
                    line.count += 1
                    if message := self._message(line, sample):
                        messages.append(message)
            if line.is_stalled(now_ns()):
                self._reopen(line)
        messages.sort(key=_logged_time)
        return messages

    def complaint(self) -> str:
        """Return which endpoints have not answered yet, or that a link was cut, if a report is due; else empty."""
        if self.reconnections > self._reported:
            self._reported = self.reconnections
            return "nothing came over a link that is there; connecting again"
        missing = [endpoint for endpoint in self._settings if endpoint not in self.connected]
        if not missing or now_ns() < self._complaint_ns:
            return ""
        self._complaint_ns = now_ns() + COMPLAINT_PERIOD_NS
        return f"still nobody at {', '.join(missing)}; waiting"

    def close(self) -> None:
        """End it; takes as long as an attempt to connect may. Closing twice is harmless."""
        self._closing.set()
        for thread in self._threads:  # one that the ending interpreter catches inside the library aborts the process
            thread.join()
        for line in self._lines:
            line.close()
        self._lines.clear()

    def _reopen(self, line: _Line) -> None:
        """Close a line and open it again, in a thread: both may take a while.

        Once: the new line is left alone until messages come, as there may be nobody who publishes.
        """
        self.reconnections += 1
        self._lines.remove(line)

        def reopen() -> None:
            line.close()
            self._open(line.endpoint, self._settings[line.endpoint])

        self._start(line.endpoint, reopen)

    def _start(self, endpoint: str, work: Callable[[], None]) -> None:
        thread = threading.Thread(target=work, name=f"tap {endpoint}", daemon=True)
        thread.start()
        self._threads = [*[thread for thread in self._threads if thread.is_alive()], thread]

    def _open(self, endpoint: str, text: str) -> None:
        """Try until the endpoint is there; from then on the library connects again after each loss."""
        config = zenoh.Config.from_json5(text)
        config.insert_json5("timestamping/enabled", "true")  # of what comes, with the time when it came
        while not self._closing.is_set():
            with suppress(zenoh.ZError):
                self._lines.append(_Line(zenoh.open(config), endpoint, self._lease))
                self.connected.add(endpoint)
                return
            self._closing.wait(RETRY_S)

    def _message(self, line: _Line, sample: zenoh.Sample) -> Message | None:
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
            publisher = self._add_publisher(line, key, sequence, gid)
        if publisher is None or sequence <= publisher.last:  # the same, by another way
            return None
        self.missed += sequence - publisher.last - 1
        publisher.last = sequence
        return Message(publisher.topic, publisher.type, sequence, sent_ns, came_ns, sample.payload.to_bytes())

    def _add_publisher(self, line: _Line, key: str, sequence: int, gid: bytes) -> _Publisher | None:
        topic = self._topic(key)
        line.learn(key)
        while len(self._publishers) >= MOST_NAMES:
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
    """Return topic and type of a key: the inverse of `ros.data_key`. None for what is no topic."""
    parts = key.split("/")
    package, _, name = parts[-2].partition("::") if len(parts) > 3 else ("", "", "")
    kind, _, last = name.partition("::dds_::")
    if not (parts[-1].startswith("RIHS01_") and last.endswith("_")):
        return None
    return "/" + "/".join(parts[1:-2]), f"{package}/{kind}/{last[:-1]}"
