"""Small recordings, and their contents as read by other software."""

import random
from pathlib import Path

from mcap.reader import make_reader
from rosbags.highlevel import AnyReader

from hil.recording.mcap_file import Message
from hil.ros import encoders as ros
from hil.scenario.records import Recording
from sim.sensors.samples import ImuSample

SMALL = Recording(file_size=1.0, total_size=2.0, keep_free=0.0)


EPOCH_NS = 1_795_000_000_000_000_000


def imu(number: int, topic: str = "/uuv1/imu", noise: bool = False) -> Message:
    time_ns = EPOCH_NS + number * 10_000_000
    chance = random.Random(number)
    turn = (chance.random(), chance.random(), chance.random()) if noise else (0.1, 0.2, 0.3)
    payload = ros.encode_imu(ImuSample(time_ns, (1.0, 0.0, 0.0, 0.0), turn, (0.0, 0.0, 9.8 + number)))
    return Message(topic, "sensor_msgs/msg/Imu", number, time_ns, time_ns + 1_000, payload)


def by_rosbags(path: Path) -> list[tuple[str, int, float]]:
    """Return topic, log time and one field of each message, as rosbags reads them with the schemas of the recording."""
    with AnyReader([path]) as reader:
        return [
            (connection.topic, at, reader.deserialize(raw, connection.msgtype).linear_acceleration.z)  # type: ignore[attr-defined]
            for connection, at, raw in reader.messages()
        ]


def by_mcap(path: Path) -> list[Message]:
    with path.open("rb") as file:
        return [
            Message(channel.topic, schema.name if schema else "", m.sequence, m.publish_time, m.log_time, m.data)
            for schema, channel, m in make_reader(file, validate_crcs=True).iter_messages()
        ]
