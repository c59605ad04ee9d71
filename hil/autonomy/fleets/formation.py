"""Formation control: artificial potential fields on a virtual structure, computed by each vehicle for itself.

A vehicle knows its own position, its place in the structure, and the neighbours within the range of communication.
Four terms make up the velocity it wants; the reference platform (Zhang et al. 2022) has them as its eqs (4) to (9):

    attraction     (4, 5) to its place in the structure
    repulsion      (6, 7) from neighbours, the target and obstacles nearby; it vanishes at the place itself
    communication  (8) to a neighbour who is about to get out of range
    structure      the velocity of the place, for a moving structure (`hil.autonomy.fleets.hunting`)

and their sum is its (9). What differs from the printed formulas, and why, is in
docs/explanation/reference_platform.md. Attraction after Khatib (IJRR 5, 1986), conic far away, as (5) below `conic`;
repulsion after Ge & Cui (IEEE Trans. Robotics and Automation 16, 2000), as (7) has its equilibrium beside the place;
for communication the mirror image of Khatib's repulsion at the range's edge, a barrier (compare Ji & Egerstedt, IEEE
Trans. Robotics 23, 2007), as (8) pulls at vehicles out of range; the virtual structure after Lewis & Tan (Autonomous
Robots 4, 1997). A "force" here is a velocity in m/s: the vehicle's own controller makes the newtons.

Level plane; positions and vectors are north, east in m and m/s.
"""

from collections.abc import Sequence
from math import hypot, inf
from typing import Annotated, NamedTuple

from hil.common.schema import Range

Vector = tuple[float, float]  # north, east

_NEAREST = 1e-3  # m: nearer than this a field would grow out of all bounds


class FieldSettings(NamedTuple):
    """The gains and ranges of the fields.

    `attraction` 1/s, up to `conic` m from the place, constant beyond. `repulsion` m²/s acts within
    `repulsion_range` m of a neighbour's or obstacle's rim. `communication` m³/s acts on a neighbour from
    `comfortable` m up to `communication_range` m: choose them off the formation's own distances, or pairs that
    are just in range of each other contract it. `max_speed` m/s bounds the sum.
    """

    attraction: Annotated[float, Range(0.0, 10.0)] = 0.6
    conic: Annotated[float, Range(0.01, 100.0, "m")] = 0.5
    repulsion: Annotated[float, Range(0.0, 100.0)] = 0.12
    repulsion_range: Annotated[float, Range(0.01, 100.0, "m")] = 0.9
    communication: Annotated[float, Range(0.0, 100.0)] = 0.05
    comfortable: Annotated[float, Range(0.1, 1e4, "m")] = 4.0
    communication_range: Annotated[float, Range(0.1, 1e4, "m")] = 5.0
    max_speed: Annotated[float, Range(0.01, 5.0, "m/s")] = 0.4

    def validate(self) -> str | None:
        """Return what is wrong between the keys, or None."""
        if self.comfortable >= self.communication_range:
            return "comfortable must be below communication_range"
        return None


class Body(NamedTuple):
    """A body to keep away from: its centre, and the least distance (m) of another vehicle's centre from it.

    A neighbour with `stays_in_range` is also held within the range of communication. One that has just come into range
    is not to be, as it would be pulled at hardest (Ji & Egerstedt add such a link only well within the range, too).
    """

    position: Vector
    radius: float
    stays_in_range: bool = True


def attraction(position: Vector, place: Vector, gain: float, conic: float) -> Vector:
    """Return gain x (place - position), constant beyond `conic` m from the place."""
    north, east = place[0] - position[0], place[1] - position[1]
    distance = hypot(north, east)
    pull = gain * min(1.0, conic / distance) if distance else 0.0
    return pull * north, pull * east


def repulsion(position: Vector, place: Vector, body: Body, gain: float, reach: float) -> Vector:
    """Return minus the gradient of ½ gain (1/rho - 1/reach)² d², rho being the distance from the rim, d from the place.

    Two parts: away from the body, gain (1/rho - 1/reach) d² / rho², and to the place, gain (1/rho - 1/reach)² d
    (Ge & Cui's n = 2). Beyond `reach` m nothing.
    """
    north, east = position[0] - body.position[0], position[1] - body.position[1]
    between = hypot(north, east)
    rho = max(between - body.radius, _NEAREST)
    if rho >= reach:
        return 0.0, 0.0
    to_north, to_east = place[0] - position[0], place[1] - position[1]
    left = hypot(to_north, to_east)
    steep = 1.0 / rho - 1.0 / reach
    away = gain * steep * left * left / (rho * rho) / max(between, _NEAREST)
    back = gain * steep * steep
    return away * north + back * to_north, away * east + back * to_east


def communication(position: Vector, neighbour: Vector, gain: float, comfortable: float, reach: float) -> Vector:
    """Return minus the gradient of ½ gain (1/(reach - d) - 1/(reach - comfortable))², d the neighbour's distance.

    Towards the neighbour, from `comfortable` m on, the steeper the nearer to `reach` m. Who is farther away
    than that is not known and does not count.
    """
    north, east = neighbour[0] - position[0], neighbour[1] - position[1]
    distance = hypot(north, east)
    if not comfortable < distance < reach:
        return 0.0, 0.0
    left = max(reach - distance, _NEAREST)
    pull = gain * (1.0 / left - 1.0 / (reach - comfortable)) / (left * left) / distance
    return pull * north, pull * east


def resultant(
    position: Vector,
    place: Vector,
    place_velocity: Vector,
    neighbours: Sequence[Body],
    obstacles: Sequence[Body],
    settings: FieldSettings,
) -> Vector:
    """Return the wanted velocity (m/s) of a vehicle at `position`: the sum of all fields, clipped to `max_speed`.

    `place` and its velocity are those of its place in the structure; of the neighbours (`radius`: how near
    middles may come, m) only those within the range of communication count.
    """
    s = settings
    known = [body for body in neighbours if _distance(position, body.position) < s.communication_range]
    parts = [place_velocity, attraction(position, place, s.attraction, s.conic)]
    parts += [repulsion(position, place, body, s.repulsion, s.repulsion_range) for body in (*known, *obstacles)]
    parts += [
        communication(position, body.position, s.communication, s.comfortable, s.communication_range)
        for body in known
        if body.stays_in_range
    ]
    north, east = sum(part[0] for part in parts), sum(part[1] for part in parts)
    share = min(1.0, s.max_speed / max(hypot(north, east), _NEAREST))
    return share * north, share * east


def separation(positions: Sequence[Vector]) -> float:
    """Return the least distance between any two vehicles' centres, m; inf for fewer than two."""
    pairs = [(a, b) for number, a in enumerate(positions) for b in positions[:number]]
    return min((_distance(a, b) for a, b in pairs), default=inf)


def formation_error(positions: Sequence[Vector], places: Sequence[Vector]) -> float:
    """Return the largest distance of a vehicle from its place, with the structure in its best-fitting pose, m.

    Best-fitting: with the centroid of the vehicles, and its own orientation. So only the formation's shape counts.
    """
    north, east = (
        sum(p[axis] - q[axis] for p, q in zip(positions, places, strict=True)) / len(positions) for axis in (0, 1)
    )
    return max(_distance(p, (q[0] + north, q[1] + east)) for p, q in zip(positions, places, strict=True))


def _distance(a: Vector, b: Vector) -> float:
    return hypot(a[0] - b[0], a[1] - b[1])
