"""One zenoh session a process, with the settings that keep a command ahead of an image.

The slave listens, the master dials, never both; with a router in between both dial it. How loss is noticed and mended
is in `hil.network.settings`. A reader is a thread of ours on a channel, because an open session with a Python
callback hangs the interpreter at exit. What comes seldom shares one, see `hil.network.worker`.

Each declaration is stored as a function of the library's session, so that a session which has stopped working can be
opened again with all that was declared (`Session.reopen`).
"""

import atexit
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from functools import partial
from math import inf
from typing import TYPE_CHECKING, Any

import zenoh

from hil.network.publisher import Declared, Publisher, close_session, is_matched, key_of
from hil.ros import dialect
from hil.ros.topics import TOPICS, Topic

if TYPE_CHECKING:
    from hil.network.worker import BoundedQueue, WorkerThread

ASKING = 8  # queries that may wait for a reader at once
ANSWER_WITHIN_S = 1.0
CALLS_END_S = 0.05  # in which what the library calls of ours has ended
OFTEN_HZ = 20.0  # from here on it pays to give a key a number
REFUSAL = zenoh.Encoding.TEXT_PLAIN  # of the reason why there is no answer

Deliver = Callable[[str, bytes, bytes], None]


class Session:
    """The process's one session. Use as a context; leaving it ends the readers.

    `open_library` returns an open session of the library; it may raise zenoh.ZError. `name` is where it listens or what
    it dials, `dialled` how many peers that is, `publishers` all that were made so far. `has_pairs`: it has two links
    with each peer, as a master has with a slave. `openings` counts how often it was opened. `has_cut`: a link that was
    not read was cut (`hil.network.stall`), which nobody has reported yet.
    """

    def __init__(
        self, open_library: Callable[[], zenoh.Session], name: str, has_pairs: bool = False, dialled: int = 1
    ) -> None:
        self.name, self.dialled, self.has_pairs = name, dialled, has_pairs
        self.openings, self.has_cut = 1, False
        self._open_library = open_library
        self._session = open_library()
        self._zid = str(self._session.info.zid())
        self._turn = threading.Condition()  # of declarations, and of opening and closing
        self._declared: list[Declared] = []
        self._is_open = True
        self._is_opening = False
        self._readers: list[threading.Thread] = []
        self._worker: WorkerThread | None = None  # of what comes seldom
        self._sending: WorkerThread | None = None  # of what is large
        self._closed = threading.Event()
        self.publishers: list[Publisher] = []
        self._numbered: set[str] = set()  # keys that have a number
        # A reader that the ending interpreter catches inside the library aborts the process: they end before.
        atexit.register(self.close)

    def __enter__(self) -> "Session":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def publisher(self, node: str, topic: Topic, wait: bool = False) -> Publisher:
        """Return a publisher of one topic of one node; `wait` as in `Publisher`."""
        publisher = Publisher(self._declare, node, topic, wait)
        self.publishers.append(publisher)
        return publisher

    def watch_subscribers(self, publisher: Publisher) -> None:
        """Let it know from now on whether anybody listens."""
        publisher.watch_subscribers(self._shared_worker())

    def publish_in_background(self, publisher: Publisher) -> None:
        """Let it send in another thread, for a loop with messages so large that the network takes its time."""
        if self._sending is None:
            self._sending = self._start_worker("sender")
        publisher.publish_in_background(self._sending)

    def subscribe(self, node: str, topic: str, deliver: Deliver, depth: int) -> None:
        """Call `deliver(topic name, payload, attachment)` for what a node publishes, in a thread of its own.

        `topic` may be "*": all topics of the node. At most `depth` messages wait; beyond it the oldest are
        dropped. `deliver` must be quick and must not raise. Of a latched topic the last message comes at once.
        """
        keys = f"{dialect.domain()}/{node}/{topic}/*/*"
        channel = self._subscribe(keys, depth, topic in TOPICS and TOPICS[topic].qos.latched)
        self._number(node, zenoh.KeyExpr(keys))
        self._read(channel, lambda sample: _deliver(sample, deliver), f"reader {topic}")

    def sender(self, key: str) -> Callable[[bytes], None]:
        """Return what sends bytes at once on a key of `hil.network.tokens`, before everything else."""
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

    def receive(self, key: str, deliver: Callable[[bytes], None], depth: int, rate: float = inf) -> "BoundedQueue":
        """Call `deliver(payload)` for what comes on such a key, in one thread for all that comes seldom.

        It must be quick and must not raise. What comes while `depth` messages wait, or beyond `rate` in a second, is
        dropped, and counted by what this gives.
        """
        queue = self._shared_worker().open_queue(lambda sample: deliver(sample.payload.to_bytes()), depth, rate)
        self._declare(lambda session: session.declare_subscriber(key, queue.callback))
        return queue

    @property
    def zid(self) -> str:
        """Zenoh id of the session as it was opened first, by which ROS tells our nodes apart."""
        return self._zid

    def declare_token(self, key: str) -> Callable[[], None]:
        """Declare a liveliness token, which lives until what this gives is called, or the session lost."""
        token = self._declare(lambda session: session.liveliness().declare_token(key))

        def withdraw() -> None:
            with self._turn:
                self._declared.remove(token)
                with suppress(zenoh.ZError):  # the session was closed, which withdraws it too
                    token.current.undeclare()

        return withdraw

    def tokens(self, keys: str, seconds: float = ANSWER_WITHIN_S) -> list[str]:
        """Return the liveliness tokens that others have declared on `keys`, asked for here and now."""
        with suppress(zenoh.ZError):  # the session was closed
            replies = self._session.liveliness().get(keys, zenoh.handlers.FifoChannel(1024), timeout=seconds)
            return sorted({str(reply.ok.key_expr) for reply in replies if reply.ok is not None})
        return []

    def watch_tokens(self, keys: str, deliver: Callable[[str, bool], None]) -> None:
        """Call `deliver(key, alive)` for each token of others on `keys` that is there, comes or goes.

        That of a session which vanishes without a word goes after the lease. Otherwise like `receive`; none is dropped.
        """

        def pass_on(sample: zenoh.Sample) -> None:
            deliver(str(sample.key_expr), sample.kind == zenoh.SampleKind.PUT)

        queue = self._shared_worker().open_queue(pass_on)
        self._declare(lambda session: session.liveliness().declare_subscriber(keys, queue.callback, history=True))

    def subscribe_keys(self, keys: str, deliver: Deliver, depth: int, latched: bool = False) -> None:
        """Call `deliver(key, payload, attachment)` for what anyone publishes on `keys`; otherwise like `subscribe`.

        `latched`: also for what was said last on a latched topic.
        """
        channel = self._subscribe(keys, depth, latched)
        self._read(channel, lambda sample: deliver(str(sample.key_expr), *_content(sample)), f"reader {keys}")

    def answer_queries(self, key: str, handler: Callable[[zenoh.Query], None]) -> None:
        """Call `handler` for each query of `key`, in a thread of the library: it must be quick and must not raise."""
        self._declare(
            lambda session: session.declare_queryable(
                key, zenoh.handlers.Callback(handler, indirect=False), complete=True
            )
        )

    def answer(self, keys: str, handler: Callable[[zenoh.Query], None]) -> None:
        """Call `handler` for each query of `keys`, otherwise like `receive`; the youngest of too many are dropped."""
        queue = self._shared_worker().open_queue(handler, ASKING)
        self._declare(lambda session: session.declare_queryable(keys, queue.callback))

    def query(
        self,
        keys: str,
        seconds: float,
        payload: bytes | None = None,
        attachment: bytes | None = None,
        refused: Callable[[str], None] | None = None,
    ) -> Iterator[tuple[str, bytes, bytes]]:
        """Return key, payload and attachment of each answer to a query that comes within the time.

        `refused` is called with the reason, by each who says that there will be none.
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
        remote = zenoh.Locality.REMOTE
        publisher = self._declare(lambda session: session.declare_publisher(keys, allowed_destination=remote))
        return lambda: is_matched(publisher.current)

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
        with self._turn:
            self._closed.set()
            self._close_library()
            self._turn.notify_all()
        for worker in (self._worker, self._sending):
            if worker:
                worker.end()
        for reader in self._readers:
            if reader is not threading.current_thread():
                reader.join(1.0)

    def reopen(self, openings: int) -> bool:
        """Close the library's session and open another with all that was declared; return whether this was done.

        `openings` is what the caller knows of: several clients may share a session, and one opens it again for all.
        What was on its way is lost. Where it cannot be opened, as when its router is gone, each later call tries again.
        """
        with self._turn:
            if self._closed.is_set() or self._is_opening or (self._is_open and openings != self.openings):
                return False
            self._close_library()
            self._is_opening = True
        opened = None
        with suppress(zenoh.ZError):
            opened = self._open_library()  # takes long without a router; clients may be closed meanwhile
        with self._turn:
            self._is_opening = False
            if opened:
                self._replace_library(opened)
            self._turn.notify_all()
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
        """True while the session is lost and could not be opened again."""
        return not (self._is_open or self._closed.is_set())

    def links(self) -> list[tuple[str, str, str]]:
        """Return of each link the identity of the peer and both addresses, ours and the peer's."""
        return [(str(link.zid), link.src, link.dst) for link in self._session.info.links()]

    def routers(self) -> set[str]:
        """Return the identities of the peers that are routers to the library, as slaves are."""
        return {str(zid) for zid in self._session.info.routers_zid()}

    def free_links(self) -> None:
        """Close lost links at once, so that they do not delay the next one; see `hil.network.sockets`."""
        from hil.network.sockets import free_new  # the vehicle is ready before this is loaded

        queue = self._shared_worker().open_queue(free_new)
        self._declare(lambda session: session.info.declare_link_events_listener(queue.callback, history=True))

    def _number(self, node: str, keys: zenoh.KeyExpr) -> None:
        """Let the library give numbers to those of `keys` on which messages come often.

        It does so for a key that somebody subscribes to letter by letter. With wildcards each message carries the text
        of its key, and is looked up again where it arrives: 110 bytes and 40 us of a command's way.
        """
        for key in [key_of(topic, node) for topic in TOPICS.values() if topic.rate_hz >= OFTEN_HZ]:
            if key not in self._numbered and keys.includes(zenoh.KeyExpr(key)):
                self._numbered.add(key)
                self._declare(partial(_declare_unread, key))

    def _declare(self, declare: Callable[[zenoh.Session], Any]) -> Declared:
        """Declare something now, and each time that the session is opened again."""
        with self._turn:
            self._turn.wait_for(lambda: self._closed.is_set() or not self._is_opening)
            declared = Declared(declare, self._session, self.name)
            self._declared.append(declared)
        return declared

    def _close_library(self) -> None:
        """Close the library's session, which wakes the readers.

        A publisher that is still declared then would keep all of the session for good, 30 kB. While one of a latched
        topic is undeclared, the library keeps the interpreter's lock and waits for its thread, for up to 10 s if that
        calls us at this moment: so nothing is watched any more by then, and calls that have begun get time to end.
        """
        self._is_open = False
        watched = sum(declared.end_watching() for declared in self._declared)
        if watched:
            time.sleep(CALLS_END_S)
        for declared in self._declared:
            declared.end_publishing()
        close_session(self._session)

    def _subscribe(self, keys: str, depth: int, latched: bool) -> Declared:
        """Declare a subscriber whose messages a thread takes."""
        declare: Any = zenoh.Session.declare_subscriber
        if latched:
            from hil.network.latched import declare_subscriber as declare
        return self._declare(lambda session: declare(session, keys, zenoh.handlers.RingChannel(depth)))

    def _shared_worker(self) -> "WorkerThread":
        """Return the thread for everything that is rare, started on first use."""
        if self._worker is None:
            self._worker = self._start_worker("worker")
        return self._worker

    def _start_worker(self, name: str) -> "WorkerThread":
        from hil.network.worker import WorkerThread

        worker = WorkerThread()
        self._start(worker.run, name=name)
        return worker

    def _read(self, channel: Declared, use: Callable[[Any], None], name: str) -> None:
        def receive() -> None:
            while not self._closed.is_set():
                current = channel.current
                try:
                    item = current.recv()
                except zenoh.ZError:  # the session was closed, or is opened again
                    self._await_other(channel, current)
                else:
                    use(item)

        self._start(receive, name=name)

    def _await_other(self, declared: Declared, current: object) -> None:
        """Wait until it is declared on another session of the library, or ours is closed."""
        with self._turn:
            self._turn.wait_for(lambda: self._closed.is_set() or declared.current is not current)

    def _start(self, run: Callable[[], None], name: str) -> None:
        reader = threading.Thread(target=run, name=name, daemon=True)
        reader.start()
        self._readers.append(reader)


def _declare_unread(key: str, session: zenoh.Session) -> Any:
    return session.declare_subscriber(key, zenoh.handlers.RingChannel(1))


def _deliver(sample: zenoh.Sample, deliver: Deliver) -> None:
    name = str(sample.key_expr).split("/", 2)[2].rsplit("/", 2)[0]  # it may have several parts
    deliver(name, *_content(sample))


def _content(sample: zenoh.Sample) -> tuple[bytes, bytes]:
    """Return payload and attachment."""
    attachment = sample.attachment
    return sample.payload.to_bytes(), attachment.to_bytes() if attachment is not None else b""
