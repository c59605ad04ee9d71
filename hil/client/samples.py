"""Samples of the Python interface: the sensors' own records, each with its age.

Vectors are along FRD or NED and in SI units, as the records say (sim.sensors.samples, sim.sensors.extra_samples).
`time_ns` is ns since 1970 by the vehicle's clock.
"""

from math import asin, atan2, hypot
from typing import Any

from hil.autonomy.control.controller import clamp, down_in_body, heading_of
from hil.client.client import Stamped
from hil.common.clock import NS_PER_S, now_ns
from hil.common.vectors import Vector3
from hil.ros.dvl import AltitudeSample
from hil.ros.topics import first_of
from sim.sensors import extra_samples as extra
from sim.sensors.samples import DvlSample, ImuSample, OdometrySample, PressureSample


class Aged:
    """Fields added to every record."""

    sent_ns = 0  # when it was sent, by this machine's monotonic clock

    @property
    def age(self) -> float:
        """Seconds since it was sent."""
        return (now_ns() - self.sent_ns) / NS_PER_S


class State(OdometrySample, Aged):
    """Position, attitude and motion: `position` m NED, `orientation` (w, x, y, z) FRD to NED, `nu` along FRD."""

    @property
    def depth(self) -> float:
        """Metres below the surface."""
        return self.position[2]

    @property
    def heading(self) -> float:
        """Radians from north, clockwise seen from above, -pi to pi."""
        return heading_of(self.orientation)

    @property
    def roll(self) -> float:
        """Radians, positive with starboard down."""
        down = down_in_body(self.orientation)
        return atan2(down[1], down[2])

    @property
    def pitch(self) -> float:
        """Radians, positive with the bow up."""
        return -asin(clamp(down_in_body(self.orientation)[0], 1.0))

    @property
    def velocity(self) -> Vector3:
        """Surge, sway and heave over ground, m/s along FRD."""
        return self.nu[:3]

    @property
    def angular_velocity(self) -> Vector3:
        """p, q and r, rad/s about FRD."""
        return self.nu[3:]

    @property
    def speed(self) -> float:
        """Speed over ground, m/s."""
        return hypot(*self.nu[:3])


class Imu(ImuSample, Aged):
    """Attitude, turn rate (rad/s) and specific force (m/s²)."""


class Dvl(DvlSample, Aged):
    """Velocity (m/s, FRD) and distance to the seabed (m)."""


class Pressure(PressureSample, Aged):
    """Absolute pressure (Pa)."""


class Distance(extra.RangeSample, Aged):
    """A distance (m) and the range limits of the device."""


class Altitude(AltitudeSample, Aged):
    """The distance to the seabed (m), measured by the DVL."""


class Field(extra.FieldSample, Aged):
    """Magnetic flux density (T)."""


class Current(extra.VelocitySample, Aged):
    """Velocity of the water relative to the vehicle (m/s)."""


class Fix(extra.FixSample, Aged):
    """Latitude and longitude (degrees) at the surface."""


class Position(extra.PositionSample, Aged):
    """A position (m, NED) with its covariance (m²)."""


class Battery(extra.BatterySample, Aged):
    """Voltage (V), current (A) and charge (Ah)."""


class Scan(extra.LaserSample, Aged):
    """Distances (m) over a sector of angles."""

    @property
    def angles(self) -> list[float]:
        """The angle (rad) of each distance."""
        return [self.angle_min + number * self.angle_increment for number in range(len(self.ranges))]


class Flag(extra.FlagSample, Aged):
    """A switch; true when on. Its message has no time (`time_ns` is 0)."""

    def __bool__(self) -> bool:
        return self.on


KINDS: dict[str, type[Any]] = {
    "odom": State, "ground_truth": State, "imu": Imu, "ahrs": Imu, "dvl": Dvl, "dvl_twist": Dvl, "dvl_water": Dvl,
    "pressure": Pressure, "altitude": Altitude, "altimeter": Distance, "echosounder": Distance, "magnetometer": Field,
    "current_meter": Current, "gps": Fix, "usbl": Position, "battery": Battery, "laser": Scan, "profiler": Scan,
    "scanning_sonar": Scan, "contact": Flag, "leak": Flag,
}  # fmt: skip
_others: dict[str, type[Any]] = {}  # types made for sensors outside the table


def aged(topic: str, stamped: Stamped) -> Any:
    """Return a topic's message as a record with an age; a message that is no record is returned as `stamped`."""
    value = stamped.value
    if isinstance(value, bool):
        value = 0, value
    if not isinstance(value, tuple):
        return stamped
    kind = KINDS.get(first_of(topic)) or _others.get(topic)
    if kind is None:
        if not hasattr(value, "_fields"):
            return stamped
        kind = _others[topic] = type(type(value).__name__, (type(value), Aged), {})
    made = kind(*value)
    made.sent_ns = stamped.sent_ns
    return made
