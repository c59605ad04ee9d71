"""Allocation of a wrench that the thrusters cannot produce."""

from collections.abc import Sequence
from math import atan2, cos, degrees, pi, radians, remainder, sin
from random import Random

from matplotlib.axes import Axes

from hil.autonomy.control.allocation import pseudo_inverse
from tests.unit.autonomy import test_allocation as sharing
from tools.validations.sheet import OURS, WRONG, Finding, Sheet, above, below, label, plot_ref

DEMAND = 200.0  # N: more than the thrusters can produce


def allocation(panels: Sequence[Axes]) -> list[Finding]:
    """Eight thrusters with 50 N forward and 40 N in reverse. The demand is 200 N, in all directions. Where the
    thrusters cannot produce it, the force is scaled and has the demanded direction. Red: each thrust is limited
    separately, and the direction of the force changes."""
    rays, turn = panels
    headings = [2.0 * i for i in range(181)]
    inverse, _ = pseudo_inverse(sharing.HEAVY)
    allocator = sharing.make_allocator(sharing.HEAVY)
    scaled = [_produced_wrench(allocator.allocate(_requested_wrench(heading))[0]) for heading in headings]
    clipped = [_produced_wrench(clip(inverse, _requested_wrench(heading))) for heading in headings]
    for made, color, name in ((clipped, WRONG, "each thrust clipped"), (scaled, OURS, "ours")):
        for m in made[10:180:20]:
            rays.plot([0.0, m[1]], [0.0, m[0]], color=color, marker="o", markersize=3)
        turn.plot(
            headings, [_heading_error(m, h) for m, h in zip(made, headings, strict=True)], color=color, label=name
        )
    requested = [_requested_wrench(heading) for heading in headings[10:180:20]]
    plot_ref(rays, [0.9 * w[1] for w in requested], [0.9 * w[0] for w in requested], "demanded direction", size=7.0)
    plot_ref(turn, headings[::6], [0.0] * 31, "demanded")
    rays.set_aspect("equal", "datalim")
    turn.set_ylim(-26.0, 45.0)
    label(rays, "sway force (N)", "surge force (N)", legend="")
    label(turn, "heading of the demanded force (deg)", "error of its heading (deg)", legend="upper right")
    return _allocation_findings(headings, scaled, clipped)


def _allocation_findings(headings: list[float], scaled: list[list[float]], clipped: list[list[float]]) -> list[Finding]:
    lateral = [abs(m[0] * sin(radians(h)) - m[1] * cos(radians(h))) for m, h in zip(scaled, headings, strict=True)]
    clipped_errors = [abs(_heading_error(m, h)) for m, h in zip(clipped, headings, strict=True)]
    return [
        below("beyond the limits: force across the demanded direction", max(lateral), 5e-9, "N"),
        below("within the limits: wrench minus demanded wrench (N, N m)", _residual(), 1e-9),
        above("each thrust clipped: largest error of the heading", max(clipped_errors), 20.0, "deg"),
    ]


def clip(inverse: Sequence[Sequence[float]], wrench: Sequence[float]) -> list[float]:
    """Return the thrusts (N) for `wrench`, each limited separately."""
    thrusts = [sum(a * b for a, b in zip(row, wrench, strict=True)) for row in inverse]
    return [max(-40.0, min(50.0, thrust)) for thrust in thrusts]


def _requested_wrench(heading: float) -> list[float]:
    return [DEMAND * cos(radians(heading)), DEMAND * sin(radians(heading)), 0.0, 0.0, 0.0, 0.0]


def _produced_wrench(thrusts: Sequence[float]) -> list[float]:
    return sharing.wrench_of(sharing.HEAVY, thrusts)


def _heading_error(made: Sequence[float], heading: float) -> float:
    return degrees(remainder(atan2(made[1], made[0]) - radians(heading), 2.0 * pi))


def _residual() -> float:
    random, allocator, worst = Random(1), sharing.make_allocator(sharing.HEAVY, 1e6, 1e6), 0.0
    for _ in range(500):
        wrench = [random.uniform(-x, x) for x in (400.0, 400.0, 400.0, 30.0, 30.0, 30.0)]
        thrusts, _ = allocator.allocate(wrench)
        worst = max(worst, *(abs(a - b) for a, b in zip(_produced_wrench(thrusts), wrench, strict=True)))
    return worst


SHEETS = [Sheet("Allocation beyond the limits", allocation, size=(7.0, 3.0))]
