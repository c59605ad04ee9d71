"""Forces of the flow on a slender hull: lift, cross-flow drag, and damping that depends on the forward speed."""

from collections.abc import Sequence
from math import atan2, exp, sqrt
from typing import Annotated, Literal, NamedTuple

from hil.common.schema import Range
from sim.forces import Force, Wrench
from sim.interpolation import PiecewiseLinear, validate_columns
from sim.matrices import Matrix, square, times
from sim.rotations import Rotation
from sim.vehicle.fins import Angle, Area, Coefficient, Polar, slope_and_induced
from sim.vehicle.thrusters.model import Point

STRIPS = 20
Damping = Annotated[float, Range(0.0, 1e6)]


class Lift(NamedTuple):
    """The hull as a wing: lift and drag over the angle of attack (Beard & McLain 2012, section 4.2; Fossen 2021, 8.4).

    `area` (m²) is the reference area of the coefficients. `aspect_ratio`, `lift_slope` (1/rad), `induced_drag`,
    `oswald`, `parasitic_drag` and the stall are as in sim/vehicle/fins.py; the drag of the separated flow is that of
    `[cross_flow]`. `plane` is "any" for a body of revolution; with "vertical", heave makes lift and sway makes none.
    The force acts at `position` and depends on the flow velocity there.
    """

    area: Area
    aspect_ratio: Annotated[float, Range(0.001, 50.0)] | None = None
    lift_slope: Annotated[float, Range(0.0, 20.0)] | None = None
    induced_drag: Coefficient | None = None
    oswald: Annotated[float, Range(0.1, 1.0)] = 0.3
    parasitic_drag: Coefficient = 0.0
    stall_angle: Angle = 0.6
    stall_width: Annotated[float, Range(0.001, 1.6, "rad")] = 0.3
    plane: Literal["any", "vertical"] = "any"
    position: Point = (0.0, 0.0, 0.0)

    def validate(self) -> str | None:
        """Return what is wrong with the combination of the keys, or None."""
        if self.aspect_ratio is None and (self.lift_slope is None or self.induced_drag is None):
            return "give aspect_ratio, or lift_slope and induced_drag"
        return None

    @property
    def polar(self) -> Polar:
        """Coefficients of the body."""
        slope, induced = slope_and_induced(self.lift_slope, self.induced_drag, self.aspect_ratio, self.oswald)
        return Polar(slope, self.stall_angle, self.stall_width, self.parasitic_drag, induced, 0.0)


class HullLift(Force):
    """The force of a `Lift` on a hull in water of `density` kg/m³."""

    def __init__(self, lift: Lift, density: float) -> None:
        self._polar = lift.polar
        self._scale = 0.5 * density * lift.area
        self._vertical = lift.plane == "vertical"
        self._position = lift.position

    def wrench(self, position: Sequence[float], rotation: Rotation, nu_r: Sequence[float]) -> Wrench:
        """Return lift and drag (N, N m, body axes) at `nu_r` (m/s, rad/s) through the water."""
        u, v, w, p, q, r = nu_r
        x, y, z = self._position
        fx, fy, fz = self._force(u + q * z - r * y, v + r * x - p * z, w + p * y - q * x)
        return fx, fy, fz, y * fz - z * fy, z * fx - x * fz, x * fy - y * fx

    def numbers(self) -> list[float]:
        """Return all numbers that `wrench` uses, as one flat list, for the C twin."""
        return [*self._polar, self._scale, float(self._vertical), *self._position]

    def _force(self, u: float, v: float, w: float) -> tuple[float, float, float]:
        """Return lift and drag in the plane of the hull's axis and the flow, or in the vertical plane."""
        cross = w if self._vertical else sqrt(v * v + w * w)
        planar = sqrt(u * u + cross * cross)
        if planar == 0.0:
            return 0.0, 0.0, 0.0
        lift, drag = self._polar.coefficients(atan2(cross, u), cross / planar, u / planar)
        factor = self._scale * (u * u + v * v + w * w) / planar
        starboard = -factor * (drag * cross + lift * u)
        ahead = -factor * (drag * u - lift * cross)
        if self._vertical or cross == 0.0:
            return ahead, 0.0, starboard
        return ahead, starboard * v / cross, starboard * w / cross


class CrossFlow(NamedTuple):
    """Drag of the flow across the hull, summed over strips of its length (Faltinsen 1990, chapter 6).

    `drag` is the two-dimensional coefficient of a strip: one number, or one for each `speed` (m/s) of the cross flow
    at the origin, linear in between, for a hull near the drag crisis. `length`, `width` and `height` (m) are those of
    the vehicle if left out. Only the velocity across the axis counts: sway and heave together.
    """

    drag: tuple[Coefficient, ...]
    speed: tuple[Annotated[float, Range(0.0, 20.0, "m/s")], ...] = ()
    length: Annotated[float, Range(0.01, 50.0, "m")] | None = None
    width: Annotated[float, Range(0.001, 50.0, "m")] | None = None
    height: Annotated[float, Range(0.001, 50.0, "m")] | None = None

    def validate(self) -> str | None:
        """Return what is wrong with the combination of the keys, or None."""
        if not self.speed:
            return None if len(self.drag) == 1 else "drag: give one value, or one for each speed"
        return validate_columns("speed", self.speed, drag=self.drag) if self.drag else "drag: give one for each speed"


class CrossFlowDrag(Force):
    """The force of a `CrossFlow` on a hull of `dimensions` m in water of `density` kg/m³."""

    def __init__(self, flow: CrossFlow, dimensions: Sequence[float], density: float) -> None:
        length, width, height = dimensions
        length = flow.length or length
        strip = length / STRIPS
        self._stations = [(i + 0.5) * strip - 0.5 * length for i in range(STRIPS)]
        self._drag = PiecewiseLinear(flow.speed or (0.0,), flow.drag)
        self._sway_scale = 0.5 * density * strip * (flow.height or height)
        self._heave_scale = 0.5 * density * strip * (flow.width or width)

    def wrench(self, position: Sequence[float], rotation: Rotation, nu_r: Sequence[float]) -> Wrench:
        """Return the drag of all strips (N, N m, body axes) at `nu_r` (m/s, rad/s) through the water."""
        _, v, w, _, q, r = nu_r
        y = z = m = n = 0.0
        for x in self._stations:
            starboard, down = v + x * r, w - x * q
            size = sqrt(starboard * starboard + down * down)
            starboard *= size
            down *= size
            y += starboard
            z += down
            m -= x * down
            n += x * starboard
        coefficient = self._drag(sqrt(v * v + w * w))[0]
        sway_scale, heave_scale = -coefficient * self._sway_scale, -coefficient * self._heave_scale
        return 0.0, sway_scale * y, heave_scale * z, 0.0, heave_scale * m, sway_scale * n

    def numbers(self) -> list[float]:
        """Return all numbers that `wrench` uses, as one flat list, for the C twin. The coefficient table comes last."""
        return [self._sway_scale, self._heave_scale, *self._stations, *self._drag.numbers()]


class SpeedDamping(Force):
    """Damping in proportion to the forward speed: the force is -|u| D nu_r, with D of 6 or 36 numbers.

    D holds the derivatives that the literature writes as Y_uv, N_uv, Y_ur ...: lift of hull and fins at small angles.
    """

    def __init__(self, values: Sequence[float]) -> None:
        self._matrix: Matrix = square(values, 6)

    def wrench(self, position: Sequence[float], rotation: Rotation, nu_r: Sequence[float]) -> Wrench:
        """Return the damping (N, N m, body axes) at `nu_r` (m/s, rad/s) through the water."""
        speed = -abs(nu_r[0])
        return [speed * x for x in times(self._matrix, *nu_r)]

    def numbers(self) -> list[float]:
        """Return all numbers that `wrench` uses, as one flat list, for the C twin."""
        return [x for row in self._matrix for x in row]


class FadingDamping(NamedTuple):
    """Linear damping of slow motion by the laminar boundary layer; it decreases as the speed grows.

    The force is -exp(-`rate` U^`exponent`) `damping` nu_r, where U (m/s) is the speed through the water. `damping` has
    six numbers (N s/m, N m s) for surge to yaw, `rate` is in (s/m)^exponent (Fossen 2021, section 6.4.3: "low-speed"
    damping).
    """

    damping: tuple[Damping, Damping, Damping, Damping, Damping, Damping]
    rate: Annotated[float, Range(0.0, 1000.0)]
    exponent: Annotated[float, Range(0.1, 4.0)] = 1.0


class SlowDamping(Force):
    """The force of a `FadingDamping`."""

    def __init__(self, fading: FadingDamping) -> None:
        self._fading = fading

    def wrench(self, position: Sequence[float], rotation: Rotation, nu_r: Sequence[float]) -> Wrench:
        """Return the damping (N, N m, body axes) at `nu_r` (m/s, rad/s) through the water."""
        u, v, w = nu_r[:3]
        share = -exp(-self._fading.rate * sqrt(u * u + v * v + w * w) ** self._fading.exponent)
        return [share * damping * speed for damping, speed in zip(self._fading.damping, nu_r, strict=True)]

    def numbers(self) -> list[float]:
        """Return all numbers that `wrench` uses, as one flat list, for the C twin."""
        return [*self._fading.damping, self._fading.rate, self._fading.exponent]
