"""What reaches a master of each topic: how often, how much of it, how old, how many bytes a second."""

import threading
import time
from typing import NamedTuple

from hil.bench.harness import Process, await_vehicle
from hil.bench.statistics import quantile
from hil.clock import NS_PER_MS, now_ns
from hil.errors import NetworkError
from hil.master.client import VehicleClient
from hil.topics import TOPICS
from hil.transport import ros
from hil.transport.roles import dial
from hil.transport.security import Security
from hil.transport.settings import Network

QUEUE = 20_000


class Stream(NamedTuple):
    """One topic as it came: `rate` Hz, `loss` 0 to 1 by sequence numbers, ages (ms) from publish, `bytes_s`."""

    topic: str
    rate: float
    loss: float
    age_p50: float
    age_p99: float
    bytes_s: float


class _Seen:
    """What came on one topic, by publisher."""

    def __init__(self) -> None:
        self.numbers: dict[bytes, tuple[int, int]] = {}  # publisher -> first and last sequence number
        self.messages = 0
        self.bytes = 0
        self.stamps: list[tuple[int, int]] = []  # sent by their clock, received by ours, ns


class Listener:
    """An observer of one node that keeps count of everything. Use as a context."""

    def __init__(self, endpoint: str, node: str, network: Network, security: Security | None) -> None:
        self._session = dial(endpoint, network=network, security=security)
        self.client = VehicleClient(self._session, node, part="observer", security=security, topics=("odom",))
        self._seen: dict[str, _Seen] = {}
        self._counting = threading.Event()
        self._began = self._ended = 0.0
        self._session.overhear(f"0/{node}/*/*/*", self._take, QUEUE)

    def __enter__(self) -> "Listener":
        return self

    def __exit__(self, *_: object) -> None:
        self.client.close()
        self._session.close()

    def listen(self, seconds: float, slave: Process | None = None) -> list[Stream]:
        """What came in so long, by topic. Raises NetworkError when the vehicle is not there, or goes."""
        await_vehicle(self.client, slave)
        self._began = time.monotonic()
        self._counting.set()
        while time.monotonic() - self._began < seconds:
            time.sleep(0.1)
            if slave and not slave.running:
                raise NetworkError(f"the slave ended: {slave.last_words}")
        self._counting.clear()
        self._ended = time.monotonic()
        return [self._stream(topic, seen) for topic, seen in sorted(self._seen.items())]

    def _take(self, key: str, payload: bytes, attachment: bytes) -> None:
        received_ns = now_ns()
        stamp = ros.unpack_attachment(attachment)
        if stamp is None or not self._counting.is_set():
            return
        seen = self._seen.setdefault(key.split("/", 3)[2], _Seen())
        first, _ = seen.numbers.get(stamp.gid, (stamp.sequence, 0))
        seen.numbers[stamp.gid] = first, stamp.sequence
        seen.messages += 1
        seen.bytes += len(payload) + len(attachment)
        seen.stamps.append((stamp.time_ns, received_ns))

    def _stream(self, topic: str, seen: _Seen) -> Stream:
        seconds = self._ended - self._began
        sent = sum(last - first + 1 for first, last in seen.numbers.values())
        ages = sorted((came - self.client.contact.sent_ns(sent, came)) / NS_PER_MS for sent, came in seen.stamps)
        loss = 1.0 - min(seen.messages / sent, 1.0) if sent else 0.0
        rate, bytes_s = seen.messages / seconds, seen.bytes / seconds
        return Stream(topic, rate, loss, quantile(ages, 0.5), quantile(ages, 0.99), bytes_s)


def nominal_hz(topic: str, rates: dict[str, float]) -> float:
    """How often a topic should come: at its sensor's rate in the scenario, else as the topic table says."""
    if topic in rates:
        return rates[topic]
    return TOPICS[topic].rate_hz if topic in TOPICS else 0.0
