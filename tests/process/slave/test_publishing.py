"""The publishing thread of the loop: samples are sent in order or the oldest are dropped, and the loop never waits."""

import threading
from collections.abc import Iterator

import pytest

from hil.common.clock import now_ns
from hil.common.errors import ConfigError
from hil.ros import encoders as ros
from hil.ros.topics import Topic
from hil.slave.pilot_source import Trace
from hil.slave.publishing import PublishingThread
from hil.slave.sample_publisher import SamplePublisher
from sim.sensors.samples import PressureSample
from tests.support.processes import PATIENCE_S, wait_for

DEPTH = 8


class Publisher:
    """A publisher that blocks until the session is `free`."""

    has_subscribers = True
    background = False

    def __init__(self, session: "Session", topic: Topic) -> None:
        self.session, self.topic = session, topic
        self.sequence = 0

    def put(self, payload: bytes, wall_ns: int) -> int:
        self.session.publishing.set()
        assert self.session.free.wait(PATIENCE_S)
        self.session.sent.append((self.topic.name, payload, wall_ns))
        self.sequence += 1
        return self.sequence

    def keep(self, payload: bytes, wall_ns: int) -> None:
        self.session.stored.append(self.topic.name)


class Session:
    """A session whose publishers block while it is not `free`."""

    zid = "1"

    def __init__(self) -> None:
        self.free, self.publishing = threading.Event(), threading.Event()
        self.sent: list[tuple[str, bytes, int]] = []
        self.stored: list[str] = []
        self.threads: set[int] = set()

    def publisher(self, _node: str, topic: Topic) -> Publisher:
        self.threads.add(threading.get_ident())
        return Publisher(self, topic)

    def declare_token(self, _key: str) -> object:
        return None

    def watch_subscribers(self, _publisher: Publisher) -> None:
        """Do nothing: every topic has subscribers."""

    def numbers(self) -> list[int]:
        """Return the times of the samples of pressure that were sent."""
        payloads = [payload for name, payload, _ in self.sent if name == "pressure"]
        decoded = [ros.decode_pressure(payload) for payload in payloads]
        return [sample.time_ns for sample in decoded if sample]


@pytest.fixture
def session() -> Session:
    return Session()


@pytest.fixture
def thread(session: Session) -> Iterator[PublishingThread]:
    thread = PublishingThread(DEPTH)
    yield thread
    session.free.set()
    thread.close()
    assert not thread._thread.is_alive()


@pytest.fixture
def sample_publisher(session: Session, thread: PublishingThread) -> SamplePublisher:
    return SamplePublisher(session, "uuv1", 0, thread=thread)  # type: ignore[arg-type]


def step(sample_publisher: SamplePublisher, number: int) -> None:
    """Do one step of the loop, with a sample."""
    assert sample_publisher.publish_sample("pressure", PressureSample(number, 1e5))
    sample_publisher.wake_publisher()


def test_a_blocked_network_drops_the_oldest_samples_without_delay(
    sample_publisher: SamplePublisher, session: Session, thread: PublishingThread
) -> None:
    step(sample_publisher, 1)
    assert session.publishing.wait(PATIENCE_S), "it is held up with the first"
    for number in range(2, 41):  # would wait for ever
        step(sample_publisher, number)
    assert session.sent == []
    assert thread.dropped == 39 - DEPTH
    session.free.set()
    assert wait_for(lambda: len(session.numbers()) == 1 + DEPTH)
    assert session.numbers() == [1, *range(41 - DEPTH, 41)]
    step(sample_publisher, 41)
    assert wait_for(lambda: session.numbers()[-1] == 41)
    assert thread.dropped == 39 - DEPTH
    assert session.threads == {thread._thread.ident}, "nothing is declared by the loop"


def test_messages_are_sent_in_order_with_the_time_of_their_measurement(
    sample_publisher: SamplePublisher, session: Session
) -> None:
    sample_publisher.publish_sample("pressure", PressureSample(1, 1e5))
    sample_publisher.publish_trace(Trace(7, 1, 2, 3, 4, 5, 6))
    sample_publisher.publish("/clock", b"clock")
    after = now_ns()
    assert not session.publishing.wait(0.01), "nothing leaves before the step is over"
    sample_publisher.wake_publisher()
    assert session.publishing.wait(PATIENCE_S)
    released = now_ns()
    session.free.set()
    assert wait_for(lambda: len(session.sent) == 3)
    (pressure, _, arrived), (trace, payload, left), (clock, output, _) = session.sent
    assert (pressure, trace, clock, output) == ("pressure", "trace", "/clock", b"clock")
    assert ros.decode_int64_array(payload) == (7, 1, 2, 3, 4, 5, 6)
    assert left - arrived >= released - after, "a sample is as old as it is; a trace compares clocks when it leaves"


def test_samples_without_subscribers_do_not_wake_the_thread(
    sample_publisher: SamplePublisher, session: Session
) -> None:
    session.free.set()
    step(sample_publisher, 1)
    assert wait_for(lambda: session.numbers() == [1])
    for publisher in sample_publisher._publishers.values():
        publisher.has_subscribers = False
    assert not sample_publisher.publish_sample("pressure", PressureSample(2, 1e5))
    assert not sample_publisher._thread._waiting  # type: ignore[union-attr]


def test_waiting_samples_are_sent_at_the_end(session: Session) -> None:
    thread = PublishingThread(DEPTH)
    sample_publisher = SamplePublisher(session, "uuv1", 0, thread=thread)  # type: ignore[arg-type]
    for number in range(5):
        sample_publisher.publish_sample("pressure", PressureSample(number, 1e5))
    session.free.set()
    thread.close()
    assert session.numbers() == list(range(5))


def test_an_error_of_the_publishing_thread_is_raised_in_the_loop(thread: PublishingThread) -> None:
    def fail() -> None:
        raise ConfigError("sensor sonar: no such field")

    thread.append(fail)
    thread.wake()
    thread._thread.join(PATIENCE_S)
    with pytest.raises(ConfigError, match="no such field"):
        thread.wake()
