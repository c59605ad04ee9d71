"""Listening to everything that vehicles say and are told, at next to no cost, for what records and shows it.

A tap visits each slave (or a router), and so hears also the commands that a slave gets from others. Many vehicles send
thousands of messages a second; a thread that wakes for each would take more of the processor than all the rest, so they
are fetched in batches, and the library notes when each came.
"""

import os
import threading
from contextlib import suppress
from typing import TYPE_CHECKING, Any

import zenoh
from zenoh.ext import HistoryConfig, declare_advanced_subscriber

from hil.clock import now_ns, to_wall_ns
from hil.topics import TOPICS
from hil.transport import ros
from hil.transport.linger import watch
from hil.transport.recording_file import Message
from hil.transport.settings import Network, settings

if TYPE_CHECKING:
    from hil.transport.security import Security

# By default one thread of the library polls and wakes another for each message; so one does both.
ONE_THREAD = "(app: (worker_threads: 1), rx: (handover: app), net: (handover: app), tx: (handover: app))"
DEPTH = 1 << 14  # messages of one endpoint that may wait; beyond it the oldest are dropped, and counted as missed
RETRY_S = 0.2


def save_processor() -> None:
    """Let this process take in what comes at a third less; before it opens its first session."""
    os.environ.setdefault("ZENOH_RUNTIME", ONE_THREAD)
    os.sched_setscheduler(0, os.SCHED_BATCH, os.sched_param(0))  # lets others finish first, and takes more at once


class Tap:
    """What comes at `endpoints` from now on, and what was said before on latched topics. Use as a context.

    An endpoint that is not there yet, or goes away, is waited for. `missed` counts what was sent and did not come,
    by the gaps in the numbers of each publisher. Raises NetworkError when an endpoint cannot be meant.
    """

    def __init__(self, endpoints: list[str], network: Network = Network(), security: "Security | None" = None) -> None:
        texts = [settings("visitor", (), (endpoint,), network, security) for endpoint in endpoints]
        self.connected: set[str] = set()
        self.missed = 0
        self._numbers: dict[bytes, int] = {}
        self._keys: dict[str, tuple[str, str] | None] = {}
        self._sessions: list[zenoh.Session] = []
        self._channels: list[Any] = []  # subscribers; their type does not say that `try_recv` is theirs
        self._closing = threading.Event()
        for endpoint, text in zip(endpoints, texts, strict=True):
            threading.Thread(target=self._open, args=(endpoint, text), name=f"tap {endpoint}", daemon=True).start()

    def __enter__(self) -> "Tap":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def take(self) -> list[Message]:
        """What has come since the last call, in the order it came."""
        samples = []
        for channel in tuple(self._channels):
            while (sample := channel.try_recv()) is not None:
                samples.append(sample)
        messages = [message for sample in samples if (message := self._message(sample))]
        messages.sort(key=_came)
        return messages

    def close(self) -> None:
        """End it. Closing twice is harmless."""
        self._closing.set()
        for session in self._sessions:
            session.close()  # type: ignore[no-untyped-call]  # zenoh leaves it unannotated

    def _open(self, endpoint: str, text: str) -> None:
        """Try until the endpoint is there; from then on the library connects again after each loss."""
        config = zenoh.Config.from_json5(text)
        config.insert_json5("timestamping/enabled", "true")  # of what comes, with the time when it came
        while not self._closing.is_set():
            with suppress(zenoh.ZError):
                session = zenoh.open(config)
                self._listen(session)
                self.connected.add(endpoint)
                watch(session)
                return
            self._closing.wait(RETRY_S)

    def _listen(self, session: zenoh.Session) -> None:
        self._sessions.append(session)
        self._channels.append(session.declare_subscriber("0/**", zenoh.handlers.RingChannel(DEPTH)))
        history = HistoryConfig(detect_late_publishers=True)
        for name in [topic.full_name("*") for topic in TOPICS.values() if topic.qos.latched]:
            channel: Any = zenoh.handlers.RingChannel(DEPTH)  # what comes by both is dropped as the same
            self._channels.append(declare_advanced_subscriber(session, f"0{name}/*/*", channel, history=history))
        if self._closing.is_set():
            session.close()  # type: ignore[no-untyped-call]  # zenoh leaves it unannotated

    def _message(self, sample: zenoh.Sample) -> Message | None:
        name = str(sample.key_expr)
        if name not in self._keys:
            self._keys[name] = _read_key(name)
        key = self._keys[name]
        if key is None:
            return None
        stamp = sample.timestamp
        came_ns = stamp.get_time_as_ntp64().as_nanos() if stamp else to_wall_ns(now_ns())
        attachment = sample.attachment
        told = ros.unpack_attachment(attachment.to_bytes()) if attachment is not None else None
        if told is None:
            return Message(*key, 0, came_ns, came_ns, sample.payload.to_bytes())
        sequence, sent_ns, gid = told
        last = self._numbers.get(gid, sequence - 1)
        if sequence <= last:  # the same, by another way
            return None
        self.missed += sequence - last - 1
        self._numbers[gid] = sequence
        return Message(*key, sequence, sent_ns, came_ns, sample.payload.to_bytes())


def _came(message: Message) -> int:
    return message.logged_ns


def _read_key(key: str) -> tuple[str, str] | None:
    """Topic and type of a key: the inverse of `ros.data_key`. None for what is no topic."""
    parts = key.split("/")
    package, _, name = parts[-2].partition("::") if len(parts) > 3 else ("", "", "")
    kind, _, last = name.partition("::dds_::")
    if not (parts[-1].startswith("RIHS01_") and last.endswith("_")):
        return None
    return "/" + "/".join(parts[1:-2]), f"{package}/{kind}/{last[:-1]}"
