"""Convert a recording to one file for Foxglove, with the seabed, obstacles and vehicle of its scenario."""

from base64 import b64decode

from hil.common.errors import ConfigError
from hil.gateways.foxglove.scene import encode_scene, scene_channel
from hil.recording.mcap_file import Message
from hil.recording.mcap_writer import RecordingFile
from hil.recording.reader import read_about, read_messages
from hil.recording.run import require_run


def write_for_foxglove(path: str, target: str, own_classes: bool = False) -> int:
    """Write the recording at `path`, a file or a folder, to the file `target`; return the number of its messages.

    Raises ConfigError, also for a target that is there already, and MissingExtraError.
    """
    about = read_about(path)
    run = require_run(about, path, own_classes)
    channel = scene_channel()
    try:
        file = RecordingFile(target, about.facts, about.attachments, run.scenario.recording.compression)
    except OSError as error:
        raise ConfigError(f"{target}: cannot be written: {error.strerror}; choose another file") from None
    file.add_topic(channel.topic, channel.type, (channel.schema_encoding, b64decode(channel.schema)), channel.encoding)
    copied = 0
    for copied, message in enumerate(read_messages(path), 1):
        if copied == 1:
            scene, logged_ns = encode_scene(run.scenario, run.world, run.vehicle), message.logged_ns
            file.write(Message(channel.topic, channel.type, 0, logged_ns, logged_ns, scene))
        file.write(message)
    file.close()
    return copied
