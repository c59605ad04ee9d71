"""Register the topics of a scenario's additional sensors of a kind, and topics and messages of a user's own sensors."""

from collections.abc import Iterable
from typing import TYPE_CHECKING

from hil.common.errors import ConfigError
from hil.ros import encoders as ros
from hil.ros import message as ros_message
from hil.ros.topics import OURS, TOPICS, Topic, add_further, further_topics
from hil.ros.types import definition
from sim.sensors.own import OwnKind, OwnSample

if TYPE_CHECKING:
    from sim.sensors.sensor_set import SensorSet

HEADER = "std_msgs/msg/Header"


def announce(sensors: "SensorSet", where: str) -> None:
    """Register the topics of users' own and additional sensors in this process. Raises ConfigError."""
    names = {*OURS}
    for name, fitted in sensors.items():
        section, own = f"{where}: {name}", fitted.sensor if isinstance(fitted.sensor, OwnKind) else None
        if not (own or fitted.name):
            continue
        added = {name, *([] if own else further_topics(name, fitted.sensor.topic))}
        if common := sorted(added & names):
            raise ConfigError(f"{section}: the topic {common[0]!r} is taken: give the sensor another name")
        names |= added
        if own:
            kind = _full_name(own.message, section)
            TOPICS[name] = Topic(name, kind, fitted.model.rate, "data")
            ros.introduce(name, _encoder(name, kind, section), _decoder(kind))
        else:
            add_further(name, fitted.sensor.topic)


def _full_name(message: str, section: str) -> str:
    """Return a message type's full name, "std_msgs/msg/Float64" also for "std_msgs/Float64". Raises ConfigError."""
    package, _, last = message.rpartition("/")
    full_name = message if "/" in package else f"{package}/msg/{last}"
    try:
        definition(full_name)
    except ConfigError as error:
        raise ConfigError(f"{section}: message: {error}") from None
    return full_name


def _encoder(name: str, kind: str, section: str) -> ros.Encoder:
    stamped = _has_header(kind)

    def encode(sample: OwnSample, prefix: str) -> Iterable[tuple[str, bytes]]:
        values = dict(sample.values)
        if stamped and "header" not in values:
            values["header"] = ros_message.header(sample.time_ns, f"{prefix}{name}_link")
        try:
            return [(name, ros_message.encode(kind, values))]
        except ConfigError as error:
            raise ConfigError(f"{section}: what it measures is no {error}") from None

    return encode


def _decoder(kind: str) -> ros.Decoder:
    stamped = _has_header(kind)

    def decode(data: bytes) -> OwnSample | None:
        values = ros_message.decode(kind, data)
        if values is None:
            return None
        return OwnSample(ros_message.time_of(values) if stamped else 0, values)

    return decode


def _has_header(kind: str) -> bool:
    fields = definition(kind).fields
    return bool(fields) and (fields[0].name, fields[0].type) == ("header", HEADER)
