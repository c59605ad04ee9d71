"""Publish one topic of one node, with the keys and attachments of rmw_zenoh."""

import os
from collections.abc import Callable
from contextlib import suppress
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import zenoh

from hil.common.errors import NetworkError
from hil.ros import dialect
from hil.ros import encoders as ros
from hil.ros.topics import TOPICS, Priority, Topic, hash_of

if TYPE_CHECKING:
    from hil.network.reception import ReaderThread

WAITING = 1  # large messages that may wait for the sending thread
# ZError: the session was closed. RuntimeError, of the Python bindings: another thread is undeclaring the publisher.
_UNDECLARED = (zenoh.ZError, RuntimeError)

_PRIORITIES: dict[Priority, zenoh.Priority] = {
    "real_time": zenoh.Priority.REAL_TIME,
    "data": zenoh.Priority.DATA,
    "background": zenoh.Priority.BACKGROUND,
}


def _ended() -> SimpleNamespace:
    """Return what replaces a publisher of a closed session: it publishes nothing and has no subscribers."""
    return SimpleNamespace(
        put=lambda *_, **__: None, matching_status=SimpleNamespace(matching=False), declare_matching_listener=bool
    )


def close_session(session: zenoh.Session) -> None:
    """Close a session of the library. If the library gives up (after 10 s), abandon it without an error."""
    with suppress(zenoh.ZError):
        session.close()  # type: ignore[no-untyped-call]  # zenoh leaves it unannotated


class Declared:
    """A declaration on the library's session, repeated on each session that replaces it.

    `current` is the library's object; it lives as long as this one. `name` is the endpoint, for the error text.
    Raises NetworkError while the session is lost.
    """

    def __init__(self, declare: Callable[[zenoh.Session], Any], session: zenoh.Session, name: str) -> None:
        self._declare = declare
        try:
            self.current = declare(session)
        except zenoh.ZError:
            raise NetworkError(f"no connection to {name} at this moment; try again when it is back") from None

    def renew(self, session: zenoh.Session) -> None:
        """Repeat the declaration on this session."""
        self.current = self._declare(session)

    def end_publishing(self) -> None:
        """Undeclare `current` if it is a publisher; later messages are dropped."""
        if not hasattr(self.current, "put") or isinstance(self.current, SimpleNamespace):
            return
        from hil.network.workarounds.kept_session import undeclare

        publisher, self.current = self.current, _ended()  # later calls of `put` no longer reach the publisher
        undeclare(publisher)


Declare = Callable[[Callable[[zenoh.Session], Any]], Declared]


class Publisher:
    """Publish one topic of one node: number and stamp messages, and store the last.

    `gid` (16 bytes) identifies the publisher; `master` (likewise) its master, if that has several. `last` is payload
    and attachment, None before the first message. Messages that the network cannot take in time are dropped; with
    `wait` the caller waits; in the background, another thread waits. `has_subscribers` is valid once
    `watch_subscribers` was called, before that true. `declare` declares on the library's session, see
    `hil.network.session.Session`; while that is closed nothing is sent.
    """

    background = False
    has_subscribers = True

    def __init__(self, declare: Declare, node: str, topic: Topic, wait: bool = False, key: str = "") -> None:
        self.topic = topic
        self.key = key or key_of(topic, node)
        self._declare = declare
        self._publisher = declare(lambda session: _declare(session, self.key, topic, wait))
        self._send: Callable[..., None] = self._send_now
        self.gid = os.urandom(16)
        self.master = b""
        self.sequence = 0
        self.last: tuple[bytes, bytes] | None = None

    def put(self, payload: bytes, wall_ns: int) -> int:
        """Send `payload` with its time (ns since 1970); return its sequence number."""
        self.sequence = sequence = self.sequence + 1
        attachment = ros.pack_attachment(sequence, wall_ns, self.gid) + self.master
        self.last = payload, attachment
        self._send(payload, attachment)
        return sequence

    def check_subscribers(self) -> bool:
        """Return whether there are subscribers now; False if the session was closed."""
        try:
            return is_matched(self._publisher.current)
        except _UNDECLARED:
            return False

    def store_last(self, payload: bytes, wall_ns: int) -> None:
        """Store a message as the last one without sending it, because there are no subscribers."""
        self.last = payload, ros.pack_attachment(self.sequence, wall_ns, self.gid)

    def watch_subscribers(self, worker: "ReaderThread") -> None:
        """Track whether there are subscribers; the thread of `worker` checks when that may have changed."""

        def update(_: object) -> None:
            with suppress(*_UNDECLARED):
                self.has_subscribers = self.background or is_matched(self._publisher.current)

        queue = worker.open_queue(update)
        self._declare(lambda _: self._publisher.current.declare_matching_listener(queue.callback))
        queue.put(None)

    def publish_in_background(self, worker: "ReaderThread") -> None:
        """Send in the thread of `worker` from now on; of the messages that wait there, only the newest is sent.

        The priority becomes the lowest, because publishers of equal priority wait for each other.
        """
        self.background = self.has_subscribers = True
        topic = self.topic._replace(priority="background")
        self._publisher = self._declare(lambda session: _declare(session, self.key, topic))
        queue = worker.open_queue(lambda message: self._send_now(message[0], message[1]), WAITING)
        self._send = lambda payload, attachment: queue.put((payload, attachment))

    def _send_now(self, payload: bytes, attachment: bytes) -> None:
        with suppress(*_UNDECLARED):
            self._publisher.current.put(payload, attachment=attachment)


def key_of(topic: Topic, node: str) -> str:
    """Return the key of a node's topic, the same as that of ROS nodes of our ROS 2 release."""
    return ros.data_key(dialect.domain(), topic.full_name(node), topic.type, hash_of(topic.type))


def read_key(key: str) -> tuple[str, bool]:
    """Return the name of a node's topic in a key of `key_of`, and whether the key has the type of our topic."""
    name, dds, _ = key.split("/", 2)[2].rsplit("/", 2)  # a topic's name may contain "/"
    return name, name not in TOPICS or dds == ros.dds_name(TOPICS[name].type)


def is_matched(publisher: zenoh.Publisher) -> bool:
    """Return whether the publisher has subscribers outside this session."""
    return bool(publisher.matching_status.matching)  # type: ignore[attr-defined]  # zenoh annotates another type


def _declare(session: zenoh.Session, key: str, topic: Topic, wait: bool = False) -> Any:
    declare: Any = zenoh.Session.declare_publisher
    if topic.qos.latched:
        from hil.network.latched import declare_publisher as declare
    return declare(
        session,
        key,
        priority=_PRIORITIES[topic.priority],
        express=topic.express,
        congestion_control=zenoh.CongestionControl.BLOCK if wait else zenoh.CongestionControl.DROP,
        allowed_destination=zenoh.Locality.REMOTE,
    )
