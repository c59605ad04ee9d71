"""One zenoh session a process, with the settings that keep a command ahead of an image.

The slave listens, the master dials, never both. Two TCP links by priority with small send buffers: a
command never waits behind a picture in the kernel's buffer. Multicast discovery is off; loss of the
peer is noticed after one second; a reader is a thread of ours on a channel, because an open session
with a Python callback hangs the interpreter at exit.
"""

import os
import threading
from collections.abc import Callable
from typing import Any

import zenoh

from hil.errors import NetworkError
from hil.topics import TYPE_HASHES, Priority, Topic
from hil.transport import ros

LEASE_MS = 1000
RETRY_MS = (20, 50)  # first and longest pause between attempts to connect
SEND_BUFFER = 16384
BATCH = 8192

Deliver = Callable[[str, bytes, bytes], None]

_PRIORITIES: dict[Priority, zenoh.Priority] = {
    "real_time": zenoh.Priority.REAL_TIME,
    "data": zenoh.Priority.DATA,
    "background": zenoh.Priority.BACKGROUND,
}


def endpoints(endpoint: str) -> list[str]:
    """The two links of an endpoint "tcp/HOST:PORT": urgent traffic on PORT, the rest on PORT + 1.

    Raises NetworkError when the endpoint is not of this form.
    """
    scheme, _, address = endpoint.partition("/")
    host, _, port = address.rpartition(":")
    if scheme != "tcp" or not host or not port.isdigit() or not 0 < int(port) < 65535:
        raise NetworkError(f"endpoint {endpoint!r} is not of the form tcp/HOST:PORT, for example tcp/127.0.0.1:7447")
    buffer = f"#so_sndbuf={SEND_BUFFER}"
    return [f"tcp/{host}:{port}?prio=1-3{buffer}", f"tcp/{host}:{int(port) + 1}?prio=4-7{buffer}"]


def _configuration(listen: list[str], connect: list[str]) -> zenoh.Config:
    first, longest = RETRY_MS
    settings = {
        "mode": "peer",
        "listen": {"endpoints": listen},
        "connect": {
            "endpoints": connect,
            "retry": {"period_init_ms": first, "period_max_ms": longest, "period_increase_factor": 2},
        },
        "scouting": {"delay": 0, "multicast": {"enabled": False}, "gossip": {"enabled": False}},
        "transport": {
            "unicast": {"max_links": 2, "open_timeout": 500, "accept_timeout": 500},
            "link": {"tx": {"lease": LEASE_MS, "keep_alive": 4, "batch_size": BATCH}},
            "shared_memory": {"enabled": False},
        },
    }
    # Python's text of it is JSON5 but for the two words; the json module would cost 2 ms of every start.
    return zenoh.Config.from_json5(repr(settings).replace("False", "false").replace("True", "true"))


def listen(endpoint: str) -> "Session":
    """A session that waits for masters at `endpoint`. Raises NetworkError, also when the port is taken."""
    return _open(endpoint, "listen on", _configuration(listen=endpoints(endpoint), connect=[]))


def dial(endpoint: str) -> "Session":
    """A session that connects to a slave at `endpoint` as soon as it is there, and again after each loss."""
    return _open(endpoint, "dial", _configuration(listen=[], connect=endpoints(endpoint)))


class Listening:
    """A session that is being opened in a thread, while the caller does something else."""

    def __init__(self, endpoint: str) -> None:
        self._endpoint = endpoint
        self._session: Session | None = None
        self._error: NetworkError | None = None
        self._thread = threading.Thread(target=self._run, name="open session")
        self._thread.start()

    def _run(self) -> None:
        try:
            self._session = listen(self._endpoint)
        except NetworkError as error:
            self._error = error

    def session(self) -> "Session":
        """The open session. Raises NetworkError as `listen` does."""
        self._thread.join()
        if self._error:
            raise self._error
        assert self._session
        return self._session

    def cancel(self) -> None:
        """Close it, if it came to be open: for the case that something else failed meanwhile."""
        self._thread.join()
        if self._session:
            self._session.close()


def _open(endpoint: str, action: str, configuration: zenoh.Config) -> "Session":
    try:
        return Session(zenoh.open(configuration))
    except zenoh.ZError as error:
        raise NetworkError(f"cannot {action} {endpoint}: {_reason(str(error))}") from None


def _reason(text: str) -> str:
    if "Address already in use" in text:
        return "the port (or the next one) is in use; is another slave running there? Choose another with --listen"
    if "Cannot assign requested address" in text or "os error 99" in text:
        return "this machine does not have that address"
    return text.partition(" at /")[0]  # without the place in the library's source


class Publisher:
    """Publishes one topic of one node; counts and stamps what it sends."""

    def __init__(self, session: zenoh.Session, node: str, topic: Topic) -> None:
        self._publisher = session.declare_publisher(
            ros.data_key(0, f"{node}/{topic.name}", topic.type, TYPE_HASHES[topic.type]),
            priority=_PRIORITIES[topic.priority],
            express=topic.express,
            congestion_control=zenoh.CongestionControl.DROP,
            allowed_destination=zenoh.Locality.REMOTE,
        )
        self._gid = os.urandom(16)
        self.sequence = 0

    def put(self, payload: bytes, wall_ns: int) -> int:
        """Send `payload` with its time (ns since 1970); the sequence number it went out with."""
        self.sequence += 1
        self._publisher.put(payload, attachment=ros.pack_attachment(self.sequence, wall_ns, self._gid))
        return self.sequence


class Session:
    """The process's one session. Use as a context; leaving it ends the readers."""

    def __init__(self, session: zenoh.Session) -> None:
        self._session = session
        self._readers: list[threading.Thread] = []

    def __enter__(self) -> "Session":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def publisher(self, node: str, topic: Topic) -> Publisher:
        """A publisher of one topic of one node."""
        return Publisher(self._session, node, topic)

    def subscribe(self, node: str, topic: str, deliver: Deliver, depth: int) -> None:
        """Call `deliver(topic name, payload, attachment)` for what a node publishes, in a thread of its own.

        `topic` may be "*": all topics of the node. At most `depth` messages wait; beyond it the oldest are
        dropped. `deliver` must be quick and must not raise.
        """
        channel = self._session.declare_subscriber(f"0/{node}/{topic}/*/*", zenoh.handlers.RingChannel(depth))
        reader = threading.Thread(target=_read, args=(channel, deliver), name=f"reader {topic}", daemon=True)
        reader.start()
        self._readers.append(reader)

    def close(self) -> None:
        """Close the session and wait for its readers to end. Closing twice is harmless."""
        self._session.close()  # type: ignore[no-untyped-call]  # zenoh leaves it unannotated; it wakes the readers
        for reader in self._readers:
            reader.join(1.0)


def _read(channel: Any, deliver: Deliver) -> None:
    while True:
        try:
            sample = channel.recv()
        except zenoh.ZError:  # the session was closed
            return
        attachment = sample.attachment
        deliver(
            str(sample.key_expr).split("/", 3)[2],
            sample.payload.to_bytes(),
            attachment.to_bytes() if attachment is not None else b"",
        )
