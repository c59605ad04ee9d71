"""The requests of QGroundControl when it connects, in its order, with the answers that it needs to continue.

Read in its sources of 2025 (mavlink/qgroundcontrol): Vehicle/InitialConnectStateMachine, Vehicle/StandardModes,
FactSystem/ParameterManager, MissionManager/PlanManager, FirmwarePlugin/APM.
"""

import struct
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as dialect

from tests.support.clients.mavlink_ground import Ground

AUTOPILOT = dialect.MAV_COMP_ID_AUTOPILOT1
STREAMS = {  # APMFirmwarePlugin::initializeStreamRates: MAV_DATA_STREAM -> Hz
    dialect.MAV_DATA_STREAM_RAW_SENSORS: 2, dialect.MAV_DATA_STREAM_EXTENDED_STATUS: 2,
    dialect.MAV_DATA_STREAM_RC_CHANNELS: 2, dialect.MAV_DATA_STREAM_POSITION: 3, dialect.MAV_DATA_STREAM_EXTRA1: 10,
    dialect.MAV_DATA_STREAM_EXTRA2: 10, dialect.MAV_DATA_STREAM_EXTRA3: 3,
}  # fmt: skip
WIDTHS = {1: "<b", 2: "<h", 3: "<i", 4: "<f"}


class Station(Ground):
    """A ground station that connects as QGroundControl does; each step fails where QGroundControl would stall."""

    def command_to(self, component: int, command: int, *params: float) -> int:
        """Return the MAV_RESULT of a command; the answer must come from that component and be addressed to us."""
        values = [*params, *[0.0] * (7 - len(params))]
        self.send.command_long_send(1, component, command, 0, *values)

        def is_answer(ack: Any) -> bool:
            return bool(
                ack.command == command and ack.get_srcComponent() == component and ack.target_system in (0, 255)
            )

        return int(self.wait("COMMAND_ACK", is_answer).result)

    def start_streams(self) -> None:
        for stream, rate in STREAMS.items():
            self.send.request_data_stream_send(1, AUTOPILOT, stream, rate, 1)
        for number in (dialect.MAVLINK_MSG_ID_HOME_POSITION, dialect.MAVLINK_MSG_ID_EXTENDED_SYS_STATE):
            assert self.command_to(AUTOPILOT, dialect.MAV_CMD_SET_MESSAGE_INTERVAL, number, 1e6) == 0

    def version(self) -> Any:
        """Vehicle::requestMessage: the message after the request for it was accepted."""
        number = dialect.MAVLINK_MSG_ID_AUTOPILOT_VERSION
        assert self.command_to(AUTOPILOT, dialect.MAV_CMD_REQUEST_MESSAGE, number) == 0
        return self.wait("AUTOPILOT_VERSION")

    def plan(self, kind: int) -> list[Any]:
        """PlanManager::loadFromVehicle: all items of a mission, of a fence or of rally points."""
        self.send.mission_request_list_send(1, AUTOPILOT, kind)
        count = self.wait("MISSION_COUNT", lambda count: count.mission_type == kind).count
        items = []
        for index in range(count):
            self.send.mission_request_int_send(1, AUTOPILOT, index, kind)
            items.append(self.wait("MISSION_ITEM_INT"))
            assert items[-1].seq == index
        self.send.mission_ack_send(1, AUTOPILOT, dialect.MAV_MISSION_ACCEPTED, kind)
        return items


def unpack(content: bytes) -> dict[str, float]:
    """ParameterManager::_parseParamFile: names and values; it refuses a file whose numbers do not fit."""
    magic, count, total = struct.unpack_from("<HHH", content)
    assert magic in (0x671B, 0x671C)
    assert count == total
    parameters: dict[str, float] = {}
    offset, last = 6, ""
    while offset < len(content):
        if not content[offset]:  # padding
            offset += 1
            continue
        kind, lengths = content[offset] & 0x0F, content[offset + 1]
        assert not content[offset] >> 4, "no default follows where none was promised"
        suffix_length = (lengths >> 4) + 1
        last = last[: lengths & 0x0F] + content[offset + 2 : offset + 2 + suffix_length].decode()
        assert 0 < len(last) <= 16
        (parameters[last],) = struct.unpack_from(WIDTHS[kind], content, offset + 2 + suffix_length)
        offset += 2 + suffix_length + struct.calcsize(WIDTHS[kind])
    assert len(parameters) == count
    return parameters
