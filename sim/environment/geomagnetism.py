"""The earth's magnetic field at a world's origin, by the World Magnetic Model.

`uuv-hil world build` writes it into the world's file as `magnetic_field`, so that a board does not need the model. For
a world with an `origin` and without that key it is computed when a sensor needs it, for the middle of the model's five
years instead of today, so that a run can be repeated. Without an origin it is DEFAULT.
"""

from math import radians
from typing import TYPE_CHECKING, NamedTuple

from hil.common.errors import MissingExtraError

if TYPE_CHECKING:
    from sim.environment.world import World

FieldAngles = tuple[float, float, float]

DEFAULT: FieldAngles = (49e-6, 1.15, 0.0)  # about that of central Europe


class MagneticField(NamedTuple):
    """The field of a model: `angles` are intensity (T), inclination (down positive) and declination (east positive).

    Inclination and declination are in rad. `model` is the name of the model, `year` the decimal year of the field.
    """

    angles: FieldAngles
    model: str
    year: float


def field_of(world: "World") -> FieldAngles:
    """Return intensity (T), inclination and declination (rad) of `world`. Raises MissingExtraError."""
    if world.magnetic_field is not None:
        return world.magnetic_field
    if world.origin is None:
        return DEFAULT
    try:
        return field_at(*world.origin, world.origin_altitude).angles
    except MissingExtraError as error:
        message = f"{world.name}: has an origin, but no magnetic_field: give it there, or else {error}"
        raise MissingExtraError(message) from None


def field_at(latitude: float, longitude: float, altitude: float = 0.0, year: float | None = None) -> MagneticField:
    """Return the field at a position (degrees, m above the WGS 84 ellipsoid), without anomalies by rock and iron.

    A `year` outside the model's five years is set to their nearest end; without one it is their middle. Raises
    MissingExtraError.
    """
    try:
        from pygeomag import GeoMag
    except ImportError:
        raise MissingExtraError("the World Magnetic Model needs pygeomag: pip install 'uuv-hil[chart]'") from None
    model = GeoMag()
    first, last = model.life_span
    time = 0.5 * (first + last) if year is None else min(max(year, first), last)
    field = model.calculate(glat=latitude, glon=longitude, alt=altitude / 1000.0, time=time)
    angles = field.f * 1e-9, radians(field.i), radians(field.d)
    return MagneticField(angles, model.model, time)
