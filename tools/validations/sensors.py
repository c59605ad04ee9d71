"""Errors of sensors, compared with theory."""

from collections.abc import Sequence
from math import cos, degrees, radians
from statistics import fmean

from matplotlib.axes import Axes

from sim.dynamics import State
from sim.environment.world import World
from sim.rotations import from_euler
from sim.sensors.error import ErrorModel
from sim.sensors.mounting import Mounting
from sim.sensors.ranging.dvl import Dvl, DvlModel
from sim.simulation import Simulation
from sim.vehicle.vehicle import load_vehicle
from tools.validations.sheet import (
    Finding,
    Sheet,
    above,
    label,
    near,
    plot_own,
    plot_ref,
    wrong,
)

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
    Sheet("Sensors: DVL altitude", dvl, columns=1, size=(5.0, 3.0)),
]
