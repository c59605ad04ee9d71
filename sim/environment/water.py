"""Motion of the water in a world with an `[ocean]`, and its forces on the vehicle."""

from collections.abc import Sequence

from sim.dynamics import State
from sim.environment.currents import Velocity, ocean_current
from sim.environment.ocean import Waves
from sim.environment.waves import Plan, WaterMotion, WaveField
from sim.environment.world import World
from sim.matrices import cross_matrix, square
from sim.rotations import Rotation, matrix, rotate_inverse
from sim.vehicle.vehicle import Vehicle, displaced_volume

LEVEL: Rotation = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)
_FAR_M2 = 0.0625  # m²: squared distance from the last sample at which the motion is computed again


class FluidMotion:
    """Currents and waves at one vehicle: the mean over its length and width.

    The velocity of the water is used in the equations of motion as that of the current. Water that accelerates with a
    also exerts the force (M_A + rho V) a on the hull: on the added mass, and on the displaced water, whose part rho V a
    acts at the centre of buoyancy (Newman 1977, Marine Hydrodynamics, 4.17). So a neutrally buoyant vehicle without
    damping moves with the water. Only waves exert this force; currents change too slowly. A hull that pierces the
    surface displaces less, and the water turns along a long one: sim/environment/stratification.py adds that.
    """

    def __init__(self, vehicle: Vehicle, world: World, seed: int, sampled: "type[SampledWaves] | None" = None) -> None:
        assert world.ocean is not None
        self.current = ocean_current(world.ocean, world.current, seed)
        self.is_steady = not world.ocean._replace(waves=None).moves  # except for waves
        waves = world.ocean.waves
        self._sampled_waves = (sampled or SampledWaves)(waves, world, seed, vehicle.dimensions) if waves else None
        self._mass = wave_inertia(vehicle, world.density)

    def set_vehicle(self, vehicle: Vehicle, density: float) -> None:
        """Use the mass and shape of `vehicle` from now on, for example after it has dropped a weight."""
        self._mass = wave_inertia(vehicle, density)

    def act(self, time_ns: int, state: State, wrench: Sequence[float]) -> tuple[Velocity, Sequence[float]]:
        """Return the water's velocity (m/s, NED), and `wrench` (N, N m, body axes) plus the force of the waves."""
        velocity = self.current(time_ns, state.position[2])
        if self._sampled_waves is None:
            return velocity, wrench
        orbital, acceleration, *_ = self._sampled_waves.motion(time_ns, state.position, matrix(state.quaternion))
        north, east, down = velocity
        a, b, c = rotate_inverse(state.quaternion, acceleration)
        total = [force + x * a + y * b + z * c for force, (x, y, z) in zip(wrench, self._mass, strict=True)]
        return (north + orbital[0], east + orbital[1], down + orbital[2]), total

    @property
    def wave_inertia(self) -> list[float]:
        """The vehicle's current `wave_inertia` matrix, row after row."""
        return [x for row in self._mass for x in row]

    @property
    def wave_field(self) -> WaveField | None:
        """The waves; None if there are none."""
        return self._sampled_waves.wave_field if self._sampled_waves else None

    def velocity(self, time_ns: int, position: Sequence[float]) -> Velocity:
        """Return the water's velocity (m/s, NED) at any position (m, NED)."""
        velocity = self.current(time_ns, position[2])
        if self._sampled_waves is None:
            return velocity
        north, east, depth = position
        x, y, z = self._sampled_waves.wave_field.motion(time_ns * 1e-9, north, east, depth).velocity
        return velocity[0] + x, velocity[1] + y, velocity[2] + z


class SampledWaves:
    """Waves whose motion is computed every `hold` s at a hull of `dimensions` (m) and extrapolated in between.

    Its depth is that of the hull's middle; of a hull that pierces the mean surface, that of half its draught. The
    velocity is extrapolated linearly: its error is at most about (omega hold)² / 2 of each wave's velocity, while that
    of a constant velocity would be omega hold. The motion is also computed again when the vehicle has moved by more
    than 0.25 m, for example because it was set to another position.
    """

    def __init__(self, waves: Waves, world: World, seed: int, dimensions: Sequence[float] = (0.0, 0.0, 0.0)) -> None:
        self._hold_ns = round(waves.hold * 1e9)
        self._half_sizes = [0.5 * size for size in dimensions]
        self.wave_field = self._make_wave_field(waves, world, seed)
        self._due_ns = self._time_ns = 0
        self._position: Sequence[float] = (0.0, 0.0, 0.0)  # of the last sample
        self._motion = WaterMotion((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))

    def motion(self, time_ns: int, position: Sequence[float], rotation: Rotation = LEVEL) -> WaterMotion:
        """Return the motion of the water at a hull at `position` (m, NED) and `rotation` (body to world).

        A new sample also updates `WaveField.surface`.
        """
        north, east, down = (a - b for a, b in zip(position, self._position, strict=True))
        if time_ns >= self._due_ns or north * north + east * east + down * down > _FAR_M2:
            self._due_ns, self._time_ns, self._position = time_ns + self._hold_ns, time_ns, tuple(position)
            time = time_ns * 1e-9
            length, width, height = self._half_sizes
            plan = Plan(length * rotation[0], length * rotation[3], width * rotation[1], width * rotation[4])
            depth = max(position[2], 0.5 * (position[2] + height))
            self._motion = self.wave_field.motion(time, position[0], position[1], depth, plan=plan)
            self.wave_field.set_tangent(time, position[0], position[1], self._motion)
        elapsed = (time_ns - self._time_ns) * 1e-9
        velocity, (north, east, down), *_ = self._motion
        extrapolated = velocity[0] + north * elapsed, velocity[1] + east * elapsed, velocity[2] + down * elapsed
        return self._motion._replace(velocity=extrapolated)

    def _make_wave_field(self, waves: Waves, world: World, seed: int) -> WaveField:
        return WaveField(waves, world.depth, world.gravity, seed)


def wave_inertia(vehicle: Vehicle, density: float) -> list[list[float]]:
    """Return M_A + rho V (6 rows of 3), which converts the water's acceleration (body axes) to a wrench."""
    displaced = density * displaced_volume(vehicle, density)
    added = square(vehicle.added_mass, 6)
    upright = square([1.0, 1.0, 1.0], 3) + cross_matrix(vehicle.center_of_buoyancy)
    return [[added[i][j] + displaced * upright[i][j] for j in range(3)] for i in range(6)]
