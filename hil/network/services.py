"""ROS 2 services as rmw_zenoh transports them: a query with the request, a reply with the response.

Both are CDR, each with an attachment; the reply repeats the request's sequence number and gid
(ros2/rmw_zenoh, src/detail/rmw_service_data.cpp).
"""

import os
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping
from contextlib import suppress
from typing import Any

import zenoh

from hil.common.clock import NS_PER_S, now_ns, seconds_ns, to_wall_ns
from hil.common.errors import NetworkError
from hil.network.session import REFUSAL, Session
from hil.ros import dialect
from hil.ros import encoders as ros
from hil.ros import message as ros_message
from hil.ros.graph import Node
from hil.ros.message import Message
from hil.ros.topics import hash_of

WAITING = 16  # calls that may wait; beyond it the oldest ones get no answer
# Limit of a request, in bytes. The loop decodes requests between two steps, and 8 kB take 1 to 7 ms. A set_pose request
# has 200 bytes; one that sets the longest failures of eight thrusters has 2,250.
LARGEST = 8192
AGAIN_S = 0.1  # between two attempts of a call that got no answer

Answer = Callable[[Message], Mapping[str, Any]]


class Server:
    """Receive calls in zenoh's thread, answer them when `serve` is called, and send the answers in a third thread.

    So the caller of `serve`, a real-time loop, never waits for the network. `fileno` is readable while a call is
    waiting. `calls` counts answered calls, `malformed` invalid requests, `oversized` requests refused for their size,
    `dropped` calls that were removed from a full queue.
    """

    def __init__(self, session: Session, node: Node) -> None:
        self._session = session
        self._node = node
        self._waiting: deque[tuple[str, zenoh.Query]] = deque(maxlen=WAITING)  # its append and popleft are atomic
        self._answered: deque[tuple[str, zenoh.Query, tuple[bytes, bytes] | None]] = deque()  # answers to be sent
        self._last: dict[tuple[str, ros.Attachment], tuple[bytes, bytes]] = {}  # service and request id -> answer
        self._is_held_up = False  # the queue of answers is full: wait until one has been sent
        self._send_soon = session.deferred(self._send)
        self._event = os.eventfd(0, os.EFD_NONBLOCK | os.EFD_CLOEXEC)
        self._lock = threading.Lock()
        self._offered: dict[str, tuple[str, str, Answer]] = {}
        self.calls = 0
        self.malformed = 0
        self.oversized = 0
        self.dropped = 0

    def offer(self, name: str, type_name: str, handler: Answer) -> None:
        """Offer the service with the full name `name` ("/uuv1/arm"); `handler` returns the response to a request.

        Both are messages of hil.ros.message. Raises ConfigError for an unknown type.
        """
        key = ros.data_key(dialect.domain(), name, type_name, hash_of(type_name))
        self._offered[key] = (f"{type_name}_Request", f"{type_name}_Response", handler)
        ros_message.empty(f"{type_name}_Request")  # loads the definition now, not at the first call
        ros_message.empty(f"{type_name}_Response")
        self._session.answer_queries(key, lambda query: self._answer_query(key, query))
        self._node.serves(name, type_name)

    def fileno(self) -> int:
        """Return the descriptor that is readable while a call is waiting."""
        return self._event

    def serve(self) -> None:
        """Answer the oldest call. Only one, because the caller has other work between two calls."""
        with suppress(BlockingIOError):
            os.eventfd_read(self._event)
        if not self._waiting:
            return
        if len(self._answered) >= WAITING:
            self._is_held_up = True  # from now on `_send` signals when there is room
            if len(self._answered) >= WAITING:  # no room was made before `_send` knew
                return
        self._is_held_up = False
        key, query = self._waiting.popleft()
        if self._waiting:
            os.eventfd_write(self._event, 1)
        # Another thread has to hold the last reference to a query, because its deletion calls the network.
        self._answered.append((key, query, self._answer(key, query)))
        self._send_soon()

    def close(self) -> None:
        """Close the descriptor. Later calls get no answer."""
        with self._lock:
            os.close(self._event)
            self._event = -1
            self._waiting.clear()

    def _answer_query(self, key: str, query: zenoh.Query) -> None:
        payload = query.payload
        size = len(payload) if payload else 0
        with self._lock:
            if self._event >= 0 and size <= LARGEST:
                self.dropped += len(self._waiting) == WAITING
                self._waiting.append((key, query))
                os.eventfd_write(self._event, 1)
                return
            self.oversized += size > LARGEST
        with suppress(zenoh.ZError), query:
            if size > LARGEST:
                why = f"a request of {size} bytes is too large; ask for less at once, at most {LARGEST} bytes"
                query.reply_err(why, encoding=REFUSAL)

    def _answer(self, key: str, query: zenoh.Query) -> tuple[bytes, bytes] | None:
        """Return the response and its attachment; None for an invalid request.

        A request that is repeated, because its answer was lost with a link, is not executed again.
        """
        request_type, response_type, answer = self._offered[key]
        stamp = ros.unpack_attachment(query.attachment.to_bytes()) if query.attachment else None
        request = ros_message.decode(request_type, query.payload.to_bytes()) if query.payload else None
        if request is None or stamp is None:
            self.malformed += 1
            return None
        if (key, stamp) not in self._last:
            response = ros_message.encode(response_type, answer(request))
            self.calls += 1
            self._last[key, stamp] = response, ros.pack_attachment(stamp.sequence, to_wall_ns(now_ns()), stamp.gid)
            if len(self._last) > WAITING:
                del self._last[next(iter(self._last))]
        return self._last[key, stamp]

    def _send(self) -> None:
        """Send the oldest answer; in a thread of the session."""
        key, query, answer = self._answered.popleft()
        with suppress(zenoh.ZError), query:  # the caller may have left; the end of the `with` completes the call
            if answer:
                query.reply(key, answer[0], attachment=answer[1])
        with self._lock:
            if self._is_held_up and self._waiting and self._event >= 0:
                os.eventfd_write(self._event, 1)


def call(
    session: Session, name: str, type_name: str, request: Mapping[str, Any] | None = None, seconds: float = 5.0
) -> Message:
    """Call the service with the full name `name` ("/uuv1/arm", "std_srvs/srv/SetBool"); return its response.

    The call is repeated until there is an answer, for example after a network loss; a server executes it only once.
    Raises ConfigError for an unknown type or a request that does not fit it; NetworkError if no answer comes within
    `seconds` or the request is refused.
    """
    key = ros.data_key(dialect.domain(), name, type_name, hash_of(type_name))
    payload = ros_message.encode(f"{type_name}_Request", request or {})
    answer = call_bytes(session, key, f"{name} ({type_name})", payload, seconds)
    response = ros_message.decode(f"{type_name}_Response", answer)
    if response is None:
        raise NetworkError(f"{name} answers with something that is no response of that type")
    return response


def call_bytes(session: Session, key: str, name: str, request: bytes, seconds: float = 5.0) -> bytes:
    """Call the service `name` with the key of its type; request and response are CDR. Else like `call`."""
    attachment = ros.pack_attachment(1, to_wall_ns(now_ns()), os.urandom(16))
    reasons: list[str] = []
    end_ns = now_ns() + seconds_ns(seconds)
    while not reasons and (left_ns := end_ns - now_ns()) > 0:
        for _, response, _ in session.query(key, left_ns / NS_PER_S, request, attachment, reasons.append):
            return response
        time.sleep(AGAIN_S)
    if reasons:
        raise NetworkError(f"{name} refuses: {reasons[0]}")
    raise NetworkError(
        f"{name} did not answer within {seconds:g} s; `uuv-hil topic list` shows what is there; "
        "if the vehicle's scenario sets [ros] domain or distro, use that scenario here too"
    )
