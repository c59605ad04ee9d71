"""Convert geographic positions to a local plane: the tangent plane of WGS 84 at a world's origin."""

from math import cos, radians, sin

import numpy as np
from numpy.typing import NDArray

# WGS 84 (NIMA TR8350.2): semi-major axis in m, flattening, and the eccentricity squared that follows
SEMI_MAJOR_AXIS = 6_378_137.0
FLATTENING = 1.0 / 298.257223563
_E2 = FLATTENING * (2.0 - FLATTENING)

Array = NDArray[np.float64]


class LocalPlane:
    """Plane that touches the ellipsoid at (latitude, longitude), in degrees; positions are north and east in m.

    A point of the ellipsoid is projected onto the plane (ECEF, then rotation to the local axes). Distances from the
    origin are therefore too short, by 0.5 mm at 5 km and 0.1 m at 30 km: suitable for worlds of some tens of km. The
    curvature of the earth is not modelled: depths are relative to the water's surface.
    """

    def __init__(self, latitude: float, longitude: float) -> None:
        self.latitude, self.longitude = latitude, longitude
        phi, lam = radians(latitude), radians(longitude)
        self._up = np.array([cos(phi) * cos(lam), cos(phi) * sin(lam), sin(phi)])
        self._north = np.array([-sin(phi) * cos(lam), -sin(phi) * sin(lam), cos(phi)])
        self._east = np.array([-sin(lam), cos(lam), 0.0])
        self._origin = _ecef(np.array(phi), np.array(lam))

    def to_local(self, latitude: Array, longitude: Array) -> tuple[Array, Array]:
        """Return north and east (m) of positions in degrees; all arrays have the same shape."""
        offset = _ecef(np.radians(latitude), np.radians(longitude)) - self._origin
        return offset @ self._north, offset @ self._east


def _ecef(phi: Array, lam: Array) -> Array:
    """Return the Earth-centred, Earth-fixed positions of points of the ellipsoid, (..., 3) in m; angles in radians."""
    radius = SEMI_MAJOR_AXIS / np.sqrt(1.0 - _E2 * np.sin(phi) ** 2)
    parts = radius * np.cos(phi) * np.cos(lam), radius * np.cos(phi) * np.sin(lam), radius * (1.0 - _E2) * np.sin(phi)
    return np.stack(parts, axis=-1)
