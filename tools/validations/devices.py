"""Named devices, simulated and found again: what their data sheets state, from the data that they make."""

from collections.abc import Sequence
from math import degrees, hypot, sqrt
from random import Random
from statistics import fmean, median
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from sim import load_device
from sim.dynamics import State
from sim.environment.world import World
from sim.geodesy import TangentPlane
from sim.sensors.error import ErrorModel
from sim.sensors.mounting import Mounting
from sim.sensors.ranging.dvl import Dvl, DvlModel
from sim.sensors.sensor_set import SensorSpec
from sim.simulation import Simulation
from sim.twins import make_error_bank
from sim.vehicle.vehicle import load_vehicle
from tools.validations.sheet import SHADES, Finding, Sheet, above, below, label, near, plot_own, plot_ref, ticks

ORIGIN = (57.7, 11.9)
SEA = World("sea", "made for this", (-2000.0, 2000.0, -2000.0, 2000.0), 120.0, origin=ORIGIN)
RATE, SECONDS, RUNS = 5.0, 10_000.0, 8
SPEED, TRACK = 1.0, 100.0  # m/s, m


def _scene() -> Simulation:
    return Simulation(load_vehicle("bluerov2_heavy")[0], SEA, {}, position=(0.0, 0.0, 100.0))


# -- inertial units ---------------------------------------------------------------------------------------------------


def inertial(panels: Sequence[Axes]) -> list[Finding]:
    """The Allan deviation of three inertial units, warm and at rest: the mean of eight runs of 10000 s. The random walk
    is that of 0.4 s, the bias instability is the lowest deviation. Dots: white noise, and the bias instability, by the
    numbers of the device."""
    findings = []
    for axes, key, unit in zip(panels, ("angular_velocity", "acceleration"), ("rad/s", "m/s²"), strict=True):
        for name, color in zip(("icm20948", "vectornav_vn100", "kvh_1750"), SHADES, strict=False):
            model: ErrorModel = getattr(load_device(name).model, key)
            taus, deviations = _allan(model._replace(warm_up=0.0))
            plot_own(axes, taus, deviations, name, color)
            plot_ref(axes, taus, [model.noise_density / sqrt(tau) for tau in taus], "_", 2.0)
            plot_ref(axes, taus, [model.flicker] * len(taus), "_", 2.0)
            walk, what = deviations[1] * sqrt(taus[1]), "gyro" if unit == "rad/s" else "accelerometer"
            findings += [
                near(f"{name}, {what}: random walk", walk, model.noise_density, f"{unit}/√Hz", rel=0.05),
                near(f"{name}, {what}: bias instability", min(deviations), model.flicker, unit, rel=0.1),
            ]
        axes.loglog()
        label(axes, "averaging time τ (s)", f"Allan deviation ({unit})", legend="upper right")
    return findings


def _allan(model: ErrorModel) -> tuple[list[float], list[float]]:
    import allantools  # here: it loads all of scipy's statistics

    bank = make_error_bank([model] * RUNS, 1.0 / RATE, Random(5))
    still = (0.0,) * RUNS
    values = np.array([bank.measure(still) for _ in range(round(RATE * SECONDS))]).T
    taus = [0.2 * 2**i for i in range(13)]
    each = [allantools.oadev(row, rate=RATE, data_type="freq", taus=taus) for row in values]
    return [float(x) for x in each[0][0]], [sqrt(fmean(x)) for x in zip(*[run[1] ** 2 for run in each], strict=True)]


# -- velocity logs ----------------------------------------------------------------------------------------------------


def velocity_logs(panels: Sequence[Axes]) -> list[Finding]:
    """How far a position is off that adds up the velocities of a log, with the true attitude: 100 m straight ahead at 1
    m/s, 20 m above the seabed, root mean square of 40 runs. The bound follows from the accuracy and from the
    misalignment of the device. The default log has no misalignment."""
    (axes,) = panels
    names = ["default", "waterlinked_a50", "waterlinked_a125", "teledyne_pathfinder", "nortek_dvl1000"]
    findings, found, stated = [], [], []
    for name in names:
        spec = SensorSpec(Dvl, DvlModel()) if name == "default" else load_device(name)
        found.append(100.0 * _drift(spec))
        model = spec.model.accuracy
        constant = sqrt(model.scale**2 + 2.0 * (model.turn_on / SPEED) ** 2)
        stated.append(100.0 * hypot(constant, spec.mounting.misalignment))
        findings.append(near(f"{name}: off, in percent of distance", found[-1], stated[-1], "%", rel=0.3))
    plot_own(axes, range(len(names)), found)
    plot_ref(axes, range(len(names)), stated, "device")
    axes.set_xticks(range(len(names)), [name.partition("_")[2] or name for name in names])
    label(axes, "", "off (% of distance)")
    return [*findings, above("default: off", found[0], 0.1, "%")]


def _drift(spec: SensorSpec) -> float:
    """Return the distance of the position from the truth as a share of the way, root mean square of the runs."""
    scene, period = _scene(), 1.0 / spec.model.rate
    state = State((0.0, 0.0, 100.0), nu=(SPEED, 0.0, 0.0, 0.0, 0.0, 0.0))
    count, squares = round(TRACK / SPEED / period), []
    for seed in range(40):
        log: Any = spec.build(seed, scene)
        velocities = [log.sample(i, state).velocity for i in range(count)]
        north, east = [period * sum(v[axis] for v in velocities) for axis in (0, 1)]
        squares.append((north - count * period * SPEED) ** 2 + east**2)
    return sqrt(fmean(squares)) / TRACK


# -- positions --------------------------------------------------------------------------------------------------------


def positions(panels: Sequence[Axes]) -> list[Finding]:
    """Left: half of the fixes of a receiver are nearer than its circular error probable. Right: errors of an
    ultra-short baseline across the line of sight, by distance, compared with the standard deviation that its covariance
    states. That holds over the whole range if the squared errors, weighted by the covariance, have the mean 3. Outliers
    are left out here, and where the direction of the station is constant, so is a part of the error."""
    near_panel, usbl_panel = panels
    away = _fixes()
    plot_own(near_panel, sorted(away), [(i + 1) / len(away) for i in range(len(away))])
    plot_ref(near_panel, [2.0], [0.5], "circular error probable")
    label(near_panel, "distance from the truth (m)", "share of fixes", "u-blox NEO-M9N")
    findings = [near("ublox_neo_m9n: half of the fixes are within", median(away), 2.0, "m", rel=0.08)]
    for name, color, far in (("seatrac_x150", SHADES[0], 900.0), ("ugps_g2", SHADES[2], 95.0)):
        ranges = [far * share for share in (0.05, 0.2, 0.5, 1.0)]
        across, stated, squares = zip(*[_usbl(load_device(name), distance) for distance in ranges], strict=True)
        plot_own(usbl_panel, ranges, across, name, color)
        plot_ref(usbl_panel, ranges, stated, "_")
        off = max(abs(square / 3.0 - 1.0) for square in squares)
        findings.append(below(f"{name}: squared errors by covariance, away from 3 (share)", off, 0.15))
    usbl_panel.loglog()
    ticks(usbl_panel.xaxis, (5.0, 20.0, 100.0, 900.0))
    label(usbl_panel, "range (m)", "error across (m)", "USBL")
    angle = load_device("seatrac_x150").model.angle
    sd = degrees(hypot(angle.noise, angle.turn_on))
    direction = degrees(_usbl(load_device("seatrac_x150"), 500.0)[0] / 500.0)
    findings.append(near("seatrac_x150: error of the direction, each axis", direction, sd, "deg", rel=0.08))
    for name, bound in (("bar30", 0.5), ("keller_pa33x", 0.15)):
        findings.append(near(f"{name}: error of the depth at 5 m", _depth(load_device(name)), bound, "m", rel=0.12))
    return findings


def _fixes() -> list[float]:
    """Return the distances (m) of fixes from the truth."""
    spec, plane, scene = load_device("ublox_neo_m9n"), TangentPlane(*ORIGIN), _scene()
    spec = spec._replace(model=spec.model._replace(acquisition=0.0))
    (north, _, _), (_, east, _) = plane.geodetic((1.0, 0.0, 0.0)), plane.geodetic((0.0, 1.0, 0.0))
    fixes: list[Any] = [spec.build(seed, scene).sample(0, State((0.0, 0.0, -1.0))) for seed in range(800)]
    return [
        hypot((fix.latitude - ORIGIN[0]) / (north - ORIGIN[0]), (fix.longitude - ORIGIN[1]) / (east - ORIGIN[1]))
        for fix in fixes
    ]


def _usbl(spec: SensorSpec, distance: float) -> tuple[float, float, float]:
    """Return errors across the line of sight (m, of one axis), the stated one, and the mean of the squares."""
    model, scene = spec.model._replace(range=spec.model.range._replace(outliers=0.0)), _scene()
    true = np.array([0.8 * distance, 0.6 * distance, min(1.0 + 0.3 * distance, 110.0)])
    line = (true - model.station) / np.linalg.norm(true - model.station)
    spec = spec._replace(model=model, mounting=Mounting())
    samples: list[Any] = [spec.build(seed, scene).sample(0, State(tuple(true))) for seed in range(500)]
    off: NDArray[np.float64] = np.array([sample.position for sample in samples]) - true
    covariance = np.array(samples[0].covariance).reshape(3, 3)
    squares = np.einsum("ij,jk,ik->i", off, np.linalg.inv(covariance), off)
    beside = off - np.outer(off @ line, line)
    stated = (np.trace(covariance) - line @ covariance @ line) / 2.0
    return sqrt(np.mean(np.sum(beside**2, axis=1)) / 2.0), sqrt(stated), float(np.mean(squares))


def _depth(spec: SensorSpec) -> float:
    scene, squares = _scene(), []
    for seed in range(400):
        sample: Any = spec.build(seed, scene).sample(0, State((0.0, 0.0, 5.0)))
        squares.append(((sample.pascal - spec.model.atmosphere) / (SEA.density * SEA.gravity) - 5.0) ** 2)
    return sqrt(fmean(squares))


SHEETS = [
    Sheet("Devices: inertial units", inertial),
    Sheet("Devices: velocity logs", velocity_logs, columns=1, size=(5.0, 3.0)),
    Sheet("Devices: positions", positions),
]
