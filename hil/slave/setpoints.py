"""Setpoints other than a velocity: records that the command mux makes and the pilot applies."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

from hil.autonomy.control.controller import VelocityCommand

if TYPE_CHECKING:
    from hil.ros.commands import PoseCommand


class PoseSetpoint(NamedTuple):
    """A pose (NED) to reach and hold."""

    pose: "PoseCommand"

    @property
    def depth(self) -> float:
        """The depth of the pose, m."""
        return self.pose.position[2]


class WrenchSetpoint(NamedTuple):
    """A wrench X Y Z (N), K M N (N m) along FRD; limited to what the thrusters can give."""

    wrench: tuple[float, float, float, float, float, float]
    depth: None = None


class ThrustSetpoint(NamedTuple):
    """One thrust (N) for each thruster, limited to what it can give."""

    thrusts: Sequence[float]
    depth: None = None


Setpoint = VelocityCommand | PoseSetpoint | WrenchSetpoint | ThrustSetpoint
