"""Convert a recording to one file for Foxglove, with seabed, obstacles, vehicle, and pictures of sonars."""

from base64 import b64decode
from collections.abc import Iterator
from dataclasses import dataclass, field

from hil.common.errors import ConfigError
from hil.gateways.foxglove.scene import encode_scene, scene_channel
from hil.recording.mcap_file import Message
from hil.recording.mcap_writer import RecordingFile
from hil.recording.reader import read_about, read_messages
from hil.recording.run import Run, require_run
from hil.ros.images import decode_sonar, encode_fan
from hil.ros.topics import FAN, TOPICS

SONAR_TYPE, FAN_TYPE = (TOPICS[f"forward_sonar/{end}"].type for end in ("image", FAN))


@dataclass
class Written:
    """Number of messages that were copied, and of those that were added, by topic."""

    copied: int = 0
    added: dict[str, int] = field(default_factory=dict)


def write_for_foxglove(path: str, target: str, own_classes: bool = False) -> Written:
    """Write the recording at `path`, a file or a folder, to the file `target`.

    Raises ConfigError, also for a target that is there already, and MissingExtraError.
    """
    about = read_about(path)
    run = require_run(about, path, own_classes)
    channel, written = scene_channel(), Written()
    fans = {message.topic for message in read_messages(path) if message.topic.endswith(f"/{FAN}")}
    try:
        file = RecordingFile(target, about.facts, about.attachments, run.scenario.recording.compression)
    except OSError as error:
        raise ConfigError(f"{target}: cannot be written: {error.strerror}; choose another file") from None
    file.add_topic(channel.topic, channel.type, (channel.schema_encoding, b64decode(channel.schema)), channel.encoding)
    for message in read_messages(path):
        if not written.copied:
            _add(file, written, _scene(run, message.logged_ns))
        file.write(message)
        written.copied += 1
        for fan in _fan(message, fans):
            _add(file, written, fan)
    file.close()
    return written


def _add(file: RecordingFile, written: Written, message: Message) -> None:
    file.write(message)
    written.added[message.topic] = written.added.get(message.topic, 0) + 1


def _scene(run: Run, time_ns: int) -> Message:
    channel = scene_channel()
    return Message(channel.topic, channel.type, 0, time_ns, time_ns, encode_scene(run.scenario, run.world, run.vehicle))


def _fan(message: Message, fans: set[str]) -> Iterator[Message]:
    """Yield the fan of a sonar's picture, unless its topic is among `fans`, which the recording has."""
    sonar, _, end = message.topic.rpartition("/")
    topic = f"{sonar}/{FAN}"
    if message.type == SONAR_TYPE and end == "image" and topic not in fans and (sample := decode_sonar(message.data)):
        data = encode_fan(sample, f"{sonar.rpartition('/')[2]}_link")
        yield message._replace(topic=topic, type=FAN_TYPE, data=data)
