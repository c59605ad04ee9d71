"""Errors of sensors, compared with theory."""

from collections.abc import Sequence
from math import cos, degrees, exp, radians, sqrt
from random import Random
from statistics import fmean

from matplotlib.axes import Axes

from sim.dynamics import State
from sim.environment.world import World
from sim.rotations import from_euler
from sim.sensors.error import ErrorModel, ErrorProcess
from sim.sensors.mounting import Mounting
from sim.sensors.ranging.dvl import Dvl, DvlModel
from sim.simulation import Simulation
from sim.vehicle.vehicle import load_vehicle
from tools.validations.sheet import (
    SHADES,
    Finding,
    Sheet,
    above,
    below,
    label,
    near,
    plot_own,
    plot_ref,
    wrong,
)

# -- Allan deviation --------------------------------------------------------------------------------------------------

DENSITY, SIZE, TIME = 3.394e-4, 0.0735, 10.0
RATE, SECONDS = 50.0, 8000.0


def allan(panels: Sequence[Axes]) -> list[Finding]:
    """The Allan deviation of 8000 s at 50 Hz, computed by allantools, compared with theory (IEEE Std 952): white
    noise, a Gauss-Markov bias with a time constant of 10 s, and both together as in an IMU."""
    white, bias = panels
    taus = [0.04 * 1.5**i for i in range(22)]
    deviations = _deviation(ErrorModel(noise_density=DENSITY), taus)
    plot_own(white, taus, deviations)
    plot_ref(white, taus, [_white(tau) for tau in taus], "theory: N / √τ")
    away = {"white": [abs(a / _white(tau) - 1.0) for a, tau in zip(deviations, taus, strict=True) if 0.08 < tau < 11.0]}
    for density, color, name in ((0.0, SHADES[0], "bias"), (0.05, SHADES[2], "bias and noise")):
        deviations = _deviation(ErrorModel(bias=SIZE, bias_time=TIME, noise_density=density), taus)
        theory = [sqrt(_gauss_markov(tau) ** 2 + density**2 / tau) for tau in taus]
        plot_own(bias, taus, deviations, f"ours, {name}", color)
        plot_ref(bias, taus, theory, "_" if density else "theory: Gauss-Markov, and N / √τ")
        away[name] = [abs(a / b - 1.0) for a, b, tau in zip(deviations, theory, taus, strict=True) if 0.5 < tau < 60.0]
    for axes in panels:
        axes.loglog()
    label(white, "averaging time τ (s)", "Allan deviation (rad/s)", "white noise", legend="upper right")
    label(bias, "averaging time τ (s)", "Allan deviation (m/s²)", "wandering bias", legend="lower right")
    return [
        below("white noise, 0.1 to 10 s, away from theory (share)", max(away["white"]), 0.06),
        below("bias, 0.5 to 60 s", max(away["bias"]), 0.12),
    ]


def _deviation(model: ErrorModel, taus: list[float]) -> list[float]:
    process = ErrorProcess(model, 1.0 / RATE, Random(11))
    values = [process.measure(0.0) for _ in range(round(SECONDS * RATE))]
    import allantools  # here: it loads all of scipy's statistics

    used, deviations, _, _ = allantools.oadev(values, rate=RATE, data_type="freq", taus=taus)
    taus[:] = [float(tau) for tau in used]
    return [float(x) for x in deviations]


def _white(tau: float) -> float:
    return DENSITY / sqrt(tau)


def _gauss_markov(tau: float) -> float:
    shape = 1.0 - TIME / (2.0 * tau) * (3.0 - 4.0 * exp(-tau / TIME) + exp(-2.0 * tau / TIME))
    return SIZE * sqrt(2.0 * TIME / tau * shape)


# -- DVL --------------------------------------------------------------------------------------------------------------


def dvl(panels: Sequence[Axes]) -> list[Finding]:
    """A tilted DVL 20 m above the seabed. Its altitude is the distance to the plane through the ends of the beams.
    uuv_simulator gives the mean of the slant ranges, which is at least 10 % too much."""
    (axes,) = panels
    log = _log()
    tilts = [radians(0.5 * i) for i in range(61)]
    red = [_mean_slant(log, _tilted(tilt, 0.0)) for tilt in tilts]
    altitudes = [log.sample(0, _tilted(tilt, 0.0)).altitude for tilt in tilts]
    wrong(axes, [degrees(tilt) for tilt in tilts], red, "mean slant range (uuv_simulator)")
    plot_own(axes, [degrees(tilt) for tilt in tilts], altitudes, "ours, altitude")
    plot_ref(axes, [degrees(tilt) for tilt in tilts[::4]], [20.0] * 16, "true height")
    slant = 20.0 / cos(radians(25.0))
    axes.axhline(slant, color="k", linestyle=":", linewidth=0.8, label="20 m / cos 25°")
    axes.set_ylim(18.0, 34.0)
    label(axes, "roll (deg)", "distance (m)", legend="upper left")
    askew = _tilted(radians(8.0), radians(-6.0))
    return [
        near("altitude at 8 deg of roll, -6 deg of pitch", log.sample(0, askew).altitude, 20.0, "m", rel=1e-6),
        above("mean slant range there", _mean_slant(log, askew), 1.09 * 20.0, "m"),
    ]


def _log() -> Dvl:
    world = World("sea", "made for this", (-9.0, 9.0, -9.0, 9.0), 25.0)
    scene = Simulation(load_vehicle("bluerov2_heavy")[0], world, {}, position=(0.0, 0.0, 5.0))
    exact = ErrorModel()
    return Dvl(DvlModel(velocity=exact, range=exact, accuracy=exact), Mounting(), 1, scene)


def _tilted(roll: float, pitch: float) -> State:
    return State((0.0, 0.0, 5.0), from_euler(roll, pitch, 0.4), (0.7, -0.2, 0.1, 0.0, 0.0, 0.0))


def _mean_slant(log: Dvl, state: State) -> float:
    return fmean([distance for distance in log._ranges(state) if distance is not None])


SHEETS = [
    Sheet("Sensors: Allan deviation", allan),
    Sheet("Sensors: DVL altitude", dvl, columns=1, size=(5.0, 3.0)),
]
