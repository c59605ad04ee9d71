"""Additional buoyancy of a hull in density layers and under waves: the difference from calm, homogeneous water."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Protocol

from sim.environment.seawater.water_column import WaterColumn
from sim.environment.world import World
from sim.forces import Force, Wrench, buoyancy_wrench
from sim.rotations import Rotation
from sim.vehicle.buoyancy import Hull
from sim.vehicle.vehicle import Vehicle

if TYPE_CHECKING:
    from sim.environment.waves import WaveField


class Twin(Protocol):
    """The C twin of a force."""

    def begin(self, time: float, /) -> None:
        """Set the time of the waves, in s."""


class Stratified:
    """The force of density layers: (rho(depth) / rho0 - 1) times the hull's buoyancy, rho0 being the world's density.

    `depth` is that of the centre of buoyancy. Not modelled: compression of the hull by the pressure.
    """

    def __init__(self, hull: Hull, column: WaterColumn, density: float) -> None:
        self._hull = hull
        self._column = column
        self._density = density

    def begin(self, time_ns: int) -> None:
        """Do nothing: layers do not change with time."""

    def wrench(self, position: Sequence[float], rotation: Rotation, nu_r: Sequence[float]) -> Wrench:
        """Return the additional buoyancy (N, N m, body axes about the origin)."""
        _, _, _, _, _, _, zx, zy, zz = rotation
        force, x, y, z = self._hull.buoyancy(position[2], rotation)
        if force == 0.0:
            return (0.0,) * 6
        depth = position[2] + (zx * x + zy * y + zz * z) / force
        share = self._column.density(depth) / self._density - 1.0
        return buoyancy_wrench((share * force, share * x, share * y, share * z), rotation)


class WavySurface:
    """The force of waves at the surface: the hull's buoyancy under the wave above it, less that under calm water.

    The surface is taken as level over the hull, so a wave should be several vehicle lengths long. Not modelled:
    slamming, the change of added mass and of wave forces on a hull partly out of the water.
    """

    def __init__(self, hull: Hull, wave_field: "WaveField") -> None:
        self._hull = hull
        self.wave_field = wave_field
        self.twin: Twin | None = None  # the C twin, if there is one; `begin` sets its time, too
        self._calm_depth = wave_field.max_elevation + hull.reach  # m: from this depth on there is no difference
        self._time = 0.0

    def begin(self, time_ns: int) -> None:
        """Set the time of the waves for the next step."""
        self._time = time_ns * 1e-9
        if self.twin is not None:
            self.twin.begin(self._time)

    def wrench(self, position: Sequence[float], rotation: Rotation, nu_r: Sequence[float]) -> Wrench:
        """Return the additional buoyancy (N, N m, body axes about the origin)."""
        north, east, depth = position
        if depth >= self._calm_depth:
            return (0.0,) * 6
        immersion = depth + self.wave_field.surface(self._time, north, east)
        calm = self._hull.buoyancy(depth, rotation)
        force, x, y, z = [a - b for a, b in zip(self._hull.buoyancy(immersion, rotation), calm, strict=True)]
        return buoyancy_wrench((force, x, y, z), rotation)

    def numbers(self) -> list[float]:
        """Return the numbers of `wrench` besides hull and waves, for the C twin."""
        return [self._calm_depth]


def surface_and_layers(vehicle: Vehicle, world: World, wave_field: "WaveField | None") -> list[Force]:
    """Return the forces of density layers and of waves on `vehicle`, as far as `world` has them."""
    hull = Hull(vehicle, world.density, world.gravity)
    forces: list[Force] = []
    if world.ocean and world.ocean.profile:
        forces.append(Stratified(hull, WaterColumn(world.ocean.profile, world.gravity), world.density))
    if wave_field is not None:
        forces.append(WavySurface(hull, wave_field))
    return forces
