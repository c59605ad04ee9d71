"""Messages of the MAVLink standard that pymavlink's dialect does not have yet: those of modes.

Layouts: mavlink/message_definitions, standard.xml and common.xml. Each is packed by pymavlink like its own.
"""

import struct
from typing import Any, ClassVar

from pymavlink.dialects.v20 import ardupilotmega as dialect

NAME_SIZE = 35  # bytes of a mode's name


class _NewerMessage(dialect.MAVLink_message):  # type: ignore[misc]  # pymavlink has no type information
    """A message whose `values` are in the order of the wire."""

    id: ClassVar[int]
    msgname: ClassVar[str]
    name: ClassVar[str]
    crc_extra: ClassVar[int]
    unpacker: ClassVar[struct.Struct]
    wire_names: ClassVar[tuple[str, ...]]

    def __init__(self, *values: Any) -> None:
        super().__init__(self.id, self.msgname)
        self.values = values
        self._fieldnames = list(self.wire_names)
        for name, value in zip(self.wire_names, values, strict=False):
            setattr(self, name, value)

    def pack(self, mav: Any, force_mavlink1: bool = False) -> bytes:
        """Return the packet. `force_mavlink1` is refused by pymavlink for such an id."""
        packet: bytes = self._pack(mav, self.crc_extra, self.unpacker.pack(*self.values), force_mavlink1)
        return packet


class ProtocolVersion(_NewerMessage):
    """PROTOCOL_VERSION: the version of MAVLink times 100, its lowest and its highest, and hashes that are not known."""

    id = 300
    msgname = name = "PROTOCOL_VERSION"
    crc_extra = 217
    unpacker = struct.Struct("<HHH8s8s")
    wire_names = ("version", "min_version", "max_version", "spec_version_hash", "library_version_hash")


class AvailableModes(_NewerMessage):
    """AVAILABLE_MODES: one of the vehicle's modes."""

    id = 435
    msgname = name = "AVAILABLE_MODES"
    crc_extra = 134
    unpacker = struct.Struct(f"<IIBBB{NAME_SIZE}s")
    wire_names = ("custom_mode", "properties", "number_modes", "mode_index", "standard_mode", "mode_name")


class CurrentMode(_NewerMessage):
    """CURRENT_MODE: the mode that the vehicle is in, and the one that was asked for last."""

    id = 436
    msgname = name = "CURRENT_MODE"
    crc_extra = 193
    unpacker = struct.Struct("<IIB")
    wire_names = ("custom_mode", "intended_custom_mode", "standard_mode")


class AvailableModesMonitor(_NewerMessage):
    """AVAILABLE_MODES_MONITOR: a number that changes when the list of modes does."""

    id = 437
    msgname = name = "AVAILABLE_MODES_MONITOR"
    crc_extra = 30
    unpacker = struct.Struct("<B")
    wire_names = ("seq",)
