"""What reaches a master of each topic: how often, how much of it, how old, how many bytes a second."""

import threading
import time
from collections.abc import Callable
from math import isnan, nan
from typing import NamedTuple

from hil.bench.harness import Process, await_vehicle
from hil.bench.presence import check_end, check_there
from hil.clock import NS_PER_MS, now_ns, to_wall_ns
from hil.config import Scenario
from hil.errors import NetworkError
from hil.master.client import VehicleClient
from hil.master.delay import doubts_of
from hil.quantiles import quantile
from hil.topics import TOPICS, is_picture
from hil.transport import ros
from hil.transport.roles import dial

QUEUE = 20_000
SENSOR_TOPICS = {"odometry": ("odom",), "dvl": ("dvl", "dvl_twist", "altitude")}  # of others it is their name


class Stream(NamedTuple):
    """One topic as it came.

    `rate` Hz, `nominal` likewise, nan where nothing says how often it should come. `loss` 0 to 1 by sequence numbers,
    `missing` 0 to 1 of what should have come by the nominal rate. Ages (ms) from publish, nan if unknown; `bytes_s`.
    """

    topic: str
    rate: float
    nominal: float
    loss: float
    missing: float
    age_p50: float
    age_p99: float
    bytes_s: float


class Heard(NamedTuple):
    """What came in one run, by topic, and why its ages are not to be trusted."""

    streams: list[Stream]
    warnings: list[str]


class _Seen:
    """What came on one topic, by publisher."""

    def __init__(self) -> None:
        self.numbers: dict[bytes, tuple[int, int]] = {}  # publisher -> first and last sequence number
        self.messages = 0
        self.bytes = 0
        self.stamps: list[tuple[int, int]] = []  # sent by their clock, received by ours, wall ns


class Listener:
    """An observer of a scenario's node that keeps count of everything but pictures. Use as a context."""

    def __init__(self, endpoint: str, scenario: Scenario) -> None:
        node, network, security = scenario.slave.node, scenario.network, scenario.security
        self._expected = expected(scenario)
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

    def listen(self, seconds: float, slave: Process | None, watch: Callable[[float], None]) -> Heard:
        """What came in so long; `watch` is told the share that is done.

        Raises NetworkError when the vehicle is not there, goes or hangs.
        """
        await_vehicle(self.client, slave)
        losses = self.client.contact.losses
        self._began = time.monotonic()
        self._counting.set()
        while time.monotonic() - self._began < seconds:
            time.sleep(0.1)
            check_there(self.client, slave)
            watch((time.monotonic() - self._began) / seconds)
        self._counting.clear()
        self._ended = time.monotonic()
        check_end(self.client, slave)
        topics = sorted({*self._seen, *self._expected})
        ages = {topic: sorted(self._ages(self._seen[topic])) for topic in topics if topic in self._seen}
        streams = [self._stream(topic, ages.get(topic, [])) for topic in topics]
        if not ages:
            raise NetworkError(f"nothing came from {self.client.node} at {self.client.endpoint}")
        lost = self.client.contact.losses - losses
        gone = [f"the vehicle was out of reach meanwhile (times: {lost})"] if lost else []
        return Heard(streams, gone + self._doubts([age for own in ages.values() for age in own]))

    def _take(self, key: str, payload: bytes, attachment: bytes) -> None:
        received_ns = to_wall_ns(now_ns())
        stamp = ros.unpack_attachment(attachment)
        if stamp is None or not self._counting.is_set():
            return
        seen = self._seen.setdefault(key.split("/", 3)[2], _Seen())
        first, _ = seen.numbers.get(stamp.gid, (stamp.sequence, 0))
        seen.numbers[stamp.gid] = first, stamp.sequence
        seen.messages += 1
        seen.bytes += len(payload) + len(attachment)
        seen.stamps.append((stamp.time_ns, received_ns))

    def _ages(self, seen: _Seen) -> list[float]:
        """From publish to receipt, ms, as the clocks have it: below zero where one of them is wrong."""
        clock, same = self.client.delays.clock, self.client.contact.same_clock
        found = []
        for sent, came in seen.stamps:
            estimate = None if same else clock.at(came)
            if same or estimate:
                found.append((came - sent + (estimate.offset_ns if estimate else 0)) / NS_PER_MS)
        return found

    def _stream(self, topic: str, ages: list[float]) -> Stream:
        seconds = self._ended - self._began
        seen, nominal = self._seen.get(topic, _Seen()), self._expected.get(topic, nan)
        sent = sum(last - first + 1 for first, last in seen.numbers.values())
        loss = 1.0 - min(seen.messages / sent, 1.0) if sent else nan
        short = missing(seen.messages, nominal, seconds)
        rate, bytes_s = seen.messages / seconds, seen.bytes / seconds
        return Stream(topic, rate, nominal, loss, short, quantile(ages, 0.5), quantile(ages, 0.99), bytes_s)

    def _doubts(self, ages: list[float]) -> list[str]:
        """Why the ages are not to be trusted, as hil.master.delay.judge says of commands; nothing if they may be."""
        clock, at_ns = self.client.delays.clock, to_wall_ns(now_ns())
        negative = sum(age < 0.0 for age in ages)
        found = [f"{negative} of {len(ages)} messages came before they were sent: a clock is wrong"] if negative else []
        if not clock.at(at_ns):
            found.append("the clocks could not be compared")
        middle_ns = quantile(sorted(ages), 0.5) * NS_PER_MS
        return found + doubts_of(clock, self.client.contact.same_clock, at_ns, middle_ns)


def expected(scenario: Scenario) -> dict[str, float]:
    """The topics that a slave of the scenario sends by itself, but for pictures, and how often each, Hz."""
    found = {"diagnostics": TOPICS["diagnostics"].rate_hz}
    for name, fitted in scenario.sensors.items():
        if not fitted.heavy:
            found |= dict.fromkeys(SENSOR_TOPICS.get(name, (name,)), fitted.model.rate)
    if scenario.ros.wrench:
        found["thruster_wrench"] = scenario.ros.wrench
    return {topic: rate for topic, rate in found.items() if not is_picture(topic)}


def missing(messages: int, nominal: float, seconds: float) -> float:
    """The share (0 to 1) of what should have come that did not.

    One message more or less is chance, but where several are due and none comes, all are missing.
    """
    if isnan(nominal):
        return nan
    due = max(int(nominal * seconds), 1)
    return max(1.0 - (messages + 1) / due, 0.0) if messages or due == 1 else 1.0
