"""The rigid body: energy of a turning body."""

from collections.abc import Sequence
from itertools import pairwise

from matplotlib.axes import Axes

from sim.dynamics import Dynamics, Integrator, State
from sim.forces import Force
from sim.matrices import Matrix
from sim.rotations import Rotation, from_euler
from sim.simulation import Simulation
from sim.vehicle.vehicle import load_vehicle
from tests.unit.sim.test_dynamics import DEEP, NOTHING, STILL, undamped
from tests.unit.sim.vehicle import test_surfaces as surfaces
from tools.validations.sheet import SHADES, Finding, Sheet, above, below, label, plot_own, plot_ref, ticks, wrong

Energies = list[float]


def kinetic(mass: Matrix, nu: Sequence[float]) -> float:
    """Return the kinetic energy in J."""
    return 0.5 * sum(v * sum(m * x for m, x in zip(row, nu, strict=True)) for row, v in zip(mass, nu, strict=True))


# -- energy -----------------------------------------------------------------------------------------------------------

UNEVEN = [10.0, 1, 0, 0, 0, 0.5, 1, 20, 2, 0, 0, 0, 0, 2, 30, 0, 0, 0,
          0, 0, 0, 5, 0.3, 0, 0, 0, 0, 0.3, 15, 1, 0.5, 0, 0, 0, 1, 25]  # fmt: skip


class WrongSign:
    """Force that a wrong sign in the Coriolis matrix of the added mass adds: X gets -A22 v r instead of +A22 v r."""

    def __init__(self, sway_mass: float) -> None:
        self._twice = 2.0 * sway_mass

    def begin(self, time_ns: int) -> None:
        """Do nothing: the force does not change with time."""

    def wrench(self, position: Sequence[float], rotation: Rotation, nu_r: Sequence[float]) -> list[float]:
        """Return the wrench (N, N m) that the wrong sign adds."""
        return [-self._twice * nu_r[1] * nu_r[5], 0.0, 0.0, 0.0, 0.0, 0.0]


def energy(panels: Sequence[Axes]) -> list[Finding]:
    """Left: a body with an asymmetric mass matrix turns without drag. Both integrators conserve its energy, Verlet at
    2.5 ms to 1e-4 in 10 s. Red: the same body with the wrong sign that the Coriolis matrix of gz-sim had until April
    2026. Right: torpedoes with deflected fins start with speeds on all axes, without thrust. Their energy falls in
    every step."""
    free, thrown = panels
    return [*_free_body(free), _thrown(thrown)]


def _turning(integrator: Integrator, dt: float, forces: Sequence[Force] = ()) -> Energies:
    """Return kinetic energy over that of the start, every 0.1 s for 10 s, or until it has grown a hundredfold."""
    dynamics = Dynamics(undamped(UNEVEN), 1000.0, 9.8, integrator, forces)
    state = State((0.0, 0.0, DEEP), from_euler(0.3, 0.2, 0.1), (1.5, -0.3, 0.7, 0.4, -0.9, 1.4))
    start, shares = kinetic(dynamics.mass, state.nu), [1.0]
    for _ in range(100):
        for _ in range(round(0.1 / dt)):
            dynamics.step(state, NOTHING, STILL, dt)
        shares.append(kinetic(dynamics.mass, state.nu) / start)
        if shares[-1] > 100.0:
            break
    return shares


def _free_body(axes: Axes) -> list[Finding]:
    times = [0.1 * i for i in range(101)]
    energies = _turning("rk4", 0.01)
    plot_own(axes, times, energies, "ours, RK4, 10 ms", SHADES[0])
    plot_own(axes, times, _turning("verlet", 0.0025), "ours, Verlet, 2.5 ms", SHADES[2])
    plot_ref(axes, times[::5], [1.0] * len(times[::5]), "theory")
    red = _turning("rk4", 0.01, [WrongSign(19.5)])
    wrong(axes, times[: len(red)], red, "a wrong sign in C")
    axes.set_ylim(0.4, 2.2)
    label(axes, "time (s)", "kinetic energy over the start's", "free body", legend="upper right")
    nu = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]
    power = abs(WrongSign(2.0).wrench((), (0.0,) * 9, nu)[0] * nu[0])
    return [
        below("free body, RK4: energy gained or lost in 10 s (share)", abs(energies[-1] - 1.0), 1e-8),
        above("power made by the wrong sign, M_A = diag(1..6), nu = (1..6)", power, 40.0, "W"),
    ]


def _thrown(axes: Axes) -> Finding:
    worst = 0.0
    for name, color in zip(surfaces.TORPEDOES, SHADES, strict=True):
        energies = _tumble(name)
        times = [0.005 * i for i in range(len(energies))]
        axes.semilogy(times, [e / energies[0] for e in energies], color=color, label=f"ours, {name}")
        worst = max(worst, *(after / before for before, after in pairwise(energies)))
    ticks(axes.yaxis, (0.05, 0.1, 0.2, 0.5, 1.0))
    label(axes, "time (s)", "kinetic energy over the start's", "without thrust", legend="lower left")
    what = "torpedoes without thrust: largest ratio of the energies after and before a step"
    return Finding(what, f"1 - {1.0 - worst:.1e}", "< 1", worst < 1.0)


def _tumble(name: str) -> Energies:
    """Return the energies of a tumbling vehicle without buoyancy, as the test starts it."""
    vehicle, _ = load_vehicle(name)
    vehicle = vehicle._replace(neutrally_buoyant=True, center_of_buoyancy=vehicle.center_of_gravity)
    vehicle = vehicle._replace(fins=tuple([fin._replace(straightening=1.0) for fin in vehicle.fins]))
    simulation = Simulation(
        vehicle, surfaces.SEA, {}, dt_ns=5_000_000, position=surfaces.DEEP, integrator="rk4"
    )  # fmt: skip
    simulation.state.nu = [1.5, 0.3, -0.2, 0.1, 0.05, -0.1]
    mass = Dynamics(vehicle, surfaces.RHO, 9.8).mass
    pulses = [1500] * len(vehicle.thrusters) + [1700] * len(vehicle.fins)
    pulses += [1500] * (len(vehicle.channels) - len(pulses))
    energies = [kinetic(mass, simulation.state.nu)]
    for _ in range(1000):
        simulation.step(pulses)
        energies.append(kinetic(mass, simulation.state.nu))
    return energies


SHEETS = [
    Sheet("Energy of what turns", energy),
]
