"""One zenoh session a process, with the settings that keep a command ahead of an image.

The slave listens, the master dials, never both; with a router in between both dial it. How loss is noticed and mended
is in `hil.network.settings`. A reader is a thread of ours on a channel, because an open session with a Python
callback hangs the interpreter at exit. What comes seldom shares one, see `hil.network.worker`.
"""

import atexit
import os
import threading
from collections.abc import Callable, Iterator
from contextlib import suppress
from math import inf
from typing import TYPE_CHECKING, Any

import zenoh

from hil.common.errors import NetworkError
from hil.network.publisher import Publisher, is_matched, key_of
from hil.network.settings import Network, settings
from hil.ros import dialect
from hil.ros.topics import TOPICS, Topic

if TYPE_CHECKING:
    from hil.network.security import Security
    from hil.network.worker import BoundedQueue, WorkerThread

ASKING = 8  # queries that may wait for a reader at once
ANSWER_WITHIN_S = 1.0
OFTEN_HZ = 20.0  # from here on it pays to give a key a number
REFUSAL = zenoh.Encoding.TEXT_PLAIN  # of the reason why there is no answer

Deliver = Callable[[str, bytes, bytes], None]


def listen(
    endpoint: str, network: Network = Network(), security: "Security | None" = None, pictures: bool = False
) -> "Session":
    """Return the session of a slave: it waits for masters at `endpoint`, and dials a router if `network` names one.

    `pictures`: it passes on those of its imaging process. Raises NetworkError, also when the port is taken.
    """
    text = settings("slave", (endpoint,), (network.router,) if network.router else (), network, security, pictures)
    return open_session("listen on", endpoint, text)


class Listening:
    """A session that is being opened in a thread while the caller does other work."""

    def __init__(
        self, endpoint: str, network: Network = Network(), security: "Security | None" = None, pictures: bool = False
    ) -> None:
        self._arguments = endpoint, network, security, pictures
        self._session: Session | None = None
        self._error: NetworkError | None = None
        self._thread = threading.Thread(target=self._run, name="open session")
        self._thread.start()

    def _run(self) -> None:
        # The library's threads inherit it. What a peer declares can keep them busy for a second: real-time ones would
        # keep the processor from the kernel's threads for that long, and so from the loop's serial line.
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
        try:
            self._session = listen(*self._arguments)
        except NetworkError as error:
            self._error = error

    def session(self) -> "Session":
        """Return the open session. Raises NetworkError as `listen` does."""
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


def open_session(action: str, name: str, text: str, has_pairs: bool = False) -> "Session":
    """Return a session with the settings `text`, and `has_pairs` as in `Session`.

    Raises NetworkError, which says that we cannot `action` `name`, and why.
    """
    try:
        return Session(zenoh.open(zenoh.Config.from_json5(text)), name, has_pairs)
    except zenoh.ZError as error:
        raise NetworkError(f"cannot {action} {name}: {_reason(str(error))}") from None


def _reason(text: str) -> str:
    if "Address already in use" in text:
        return (
            f"{_taken(text)} is in use: by another slave or router, or by ROS 2's rmw_zenohd, whose port is 7447 too; "
            "end that, or choose another with --listen"
        )
    if "Cannot assign requested address" in text or "os error 99" in text:
        return "this machine does not have that address"
    if "Permission denied" in text:
        return "no permission for that port: those below 1024 are root's alone; choose another with --listen"
    if "lookup address" in text:
        return "no machine is called that here; give its address"
    if "Unable to connect" in text:
        return "there is no router, or it refuses us; start it first, `uuv-hil router`"
    return text.partition(" at /")[0]  # without the place in the library's source


def _taken(text: str) -> str:
    """Return which port the library could not have, by what it says of it."""
    address = text.partition("bound to ")[2].partition(": ")[0].partition("?")[0].partition("#")[0]
    port = address.rpartition(":")[2]
    return f"port {port}" if port.isdigit() else "the port (or the next one)"


class Session:
    """The process's one session. Use as a context; leaving it ends the readers.

    `name` is where it listens or what it dials, `publishers` all that were made so far. `has_pairs`: it has two links
    with each peer, as a master has with a slave.
    """

    def __init__(self, session: zenoh.Session, name: str, has_pairs: bool = False) -> None:
        self.name = name
        self.has_pairs = has_pairs
        self._session = session
        self._readers: list[threading.Thread] = []
        self._worker: WorkerThread | None = None  # of what comes seldom
        self._sending: WorkerThread | None = None  # of what is large
        self._closed = threading.Event()
        self.publishers: list[Publisher] = []
        self._tokens: list[zenoh.LivelinessToken] = []  # one lives as long as someone holds it
        self._numbered: dict[str, Any] = {}  # by key what nobody reads: it lives as long too
        # A reader that the ending interpreter catches inside the library aborts the process: they end before.
        atexit.register(self.close)

    def __enter__(self) -> "Session":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def publisher(self, node: str, topic: Topic, wait: bool = False) -> Publisher:
        """Return a publisher of one topic of one node; `wait` as in `Publisher`."""
        publisher = Publisher(self._session, node, topic, wait)
        self.publishers.append(publisher)
        return publisher

    def watch_subscribers(self, publisher: Publisher) -> None:
        """Let it know from now on whether anybody listens."""
        publisher.watch_subscribers(self._shared_worker())

    def publish_in_background(self, publisher: Publisher) -> None:
        """Let it send in another thread, for a loop with messages so large that the network takes its time."""
        if self._sending is None:
            self._sending = self._start_worker("sender")
        publisher.publish_in_background(self._session, self._sending)

    def subscribe(self, node: str, topic: str, deliver: Deliver, depth: int) -> None:
        """Call `deliver(topic name, payload, attachment)` for what a node publishes, in a thread of its own.

        `topic` may be "*": all topics of the node. At most `depth` messages wait; beyond it the oldest are
        dropped. `deliver` must be quick and must not raise.
        """
        keys = f"{dialect.domain()}/{node}/{topic}/*/*"
        channel = self._session.declare_subscriber(keys, zenoh.handlers.RingChannel(depth))
        self._number(node, zenoh.KeyExpr(keys))
        self._read(channel, lambda sample: _deliver(sample, deliver), f"reader {topic}")

    def sender(self, key: str) -> Callable[[bytes], None]:
        """Return what sends bytes at once on a key of `hil.network.tokens`, before everything else."""
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

    def receive(self, key: str, deliver: Callable[[bytes], None], depth: int, rate: float = inf) -> "BoundedQueue":
        """Call `deliver(payload)` for what comes on such a key, in one thread for all that comes seldom.

        It must be quick and must not raise. What comes while `depth` messages wait, or beyond `rate` in a second, is
        dropped, and counted by what this gives.
        """
        queue = self._shared_worker().open_queue(lambda sample: deliver(sample.payload.to_bytes()), depth, rate)
        self._session.declare_subscriber(key, queue.callback)
        return queue

    @property
    def zid(self) -> str:
        """Zenoh id of the session."""
        return str(self._session.info.zid())

    def declare_token(self, key: str) -> Callable[[], None]:
        """Declare a liveliness token, which lives until what this gives is called, or the session lost."""
        token = self._session.liveliness().declare_token(key)
        self._tokens.append(token)

        def withdraw() -> None:
            self._tokens.remove(token)
            with suppress(zenoh.ZError):  # the session was closed, which withdraws it too
                token.undeclare()  # type: ignore[no-untyped-call]

        return withdraw

    def tokens(self, keys: str, seconds: float = ANSWER_WITHIN_S) -> list[str]:
        """Return the liveliness tokens that others have declared on `keys`, asked for here and now."""
        replies = self._session.liveliness().get(keys, zenoh.handlers.FifoChannel(1024), timeout=seconds)
        return sorted({str(reply.ok.key_expr) for reply in replies if reply.ok is not None})

    def watch_tokens(self, keys: str, deliver: Callable[[str, bool], None]) -> None:
        """Call `deliver(key, alive)` for each token of others on `keys` that is there, comes or goes.

        That of a session which vanishes without a word goes after the lease. Otherwise like `receive`; none is dropped.
        """

        def pass_on(sample: zenoh.Sample) -> None:
            deliver(str(sample.key_expr), sample.kind == zenoh.SampleKind.PUT)

        self._session.liveliness().declare_subscriber(keys, self._worker_callback(pass_on), history=True)

    def subscribe_keys(self, keys: str, deliver: Deliver, depth: int, latched: bool = False) -> None:
        """Call `deliver(key, payload, attachment)` for what anyone publishes on `keys`; otherwise like `subscribe`.

        `latched`: also for what was said last on a latched topic.
        """
        declare: Any = zenoh.Session.declare_subscriber
        if latched:
            from hil.network.latched import declare_subscriber as declare
        channel = declare(self._session, keys, zenoh.handlers.RingChannel(depth))
        self._read(channel, lambda sample: deliver(str(sample.key_expr), *_content(sample)), f"reader {keys}")

    def answer_queries(self, key: str, take: Callable[[zenoh.Query], None]) -> None:
        """Call `take` for each query of `key`, in a thread of the library: it must be quick and must not raise."""
        self._session.declare_queryable(key, zenoh.handlers.Callback(take, indirect=False), complete=True)

    def answer(self, keys: str, take: Callable[[zenoh.Query], None]) -> None:
        """Call `take` for each query of `keys`, otherwise like `receive`; of many at once the youngest are dropped."""
        self._session.declare_queryable(keys, self._worker_callback(take, ASKING))

    def ask(
        self,
        keys: str,
        seconds: float,
        payload: bytes | None = None,
        attachment: bytes | None = None,
        refused: Callable[[str], None] | None = None,
    ) -> Iterator[tuple[str, bytes, bytes]]:
        """Key, payload and attachment of each answer to a query that comes within the time.

        `refused` is told why, by each who says that there will be none.
        """
        with suppress(zenoh.ZError):  # the session was closed
            replies: Any = self._session.get(
                keys,
                zenoh.handlers.FifoChannel(256),
                target=zenoh.QueryTarget.ALL,
                consolidation=zenoh.ConsolidationMode.NONE,
                timeout=seconds,
                payload=payload,
                attachment=attachment,
            )
            for reply in replies:
                if reply.ok is not None:
                    yield str(reply.ok.key_expr), *_content(reply.ok)
                elif refused and reply.err.encoding == REFUSAL:  # and not the library's own, when the time is over
                    refused(reply.err.payload.to_bytes().decode(errors="replace"))

    def deferred(self, run: Callable[[], None]) -> Callable[[], None]:
        """Return a function that has `run` called in the worker thread: for callers that must not wait."""
        queue = self._shared_worker().open_queue(lambda _: run())
        return lambda: queue.put(None)

    def others(self) -> list[str]:
        """Return who is connected: the names in their certificates, or their addresses where there are none."""
        return sorted({link.auth_identifier or link.dst.partition("?")[0] for link in self._session.info.links()})

    def watch_keys(self, keys: str) -> Callable[[], bool]:
        """Return what tells whether anybody out there wants messages with such keys."""
        publisher = self._session.declare_publisher(keys, allowed_destination=zenoh.Locality.REMOTE)
        return lambda: is_matched(publisher)

    def every(self, seconds: float, run: Callable[[], None], name: str) -> None:
        """Call `run` every so many seconds until the session is closed, in a thread of its own."""

        def repeat() -> None:
            while not self._closed.wait(seconds):
                run()

        self._start(repeat, name=name)

    def has_dialled(self, port: int) -> bool:
        """Return whether there is a link that we have opened, to somebody's `port`."""
        return any(link.dst.partition("?")[0].endswith(f":{port}") for link in self._session.info.links())

    def close(self) -> None:
        """Close the session and wait for its readers to end. Closing twice is harmless."""
        atexit.unregister(self.close)
        self._closed.set()
        self._session.close()  # type: ignore[no-untyped-call]  # zenoh leaves it unannotated; it wakes the readers
        for worker in (self._worker, self._sending):
            if worker:
                worker.end()
        for reader in self._readers:
            if reader is not threading.current_thread():
                reader.join(1.0)

    def links(self) -> list[tuple[str, str, str]]:
        """Of each link the identity of the peer, and the addresses, ours and theirs."""
        return [(str(link.zid), link.src, link.dst) for link in self._session.info.links()]

    def free_links(self) -> None:
        """Close lost links at once, so that they do not delay the next one; see `hil.network.sockets`."""
        from hil.network.sockets import free_new  # the vehicle is ready before this is loaded

        self._session.info.declare_link_events_listener(self._worker_callback(free_new), history=True)

    def _number(self, node: str, keys: zenoh.KeyExpr) -> None:
        """Let the library give numbers to those of `keys` on which messages come often.

        It does so for a key that somebody subscribes to letter by letter. With wildcards each message carries the text
        of its key, and is looked up anew where it arrives: 110 bytes and 40 us of a command's way.
        """
        for key in [key_of(topic, node) for topic in TOPICS.values() if topic.rate_hz >= OFTEN_HZ]:
            if key not in self._numbered and keys.includes(zenoh.KeyExpr(key)):
                self._numbered[key] = self._session.declare_subscriber(key, zenoh.handlers.RingChannel(1))

    def _worker_callback(self, handle: Callable[[Any], None], capacity: float = inf) -> "zenoh.handlers.Callback[Any]":
        """Return the handler for a declaration whose items `handle` gets in the worker thread."""
        return self._shared_worker().open_queue(handle, capacity).callback

    def _shared_worker(self) -> "WorkerThread":
        """Return the thread for everything that is rare, started on first use."""
        if self._worker is None:
            self._worker = self._start_worker("worker")
        return self._worker

    def _start_worker(self, name: str) -> "WorkerThread":
        """Start a worker thread of this name."""
        from hil.network.worker import WorkerThread

        worker = WorkerThread()
        self._start(worker.run, name=name)
        return worker

    def _read(self, channel: Any, use: Callable[[Any], None], name: str) -> None:
        self._start(_receive, channel, use, name=name)

    def _start(self, run: Callable[..., None], *arguments: Any, name: str) -> None:
        reader = threading.Thread(target=run, args=arguments, name=name, daemon=True)
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
    name = str(sample.key_expr).split("/", 2)[2].rsplit("/", 2)[0]  # it may have several parts
    deliver(name, *_content(sample))


def _content(sample: zenoh.Sample) -> tuple[bytes, bytes]:
    """Payload and attachment."""
    attachment = sample.attachment
    return sample.payload.to_bytes(), attachment.to_bytes() if attachment is not None else b""
