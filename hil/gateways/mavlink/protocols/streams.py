"""Rates at which one ground station gets messages, and which are due.

A ground station asks for a rate a message (SET_MESSAGE_INTERVAL) or for groups of messages (REQUEST_DATA_STREAM).
Until it does, it has `DEFAULT_HZ`.
"""

from pymavlink.dialects.v20 import ardupilotmega as dialect

from hil.common.clock import NS_PER_S, NS_PER_US

MAX_HZ = 50.0
MIN_HZ = 0.05
OFF = -1  # us, of a message that is not sent

NONE = 0  # group of what REQUEST_DATA_STREAM does not change
RAW_SENSORS, EXTENDED_STATUS, RC_CHANNELS, POSITION, EXTRA1, EXTRA2, EXTRA3 = (
    dialect.MAV_DATA_STREAM_RAW_SENSORS, dialect.MAV_DATA_STREAM_EXTENDED_STATUS, dialect.MAV_DATA_STREAM_RC_CHANNELS,
    dialect.MAV_DATA_STREAM_POSITION, dialect.MAV_DATA_STREAM_EXTRA1, dialect.MAV_DATA_STREAM_EXTRA2,
    dialect.MAV_DATA_STREAM_EXTRA3,
)  # fmt: skip
# Message -> its rate (Hz) until a ground station requests another one, and its group. Groups and rates are ArduSub's.
STREAMS: dict[str, tuple[float, int]] = {
    "HEARTBEAT": (1.0, NONE), "HOME_POSITION": (0.1, NONE), "GPS_GLOBAL_ORIGIN": (0.1, NONE),
    "EXTENDED_SYS_STATE": (0.0, NONE),
    "RAW_IMU": (4.0, RAW_SENSORS), "SCALED_IMU2": (4.0, RAW_SENSORS), "SCALED_IMU3": (4.0, RAW_SENSORS),
    "SCALED_PRESSURE": (4.0, RAW_SENSORS), "SCALED_PRESSURE2": (4.0, RAW_SENSORS),
    "SYS_STATUS": (4.0, EXTENDED_STATUS), "POWER_STATUS": (4.0, EXTENDED_STATUS),
    "MISSION_CURRENT": (4.0, EXTENDED_STATUS), "GPS_RAW_INT": (4.0, EXTENDED_STATUS),
    "NAV_CONTROLLER_OUTPUT": (4.0, EXTENDED_STATUS), "NAMED_VALUE_FLOAT": (4.0, EXTENDED_STATUS),
    "SERVO_OUTPUT_RAW": (4.0, RC_CHANNELS), "RC_CHANNELS": (4.0, RC_CHANNELS),
    "LOCAL_POSITION_NED": (4.0, POSITION), "GLOBAL_POSITION_INT": (4.0, POSITION),
    "ATTITUDE": (10.0, EXTRA1), "AHRS2": (4.0, EXTRA1), "VFR_HUD": (4.0, EXTRA2),
    "AHRS": (4.0, EXTRA3), "SYSTEM_TIME": (4.0, EXTRA3), "RANGEFINDER": (4.0, EXTRA3),
    "DISTANCE_SENSOR": (4.0, EXTRA3), "BATTERY_STATUS": (4.0, EXTRA3), "EKF_STATUS_REPORT": (4.0, EXTRA3),
    "VIBRATION": (4.0, EXTRA3), "GIMBAL_DEVICE_ATTITUDE_STATUS": (4.0, EXTRA3),
    "ESC_TELEMETRY_1_TO_4": (1.0, EXTRA3),
    "ATTITUDE_QUATERNION": (0.0, NONE), "SCALED_IMU": (0.0, NONE), "HIGHRES_IMU": (0.0, NONE),
    "ODOMETRY": (0.0, NONE), "ALTITUDE": (0.0, NONE),
}  # fmt: skip


def number_of(name: str) -> int:
    """Return the id of a message."""
    return int(getattr(dialect, f"MAVLINK_MSG_ID_{name}"))


HEARTBEAT, MISSION_CURRENT = number_of("HEARTBEAT"), number_of("MISSION_CURRENT")
DEFAULT_HZ = {number_of(name): rate for name, (rate, _) in STREAMS.items()}


class StreamRates:
    """Periods (ns) of one ground station's messages by their ids, 0 for those that are off.

    `most_hz` limits the default rates: a slow line does not carry all messages at theirs.
    """

    def __init__(self, most_hz: float = MAX_HZ) -> None:
        self._default = {
            number: round(NS_PER_S / min(rate, most_hz)) if rate else 0 for number, rate in DEFAULT_HZ.items()
        }
        self._periods = dict(self._default)
        self._due: dict[int, int] = {}

    def set_interval(self, number: int, interval_us: float) -> bool:
        """Set the interval of a message: -1 turns it off, 0 is the default; return whether there is such a stream."""
        if number not in self._default or not (interval_us == interval_us and abs(interval_us) < 1e12):
            return False
        if interval_us < 0:
            self._periods[number] = 0
        elif interval_us == 0:
            self._periods[number] = self._default[number]
        else:
            self._set_rate(number, 1e6 / interval_us)
        self._due.pop(number, None)
        return True

    def interval_us(self, number: int) -> int:
        """Return the interval of a message: -1 if it is off, 0 if there is no such stream."""
        if number not in self._default:
            return 0
        period = self._periods[number]
        return period // NS_PER_US if period else OFF

    def set_group(self, group: int, rate_hz: int, start: bool) -> bool:
        """Set the rate of a group of messages (MAV_DATA_STREAM); return whether there is such a group."""
        is_all = group == dialect.MAV_DATA_STREAM_ALL
        numbers = [number_of(name) for name, (_, of) in STREAMS.items() if of != NONE and (is_all or of == group)]
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
