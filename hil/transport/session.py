"""One zenoh session a process, with the settings that keep a command ahead of an image.

The slave listens, the master dials, never both; with a router in between both dial it. How loss is noticed and mended
is in `hil.transport.settings`. A reader is a thread of ours on a channel, because an open session with a Python
callback hangs the interpreter at exit.
"""

import atexit
import os
import threading
from collections.abc import Callable
from contextlib import suppress
from typing import TYPE_CHECKING, Any

import zenoh

from hil.errors import NetworkError
from hil.topics import Priority, Topic, hash_of
from hil.transport import ros
from hil.transport.settings import Network, settings

if TYPE_CHECKING:
    from hil.transport.security import Security
    from hil.transport.tokens import Part, Presence

LATE_JOINERS = 8  # that may wait for the last state at once
ANSWER_WITHIN_S = 1.0

Deliver = Callable[[str, bytes, bytes], None]
Watch = Callable[["Presence", bool], None]

_PRIORITIES: dict[Priority, zenoh.Priority] = {
    "real_time": zenoh.Priority.REAL_TIME,
    "data": zenoh.Priority.DATA,
    "background": zenoh.Priority.BACKGROUND,
}


def listen(endpoint: str, network: Network = Network(), security: "Security | None" = None) -> "Session":
    """The session of a slave: it waits for masters at `endpoint`, and dials a router if `network` names one.

    Raises NetworkError, also when the port is taken.
    """
    text = settings("slave", (endpoint,), (network.router,) if network.router else (), network, security)
    return _open("listen on", endpoint, text)


def dial(*endpoints: str, network: Network = Network(), security: "Security | None" = None) -> "Session":
    """The session of a master: it connects to each slave as soon as it is there, and again after each loss.

    Raises NetworkError when an endpoint cannot be meant, or a router is not there.
    """
    text = settings("master", (), endpoints, network, security)
    return _open("dial", ", ".join(endpoints), text)


def route(endpoint: str, network: Network = Network(), security: "Security | None" = None) -> "Session":
    """The session of a router at `endpoint`, which forwards between all who dial it. Raises NetworkError."""
    text = settings("router", (endpoint,), (), network, security)
    return _open("listen on", endpoint, text)


class Listening:
    """A session that is being opened in a thread, while the caller does something else."""

    def __init__(self, endpoint: str, network: Network = Network(), security: "Security | None" = None) -> None:
        self._arguments = endpoint, network, security
        self._session: Session | None = None
        self._error: NetworkError | None = None
        self._thread = threading.Thread(target=self._run, name="open session")
        self._thread.start()

    def _run(self) -> None:
        try:
            self._session = listen(*self._arguments)
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


def _open(action: str, name: str, text: str) -> "Session":
    try:
        return Session(zenoh.open(zenoh.Config.from_json5(text)), name)
    except zenoh.ZError as error:
        raise NetworkError(f"cannot {action} {name}: {_reason(str(error))}") from None


def _reason(text: str) -> str:
    if "Address already in use" in text:
        return "the port (or the next one) is in use; is another slave running there? Choose another with --listen"
    if "Cannot assign requested address" in text or "os error 99" in text:
        return "this machine does not have that address"
    if "Unable to connect" in text:
        return "there is no router, or it refuses us; start it first, `uuv-hil router`"
    return text.partition(" at /")[0]  # without the place in the library's source


class Publisher:
    """Publishes one topic of one node; counts and stamps what it sends, and keeps the last of it.

    `gid` (16 bytes) tells publishers apart; `last` is payload and attachment, None before the first.
    """

    def __init__(self, session: zenoh.Session, node: str, topic: Topic) -> None:
        self.topic = topic
        self.key = ros.data_key(0, topic.full_name(node), topic.type, hash_of(topic.type))
        declare: Any = _latched if topic.qos.latched else zenoh.Session.declare_publisher
        self._publisher = declare(
            session,
            self.key,
            priority=_PRIORITIES[topic.priority],
            express=topic.express,
            congestion_control=zenoh.CongestionControl.DROP,
            allowed_destination=zenoh.Locality.REMOTE,
        )
        self.gid = os.urandom(16)
        self.sequence = 0
        self.last: tuple[bytes, bytes] | None = None

    def put(self, payload: bytes, wall_ns: int) -> int:
        """Send `payload` with its time (ns since 1970); the sequence number it went out with."""
        self.sequence += 1
        attachment = ros.pack_attachment(self.sequence, wall_ns, self.gid)
        self.last = payload, attachment
        self._publisher.put(payload, attachment=attachment)
        return self.sequence


def _late(session: zenoh.Session, keys: str, ring: Any) -> Any:
    """A subscriber that asks latched publishers what they said last."""
    from zenoh.ext import HistoryConfig, declare_advanced_subscriber

    return declare_advanced_subscriber(
        session, keys, ring, history=HistoryConfig(detect_late_publishers=True, max_samples=1)
    )


def _latched(session: zenoh.Session, key: str, **options: Any) -> Any:
    """A publisher whose last message late joiners get, as rmw_zenoh asks for it."""
    from zenoh.ext import CacheConfig, MissDetectionConfig, declare_advanced_publisher

    beat = MissDetectionConfig(heartbeat=None, sporadic_heartbeat=0.5)
    kept = CacheConfig(max_samples=1)
    return declare_advanced_publisher(
        session, key, cache=kept, sample_miss_detection=beat, publisher_detection=True, **options
    )


class Session:
    """The process's one session. Use as a context; leaving it ends the readers.

    `name` is where it listens or what it dials.
    """

    def __init__(self, session: zenoh.Session, name: str) -> None:
        self.name = name
        self._session = session
        self._readers: list[threading.Thread] = []
        self._publishers: list[Publisher] = []
        self._tokens: list[zenoh.LivelinessToken] = []
        # A reader that the ending interpreter catches inside the library aborts the process: they end before.
        atexit.register(self.close)

    def __enter__(self) -> "Session":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def publisher(self, node: str, topic: Topic) -> Publisher:
        """A publisher of one topic of one node."""
        publisher = Publisher(self._session, node, topic)
        self._publishers.append(publisher)
        return publisher

    def subscribe(self, node: str, topic: str, deliver: Deliver, depth: int) -> None:
        """Call `deliver(topic name, payload, attachment)` for what a node publishes, in a thread of its own.

        `topic` may be "*": all topics of the node. At most `depth` messages wait; beyond it the oldest are
        dropped. `deliver` must be quick and must not raise.
        """
        channel = self._session.declare_subscriber(f"0/{node}/{topic}/*/*", zenoh.handlers.RingChannel(depth))
        self._read(channel, lambda sample: _deliver(sample, deliver), f"reader {topic}")

    def sender(self, key: str) -> Callable[[bytes], None]:
        """What sends bytes at once on a key of `hil.transport.tokens`, before everything else."""
        publisher = self._session.declare_publisher(
            key,
            priority=zenoh.Priority.REAL_TIME,
            express=True,
            congestion_control=zenoh.CongestionControl.DROP,
            allowed_destination=zenoh.Locality.REMOTE,
        )

        def send(payload: bytes) -> None:
            with suppress(zenoh.ZError):  # the session was closed
                publisher.put(payload)

        return send

    def receive(self, key: str, deliver: Callable[[bytes], None], depth: int) -> None:
        """Call `deliver(payload)` for what comes on such a key; otherwise like `subscribe`."""
        channel = self._session.declare_subscriber(key, zenoh.handlers.RingChannel(depth))
        self._read(channel, lambda sample: deliver(sample.payload.to_bytes()), f"reader {key}")

    def declare_presence(self, node: str, part: "Part", ident: str = "", rank: int = 0) -> Callable[[], None]:
        """Let others see that this process is there for a node, until what this gives is called, or the session lost.

        `ident` and `rank`: see `hil.transport.tokens.Presence`; by default the session's own identity and 0.
        """
        from hil.transport.tokens import Presence, presence_key  # the vehicle is ready before this is loaded

        who = f"{os.uname().nodename}:{os.getpid()}"
        presence = Presence(node, part, rank, ident or os.urandom(16).hex(), who)
        token = self._session.liveliness().declare_token(presence_key(presence))
        self._tokens.append(token)  # it lives as long as someone holds it

        def withdraw() -> None:
            with suppress(zenoh.ZError):  # the session was closed, which withdraws it too
                token.undeclare()  # type: ignore[no-untyped-call]

        return withdraw

    def watch_presence(self, node: str, deliver: Watch) -> None:
        """Call `deliver(presence, alive)` for each that is there for a node ("*": any), comes or goes.

        One that vanishes without a word goes after the lease. Otherwise like `subscribe`.
        """
        from hil.transport.tokens import read_presence

        keys = f"uuv_hil/{node}/alive/**"
        channel = self._session.liveliness().declare_subscriber(keys, zenoh.handlers.FifoChannel(256), history=True)

        def pass_on(sample: zenoh.Sample) -> None:
            presence = read_presence(str(sample.key_expr))
            if presence:
                deliver(presence, sample.kind == zenoh.SampleKind.PUT)

        self._read(channel, pass_on, "presence")

    def serve_last(self, node: str) -> None:
        """Tell late joiners what this session's publishers of a node's own topics said last, see `fetch_last`."""
        from hil.transport.tokens import last_key

        channel = self._session.declare_queryable(last_key(node, "*"), zenoh.handlers.RingChannel(LATE_JOINERS))

        def answer(query: zenoh.Query) -> None:
            with suppress(zenoh.ZError), query:  # who asked may be gone; leaving the query says that this was all
                for publisher in list(self._publishers):
                    if publisher.last and not publisher.topic.name.startswith("/"):
                        payload, attachment = publisher.last
                        query.reply(last_key(node, publisher.topic.name), payload, attachment=attachment)

        self._read(channel, answer, "last state")

    def fetch_last(self, node: str, deliver: Deliver) -> None:
        """Call `deliver`, here and now, for the last message of each topic that the node keeps."""
        from hil.transport.tokens import last_key

        channel: Any = zenoh.handlers.FifoChannel(256)
        with suppress(zenoh.ZError):  # the session was closed
            for reply in self._session.get(last_key(node, "*"), channel, timeout=ANSWER_WITHIN_S):
                if reply.ok is not None:
                    deliver(str(reply.ok.key_expr).rpartition("/")[2], *_content(reply.ok))

    @property
    def zid(self) -> str:
        """Its identity on the network."""
        return str(self._session.info.zid())

    def declare_token(self, key: str) -> zenoh.LivelinessToken:
        """A liveliness token of any key; it lives as long as the session and what this gives."""
        return self._session.liveliness().declare_token(key)

    def tokens(self, keys: str, seconds: float = ANSWER_WITHIN_S) -> list[str]:
        """The liveliness tokens that others have declared on `keys`, asked for here and now."""
        replies = self._session.liveliness().get(keys, zenoh.handlers.FifoChannel(1024), timeout=seconds)
        return sorted({str(reply.ok.key_expr) for reply in replies if reply.ok is not None})

    def overhear(self, keys: str, deliver: Deliver, depth: int, latched: bool = False) -> None:
        """Call `deliver(key, payload, attachment)` for what anyone publishes on `keys`; otherwise like `subscribe`.

        `latched`: also for what was said last on a latched topic.
        """
        ring: Any = zenoh.handlers.RingChannel(depth)
        channel = _late(self._session, keys, ring) if latched else self._session.declare_subscriber(keys, ring)
        self._read(channel, lambda sample: deliver(str(sample.key_expr), *_content(sample)), f"reader {keys}")

    def serve(self, key: str, take: Callable[[zenoh.Query], None]) -> None:
        """Call `take` for each query of `key`, in a thread of the library: it must be quick and must not raise."""
        self._session.declare_queryable(key, zenoh.handlers.Callback(take, indirect=False), complete=True)

    def ask(self, key: str, payload: bytes, attachment: bytes, seconds: float) -> bytes | None:
        """The first answer to a query of `key` within the time; None if there is none."""
        replies = self._session.get(
            key,
            zenoh.handlers.FifoChannel(4),
            target=zenoh.QueryTarget.ALL_COMPLETE,
            consolidation=zenoh.ConsolidationMode.NONE,
            timeout=seconds,
            payload=payload,
            attachment=attachment,
        )
        return next((reply.ok.payload.to_bytes() for reply in replies if reply.ok is not None), None)

    def others(self) -> list[str]:
        """Who is connected: the names in their certificates, or their addresses where there are none."""
        return sorted({link.auth_identifier or link.dst.partition("?")[0] for link in self._session.info.links()})

    def close(self) -> None:
        """Close the session and wait for its readers to end. Closing twice is harmless."""
        atexit.unregister(self.close)
        self._session.close()  # type: ignore[no-untyped-call]  # zenoh leaves it unannotated; it wakes the readers
        for reader in self._readers:
            if reader is not threading.current_thread():
                reader.join(1.0)

    def _read(self, channel: Any, use: Callable[[Any], None], name: str) -> None:
        reader = threading.Thread(target=_receive, args=(channel, use), name=name, daemon=True)
        reader.start()
        self._readers.append(reader)


def _receive(channel: Any, use: Callable[[Any], None]) -> None:
    while True:
        try:
            item = channel.recv()
        except zenoh.ZError:  # the session was closed
            return
        use(item)


def _deliver(sample: zenoh.Sample, deliver: Deliver) -> None:
    deliver(str(sample.key_expr).split("/", 3)[2], *_content(sample))


def _content(sample: zenoh.Sample) -> tuple[bytes, bytes]:
    """Payload and attachment."""
    attachment = sample.attachment
    return sample.payload.to_bytes(), attachment.to_bytes() if attachment is not None else b""
