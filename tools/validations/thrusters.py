"""Thrusters compared with tables of their manufacturers and with theory."""

from collections.abc import Callable, Sequence
from math import cos, exp, sin, sqrt, tanh

from matplotlib.axes import Axes

from sim.assembly import make_thrusters
from sim.vehicle.thrusters.t200 import performance
from sim.vehicle.vehicle import load_vehicle
from tests.unit.sim import test_remus as remus
from tests.unit.sim.vehicle import test_thruster_curves as curves
from tests.unit.sim.vehicle.test_thruster_lags import BESSA, FULL, PI, YOERGER, run
from tools.validations.sheet import SHADES, Finding, Sheet, above, below, label, plot_own, plot_ref, wrong

# -- T200 -------------------------------------------------------------------------------------------------------------


def t200(panels: Sequence[Axes]) -> list[Finding]:
    """The T200 compared with its manufacturer's table for 10 to 20 V. The simulator has every fifth pulse width of the
    table. The dots are points of the table that it does not have."""
    thrust, current = panels
    held_out = curves.held_out_points()
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


# -- advance speed ----------------------------------------------------------------------------------------------------


def advance(panels: Sequence[Axes]) -> list[Finding]:
    """A propeller loses thrust with the speed of the water through it. Left: the propeller of the REMUS 100
    compared with MSS. Right: a propeller at many speeds, ahead and astern, as thrust coefficient over advance ratio."""
    remus_panel, coefficient = panels
    return [_remus_propeller(remus_panel), _open_water(coefficient)]


def _remus_propeller(axes: Axes) -> Finding:
    speeds, worst = [0.1 * i for i in range(31)], 0.0
    for n, color in zip((10.0, 17.0, 25.0), reversed(SHADES), strict=False):
        ahead = [[speed, 0.0, 0.0, 0.0, 0.0, 0.0] for speed in speeds]
        thrusts = [remus.our_propeller(n, nu)[0] for nu in ahead]
        expected = [remus.their_propeller(n, nu)[0] for nu in ahead]
        plot_own(axes, speeds, thrusts, f"ours, {n:g} rev/s", color)
        plot_ref(axes, speeds[::3], expected[::3], "MSS" if n == 25.0 else "_")
        worst = max(worst, *(abs(a / b - 1.0) for a, b in zip(thrusts, expected, strict=True)))
    label(axes, "speed ahead (m/s)", "thrust (N)", "REMUS 100", legend="upper right")
    return below("REMUS 100's propeller ahead, away from MSS (share)", worst, 1e-12)


def _open_water(axes: Axes) -> Finding:
    thruster = curves.curved(**curves.CURVES[2])._replace(max_forward=1e3, max_reverse=1e3, position=(0.0, 1.0, 0.0))
    thrusters = make_thrusters(load_vehicle("paper_six")[0]._replace(thrusters=(thruster,)), 0.01)
    worst, diameter = 0.0, 0.076
    for pulse, n, kt, color in ((1900, 58.9, 0.43, SHADES[0]), (1100, -58.9, 0.34, SHADES[2])):
        ratios, coefficients, expected = [], [], []
        for step in range(-8, 17):
            u, r = 0.2 * step, 0.03 * step
            thrusters.step((pulse,), (u, 9.0, 9.0, 0.0, 0.0, r))
            ratios.append((u - r) / (n * diameter))
            coefficients.append(thrusters.thrusts[0] / (1025.0 * diameter**4 * n * abs(n)))
            expected.append(kt - 0.5 * ratios[-1])
        worst = max(worst, *(abs(a / b - 1.0) for a, b in zip(coefficients, expected, strict=True)))
        plot_own(axes, ratios, coefficients, "ours, forward" if n > 0.0 else "ours, reverse", color)
        plot_ref(axes, ratios[::2], expected[::2], "KT0 - α J" if n > 0.0 else "_")
    label(axes, "advance ratio J", "thrust coefficient KT", "0.076 m, 58.9 rev/s")
    return below("thrust coefficient away from KT0 - alpha J (share)", worst, 1e-6)


# -- lags -------------------------------------------------------------------------------------------------------------

DTS = (0.0005, 0.0025, 0.01, 0.05)


def lags(panels: Sequence[Axes]) -> list[Finding]:
    """The speed of a rotor after full command from rest. Ours is solved exactly over a step, so a step of 50 ms
    ends where steps of 0.5 ms end. uuv_simulator does not update its previous time. So each of its steps is as long
    as the whole time since the start, and the models of Yoerger and Bessa diverge."""
    findings = [
        *_lag(panels[0], "Yoerger", YOERGER, (0.0, 0.05), lambda t: FULL * tanh(0.05 * FULL * t)),
        *_lag(panels[1], "Bessa", BESSA, (5.0, 0.04), _bessa),
    ]
    _pi_rotor(panels[2])
    away = max(abs(run({**PI, "load": 0.0}, dt, [(1900, 0.05)])[0] / _pi(0.05) - 1.0) for dt in DTS[:3])
    return [*findings, below("rotor under PI control, away from theory (share)", away, 1e-9)]


def _bessa(t: float) -> float:
    k1, k2 = 5.0, 0.04
    r = FULL + k1 / k2
    fade = FULL / r * exp(-k2 * (FULL + r) * t)
    return (FULL - r * fade) / (1.0 + fade)


def _pi(t: float) -> float:
    damping, stiffness = 20.0, 500.0
    w = sqrt(stiffness - damping**2 / 4.0)
    return FULL - FULL * exp(-damping / 2.0 * t) * (cos(w * t) - damping / (2.0 * w) * sin(w * t))


def _lag(
    axes: Axes, name: str, model: dict[str, object], rates: tuple[float, float], theory: Callable[[float], float]
) -> list[Finding]:
    """Draw and check one of the models that uuv_simulator has too."""
    times = [0.005 * i for i in range(61)]
    plot_own(axes, times, [0.0, *run(model, 0.0025, [(1900, 0.005)] * 60)])
    plot_ref(axes, times[::3], [theory(t) for t in times[::3]], "theory")
    red = [_others_speed(rates, FULL, 0.01, 0.01 * i - 0.005) for i in range(31)]
    wrong(axes, [0.01 * i for i in range(31)], red, "uuv_simulator as published")
    axes.set_ylim(-500.0, 1300.0)
    label(axes, "time (s)", "rotor (rad/s)", name, legend="upper left")
    away = max(abs(run(model, dt, [(1900, 0.05)])[0] / theory(0.05) - 1.0) for dt in DTS)
    end = abs(_others_speed(rates, FULL, 0.01, 0.6))
    return [
        below(f"{name}, steps of 0.5 to 50 ms, away from theory (share)", away, 1e-12),
        above(f"{name} as published, within 0.6 s", end, 1e6, "rad/s"),
    ]


def _pi_rotor(axes: Axes) -> None:
    times = [0.01 * i for i in range(51)]
    plot_own(axes, times, [0.0, *run({**PI, "load": 0.0}, 0.0025, [(1900, 0.01)] * 50)], "ours, no load", SHADES[0])
    plot_own(axes, times, [0.0, *run(PI, 0.0025, [(1900, 0.01)] * 50)], "ours, load", SHADES[2])
    plot_ref(axes, times[::2], [_pi(t) for t in times[::2]], "theory, no load")
    label(axes, "time (s)", "rotor (rad/s)", "PI speed control", legend="lower right")


def _others_speed(rates: tuple[float, float], target: float, dt: float, end: float) -> float:
    """Return the speed by uuv_simulator's Euler step (Dynamics.cc, commit of 2020-06).

    As published it never updates its previous time, so each step is as long as all the time since the start.
    """
    k1, k2 = rates
    speed, time = 0.0, 0.0
    while time < end and abs(speed) < 1e6:
        time += dt
        speed += time * (k1 * (target - speed) + k2 * (target * abs(target) - speed * abs(speed)))
    return speed


SHEETS = [
    Sheet("Thrusters: T200", t200),
    Sheet("Thrusters: advance speed", advance),
    Sheet("Thrusters: lags", lags, columns=3, size=(9.5, 2.8)),
]
