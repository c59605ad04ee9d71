"""Mounting of a sensor in the vehicle, and the keys that all sensors share."""

from collections.abc import Sequence
from math import pi
from random import Random
from typing import Annotated, NamedTuple

from hil.common.schema import Range
from hil.common.vectors import Quaternion, Vector3
from sim.dynamics import State
from sim.rotations import down_axis, from_euler, integrate, multiply, rotate, to_euler
from sim.vehicle.vehicle import Point

Angle = Annotated[float, Range(-2.0 * pi, 2.0 * pi, "rad")]


class Mounting(NamedTuple):
    """Keys that every sensor has besides its own.

    `position` in m from the body origin along the body axes; `orientation` the roll, pitch and yaw (rad) of the
    sensor's axes in the body's; `latency` s from measuring to delivering; `drop_out` the share of samples
    that is lost, independently of each other, from `drop_out_from` to `drop_out_until` (s of simulation time).
    `misalignment`: sd (rad) of an unknown turn about each axis, drawn when the run starts; `jitter`: longest further
    delay (s) of a sample, evenly distributed.
    """

    position: Point = (0.0, 0.0, 0.0)
    orientation: tuple[Angle, Angle, Angle] = (0.0, 0.0, 0.0)
    latency: Annotated[float, Range(0.0, 10.0, "s")] = 0.0
    drop_out: Annotated[float, Range(0.0, 1.0)] = 0.0
    drop_out_from: Annotated[float, Range(0.0, 1e9, "s")] = 0.0
    drop_out_until: Annotated[float, Range(0.0, 1e9, "s")] = 1e9
    misalignment: Annotated[float, Range(0.0, 0.5, "rad")] = 0.0
    jitter: Annotated[float, Range(0.0, 10.0, "s")] = 0.0

    @property
    def is_turned(self) -> bool:
        """True if the sensor's axes are not the vehicle's."""
        return any(self.orientation)

    def tilted(self, angle: float) -> "Mounting":
        """Return the mounting with the sensor turned up by an angle (rad) about its y axis."""
        roll, pitch, yaw = self.orientation
        return self._replace(orientation=(roll, pitch + angle, yaw)) if angle else self

    def misaligned(self, random: Random) -> "Mounting":
        """Return the mounting as it is in truth, with a turn drawn from `random`."""
        turn = [random.gauss(0.0, self.misalignment) for _ in range(3)]
        return self._replace(orientation=to_euler(integrate(self.quaternion, turn, 1.0)))

    @property
    def quaternion(self) -> Quaternion:
        """Quaternion from the sensor's axes to the body's."""
        return from_euler(*self.orientation)

    def attitude(self, state: State) -> Quaternion:
        """Return the quaternion from the sensor's axes to the world's."""
        return multiply(state.quaternion, self.quaternion)

    def world_position(self, state: State) -> Vector3:
        """Return the position of the sensor, NED in m."""
        north, east, down = state.position
        x, y, z = rotate(state.quaternion, self.position)
        return north + x, east + y, down + z

    def depth(self, state: State) -> float:
        """Return the depth of the sensor in m."""
        x, y, z = self.position
        down_x, down_y, down_z = down_axis(state.quaternion)
        return state.position[2] + (down_x * x + down_y * y + down_z * z)

    def velocity(self, nu: Sequence[float]) -> Vector3:
        """Return the velocity (m/s, body axes) at the sensor's position when the vehicle moves with `nu`."""
        u, v, w, p, q, r = nu
        x, y, z = self.position
        return u + q * z - r * y, v + r * x - p * z, w + p * y - q * x
