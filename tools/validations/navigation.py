"""A reference filter (examples/navigation) with named devices, and how far it drifts."""

from collections.abc import Iterator, Sequence
from math import sqrt
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from examples.navigation.reference_filter import ReferenceFilter, matrix
from sim import load_device
from sim.dynamics import State
from sim.environment.world import World
from sim.rotations import from_euler
from sim.sensors.mounting import Mounting
from sim.simulation import Simulation
from sim.vehicle.vehicle import load_vehicle
from tools.validations.sheet import SHADES, Finding, Sheet, below, label, near, plot_own

Array = NDArray[np.float64]
SEA = World("sea", "made for this", (-2000.0, 2000.0, -2000.0, 2000.0), 45.0)
PERIOD, FINE = 0.1, 20  # s between samples of the IMU, and steps between them
STEPS = 1, 5, 5, 20  # between samples of IMU, DVL, pressure and USBL
START_SD = 0.05  # m
LEG = 50.0  # s, of which the last 15 are a turn of 90 deg


class Track(NamedTuple):
    """States of a vehicle every PERIOD: a lawn mower's track with changes of speed, depth, roll and pitch."""

    states: list[State]
    distance: float


def make_track(seconds: float) -> Track:
    """Return a track of this length."""
    dt = PERIOD / FINE
    t = np.arange(round(seconds / dt) + 1) * dt
    in_leg = t % LEG - (LEG - 15.0)
    side = np.where((t // LEG).astype(int) // 2 % 2, -1.0, 1.0)
    rate = np.where(in_leg > 0.0, side * np.pi / 15.0 * np.sin(np.pi * in_leg / 15.0) ** 2, 0.0)
    heading = 0.3 + _integral(rate, dt)
    roll, pitch = 0.06 * np.sin(2.0 * np.pi * t / 11.0), 0.05 * np.sin(2.0 * np.pi * t / 17.0)
    speed = (1.0 + 0.4 * np.sin(2.0 * np.pi * t / 70.0)) * np.minimum(1.0, t / 5.0)
    sink = 0.15 * np.sin(2.0 * np.pi * t / 45.0)
    velocity = np.array([speed * np.cos(heading), speed * np.sin(heading), sink])
    position = np.array([_integral(x, dt) for x in velocity])
    position[2] += 15.0
    acceleration = np.gradient(velocity, dt, axis=1)
    droll, dpitch = np.gradient(roll, dt), np.gradient(pitch, dt)
    states = []
    for i in range(0, len(t), FINE):
        q = from_euler(roll[i], pitch[i], heading[i])
        to_body = matrix(q).T
        s, c, sp, cp = np.sin(roll[i]), np.cos(roll[i]), np.sin(pitch[i]), np.cos(pitch[i])
        turn = [droll[i] - rate[i] * sp, dpitch[i] * c + rate[i] * s * cp, -dpitch[i] * s + rate[i] * c * cp]
        v = to_body @ velocity[:, i]
        state = State(tuple(position[:, i].tolist()), q, (*v.tolist(), *[float(x) for x in turn]))
        state.nu_dot = [*(to_body @ acceleration[:, i] - np.cross(turn, v)).tolist(), 0.0, 0.0, 0.0]
        states.append(state)
    return Track(states, float(_integral(speed, dt)[-1]))


def _integral(values: Array, dt: float) -> Array:
    return np.concatenate([[0.0], np.cumsum(0.5 * dt * (values[1:] + values[:-1]))])


class Errors(NamedTuple):
    """Error of the position (m) at one time; squares of all errors of the motion, weighted by their covariance."""

    position: Array
    squared: float


def run(devices: Sequence[str], track: Track, seed: int) -> Iterator[Errors]:
    """Run the filter with `devices` (IMU, DVL, pressure, perhaps a USBL) along a track; yield the errors each LEG."""
    scene = Simulation(load_vehicle("bluerov2_heavy")[0], SEA, {}, position=(0.0, 0.0, 15.0))
    specs = [
        spec._replace(model=spec.model._replace(rate=1.0 / (PERIOD * step)))
        for spec, step in zip(map(load_device, devices), STEPS, strict=False)
    ]
    specs[0] = specs[0]._replace(mounting=Mounting())  # the axes of the vehicle are those of its IMU
    sensors: list[Any] = [spec.build(seed, scene) for spec in specs]
    imu, dvl, pressure, usbl = [*specs, None][:4]
    found = ReferenceFilter(imu, dvl, pressure, usbl, SEA.gravity, SEA.density)
    handlers = [found.on_imu, found.on_dvl, found.on_pressure, found.on_usbl]
    start = np.random.default_rng(seed).normal(track.states[0].position, START_SD)
    found.start(sensors[0].sample(0, track.states[0]), start.tolist(), START_SD)
    for i, state in enumerate(track.states[1:], 1):
        for sensor, handle, step in zip(sensors, handlers, STEPS, strict=False):
            sample = sensor.sample(round(i * PERIOD * 1e9), state) if i % step == 0 else None
            if sample is not None:
                handle(sample)
        if i % round(LEG / PERIOD) == 0:
            yield _errors(found, state)


def _errors(found: ReferenceFilter, state: State) -> Errors:
    true = matrix(state.quaternion)
    turn = found.axes.T @ true
    attitude = 0.5 * np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])
    position = np.array(state.position) - found.position
    error = np.concatenate([position, true @ np.array(state.nu[:3]) - found.velocity, attitude])
    covariance = found.covariance[:9, :9]
    return Errors(position, float(error @ np.linalg.solve(covariance, error)))


DEVICES = {  # IMU, velocity log, depth, and perhaps a USBL; the greatest drift that a page may state, in %
    "VN-100, A50, Bar30": (("vectornav_vn100", "waterlinked_a50", "bar30"), 4.0),
    "KVH 1750, Pathfinder, PA-33X": (("kvh_1750", "teledyne_pathfinder", "keller_pa33x"), 1.0),
    "ICM-20948, A125, Bar30": (("icm20948", "waterlinked_a125", "bar30"), 6.0),
    "VN-100, A50, Bar30, X150": (("vectornav_vn100", "waterlinked_a50", "bar30", "seatrac_x150"), 1.5),
}
RUNS, LASTS = 12, 150.0


def reference_filter(panels: Sequence[Axes]) -> list[Finding]:
    """The reference filter (examples/navigation) with named devices, 12 runs of 150 s each, along a lawn mower's track.
    Left: the squared errors of position, velocity and attitude, weighted by the filter's covariance. Their mean is 9 if
    the covariance is right; the lines are the bounds of 99 % of such means. Right: horizontal error of the position,
    root mean square. Without acoustic positions, it grows with the distance, mostly by the error of the heading."""
    from scipy.stats import chi2

    squares, drift = panels
    track = make_track(LASTS)
    low, high = [float(chi2.ppf(share, 9 * RUNS)) / RUNS for share in (0.005, 0.995)]
    findings = []
    for (name, (devices, most)), color in zip(DEVICES.items(), SHADES, strict=True):
        runs = [[*run(devices, track, seed)] for seed in range(RUNS)]
        nees = [float(np.mean([errors.squared for errors in each])) for each in zip(*runs, strict=True)]
        off = [sqrt(np.mean([e.position[:2] @ e.position[:2] for e in each])) for each in zip(*runs, strict=True)]
        times = [LEG * (i + 1) for i in range(len(nees))]
        plot_own(squares, times, nees, name, color)
        plot_own(drift, times, off, name, color)
        findings += [
            near(f"{name}: mean of the squares", nees[-1], 0.5 * (low + high), within=0.5 * (high - low)),
            below(f"{name}: off, in percent of distance", 100.0 * off[-1] / track.distance, most, "%"),
        ]
    for bound in (low, 9.0, high):
        squares.axhline(bound, color="k", linestyle=":", linewidth=0.8)
    label(squares, "time (s)", "weighted squares", legend="lower right")
    label(drift, "time (s)", "error of the position (m)", legend="upper left")
    return findings


SHEETS = [Sheet("Devices: reference filter", reference_filter)]
