"""Samples without subscribers are not sent, but the last one is stored for late subscribers."""

import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from hil.common.clock import now_ns, to_wall_ns
from hil.network.opening import listen
from hil.network.presence import fetch_last, serve_last
from hil.network.roles import open_master_session
from hil.network.session import Session
from hil.network.settings import Network
from hil.ros import encoders as ros
from hil.slave.sample_publisher import MessageContent, SamplePublisher
from sim.sensors.samples import DvlSample, ImuSample, OdometrySample, PressureSample
from tests.support.processes import Program, free_port, wait_for


def imu(number: int) -> ImuSample:
    return ImuSample(number, (1.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, -9.8))


def pressure(number: int) -> PressureSample:
    return PressureSample(number, 1e5)


class Vehicle:
    """A publisher of samples that counts its steps."""

    def __init__(self, session: Session) -> None:
        self.sample_publisher = SamplePublisher(session, "uuv1", 0)
        self.steps = 0

    def step(self) -> None:
        self.steps += 1
        self.sample_publisher.publish_sample("imu", imu(self.steps))
        self.sample_publisher.publish_sample("pressure", pressure(self.steps))

    def sent_count(self, topic: str) -> int:
        return self.sample_publisher._publishers[topic].sequence

    def stops_sending(self) -> bool:
        """Return True if sending stops soon."""

        def is_silent() -> bool:
            before = self.sample_publisher.sent
            self.step()
            return self.sample_publisher.sent == before

        return bool(wait_for(is_silent))

    def run(self, count: int) -> None:
        for _ in range(count):
            self.step()
            time.sleep(0.001)

    def until(self, true: Callable[[], bool]) -> bool:
        """Return True if the condition becomes true while samples are published."""

        def stepped() -> bool:
            self.step()
            return true()

        return bool(wait_for(stepped))


class Received(defaultdict[str, list[int]]):
    """The sequence numbers received, by topic."""

    def __init__(self, session: Session, *topics: str) -> None:
        super().__init__(list)
        for topic in topics:
            session.subscribe("uuv1", topic, self._on_sample, depth=1000)

    def _on_sample(self, topic: str, _: bytes, attachment: bytes) -> None:
        stamp = ros.unpack_attachment(attachment)
        assert stamp
        self[topic].append(stamp.sequence)

    def all_of(self, topic: str, last: int) -> bool:
        """Return True if all from the first to the last have arrived."""
        return bool(wait_for(lambda: self[topic] == list(range(self[topic][0], last + 1))))


@contextmanager
def listening(endpoint: str, *topics: str) -> Iterator[Received]:
    with open_master_session(endpoint) as session:
        yield Received(session, *topics)


@pytest.fixture
def endpoint() -> str:
    return f"tcp/127.0.0.1:{free_port()}"


@pytest.fixture
def vehicle(endpoint: str) -> Iterator[Vehicle]:
    with listen(endpoint) as session:
        yield Vehicle(session)


def test_only_topics_with_subscribers_are_sent(vehicle: Vehicle, endpoint: str) -> None:
    vehicle.step()
    assert vehicle.stops_sending()
    with listening(endpoint, "pressure") as received:
        assert vehicle.until(lambda: "pressure" in received)
        before = vehicle.sent_count("imu"), vehicle.sent_count("pressure")
        vehicle.run(50)
        assert vehicle.sent_count("imu") == before[0]
        assert vehicle.sent_count("pressure") == before[1] + 50
        assert received.all_of("pressure", vehicle.sent_count("pressure"))
    assert vehicle.stops_sending()


def test_all_subscribers_get_the_same_samples(vehicle: Vehicle, endpoint: str) -> None:
    vehicle.step()
    with listening(endpoint, "imu") as one, listening(endpoint, "*") as other:
        assert vehicle.until(lambda: "imu" in one and "imu" in other and "pressure" in other)
        vehicle.run(20)
        assert one.all_of("imu", vehicle.sent_count("imu"))
        assert other.all_of("imu", vehicle.sent_count("imu"))
        assert other.all_of("pressure", vehicle.sent_count("pressure"))


def test_one_subscriber_of_one_of_its_messages_is_enough(endpoint: str) -> None:
    """A sample may be sent as several messages."""
    with listen(endpoint) as session:
        sample_publisher = SamplePublisher(session, "uuv1", 0)

        def output() -> set[str]:
            sample_publisher.publish_sample("dvl", DvlSample(1, (1.0, 0.0, 0.0), 7.5, True))
            return set(received)

        with listening(endpoint, "altitude") as received:
            assert wait_for(lambda: output() == {"altitude"})


def test_an_excluded_topic_does_not_cause_sending(endpoint: str) -> None:
    """A subscriber to /tf gets no odometry where transforms are switched off."""
    with listen(endpoint) as session, open_master_session(endpoint) as other:
        other.subscribe_keys("0/tf/*/*", lambda *_: None, 8)
        sample_publisher = SamplePublisher(session, "uuv1", 0, MessageContent(excluded_topics=("/tf",)))
        sample = OdometrySample(1, (0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0), (0.0,) * 6)
        assert wait_for(session.watch_keys("0/tf/*/*"))
        sample_publisher.publish_sample("odom", sample)
        assert wait_for(lambda: not sample_publisher._publishers["odom"].has_subscribers)
        before = sample_publisher.sent
        sample_publisher.publish_sample("odom", sample)
        assert sample_publisher.sent == before
        assert set(sample_publisher._publishers) == {"odom"}


def test_a_late_subscriber_gets_the_newest_sample_though_it_was_never_sent(vehicle: Vehicle, endpoint: str) -> None:
    serve_last(vehicle.sample_publisher._session, "uuv1", vehicle.sample_publisher.encode_unsent)
    vehicle.step()
    assert vehicle.stops_sending()
    vehicle.run(10)
    before = to_wall_ns(now_ns())
    vehicle.step()
    after, sent_counts = to_wall_ns(now_ns()), vehicle.sample_publisher.sent
    last: dict[str, tuple[bytes, bytes]] = {}
    with open_master_session(endpoint) as late:

        def ask(topic: str = "*") -> set[str]:
            last.clear()
            fetch_last(late, "uuv1", lambda name, *message: last.update({name: message}), topic)
            return set(last)

        assert wait_for(ask)
        assert set(last) == {"imu", "pressure"}
        decoded, stamp = ros.decode_imu(last["imu"][0]), ros.unpack_attachment(last["imu"][1])
        assert decoded is not None
        assert decoded.time_ns == vehicle.steps
        assert stamp is not None
        assert before <= stamp.time_ns <= after, "it is as old as it is"
        assert ask("pressure") == {"pressure"}, "only what was queried"
    assert vehicle.sample_publisher.sent == sent_counts


def test_a_stored_sample_does_not_replace_a_sent_one(vehicle: Vehicle, endpoint: str) -> None:
    vehicle.step()
    assert vehicle.stops_sending()
    with listening(endpoint, "*") as received:
        assert vehicle.until(lambda: "imu" in received)
        sent = vehicle.sample_publisher._publishers["imu"].last
        vehicle.sample_publisher.encode_unsent()
        assert vehicle.sample_publisher._publishers["imu"].last is sent


def test_all_samples_are_sent_when_required(endpoint: str) -> None:
    """The slave's own recording needs all samples."""
    numbers: list[int] = []
    with listen(endpoint) as session:
        sample_publisher = SamplePublisher(session, "uuv1", 0, record=lambda _, __, number: numbers.append(number))
        for number in range(30):
            sample_publisher.publish_sample("imu", imu(number))
            time.sleep(0.002)
    assert sample_publisher.sent == 30
    assert numbers == [*range(1, 31)]


def test_a_subscriber_behind_a_router_counts(tmp_path: Path, endpoint: str) -> None:
    router = f"tcp/127.0.0.1:{free_port()}"
    network = Network(mode="routed", router=router)
    with Program(tmp_path, "router", "--listen", router) as between:
        between.expect("forwarding")
        with listen(endpoint, network) as session:
            vehicle = Vehicle(session)
            vehicle.step()
            assert vehicle.stops_sending()
            with open_master_session(router, network=network) as master:
                received = Received(master, "imu")
                assert vehicle.until(lambda: "imu" in received)
                before = vehicle.sent_count("pressure")
                vehicle.run(20)
                assert vehicle.sent_count("pressure") == before
            assert vehicle.stops_sending()
