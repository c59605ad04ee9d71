"""Make the C headers of the firmware's MAVLink messages by pymavlink's generator.

To keep the firmware small, a dialect with only these messages is extracted from pymavlink's definitions.
"""

import os
import subprocess
import xml.etree.ElementTree as ElementTree

from hil.common.children import module_command
from hil.common.errors import MissingExtraError

DIALECT = "uuv_hil"
VERSION = "3"  # version of the common messages, sent in HEARTBEAT
DEFINITIONS = ("minimal.xml", "common.xml")
MESSAGES = {
    "HEARTBEAT", "SYS_STATUS", "SERVO_OUTPUT_RAW", "RC_CHANNELS_OVERRIDE", "COMMAND_LONG", "COMMAND_ACK", "TIMESYNC",
}  # fmt: skip


def version() -> str | None:
    """Return the version of the installed pymavlink; None if it is not installed."""
    from importlib import metadata

    try:
        return metadata.version("pymavlink")
    except metadata.PackageNotFoundError:
        return None


def make_headers(folder: str) -> None:
    """Write the headers into `folder`, to be included as <uuv_hil/mavlink.h>.

    Raises MissingExtraError without pymavlink.
    """
    if version() is None:
        raise MissingExtraError("the firmware's MAVLink is made with pymavlink: pip install pymavlink")
    path = os.path.join(folder, f"{DIALECT}.xml")
    _write_dialect(path)
    command = module_command("pymavlink.tools.mavgen", "--no-validate", "--lang", "C")
    command += ["--wire-protocol", "2.0", "--output", folder, path]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)


def _write_dialect(path: str) -> None:
    root = ElementTree.Element("mavlink")
    ElementTree.SubElement(root, "version").text = VERSION
    ElementTree.SubElement(root, "dialect").text = "0"
    enums, messages = ElementTree.SubElement(root, "enums"), ElementTree.SubElement(root, "messages")
    for definitions in map(_definitions, DEFINITIONS):
        enums.extend(definitions.iter("enum"))
        messages.extend(message for message in definitions.iter("message") if message.get("name") in MESSAGES)
    ElementTree.ElementTree(root).write(path)


def _definitions(name: str) -> ElementTree.Element:
    import pymavlink

    return ElementTree.parse(os.path.join(os.path.dirname(pymavlink.__file__), "dialects", "v20", name)).getroot()
