"""What a current does to a vehicle."""

from collections.abc import Sequence
from math import dist

from matplotlib.axes import Axes

from sim.dynamics import Dynamics, State
from sim.rotations import from_euler, rotate, rotate_inverse
from tests.support.flights.runge_kutta import RungeKutta
from tests.support.flights.von_benzon import LeftOut
from tests.unit.sim.test_dynamics import DEEP, HEAVY, NOTHING, STILL
from tools.validations.sheet import SHADES, WRONG, Finding, Sheet, below, label, plot_own, plot_ref, wrong

CURRENT = (0.4, -0.3, 0.1)


def carried(panels: Sequence[Axes]) -> list[Finding]:
    """Galileo's principle: relative to the water, motion in a steady current is the same as in still water. Left: the
    same run in both. The vehicle starts with speeds on all axes, and a constant wrench acts on it. Red: the same
    without the term for the water's velocity in turning axes. Right: a drifting vehicle gets the speed of the current.
    In HoloOcean it stays at rest."""
    apart, adrift = panels
    ends = {}
    runs: tuple[tuple[type[Dynamics], bool, str, str], ...] = (
        (RungeKutta, True, "turning left out (RK4)", WRONG),
        (Dynamics, False, "ours, Verlet, 2 ms", SHADES[2]),
        (RungeKutta, False, "ours, RK4, 2 ms", SHADES[0]),
    )
    for method, left_out, name, color in runs:
        away = _apart(method, left_out)
        apart.semilogy([0.1 * (i + 1) for i in range(len(away))], away, color=color, label=name)
        ends[name] = away[-1]
    label(apart, "time (s)", "distance of the two (m)", legend="center right")
    return [
        below("seen from the water, RK4, 4 s: distance", ends["ours, RK4, 2 ms"], 1e-8, "m"),
        below("the same, Verlet", ends["ours, Verlet, 2 ms"], 5e-5, "m"),
        _adrift(adrift),
    ]


def _apart(method: type[Dynamics], left_out: bool) -> list[float]:
    """Return the distances (m) between the carried vehicle and the one in calm water, each 0.1 s of 4 s."""
    q, nu = from_euler(0.3, -0.2, 0.9), [0.5, -0.2, 0.1, 0.4, -0.3, 0.8]
    moving = [a + b for a, b in zip(nu[:3], rotate_inverse(q, CURRENT), strict=True)] + nu[3:]
    calm, moved = State((0.0, 0.0, DEEP), q, nu), State((0.0, 0.0, DEEP), q, moving)
    still = method(HEAVY, 1000.0, 9.82)
    flowing = method(HEAVY, 1000.0, 9.82, [LeftOut(CURRENT)] if left_out else [])
    wrench, away = (20.0, 5.0, 0.0, 0.0, 0.0, 1.0), []
    for step in range(1, 2001):
        still.step(calm, wrench, STILL, 0.002)
        flowing.step(moved, wrench, CURRENT, 0.002)
        if step % 50 == 0:
            drifted = [x - c * 0.002 * step for x, c in zip(moved.position, CURRENT, strict=True)]
            away.append(max(dist(drifted, calm.position), 1e-16))
    return away


def _adrift(axes: Axes) -> Finding:
    current, state = (0.3, -0.2, 0.0), State((0.0, 0.0, DEEP), from_euler(0.0, 0.0, 1.0))
    dynamics = Dynamics(HEAVY._replace(neutrally_buoyant=True), 1000.0, 9.82)
    speeds = [(0.0, 0.0, 0.0)]
    for _ in range(120):
        for _ in range(200):
            dynamics.step(state, NOTHING, current, 0.0025)
        speeds.append(rotate(state.quaternion, state.nu[:3]))
    times = [0.5 * i for i in range(121)]
    for axis, name, color in ((0, "ours, north", SHADES[0]), (1, "ours, east", SHADES[2])):
        plot_own(axes, times, [speed[axis] for speed in speeds], name, color)
        plot_ref(axes, times[::8], [current[axis]] * len(times[::8]), "the water" if axis else "_")
    wrong(axes, times, [0.0] * len(times), "HoloOcean")
    axes.set_ylim(-0.25, 0.6)
    label(axes, "time (s)", "speed over ground (m/s)", legend="upper right")
    away = max(abs(a - b) for a, b in zip(speeds[-1], current, strict=True))
    return below("adrift for a minute: speed away from the water's", away, 0.02, "m/s")


SHEETS = [Sheet("Carried by a current", carried)]
