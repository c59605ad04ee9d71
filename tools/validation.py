"""Draw how the simulator stands beside others' numbers and beside theory: docs/validation.md and its pictures.

    python tools/validation.py [--out docs]

Every figure is computed anew from tests/vectors and the code; the text states what was found in that run.
The tests hold the same comparisons with bounds; this is for people who would rather look.
"""

import argparse
import csv
import statistics
import sys
from collections.abc import Callable
from itertools import pairwise
from math import exp, pi, sqrt
from pathlib import Path
from random import Random
from typing import Any

import matplotlib as mpl

mpl.use("Agg")
import matplotlib.pyplot as plt

ROOT = Path(__file__).parent.parent
sys.path.insert(0, str(ROOT))

from sim.dynamics import Dynamics, Integrator, State  # noqa: E402 - works from a bare checkout too
from sim.rotations import from_euler, matrix, to_euler  # noqa: E402
from sim.sensors.error import ErrorModel, ErrorProcess  # noqa: E402
from sim.vehicle import load_vehicle  # noqa: E402

VECTORS = ROOT / "tests" / "vectors"
HEAVY = load_vehicle("bluerov2_heavy")[0]
DENSITY, GRAVITY, DEEP = 1000.0, 9.82, 1000.0  # density and gravity of the reference's runs
STILL, NOTHING = (0.0, 0.0, 0.0), (0.0,) * 6

Row = dict[str, float]


def rows_of(name: str) -> list[Row]:
    """A vector file without its comments."""
    with (VECTORS / name).open() as file:
        lines = [line for line in file if not line.startswith("#")]
    return [{key: float(value) for key, value in row.items()} for row in csv.DictReader(lines)]


def pick(row: Row, keys: str) -> list[float]:
    """Some columns of a row."""
    return [row[key] for key in keys.split()]


def derivatives(axes: Any) -> str:
    """State derivatives at random states in still water, beside von Benzon 2022's model run in Octave."""
    dynamics = Dynamics(HEAVY, DENSITY, GRAVITY)
    differences = []
    for row in rows_of("vonbenzon_fossen_xdot.csv"):
        if any(pick(row, "vcN vcE vcD")):
            continue
        rotation = matrix(from_euler(*pick(row, "phi theta psi")))
        wrench = pick(row, "tauX tauY tauZ tauK tauM tauN")
        found = dynamics.acceleration(DEEP, rotation, pick(row, "u v w p q r"), wrench, STILL)
        theirs = pick(row, "du dv dw dp dq dr")
        scale = max(map(abs, theirs))
        differences.append(max(abs(a - b) for a, b in zip(found, theirs, strict=True)) / scale)
    axes.semilogy(sorted(differences), "o", markersize=4)
    axes.set(xlabel="state, sorted", ylabel="largest relative difference", ylim=(1e-12, 1e-6))
    return (
        f"{len(differences)} random states: median {statistics.median(differences):.0e}, worst {max(differences):.0e}"
    )


def trajectory(case: str) -> list[Row]:
    """One case of the vector file, a row a second."""
    with (VECTORS / "vonbenzon_fossen_trajectories.csv").open() as file:
        rows = list(csv.DictReader(line for line in file if not line.startswith("#")))
    return [{key: float(value) for key, value in row.items() if key != "case"} for row in rows if row["case"] == case]


def wrench_of(case: str, t: float) -> tuple[float, ...]:
    """The wrench (N, N m) of a case at `t` s; what its name says begins after a second."""
    if t < 1.0 - 1e-9:
        return NOTHING
    return {"surge_yaw_40N_3Nm": (40.0, 0.0, 0.0, 0.0, 0.0, 3.0)}.get(case, NOTHING)


def fly(case: str, integrator: Integrator, dt: float) -> list[tuple[float, State]]:
    """That trajectory, by our step."""
    rows = trajectory(case)
    dynamics = Dynamics(HEAVY, DENSITY, GRAVITY, integrator)
    state = State((0.0, 0.0, DEEP), from_euler(*pick(rows[0], "phi theta psi")), pick(rows[0], "u v w p q r"))
    states = [(0.0, _copy(state))]
    for row, after in pairwise(rows):
        for _ in range(round((after["t"] - row["t"]) / dt)):
            dynamics.step(state, wrench_of(case, row["t"]), STILL, dt)
        states.append((after["t"], _copy(state)))
    return states


def _copy(state: State) -> State:
    return State(state.position, state.quaternion, state.nu)


def roll_release(axes: Any) -> str:
    """BlueROV2 Heavy let go at 20 degrees of roll."""
    rows, ours = trajectory("roll_release_20deg"), fly("roll_release_20deg", "rk4", 0.02)
    rolls = [to_euler(state.quaternion)[0] for _, state in ours]
    axes.plot([t for t, _ in ours], [roll * 180 / pi for roll in rolls], label="ours")
    axes.plot(
        [row["t"] for row in rows], [row["phi"] * 180 / pi for row in rows], "k.", label="von Benzon 2022 in Octave"
    )
    axes.set(xlabel="time (s)", ylabel="roll (deg)")
    axes.legend(fontsize="small")
    return f"largest difference {max(abs(a - row['phi']) for a, row in zip(rolls, rows, strict=True)):.0e} rad"


def surge_and_yaw(axes: Any) -> str:
    """BlueROV2 Heavy under a constant surge force and yaw moment."""
    rows, ours = trajectory("surge_yaw_40N_3Nm"), fly("surge_yaw_40N_3Nm", "rk4", 0.02)
    axes.plot([s.position[1] for _, s in ours], [s.position[0] for _, s in ours], label="ours")
    axes.plot([row["y"] for row in rows], [row["x"] for row in rows], "k.", label="von Benzon 2022 in Octave")
    axes.set(xlabel="east (m)", ylabel="north (m)", aspect="equal")
    axes.legend(fontsize="small")
    pairs = zip(ours, rows, strict=True)
    worst = max(max(abs(s.position[0] - row["x"]), abs(s.position[1] - row["y"])) for (_, s), row in pairs)
    return f"largest difference {worst:.0e} m"


def convergence(axes: Any) -> str:
    """Error of both integrators beside the step, in the surge and yaw run."""
    name, rows = "surge_yaw_40N_3Nm", trajectory("surge_yaw_40N_3Nm")
    exact = fly(name, "rk4", 0.0025)[-1][1]
    steps = [0.1, 0.05, 0.025, 0.0125]
    orders = []
    integrators: list[tuple[Integrator, str]] = [("semi_implicit_euler", "semi-implicit Euler"), ("rk4", "RK4")]
    for integrator, label in integrators:
        ends = [fly(name, integrator, dt)[-1][1] for dt in steps]
        errors = [max(abs(a - b) for a, b in zip(end.position, exact.position, strict=True)) for end in ends]
        axes.loglog([dt * 1e3 for dt in steps], errors, "o-", label=label)
        orders.append(f"{label} of order {statistics.fmean(_orders(errors)):.1f}")
    axes.set(xlabel="step (ms)", ylabel=f"position error after {rows[-1]['t']:.0f} s (m)")
    axes.legend(fontsize="small")
    return ", ".join(orders)


def _orders(errors: list[float]) -> list[float]:
    from math import log2

    return [log2(a / b) for a, b in pairwise(errors) if b > 1e-12]


def bobbing(axes: Any) -> str:
    """A float let go above its waterline: period 2 pi sqrt((m + m_a) / (rho g A))."""
    added = 20.0
    float_ = HEAVY._replace(
        mass=10.0, volume=0.02, neutrally_buoyant=False, dimensions=(0.5, 0.4, 0.1), center_of_buoyancy=(0.0, 0.0, 0.0),
        added_mass=(1.0, 1.0, added, 1.0, 1.0, 1.0), linear_damping=NOTHING, quadratic_damping=NOTHING,
    )  # fmt: skip
    dynamics, state, dt = Dynamics(float_, DENSITY, GRAVITY), State((0.0, 0.0, 0.01)), 0.001
    depths = []
    for _ in range(8000):
        dynamics.step(state, NOTHING, STILL, dt)
        depths.append(state.position[2])
    middle = (max(depths) + min(depths)) / 2
    ups = [i for i, (a, b) in enumerate(pairwise(depths)) if a < middle <= b]
    period = (ups[-1] - ups[0]) / (len(ups) - 1) * dt
    theory = 2 * pi * sqrt((10.0 + added) / (DENSITY * GRAVITY * 0.02 / 0.1))
    axes.plot([i * dt for i in range(len(depths))], [depth * 1e3 for depth in depths])
    axes.set(xlabel="time (s)", ylabel="depth of the origin (mm)")
    return (
        f"period {period:.4f} s, theory {theory:.4f} s; amplitude of the last cycle over the first {_decay(depths):.4f}"
    )


def _decay(values: list[float]) -> float:
    third = len(values) // 3
    first, last = values[:third], values[-third:]
    return (max(last) - min(last)) / (max(first) - min(first))


def sensor_bias(axes: Any) -> str:
    """Size of a Gauss-Markov bias beside the sampling rate: ours and the formulae of others."""
    tau, size, rates = 0.5, 1.0, [10.0, 30.0, 100.0, 300.0, 1000.0]

    def ours(rate: float, count: int) -> list[float]:
        process = ErrorProcess(ErrorModel(bias=size, bias_time=tau), 1 / rate, Random(1))
        return [process.measure(0.0) for _ in range(count)]

    def scaled_with_dt(rate: float, count: int) -> list[float]:
        random, value, values = Random(1), 0.0, []
        for _ in range(count):
            value = exp(-1 / rate / tau) * value + random.gauss(0.0, sqrt(2 / tau) * size) / rate
            values.append(value)
        return values

    found = []
    models: list[tuple[Callable[[float, int], list[float]], str]] = [
        (ours, "ours (exact)"),
        (scaled_with_dt, "noise scaled with dt (hector_gazebo)"),
    ]
    for model, label in models:
        sizes = [statistics.pstdev(model(rate, round(400 * rate))) for rate in rates]
        axes.loglog(rates, sizes, "o-", label=label)
        found.append(f"{label}: {min(sizes):.2f} to {max(sizes):.2f} of the nominal")
    axes.set(xlabel="sampling rate (Hz)", ylabel="sd over nominal")
    axes.legend(fontsize="small")
    return "; ".join(found)


FIGURES: list[tuple[str, Callable[[Any], str]]] = [
    ("derivatives", derivatives),
    ("roll_release", roll_release),
    ("surge_and_yaw", surge_and_yaw),
    ("convergence", convergence),
    ("bobbing", bobbing),
    ("sensor_bias", sensor_bias),
]


def main() -> None:
    """Draw all figures and write the page."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=ROOT / "docs", help="folder of the page [%(default)s]")
    out: Path = parser.parse_args().out
    (out / "validation").mkdir(parents=True, exist_ok=True)
    page = [
        "# How the simulator stands beside others' numbers and theory",
        "",
        "Made by `python tools/validation.py`.",
        "",
    ]
    for name, draw in FIGURES:
        figure, axes = plt.subplots(figsize=(5, 3.2), layout="constrained")
        found = draw(axes)
        figure.savefig(out / "validation" / f"{name}.png", dpi=80)
        plt.close(figure)
        page += [f"**{draw.__doc__}** Found: {found}.", "", f"![{name}](validation/{name}.png)", ""]
        print(f"{name}: {found}", flush=True)
    (out / "validation.md").write_text("\n".join(page))


if __name__ == "__main__":
    main()
