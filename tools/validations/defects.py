"""Wrong formulas of other software that the other sheets do not show."""

from collections.abc import Sequence
from math import exp
from random import Random
from statistics import fmean, pstdev

from matplotlib.axes import Axes

from sim.dynamics import Dynamics, State
from sim.sensors.error import ErrorModel, ErrorProcess
from sim.vehicle.vehicle import Vehicle
from tests.unit.sim.test_known_defects import DEEP, HEAVY, NOTHING, STILL
from tools.validations.sheet import OURS, SHADES, WRONG, Finding, Sheet, above, label, near, plot_own, plot_ref, wrong


def defects(panels: Sequence[Axes]) -> list[Finding]:
    """Left: position noise of the reference paper, a exp(µ²/(2 c²)), is never below a. Middle: quadratic drag with
    abs() of whole numbers, as in gz-sim before April 2026, vanishes below 1 m/s. Right: with one mean added mass
    for all axes, as in Stonefish, heave starts too fast."""
    noise, drag, start = panels
    return [*_noise(noise), _drag(drag), *_start(start)]


def _noise(axes: Axes) -> list[Finding]:
    a, random = 0.1, Random(1)
    red = [a * exp(random.gauss(0.0, 1.0) ** 2 / 2.0) for _ in range(20_000)]
    process = ErrorProcess(ErrorModel(noise=a), 0.1, Random(1))
    green = [process.measure(0.0) for _ in range(20_000)]
    bins = [-0.4 + 0.02 * i for i in range(61)]
    axes.hist(red, bins, color=WRONG, alpha=0.6, label="the paper's eq. 10")
    axes.hist(green, bins, color=OURS, histtype="step", label="ours")
    label(axes, "error of position (m)", "samples", "noise of 0.1 m", legend="upper right")
    return [
        near("noise of 0.1 m: sd of ours", pstdev(green), a, "m", rel=0.02),
        near("its mean", fmean(green), 0.0, "m", within=4.0 * a / 20_000**0.5),
        above("the paper's: largest error", max(red), 50.0 * a, "m"),
    ]


def _drag(axes: Axes) -> Finding:
    dynamics = Dynamics(HEAVY, 1000.0, 9.8)
    speeds = [0.02 * i for i in range(121)]

    def quadratic(u: float) -> float:
        return -dynamics.forces(State((0.0, 0.0, DEEP), nu=[u] + [0.0] * 5), NOTHING, STILL).quadratic_damping[0]

    wrong(axes, speeds, [141.0 * int(abs(u)) * u for u in speeds], "gz-sim, abs() of whole numbers")
    plot_own(axes, speeds, [quadratic(u) for u in speeds])
    plot_ref(axes, speeds[::10], [141.0 * u * u for u in speeds[::10]], "theory: 141 u²")
    label(axes, "speed ahead (m/s)", "quadratic drag (N)", "BlueROV2 Heavy", legend="upper left")
    return near("quadratic drag at 0.5 m/s", quadratic(0.5), 141.0 * 0.25, "N", rel=1e-6)


def _start(axes: Axes) -> list[Finding]:
    mean = sum(HEAVY.added_mass[:3]) / 3.0
    averaged = HEAVY._replace(added_mass=(mean,) * 3 + HEAVY.added_mass[3:])
    times = [0.02 * i for i in range(51)]
    for axis, name, color in ((0, "surge", SHADES[2]), (2, "heave", SHADES[0])):
        plot_own(axes, times, _run(HEAVY, axis), f"ours, {name}", color)
        wrong(axes, times, _run(averaged, axis), f"one mean, {name}", "-" if axis else "--")
    label(axes, "time (s)", "speed (m/s)", "10 N, from rest", legend="lower right")
    weight = (13.5 - 13.4) * 9.82
    own, other = _first(HEAVY), _first(averaged)
    return [
        near("heave: first acceleration", own, (10.0 + weight) / 32.18, "m/s²", rel=1e-6),
        above("with one mean added mass, of that", other / own, 1.3),
    ]


def _run(vehicle: Vehicle, axis: int) -> list[float]:
    dynamics, state, speeds = Dynamics(vehicle, 1000.0, 9.82), State((0.0, 0.0, DEEP)), [0.0]
    for _ in range(50):
        for _ in range(8):
            dynamics.step(state, [10.0 if i == axis else 0.0 for i in range(6)], STILL, 0.0025)
        speeds.append(state.nu[axis])
    return speeds


def _first(vehicle: Vehicle) -> float:
    state = State((0.0, 0.0, DEEP))
    Dynamics(vehicle, 1000.0, 9.82).step(state, (10.0, 10.0, 10.0, 0.0, 0.0, 0.0), STILL, 1e-6)
    return state.nu_dot[2]


SHEETS = [Sheet("Others' defects", defects, columns=3, size=(9.5, 2.8))]
