"""Fins: control surfaces that a servo turns in the flow, with lift, drag, stall, and the servo's lag.

The flow at a fin is the velocity of its position through the water, including the vehicle's rotation, without its
component along the fin's axis. In the plane normal to the axis, lift is perpendicular to this flow and drag along it:

    L = 1/2 rho V² A C_L(alpha),  D = 1/2 rho V² A C_D(alpha),  alpha = deflection - angle of the flow

So a fin never adds energy (unless the hull straightens its flow, see `Fin.straightening`), and it works astern as well
as ahead. Not modelled: the water's inertia, the wake of one fin at another, the jet of the propeller, loss of lift at
the surface.
"""

from collections.abc import Sequence
from math import atan2, cos, hypot, pi, remainder, sin, sqrt
from typing import Annotated, NamedTuple

from hil.common.schema import Range
from hil.common.vectors import cross, unit
from sim.forces import Force, Wrench
from sim.matrices import Matrix
from sim.rotations import Rotation
from sim.vehicle.servos import ServoSet
from sim.vehicle.thrusters.model import SHORTEST, Direction, Point, Pulse, pulses_problem

Area = Annotated[float, Range(1e-6, 100.0, "m²")]
Angle = Annotated[float, Range(0.0, pi / 2.0, "rad")]
Coefficient = Annotated[float, Range(0.0, 100.0)]


class Polar(NamedTuple):
    """Lift and drag coefficients over the angle of attack.

    Up to `stall_angle` (rad) C_L = lift_slope alpha and C_D = parasitic_drag + induced_drag C_L². Beyond it the flow
    separates: within `stall_width` (rad) the coefficients change linearly to those of a flat plate, C_L =
    broadside_drag sin(2 alpha) / 2 and C_D = parasitic_drag + broadside_drag sin²(alpha). Flow from behind gives the
    same as flow from ahead.
    """

    lift_slope: float
    stall_angle: float
    stall_width: float
    parasitic_drag: float
    induced_drag: float
    broadside_drag: float

    def at(self, alpha: float) -> tuple[float, float]:
        """Return C_L and C_D at any `alpha` (rad). C_L has the sign of a small `alpha`; C_D is never negative."""
        return self.coefficients(alpha, sin(alpha), cos(alpha))

    def coefficients(self, alpha: float, sine: float, cosine: float) -> tuple[float, float]:
        """Return the coefficients as `at` does, with the sine and cosine of `alpha` given."""
        alpha = remainder(alpha, pi)
        attached = max(-self.stall_angle, min(self.stall_angle, alpha))
        lift = self.lift_slope * attached
        drag = self.parasitic_drag + self.induced_drag * lift * lift
        beyond = abs(alpha - attached)
        if beyond == 0.0:
            return lift, drag
        share = min(1.0, beyond / self.stall_width)
        separated = self.broadside_drag * (sine * cosine)
        blunt = self.parasitic_drag + self.broadside_drag * (sine * sine)
        return lift + share * (separated - lift), drag + share * (blunt - drag)


def lift_slope(aspect_ratio: float) -> float:
    """Return dC_L/d(alpha) per rad of a wing of low aspect ratio (Helmbold 1942; Beard & McLain 2012, 4.2.3)."""
    return pi * aspect_ratio / (1.0 + sqrt(1.0 + 0.25 * aspect_ratio * aspect_ratio))


class Fin(NamedTuple):
    """One fin, or a pair that one servo turns.

    Its force acts at `position`. A positive deflection turns it right-handed about `axis` (any length). At rest its
    chord points along `chord`; a component along the axis is ignored. `area` is in m². `aspect_ratio` is span² over
    area; from it follow `lift_slope` (1/rad) and `induced_drag` (1 / (pi oswald aspect_ratio)) if they are left out.
    The default `broadside_drag` is that of a square plate (Hoerner 1965, Fluid-Dynamic Drag, 3-16).

    `straightening` is the share of the cross flow that reaches the fin past hull and propeller: 1 in undisturbed flow,
    0 if the angle of attack is the deflection alone (the flow-straightening coefficient of the MMG model, Yasukawa &
    Yoshimura 2015, J. Mar. Sci. Technol. 20).

    The deflection is proportional to the pulse, with `max_deflection` at both ends of the pulse range. The servo
    follows with a first-order lag, no faster than `rate` (0: no limit). Without a valid pulse (800..2200 us) it stops.
    """

    name: str
    position: Point
    axis: Direction
    area: Area
    max_deflection: Angle
    chord: Direction = (1.0, 0.0, 0.0)
    aspect_ratio: Annotated[float, Range(0.01, 50.0)] | None = None
    lift_slope: Annotated[float, Range(0.01, 20.0)] | None = None
    induced_drag: Coefficient | None = None
    oswald: Annotated[float, Range(0.1, 1.0)] = 0.9
    parasitic_drag: Coefficient = 0.01
    broadside_drag: Coefficient = 1.17
    stall_angle: Angle = 0.3
    stall_width: Annotated[float, Range(0.001, 1.6, "rad")] = 0.2
    straightening: Annotated[float, Range(0.0, 1.0)] = 1.0
    time_constant: Annotated[float, Range(0.0, 10.0, "s")] = 0.1
    rate: Annotated[float, Range(0.0, 100.0, "rad/s")] = 0.0
    pwm_neutral_us: Pulse = 1500
    pwm_min_us: Pulse = 1100
    pwm_max_us: Pulse = 1900

    def validate(self) -> str | None:
        """Return what is wrong with the combination of the keys, or None."""
        if self.aspect_ratio is None and (self.lift_slope is None or self.induced_drag is None):
            return f"fin {self.name!r}: give aspect_ratio, or lift_slope and induced_drag"
        across = hypot(*cross(self.axis, self.chord))
        if min(hypot(*self.axis), hypot(*self.chord)) < SHORTEST or across < SHORTEST * SHORTEST:
            return f"fin {self.name!r}: axis and chord must be directions across each other"
        problem = pulses_problem(self)
        return f"fin {self.name!r}: {problem}" if problem else None

    @property
    def polar(self) -> Polar:
        """Coefficients of the fin."""
        slope, induced = slope_and_induced(self.lift_slope, self.induced_drag, self.aspect_ratio, self.oswald)
        return Polar(
            slope, self.stall_angle, self.stall_width, self.parasitic_drag, induced, self.broadside_drag
        )  # fmt: skip

    @property
    def frame(self) -> tuple[Direction, Direction]:
        """Two unit vectors: the chord at rest, and where a positive deflection turns the leading edge."""
        normal = unit(cross(self.axis, self.chord))
        return unit(cross(normal, self.axis)), normal


def slope_and_induced(
    slope: float | None, induced: float | None, aspect_ratio: float | None, oswald: float
) -> tuple[float, float]:
    """Return lift slope and induced drag factor; one that is None is computed from the aspect ratio."""
    if aspect_ratio is not None:
        slope = lift_slope(aspect_ratio) if slope is None else slope
        induced = 1.0 / (pi * oswald * aspect_ratio) if induced is None else induced
    assert slope is not None
    assert induced is not None
    return slope, induced


class FinSet(ServoSet, Force):
    """All fins of a vehicle in water of `density` kg/m³; their servos start at 0 rad and step every `dt` s."""

    def __init__(self, fins: Sequence[Fin], density: float, dt: float) -> None:
        super().__init__(fins, dt)
        self._surfaces = [
            (*fin.position, *fin.frame, 0.5 * density * fin.area, fin.straightening, fin.polar) for fin in fins
        ]

    def wrench(self, position: Sequence[float], rotation: Rotation, nu_r: Sequence[float]) -> Wrench:
        """Return the sum of all fins (N, N m, body axes about the origin) at `nu_r` (m/s, rad/s) through the water."""
        u, v, w, p, q, r = nu_r
        total = [0.0] * 6
        for angle, (x, y, z, chord, normal, scale, share, polar) in zip(self.angles, self._surfaces, strict=True):
            a, b, c = u + q * z - r * y, v + r * x - p * z, w + p * y - q * x
            along = a * chord[0] + b * chord[1] + c * chord[2]
            across = share * (a * normal[0] + b * normal[1] + c * normal[2])
            speed = sqrt(along * along + across * across)
            if speed == 0.0:
                continue
            sine, cosine = sin(angle), cos(angle)
            alpha = angle - atan2(across, along)
            sine_alpha = (sine * along - cosine * across) / speed
            cosine_alpha = (cosine * along + sine * across) / speed
            lift, drag = polar.coefficients(alpha, sine_alpha, cosine_alpha)
            factor = scale * speed
            ahead, sideways = -factor * (drag * along + lift * across), factor * (lift * along - drag * across)
            force = [ahead * i + sideways * j for i, j in zip(chord, normal, strict=True)]
            total = [a + b for a, b in zip(total, (*force, *cross((x, y, z), force)), strict=True)]
        return total

    def numbers(self) -> list[float]:
        """Return all numbers that `wrench` uses, with sine and cosine of each angle, as a flat list, for the C twin."""
        return [
            number
            for angle, (x, y, z, chord, normal, scale, share, polar) in zip(self.angles, self._surfaces, strict=True)
            for number in (x, y, z, *chord, *normal, scale, share, *polar, sin(angle), cos(angle))
        ]


def fin_matrix(fins: Sequence[Fin], density: float) -> Matrix:
    """Return the 6 x n matrix of the wrench (N, N m) of each fin per rad of deflection at 1 m/s, below stall.

    The wrench grows with the square of the speed. A fin whose chord points astern meets the flow with its other edge.
    """
    columns = []
    for fin in fins:
        chord, normal = fin.frame
        size = 0.5 * density * fin.area * fin.polar.lift_slope * chord[0] * abs(chord[0])
        force = [size * n for n in normal]
        columns.append((*force, *cross(fin.position, force)))
    return [list(row) for row in zip(*columns, strict=True)]
