"""What a vehicle that steers by fins can do: the tightest circle and the steepest slope at a speed.

Both are steady motions, in which no force and no moment is left over (Fossen 2021, "Handbook of Marine Craft
Hydrodynamics and Motion Control", on steady turning). The forces are those of the simulation: inertia, damping, hull,
fins, weight and buoyancy. Roll and the loss of speed in a turn are left out.
"""

from collections.abc import Callable, Sequence
from math import atan2, hypot

from hil.autonomy.control.allocation import pseudo_inverse
from hil.autonomy.control.controller import Gains
from hil.autonomy.control.fin_control import FinAllocator, FinGains
from sim.dynamics import Dynamics, State
from sim.rotations import from_euler
from sim.vehicle.equipment import Equipment
from sim.vehicle.fins import fin_matrix
from sim.vehicle.terminal_speed import axis_capabilities
from sim.vehicle.thrusters.bank import wrench_matrix
from sim.vehicle.vehicle import Vehicle, mass_matrix

_HEAVE, _SWAY, _PITCH, _YAW = 2, 1, 4, 5
_DEEP = 100.0  # m, far below the surface
_STEPS = 60  # of a search for the first balance; of a bisection
_NO_FIN = 1e-9  # rad, in place of 0: the deflection of a fixed fin


class Manoeuvring:
    """The steady motions of a `vehicle` with fins at `speed` m/s ahead, under its controller's limits.

    `density` (kg/m³) is that of the water. `speed` is raised to the controller's least speed. `top_speed` is the
    greatest speed ahead (m/s).
    """

    def __init__(
        self, vehicle: Vehicle, gains: Gains, fins: FinGains, speed: float, density: float, gravity: float = 9.80665
    ) -> None:
        equipment = Equipment(vehicle, density, gravity, 1.0)
        assert equipment.fins, "steered by fins"
        self._servos, self._pitch_limit = equipment.fins.servos, fins.pitch_limit
        self.speed = max(speed, fins.least_speed)
        self._dynamics = Dynamics(vehicle, density, gravity, forces=equipment.forces)
        limits = [fin.max_deflection or _NO_FIN for fin in vehicle.fins]
        self._allocator = FinAllocator(fin_matrix(vehicle.fins, density), limits, fins.least_speed)
        self._reach = axis_capabilities(vehicle, pseudo_inverse(wrench_matrix(vehicle))[0], density, gravity)
        self.top_speed = self._reach[0].speed[0]
        mass = mass_matrix(vehicle)
        self._moments = {
            axis: loop.limit * mass[axis][axis] for axis, loop in ((_PITCH, gains.pitch_rate), (_YAW, gains.yaw_rate))
        }
        self._length = vehicle.dimensions[0]

    def turn_radius(self) -> float:
        """Return the radius (m) of the tightest circle, at least half the vehicle's length."""
        self._steer(_YAW)

        def circle(rate: float) -> tuple[float, float]:
            return self._balance(lambda sway: self._forces(sway, 0.0, 0.0, rate), _SWAY, _YAW)

        rate = _first_root(lambda rate: circle(rate)[1], 2.0 * self.speed / self._length)
        return hypot(self.speed, circle(rate)[0]) / rate

    def slope(self) -> float:
        """Return the steepest slope (rad) of a path up, with the pitch within the controller's limit."""
        self._steer(_PITCH)

        def climb(pitch: float) -> tuple[float, float]:
            return self._balance(lambda heave: self._forces(0.0, heave, pitch, 0.0), _HEAVE, _PITCH)

        pitch = _first_root(lambda pitch: climb(pitch)[1], self._pitch_limit)
        return max(0.0, pitch - atan2(climb(pitch)[0], self.speed))

    def _steer(self, axis: int) -> None:
        """Deflect the fins for the greatest moment about `axis` that the controller commands."""
        own = min(self._moments[axis], self._reach[axis].force[0])
        wanted = [0.0] * 6
        wanted[axis] = self._moments[axis] - own
        self._servos.values, _ = self._allocator.allocate(tuple(wanted), self.speed)  # type: ignore[arg-type]
        self._thrust = [own if number == axis else 0.0 for number in range(6)]

    def _forces(self, sway: float, heave: float, pitch: float, rate: float) -> Sequence[float]:
        state = State((0.0, 0.0, _DEEP), from_euler(0.0, pitch, 0.0), (self.speed, sway, heave, 0.0, 0.0, rate))
        return self._dynamics.forces(state, self._thrust, (0.0, 0.0, 0.0)).total

    def _balance(self, forces: Callable[[float], Sequence[float]], force: int, moment: int) -> tuple[float, float]:
        """Return the cross velocity (m/s) at which the `force` vanishes, and the `moment` that is left."""
        cross = _bisect(lambda velocity: forces(velocity)[force], -self.speed, self.speed)
        return cross, forces(cross)[moment]


def _first_root(left: Callable[[float], float], most: float) -> float:
    """Return the least value up to `most` at which `left` falls below 0; `most` if it stays above."""
    for step in range(1, _STEPS + 1):
        if left(most * step / _STEPS) < 0.0:
            return _bisect(left, most * (step - 1) / _STEPS, most * step / _STEPS)
    return most


def _bisect(left: Callable[[float], float], low: float, high: float) -> float:
    """Return where `left`, positive at `low`, becomes negative."""
    for _ in range(_STEPS // 3):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if left(middle) > 0.0 else (low, middle)
    return 0.5 * (low + high)
