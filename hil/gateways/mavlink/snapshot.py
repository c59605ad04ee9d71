"""State of the gateway's vehicle at one instant (`Snapshot`, `Context`), and the commands that it takes."""

from collections.abc import Mapping
from math import isfinite
from typing import NamedTuple

from hil.autonomy.control.controller import VelocityCommand
from hil.client.samples import State
from hil.common.clock import NS_PER_MS, NS_PER_US
from hil.common.vectors import Vector3
from hil.ros.commands import PoseCommand
from hil.ros.joints import MotorState
from sim.geodesy import TangentPlane
from sim.rotations import rotate
from sim.sensors.extra_samples import BatterySample, FixSample
from sim.sensors.samples import ImuSample


class ThrusterTest(NamedTuple):
    """The thrust (N) of one thruster, counted from 0; the others stand still."""

    thruster: int
    thrust: float


Wrench = tuple[float, float, float, float, float, float]
Command = VelocityCommand | PoseCommand | ThrusterTest | Wrench
NEUTRAL: Wrench = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


class Echo(NamedTuple):
    """A distance (m) below the vehicle, and the reach (m) of the device that measured it."""

    distance: float
    least: float
    most: float

    @property
    def is_valid(self) -> bool:
        """Whether there was an echo."""
        return isfinite(self.distance)


class Snapshot(NamedTuple):
    """Newest samples of the vehicle; None where it has no such sensor, or that is silent.

    `state` is the navigation solution (NED, FRD). `pulses` are in us, `motors` what the slave reports of each channel.
    `sensors` are the topics that it sends.
    """

    state: State
    battery: BatterySample | None = None
    pascal: float | None = None
    echo: Echo | None = None
    fix: FixSample | None = None
    leak: bool = False
    pulses: tuple[int, ...] = ()
    motors: tuple[MotorState, ...] = ()
    sensors: frozenset[str] = frozenset()
    slave_load: float = 0.0  # share of one processor
    link_silent: bool = False
    imu: ImuSample | None = None
    field: Vector3 | None = None  # T
    disarmed: bool = False  # the slave refuses all commands until it is armed

    @property
    def velocity_ned(self) -> Vector3:
        """Velocity over ground (m/s, NED)."""
        north, east, down = rotate(self.state.orientation, self.state.velocity)
        return north, east, down


class Origin(NamedTuple):
    """Origin of the NED frame: latitude and longitude in degrees; altitude of the surface in m."""

    latitude: float
    longitude: float
    altitude: float = 0.0


class Context(NamedTuple):
    """Values that messages need beside the snapshot: times (ns), home (m, NED), origin, setpoint, sticks, panel."""

    now: int  # since the gateway started
    wall_ns: int  # since 1970
    home: Vector3
    origin: Origin | None
    plane: TangentPlane | None
    ready: bool  # whether arming would be accepted
    target: Vector3 | None  # m, NED
    channels: tuple[int, ...] = ()  # pulses (us) of RC channels
    panel: Mapping[str, float] = {}  # values for the pilot, by their names in NAMED_VALUE_FLOAT
    outputs: Mapping[int, int] = {}  # pulses (us) of servo outputs that are no thrusters'
    tilt: float = 0.0  # of the camera, degrees, up is positive

    @property
    def boot_ms(self) -> int:
        """Time since the gateway started, ms in 32 bits."""
        return self.now // NS_PER_MS & 0xFFFF_FFFF

    @property
    def boot_us(self) -> int:
        """Time since the gateway started, us."""
        return self.now // NS_PER_US
