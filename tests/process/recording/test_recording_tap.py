"""The recording tap: samples and commands in order, with their times; counted losses; endpoints that appear and end."""

import threading
import time
from collections import Counter
from collections.abc import Callable
from itertools import pairwise

import pytest
import zenoh

from hil.common.clock import NS_PER_S
from hil.network import session as session_module
from hil.network import supervisor
from hil.network.opening import listen
from hil.network.roles import open_master_session
from hil.recording import tap as recording_tap
from hil.recording.mcap_file import Message
from hil.recording.tap import Tap
from hil.ros.topics import TOPICS
from tests.support.busy import RunClock
from tests.support.processes import free_port, wait_for


def collect(tap: Tap, enough: Callable[[list[Message]], object], seconds: float = 10.0) -> list[Message]:
    messages: list[Message] = []

    def poll() -> object:
        messages.extend(tap.receive())
        return enough(messages)

    wait_for(poll, seconds)
    return messages


def have_subscribers(*audiences: Callable[[], bool]) -> object:
    """Return True once each key has a subscriber; messages published before would be lost."""
    return wait_for(lambda: all(is_received() for is_received in audiences))


def test_a_tap_receives_from_the_vehicle_and_its_master() -> None:
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with listen(endpoint) as slave, open_master_session(endpoint) as master, Tap([endpoint]) as tap:
        slave.subscribe("uuv1", "cmd_vel", lambda *_: None, depth=8)
        imu, commands = slave.publisher("uuv1", TOPICS["imu"]), master.publisher("uuv1", TOPICS["cmd_vel"])
        assert wait_for(lambda: tap.connected)
        assert have_subscribers(slave.watch_keys("0/uuv1/imu/**"), master.watch_keys("0/uuv1/cmd_vel/**"))
        start = time.time_ns()
        for number in range(100):
            imu.put(b"imu %d" % number, start + number)
            commands.put(b"command %d" % number, start + number)
            time.sleep(0.01)  # a command that finds two others waiting to be sent is dropped
        last = {b"imu 99", b"command 99"}
        arrived = collect(tap, lambda messages: last <= {message.data for message in messages})
    topics = Counter(message.topic for message in arrived)
    assert topics["/uuv1/imu"] + tap.missed >= 100
    assert topics["/uuv1/cmd_vel"] > 50, "messages before the tap was connected are lost"
    first = next(message for message in arrived if message.topic == "/uuv1/imu")
    assert first[:4] == ("/uuv1/imu", "sensor_msgs/msg/Imu", 1, start)
    assert first.data == b"imu 0"
    sequences = [m.sequence for m in arrived if m.topic == "/uuv1/imu"]
    assert sequences == sorted({*sequences})
    assert sequences[-1] == 100
    assert all(a.logged_ns <= b.logged_ns for a, b in pairwise(arrived))
    assert all(0 < message.logged_ns - start < 60_000_000_000 for message in arrived)


def test_latched_messages_are_received_once() -> None:
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with listen(endpoint) as slave:
        imu, tf = slave.publisher("uuv1", TOPICS["imu"]), slave.publisher("uuv1", TOPICS["/tf_static"])
        imu.put(b"missed", 6)
        tf.put(b"before", 7)
        with Tap([endpoint]) as tap:
            arrived = collect(tap, lambda messages: messages)
            tf.put(b"after", 8)
            arrived += collect(tap, lambda messages: messages)
            time.sleep(0.2)
            arrived += tap.receive()
    assert [(message.topic, message.sequence, message.data) for message in arrived] == [
        ("/tf_static", 1, b"before"),
        ("/tf_static", 2, b"after"),
    ]
    assert tap.missed == 0


def test_messages_of_two_vehicles_on_one_topic_are_counted_separately() -> None:
    ends = [f"tcp/127.0.0.1:{free_port()}" for _ in range(2)]
    with listen(ends[0]) as one, listen(ends[1]) as two, Tap(ends) as tap:
        publishers = [slave.publisher("", TOPICS["/tf"]) for slave in (one, two)]
        imu = two.publisher("uuv2", TOPICS["imu"])
        assert have_subscribers(one.watch_keys("0/tf/**"), two.watch_keys("0/tf/**"), two.watch_keys("0/uuv2/imu/**"))
        for number in range(50):
            publishers[0].put(b"one %d" % number, 7)
            publishers[1].put(b"two %d" % number, 8)
            imu.put(b"imu %d" % number, 9)
            if number == 20:  # from here on the keys are known, and go by number
                collect(tap, lambda messages: len(messages) >= 63)
        arrived = collect(tap, lambda messages: len(messages) >= 87)
    for name, topic in ((b"one", "/tf"), (b"two", "/tf"), (b"imu", "/uuv2/imu")):
        mine = [message for message in arrived if message.data.startswith(name)]
        assert [(m.topic, m.sequence, m.data) for m in mine] == [
            (topic, n + 1, b"%s %d" % (name, n)) for n in range(21, 50)
        ]
    assert tap.missed == 0


def test_a_link_that_the_library_does_not_read_is_opened_again() -> None:
    """The library never reads a link whose time limit for opening ends while it calls a slow listener."""
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    opened_endpoints: list[str] = []

    def be_slow(event: zenoh.LinkEvent) -> None:
        if event.kind == zenoh.SampleKind.PUT:
            opened_endpoints.append(event.link.dst)
            if len(opened_endpoints) == 1:
                time.sleep(0.7)  # the limit is 0.3 s

    with Tap([endpoint]) as tap:
        with listen(endpoint):
            assert wait_for(lambda: tap._sources and tap._sources[0].session.links())
            slow = zenoh.handlers.Callback(be_slow, indirect=False)
            listener = tap._sources[0].session._session.info.declare_link_events_listener(slow)
            assert not tap.complaint()
        with listen(endpoint) as slave:
            publisher = slave.publisher("uuv1", TOPICS["imu"])
            arrived = []

            def poll() -> bool:
                publisher.put(b"imu", 7)
                arrived.extend(tap.receive())
                return bool(tap.reconnections and arrived)

            assert wait_for(poll)
        assert tap.complaint() == "no message arrived although the link is open; connecting again"
        assert not tap.complaint()
        listener.undeclare()  # type: ignore[no-untyped-call]


def test_a_session_that_receives_nothing_any_more_is_reopened_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(supervisor, "LEASES", 1)
    monkeypatch.setattr(supervisor, "FIRST_GAP_NS", NS_PER_S // 4)  # a stall is reported after 1.75 s, then 3.5 s
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with listen(endpoint) as slave, Tap([endpoint]) as tap:
        publisher = slave.publisher("uuv1", TOPICS["imu"])

        def arrived() -> bool:
            publisher.put(b"imu", 7)
            return bool(tap.receive())

        assert wait_for(arrived)
        assert wait_for(lambda: (tap.receive(), tap.reconnections)[1])
        silent = time.monotonic() + 4.5  # without a message since it was opened there is no next time
        while time.monotonic() < silent:
            assert tap.receive() == []
            time.sleep(0.05)
        assert tap.reconnections == 1
        assert wait_for(arrived)


def test_topics_of_one_publisher_are_distinguished() -> None:
    """All commands of a master have one gid; each topic counts its own."""
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with listen(endpoint) as slave, Tap([endpoint]) as tap:
        topics = "imu", "pressure", "odom"
        publishers = [slave.publisher("uuv1", TOPICS[topic]) for topic in topics]
        for publisher in publishers:
            publisher.gid = publishers[0].gid
        assert have_subscribers(*[slave.watch_keys(f"0/uuv1/{topic}/**") for topic in topics])
        for number in range(1, 31):
            for topic, publisher in zip(topics, publishers, strict=True):
                if topic != "odom" or not number % 3:
                    publisher.put(b"%s %d" % (topic.encode(), number), 7)
        arrived = collect(tap, lambda messages: len(messages) >= 70)
    recorded = {topic: [(m.sequence, m.data) for m in arrived if m.topic == f"/uuv1/{topic}"] for topic in topics}
    for topic in ("imu", "pressure"):
        assert recorded[topic] == [(n, b"%s %d" % (topic.encode(), n)) for n in range(1, 31)]
    assert recorded["odom"] == [(n, b"odom %d" % (3 * n)) for n in range(1, 11)]
    assert tap.missed == 0


def test_a_vehicle_that_starts_late_and_restarts_is_received() -> None:
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    arrived: list[Message] = []
    with Tap([endpoint]) as tap:
        assert not tap.connected
        for life in range(2):
            with listen(endpoint) as slave:
                imu = slave.publisher("uuv1", TOPICS["imu"])

                def publish_imu(messages: list[Message], imu: object = imu, life: int = life) -> object:
                    imu.put(b"%d" % life, 7)  # type: ignore[attr-defined]
                    time.sleep(0.01)
                    return [message for message in messages if message.data == b"%d" % life]

                arrived += collect(tap, publish_imu)
    assert {message.data for message in arrived} == {b"0", b"1"}


def test_gaps_are_counted() -> None:
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with listen(endpoint) as slave, Tap([endpoint]) as tap:
        assert wait_for(lambda: tap.connected)
        imu = slave.publisher("uuv1", TOPICS["imu"])
        assert have_subscribers(slave.watch_keys("0/uuv1/imu/**"))
        imu.put(b"a", 7)
        imu.sequence += 4
        imu.put(b"b", 7)
        arrived = collect(tap, lambda messages: len(messages) >= 2)
    assert [message.sequence for message in arrived] == [1, 6]
    assert tap.missed == 4


def test_a_missing_endpoint_is_reported_once_in_a_while(monkeypatch: pytest.MonkeyPatch) -> None:
    endpoints = [f"tcp/127.0.0.1:{free_port()}" for _ in range(2)]
    monkeypatch.setattr(recording_tap, "PATIENCE_NS", 100_000_000)
    with listen(endpoints[0]), Tap(endpoints) as tap:
        assert tap.complaint() == ""
        assert wait_for(lambda: tap.connected)
        assert wait_for(tap.complaint) == f"still no answer from {endpoints[1]}; waiting"
        time.sleep(0.2)  # longer than the patience
        assert tap.complaint() == "", "not again for a minute"
        with listen(endpoints[1]):
            assert wait_for(lambda: len(tap.connected) == 2)
        monkeypatch.setattr(tap, "_complaint_ns", 0)
        assert tap.complaint() == ""


def test_the_threads_of_a_tap_end_with_it() -> None:
    before = set(threading.enumerate())
    with Tap([f"tcp/127.0.0.1:{free_port()}" for _ in range(3)]):
        assert len(set(threading.enumerate()) - before) == 3
    assert not set(threading.enumerate()) - before
    tap = Tap([f"tcp/127.0.0.1:{free_port()}"])
    assert not set(threading.enumerate()) - before, "it connects when it is entered"
    tap.close()


def test_closing_does_not_wait_for_a_missing_endpoint() -> None:
    with RunClock() as clock:
        with Tap([f"tcp/127.0.0.1:{free_port()}"]) as tap:
            assert tap.receive() == []
        assert clock.seconds < 1.0


def test_the_number_of_remembered_names_is_limited(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(recording_tap, "MAX_NAMES", 8)
    monkeypatch.setattr(session_module, "MAX_LEARNED", 8)
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with listen(endpoint) as slave, Tap([endpoint]) as tap:
        publishers = [slave.publisher(f"uuv{number}", TOPICS["imu"]) for number in range(40)]
        assert wait_for(lambda: tap.connected)
        assert have_subscribers(slave.watch_keys("0/uuv1/imu/**"))
        for publisher in publishers:
            publisher.put(b"imu", time.time_ns())
        received = collect(tap, lambda messages: len({message.topic for message in messages}) == len(publishers))
        assert len({message.topic for message in received}) == len(publishers), "each is recorded"
        assert len(tap._publishers) <= 8
        assert len(tap._sources[0].session._learned) <= 8
