"""Combine the commands of several topics into one setpoint.

Loaded when the first command arrives on a topic other than cmd_vel. Earlier velocities are not known here: a velocity
takes effect with its next message. cmd_vel_stamped means the same as cmd_vel. Depth and heading setpoints apply beside
a velocity: depth replaces its heave if that is zero, heading replaces its turn rate if that is zero. Both have to be
repeated. Pose, wrench and thrusts combine with nothing: of these and of velocities the newest command counts.
"""

from typing import Any

from hil.autonomy.control.controller import VelocityCommand
from hil.ros import encoders as ros
from hil.slave.setpoints import PoseSetpoint, Setpoint, ThrustSetpoint, WrenchSetpoint

STANDSTILL = VelocityCommand()


class CommandMux:
    """Decode the commands of all topics for a vehicle with `thrusters` thrusters, and combine them.

    A velocity, depth or heading expires `hold_ns` after its last message. `fault` describes the last command that was
    decoded but cannot be carried out.
    """

    def __init__(self, thrusters: int, hold_ns: int) -> None:
        self._thrusters = thrusters
        self._hold_ns = hold_ns
        self._received: dict[str, tuple[Any, int]] = {}

    def decode(self, topic: str, payload: bytes) -> Any:
        """Return the decoded message; None if it is malformed or does not fit the vehicle."""
        self.fault = ""
        decode = ros.decoder(topic)
        value = decode(payload) if decode else None
        if topic == "cmd_thrusters" and value is not None and len(value) != self._thrusters:
            self.fault = f"cmd_thrusters: {len(value)} thrusts for {self._thrusters} thrusters"
            return None
        return value

    def combine(self, topic: str, value: Any, now: int) -> Setpoint:
        """Return the vehicle's setpoint after a message on `topic`, received at `now` (monotonic ns)."""
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
        """Remove all setpoints, because another master has become active."""
        self._received.clear()

    def _recent(self, topic: str, now: int, otherwise: Any = None) -> Any:
        value, received_ns = self._received.get(topic, (otherwise, 0))
        return value if now - received_ns <= self._hold_ns else otherwise
