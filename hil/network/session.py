"""One zenoh session a process, with settings that send a command before a picture.

The slave listens and the master connects; with a router in between both connect to it. `hil.network.settings` describes
how a loss is detected and repaired. Messages of topics wait in bounded channels of the library, from which a thread of
ours takes them: the library's threads then never wait for the interpreter's lock, and commands come 0.03 to 0.07 ms
sooner. Rare messages share one thread, see `hil.network.reception`.

Each declaration is stored as a function of the library's session. So a session that has stopped working can be replaced
by a new one with the same declarations (`Session.reopen`).
"""

import atexit
import threading
from collections.abc import Callable, Iterator
from contextlib import suppress
from functools import partial
from math import inf
from typing import TYPE_CHECKING, Any

import zenoh

from hil.common.errors import NetworkError
from hil.network.publisher import Declared, Publisher, close_session, is_matched, read_key
from hil.network.workarounds.key_text import frequent_keys
from hil.ros import dialect
from hil.ros.topics import TOPICS, Topic

if TYPE_CHECKING:
    from hil.network.reception import MessageQueue, ReaderThread
    from hil.network.supervisor import Supervisor

ASKING = 8  # queries that may wait for a reader
ANSWER_WITHIN_S = 1.0
CLOSE_WITHIN_S = 5.0  # usually 0.1 s, but sometimes the library takes 10 s for each of several steps
MAX_LEARNED = 4096  # keys, because anybody can invent names
REFUSAL = zenoh.Encoding.TEXT_PLAIN  # encoding of the reason for a refusal

Deliver = Callable[[str, bytes, bytes], None]


class Session:
    """The process's one session. Use as a context manager; leaving it ends the readers.

    `open_library` returns an open session of the library; it may raise zenoh.ZError. `name` is the endpoint where it
    listens or to which it connects, `peer_count` the number of peers to connect to. `has_pairs`: it has two links with
    each peer, as a master has with a slave. `publishers` are all made so far. `openings` counts how often the session
    was opened. `supervisor` is there once `supervise` was called. `close_within_s`: how long `close` waits for the
    library. `is_stuck`: it did not close in time.
    """

    supervisor: "Supervisor"
    close_within_s = CLOSE_WITHIN_S
    is_stuck = False

    def __init__(
        self, open_library: Callable[[], zenoh.Session], name: str, has_pairs: bool = False, peer_count: int = 1
    ) -> None:
        self.name, self.peer_count, self.has_pairs = name, peer_count, has_pairs
        self.openings = 1
        self._open_library = open_library
        self._session = open_library()
        self._zid = str(self._session.info.zid())
        self._condition = threading.Condition()  # guards declarations, opening and closing
        self._declared: list[Declared] = []
        self._is_open = True
        self._is_opening = False
        self._threads: list[threading.Thread] = []
        self._readers: dict[str, ReaderThread] = {}
        self._closed = threading.Event()
        self.publishers: list[Publisher] = []
        self._learned: set[str] = set()  # keys that have a numeric id
        # Readers have to end before the interpreter does: a thread stopped inside the library aborts the process.
        atexit.register(self.close)

    def __enter__(self) -> "Session":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def publisher(self, node: str, topic: Topic, wait: bool = False, key: str = "") -> Publisher:
        """Return a publisher of one topic of one node, or on the `key` of a vehicle; `wait` as in `Publisher`."""
        publisher = Publisher(self._declare, node, topic, wait, key)
        self.publishers.append(publisher)
        return publisher

    def watch_subscribers(self, publisher: Publisher) -> None:
        """Let `publisher.has_subscribers` follow the subscribers from now on."""
        publisher.watch_subscribers(self._reader("worker"))

    def publish_in_background(self, publisher: Publisher) -> None:
        """Let the publisher send in another thread: for a loop with messages so large that sending takes long."""
        publisher.publish_in_background(self._reader("sender"))

    def subscribe(self, node: str, topic: str, deliver: Deliver, depth: int) -> None:
        """Call `deliver(topic name, payload, attachment)` for each message of a node's topic, in a separate thread.

        `topic` "*" means all topics of the node. At most `depth` messages wait; beyond it the oldest are dropped.
        `deliver` must be quick and must not raise. The last message of a latched topic comes at once.
        """
        keys = f"{dialect.domain()}/{node}/{topic}/*/*"
        channel = self.collect(keys, depth, topic in TOPICS and TOPICS[topic].qos.latched)
        for key in frequent_keys(node, keys):
            self.learn(key)
        self._read(channel, lambda sample: _deliver(sample, deliver), f"reader {topic}")

    def sender(self, key: str) -> Callable[[bytes], None]:
        """Return a function that sends bytes at once, with the highest priority, on a key of `hil.network.tokens`."""
        publisher = self._declare(
            lambda session: session.declare_publisher(
                key,
                priority=zenoh.Priority.REAL_TIME,
                express=True,
                congestion_control=zenoh.CongestionControl.DROP,
                allowed_destination=zenoh.Locality.REMOTE,
            )
        )

        def send(payload: bytes) -> None:
            with suppress(zenoh.ZError):  # the session was closed
                publisher.current.put(payload)

        return send

    def receive(self, key: str, deliver: Callable[[bytes], None], depth: int, rate: float = inf) -> "MessageQueue":
        """Call `deliver(payload)` for each message on such a key, in the thread "worker".

        `deliver` must be quick. At most `depth` messages wait, and `rate` a second are accepted; the returned queue
        counts those that were dropped.
        """
        queue = self._reader("worker").open_queue(lambda sample: deliver(sample.payload.to_bytes()), depth, rate)
        self._declare(lambda session: session.declare_subscriber(key, queue.callback))
        return queue

    @property
    def zid(self) -> str:
        """Zenoh id of the first opened session, by which ROS distinguishes our nodes."""
        return self._zid

    def declare_token(self, key: str) -> Callable[[], None]:
        """Declare a liveliness token; it lives until the returned function is called or the session is lost."""
        return partial(self.withdraw, self._declare(lambda session: session.liveliness().declare_token(key)))

    def withdraw(self, declared: Declared) -> None:
        """End a declaration of this session, such as that of `collect`."""
        with self._condition:
            self._declared.remove(declared)
            with suppress(zenoh.ZError):  # the session was closed, which withdraws it too
                declared.current.undeclare()

    def tokens(self, keys: str, seconds: float = ANSWER_WITHIN_S) -> list[str]:
        """Return the liveliness tokens on `keys` that others have declared, by a query at this moment."""
        with suppress(zenoh.ZError):  # the session was closed
            replies = self._session.liveliness().get(keys, zenoh.handlers.FifoChannel(1024), timeout=seconds)
            return sorted({str(reply.ok.key_expr) for reply in replies if reply.ok is not None})
        return []

    def watch_tokens(self, keys: str, deliver: Callable[[str, bool], None]) -> None:
        """Call `deliver(key, alive)` for each token of others on `keys` that exists, appears or is withdrawn.

        The tokens of a session that was lost are withdrawn after its lease, and those that are missing after `reopen`
        after CONFIRM_WITHIN_S. Otherwise like `receive`; none is dropped.
        """
        from hil.network.token_watch import TokenWatch  # needs the worker's queues

        self._declare(TokenWatch(keys, deliver, self._reader("worker")).declare)

    def subscribe_keys(self, keys: str, deliver: Deliver, depth: int, latched: bool = False) -> None:
        """Call `deliver(key, payload, attachment)` for every message on `keys`; otherwise like `subscribe`.

        `latched`: get the last message of latched topics too.
        """
        channel = self.collect(keys, depth, latched)
        self._read(channel, lambda sample: deliver(str(sample.key_expr), *_content(sample)), f"reader {keys}")

    def collect(self, keys: str, depth: int, latched: bool = False, handler: Any = None) -> Declared:
        """Return a subscriber, for a caller that takes the library's samples itself, in batches: `current.try_recv`.

        At most `depth` samples wait in the library; beyond it the oldest are dropped. A `handler` gets them instead.
        """
        declare: Any = zenoh.Session.declare_subscriber
        if latched:
            from hil.network.latched import declare_subscriber as declare
        return self._declare(lambda session: declare(session, keys, handler or zenoh.handlers.RingChannel(depth)))

    def learn(self, key: str) -> None:
        """Reduce the cost of messages with this key, on the wire and here; see `workarounds.key_text`."""
        from hil.network.workarounds.key_text import declare_key

        if key not in self._learned and len(self._learned) < MAX_LEARNED:
            self._learned.add(key)
            self._declare(partial(declare_key, key))

    def answer_queries(self, key: str, handler: Callable[[zenoh.Query], None]) -> None:
        """Call `handler` for each query of `key`, in a thread of the library. It must be quick and must not raise."""
        from hil.network.workarounds.exit_hang import direct_callback

        self._declare(lambda session: session.declare_queryable(key, direct_callback(handler), complete=True))

    def answer(self, keys: str, handler: Callable[[zenoh.Query], None]) -> None:
        """Call `handler` for each query of `keys`; else like `receive`."""
        queue = self._reader("worker").open_queue(handler, ASKING)
        self._declare(lambda session: session.declare_queryable(keys, queue.callback))

    def query(
        self,
        keys: str,
        seconds: float,
        payload: bytes | None = None,
        attachment: bytes | None = None,
        refused: Callable[[str], None] | None = None,
    ) -> Iterator[tuple[str, bytes, bytes]]:
        """Yield key, payload and attachment of each answer to a query that comes within `seconds`.

        `refused` is called with the reason of each refusal.
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
                elif refused and reply.err.encoding == REFUSAL:  # not the library's own error after the timeout
                    refused(reply.err.payload.to_bytes().decode(errors="replace"))

    def deferred(self, run: Callable[[], None]) -> Callable[[], None]:
        """Return a function that lets the worker thread call `run`; for callers that must not wait."""
        queue = self._reader("worker").open_queue(lambda _: run())
        return lambda: queue.put(None)

    def others(self) -> list[str]:
        """Return the connected peers: the names in their certificates, or without certificates their addresses."""
        return sorted({link.auth_identifier or link.dst.partition("?")[0] for link in self._session.info.links()})

    def watch_keys(self, keys: str) -> Callable[[], bool]:
        """Return a function that returns whether anybody subscribes to messages with such keys."""
        remote = zenoh.Locality.REMOTE
        publisher = self._declare(lambda session: session.declare_publisher(keys, allowed_destination=remote))
        return lambda: is_matched(publisher.current)

    def every(self, seconds: float, run: Callable[[], None], name: str, end: Callable[[], None] = lambda: None) -> None:
        """Call `run` every `seconds` in a separate thread, until the session is closed; then `end`."""

        def repeat() -> None:
            while not self._closed.wait(seconds):
                run()
            end()

        self._start(repeat, name=name)

    def close(self) -> None:
        """Close the session and wait for its readers to end. May be called twice."""
        atexit.unregister(self.close)
        with self._condition:
            self._closed.set()
            closing = threading.Thread(target=self._close_library, name="close session", daemon=True)
            try:
                closing.start()
                closing.join(self.close_within_s)
            except RuntimeError:  # since Python 3.12 no thread starts at the interpreter's exit
                self._close_library()
            self.is_stuck = closing.is_alive()
            self._condition.notify_all()
        for reader in self._readers.values():
            reader.end()
        for thread in self._threads:
            if thread is not threading.current_thread():
                thread.join(1.0)

    def reopen(self) -> bool:
        """Replace the library's session by a new one with all declarations; return whether this was done.

        Messages in transit are lost. If it cannot be opened, for example without its router, each later call tries
        again.
        """
        with self._condition:
            if self._closed.is_set() or self._is_opening:
                return False
            self._close_library()
            self._is_opening = True
        opened = None
        with suppress(zenoh.ZError, NetworkError):
            opened = self._open_library()  # takes long without a router; the lock is free, so that clients can close
        with self._condition:
            self._is_opening = False
            if opened:
                self._replace_library(opened)
            self._condition.notify_all()
        return opened is not None

    def _replace_library(self, opened: zenoh.Session) -> None:
        if self._closed.is_set():
            close_session(opened)
            return
        self._session = opened
        with suppress(zenoh.ZError):
            for declared in self._declared:
                declared.renew(opened)
            self._is_open = True
            self.openings += 1

    @property
    def is_lost(self) -> bool:
        """True while the session is lost and could not be reopened."""
        return not (self._is_open or self._closed.is_set())

    def links(self) -> list[tuple[str, str, str]]:
        """Return for each link the peer's zenoh id, our address and the peer's address."""
        return [(str(link.zid), link.src, link.dst) for link in self._session.info.links()]

    def routers(self) -> set[str]:
        """Return the zenoh ids of the peers that the library takes for routers; slaves are among them."""
        return {str(zid) for zid in self._session.info.routers_zid()}

    def supervise(self, lease: float) -> None:
        """Let a thread supervise the links (of `lease` s) and what arrives on them, until the session is closed."""
        from hil.network.supervisor import CHECK_S, Supervisor

        self.free_links()
        self.supervisor = Supervisor(self, lease, self.has_pairs)
        self.every(CHECK_S, self.supervisor.check, "supervisor")

    def free_links(self) -> None:
        """Close lost links at once, so that they do not delay the next one."""
        from hil.network.workarounds.lingering_socket import free_new  # loaded after the vehicle is ready

        queue = self._reader("worker").open_queue(free_new)
        self._declare(lambda session: session.info.declare_link_events_listener(queue.callback, history=True))

    def _declare(self, declare: Callable[[zenoh.Session], Any]) -> Declared:
        """Declare something now, and again on each session that replaces this one."""
        with self._condition:
            self._condition.wait_for(lambda: self._closed.is_set() or not self._is_opening)
            declared = Declared(declare, self._session, self.name)
            self._declared.append(declared)
        return declared

    def _close_library(self) -> None:
        """Close the library's session after its publishers."""
        from hil.network.workarounds.late_undeclaration import end_listeners

        self._is_open = False
        end_listeners([declared.current for declared in self._declared])
        for declared in self._declared:
            declared.end_publishing()
        close_session(self._session)

    def _read(self, channel: Declared, use: Callable[[Any], None], name: str) -> None:
        def receive() -> None:
            while not self._closed.is_set():
                current = channel.current
                try:
                    item = current.recv()
                except zenoh.ZError:  # the session was closed, or is being reopened
                    self._await_other(channel, current)
                else:
                    use(item)

        self._start(receive, name)

    def _await_other(self, declared: Declared, current: object) -> None:
        """Wait until the declaration is repeated on another session of the library, or this session is closed."""
        with self._condition:
            self._condition.wait_for(lambda: self._closed.is_set() or declared.current is not current)

    def _reader(self, name: str) -> "ReaderThread":
        """Return the reader with this name, whose thread is started on first use."""
        from hil.network.reception import ReaderThread  # loaded after the vehicle is ready

        with self._condition:
            if name not in self._readers:
                self._readers[name] = ReaderThread()
                self._start(self._readers[name].run, name)
            return self._readers[name]

    def _start(self, run: Callable[[], None], name: str) -> None:
        thread = threading.Thread(target=run, name=name, daemon=True)
        thread.start()
        self._threads.append(thread)


def _deliver(sample: zenoh.Sample, deliver: Deliver) -> None:
    topic, is_of_type = read_key(str(sample.key_expr))
    payload, attachment = _content(sample)
    deliver(topic, payload if is_of_type else b"", attachment)  # an empty payload is malformed


def _content(sample: zenoh.Sample) -> tuple[bytes, bytes]:
    """Return payload and attachment."""
    attachment = sample.attachment
    return sample.payload.to_bytes(), attachment.to_bytes() if attachment is not None else b""
