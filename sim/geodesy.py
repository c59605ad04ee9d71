"""Convert local coordinates to latitude and longitude."""

from collections.abc import Sequence
from math import atan2, cos, degrees, hypot, radians, sin, sqrt

from hil.common.vectors import Vector3

SEMI_MAJOR_AXIS = 6_378_137.0  # m; WGS 84: NIMA TR8350.2, table 3.1
FLATTENING = 1.0 / 298.257223563
_E2 = FLATTENING * (2.0 - FLATTENING)  # the square of the first eccentricity


class TangentPlane:
    """Local north-east-down frame of an origin on the earth: the plane tangent to the ellipsoid there.

    `latitude` and `longitude` in degrees, `altitude` in m above the ellipsoid.
    """

    def __init__(self, latitude: float, longitude: float, altitude: float = 0.0) -> None:
        phi, lam = radians(latitude), radians(longitude)
        self._origin = earth_centred(latitude, longitude, altitude)
        north = (-sin(phi) * cos(lam), -sin(phi) * sin(lam), cos(phi))
        east = (-sin(lam), cos(lam), 0.0)
        down = (-cos(phi) * cos(lam), -cos(phi) * sin(lam), -sin(phi))
        self._axes = list(zip(north, east, down, strict=True))

    def geodetic(self, position: Sequence[float]) -> Vector3:
        """Return latitude and longitude (degrees) and altitude (m) of a position (m, NED from the origin)."""
        north, east, down = position
        x, y, z = [
            start + a * north + b * east + c * down
            for start, (a, b, c) in zip(self._origin, self._axes, strict=True)
        ]  # fmt: skip
        return geodetic(x, y, z)

    def local(self, latitude: float, longitude: float, altitude: float) -> Vector3:
        """Return the position (m, NED from the origin) of a latitude and longitude (degrees) and an altitude (m)."""
        offset = [a - b for a, b in zip(earth_centred(latitude, longitude, altitude), self._origin, strict=True)]
        north, east, down = [
            sum(x * axis for x, axis in zip(offset, column, strict=True)) for column in zip(*self._axes, strict=True)
        ]
        return north, east, down


def earth_centred(latitude: float, longitude: float, altitude: float) -> Vector3:
    """Convert geodetic (degrees, m) to Cartesian, earth-centred and earth-fixed, in m."""
    phi, lam = radians(latitude), radians(longitude)
    normal = SEMI_MAJOR_AXIS / sqrt(1.0 - _E2 * sin(phi) ** 2)
    out = (normal + altitude) * cos(phi)
    return out * cos(lam), out * sin(lam), (normal * (1.0 - _E2) + altitude) * sin(phi)


def geodetic(x: float, y: float, z: float) -> Vector3:
    """Convert Cartesian, earth-centred and earth-fixed (m) to latitude and longitude (degrees) and altitude (m).

    tan(phi) = (z + e² N sin(phi)) / p, iterated (Hofmann-Wellenhof and Moritz 2006, Physical Geodesy, 5.6.1):
    each iteration reduces the error by a factor of 150. Between the deepest sea and the highest mountain the initial
    error is below 1e-5 rad, so five iterations reach the resolution of a float.
    """
    p = hypot(x, y)
    phi = atan2(z, p * (1.0 - _E2))
    for _ in range(5):
        sine = sin(phi)
        phi = atan2(z + _E2 * SEMI_MAJOR_AXIS / sqrt(1.0 - _E2 * sine * sine) * sine, p)
    # distance along the normal; unlike p / cos(phi) - N it is also valid at the poles
    altitude = p * cos(phi) + z * sin(phi) - SEMI_MAJOR_AXIS * sqrt(1.0 - _E2 * sin(phi) ** 2)
    return degrees(phi), degrees(atan2(y, x)), altitude
