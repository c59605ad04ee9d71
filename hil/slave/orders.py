"""Commands beside cmd_vel: how those of several topics combine, and what each makes of the thrusters.

Loaded when the first of them comes; a velocity from before counts when it is repeated. Depth and heading are held
beside cmd_vel: the one in place of its heave, the other in place of its turn rate, wherever that is zero, and as long
as they are repeated. Pose, wrench and thrusts stand alone: of these and of velocities the newest counts.
"""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

from hil.autonomy.control import VelocityCommand, heading_of
from hil.autonomy.position import approach
from hil.transport import ros
from hil.transport.ros_commands import PoseCommand

if TYPE_CHECKING:
    from hil.slave.inbox import Command
    from hil.slave.pilot import Pilot

STANDSTILL = VelocityCommand()


class PoseOrder(NamedTuple):
    """Go to a pose and stay."""

    pose: PoseCommand

    def drive(self, pilot: "Pilot", dt: float) -> tuple[int, ...]:
        """The pulses (us) for the next `dt` s."""
        own = heading_of(pilot.navigation.orientation)
        return pilot.push(pilot.steer(approach(*self.pose, pilot.position, own), dt))


class WrenchOrder(NamedTuple):
    """Push with X Y Z (N) and K M N (N m) along FRD, as far as the thrusters can."""

    wrench: tuple[float, float, float, float, float, float]

    def drive(self, pilot: "Pilot", _dt: float) -> tuple[int, ...]:
        """The pulses (us)."""
        pilot.reset()  # no loop is closed: there is nothing to integrate
        return pilot.push(self.wrench)


class ThrustOrder(NamedTuple):
    """Let each thruster push with so many N, as far as it can."""

    thrusts: Sequence[float]

    def drive(self, pilot: "Pilot", _dt: float) -> tuple[int, ...]:
        """The pulses (us)."""
        pilot.reset()
        return pilot.pulses(self.thrusts)


class Orders:
    """Reads commands of all topics for a vehicle of so many thrusters, and combines them.

    A depth or heading is forgotten `hold_ns` after it was last heard. `fault` says what was wrong with the last
    command that could be read and yet not be obeyed.
    """

    def __init__(self, thrusters: int, hold_ns: int) -> None:
        self._thrusters = thrusters
        self._hold_ns = hold_ns
        self._heard: dict[str, tuple[Any, int]] = {}
        self.fault = ""

    def read(self, topic: str, payload: bytes) -> Any:
        """What a message says; None if that cannot be obeyed."""
        decode = ros.decoder(topic)
        value = decode(payload) if decode else None
        if topic == "cmd_thrusters" and value is not None and len(value) != self._thrusters:
            self.fault = f"cmd_thrusters: {len(value)} thrusts for {self._thrusters} thrusters"
            return None
        return value

    def combine(self, topic: str, value: Any, now: int) -> "Command":
        """The command that the vehicle obeys after what was heard on a topic `now` (monotonic ns)."""
        if topic == "cmd_pose":
            return PoseOrder(value)
        if topic == "cmd_wrench":
            return WrenchOrder(value)
        if topic == "cmd_thrusters":
            return ThrustOrder(value)
        self._heard[topic] = value, now
        velocity: VelocityCommand = self._recent("cmd_vel", now, STANDSTILL)
        depth = None if velocity.heave else self._recent("cmd_depth", now)
        heading = None if velocity.yaw_rate else self._recent("cmd_heading", now)
        return velocity._replace(depth=depth, heading=heading)

    def forget(self) -> None:
        """Hold nothing any more: another commands."""
        self._heard.clear()

    def _recent(self, topic: str, now: int, otherwise: Any = None) -> Any:
        value, heard = self._heard.get(topic, (otherwise, 0))
        return value if now - heard <= self._hold_ns else otherwise
