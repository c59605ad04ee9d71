"""Select the part in C where it was compiled, the one in Python otherwise: errors, inertial units, rays, pictures.

Both return the same numbers to the last bit. `sim.assembly` selects what a whole simulation is made of.
"""

from collections.abc import Callable, Iterable, Sequence
from random import Random
from typing import TYPE_CHECKING

from sim.dynamics import State
from sim.native import NativeErrorBank, has_native
from sim.sensors.error import ErrorBank, ErrorModel

if TYPE_CHECKING:
    from types import ModuleType

    from sim.native._rays import Caster
    from sim.rays.geometry import Geometry
    from sim.sensors.samples import ImuSample


def make_imu(
    errors: ErrorBank, sample: "type[ImuSample]", position: Sequence[float], gravity: float
) -> "Callable[[int, State], ImuSample] | None":
    """Return the `sample` function of an IMU in C, or None if `errors` are not in C.

    It returns what sim.sensors.imu.Imu returns for a unit at `position` (m, body axes) that is aligned with the
    vehicle's axes, under `gravity` m/s².
    """
    if not isinstance(errors, NativeErrorBank):
        return None
    from sim.native._native import Imu

    return Imu(errors.errors, sample, position, gravity).sample


def make_error_bank(models: Iterable[ErrorModel], period: float, random: Random) -> ErrorBank:
    """Return the errors of one sensor that is sampled every `period` s, in C if it is compiled.

    Raises ConfigError as `choose` does.
    """
    return (NativeErrorBank if has_native() else ErrorBank)(models, period, random)


def make_caster(geometry: "Geometry") -> "Caster | None":
    """Return a ray caster in C, or None without C. Its `cast` is sim.rays.single.cast without the first argument.

    Raises ConfigError as `choose` does.
    """
    if not has_native("sim.native._rays"):
        return None
    from sim.native._rays import Caster

    _, _, solids, nodes, triangles = geometry
    terrain, depth = geometry.terrain, geometry.depth
    if terrain is None:
        return Caster((0, 0, 0.0, 0.0, 1.0, depth), b"", solids, nodes, triangles)
    north_min, east_min, _, rows, columns = terrain.grid
    ground = rows, columns, north_min, east_min, terrain.scale, terrain.outside
    return Caster(ground, terrain.depths, solids, nodes, triangles)


def load_picture() -> "ModuleType | None":
    """Return the C module sim.native._picture, which computes the light and the sensor of cameras; None without C.

    Raises ConfigError as `choose` does.
    """
    if not has_native("sim.native._picture"):
        return None
    from sim.native import _picture

    return _picture
