"""Measure what a master receives of each topic: rate, loss, age, bandwidth."""

import threading
import time
from collections.abc import Callable
from math import isnan, nan
from typing import NamedTuple

from hil.bench.harness import Process, await_vehicle
from hil.bench.presence import check_end, check_present
from hil.bench.report import Row
from hil.client.client import VehicleClient
from hil.client.delay import doubts_of
from hil.common.clock import NS_PER_MS, now_ns, to_wall_ns
from hil.common.errors import NetworkError
from hil.common.quantiles import quantile
from hil.network.roles import open_master_session
from hil.ros import dialect
from hil.ros import encoders as ros
from hil.ros.topics import TOPICS, is_picture
from hil.scenario.config import Scenario

QUEUE = 20_000
SENSOR_TOPICS = {"odometry": ("odom",), "dvl": ("dvl", "dvl_twist", "altitude")}  # other sensors: their name


ROWS = (
    Row("rate", "rate", "Hz", "{:.1f}", "higher"),
    Row("nominal", "nominal", "Hz", "{:g}", ""),
    Row("loss", "loss", "%", "{:.3f}"),
    Row("missing", "missing", "%", "{:.3f}"),
    Row("age p50", "age p50", "ms", "{:.3f}"),
    Row("age p99", "age p99", "ms", "{:.3f}"),
    Row("bandwidth", "bandwidth", "bytes/s", "{:.0f}", ""),
)
Stream = dict[str, float]  # name of a row -> its value for one topic, nan if unknown


class Listening(NamedTuple):
    """What came of each topic in one run, and the reasons to doubt the ages.

    Loss is counted by sequence numbers, "missing" is the share of the messages due by the nominal rate. Ages are from
    publication.
    """

    streams: dict[str, Stream]
    warnings: list[str]


class _TopicCount:
    """Messages of one topic, by publisher."""

    def __init__(self) -> None:
        self.numbers: dict[bytes, tuple[int, int]] = {}  # publisher -> first and last sequence number
        self.messages = 0
        self.bytes = 0
        self.stamps: list[tuple[int, int]] = []  # sent by their clock, received by ours, wall ns


class Listener:
    """An observer of a scenario's node that counts all messages except pictures. Use as a context."""

    def __init__(self, endpoint: str, scenario: Scenario) -> None:
        node, network, security = scenario.slave.node, scenario.network, scenario.security
        self._expected = expected(scenario)
        self._session = open_master_session(endpoint, network=network, security=security)
        self.client = VehicleClient(self._session, node, role="observer", security=security, topics=("odom",))
        self._counts: dict[str, _TopicCount] = {}
        self._counting = threading.Event()
        self._began = self._ended = 0.0
        self._session.subscribe_keys(f"{dialect.domain()}/{node}/*/*/*", self._on_message, QUEUE)

    def __enter__(self) -> "Listener":
        return self

    def __exit__(self, *_: object) -> None:
        self.client.close()
        self._session.close()

    def listen(self, seconds: float, slave: Process | None, watch: Callable[[float], None]) -> Listening:
        """Return what was received in `seconds`; `watch` is called with the progress (0 to 1).

        Raises NetworkError if the vehicle is not present, ends or hangs.
        """
        await_vehicle(self.client, slave)
        losses = self.client.contact.losses
        self._began = time.monotonic()
        self._counting.set()
        while time.monotonic() - self._began < seconds:
            time.sleep(0.1)
            check_present(self.client, slave)
            watch((time.monotonic() - self._began) / seconds)
        self._counting.clear()
        self._ended = time.monotonic()
        check_end(self.client, slave)
        topics = sorted({*self._counts, *self._expected})
        ages = {topic: sorted(self._ages(self._counts[topic])) for topic in topics if topic in self._counts}
        streams = {topic: self._stream(topic, ages.get(topic, [])) for topic in topics}
        if not ages:
            raise NetworkError(
                f"nothing came from {self.client.node} at {self.client.endpoint}; start it: uuv-hil slave"
            )
        lost = self.client.contact.losses - losses
        warnings = [f"the vehicle was out of reach meanwhile (times: {lost})"] if lost else []
        return Listening(streams, warnings + self._doubts([age for own in ages.values() for age in own]))

    def _on_message(self, key: str, payload: bytes, attachment: bytes) -> None:
        received_ns = to_wall_ns(now_ns())
        stamp = ros.unpack_attachment(attachment)
        if stamp is None or not self._counting.is_set():
            return
        count = self._counts.setdefault(key.split("/", 3)[2], _TopicCount())
        first, _ = count.numbers.get(stamp.gid, (stamp.sequence, 0))
        count.numbers[stamp.gid] = first, stamp.sequence
        count.messages += 1
        count.bytes += len(payload) + len(attachment)
        count.stamps.append((stamp.time_ns, received_ns))

    def _ages(self, count: _TopicCount) -> list[float]:
        """Return the ages from publish to receipt in ms by the clocks; negative where a clock is wrong."""
        delays, same = self.client.delays, self.client.contact.same_clock
        if not same and not delays.clock.exchanges:
            return []
        delays.same_clock = same
        return [(came - sent + delays.clock_at(came).offset_ns) / NS_PER_MS for sent, came in count.stamps]

    def _stream(self, topic: str, ages: list[float]) -> Stream:
        seconds = self._ended - self._began
        count, nominal = self._counts.get(topic, _TopicCount()), self._expected.get(topic, nan)
        sent = sum(last - first + 1 for first, last in count.numbers.values())
        loss = 1.0 - min(count.messages / sent, 1.0) if sent else nan
        short = missing(count.messages, nominal, seconds)
        return {
            "rate": count.messages / seconds, "nominal": nominal, "loss": 100.0 * loss, "missing": 100.0 * short,
            "age p50": quantile(ages, 0.5), "age p99": quantile(ages, 0.99), "bandwidth": count.bytes / seconds,
        }  # fmt: skip

    def _doubts(self, ages: list[float]) -> list[str]:
        """Return why the ages may be wrong, as hil.client.delay.judge does for commands.

        The list is empty if there is no reason.
        """
        clock, at_ns = self.client.delays.clock, to_wall_ns(now_ns())
        negative = sum(age < 0.0 for age in ages)
        doubts = []
        if negative:
            doubts.append(f"{negative} of {len(ages)} messages came before they were sent: a clock is wrong")
        if not clock.at(at_ns):
            doubts.append("the clocks could not be compared")
        middle_ns = quantile(sorted(ages), 0.5) * NS_PER_MS
        return doubts + doubts_of(clock, self.client.contact.same_clock, at_ns, middle_ns)


def expected(scenario: Scenario) -> dict[str, float]:
    """Return topic -> rate (Hz) of the topics that a slave of the scenario sends by itself, except pictures."""
    rates = {"diagnostics": TOPICS["diagnostics"].rate_hz}
    for name, fitted in scenario.sensors.items():
        if not fitted.offloaded:
            rates |= dict.fromkeys(SENSOR_TOPICS.get(name, (name,)), fitted.model.rate)
    if scenario.ros.wrench:
        rates["thruster_wrench"] = scenario.ros.wrench
    if scenario.ros.joints:
        own = ("joint_states", "motors", *(("tether",) if scenario.tether else ()))
        rates |= dict.fromkeys(own, scenario.ros.joints)
    return {topic: rate for topic, rate in rates.items() if not is_picture(topic)}


def missing(messages: int, nominal: float, seconds: float) -> float:
    """Return the share (0 to 1) of due messages that did not arrive.

    A difference of one message is chance, but if several are due and none arrives, all are missing.
    """
    if isnan(nominal):
        return nan
    due = max(int(nominal * seconds), 1)
    return max(1.0 - (messages + 1) / due, 0.0) if messages or due == 1 else 1.0
