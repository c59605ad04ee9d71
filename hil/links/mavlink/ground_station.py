"""Answers of the device's end to the requests that a ground station sends to every vehicle.

A ground station waits for parameters, missions and files before it shows anything. All requests are answered at once:
with one parameter, the system id, which is read-only; an empty mission; no files (NAK).
"""

from collections.abc import Callable
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as dialect

PARAMETER = b"SYSID_THISMAV"
FTP_REPLIES = (0, 128, 129)  # opcodes that are not requests: none, ACK, NAK
FTP_NAK, FTP_UNKNOWN = 129, 7
FTP_PAYLOAD = 251


class GroundStationAnswers:
    """Answers of the end with this system id. `handlers` maps message ids to functions that return messages."""

    def __init__(self, system: int) -> None:
        self._system = system
        self.handlers: dict[int, Callable[[Any], list[Any]]] = {
            dialect.MAVLINK_MSG_ID_PARAM_REQUEST_LIST: self._parameter,
            dialect.MAVLINK_MSG_ID_PARAM_REQUEST_READ: self._read_parameter,
            dialect.MAVLINK_MSG_ID_PARAM_SET: self._read_parameter,
            dialect.MAVLINK_MSG_ID_MISSION_REQUEST_LIST: self._mission_list,
            dialect.MAVLINK_MSG_ID_MISSION_REQUEST: self._no_item,
            dialect.MAVLINK_MSG_ID_MISSION_REQUEST_INT: self._no_item,
            dialect.MAVLINK_MSG_ID_MISSION_ITEM: self._no_item,
            dialect.MAVLINK_MSG_ID_MISSION_ITEM_INT: self._no_item,
            dialect.MAVLINK_MSG_ID_MISSION_COUNT: self._mission_count,
            dialect.MAVLINK_MSG_ID_MISSION_CLEAR_ALL: lambda packet: [_mission_ack(packet, 0)],
            dialect.MAVLINK_MSG_ID_FILE_TRANSFER_PROTOCOL: self._refuse_file,
        }

    def _parameter(self, _: Any) -> list[Any]:
        kind = dialect.MAV_PARAM_TYPE_INT16
        return [dialect.MAVLink_param_value_message(PARAMETER, float(self._system), kind, 1, 0)]

    def _read_parameter(self, packet: Any) -> list[Any]:
        """Return the parameter if it is requested, by name or by index."""
        named = str(packet.param_id).encode("ascii", "replace") == PARAMETER
        return self._parameter(packet) if named or getattr(packet, "param_index", -1) == 0 else []

    def _mission_list(self, packet: Any) -> list[Any]:
        return [dialect.MAVLink_mission_count_message(*_sender(packet), 0, packet.mission_type)]

    def _mission_count(self, packet: Any) -> list[Any]:
        result = dialect.MAV_MISSION_NO_SPACE if packet.count else dialect.MAV_MISSION_ACCEPTED
        return [_mission_ack(packet, result)]

    def _no_item(self, packet: Any) -> list[Any]:
        return [_mission_ack(packet, dialect.MAV_MISSION_INVALID_SEQUENCE)]

    def _refuse_file(self, packet: Any) -> list[Any]:
        data = bytes(packet.payload)
        if data[3] in FTP_REPLIES:
            return []
        sequence = int.from_bytes(data[:2], "little") + 1 & 0xFFFF
        head = sequence.to_bytes(2, "little") + bytes((data[2], FTP_NAK, 1, data[3], 0, 0)) + data[8:12]
        payload = (head + bytes((FTP_UNKNOWN,))).ljust(FTP_PAYLOAD, b"\0")
        return [dialect.MAVLink_file_transfer_protocol_message(0, *_sender(packet), list(payload))]


def _mission_ack(packet: Any, result: int) -> Any:
    return dialect.MAVLink_mission_ack_message(*_sender(packet), result, packet.mission_type)


def _sender(packet: Any) -> tuple[int, int]:
    return packet.get_srcSystem(), packet.get_srcComponent()
