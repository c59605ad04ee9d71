"""Formation control: artificial potential fields on a virtual structure, computed by each vehicle for itself.

A vehicle knows its own position, its slot (place in the structure), and the neighbours within communication range. Its
target velocity is the sum of four terms; the numbers are the equations of the reference platform (Zhang et al. 2022):

    attraction     (4, 5) to its slot
    repulsion      (6, 7) from neighbours, the target and obstacles nearby; zero at the slot itself
    communication  (8) to a neighbour that is about to leave the range
    structure      the velocity of the slot, for a moving structure (`hil.autonomy.fleets.hunting`)

Their sum is its (9). docs/explanation/reference_platform.md explains where the code differs from the printed formulas.
Attraction is after Khatib (IJRR 5, 1986), conic far away, as (5) below `conic`. Repulsion is after Ge & Cui (IEEE
Trans. Robotics and Automation 16, 2000), because (7) has its equilibrium beside the slot. Communication is the mirror
image of Khatib's repulsion at the edge of the range, a barrier (compare Ji & Egerstedt, IEEE Trans. Robotics 23, 2007),
because (8) attracts vehicles that are out of range. The virtual structure is after Lewis & Tan (Autonomous Robots 4,
1997). A "force" here is a velocity in m/s, which the vehicle's own controller follows.

Horizontal plane; positions and vectors are north, east in m and m/s.
"""

from collections.abc import Sequence
from math import hypot, inf
from typing import Annotated, NamedTuple

from hil.common.schema import Range

Vector = tuple[float, float]  # north, east

_NEAREST = 1e-3  # m; smaller distances are replaced by this, to bound the fields


class FieldSettings(NamedTuple):
    """The gains and ranges of the fields.

    `attraction` in 1/s, up to `conic` m from the slot, constant beyond. `repulsion` in m²/s acts within
    `repulsion_range` m of the rim of a neighbour or obstacle. `communication` in m³/s acts toward a neighbour from
    `comfortable` m up to `communication_range` m. Choose these two away from the formation's own distances; otherwise
    pairs that are just within range contract the formation. `max_speed` in m/s limits the sum.
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
        """Return which keys contradict each other, or None."""
        if self.comfortable >= self.communication_range:
            return "comfortable must be below communication_range"
        return None


class Body(NamedTuple):
    """A body to avoid: its centre, and the least distance (m) of another vehicle's centre from it.

    A neighbour with `stays_in_range` is also kept within communication range. This should be false for one that has
    just come into range, as the attraction is strongest there (Ji & Egerstedt also add such a link only well within
    range).
    """

    position: Vector
    radius: float
    stays_in_range: bool = True


def attraction(position: Vector, slot: Vector, gain: float, conic: float) -> Vector:
    """Return gain x (slot - position), constant beyond `conic` m from the slot."""
    north, east = slot[0] - position[0], slot[1] - position[1]
    distance = hypot(north, east)
    pull = gain * min(1.0, conic / distance) if distance else 0.0
    return pull * north, pull * east


def repulsion(position: Vector, slot: Vector, body: Body, gain: float, reach: float) -> Vector:
    """Return minus the gradient of ½ gain (1/rho - 1/reach)² d², with distances rho from the rim and d from the slot.

    It has two parts: away from the body, gain (1/rho - 1/reach) d² / rho², and to the slot, gain (1/rho - 1/reach)² d
    (Ge & Cui's n = 2). Beyond `reach` m it is zero.
    """
    north, east = position[0] - body.position[0], position[1] - body.position[1]
    between = hypot(north, east)
    rho = max(between - body.radius, _NEAREST)
    if rho >= reach:
        return 0.0, 0.0
    to_north, to_east = slot[0] - position[0], slot[1] - position[1]
    left = hypot(to_north, to_east)
    steep = 1.0 / rho - 1.0 / reach
    away = gain * steep * left * left / (rho * rho) / max(between, _NEAREST)
    back = gain * steep * steep
    return away * north + back * to_north, away * east + back * to_east


def communication(position: Vector, neighbour: Vector, gain: float, comfortable: float, reach: float) -> Vector:
    """Return minus the gradient of ½ gain (1/(reach - d) - 1/(reach - comfortable))², d being the neighbour's distance.

    It points to the neighbour, from `comfortable` m on, and grows toward `reach` m. Neighbours beyond are unknown and
    do not count.
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
    slot: Vector,
    slot_velocity: Vector,
    neighbours: Sequence[Body],
    obstacles: Sequence[Body],
    settings: FieldSettings,
) -> Vector:
    """Return the target velocity (m/s) of a vehicle at `position`: the sum of all fields, limited to `max_speed`.

    `slot` and `slot_velocity` are its position and velocity in the structure. Only neighbours within communication
    range count; their `radius` is the least distance between centres, m.
    """
    s = settings
    known = [body for body in neighbours if _distance(position, body.position) < s.communication_range]
    parts = [slot_velocity, attraction(position, slot, s.attraction, s.conic)]
    parts += [repulsion(position, slot, body, s.repulsion, s.repulsion_range) for body in (*known, *obstacles)]
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


def formation_error(positions: Sequence[Vector], slots: Sequence[Vector]) -> float:
    """Return the largest distance (m) of a vehicle from its slot, after the structure was moved to fit best.

    The structure is moved to the vehicles' centroid, not rotated. So only the formation's shape and orientation count.
    """
    north, east = (
        sum(p[axis] - q[axis] for p, q in zip(positions, slots, strict=True)) / len(positions) for axis in (0, 1)
    )
    return max(_distance(p, (q[0] + north, q[1] + east)) for p, q in zip(positions, slots, strict=True))


def _distance(a: Vector, b: Vector) -> float:
    return hypot(a[0] - b[0], a[1] - b[1])
