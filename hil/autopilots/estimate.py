"""Compare an autopilot's estimate, as it sends it by MAVLink, with the truth."""

from math import dist, nan, remainder, tau
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as dialect

from hil.autopilots.contract import EstimateError
from hil.common.vectors import Vector3
from sim.geodesy import TangentPlane
from sim.rotations import to_euler
from sim.sensors.samples import OdometrySample

INTERVAL_US = 50_000  # between two messages of the estimate
ATTITUDE, GLOBAL_POSITION, LOCAL_POSITION = (
    dialect.MAVLINK_MSG_ID_ATTITUDE, dialect.MAVLINK_MSG_ID_GLOBAL_POSITION_INT,
    dialect.MAVLINK_MSG_ID_LOCAL_POSITION_NED,
)  # fmt: skip


class EstimateReader:
    """Store the newest `error`, None until an attitude has come.

    `plane` is that of the world's origin; without it the autopilot's local position counts from `start` (m, NED).
    """

    def __init__(self, plane: TangentPlane | None, start: Vector3 = (0.0, 0.0, 0.0)) -> None:
        self.error: EstimateError | None = None
        self._plane, self._start = plane, start

    def requests(self, system: int) -> list[Any]:
        """Return the messages that ask the autopilot for its estimate; none once it has come."""
        wanted = (ATTITUDE, GLOBAL_POSITION if self._plane else LOCAL_POSITION) if self.error is None else ()
        command = dialect.MAV_CMD_SET_MESSAGE_INTERVAL
        return [
            dialect.MAVLink_command_long_message(system, 1, command, 0, message, INTERVAL_US, *[0.0] * 5)
            for message in wanted
        ]

    def take(self, message: Any, truth: OdometrySample) -> None:
        """Take one message, if it is one of the estimate."""
        kind = message.get_msgId()
        if kind == ATTITUDE:
            angles = message.roll, message.pitch, message.yaw
            errors = [remainder(a - b, tau) for a, b in zip(angles, to_euler(truth.orientation), strict=True)]
            self.error = EstimateError(errors[0], errors[1], errors[2], self.error.position if self.error else nan)
        elif self.error and self._plane and kind == GLOBAL_POSITION and (message.lat or message.lon):
            believed = self._plane.local(1e-7 * message.lat, 1e-7 * message.lon, 1e-3 * message.alt)
            self.error = self.error._replace(position=dist(believed, truth.position))
        elif self.error and not self._plane and kind == LOCAL_POSITION:
            north, east, down = self._start
            believed = north + message.x, east + message.y, down + message.z
            self.error = self.error._replace(position=dist(believed, truth.position))
