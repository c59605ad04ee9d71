"""Surface vessels compared with the models and data that they are from."""

from collections.abc import Sequence

from matplotlib.axes import Axes

from sim.simulation import Simulation
from sim.vehicle.hydrostatics import afloat
from tests.unit.sim.vehicle import test_vessels as held
from tools.validations.sheet import SHADES, Finding, Sheet, below, label, near, plot_own, plot_ref

PVS = "PythonVehicleSimulator"


def _run(left: float, right: float, seconds: float = 10.0) -> list[tuple[float, float, float]]:
    """Return time (s), surge (m/s) and yaw rate (rad/s) every 0.1 s, with propellers at these speeds (rad/s)."""
    simulation, rows = Simulation(held.OTTER, held.SEA), [(0.0, 0.0, 0.0)]
    while simulation.time_ns < seconds * 1e9:
        for _ in range(40):
            simulation.step((held.pulse(left), held.pulse(right)))
        rows.append((simulation.time_ns * 1e-9, simulation.state.nu[0], simulation.state.nu[5]))
    return rows


def _draw(axes: Axes, speeds: Sequence[tuple[float, float]], column: int) -> float:
    """Draw runs and the reference's values; return the largest difference as a share."""
    worst = 0.0
    for (left, right), colour in zip(speeds, SHADES, strict=False):
        rows = _run(left, right)
        plot_own(axes, [row[0] for row in rows], [row[column] for row in rows], f"{left:g} and {right:g} rad/s", colour)
        dots = [(run[2], run[3 if column == 1 else 5]) for run in held.RUNS if run[:2] == (left, right)]
        plot_ref(axes, [time for time, _ in dots], [value for _, value in dots], "")
        worst = max(worst, *[abs(rows[round(10.0 * time)][column] / value - 1.0) for time, value in dots])
    return worst


def otter(panels: Sequence[Axes]) -> list[Finding]:
    """Runs from rest, the left and the right propeller at constant speeds. The dots are from the equations of
    PythonVehicleSimulator with the payload of MSS. Its own counts the payload's lever arms twice, which is 6 % too much
    inertia and damping in yaw, and presses the hull down by a weight that the displacement has already: it is 9 %
    faster at 60 rad/s, trimmed by the bow. Draught and metacentric heights are those of MSS. The Heron's rated speed
    and draught are Clearpath's."""
    surge = _draw(panels[0], ((60.0, 60.0), (100.0, 100.0), (100.0, 80.0), (-80.0, -80.0)), 1)
    yaw = _draw(panels[1], ((100.0, 80.0), (80.0, -60.0)), 2)
    label(panels[0], "time (s)", "u (m/s)", f"dots: {PVS}", legend="")
    label(panels[1], "time (s)", "r (rad/s)", "", legend="lower right")
    floating, loaded = afloat(held.OTTER, 1025.0, held.G), afloat(held.HERON._replace(mass=39.0), 1000.0, held.G)
    assert floating
    assert loaded
    heron = Simulation(held.HERON, held.LAKE)
    for _ in range(400 * 12):
        heron.step((1900, 1900))
    return [
        below("surge: largest difference (share)", surge, 0.02),
        below("yaw rate: largest difference (share)", yaw, 0.02),
        near("Otter's draught", floating.draught, 0.19512, "m", rel=0.001),
        near("metacentric height, roll", floating.metacentres[0], 1.2325, "m", rel=0.01),
        near("metacentric height, pitch", floating.metacentres[1], 3.1113, "m", rel=0.01),
        near("Heron's draught with 10 kg of payload", loaded.draught, 0.15, "m", within=0.002),
        near("Heron's speed at full thrust", heron.state.nu[0], 1.7, "m/s", rel=0.02),
    ]


SHEETS = [Sheet("Surface vessels", otter)]
