"""Samples published by a session: each on its topic with its time, and only declared topics."""

import math
import time

from hil.network.opening import listen
from hil.network.roles import open_master_session
from hil.ros import encoders as ros
from hil.ros import graph
from hil.ros.topics import TYPE_HASHES
from hil.slave.sample_publisher import MessageContent, SamplePublisher
from sim.sensors import extra_samples, own, samples
from sim.sensors.extra_samples import FixSample, FlagSample, PositionSample
from sim.sensors.imaging import samples as imaging_samples
from sim.sensors.samples import DvlSample, OdometrySample
from tests.support.processes import free_port, wait_for

EPOCH_NS = 1_700_000_000_000_000_000


def test_samples_arrive_on_their_topics() -> None:
    endpoint, received = f"tcp/127.0.0.1:{free_port()}", dict[str, bytes]()
    with listen(endpoint) as slave, open_master_session(endpoint) as master:
        master.subscribe("uuv1", "*", lambda topic, payload, _: received.update({topic: payload}), depth=64)
        sample_publisher = SamplePublisher(slave, "uuv1", EPOCH_NS)
        output = {"gps", "leak", "usbl", "dvl", "dvl_twist", "altitude", "diagnostics"}
        deadline = time.monotonic() + 60.0
        while set(received) != output and time.monotonic() < deadline:  # until the sessions have met
            sample_publisher.publish_sample("gps", FixSample(5, 57.7, 11.9, 36.0, (1.0, 2.0), True))
            sample_publisher.publish_sample("leak", FlagSample(5, True))
            sample_publisher.publish_sample(
                "usbl", PositionSample(5, (1.0, 2.0, 3.0), (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0))
            )
            sample_publisher.publish_sample("dvl", DvlSample(5, (1.0, 2.0, 3.0), 7.5, True))
            sample_publisher.publish_diagnostics("slave", 0, "well", {"cpu": "3"})
            time.sleep(0.01)
    assert set(received) == output == set(sample_publisher._publishers) - {"/diagnostics"}  # which is of no node
    assert sample_publisher.sent >= len(output)
    decoded = {topic: decoder(received[topic]) for topic in output if (decoder := ros.decoder(topic))}
    assert decoded["gps"] == (EPOCH_NS + 5, 57.7, 11.9, 36.0, (1.0, 2.0), True)
    assert decoded["leak"] is True
    assert decoded["usbl"].position == (1.0, 2.0, 3.0)
    assert decoded["altitude"] == (EPOCH_NS + 5, 7.5)
    assert decoded["dvl"] == DvlSample(EPOCH_NS + 5, (1.0, 2.0, 3.0), 7.5, True)
    assert decoded["dvl_twist"].velocity == (1.0, 2.0, 3.0)
    assert math.isnan(decoded["dvl_twist"].altitude)


def test_topics_are_declared_before_the_first_sample() -> None:
    """ROS can discover the publisher of a slow sensor at once."""
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with listen(endpoint) as slave, open_master_session(endpoint) as master:
        sample_publisher = SamplePublisher(slave, "uuv1", EPOCH_NS, MessageContent(excluded_topics=("/tf",)))
        sample_publisher.declare(["gps", "dvl", "odom"])

        def published() -> set[str]:
            entities = [graph.read_token(key) for key in master.tokens(graph.ALL)]
            return {entity.topic for entity in entities if entity and entity.kind == "MP"}

        topics = {f"/uuv1/{name}" for name in ("gps", "dvl", "dvl_twist", "altitude", "odom")}
        assert wait_for(lambda: published() == topics)
        assert sample_publisher.sent == 0


def test_every_sample_begins_with_its_time() -> None:
    """The sample publisher replaces the first field by the wall time."""
    modules = samples, extra_samples, imaging_samples, own
    named = [kind for module in modules for name, kind in vars(module).items() if name.endswith("Sample")]
    kinds = [kind for kind in named if hasattr(kind, "_fields")]  # Sample itself is a protocol
    assert len(kinds) > 12
    assert {kind._fields[0] for kind in kinds} == {"time_ns"}


def test_excluded_topics_are_not_published_and_frames_have_their_prefix() -> None:
    endpoint, received = f"tcp/127.0.0.1:{free_port()}", dict[str, bytes]()
    with listen(endpoint) as slave, open_master_session(endpoint) as master:
        master.subscribe_keys("0/**", lambda key, payload, _: received.update({key: payload}), depth=64)
        sample_publisher = SamplePublisher(slave, "uuv1", EPOCH_NS, MessageContent("uuv1/", ("/tf",)))
        deadline = time.monotonic() + 60.0
        while not received and time.monotonic() < deadline:
            sample_publisher.publish_sample(
                "odom", OdometrySample(5, (1.0, 2.0, 3.0), (1.0, 0.0, 0.0, 0.0), (0.0,) * 6)
            )
            time.sleep(0.01)
    ((key, payload),) = received.items()
    assert key == ros.data_key(0, "/uuv1/odom", "nav_msgs/msg/Odometry", TYPE_HASHES["nav_msgs/msg/Odometry"])
    assert b"uuv1/odom\0" in payload
