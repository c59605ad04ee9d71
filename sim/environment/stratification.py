"""Lift of a hull in layers of density and under waves, as the difference from calm water of one density."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

from sim.environment.seawater.water_column import WaterColumn
from sim.environment.world import World
from sim.forces import Force, Wrench, lift_wrench
from sim.rotations import Rotation
from sim.vehicle.buoyancy import Hull
from sim.vehicle.vehicle import Vehicle

if TYPE_CHECKING:
    from sim.environment.waves import WaveField
    from sim.native._native import Force as Twin


class Stratified:
    """(rho(depth) / rho0 - 1) times the hull's lift, rho0 being the world's own density.

    `depth` is that of the centre of buoyancy. Not modelled: a hull that the pressure squeezes.
    """

    def __init__(self, hull: Hull, column: WaterColumn, density: float) -> None:
        self._hull = hull
        self._column = column
        self._density = density

    def begin(self, time_ns: int) -> None:
        """Do nothing: layers do not change with time."""

    def wrench(self, position: Sequence[float], rotation: Rotation, nu_r: Sequence[float]) -> Wrench:
        """Return what the lift is more, or less (N, N m, body axes about the origin)."""
        _, _, _, _, _, _, zx, zy, zz = rotation
        lift, x, y, z = self._hull.lift(position[2], rotation)
        if lift == 0.0:
            return (0.0,) * 6
        depth = position[2] + (zx * x + zy * y + zz * z) / lift
        share = self._column.density(depth) / self._density - 1.0
        return lift_wrench((share * lift, share * x, share * y, share * z), rotation)


class WavySurface:
    """The hull's lift under the wave above it, less that under calm water.

    The surface is level over the hull, so a wave should be several vehicles long. Not modelled: slamming, the
    change of added mass and of wave forces on a hull partly out of the water.
    """

    def __init__(self, hull: Hull, wave_field: "WaveField") -> None:
        self._hull = hull
        self.wave_field = wave_field
        self.twin: Twin | None = None  # in C, which gets the time too
        highest = sum(abs(wave.amplitude) for wave in wave_field.components)
        self._deep = highest + hull.reach
        self._time = 0.0

    def begin(self, time_ns: int) -> None:
        """Set the instant of the sea, which holds for the step."""
        self._time = time_ns * 1e-9
        if self.twin is not None:
            self.twin.begin(self._time)

    def wrench(self, position: Sequence[float], rotation: Rotation, nu_r: Sequence[float]) -> Wrench:
        """Return what the lift is more, or less (N, N m, body axes about the origin)."""
        north, east, depth = position
        if depth >= self._deep:
            return (0.0,) * 6
        under = depth + self.wave_field.surface(self._time, north, east)
        calm = self._hull.lift(depth, rotation)
        lift, x, y, z = [a - b for a, b in zip(self._hull.lift(under, rotation), calm, strict=True)]
        return lift_wrench((lift, x, y, z), rotation)

    def numbers(self) -> list[float]:
        """Return all that `wrench` uses but hull and sea, in a row: what the C twin is made of."""
        return [self._deep]


def surface_and_layers(vehicle: Vehicle, world: World, wave_field: "WaveField | None") -> list[Force]:
    """Return the forces above on `vehicle` that `world` calls for."""
    hull = Hull(vehicle, world.density, world.gravity)
    forces: list[Force] = []
    if world.ocean and world.ocean.profile:
        forces.append(Stratified(hull, WaterColumn(world.ocean.profile, world.gravity), world.density))
    if wave_field is not None:
        forces.append(WavySurface(hull, wave_field))
    return forces
