"""REMUS 100 compared with the model that its numbers are from: MSS (T. I. Fossen), remus100.m, run in GNU Octave."""

from collections.abc import Sequence
from math import degrees, dist, radians, sqrt

from matplotlib.axes import Axes

from sim.dynamics import Dynamics
from sim.forces import Force
from sim.vehicle.body_lift import CrossFlowDrag, SlowDamping
from sim.vehicle.fins import FinSet
from tests.unit.sim import test_remus as held
from tests.unit.sim.test_remus import GRAVITY, REMUS, SAMPLES, Run, Six, add, rows_of
from tools.validations.sheet import OURS, Finding, Sheet, below, label, near, plot_own, plot_ref

AXES = ("surge", "sway", "heave", "roll", "pitch", "yaw")
SHARES = (0.013, 0.098, 0.072, 0.010, 0.096, 0.139)  # as in the test
MSS = "MSS, Octave"


# -- derivatives ------------------------------------------------------------------------------------------------------


def _with_their_terms() -> float:
    """Return the largest difference with their five terms in place of ours."""
    dynamics, worst = Dynamics(REMUS, 1026.0, GRAVITY, forces=[held.hull_of(REMUS)]), 0.0
    for sample in SAMPLES:
        if sample.nu_r[0] > 0.0:
            wrench = add(
                held.their_propeller(sample.n, sample.nu),
                held.their_fins(sample.rudder, sample.planes, sample.nu_r),
                held.their_cross_flow(sample.nu_r),
                held.their_surge_damping(sample.nu, sample.nu_r),
            )
            slope = sample.slope_of(dynamics, wrench)
            differences = [abs(a - b) / max(1.0, abs(b)) for a, b in zip(slope, sample.slope, strict=True)]
            worst = max(worst, *differences)
    return worst


def _with_ours() -> list[Six]:
    """Return the derivatives of the samples without a current, with all terms ours."""
    assert REMUS.cross_flow
    fins, slopes = FinSet(REMUS.fins, 1026.0, 0.01), []
    cross = CrossFlowDrag(REMUS.cross_flow, REMUS.dimensions, 1026.0)
    assert REMUS.fading_damping
    forces: list[Force] = [held.hull_of(REMUS), cross, fins, SlowDamping(REMUS.fading_damping)]
    dynamics = Dynamics(REMUS, 1026.0, GRAVITY, forces=forces)
    for sample in SAMPLES[:100]:
        fins.servos.values = [sample.rudder, sample.planes]
        slopes.append(sample.slope_of(dynamics, held.our_propeller(sample.n, sample.nu_r)))
    return slopes


def remus_derivatives(panels: Sequence[Axes]) -> list[Finding]:
    """State derivatives at random states, ours over those of MSS. On the black line both are the same. Five terms
    differ, which sim/vehicles/remus100.toml lists. With the five terms of MSS in place of ours all derivatives are the
    same to the last digits, except for one state of 300, with a flow from astern. With ours the root mean square
    differs by the shares below. Most of it is cross-flow drag: ours combines sway and heave, MSS computes each
    separately."""
    slopes = _with_ours()
    findings = [below("with their five terms in place of ours", _with_their_terms(), 1e-8)]
    for axis, (axes, name, share) in enumerate(zip(panels, AXES, SHARES, strict=True)):
        x, y = [sample.slope[axis] for sample in SAMPLES[:100]], [row[axis] for row in slopes]
        ends = [min(x), max(x)]
        axes.plot(x, y, ".", color=OURS, markersize=4, label="ours")
        axes.plot(ends, ends, "k-", linewidth=0.7, label="the same as MSS")
        unit = "m/s²" if axis < 3 else "rad/s²"
        label(axes, f"MSS ({unit})", f"ours ({unit})", name, legend="")
        away = sqrt(sum((a - b) ** 2 for a, b in zip(x, y, strict=True)) / sum(a * a for a in x))
        findings.append(near(f"{name}, all terms ours: share away from MSS", away, share, within=0.001))
    return findings[::-1]


# -- manoeuvres -------------------------------------------------------------------------------------------------------


def manoeuvres(panels: Sequence[Axes]) -> list[Finding]:
    """Four manoeuvres with the same inputs, without lags. Our circle is wider: our rudder uses only the
    surge speed, the reference's also the sway speed."""
    surge, circle, zigzag, dive = panels
    return [*_turning_circle(circle), *_surge_step(surge), *_zigzag(zigzag), *_dive(dive)]


def _surge_step(axes: Axes) -> list[Finding]:
    run, rows, speeds = Run(1525.0, 0.0), rows_of("surge_step_1525rpm"), [0.0]
    for _ in range(10 * (len(rows) - 1)):
        run.step(0.1)
        speeds.append(run.nu[0])
    plot_own(axes, [0.1 * i for i in range(101)], speeds[:101])
    plot_ref(axes, [row["t"] for row in rows[:11]], [row["u"] for row in rows[:11]], MSS)
    label(axes, "time (s)", "u (m/s)", "1525 rpm from rest", legend="lower right")
    away = max(abs(a - row["u"]) for a, row in zip(speeds[::10], rows, strict=True))
    return [
        near("speed at 1525 rpm", speeds[-1], rows[-1]["u"], "m/s", within=0.001),
        below("surge step: furthest in a minute", away, 0.015, "m/s"),
    ]


def _turning_circle(axes: Axes) -> list[Finding]:
    run, rows, track = Run(1200.0, 1.5), rows_of("turning_circle_r20"), [(0.0, 0.0)]
    for second in range(140):
        run.step(1.0, rudder=20.0 if second >= 20 else 0.0)
        track.append((run.position[0], run.position[1]))
    last = rows[-1]
    shown = slice(15, 65)
    plot_own(axes, [east for _, east in track[shown]], [north for north, _ in track[shown]])
    plot_ref(axes, [row["y"] for row in rows[shown]], [row["x"] for row in rows[shown]], MSS)
    axes.set_aspect("equal", "datalim")
    label(axes, "east (m)", "north (m)", "20° of rudder at 1200 rpm", legend="center")
    radius, mss = sqrt(sum(x * x for x in run.nu[:3])) / run.nu[5], last["U"] / last["r"]
    what = f"radius of the circle, {100.0 * (radius / mss - 1.0):.1f} % wider than the {mss:.2f} m of MSS"
    return [
        near(what, radius, 10.95, "m", within=0.02),
        near("its sway speed, of theirs", run.nu[1] / last["v"], 1.0, rel=0.01),
    ]


def _zigzag(axes: Axes) -> list[Finding]:
    run, rows = Run(1200.0, 1.5), rows_of("zigzag20_20")
    run.step(20.0)
    side, times, headings, away = 20.0, [20.0], [run.euler[2]], 0.0
    for k in range(1, 2501):
        run.step(0.04, rudder=side)
        times.append(20.0 + 0.04 * k)
        headings.append(run.euler[2])
        if k % 25 == 0:
            row = rows[20 + k // 25]
            away = max(away, dist(run.position[:2], (row["x"], row["y"])))
        if headings[-1] * side > radians(20.0) * 20.0:
            side = -side
    plot_own(axes, times[:1251], [degrees(x) for x in headings[:1251]])
    plot_ref(axes, [row["t"] for row in rows[20:71]], [degrees(row["psi"]) for row in rows[20:71]], MSS)
    label(axes, "time (s)", "heading (deg)", "zig-zag 20/20", legend="")
    return [
        near("zig-zag: greatest heading", degrees(max(headings)), degrees(0.3876), "deg", within=degrees(0.006)),
        below("its place after 230 m", away, 1.5, "m"),
    ]


def _dive(axes: Axes) -> list[Finding]:
    run, rows, depths = Run(1200.0, 1.5), rows_of("dive_s05"), [0.0]
    for second in range(80):
        run.step(1.0, planes=5.0 if second >= 20 else 0.0)
        depths.append(run.position[2] - 50.0)
    plot_own(axes, list(range(81)), depths)
    plot_ref(axes, [row["t"] for row in rows[::4]], [row["z"] for row in rows[::4]], MSS)
    axes.invert_yaxis()
    label(axes, "time (s)", "depth (m)", "5° of planes", legend="")
    return [near("depth after a dive of 60 s", depths[-1], rows[-1]["z"], "m", rel=0.005)]


SHEETS = [
    Sheet("REMUS 100: manoeuvres", manoeuvres, columns=4, size=(9.5, 2.7)),
    Sheet("REMUS 100: derivatives", remus_derivatives, columns=6, size=(10.0, 2.2)),
]
