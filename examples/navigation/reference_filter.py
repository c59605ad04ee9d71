"""A reference filter: inertial navigation, aided by velocity log, depth, heading, and acoustic positions.

An error-state Kalman filter (Solà 2017, arXiv 1711.02508, with the errors of the attitude in body axes). It has 35
states: position, velocity and attitude; slow and fast biases of gyros and accelerometers; scale, bias and misalignment
of the velocity log; bias of the depth and of the heading; errors of the acoustic positions. Only white noise of sensors
is noise of the filter. Errors that are correlated in time are states: docs/explanation/covariances.md says why.

The numbers are those of the devices of the scenario. As a planner, it goes straight to the goal by its own position:

    [planner]
    class = "reference_filter:StraightByFilter"
    imu = "vectornav_vn100"
    dvl = "waterlinked_a50"
    pressure = "bar30"
"""

from collections import deque
from collections.abc import Sequence
from math import atan2, dist, exp, hypot, pi, remainder, sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hil import Done, Planner, PlanRequest, Samples, VelocityCommand
from sim import load_device

Array = NDArray[np.float64]

# States: errors of position (m, NED), velocity (m/s, NED), attitude (rad, body axes), and what makes the sensors err.
POSITION, VELOCITY, ATTITUDE, GYRO, FORCE, FAST_GYRO, FAST_FORCE = (slice(at, at + 3) for at in range(0, 21, 3))
SCALE, BIAS, TURN, USBL = (slice(at, at + 3) for at in range(21, 33, 3))
DEPTH, HEADING, STATES = 33, 34, 35
MOVING, INERTIAL, FAST = slice(0, 9), slice(0, 21), slice(15, 21)

GATE = {1: 15.1, 3: 21.1}  # of 10,000 good measurements, one is beyond: chi-squared with as many degrees of freedom
FLICKER = 1.661  # variance of each of the three processes of flicker noise, over the square of the bias instability
FAST_TIME = 10.0  # s: time constant of the fastest of them; the others have 100 and 1000 s
TURN_TIME = 10.0  # s: as long, errors of the scale of gyros act in one direction
HEADING_PERIOD = 1.0  # s


def white(model: Any, period: float) -> float:
    """Return the variance of the white noise of a sample."""
    return float(model.noise**2 + model.noise_density**2 / period)


def slow(model: Any) -> float:
    """Return the variance of the errors that are correlated over minutes, when the run starts."""
    return float(model.turn_on**2 + model.bias**2 + model.warm_up**2 + 2.0 * FLICKER * model.flicker**2)


def walk(model: Any, time: float) -> float:
    """Return the variance that their change adds in a second, `time` s after the start."""
    warming = model.warm_up**2 / model.warm_up_time * exp(-2.0 * time / model.warm_up_time)
    return float(2.0 * (model.bias**2 / model.bias_time + FLICKER * model.flicker**2 * (0.01 + 0.001) + warming))


class ReferenceFilter:
    """The filter. `imu`, `dvl`, `pressure` and `usbl` are devices as sim.load_device has them.

    The axes of the vehicle are those of its IMU. Gravity in m/s², density of the water in kg/m³.
    """

    def __init__(
        self, imu: Any, dvl: Any, pressure: Any, usbl: Any = None, gravity: float = 9.81, density: float = 1025.0
    ) -> None:
        self.imu, self.dvl, self.pressure, self.usbl = imu.model, dvl.model, pressure.model, usbl and usbl.model
        self._gravity, self._weight = np.array([0.0, 0.0, gravity]), density * gravity
        self._misalignment = hypot(imu.mounting.misalignment, dvl.mounting.misalignment)
        self._dvl_axes, self._dvl_at = matrix(dvl.mounting.quaternion), np.array(dvl.mounting.position)
        self._pressure_at = np.array(pressure.mounting.position)
        self._heading = self.imu.heading or self.imu.attitude
        flicker = [self.imu.angular_velocity.flicker] * 3 + [self.imu.acceleration.flicker] * 3
        self._fast = FLICKER * np.array(flicker) ** 2
        self.time_ns: int | None = None
        self.rejected = 0

    def start(self, sample: Any, position: Sequence[float], sd: float) -> None:
        """Start at rest at a known `position` (m, NED, 1 sigma `sd`), with the attitude of an IMU's sample."""
        self.time_ns = self._started_ns = self._heading_ns = sample.time_ns
        self.position, self.velocity, self.axes = np.array(position), np.zeros(3), matrix(sample.orientation)
        self.bias = np.zeros(STATES)  # of the states after those of the motion
        self._rate, self._force = np.array(sample.angular_velocity), np.array(sample.acceleration)
        self._track: deque[tuple[int, Array]] = deque(maxlen=2000)
        tilt, heading, accuracy = slow(self.imu.attitude), slow(self._heading), self.dvl.accuracy
        deep = self.pressure.error.scale * float(position[2])
        start = np.zeros(STATES)
        start[POSITION], start[VELOCITY] = sd**2, 1e-6
        start[ATTITUDE] = tilt, tilt, heading + self._heading.noise**2
        start[GYRO] = slow(self.imu.angular_velocity) + self.imu.g_sensitivity**2 * float(self._force @ self._force)
        start[FORCE] = slow(self.imu.acceleration) + (self.imu.acceleration.scale * self._force) ** 2
        start[FAST] = self._fast
        start[SCALE], start[BIAS], start[TURN] = accuracy.scale**2, slow(accuracy), self._misalignment**2
        start[DEPTH], start[HEADING] = slow(self.pressure.error) / self._weight**2 + deep**2, heading
        if self.usbl:
            start[USBL] = self.usbl.range.scale**2, slow(self.usbl.angle), slow(self.usbl.angle)
        self.covariance: Array = np.diag(start)
        # the heading that it starts with has the error that the heading sensor has
        self.covariance[8, HEADING] = self.covariance[HEADING, 8] = -heading

    def on_imu(self, sample: Any) -> None:
        """Advance the solution to the time of `sample`; take up its heading once a second."""
        assert self.time_ns is not None, "start() comes first"
        dt = (sample.time_ns - self.time_ns) * 1e-9
        if dt <= 0.0:
            return
        before = self._rate, self._force
        self._rate, self._force = np.array(sample.angular_velocity), np.array(sample.acceleration)
        rate = 0.5 * (before[0] + self._rate) - self.bias[GYRO] - self.bias[FAST_GYRO]
        force = 0.5 * (before[1] + self._force) - self.bias[FORCE] - self.bias[FAST_FORCE]
        axes, middle = self.axes, self.axes @ rotation(0.5 * dt * rate)
        acceleration = middle @ force + self._gravity
        self.position = self.position + dt * self.velocity + 0.5 * dt * dt * acceleration
        self.velocity = self.velocity + dt * acceleration
        self.axes = middle @ rotation(0.5 * dt * rate)
        self.time_ns = sample.time_ns
        self._advance_covariance(dt, rate, middle, cross_matrix(middle @ force) @ -axes)
        self._track.append((sample.time_ns, self.position))
        if sample.time_ns - self._heading_ns >= HEADING_PERIOD * 1e9:
            self._heading_ns = sample.time_ns
            self._on_heading(matrix(sample.orientation))

    def _advance_covariance(self, dt: float, rate: Array, axes: Array, felt: Array) -> None:
        """Advance the covariance; `felt` is the derivative of the acceleration by the attitude at the beginning."""
        step = np.zeros((9, 21))
        step[:, MOVING] = np.eye(9)
        step[POSITION, VELOCITY] = dt * np.eye(3)
        step[POSITION, ATTITUDE], step[POSITION, FORCE] = 0.5 * dt * dt * felt, -0.5 * dt * dt * axes
        step[VELOCITY, ATTITUDE], step[VELOCITY, FORCE] = dt * felt, -dt * axes
        step[VELOCITY, GYRO] = -0.5 * dt * dt * felt
        step[ATTITUDE, ATTITUDE], step[ATTITUDE, GYRO] = rotation(-dt * rate), -dt * np.eye(3)
        step[:, FAST] = step[:, 9:15]
        p, imu = self.covariance, self.imu
        p[MOVING] = step @ p[INERTIAL]
        p[:, MOVING] = p[:, INERTIAL] @ step.T
        time = ((self.time_ns or 0) - self._started_ns) * 1e-9
        added = np.zeros(STATES)
        turning = (imu.angular_velocity.scale * rate) ** 2 * 2.0 * TURN_TIME * dt
        added[ATTITUDE] = white(imu.angular_velocity, 1.0 / imu.rate) * dt**2 + turning
        added[VELOCITY] = white(imu.acceleration, 1.0 / imu.rate) * dt**2
        added[GYRO], added[FORCE] = dt * walk(imu.angular_velocity, time), dt * walk(imu.acceleration, time)
        added[BIAS] = dt * walk(self.dvl.accuracy, time)
        added[DEPTH] = dt * walk(self.pressure.error, time) / self._weight**2
        kept = np.ones(STATES)
        kept[FAST] = exp(-dt / FAST_TIME)
        added[FAST] = self._fast * (1.0 - kept[FAST] ** 2)
        kept[HEADING] = exp(-dt / self._heading.bias_time)
        added[HEADING] = slow(self._heading) * (1.0 - kept[HEADING] ** 2)
        self.bias *= kept
        self.covariance = p * kept * kept[:, None] + np.diag(added)

    def _on_heading(self, measured: Array) -> None:
        axes = self.axes
        off = atan2(measured[1, 0], measured[0, 0]) - atan2(axes[1, 0], axes[0, 0]) - self.bias[HEADING]
        h = np.zeros((1, STATES))
        level = axes[2, 1] ** 2 + axes[2, 2] ** 2  # the squared cosine of pitch
        h[0, ATTITUDE] = 0.0, axes[2, 1] / level, axes[2, 2] / level
        h[0, HEADING] = 1.0
        self._update(h, np.array([remainder(off, 2.0 * pi)]), np.array([[self._heading.noise**2 + 1e-8]]))

    def on_dvl(self, sample: Any) -> None:
        """Take up a velocity; its covariance without what are states here."""
        if not sample.locked:
            return
        turn, accuracy = self._dvl_axes, self.dvl.accuracy
        seen = turn @ np.array(sample.velocity)
        of_states = slow(accuracy) + (accuracy.scale * np.array(sample.velocity)) ** 2
        noise = turn @ (np.array(sample.covariance).reshape(3, 3) - np.diag(of_states)) @ turn.T
        lever = cross_matrix(self._dvl_at)
        body = self.axes.T @ self.velocity - lever @ (self._rate - self.bias[GYRO])
        expected = body * (1.0 + self.bias[SCALE]) + self.bias[BIAS] + cross_matrix(body) @ self.bias[TURN]
        h = np.zeros((3, STATES))
        h[:, VELOCITY], h[:, ATTITUDE], h[:, GYRO] = self.axes.T, cross_matrix(self.axes.T @ self.velocity), lever
        h[:, SCALE], h[:, BIAS], h[:, TURN] = np.diag(body), np.eye(3), cross_matrix(body)
        self._update(h, seen - expected, noise)

    def on_pressure(self, sample: Any) -> None:
        """Take up a depth."""
        deep = (sample.pascal - self.pressure.atmosphere) / self._weight
        h = np.zeros((1, STATES))
        h[0, 2] = h[0, DEPTH] = 1.0
        expected = self.position[2] + self.axes[2] @ self._pressure_at + self.bias[DEPTH]
        error = self.pressure.error
        noise = white(error, 1.0 / self.pressure.rate) + error.resolution**2 / 12.0
        self._update(h, np.array([deep - expected]), np.array([[noise / self._weight**2]]))

    def on_usbl(self, sample: Any) -> None:
        """Take up a position of the past: the scale of its range and its constant angles are states."""
        then = next((at for stamp, at in reversed(self._track) if stamp <= sample.time_ns), self.position)
        model, period, off = self.usbl, 1.0 / self.usbl.rate, np.array(sample.position) - self.usbl.station
        distance, level = float(np.linalg.norm(off)), hypot(off[0], off[1]) or 1e-9
        line, starboard = off / distance, np.array([-off[1], off[0], 0.0]) / level
        along = white(model.range, period) + (model.range.noise_share * distance) ** 2
        across = white(model.angle, period) * distance**2
        effects = np.column_stack([off, distance * cross_matrix(line) @ starboard, distance * starboard])
        h = np.zeros((3, STATES))
        h[:, POSITION], h[:, USBL] = np.eye(3), effects
        noise = across * np.eye(3) + (along - across) * np.outer(line, line)
        self._update(h, np.array(sample.position) - then - effects @ self.bias[USBL], noise)

    def _update(self, h: Array, residual: Array, noise: Array) -> None:
        """Correct the solution, unless the measurement is an outlier.

        An unknown turn of the world about the vertical is an error of heading, velocity and position together. The
        covariance is kept for the corrected velocity and position, as in an invariant filter (Barrau and Bonnabel 2017,
        IEEE Trans. Automatic Control 62:1797). Without this, the filter believes in a heading that nothing measures.
        """
        across = self.covariance @ h.T
        information = np.linalg.inv(h @ across + noise)
        if residual @ information @ residual > GATE[len(residual)]:
            self.rejected += 1
            return
        gain = across @ information
        change = gain @ residual
        self.covariance = self.covariance - gain @ across.T
        self.covariance = 0.5 * (self.covariance + self.covariance.T)
        reset = np.eye(9)
        reset[POSITION, ATTITUDE] = -cross_matrix(change[POSITION]) @ self.axes
        reset[VELOCITY, ATTITUDE] = -cross_matrix(change[VELOCITY]) @ self.axes
        reset[ATTITUDE, ATTITUDE] = rotation(-change[ATTITUDE])
        self.covariance[MOVING] = reset @ self.covariance[MOVING]
        self.covariance[:, MOVING] = self.covariance[:, MOVING] @ reset.T
        self.position = self.position + change[POSITION]
        self.velocity = self.velocity + change[VELOCITY]
        self.axes = self.axes @ rotation(change[ATTITUDE])
        change[MOVING] = 0.0
        self.bias += change


class StraightByFilter(Planner):
    """Goes straight to the scenario's goal at its depth, by the position that the filter finds."""

    subscriptions = ("imu", "dvl", "pressure", "usbl")

    def __init__(self, imu: str, dvl: str, pressure: str, usbl: str = "") -> None:
        devices = [load_device(name) for name in (imu, dvl, pressure, usbl) if name]
        self.filter = ReferenceFilter(*devices)
        self._handlers = {"imu": self.filter.on_imu, "dvl": self.filter.on_dvl, "pressure": self.filter.on_pressure}
        if usbl:
            self._handlers["usbl"] = self.filter.on_usbl
        self._newest: dict[str, int] = {}

    def begin(self, request: PlanRequest) -> None:
        """Take the task: the start is where the filter starts."""
        self._request = request

    def command(self, time: float, samples: Samples) -> VelocityCommand | Done:
        """Take up the new samples, and steer by the filter's position."""
        found, start, master = self.filter, self._request.start, self._request.master
        if found.time_ns is None and "imu" in samples:
            found.start(samples["imu"], (start.north, start.east, start.depth), 0.1)
        for topic, handle in self._handlers.items():
            sample = samples.get(topic)
            if found.time_ns is not None and sample and sample.time_ns > self._newest.get(topic, -1):
                self._newest[topic] = sample.time_ns
                handle(sample)
        if found.time_ns is None:
            return VelocityCommand()
        north, east, _ = found.position
        goal = master.goal or (0.0, 0.0)
        left = dist((north, east), goal)
        sd = sqrt(found.covariance[0, 0] + found.covariance[1, 1])
        self.status = f"{left:.1f} m to go, position within {sd:.2f} m (1 sigma)"
        if left < master.tolerance:
            return Done("goal reached by the filter's position")
        bearing = atan2(goal[1] - east, goal[0] - north)
        return VelocityCommand(surge=min(master.speed, 0.3 * left), heading=bearing, depth=master.depth)


def cross_matrix(a: Array) -> Array:
    """Return the matrix that multiplies a vector by `a` from the left, as a vector product."""
    x, y, z = a
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def rotation(turn: Array) -> Array:
    """Return the rotation matrix of a small turn (rad), to the fourth order of its angle."""
    k, square = cross_matrix(turn), float(turn @ turn)
    turned: Array = np.eye(3) + (1.0 - square / 6.0) * k + (0.5 - square / 24.0) * k @ k
    return turned


def matrix(q: Sequence[float]) -> Array:
    """Return the rotation matrix of a quaternion (w, x, y, z)."""
    w, x, y, z = q
    k = cross_matrix(np.array([x, y, z]))
    turned: Array = np.eye(3) + 2.0 * w * k + 2.0 * k @ k
    return turned
