"""The keys of a vehicle's surface meshes, which are separate files and are used for pictures only."""

from math import pi
from typing import Annotated, NamedTuple

from hil.common.schema import Range
from sim.vehicle.thrusters.model import Point

Scale = Annotated[float, Range(-1e6, 1e6)]
Angle = Annotated[float, Range(-2.0 * pi, 2.0 * pi, "rad")]


class Mesh(NamedTuple):
    """One mesh file. `file` is a path, beside the vehicle's file or absolute.

    `position` is that of the mesh's origin from the body origin (m, FRD), `orientation` the roll, pitch and yaw
    (rad) of the mesh's axes in the body's, `scale` the factors that convert its coordinates to metres.
    """

    file: str
    position: Point = (0.0, 0.0, 0.0)
    orientation: tuple[Angle, Angle, Angle] = (0.0, 0.0, 0.0)
    scale: tuple[Scale, Scale, Scale] = (1.0, 1.0, 1.0)
