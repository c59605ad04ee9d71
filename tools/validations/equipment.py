"""Fins, hull lift, cross flow and the buoyancy engine, compared with theory."""

from collections.abc import Sequence
from math import atan2, cos, degrees, pi, sin, sqrt
from random import Random

from matplotlib.axes import Axes

from sim.dynamics import Dynamics, State
from sim.vehicle.body_lift import CrossFlow, CrossFlowDrag, HullLift, Lift
from sim.vehicle.fins import lift_slope
from sim.vehicle.vehicle import load_vehicle
from tests.unit.sim.vehicle import test_ballast as ballast
from tests.unit.sim.vehicle import test_surfaces as held
from tests.unit.sim.vehicle.test_surfaces import RHO, RUDDER, wrench
from tools.validations.sheet import SHADES, Finding, Sheet, below, label, near, plot_own, plot_ref

BROADSIDE = 1.17  # Hoerner's square plate


# -- fins -------------------------------------------------------------------------------------------------------------


def fins(panels: Sequence[Axes]) -> list[Finding]:
    """Left: a rudder of aspect ratio 2. Below the stall at 17° it has Helmbold's lift slope and induced drag. Above
    29° it has the lift and drag of a flat plate. Right: the lift slope from a very low aspect ratio (Jones) to an
    infinite one."""
    polar, slopes = panels
    return [*_polar(polar), *_slopes(slopes), _power()]


def _polar(axes: Axes) -> list[Finding]:
    polar = RUDDER.polar
    angles = [0.005 * i for i in range(315)]
    coefficients = [polar.at(angle) for angle in angles]
    plot_own(axes, [degrees(a) for a in angles], [lift for lift, _ in coefficients], "ours, lift", SHADES[0])
    plot_own(axes, [degrees(a) for a in angles], [drag for _, drag in coefficients], "ours, drag", SHADES[2])
    wing, plate = [0.05 * i for i in range(7)], [0.5 + 0.05 * i for i in range(22)]
    lift = [polar.lift_slope * a for a in wing] + [0.5 * BROADSIDE * sin(2.0 * a) for a in plate]
    drag = [0.01 + (polar.lift_slope * a) ** 2 / (pi * 0.9 * 2.0) for a in wing]
    drag += [0.01 + BROADSIDE * sin(a) ** 2 for a in plate]
    plot_ref(axes, [degrees(a) for a in wing + plate], lift, "theory: wing, flat plate")
    plot_ref(axes, [degrees(a) for a in wing + plate], drag, "_")
    label(axes, "angle of attack (deg)", "coefficient", legend="upper left")
    highest = 0.6 * pi / (1.0 + sqrt(2.0))
    return [
        near("lift coefficient at 0.3 rad", polar.at(0.3)[0], highest, rel=1e-6),
        near("stalled, at 0.55 rad", polar.at(0.55)[0], 0.5 * BROADSIDE * sin(1.1), rel=1e-6),
    ]


def _slopes(axes: Axes) -> list[Finding]:
    ratios = [0.05 * 1.15**i for i in range(72)]
    plot_own(axes, ratios, [lift_slope(ratio) for ratio in ratios])
    stubs, wings = [r for r in ratios[::3] if r < 0.5], [r for r in ratios[::3] if r > 200.0]
    plot_ref(axes, stubs, [0.5 * pi * ratio for ratio in stubs], "theory: short (Jones), thin aerofoil")
    plot_ref(axes, wings, [2.0 * pi for _ in wings], "_")
    axes.set_xscale("log")
    label(axes, "aspect ratio", "lift slope (1/rad)", legend="upper left")
    return [
        near("lift slope of aspect ratio 10 000 (2π)", lift_slope(1e4), 2.0 * pi, "1/rad", rel=1e-3),
        near("lift slope of aspect ratio 0.1 (Jones)", lift_slope(0.1), 0.05 * pi, "1/rad", rel=1e-2),
    ]


def _power() -> Finding:
    """Return the largest power of a fin's force, relative to its parts, over random fins and flows."""
    random, worst = Random(5), -1.0
    for make in held.forces():
        for _ in range(400):
            scale = 10.0 ** random.uniform(-6.0, 1.0)
            nu = [scale * random.gauss(0.0, 1.0) for _ in range(6)]
            parts = [a * b for a, b in zip(wrench(make(random), *nu), nu, strict=True)]
            worst = max(worst, sum(parts) / sum(map(abs, parts)))
    what = "power of fins, hulls and cross flow in 2000 random flows, largest (share; never above 0)"
    return below(what, worst, 1e-12)


# -- hull -------------------------------------------------------------------------------------------------------------

HULL = Lift(0.2, aspect_ratio=0.2, parasitic_drag=0.05, position=(-0.3, 0.0, 0.0))


def hull(panels: Sequence[Axes]) -> list[Finding]:
    """A slender hull at 2 m/s. First: lift and drag over its angle to the flow, up to the stall at 34°. Second: the
    Munk moment, which separation of the flow reduces to a share. Third: the drag of strips in cross flow. Its yaw
    moment grows with L⁴."""
    lift, munk, cross = panels
    return [*_lift(lift), _munk(munk), *_cross_flow(cross)]


def _lift(axes: Axes) -> list[Finding]:
    angles = [0.01 * i for i in range(90)]
    across, along = zip(*(_hull_force(angle) for angle in angles), strict=True)
    plot_own(axes, [degrees(a) for a in angles], across, "ours, lift", SHADES[0])
    plot_own(axes, [degrees(a) for a in angles], along, "ours, drag", SHADES[2])
    dots = [0.06 * i for i in range(11)]
    expected = [_hull_theory(angle) for angle in dots]
    for values, name in zip(zip(*expected, strict=True), ("theory, before stall", "_"), strict=True):
        plot_ref(axes, [degrees(a) for a in dots], values, name)
    label(axes, "angle of the flow (deg)", "force (N)", "hull lift", legend="upper left")
    force, (up, drag) = _hull_force(0.1), _hull_theory(0.1)
    return [
        near("lift of the hull at 0.1 rad", force[0], up, "N", rel=1e-6),
        near("its drag", force[1], drag, "N", rel=1e-6),
    ]


def _hull_force(angle: float) -> tuple[float, float]:
    """Return the force (N) across and along the flow."""
    u, w = 2.0 * cos(angle), 2.0 * sin(angle)
    x, _, z, *_ = wrench(HullLift(HULL, RHO), u, 0.0, w)
    turn = atan2(w, u)
    return x * sin(turn) - z * cos(turn), -x * cos(turn) - z * sin(turn)


def _hull_theory(angle: float) -> tuple[float, float]:
    size, lift = 0.5 * RHO * 4.0 * 0.2, lift_slope(0.2) * angle
    return size * lift, size * (0.05 + lift**2 / (pi * 0.3 * 0.2))


def _munk(axes: Axes) -> Finding:
    vehicle, _ = load_vehicle("remus100")
    ideal = vehicle.added_mass[1] - vehicle.added_mass[0]
    sways, worst = [0.05 * i for i in range(9)], 0.0
    for share, color in zip((1.0, 0.4, 0.0), SHADES, strict=False):
        dynamics = Dynamics(vehicle._replace(munk_share=(1.0, share, share)), RHO, 9.8)
        moments = [_moment_to_broadside(dynamics, 1.5, sway) for sway in sways]
        theory = [share * ideal * 1.5 * sway for sway in sways]
        worst = max(worst, *(abs(a - b) / (ideal * 1.5 * sways[-1]) for a, b in zip(moments, theory, strict=True)))
        plot_own(axes, sways, moments, f"ours, share {share:g}", color)
        plot_ref(axes, sways, theory, "theory" if share == 0.0 else "_")
    label(axes, "sway at 1.5 m/s ahead (m/s)", "moment to broadside (N m)", "Munk moment", legend="upper left")
    return below("Munk moment away from its share of the ideal one (share)", worst, 1e-6)


def _moment_to_broadside(dynamics: Dynamics, surge: float, sway: float) -> float:
    state = State((0.0, 0.0, 50.0), nu=(surge, sway, 0.0, 0.0, 0.0, 0.0))
    forces = dynamics.forces(state, (0.0,) * 6, (0.0, 0.0, 0.0))
    return -(forces.coriolis[5] + forces.others[5])


def _cross_flow(axes: Axes) -> list[Finding]:
    drag = CrossFlowDrag(CrossFlow((1.1,)), (2.0, 0.2, 0.3), RHO)
    rates = [0.05 * i for i in range(21)]
    yaw = [-wrench(drag, 0.0, 0.0, 0.0, 0.0, 0.0, r)[5] for r in rates]
    side = [-wrench(drag, 1.0, v)[1] for v in rates]
    plot_own(axes, rates, yaw, "ours, moment by yaw rate", SHADES[0])
    plot_own(axes, rates, [0.1 * y for y in side], "ours, force by sway / 10", SHADES[2])
    theory = [0.5 * RHO * 1.1 * 0.3 * r * r * 2.0**4 / 32.0 for r in rates]
    sideways = [0.5 * RHO * 1.1 * 0.3 * 2.0 * v * v for v in rates]
    plot_ref(axes, rates[::2], theory[::2], "theory")
    plot_ref(axes, rates[::2], [0.1 * y for y in sideways[::2]], "_")
    label(axes, "yaw rate (rad/s) or sway (m/s)", "drag (N m or N / 10)", "cross flow", legend="upper left")
    return [
        near("yaw drag of the strips at 0.7 rad/s", yaw[14], theory[14], "N m", rel=0.005),
        near("sway drag at 0.4 m/s", side[8], sideways[8], "N", rel=1e-6),
    ]


# -- ballast ----------------------------------------------------------------------------------------------------------

DRAG = 601.27  # N s²/m² of Tethys' hull in heave


def buoyancy_engine(panels: Sequence[Axes]) -> list[Finding]:
    """Tethys fills and empties its bladder, and rises and sinks at the speed at which its drag equals this lift."""
    (axes,) = panels
    vehicle = ballast.BARE._replace(buoyancy_engine=ballast.ENGINE._replace(rate=1e-4))
    simulation = ballast.at_sea(vehicle, 200.0)
    times, speeds, findings = [0.0], [0.0], []
    for pulse, volume, sign, name in ((1900, 455e-6, 1.0, "full"), (1100, 420e-6, -1.0, "empty")):
        command = ballast.idle(vehicle, buoyancy_engine=pulse)
        for _ in range(600):
            for _ in range(20):
                simulation.step(command)
            times.append(1e-9 * simulation.time_ns)
            speeds.append(-simulation.state.nu[2])
        theory = sign * sqrt(1025.0 * 9.8 * volume / DRAG)
        plot_ref(axes, times[-350::50], [theory] * 7, "theory: √(lift / drag)" if sign > 0.0 else "_")
        findings.append(near(f"bladder {name}: speed up", speeds[-1], theory, "m/s", rel=1e-3))
    plot_own(axes, times, speeds)
    label(axes, "time (s)", "speed up (m/s)", "bladder full, then empty", legend="upper right")
    axes.set_ylim(-0.11, 0.15)
    return findings


SHEETS = [
    Sheet("Fins", fins),
    Sheet("Slender hulls", hull, columns=3, size=(9.5, 2.9)),
    Sheet("Buoyancy engine", buoyancy_engine, columns=1, size=(5.5, 2.8)),
]
