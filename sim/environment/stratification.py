"""Additional buoyancy of a hull in density layers and under waves: the difference from calm, homogeneous water."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

from sim.environment.seawater.water_column import WaterColumn
from sim.environment.world import World
from sim.forces import Force, TimedForce, Wrench, buoyancy_wrench
from sim.matrices import square
from sim.rotations import Rotation
from sim.vehicle.buoyancy import Hull
from sim.vehicle.vehicle import Vehicle

if TYPE_CHECKING:
    from sim.environment.waves import WaterMotion, WaveField


class Stratified(Force):
    """The force of density layers: (rho(depth) / rho0 - 1) times the hull's buoyancy, rho0 being the world's density.

    `depth` is that of the centre of buoyancy. Not modelled: compression of the hull by the pressure.
    """

    def __init__(self, hull: Hull, column: WaterColumn, density: float) -> None:
        self._hull = hull
        self._column = column
        self._density = density

    def wrench(self, position: Sequence[float], rotation: Rotation, nu_r: Sequence[float]) -> Wrench:
        """Return the additional buoyancy (N, N m, body axes about the origin)."""
        _, _, _, _, _, _, zx, zy, zz = rotation
        force, x, y, z = self._hull.buoyancy(position[2], (zx, zy, zz))
        if force == 0.0:
            return (0.0,) * 6
        depth = position[2] + (zx * x + zy * y + zz * z) / force
        share = self._column.density(depth) / self._density - 1.0
        return buoyancy_wrench((share * force, share * x, share * y, share * z), rotation)


class WavySurface(TimedForce):
    """The force of waves on a hull besides that of the accelerating water at its middle, which FluidMotion adds.

    At the surface: the lift is that under the plane that the waves make of the surface over the hull, less that under
    calm water; and the water's acceleration acts on what the hull displaces then, less the whole volume. At any depth:
    the moment of the acceleration's gradient on the displaced water, and the turning of the water along the hull,
    which acts on rotational added mass and damping. Water with a gradient has no rotation; it turns a slender body by
    the share (l² - w²) / (l² + w²) of its gradient (Jeffery 1922, Proc. R. Soc. A 102:161), a cube not at all.
    Together this is the pressure of the undisturbed waves (Froude and Krylov): in long waves a floating hull moves with
    the surface and tilts with its slope. Not modelled: slamming, diffraction beyond the constant added mass, loss of
    added mass and damping out of the water.
    """

    def __init__(self, vehicle: Vehicle, hull: Hull, wave_field: "WaveField", gravity: float) -> None:
        self._hull = hull
        self.wave_field = wave_field
        # m: from this depth on there is no difference of lift.
        self._calm_depth = wave_field.max_elevation + (1.0 + wave_field.max_slope) * hull.reach
        self._gravity = gravity
        squares = [size * size for size in vehicle.dimensions]
        pairs = [(squares[i], squares[j]) for i, j in ((1, 2), (0, 2), (0, 1))]
        self._slender = [(a - b) / (a + b) for a, b in pairs]
        self._second = [hull.full / gravity / 12.0 * (a - b) for a, b in pairs]
        added, linear, quadratic = (
            square(getattr(vehicle, key), 6) for key in ("added_mass", "linear_damping", "quadratic_damping")
        )
        self._added, self._linear, self._quadratic = (
            [rows[i][i] for i in (3, 4, 5)] for rows in (added, linear, quadratic)
        )

    def wrench(self, position: Sequence[float], rotation: Rotation, nu_r: Sequence[float]) -> Wrench:
        """Return the additional force (N, N m, body axes about the origin)."""
        waves = self.wave_field.held
        share = 1.0
        wrench: Wrench = (0.0,) * 6
        if position[2] < self._calm_depth:
            share, wrench = self._at_surface(waves, position, rotation)
        turn, accelerated = _shear(waves.gradient, rotation), _shear(waves.gradient_rate, rotation)
        x, y, z, *moments = wrench
        for i in range(3):
            speed, relative = nu_r[3 + i], nu_r[3 + i] - self._slender[i] * turn[i]
            moments[i] = (
                moments[i]
                + (share * self._second[i] + self._added[i] * self._slender[i]) * accelerated[i]
                + self._linear[i] * (speed - relative)
                + self._quadratic[i] * (abs(speed) * speed - abs(relative) * relative)
            )
        return (x, y, z, *moments)

    def numbers(self) -> list[float]:
        """Return the numbers of `wrench` besides hull and waves, for the C twin."""
        axes = self._slender, self._second, self._added, self._linear, self._quadratic
        return [self._calm_depth, self._gravity, *(x for numbers in axes for x in numbers)]

    def _at_surface(self, waves: "WaterMotion", position: Sequence[float], rotation: Rotation) -> tuple[float, Wrench]:
        """Return the share of the hull that is under water, and the wrench."""
        north, east, depth = position
        xx, xy, xz, yx, yy, yz, zx, zy, zz = rotation
        a_north, a_east, a_down = waves.acceleration
        _, _, slope_north, slope_east = waves.surface
        immersion = depth + self.wave_field.surface(self._time, north, east)
        tilted = [
            zx + slope_north * xx + slope_east * yx,
            zy + slope_north * xy + slope_east * yy,
            zz + slope_north * xz + slope_east * yz,
        ]
        calm, lift = self._hull.buoyancy(depth, (zx, zy, zz)), self._hull.buoyancy(immersion, tilted)
        force, x, y, z = [a - b for a, b in zip(lift, calm, strict=True)]
        mass, mx, my, mz = [(a - b) / self._gravity for a, b in zip(lift, self._hull.submerged, strict=True)]
        ax = xx * a_north + yx * a_east + zx * a_down
        ay = xy * a_north + yy * a_east + zy * a_down
        az = xz * a_north + yz * a_east + zz * a_down
        wrench = buoyancy_wrench((force, x, y, z), rotation)
        pushed = mass * ax, mass * ay, mass * az, my * az - mz * ay, mz * ax - mx * az, mx * ay - my * ax
        return lift[0] / self._hull.full, [a + b for a, b in zip(wrench, pushed, strict=True)]


def _shear(gradient: Sequence[float], rotation: Rotation) -> tuple[float, float, float]:
    """Return the yz, -xz and xy elements, along body axes, of a symmetric gradient nn, ne, ee, nd, ed without trace.

    They are the rates at which it turns a body that is wide, long and long: about x, y and z.
    """
    nn, ne, ee, nd, ed = gradient
    xx, xy, xz, yx, yy, yz, zx, zy, zz = rotation
    dd = -(nn + ee)
    # The gradient times the body's y and z axes.
    y_north, y_east, y_down = nn * xy + ne * yy + nd * zy, ne * xy + ee * yy + ed * zy, nd * xy + ed * yy + dd * zy
    z_north, z_east, z_down = nn * xz + ne * yz + nd * zz, ne * xz + ee * yz + ed * zz, nd * xz + ed * yz + dd * zz
    return (
        xy * z_north + yy * z_east + zy * z_down,
        -(xx * z_north + yx * z_east + zx * z_down),
        xx * y_north + yx * y_east + zx * y_down,
    )


def surface_and_layers(vehicle: Vehicle, world: World, wave_field: "WaveField | None") -> list[Force]:
    """Return the forces of density layers and of waves on `vehicle`, as far as `world` has them."""
    hull = Hull(vehicle, world.density, world.gravity)
    forces: list[Force] = []
    if world.ocean and world.ocean.profile:
        forces.append(Stratified(hull, WaterColumn(world.ocean.profile, world.gravity), world.density))
    if wave_field is not None:
        forces.append(WavySurface(vehicle, hull, wave_field, world.gravity))
    return forces
