"""What the rules measure: a vehicle in its water, and how it moves in 10 s of simulated time."""

from functools import cached_property
from math import acos, cos, degrees, hypot, inf, pi, sqrt
from typing import Any, NamedTuple

from hil.autonomy.control.allocation import pseudo_inverse
from hil.autonomy.control.controller import VelocityCommand, gains_of, wrap
from hil.autonomy.control.fin_control import FinGains
from hil.common.errors import DivergenceError
from hil.common.schema import parse
from hil.master.manoeuvring import Manoeuvring
from hil.tuning.rig import DEEP, START_DEPTH, Rig
from sim.matrices import square
from sim.vehicle.hydrostatics import afloat
from sim.vehicle.terminal_speed import AxisCapability, axis_capabilities, equipment_drag
from sim.vehicle.thrusters.azimuth import with_turned
from sim.vehicle.thrusters.bank import wrench_matrix
from sim.vehicle.vehicle import Vehicle, displaced_volume, mass_matrix

SECONDS, HELD_S = 10.0, 3.0  # of each flight; at its end it has to hold depth and heading
TURN, SLOW_TURN_S = 0.8, 30.0  # rad, of a vehicle with fins; up to so long a turn by 90 degrees is awaited
TILT = 0.1  # rad, of roll and pitch at the start, so that an unstable vehicle leaves its equilibrium
LAKE, SEA = 998.0, 1028.0  # kg/m³
AFLOAT = 1.03  # buoyancy over weight, up to which a vehicle without vertical thrust dives by its fins
CRUISE, HURRY = 0.6, 0.5  # cruising speed as a share of the top speed, and at most (m/s) without fins


class Motion(NamedTuple):
    """Largest tilt (deg) and turn rate (deg/s) of a flight, and errors of depth (m) and heading (deg) at its end."""

    tilt: float
    rate: float
    depth: float
    heading: float


class Subject:
    """A vehicle with its `[control]` table in water of `density` kg/m³ under `gravity` m/s²; `name` is for errors.

    Without a `density` the water is the one between a lake's and the sea's in which it weighs least. It is to fly at
    `speed` m/s; without one, at a share of its top speed.
    """

    def __init__(
        self,
        vehicle: Vehicle,
        control: dict[str, Any],
        density: float | None = None,
        gravity: float = 9.80665,
        name: str = "",
        speed: float | None = None,
    ) -> None:
        self.vehicle, self.gravity = vehicle, gravity
        self.density = density or min(max(vehicle.mass / vehicle.volume, LAKE), SEA)
        self._control, self._name, self._speed = control, name or vehicle.name, speed
        self.weight = vehicle.mass * gravity
        self.volume = displaced_volume(vehicle, self.density)
        self.buoyancy_ratio = self.density * self.volume / vehicle.mass
        self.net_weight = self.weight * (1.0 - self.buoyancy_ratio)  # N, positive if it sinks

    @cached_property
    def capabilities(self) -> tuple[AxisCapability, ...]:
        """Forces and speeds along each axis."""
        vehicle = with_turned(self.vehicle)
        return axis_capabilities(vehicle, pseudo_inverse(wrench_matrix(vehicle))[0], self.density, self.gravity)

    @property
    def floats(self) -> bool:
        """True for a surface craft: its thrusters cannot hold it under water."""
        return self.buoyancy_ratio > AFLOAT and -self.net_weight > self.capabilities[2].force[0]

    @cached_property
    def inertia(self) -> list[float]:
        """Mass and inertia of each axis with added mass (kg, kg m²)."""
        matrix = mass_matrix(self.vehicle)
        return [matrix[axis][axis] for axis in range(6)]

    @cached_property
    def damping(self) -> list[tuple[float, float]]:
        """Linear and quadratic damping of each axis, with the drag of equipment."""
        linear, quadratic = (square(one, 6) for one in (self.vehicle.linear_damping, self.vehicle.quadratic_damping))
        drags = [equipment_drag(self.vehicle, self.density, axis) for axis in range(6)]
        return [(linear[i][i], quadratic[i][i] + drags[i]) for i in range(6)]

    @property
    def stability(self) -> float:
        """Height (m) of the centre of buoyancy, or of a surface craft's metacentre, above the centre of gravity.

        That of a surface craft is the lower one of roll and pitch, of the form of its hull.
        """
        vehicle = self.vehicle
        floating = afloat(vehicle, self.density, self.gravity) if self.floats else None
        if floating is None:
            return vehicle.center_of_gravity[2] - vehicle.center_of_buoyancy[2]
        return min(*floating.metacentres, vehicle.dimensions[2])

    @cached_property
    def turn_time(self) -> float:
        """Time (s) to turn by 90 degrees: from rest, with fins at cruising speed; 0 if nothing turns it.

        From rest it is the root of the squares of the time without damping and of that at the final rate.
        """
        if self.vehicle.fins:
            gains = gains_of(self._control, f"{self._name}: control")
            fins = parse(self._control.get("fins", {}), FinGains, f"{self._name}: control.fins")
            motion = Manoeuvring(self.vehicle, gains, fins, self.cruise, self.density, self.gravity)
            return 0.5 * pi * motion.turn_radius() / motion.speed
        yaw = self.capabilities[5]
        if not yaw.driven:
            return 0.0
        return hypot(sqrt(pi * self.inertia[5] / yaw.force[0]), 0.5 * pi / yaw.speed[0])

    @cached_property
    def adrift(self) -> Motion:
        """Motion without thrust."""
        return self._fly(SECONDS, None)

    @cached_property
    def controlled(self) -> Motion:
        """Motion under its own controller, which holds depth and heading, at cruising speed."""
        return self.fly(self.cruise)

    @property
    def cruise(self) -> float:
        """Speed (m/s) of its flight; 0 for a vehicle that cannot go ahead alone."""
        top, limit = self.capabilities[0].speed[0], self.vehicle.attitude_limit_speed or inf
        if self._speed is not None:
            return min(self._speed, top, limit)
        return CRUISE * top if self.vehicle.fins else min(CRUISE * top, HURRY, limit)

    def fly(self, speed: float) -> Motion:
        """Return the motion ahead at `speed` m/s under its own controller, which holds depth and heading.

        With fins it turns first, as one that is unstable at a drift angle cannot stop turning.
        """
        turn, seconds = (
            (TURN, SECONDS + 2.0 * min(self.turn_time, SLOW_TURN_S)) if self.vehicle.fins else (0.0, SECONDS)
        )
        return self._fly(seconds, VelocityCommand(surge=speed, depth=self._depth, heading=turn))

    @property
    def _depth(self) -> float:
        return 0.0 if self.floats else START_DEPTH

    def _fly(self, seconds: float, command: VelocityCommand | None) -> Motion:
        water = DEEP._replace(density=self.density, gravity=self.gravity)
        rig = Rig(self._name, self.vehicle, self._control, tilt=(TILT, TILT), world=water, depth=self._depth)
        try:
            moments = rig.fly(seconds, None if command is None else lambda time: command)
        except DivergenceError:
            return Motion(inf, inf, inf, inf)
        end = [m for m in moments if m.time >= seconds - HELD_S]
        heading = command.heading or 0.0 if command else 0.0
        return Motion(
            tilt=degrees(max(acos(cos(m.attitude[0]) * cos(m.attitude[1])) for m in moments)),
            rate=degrees(max(hypot(*m.nu[3:]) for m in moments)),
            depth=max(abs(m.position[2] - self._depth) for m in end),
            heading=degrees(max(abs(wrap(m.attitude[2] - heading)) for m in end)),
        )
