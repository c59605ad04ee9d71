"""A hull at the surface compared with theory: period of bobbing, and continuous buoyancy."""

from collections.abc import Sequence
from itertools import pairwise
from math import cos, pi, sqrt

from matplotlib.axes import Axes

from sim.dynamics import Dynamics, Integrator, State
from sim.rotations import from_euler, matrix
from sim.vehicle.buoyancy import Hull
from tests.unit.sim.vehicle import test_buoyancy as floats
from tools.validations.sheet import SHADES, WRONG, Finding, Sheet, above, below, label, plot_own, plot_ref

HEIGHT, AMPLITUDE, DT = 0.234, 0.02, 0.001


def surface(panels: Sequence[Axes]) -> list[Finding]:
    """A box floats half out of the water, without drag. It is released 2 cm too deep. Then it bobs with a period of 2π
    √((m + m_a) / (ρ g A)), and its energy is constant. In a widely used simulator the lift jumps from none to half of
    the full lift where the middle passes the surface. Here the lift is continuous in every attitude."""
    trace, periods, lift = panels
    return [*_bobbing(trace, periods), _bobbing_energy(), *_lift(lift)]


def _theory(added: float) -> float:
    vehicle = floats.float_()
    return 2.0 * pi * sqrt((vehicle.mass + added) / (floats.RHO * floats.G * vehicle.volume / HEIGHT))


def _bob(added: float, integrator: Integrator = "verlet") -> list[float]:
    """Return the depths (m) every millisecond for 6 s."""
    vehicle = floats.float_(added_mass=(5.0, 5.0, added, 0.1, 0.1, 0.1))
    dynamics = Dynamics(vehicle, floats.RHO, floats.G, integrator)
    state, depths = State((0.0, 0.0, AMPLITUDE)), [AMPLITUDE]
    for _ in range(6000):
        dynamics.step(state, floats.NOTHING, floats.STILL, DT)
        depths.append(state.position[2])
    return depths


def _period(depths: list[float]) -> float:
    crossings = [(i + a / (a - b)) * DT for i, (a, b) in enumerate(pairwise(depths)) if a > 0.0 >= b]
    return (crossings[-1] - crossings[0]) / (len(crossings) - 1)


def _bobbing(trace: Axes, periods: Axes) -> list[Finding]:
    masses = [0.0, 9.24, 20.0, 40.0, 60.0]
    runs = {added: _bob(added) for added in masses}
    measured = {added: _period(depths) for added, depths in runs.items()}
    for added, color in ((9.24, SHADES[0]), (60.0, SHADES[2])):
        plot_own(
            trace, [i * DT for i in range(2501)], [1e3 * z for z in runs[added][:2501]], f"ours, {added:g} kg", color
        )
        times = [0.05 * i for i in range(51)]
        cosine = [1e3 * AMPLITUDE * cos(2.0 * pi * t / _theory(added)) for t in times]
        plot_ref(trace, times, cosine, "theory" if added == 60.0 else "_")
    trace.set_ylim(-24.0, 40.0)
    label(trace, "time (s)", "depth (mm)", "bobbing, by added mass", legend="upper right")
    plot_own(periods, masses, list(measured.values()))
    plot_ref(periods, masses, [_theory(added) for added in masses], "theory", size=8.0)
    label(periods, "added mass (kg)", "period (s)")
    away = max(abs(_period(_bob(m, "rk4")) / _theory(m) - 1.0) for m in (0.0, 9.24, 60.0))
    away = max(away, *(abs(measured[m] / _theory(m) - 1.0) for m in (0.0, 9.24, 60.0)))
    return [below("bobbing: period away from theory (share)", away, 1e-4)]


def _bobbing_energy() -> Finding:
    """Return the largest change of a bobbing vehicle's energy within 100 s, with the default integrator."""
    vehicle = floats.float_(linear_damping=(0.0, 0.0, 0.0, 0.5, 0.5, 0.5))
    dynamics, state, worst = Dynamics(vehicle, floats.RHO, floats.G), State((0.0, 0.0, 0.08)), 0.0
    rest_energy = floats.energy(dynamics, State())
    first = floats.energy(dynamics, state) - rest_energy
    for _ in range(100):
        for _ in range(400):
            dynamics.step(state, floats.NOTHING, floats.STILL, 0.0025)
        worst = max(worst, abs((floats.energy(dynamics, state) - rest_energy) / first - 1.0))
    return below("energy gained or lost in 100 s (share)", worst, 0.001)


def _lift(axes: Axes) -> list[Finding]:
    hull = Hull(floats.float_(), floats.RHO, floats.G)
    depths = [-0.3 + 0.0001 * i for i in range(6001)]
    red, jumps = [floats.others_lift(depth, HEIGHT, 1.0) for depth in depths], []
    axes.plot(depths, red, color=WRONG, linewidth=3.0, alpha=0.7, label="others")
    for attitude, name, color in (
        (floats.LEVEL, "ours, level", SHADES[0]),
        (matrix(from_euler(0.7, -0.4, 0.2)), "ours, heeled 40°", SHADES[2]),
    ):
        shares = [hull.buoyancy(depth, attitude)[0] / hull.full for depth in depths]
        plot_own(axes, depths, shares, name, color)
        jumps.append(floats.largest_jump(shares))
    axes.set_xlim(-0.25, 0.25)
    label(axes, "depth of the middle (m)", "lift (share of full)", "lift", legend="upper left")
    return [
        below("largest jump of lift in 0.1 mm, ours (share of full)", max(jumps), 0.002),
        above("the same, others", floats.largest_jump(red), 0.49),
    ]


SHEETS = [Sheet("Afloat: bobbing and lift", surface, columns=3, size=(9.0, 2.8))]
