"""Receive all messages from and to vehicles at low cost, for recorders and displays.

A tap connects to each slave (or to a router), and so also receives the commands that others send to a slave. Many
vehicles send thousands of messages a second. A thread that wakes for each message would take most of the processor
time, so messages are fetched in batches, and the library stamps each with its time of arrival.
"""

import os
import threading
from contextlib import suppress
from functools import partial
from operator import attrgetter
from typing import TYPE_CHECKING

import zenoh

from hil.common.clock import NS_PER_S, now_ns, to_wall_ns, use_one_arena
from hil.common.endpoint import LAN
from hil.network.buffered import join_publishers
from hil.network.roles import client_opener, open_when_present
from hil.network.session import Session
from hil.network.settings import Network
from hil.network.supervisor import Received
from hil.recording.mcap_file import Message
from hil.ros import dialect
from hil.ros import encoders as ros
from hil.ros.graph import ALL, Entity, read_token
from hil.ros.topics import TOPICS

if TYPE_CHECKING:
    from hil.network.security import Security

# By default one thread of the library polls and wakes another for each message; with this setting one thread does both.
ONE_THREAD = "(app: (worker_threads: 1), rx: (handover: app), net: (handover: app), tx: (handover: app))"
DEPTH = 1 << 14  # queued messages of one endpoint; beyond it the oldest are dropped, and counted as missed
MAX_NAMES = 4096  # limit of stored publishers, keys and topics, because anybody can invent names; the oldest goes
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


class _Source:
    """The session with one endpoint, with the channels of its messages; `count` is the number of those received."""

    def __init__(self, session: Session) -> None:
        self.session = session
        self.count = self._counted = 0
        self._openings = session.openings
        domain = dialect.domain()
        latched = [f"{domain}{topic.full_name('*')}/*/*" for topic in TOPICS.values() if topic.qos.latched]
        # A latched message that arrives by both subscriptions is dropped once, by its sequence number.
        self.channels = [session.collect(f"{domain}/**", DEPTH)]
        self.channels += [session.collect(keys, DEPTH, latched=True) for keys in latched]
        join_publishers(session, f"{domain}/**", f"uuv_hil_{os.getpid()}")

    def arrivals(self) -> Received:
        """Return what has arrived. Before the first message of an open session, none are missed: nobody may publish."""
        if self._openings != self.session.openings:
            self._openings, self._counted = self.session.openings, self.count
        return Received(0, self.count, self.count > self._counted and bool(self.session.links()))


class Tap:
    """Subscribe to all topics at `endpoints`, with the last messages of latched topics. Use as a context.

    It waits for endpoints that are not reachable yet, or are lost. `missed` counts messages that were sent and not
    received, by the gaps in each publisher's sequence numbers. `reconnections` counts how often links were closed or
    sessions opened again (`hil.network.supervisor`). Raises NetworkError for an invalid endpoint.
    """

    def __init__(self, endpoints: list[str], network: Network = Network(), security: "Security | None" = None) -> None:
        self._opener = partial(client_opener, network=network, security=security)
        self._open = {endpoint: self._opener(endpoint) for endpoint in endpoints}
        self.connected: set[str] = set()
        self.missed = self.reconnections = self._reported = 0
        # By the publisher's gid and the key: others may have one gid for all topics, with numbers for each topic.
        self._publishers: dict[tuple[bytes, str], _Publisher | None] = {}
        self._topics: dict[str, tuple[str, str] | None] = {}
        self._sources: list[_Source] = []
        self._threads: list[threading.Thread] = []
        self._closing = threading.Event()
        self._complaint_ns = 0

    def __enter__(self) -> "Tap":
        self._complaint_ns = now_ns() + PATIENCE_NS
        self._threads = [
            threading.Thread(target=self._search if endpoint == LAN else self._connect, args=(endpoint,), daemon=True)
            for endpoint in self._open
        ]
        for thread in self._threads:
            thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def receive(self) -> list[Message]:
        """Return the messages received since the last call, in the order of their arrival."""
        messages: list[Message] = []
        for source in tuple(self._sources):
            for channel in source.channels:
                receive = channel.current.try_recv
                with suppress(zenoh.ZError):  # the session is being reopened
                    while (sample := receive()) is not None:
                        source.count += 1
                        if message := self._message(source, sample):
                            messages.append(message)
        messages.sort(key=_logged_time)
        return messages

    def entities(self) -> list[Entity]:
        """Return the nodes at the endpoints, and what they publish, subscribe to, answer and call; by a query."""
        tokens = {token for source in tuple(self._sources) for token in source.session.tokens(ALL)}
        return [entity for token in tokens if (entity := read_token(token))]

    def complaint(self) -> str:
        """Return a text about endpoints that do not answer, or a link that was cut, if a report is due; else ""."""
        if self.reconnections > self._reported:
            self._reported = self.reconnections
            return "no message arrived although the link is open; connecting again"
        missing = [endpoint for endpoint in tuple(self._open) if endpoint not in self.connected]
        if not missing or now_ns() < self._complaint_ns:
            return ""
        self._complaint_ns = now_ns() + COMPLAINT_PERIOD_NS
        return f"still no answer from {', '.join(missing)}; waiting"

    def close(self) -> None:
        """Close all sessions; this may take as long as an attempt to connect. Closing twice is harmless."""
        self._closing.set()
        for thread in self._threads:  # a thread that is inside the library when the interpreter ends aborts the process
            thread.join()
        for source in self._sources:
            source.session.close()
        self._sources.clear()

    def _connect(self, endpoint: str) -> None:
        """Wait until the endpoint answers. After that the session reconnects by itself after each loss."""
        if session := open_when_present(self._open[endpoint], self._closing):
            source = _Source(session)
            session.supervisor.watch(endpoint, source.arrivals, self._on_reconnection, lambda: True)
            self._sources.append(source)
            self.connected.add(endpoint)

    def _search(self, _: str) -> None:
        """Connect to each endpoint that answers by multicast; search while there is none, or one without a link."""
        from hil.network.discovery import LOOK_S, LOST_S, find

        while not self._closing.wait(0.0 if not self._sources else LOST_S):
            if self._sources and all(source.session.links() for source in tuple(self._sources)):
                continue
            for endpoint in set(find(LOOK_S)) - self._open.keys():
                self.connected.add(LAN)
                self._open[endpoint] = self._opener(endpoint)
                self._connect(endpoint)

    def _on_reconnection(self, _: str) -> None:
        self.reconnections += 1

    def _message(self, source: _Source, sample: zenoh.Sample) -> Message | None:
        stamp = sample.timestamp
        came_ns = stamp.get_time_as_ntp64().as_nanos() if stamp else to_wall_ns(now_ns())
        key, attachment = str(sample.key_expr), sample.attachment
        stamp_fields = ros.unpack_attachment(attachment.to_bytes()) if attachment is not None else None
        if stamp_fields is None:
            topic = self._topic(key)
            return Message(*topic, 0, came_ns, came_ns, sample.payload.to_bytes()) if topic else None
        sequence, sent_ns, gid, _ = stamp_fields
        try:
            publisher = self._publishers[gid, key]
        except KeyError:
            publisher = self._add_publisher(source, key, sequence, gid)
        if publisher is None or sequence <= publisher.last:  # received already, by another path
            return None
        self.missed += sequence - publisher.last - 1
        publisher.last = sequence
        return Message(publisher.topic, publisher.type, sequence, sent_ns, came_ns, sample.payload.to_bytes())

    def _add_publisher(self, source: _Source, key: str, sequence: int, gid: bytes) -> _Publisher | None:
        topic = self._topic(key)
        source.session.learn(key)
        while len(self._publishers) >= MAX_NAMES:
            del self._publishers[next(iter(self._publishers))]
        self._publishers[gid, key] = publisher = _Publisher(*topic, sequence - 1) if topic else None
        return publisher

    def _topic(self, key: str) -> tuple[str, str] | None:
        if key not in self._topics:
            self._topics[key] = _read_key(key)
        return self._topics[key]


_logged_time = attrgetter("logged_ns")


def _read_key(key: str) -> tuple[str, str] | None:
    """Return topic and type of a key, the inverse of `ros.data_key`; None if it is no topic's key."""
    parts = key.split("/")
    package, _, name = parts[-2].partition("::") if len(parts) > 3 else ("", "", "")
    kind, _, last = name.partition("::dds_::")
    if not (parts[-1].startswith(("RIHS01_", dialect.NO_HASH)) and last.endswith("_")):
        return None
    return "/" + "/".join(parts[1:-2]), f"{package}/{kind}/{last[:-1]}"
