"""Rates at which one ground station gets messages, and which are due.

A ground station asks for a rate a message (SET_MESSAGE_INTERVAL) or for groups of messages (REQUEST_DATA_STREAM).
Until it does, it has `DEFAULT_HZ`.
"""

from collections.abc import Mapping

from pymavlink.dialects.v20 import ardupilotmega as dialect

from hil.common.clock import NS_PER_S, NS_PER_US
from hil.gateways.mavlink import newer_messages as newer

MAX_HZ = 50.0
MIN_HZ = 0.05
OFF = -1  # us, of a message that is not sent

HEARTBEAT = dialect.MAVLINK_MSG_ID_HEARTBEAT
SYS_STATUS = dialect.MAVLINK_MSG_ID_SYS_STATUS
SYSTEM_TIME = dialect.MAVLINK_MSG_ID_SYSTEM_TIME
GPS_RAW_INT = dialect.MAVLINK_MSG_ID_GPS_RAW_INT
ATTITUDE = dialect.MAVLINK_MSG_ID_ATTITUDE
ATTITUDE_QUATERNION = dialect.MAVLINK_MSG_ID_ATTITUDE_QUATERNION
LOCAL_POSITION_NED = dialect.MAVLINK_MSG_ID_LOCAL_POSITION_NED
GLOBAL_POSITION_INT = dialect.MAVLINK_MSG_ID_GLOBAL_POSITION_INT
SERVO_OUTPUT_RAW = dialect.MAVLINK_MSG_ID_SERVO_OUTPUT_RAW
MISSION_CURRENT = dialect.MAVLINK_MSG_ID_MISSION_CURRENT
NAV_CONTROLLER_OUTPUT = dialect.MAVLINK_MSG_ID_NAV_CONTROLLER_OUTPUT
VFR_HUD = dialect.MAVLINK_MSG_ID_VFR_HUD
SCALED_PRESSURE2 = dialect.MAVLINK_MSG_ID_SCALED_PRESSURE2
BATTERY_STATUS = dialect.MAVLINK_MSG_ID_BATTERY_STATUS
HOME_POSITION = dialect.MAVLINK_MSG_ID_HOME_POSITION
EKF_STATUS_REPORT = dialect.MAVLINK_MSG_ID_EKF_STATUS_REPORT
DISTANCE_SENSOR = dialect.MAVLINK_MSG_ID_DISTANCE_SENSOR
EXTENDED_SYS_STATE = dialect.MAVLINK_MSG_ID_EXTENDED_SYS_STATE
ESC_TELEMETRY = dialect.MAVLINK_MSG_ID_ESC_TELEMETRY_1_TO_4
ESC_STATUS = newer.EscStatus.id
CURRENT_MODE = newer.CurrentMode.id
MODES_MONITOR = newer.AvailableModesMonitor.id

DEFAULT_HZ: dict[int, float] = {
    HEARTBEAT: 1.0, SYS_STATUS: 1.0, SYSTEM_TIME: 1.0, GPS_RAW_INT: 2.0, ATTITUDE: 10.0, LOCAL_POSITION_NED: 5.0,
    GLOBAL_POSITION_INT: 4.0, SERVO_OUTPUT_RAW: 4.0, MISSION_CURRENT: 1.0, VFR_HUD: 4.0, SCALED_PRESSURE2: 2.0,
    BATTERY_STATUS: 1.0, HOME_POSITION: 0.2, EKF_STATUS_REPORT: 1.0, DISTANCE_SENSOR: 4.0, EXTENDED_SYS_STATE: 1.0,
    ESC_STATUS: 1.0, ESC_TELEMETRY: 1.0, CURRENT_MODE: 0.5, MODES_MONITOR: 0.3, NAV_CONTROLLER_OUTPUT: 1.0,
}  # fmt: skip
STREAMED = frozenset(DEFAULT_HZ) | {ATTITUDE_QUATERNION}

# MAV_DATA_STREAM -> the messages of the group, as ArduPilot has them as far as they exist here
GROUPS: dict[int, tuple[int, ...]] = {
    dialect.MAV_DATA_STREAM_RAW_SENSORS: (SCALED_PRESSURE2,),
    dialect.MAV_DATA_STREAM_EXTENDED_STATUS: (SYS_STATUS, GPS_RAW_INT, MISSION_CURRENT, NAV_CONTROLLER_OUTPUT),
    dialect.MAV_DATA_STREAM_RC_CHANNELS: (SERVO_OUTPUT_RAW,),
    dialect.MAV_DATA_STREAM_POSITION: (LOCAL_POSITION_NED, GLOBAL_POSITION_INT),
    dialect.MAV_DATA_STREAM_EXTRA1: (ATTITUDE,),
    dialect.MAV_DATA_STREAM_EXTRA2: (VFR_HUD,),
    dialect.MAV_DATA_STREAM_EXTRA3: (
        BATTERY_STATUS, DISTANCE_SENSOR, EKF_STATUS_REPORT, ESC_STATUS, ESC_TELEMETRY, SYSTEM_TIME,
    ),
}  # fmt: skip
ALL_GROUPS = tuple(number for group in GROUPS.values() for number in group)


class StreamRates:
    """Periods (ns) of one ground station's messages by their ids, 0 for those that are off."""

    def __init__(self, rates: Mapping[int, float] = DEFAULT_HZ) -> None:
        self._default = {number: round(NS_PER_S / rate) for number, rate in rates.items()}
        self._periods = dict(self._default)
        self._due: dict[int, int] = {}

    def set_interval(self, number: int, interval_us: float) -> bool:
        """Set the interval of a message: -1 turns it off, 0 is the default; return whether there is such a stream."""
        if number not in STREAMED or not (interval_us == interval_us and abs(interval_us) < 1e12):
            return False
        if interval_us < 0:
            self._periods[number] = 0
        elif interval_us == 0:
            self._periods[number] = self._default.get(number, 0)
        else:
            self._set_rate(number, 1e6 / interval_us)
        self._due.pop(number, None)
        return True

    def interval_us(self, number: int) -> int:
        """Return the interval of a message: -1 if it is off, 0 if there is no such stream."""
        if number not in STREAMED:
            return 0
        period = self._periods.get(number, 0)
        return period // NS_PER_US if period else OFF

    def set_group(self, group: int, rate_hz: int, start: bool) -> bool:
        """Set the rate of a group of messages (MAV_DATA_STREAM); return whether there is such a group."""
        numbers = ALL_GROUPS if group == dialect.MAV_DATA_STREAM_ALL else GROUPS.get(group, ())
        for number in numbers:
            if start and rate_hz:
                self._set_rate(number, rate_hz)
            else:
                self._periods[number] = 0
            self._due.pop(number, None)
        return bool(numbers)

    def due(self, now: int) -> list[int]:
        """Return the ids of the messages that are due; one that is late is sent once."""
        numbers = []
        for number, period in self._periods.items():
            when = self._due.get(number, 0)
            if period and now >= when:
                numbers.append(number)
                self._due[number] = when + period if now - when < period else now + period
        return numbers

    def _set_rate(self, number: int, rate_hz: float) -> None:
        self._periods[number] = round(NS_PER_S / min(max(rate_hz, MIN_HZ), MAX_HZ))
