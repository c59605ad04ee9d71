"""Messages of the MAVLink standard that pymavlink's dialect does not have yet: those of modes, and PROTOCOL_VERSION.

Layouts: mavlink/message_definitions, standard.xml and common.xml. Each is packed by pymavlink like its own.
"""

import struct
from typing import Any, ClassVar

from pymavlink.dialects.v20 import ardupilotmega as dialect

NAME_SIZE = 35  # bytes of a mode's name


class _NewerMessage(dialect.MAVLink_message):  # type: ignore[misc]  # pymavlink has no type information
    """A message whose `values` are in the order of the wire."""

    id: ClassVar[int]
    name: ClassVar[str]
    crc_extra: ClassVar[int]
    unpacker: ClassVar[struct.Struct]
    fields: ClassVar[tuple[str, ...]]

    def __init__(self, *values: Any) -> None:
        super().__init__(self.id, self.name)
        self.values = values
        self._fieldnames = list(self.fields)
        for name, value in zip(self.fields, values, strict=True):
            setattr(self, name, value)

    def pack(self, mav: Any, force_mavlink1: bool = False) -> bytes:
        """Return the packet. `force_mavlink1` is refused by pymavlink for such an id."""
        packet: bytes = self._pack(mav, self.crc_extra, self.unpacker.pack(*self.values), force_mavlink1)
        return packet


def _declare(number: int, name: str, crc_extra: int, layout: str, *fields: str) -> type[_NewerMessage]:
    parts = {"id": number, "msgname": name, "name": name, "crc_extra": crc_extra, "fields": fields}
    return type(name, (_NewerMessage,), parts | {"unpacker": struct.Struct(f"<{layout}")})


ProtocolVersion = _declare(  # the version times 100, the lowest and highest, and hashes that are not known
    300, "PROTOCOL_VERSION", 217, "HHH8s8s", "version", "min_version", "max_version", "spec_version_hash",
    "library_version_hash",
)  # fmt: skip
AvailableModes = _declare(  # one of the vehicle's modes
    435, "AVAILABLE_MODES", 134, f"IIBBB{NAME_SIZE}s", "custom_mode", "properties", "number_modes", "mode_index",
    "standard_mode", "mode_name",
)  # fmt: skip
# The mode that the vehicle is in, and the one that was asked for last
CurrentMode = _declare(436, "CURRENT_MODE", 193, "IIB", "custom_mode", "intended_custom_mode", "standard_mode")
AvailableModesMonitor = _declare(437, "AVAILABLE_MODES_MONITOR", 30, "B", "seq")  # changes when the list of modes does
