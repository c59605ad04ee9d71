"""A Doppler velocity log: four slanted beams, each with its own velocity, range and lock."""

from collections.abc import Sequence
from math import cos, inf, nan, pi, sin, sqrt
from operator import mul
from typing import Annotated, NamedTuple

from hil.common.schema import Range
from hil.common.vectors import Vector3
from sim.dynamics import State
from sim.matrices import Matrix, inverse, product, transpose
from sim.rotations import down_axis, rotate, rotate_inverse
from sim.sensors.error import ErrorModel, noise_variance, sensor_random, variance
from sim.sensors.mounting import Mounting
from sim.sensors.ranging.ground import Ground
from sim.sensors.samples import DVL, Covariance, DvlSample, Scene
from sim.twins import make_error_bank

_BEAMS = 4
_ZEROS = (0.0,) * _BEAMS
_MIN_BEAMS = 3  # for three components of velocity


class _Fit(NamedTuple):
    """Solution of a set of beams.

    `beams` (4 x 3) are unit vectors, zero if not locked. `solution` (3 x 4) converts speeds along them to the velocity
    by least squares.
    """

    beams: Matrix
    solution: Matrix


class DvlModel(NamedTuple):
    """Rate in Hz (0: none), slant of the beams from straight down, reach and errors.

    `velocity` has the errors of each beam, `accuracy` those of each component of the velocity that remain however long
    one averages. At `noise_range` (m along a beam) the white noise of a beam has twice the variance that it has nearby;
    0: it does not grow. The defaults are those of a Nortek DVL1000 300 m as in DAVE (Field Robotics Lab): 8 Hz, 25 deg,
    0.2 to 75 m, and 0.015 m/s, which is the noise of each beam here; its accuracy is commonly given as 0.1 % and
    0.1 cm/s. The noise of the ranges is the 0.005 m of uuv_simulator.
    """

    rate: Annotated[float, Range(0.0, 100.0, "Hz")] = 8.0
    tilt: Annotated[float, Range(0.087, 1.05, "rad")] = 0.4363323
    min_range: Annotated[float, Range(0.0, 10.0, "m")] = 0.2
    max_range: Annotated[float, Range(0.1, 1000.0, "m")] = 75.0
    velocity: ErrorModel = ErrorModel(noise=0.015)
    range: ErrorModel = ErrorModel(noise=0.005)
    accuracy: ErrorModel = ErrorModel(turn_on=0.001, scale=0.001)
    noise_range: Annotated[float, Range(0.0, 1000.0, "m")] = 0.0

    def validate(self) -> str | None:
        """Return what is wrong with the combination of the keys, or None."""
        return "min_range is not below max_range" if self.min_range >= self.max_range else None


class Dvl:
    """A Doppler velocity log with thin beams at 45, 135 ... deg about its z axis.

    A beam is locked while the seabed or an obstacle is within its reach and the sensor is under water. Velocity is the
    least-squares solution of three or four locked beams. Altitude is the distance to the plane that fits the ends of
    the beams. Neither uses the attitude. The covariances are those at the measured speeds and distances, so they hold
    for a tilted sensor and over a slope.
    """

    Model = DvlModel
    topic = DVL

    def __init__(self, model: DvlModel, mounting: Mounting, seed: int, scene: Scene) -> None:
        self._limits = model.min_range, model.max_range
        self._mounting, self._mounting_rotation = mounting, mounting.quaternion
        self._seabed = scene.world.depth
        self._model, self._period = model, 1.0 / model.rate
        noise = sqrt(noise_variance(model.velocity, self._period)) if model.noise_range else 0.0
        models = [model.velocity, model.range] * _BEAMS + [model.accuracy] * 3 + [ErrorModel(noise=noise)] * _BEAMS
        self._errors = make_error_bank(models, self._period, sensor_random(seed, self.topic))
        self._beams = _janus(model.tilt)
        self._body_beams = [rotate(mounting.quaternion, beam) for beam in self._beams]  # the same in body axes
        self._ground = Ground(scene.world, mounting, self._body_beams, model.max_range)
        self._fits: dict[tuple[bool, ...], _Fit] = {}

    def sample(self, time_ns: int, state: State) -> DvlSample:
        """Return the measurement of `state`."""
        ranges = self._ranges(state)
        u, v, w = self._mounting.velocity(state.nu)
        true: list[float] = []
        for (x, y, z), distance in zip(self._body_beams, ranges, strict=True):
            true += (x * u + y * v + z * w, distance or 0.0)
        true += rotate_inverse(self._mounting_rotation, (u, v, w))
        measured = self._errors.measure([*true, *_ZEROS])  # advances the errors of all beams, locked or not
        locked = tuple(map(bool, ranges))
        if sum(locked) < _MIN_BEAMS:
            return DvlSample(time_ns, (nan, nan, nan), nan, False)
        fit = self._fits.get(locked) or self._fit(locked)
        distances, far = measured[1:8:2], self._model.noise_range
        shares = [distance / far if far else 0.0 for distance in distances]
        speeds = [x + share * more for x, share, more in zip(measured[:8:2], shares, measured[11:], strict=True)]
        off = [found - x for found, x in zip(measured[8:11], true[8:], strict=True)]
        u, v, w = velocity = [sum(map(mul, row, speeds)) + more for row, more in zip(fit.solution, off, strict=True)]
        altitude, slopes = _distance_to_plane(fit.beams, distances)
        of_range = [variance(self._model.range, self._period, distance) for distance in distances]
        altitude_variance = sum([slope * slope * each for slope, each in zip(slopes, of_range, strict=True)])
        covariance = self._covariance(fit, speeds, shares, velocity)
        return DvlSample(time_ns, (u, v, w), altitude, True, covariance, altitude_variance)

    def _covariance(
        self, fit: _Fit, speeds: Sequence[float], shares: Sequence[float], velocity: Sequence[float]
    ) -> Covariance:
        """Return the covariance of the velocity ((m/s)²), from the variances of the beams and of the accuracy."""
        model, period = self._model, self._period
        growth = noise_variance(model.velocity, period) if model.noise_range else 0.0
        beams = [
            variance(model.velocity, period, speed) + growth * share * share
            for speed, share in zip(speeds, shares, strict=True)
        ]
        xs, ys, zs = fit.solution
        a, b, c = [variance(model.accuracy, period, component) for component in velocity]
        weighted = [[x * of_beam for x, of_beam in zip(row, beams, strict=True)] for row in fit.solution]
        (xx, xy, xz), (_, yy, yz), (_, _, zz) = [[sum(map(mul, row, to)) for to in (xs, ys, zs)] for row in weighted]
        return xx + a, xy, xz, xy, yy + b, yz, xz, yz, zz + c

    def _fit(self, locked: tuple[bool, ...]) -> _Fit:
        """Return the solution for a set of locked beams, computed once for each set."""
        rows = [list(beam) if on else [0.0, 0.0, 0.0] for beam, on in zip(self._beams, locked, strict=True)]
        columns = transpose(rows)
        self._fits[locked] = fit = _Fit(rows, product(inverse(product(columns, rows)), columns))
        return fit

    def _ranges(self, state: State) -> list[float | None]:
        """Return the true distance along each beam (m); None for a beam that is not locked."""
        depth = self._mounting.depth(state)
        if depth <= 0.0:
            return [None] * _BEAMS
        near, far = self._limits
        distances, across = self._flat_ranges(state, self._seabed - depth)
        if not self._ground.is_flat(state, across):
            distances = self._ground.ranges(state)
        return [distance if near <= distance <= far and distance > 0.0 else None for distance in distances]

    def _flat_ranges(self, state: State, height: float) -> tuple[Sequence[float], float]:
        """Return the distances to flat seabed `height` m below the sensor (inf: none), and the greatest across."""
        down_x, down_y, down_z = down_axis(state.quaternion)
        _, far = self._limits
        distances, across = [], 0.0
        for x, y, z in self._body_beams:
            down = down_x * x + down_y * y + down_z * z
            distance = height / down if down > 0.0 else inf
            distances.append(distance)
            across = max(across, min(distance, far) * sqrt(max(0.0, 1.0 - down * down)))
        return distances, across


def _janus(tilt: float) -> list[Vector3]:
    """Return unit vectors of the beams, `tilt` rad from straight down, between the axes seen from above."""
    angles = [pi / 4.0 + k * pi / 2.0 for k in range(_BEAMS)]
    return [(sin(tilt) * cos(angle), sin(tilt) * sin(angle), cos(tilt)) for angle in angles]


def _distance_to_plane(beams: Matrix, ranges: Sequence[float]) -> tuple[float, list[float]]:
    """Return the distance (m) from the origin to the plane n p = 1 fitted to the ends p of the beams: 1 / |n|.

    Also return its derivative by the length of each beam. `beams` are unit vectors, `ranges` in m. The normal equations
    M n = sum(p) of three unknowns are solved by Cramer's rule: a beam that is zero adds nothing to them. By their
    derivative, M dn = b (1 - n p) - p (n b) for a change of the beam b.
    """
    xx = xy = xz = yy = yz = zz = x = y = z = 0.0
    for (a, b, c), distance in zip(beams, ranges, strict=True):
        a, b, c = distance * a, distance * b, distance * c
        xx += a * a
        xy += a * b
        xz += a * c
        yy += b * b
        yz += b * c
        zz += c * c
        x += a
        y += b
        z += c
    i, j, k = yy * zz - yz * yz, yz * xz - xy * zz, xy * yz - yy * xz
    ll, m, n = xx * zz - xz * xz, xy * xz - xx * yz, xx * yy - xy * xy
    a, b, c = i * x + j * y + k * z, j * x + ll * y + m * z, k * x + m * y + n * z
    determinant = xx * i + xy * j + xz * k
    height = float(abs(determinant) / (a * a + b * b + c * c) ** 0.5)
    nx, ny, nz = a / determinant, b / determinant, c / determinant
    # M^-1 n, as M is symmetric: the derivative of |n|² / 2 is its product with M dn
    gx, gy, gz = [(r * nx + s * ny + t * nz) / determinant for r, s, t in ((i, j, k), (j, ll, m), (k, m, n))]
    slopes = []
    for (x, y, z), distance in zip(beams, ranges, strict=True):
        to_plane, along = nx * x + ny * y + nz * z, gx * x + gy * y + gz * z
        slopes.append(-(height**3) * along * (1.0 - 2.0 * distance * to_plane))
    return height, slopes
