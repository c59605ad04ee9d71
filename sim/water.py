"""The water of a world that has an `[ocean]`: how it moves and pushes the vehicle, and its layers."""

from bisect import bisect_right
from collections.abc import Sequence

from sim.currents import Velocity, ocean_current
from sim.dynamics import State
from sim.interpolation import PiecewiseLinear
from sim.matrices import cross_matrix, square
from sim.ocean import Profile, Waves
from sim.rotations import rotate_inverse
from sim.vehicle import Vehicle, displaced_volume
from sim.waves import Sea, WaterMotion
from sim.world import World

SOUND_SPEED = 1500.0  # m/s, where a profile does not give it

_AT_REST = WaterMotion((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))


class MovingWater:
    """Currents and waves as one vehicle feels them at its origin.

    The velocity of the water goes into the equations of motion as that of the current does. Water that
    accelerates pushes besides, on what it would itself fill of the hull and on the added mass:
    (M_A + rho V) a, in which rho V acts at the centre of buoyancy (Newman 1977, Marine Hydrodynamics, 4.17);
    a vehicle that weighs nothing and does not drag goes with the water. Waves push so; currents change too
    slowly for it. A hull that pierces the surface feels the height of the waves by sim/stratification.py.
    Not modelled: differences of the water's velocity along the hull, so a wave should be several vehicles long.
    """

    def __init__(self, vehicle: Vehicle, world: World, seed: int) -> None:
        assert world.ocean is not None
        self._current = ocean_current(world.ocean, world.current, seed)
        waves = world.ocean.waves
        self._sea = HeldSea(waves, world, seed) if waves else None
        self._mass = pushed_mass(vehicle, world.density)

    def carry(self, vehicle: Vehicle, density: float) -> None:
        """Push `vehicle` from now on: what it was, without what it has dropped."""
        self._mass = pushed_mass(vehicle, density)

    def act(self, time_ns: int, state: State, wrench: Sequence[float]) -> tuple[Velocity, Sequence[float]]:
        """The water's velocity (m/s, NED), and `wrench` (N, N m, body axes) with the push of the waves added."""
        velocity = self._current(time_ns, state.position[2])
        if self._sea is None:
            return velocity, wrench
        orbital, acceleration = self._sea.motion(time_ns, state.position)
        north, east, down = velocity
        a, b, c = rotate_inverse(state.quaternion, acceleration)
        pushed = [force + x * a + y * b + z * c for force, (x, y, z) in zip(wrench, self._mass, strict=True)]
        return (north + orbital[0], east + orbital[1], down + orbital[2]), pushed

    @property
    def sea(self) -> Sea | None:
        """The waves; None if there are none."""
        return self._sea.sea if self._sea else None

    def velocity(self, time_ns: int, place: Sequence[float]) -> Velocity:
        """The water's velocity (m/s, NED) at a place (m, NED), which need not be the vehicle's."""
        north, east, down = self._current(time_ns, place[2])
        if self._sea is None:
            return north, east, down
        x, y, z = self._sea.sea.motion(time_ns * 1e-9, *place).velocity
        return north + x, east + y, down + z


class HeldSea:
    """A sea whose motion is computed every `hold` s where the vehicle is then, and kept in between."""

    def __init__(self, waves: Waves, world: World, seed: int) -> None:
        self.sea = Sea(waves, world.depth, world.gravity, seed)
        self._hold_ns = round(waves.hold * 1e9)
        self._due_ns = 0
        self._motion = _AT_REST

    def motion(self, time_ns: int, position: Sequence[float]) -> WaterMotion:
        """The motion of the water at `position` (m, NED), not older than `hold`."""
        if time_ns >= self._due_ns:
            self._due_ns = time_ns + self._hold_ns
            self._motion = self.sea.motion(time_ns * 1e-9, *position)
        return self._motion


def pushed_mass(vehicle: Vehicle, density: float) -> list[list[float]]:
    """M_A + rho V: 6 rows of 3, from the water's acceleration (body axes) to force and moment about the origin."""
    displaced = density * displaced_volume(vehicle, density)
    added = square(vehicle.added_mass, 6)
    upright = square([1.0, 1.0, 1.0], 3) + cross_matrix(vehicle.center_of_buoyancy)
    return [[added[i][j] + displaced * upright[i][j] for j in range(3)] for i in range(6)]


class WaterColumn:
    """Density, speed of sound and pressure by depth, from the rows of a profile, under `gravity` m/s².

    What a hull's lift makes of it is in sim/stratification.py.
    """

    def __init__(self, profile: Profile, gravity: float) -> None:
        depths, densities = list(profile.depth), list(profile.density)
        if depths[0] > 0.0:  # the first row holds up to the surface
            depths.insert(0, 0.0)
            densities.insert(0, densities[0])
        self._density = PiecewiseLinear(depths, densities)
        self._sound = PiecewiseLinear(profile.depth, profile.sound_speed or (SOUND_SPEED,) * len(profile.depth))
        self._depths = depths
        self._gravity = gravity
        self._pressures = [0.0]
        for depth in depths[1:]:
            self._pressures.append(self.pressure(depth))

    def density(self, depth: float) -> float:
        """kg/m³ at `depth` m."""
        return self._density(depth)[0]

    def sound_speed(self, depth: float) -> float:
        """m/s at `depth` m: 1500 where the profile says nothing."""
        return self._sound(depth)[0]

    def pressure(self, depth: float) -> float:
        """Pa above that of the air at `depth` m: the weight of the water on top, exactly; 0 in the air."""
        if depth <= 0.0:
            return 0.0
        row = min(bisect_right(self._depths, depth), len(self._pressures)) - 1
        top = self._depths[row]
        mean = 0.5 * (self.density(top) + self.density(depth))  # exact: linear between two rows
        return self._pressures[row] + self._gravity * mean * (depth - top)
