"""What publishes one topic of one node, as ROS 2 does on zenoh."""

import os
from collections.abc import Callable
from contextlib import suppress
from math import inf
from typing import TYPE_CHECKING, Any

import zenoh

from hil.topics import Priority, Topic, hash_of
from hil.transport import ros

if TYPE_CHECKING:
    from hil.transport.errands import Errands

WAITING = 1  # large messages that may wait for the thread that sends them

_PRIORITIES: dict[Priority, zenoh.Priority] = {
    "real_time": zenoh.Priority.REAL_TIME,
    "data": zenoh.Priority.DATA,
    "background": zenoh.Priority.BACKGROUND,
}


class Publisher:
    """Publishes one topic of one node; counts and stamps what it sends, and keeps the last of it.

    `gid` (16 bytes) tells publishers apart; `last` is payload and attachment, None before the first. What the network
    cannot take in time is left out; with `wait` it is waited for; what is sent `aside` holds up nobody. `wanted` tells
    whether anybody listens, where that is watched.
    """

    aside = False
    wanted = True
    _listener: Any = None  # it lives as long as someone holds it

    def __init__(self, session: zenoh.Session, node: str, topic: Topic, wait: bool = False) -> None:
        self.topic = topic
        self.key = key_of(topic, node)
        self._publisher = _declare(session, self.key, topic, wait)
        self._send: Callable[..., None] = self._publisher.put
        self.gid = os.urandom(16)
        self.sequence = 0
        self.last: tuple[bytes, bytes] | None = None

    def put(self, payload: bytes, wall_ns: int) -> int:
        """Send `payload` with its time (ns since 1970); the sequence number it went out with."""
        self.sequence = sequence = self.sequence + 1
        attachment = ros.pack_attachment(sequence, wall_ns, self.gid)
        self.last = payload, attachment
        self._send(payload, attachment=attachment)
        return sequence

    def keep(self, payload: bytes, wall_ns: int) -> None:
        """Keep as the last what is not sent, as nobody wants it."""
        self.last = payload, ros.pack_attachment(self.sequence, wall_ns, self.gid)

    def watch_audience(self, errands: "Errands") -> None:
        """From now on know whether anybody listens; the thread of `errands` looks whenever that may have changed."""

        def look(_: object) -> None:
            with suppress(zenoh.ZError):  # the session was closed
                self.wanted = self.aside or is_matched(self._publisher)

        self._listener = self._publisher.declare_matching_listener(errands.handler(look, inf))
        errands.queue(look, inf)(None)

    def send_aside(self, session: zenoh.Session, errands: "Errands") -> None:
        """From now on let the thread of `errands` send; while a message waits for it the next are left out.

        They go after everything else, as two who send with one priority wait for each other.
        """
        self.aside = self.wanted = True
        publisher = self._publisher = _declare(session, self.key, self.topic._replace(priority="background"))

        def send(message: tuple[bytes, bytes]) -> None:
            with suppress(zenoh.ZError):  # the session was closed
                publisher.put(message[0], attachment=message[1])

        take = errands.queue(send, WAITING)
        self._send = lambda payload, attachment: take((payload, attachment))


def key_of(topic: Topic, node: str) -> str:
    """The key on which we publish a topic of that node, and so do ROS nodes of our release of ROS 2."""
    return ros.data_key(0, topic.full_name(node), topic.type, hash_of(topic.type))


def is_matched(publisher: zenoh.Publisher) -> bool:
    """Whether anybody out there listens to what it publishes."""
    return bool(publisher.matching_status.matching)  # type: ignore[attr-defined]  # its type is not the one zenoh says


def _declare(session: zenoh.Session, key: str, topic: Topic, wait: bool = False) -> Any:
    declare: Any = zenoh.Session.declare_publisher
    if topic.qos.latched:
        from hil.transport.latched import declare_publisher as declare
    return declare(
        session,
        key,
        priority=_PRIORITIES[topic.priority],
        express=topic.express,
        congestion_control=zenoh.CongestionControl.BLOCK if wait else zenoh.CongestionControl.DROP,
        allowed_destination=zenoh.Locality.REMOTE,
    )
