"""The table of rules that a vehicle has to follow, and its findings.

A rule measures one or more values. A value outside `sane` is reported at the rule's level, one that is also outside
`absurd` is a problem. The vehicles of sim/vehicles and those of public simulators are within the bounds.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from math import atan2, degrees, inf
from typing import NamedTuple

from hil.doctor.vehicle.finding import Finding
from hil.doctor.vehicle.subject import AFLOAT, Subject
from sim.matrices import square
from sim.simulation import DT_NS
from sim.vehicle.terminal_speed import AXES, terminal_speed

Bounds = tuple[float, float]
Values = Iterable[tuple[str, float]]  # the part of the vehicle ("" for all of it), and the value
ANY: Bounds = (-inf, inf)
HELD_HEADING: Bounds = (-inf, 10.0)  # deg
ADRIFT, CONTROLLED = FLIGHTS = "adrift for 10 s", "under control"  # in place of a key


class Rule(NamedTuple):
    """What `key` of a vehicle's file has to do with: a measured `quantity` in `unit`, its bounds, and the remedy."""

    key: str
    quantity: str
    unit: str
    measure: Callable[[Subject], Values]
    sane: Bounds
    absurd: Bounds
    remedy: str
    level: str = "warning"


def check_vehicle(subject: Subject) -> Iterator[Finding]:
    """Yield the findings about a vehicle in its water; none if it is sane.

    Raises ConfigError if its `[control]` table is invalid.
    """
    is_absurd = False
    for rule in RULES:
        if rule.key in FLIGHTS and is_absurd:
            return  # its flight would show the same mistake again
        outside = [(part, value) for part, value in rule.measure(subject) if not _is_within(value, rule.sane)]
        if outside:
            absurd = not all(_is_within(value, rule.absurd) for _, value in outside)
            is_absurd = is_absurd or absurd
            yield Finding("problem" if absurd else rule.level, _text(rule, outside))


def _is_within(value: float, bounds: Bounds) -> bool:
    return bounds[0] <= value <= bounds[1]


def _text(rule: Rule, outside: Sequence[tuple[str, float]]) -> str:
    values = ", ".join([f"{part} {value:.3g}".strip() for part, value in outside])
    return (
        f"{rule.key}: {rule.quantity}: {values} {rule.unit}".rstrip()
        + f", expected {words(rule.sane, rule.unit)}: {rule.remedy}"
    )


def words(bounds: Bounds, unit: str) -> str:
    """Return bounds in words; empty if everything is within."""
    low, high = bounds
    if bounds == ANY:
        return ""
    numbers = f"at most {high:g}" if low == -inf else f"at least {low:g}" if high == inf else f"{low:g} to {high:g}"
    return f"{numbers} {unit}".rstrip()


def _inertia(subject: Subject) -> Values:
    """Yield each moment of inertia over that of a homogeneous box."""
    vehicle, matrix = subject.vehicle, square(subject.vehicle.inertia, 3)
    squares = [size * size for size in vehicle.dimensions]
    for axis in range(3):
        yield AXES[3 + axis], matrix[axis][axis] / (vehicle.mass * (sum(squares) - squares[axis]) / 12.0)


def _outside(subject: Subject) -> Values:
    """Yield how far points are outside the hull's box about the origin or the centre of buoyancy, in its sizes."""
    vehicle = subject.vehicle
    points = [("centre of gravity", vehicle.center_of_gravity), *((t.name, t.position) for t in vehicle.thrusters)]
    for name, point in points:
        centres = (0.0, 0.0, 0.0), vehicle.center_of_buoyancy
        rows = [zip(point, centre, vehicle.dimensions, strict=True) for centre in centres]
        yield name, min(max(abs(a - b) / size - 0.5 for a, b, size in row) for row in rows)


def _static_tilt(subject: Subject) -> Values:
    """Yield pitch and roll at which weight and buoyancy balance; none for what floats or does not right itself."""
    gravity, buoyancy = subject.vehicle.center_of_gravity, subject.vehicle.center_of_buoyancy
    x, y, z = (a - subject.buoyancy_ratio * b for a, b in zip(gravity, buoyancy, strict=True))
    if z > 0.0 and not subject.floats:
        yield from zip(("pitch", "roll"), (degrees(atan2(abs(size), z)) for size in (x, y)), strict=True)


def _speeds(subject: Subject, axes: slice) -> Values:
    for capability in subject.capabilities[axes]:
        if capability.driven:
            yield capability.axis, max(map(abs, capability.speed))


def _turn_time(subject: Subject) -> Values:
    if subject.turn_time:
        yield "", subject.turn_time


def _hold(subject: Subject) -> Values:
    """Yield net weight over the vertical thrust against it."""
    heave = subject.capabilities[2]
    if heave.driven:
        yield "", abs(subject.net_weight / heave.force[subject.net_weight > 0.0])


def _buoyancy(subject: Subject) -> Values:
    """Yield buoyancy over weight; none for a surface craft whose file has the form of its hull."""
    if not (subject.floats and subject.vehicle.hull):
        yield "", subject.buoyancy_ratio


def _depth_rate(subject: Subject) -> Values:
    if not subject.floats and any(subject.damping[2]):
        yield "", abs(terminal_speed(subject.net_weight, *subject.damping[2]))


def _undamped(subject: Subject) -> Values:
    """Yield the damping of each axis on which nothing acts that needs a speed ahead, or a length across the flow."""
    vehicle = subject.vehicle
    for axis, name in enumerate(AXES):
        crosses = axis in (1, 2, 4, 5) and (vehicle.lift or vehicle.cross_flow)
        if not crosses and not vehicle.forward_speed_damping:
            yield name, sum(subject.damping[axis])


def _fastest(subject: Subject) -> Values:
    """Yield the share of its velocity that damping takes in one step, at 1 m/s or 1 rad/s."""
    for name, (linear, quadratic), inertia in zip(AXES, subject.damping, subject.inertia, strict=True):
        yield name, (linear + quadratic) / inertia * DT_NS * 1e-9


def _held_depth(subject: Subject, driven: bool) -> Values:
    if driven == bool(subject.vehicle.fins or subject.capabilities[2].driven) and not subject.vehicle.buoyancy_engine:
        yield "", subject.controlled.depth


def _held_heading(subject: Subject) -> Values:
    if subject.vehicle.fins or subject.capabilities[5].driven:
        yield "", subject.controlled.heading


def _one(value: Callable[[Subject], float]) -> Callable[[Subject], Values]:
    return lambda subject: (("", value(subject)),)


WEIGHTS = "correct mass and volume, or set neutrally_buoyant = true"
CENTRES = "correct center_of_gravity, center_of_buoyancy, and the origin that they are measured from"
TUNE = "fly slower, compute [control] by `uuv-hil tune FILE`, and"
DRAG = "correct the damping of this axis, or the limits of the thrusters"
RULES = (
    Rule(
        "inertia", "moment over that of a box of this mass and size", "", _inertia, (0.05, 5.0), (0.0125, 80.0),
        "write kg m² about the centre of gravity, and check mass and dimensions",
    ),
    Rule(
        "volume", "displaced volume over that of the box of the dimensions", "",
        _one(lambda s: s.volume / (s.vehicle.dimensions[0] * s.vehicle.dimensions[1] * s.vehicle.dimensions[2])),
        (0.01, 1.05), (0.001, 3.0), "correct volume (m³) or dimensions (m); a neutrally buoyant one displaces its mass",
    ),
    Rule(
        "volume", "buoyancy over weight", "", _buoyancy, (0.97, AFLOAT), (0.3, 10.0),
        f"{WEIGHTS}, unless it is a glider, a lander or a surface craft", "note",
    ),
    Rule(
        "volume", "net weight over the vertical thrust against it", "", _hold, (-inf, 0.9), (-inf, 10.0),
        f"it cannot hold its depth: {WEIGHTS}",
    ),
    Rule(
        "volume", "terminal speed of sinking or rising adrift", "m/s", _depth_rate, (-inf, 1.0), (-inf, 10.0),
        f"{WEIGHTS}; or correct the damping of heave",
    ),
    Rule(
        "position", "distance outside the hull's box, in its sizes", "", _outside, (-inf, 0.5), (-inf, 2.0),
        "write metres from the origin of the body axes, or correct dimensions",
    ),
    Rule(
        "center_of_buoyancy", "height above the centre of gravity, in heights of the hull", "",
        _one(lambda s: s.stability / s.vehicle.dimensions[2]), (0.0, 1.0), (-0.02, 20.0),
        f"it capsizes if this is negative: {CENTRES} (z is down)",
    ),
    Rule("center_of_buoyancy", "static tilt", "deg", _static_tilt, (-inf, 15.0), (-inf, 75.0), CENTRES),
    Rule(
        "thrusters", "sum of max_forward over the weight", "",
        _one(lambda s: sum(each.max_forward for each in s.vehicle.thrusters) / s.weight), (0.001, 20.0), (1e-5, 200.0),
        "write max_forward and max_reverse in N, and mass in kg",
    ),
    Rule(
        "thrusters", "top speed ahead", "m/s", lambda s: _speeds(s, slice(1)), (0.05, 10.0), (0.005, 30.0), DRAG,
    ),
    Rule(
        "thrusters", "top speed aside and down", "m/s", lambda s: _speeds(s, slice(1, 3)), (-inf, 10.0), (-inf, 30.0),
        DRAG,
    ),
    Rule(
        "thrusters", "time to turn by 90 degrees", "s", _turn_time, (0.2, 60.0), (0.02, 600.0),
        "correct the thrusters' positions, or inertia and damping of yaw",
    ),
    Rule(
        "linear_damping", "sum of linear and quadratic damping", "", _undamped, (1e-9, inf), ANY,
        "nothing brakes this axis: write linear_damping or quadratic_damping",
    ),
    Rule(
        "linear_damping", "velocity that damping takes in a step of 2.5 ms", "", _fastest, (-inf, 0.5), (-inf, 2.0),
        "correct damping or added mass; or set a shorter step in [slave]",
    ),
    Rule(
        ADRIFT, "tilt", "deg", _one(lambda s: s.adrift.tilt), (-inf, 45.0), ANY,
        f"it does not right itself: {CENTRES}",
    ),
    Rule(
        ADRIFT, "turn rate", "deg/s", _one(lambda s: s.adrift.rate), (-inf, 90.0), (-inf, 1000.0),
        "it spins without thrust: correct inertia, damping and centres",
    ),
    Rule(
        ADRIFT, "change of depth", "m", _one(lambda s: s.adrift.depth), (-inf, 10.0), (-inf, 100.0), WEIGHTS,
    ),
    Rule(
        CONTROLLED, "error of depth", "m", lambda s: _held_depth(s, True), (-inf, 1.0), (-inf, 50.0),
        f"{TUNE} check trim and vertical thrust",
    ),
    Rule(
        CONTROLLED, "error of depth without vertical thrust", "m", lambda s: _held_depth(s, False), (-inf, 0.2), ANY,
        f"{WEIGHTS}, or add thrusters", "note",
    ),
    Rule(
        CONTROLLED, "error of heading", "deg", _held_heading,
        HELD_HEADING, (-inf, 60.0), f"{TUNE} check the places of thrusters and fins, and munk_share",
    ),
    Rule(
        CONTROLLED, "tilt", "deg", _one(lambda s: s.controlled.tilt), (-inf, 45.0), (-inf, 90.0),
        f"{TUNE} check the thrusters' directions and the centres",
    ),
)  # fmt: skip
