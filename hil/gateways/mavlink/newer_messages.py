"""A message of the MAVLink standard that pymavlink's dialect does not have; packed by pymavlink like its own."""

import struct
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as dialect


class ProtocolVersion(dialect.MAVLink_message):  # type: ignore[misc]  # pymavlink has no type information
    """PROTOCOL_VERSION: the version of MAVLink times 100, its lowest and its highest, and hashes that are not known."""

    id = 300
    msgname = name = "PROTOCOL_VERSION"
    crc_extra = 217
    unpacker = struct.Struct("<HHH8s8s")

    def __init__(self) -> None:
        super().__init__(self.id, self.name)

    def pack(self, mav: Any, force_mavlink1: bool = False) -> bytes:
        """Return the packet. `force_mavlink1` is refused by pymavlink for such an id."""
        content = self.unpacker.pack(200, 100, 200, bytes(8), bytes(8))
        packet: bytes = self._pack(mav, self.crc_extra, content, force_mavlink1)
        return packet
