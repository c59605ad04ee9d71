"""Combine the commands of several topics into one setpoint.

Loaded when the first of them comes; a velocity from before counts when it is repeated. cmd_vel_stamped is the same as
cmd_vel. Depth and heading are held beside it: the one in place of its heave, the other in place of its turn rate,
wherever that is zero, and as long as they are repeated. Pose, wrench and thrusts stand alone: of these and of
velocities the newest counts.
"""

from typing import Any

from hil.autonomy.control.controller import VelocityCommand
from hil.ros import encoders as ros
from hil.slave.setpoints import PoseSetpoint, Setpoint, ThrustSetpoint, WrenchSetpoint

STANDSTILL = VelocityCommand()


class CommandMux:
    """Decode commands of all topics for a vehicle with so many thrusters, and combine them.

    A depth or heading is forgotten `hold_ns` after it was last heard. `fault` says what was wrong with the last
    command that could be read and yet not be obeyed.
    """

    def __init__(self, thrusters: int, hold_ns: int) -> None:
        self._thrusters = thrusters
        self._hold_ns = hold_ns
        self._received: dict[str, tuple[Any, int]] = {}
        self.fault = ""

    def read(self, topic: str, payload: bytes) -> Any:
        """Return the decoded message; None if it cannot be obeyed."""
        decode = ros.decoder(topic)
        value = decode(payload) if decode else None
        if topic == "cmd_thrusters" and value is not None and len(value) != self._thrusters:
            self.fault = f"cmd_thrusters: {len(value)} thrusts for {self._thrusters} thrusters"
            return None
        return value

    def combine(self, topic: str, value: Any, now: int) -> Setpoint:
        """Return the vehicle's command after a message on a topic at `now` (monotonic ns)."""
        if topic == "cmd_pose":
            return PoseSetpoint(value)
        if topic == "cmd_wrench":
            return WrenchSetpoint(value)
        if topic == "cmd_thrusters":
            return ThrustSetpoint(value)
        self._received["cmd_vel" if topic == "cmd_vel_stamped" else topic] = value, now
        velocity: VelocityCommand = self._recent("cmd_vel", now, STANDSTILL)
        depth = None if velocity.heave else self._recent("cmd_depth", now)
        heading = None if velocity.yaw_rate else self._recent("cmd_heading", now)
        return velocity._replace(depth=depth, heading=heading)

    def clear(self) -> None:
        """Forget all set points: another master commands."""
        self._received.clear()

    def _recent(self, topic: str, now: int, otherwise: Any = None) -> Any:
        value, received_ns = self._received.get(topic, (otherwise, 0))
        return value if now - received_ns <= self._hold_ns else otherwise
