"""Thrusters compared with the table of their manufacturer."""

from collections.abc import Sequence
from math import sqrt

from matplotlib.axes import Axes

from sim.vehicle.thrusters.t200 import performance
from tests.unit.sim.vehicle.test_thruster_curves import held_out_points
from tools.validations.sheet import SHADES, Finding, Sheet, below, label, plot_own, plot_ref


def t200(panels: Sequence[Axes]) -> list[Finding]:
    """The T200 compared with its manufacturer's table for 10 to 20 V. The simulator has every fifth pulse width of the
    table. The dots are points of the table that it does not have."""
    thrust, current = panels
    held_out = held_out_points()
    for volts, color in zip((10, 14, 16, 20), reversed(SHADES), strict=True):
        pulses = list(range(1100, 1901, 2))
        performances = [performance(pulse, volts) for pulse in pulses]
        plot_own(thrust, pulses, [p.thrust for p in performances], f"ours, {volts} V", color)
        plot_own(current, pulses, [p.current for p in performances], f"ours, {volts} V", color)
        points = sorted(pulse for v, pulse in held_out if v == volts)[::4]
        name = "held-out points" if volts == 20 else "_"
        plot_ref(thrust, points, [held_out[volts, pulse][0] for pulse in points], name)
        plot_ref(current, points, [held_out[volts, pulse][1] for pulse in points], name)
    label(thrust, "pulse (µs)", "thrust (N)", legend="upper left")
    label(current, "pulse (µs)", "current (A)", legend="upper center")
    return _t200_findings(held_out)


def _t200_findings(held_out: dict[tuple[int, int], tuple[float, float, float, float]]) -> list[Finding]:
    square = share = amperes = watts = rpm = 0.0
    for (volts, pulse), truth in held_out.items():
        point = performance(pulse, volts)
        full = max(abs(x[0]) for (v, _), x in held_out.items() if v == volts)
        square += (point.thrust - truth[0]) ** 2 / len(held_out)
        share = max(share, abs(point.thrust - truth[0]) / full)
        amperes = max(amperes, abs(point.current - truth[1]))
        watts, rpm = max(watts, abs(point.power - truth[2])), max(rpm, abs(point.rpm - truth[3]))
    return [
        below(f"thrust at {len(held_out)} held-out points, root mean square", sqrt(square), 0.2, "N"),
        below("worst thrust (share of full)", share, 0.022),
        below("worst current", amperes, 0.5, "A"),
        below("worst power", watts, 8.0, "W"),
        below("worst speed of the propeller", rpm, 60.0, "1/min"),
    ]


SHEETS = [Sheet("Thrusters: T200", t200)]
