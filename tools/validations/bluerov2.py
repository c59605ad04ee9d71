"""BlueROV2 Heavy compared with the code of von Benzon et al. 2022, whose results are tests/vectors/vonbenzon_*.csv."""

from collections.abc import Iterator, Sequence
from math import degrees, pi

from matplotlib.axes import Axes

from sim import rotations
from sim.dynamics import Dynamics, State
from sim.rotations import from_euler, to_euler
from tests.support.flights.runge_kutta import RungeKutta
from tests.support.flights.von_benzon import CASES, CURRENT, DEEP, DENSITY, GRAVITY, HEAVY, LeftOut, Row, pick, rows_of
from tools.validations.sheet import SHADES, WRONG, Finding, Sheet, below, label, near, plot_own, plot_ref

STILL = (0.0, 0.0, 0.0)
REFERENCE = "others' code, Octave"


def difference(values: Sequence[float], expected: Sequence[float]) -> float:
    """Return the largest difference; for expected values above 1, as a share of them. The tests use the same."""
    return max(abs(a - b) / max(1.0, abs(b)) for a, b in zip(values, expected, strict=True))


# -- derivatives ------------------------------------------------------------------------------------------------------


def apart(row: Row, like_them: bool) -> float:
    """Return the difference of our state derivative from theirs; `like_them`: without the term that theirs lacks."""
    current = pick(row, "vcN vcE vcD")
    dynamics = Dynamics(HEAVY, DENSITY, GRAVITY, forces=[LeftOut(current)] if like_them else [])
    rotation, nu = rotations.matrix(from_euler(*pick(row, "phi theta psi"))), pick(row, "u v w p q r")
    wrench = dynamics.add_forces((0.0, 0.0, DEEP), rotation, nu, pick(row, "tauX tauY tauZ tauK tauM tauN"), current)
    found = dynamics.acceleration(DEEP, rotation, nu, wrench, current)
    velocity = rotations.rotate(from_euler(*pick(row, "phi theta psi")), nu[:3])
    return difference([*found, *velocity], pick(row, "du dv dw dp dq dr dx dy dz"))


def derivatives(panels: Sequence[Axes]) -> list[Finding]:
    """State derivatives at 300 random states, forces and currents. Without a current ours are the same as the
    reference's, to its last digits. In a current the reference lacks one term: relative to the axes of a turning body,
    the velocity of the water turns. Without this term ours are the same in a current too. The red points show its size.
    Galileo's principle requires the term."""
    rows = list(rows_of("vonbenzon_fossen_xdot.csv"))
    still = sorted(apart(row, False) for row in rows if not any(pick(row, "vcN vcE vcD")))
    flowing = [row for row in rows if any(pick(row, "vcN vcE vcD"))]
    same, whole = (sorted(apart(row, like_them) for row in flowing) for like_them in (True, False))
    (axes,) = panels
    for values, color, name in (
        (still, SHADES[0], "still water"),
        (same, SHADES[2], "current, turning left out as there"),
        (whole, WRONG, "current, what the reference leaves out"),
    ):
        shares = [100.0 * (i + 1) / len(values) for i in range(len(values))]
        axes.semilogy(shares, values, ".", color=color, markersize=4, label=name)
    axes.axhline(1e-8, color="k", linewidth=0.8, linestyle=":", label="bound of the test")
    label(axes, "states, sorted (%)", "difference from theirs\n(m/s², rad/s², or share)", legend="center right")
    return [
        below(f"worst of {len(still)} in still water", still[-1], 1e-8),
        below(f"worst of {len(same)} in a current, turning left out", same[-1], 1e-8),
    ]


# -- trajectories -----------------------------------------------------------------------------------------------------

TRACK = "track"
SHOWN = {
    "surge_85N": ("85 N ahead", "u"), "sway_85N": ("85 N aside", "v"), "heave_120N": ("120 N down", "w"),
    "yaw_10Nm": ("10 N m of yaw", "r"), "roll_release_20deg": ("let go at 20° of roll", "phi"),
    "all_axes_sines": ("sines on all axes", "w"), "surge_yaw_40N_3Nm": ("40 N ahead, 3 N m of yaw", TRACK),
    "current_drift_0p3_0p2": ("adrift, 0.3 m/s N, 0.2 m/s E", TRACK),
}  # fmt: skip
KEYS = ("x", "y", "z", "phi", "theta", "psi", "u", "v", "w", "p", "q", "r")
UNITS = {"u": "m/s", "v": "m/s", "w": "m/s", "r": "rad/s", "phi": "deg"}


def fly(name: str, method: type[Dynamics], splits: int) -> Iterator[tuple[float, State]]:
    """Yield time (s) and state every 0.1 s; `splits` of our steps are one step of the reference, 0.02 s."""
    current = CURRENT if name.startswith("current") else STILL
    dynamics = method(HEAVY, DENSITY, GRAVITY, [LeftOut(current)] if any(current) else [])
    rows = reference(name)
    state = State((0.0, 0.0, DEEP), from_euler(*pick(rows[0], "phi theta psi")), pick(rows[0], "u v w p q r"))
    yield 0.0, state
    for step in range(50 * (len(rows) - 1)):
        for _ in range(splits):
            dynamics.step(state, CASES[name](0.02 * step), current, 0.02 / splits)
        if step % 5 == 4:
            yield 0.02 * (step + 1), state


def reference(name: str) -> list[Row]:
    """Return the reference trajectory, one row per second."""
    return [row for row in rows_of("vonbenzon_fossen_trajectories.csv") if row["case"] == name]


def numbers(state: State) -> dict[str, float]:
    """Return the values of a state by the column names of the reference."""
    values = [*state.position[:2], state.position[2] - DEEP, *to_euler(state.quaternion), *state.nu]
    return dict(zip(KEYS, values, strict=True))


def furthest(name: str, flown: list[tuple[float, dict[str, float]]]) -> float:
    """Return the largest difference of any of the twelve values at any second."""
    worst = 0.0
    for (_, values), row in zip(flown[::10], reference(name), strict=True):
        for key, value in values.items():
            off = value - float(row[key])
            if key in ("phi", "theta", "psi"):
                worst = max(worst, abs((off + pi) % (2.0 * pi) - pi))
            else:
                worst = max(worst, abs(off) / max(1.0, abs(float(row[key]))))
    return worst


def trajectories(panels: Sequence[Axes]) -> list[Finding]:
    """Eight runs of 15 to 40 s. The dots are from the Runge-Kutta code of others, with steps of 0.02 s, one dot a
    second. The lines are our equations with that method. The difference is the largest in position, attitude and
    speeds."""
    same_steps = fine = 0.0
    for axes, (name, (title, key)) in zip(panels, SHOWN.items(), strict=True):
        flown = [(t, numbers(state)) for t, state in fly(name, RungeKutta, 1)]
        same_steps = max(same_steps, furthest(name, flown))
        fine = max(fine, furthest(name, [(t, numbers(state)) for t, state in fly(name, Dynamics, 8)]))
        _panel(axes, name, title, key, flown)
    return [
        below("Runge-Kutta, the same steps", same_steps, 1e-4),
        below("ours, 2.5 ms", fine, 2e-4),
    ]


def _panel(axes: Axes, name: str, title: str, key: str, flown: list[tuple[float, dict[str, float]]]) -> None:
    rows = reference(name)
    if key == TRACK:
        plot_own(axes, [s["y"] for _, s in flown], [s["x"] for _, s in flown])
        plot_ref(axes, [float(row["y"]) for row in rows], [float(row["x"]) for row in rows], REFERENCE)
        axes.set_aspect("equal", "datalim")
        label(axes, "east (m)", "north (m)", title, legend="")
        return
    scale = degrees(1.0) if key == "phi" else 1.0
    plot_own(axes, [t for t, _ in flown], [scale * s[key] for _, s in flown])
    plot_ref(axes, [float(row["t"]) for row in rows], [scale * float(row[key]) for row in rows], REFERENCE)
    shown = {"phi": "roll"}.get(key, key)
    label(axes, "time (s)", f"{shown} ({UNITS[key]})", title, legend="center" if key == "r" else "")


# -- published speeds -------------------------------------------------------------------------------------------------


def published_speeds(panels: Sequence[Axes]) -> list[Finding]:
    """Speeds under a constant force, compared with those of table 4 of the paper. The paper's own damping, (13.7 + 141
    u) u = 85 N, gives 0.729 m/s. The table prints 0.72."""
    (axes,) = panels
    findings = []
    rows = (("surge", 85.0, 0.72, 0.015), ("sway", 85.0, 0.63, 0.01), ("heave", 120.0, 0.71, 0.01))
    for axis, (name, force, published, rel) in enumerate(rows):
        times, speeds = _speeds(axis, force)
        plot_own(axes, times, speeds, f"ours, {name} {force:g} N", SHADES[axis])
        plot_ref(axes, [1.7 + 0.1 * axis], [published], "_" if axis else "table 4", size=10.0)
        axes.annotate(name, (1.7 + 0.1 * axis, published), (0, -13), textcoords="offset points", ha="center")
        what = f"{name} at {force:g} N"
        findings.append(near(what, speeds[-1], published, "m/s", rel))
    axes.set(xlim=(0.0, 2.0), ylim=(0.4, 0.78))
    label(axes, "time (s)", "speed (m/s)", legend="lower right")
    return findings


def _speeds(axis: int, force: float) -> tuple[list[float], list[float]]:
    dynamics = Dynamics(HEAVY._replace(neutrally_buoyant=axis != 2), DENSITY, GRAVITY)
    wrench = [force if i == axis else 0.0 for i in range(6)]
    state, times, speeds = State((0.0, 0.0, DEEP)), [0.0], [0.0]
    for step in range(1, 2401):
        dynamics.step(state, wrench, STILL, 0.0025)
        state.quaternion = [1.0, 0.0, 0.0, 0.0]
        times.append(0.0025 * step)
        speeds.append(state.nu[axis])
    return times, speeds


SHEETS = [
    Sheet("BlueROV2 Heavy: derivatives", derivatives, columns=1, size=(6.0, 3.0)),
    Sheet("BlueROV2 Heavy: eight trajectories", trajectories, rows=2, columns=4, size=(9.0, 4.2)),
    Sheet("BlueROV2 Heavy: published speeds", published_speeds, columns=1, size=(5.0, 3.0)),
]
