"""An irregular sea as the sum of linear (Airy) waves over a flat seabed.

With z the depth, h that of the seabed, and theta = k . (north, east) - omega t + phase, each wave has
(Faltinsen 1990, Sea Loads on Ships and Offshore Structures, table 2.1)

    elevation            a cos(theta)
    horizontal velocity  a omega cosh(k (h - z)) / sinh(k h) cos(theta), along k
    upward velocity      a omega sinh(k (h - z)) / sinh(k h) sin(theta)
    pressure             rho g a cosh(k (h - z)) / cosh(k h) cos(theta), on top of that of calm water
    omega² = g k tanh(k h)

In deep water this is a circular motion that decreases as exp(-k z); it includes the Stokes drift of a body that moves
with the water. Not modelled: terms of second order in the height of the components (sharper crests, bound waves),
breaking, the interaction of waves and current, shelter behind obstacles. Above the mean surface the motion of the
surface is used; only the pressure follows the elevation.

A hull feels the mean over its length and width: of a wave it crosses at x = k l / 2 the share sin(x) / x, and its water
plane tilts by the share 3 (sin x - x cos x) / x³ of the slope, which is sin(y) / y with y = sqrt(0.6) x to a thousandth
for waves longer than two hulls (Gauss's integration at three points).
"""

from itertools import pairwise
from math import cos, exp, inf, log, pi, sin, sqrt, tanh
from random import Random
from typing import NamedTuple

from sim.environment.ocean import Waves
from sim.interpolation import PiecewiseLinear

# The range of frequencies in multiples of the peak's (a thousandth of the energy is above), and the cells of the
# integral for each component: so many that even at the sharpest peak no two components get the same frequency.
_LOWEST, _HIGHEST, _CELLS = 0.3, 6.0, 40
# Within this time (s) and squared distance (m²) of the last sample, the surface is approximated by a moving plane.
_NEAR_S, _NEAR_M2 = 0.2, 1.0
_TILT = 0.7745966692414834  # sqrt(0.6)


class Component(NamedTuple):
    """One wave: amplitude (m), angular frequency (rad/s), wave number (rad/m), heading of travel and phase (rad)."""

    amplitude: float
    omega: float
    wave_number: float
    heading: float
    phase: float


class WaterMotion(NamedTuple):
    """Velocity (m/s) and acceleration (m/s²) of the water, each north, east, down, and the surface above it.

    The acceleration is the material derivative, dv/dt + (v . grad) v. `surface` is the elevation (m), its rate of
    change (m/s), and its slopes to the north and east. `gradient` is that of the velocity (1/s), which is symmetric and
    without a trace: nn, ne, ee, nd, ed; `gradient_rate` its rate of change (1/s²). All are those of a point, or means
    over a hull.
    """

    velocity: tuple[float, float, float]
    acceleration: tuple[float, float, float]
    surface: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)
    gradient: tuple[float, float, float, float, float] = (0.0, 0.0, 0.0, 0.0, 0.0)
    gradient_rate: tuple[float, float, float, float, float] = (0.0, 0.0, 0.0, 0.0, 0.0)


class Plan(NamedTuple):
    """A hull seen from above: half its length and half its width (m) along north and east; all 0 for a point."""

    length_north: float = 0.0
    length_east: float = 0.0
    width_north: float = 0.0
    width_east: float = 0.0


POINT = Plan()


def spectral_density(waves: Waves, omega: float) -> float:
    """Return the one-sided spectrum of the elevation, m² s/rad, at `omega` > 0 rad/s.

    Either Pierson-Moskowitz, by significant height and peak period, or JONSWAP (Hasselmann et al. 1973) with the factor
    1 - 0.287 ln gamma, which approximately conserves the energy (DNV-RP-C205, 3.5.5).
    """
    ratio = 2.0 * pi / waves.peak_period / omega
    density = 0.3125 * waves.significant_height**2 * ratio**4 / omega * exp(-1.25 * ratio**4)
    if waves.spectrum == "pierson_moskowitz":
        return density
    width = 0.07 if ratio >= 1.0 else 0.09
    peak = exp(-0.5 * ((1.0 / ratio - 1.0) / width) ** 2)
    return density * (1.0 - 0.287 * log(waves.gamma)) * exp(peak * log(waves.gamma))


def wave_number(omega: float, depth: float, gravity: float) -> float:
    """Return the k (rad/m) with omega² = g k tanh(k h), to rounding, by Newton's method from Eckart's estimate."""
    deep = omega * omega / gravity
    k = deep / sqrt(tanh(deep * depth))
    for _ in range(20):
        slope = tanh(k * depth)
        step = (k * slope - deep) / (slope + k * depth * (1.0 - slope * slope))
        k -= step
        if abs(step) <= 1e-15 * k:
            break
    return k


def components(waves: Waves, depth: float, gravity: float, seed: int) -> list[Component]:
    """Return the components of a sea over a seabed at `depth` m, with equal heights and random phases by `seed`.

    Each component represents an equal part of the spectrum's energy, at the root mean square frequency of that part. So
    the variance of the elevation is exactly Hs²/16, and that of the surface's velocity exactly the spectrum's.
    """
    random = Random(f"{seed}/ocean.waves")
    amplitude = 0.25 * waves.significant_height * sqrt(2.0 / waves.components)
    generated = []
    for omega in _frequencies(waves):
        heading = waves.direction + random.gauss(0.0, waves.spread)
        phase = random.uniform(0.0, 2.0 * pi)
        generated.append(Component(amplitude, omega, wave_number(omega, depth, gravity), heading, phase))
    return generated


def _frequencies(waves: Waves) -> list[float]:
    peak = 2.0 * pi / waves.peak_period
    cells = _CELLS * max(waves.components, 25)
    width = peak * (_HIGHEST - _LOWEST) / cells
    shape = waves._replace(significant_height=1.0)  # so that it also works for a height of 0
    energy, squares = [0.0], [0.0]
    for cell in range(cells):
        omega = peak * _LOWEST + (cell + 0.5) * width
        part = spectral_density(shape, omega)
        if part > 0.0:
            energy.append(energy[-1] + part)
            squares.append(squares[-1] + part * omega * omega)
    squares_below = PiecewiseLinear(energy, squares)
    share = energy[-1] / waves.components
    edges = [squares_below(share * i)[0] for i in range(waves.components)] + [squares[-1]]
    return [sqrt((above - below) / share) for below, above in pairwise(edges)]


class WaveField:
    """An irregular sea of `waves` over a flat seabed at `depth` m under `gravity` m/s²."""

    def __init__(self, waves: Waves, depth: float, gravity: float, seed: int) -> None:
        self.components = components(waves, depth, gravity, seed)
        self.depth = depth
        self._rows = [_row(component, depth) for component in self.components]
        self._tangent = (-inf, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)  # time, north, east, and WaterMotion.surface there
        self._held = _AT_REST  # the motion of the last `set_tangent`

    @property
    def max_elevation(self) -> float:
        """The elevation (m) that no superposition of the components exceeds."""
        return sum(abs(component.amplitude) for component in self.components)

    @property
    def max_slope(self) -> float:
        """The slope of the surface that no superposition of the components exceeds."""
        return sum(abs(component.amplitude) * component.wave_number for component in self.components)

    def set_tangent(self, time: float, north: float, east: float, motion: WaterMotion) -> None:
        """Let `surface` extrapolate from `motion`, which is that of this time (s) and position (m)."""
        self._tangent = (time, north, east, *motion.surface)
        self._held = motion

    @property
    def held(self) -> WaterMotion:
        """The motion of the last `set_tangent`."""
        return self._held

    def surface(self, time: float, north: float, east: float) -> float:
        """Return the elevation (m), extrapolated from the last `set_tangent` if that is near, else computed.

        For each wave the error is less than (omega t + k d)² / 2 of its amplitude, t s and d m away from it.
        """
        then, at_north, at_east, height, rate, slope_north, slope_east = self._tangent
        elapsed, away_north, away_east = time - then, north - at_north, east - at_east
        if not (abs(elapsed) <= _NEAR_S and away_north * away_north + away_east * away_east <= _NEAR_M2):
            return self.elevation(time, north, east)
        return height + rate * elapsed + slope_north * away_north + slope_east * away_east

    def elevation(self, time: float, north: float, east: float) -> float:
        """Return the height (m) of the surface above its mean at `time` s."""
        elevation = 0.0  # not sum(), whose rounding depends on the version of Python
        for kn, ke, _, omega, phase, _, _, _, _, amplitude in self._rows:
            elevation += amplitude * cos(kn * north + ke * east - omega * time + phase)
        return elevation

    def numbers(self) -> list[float]:
        """Return the numbers of all components, one after the other, as one flat list, for the C twin."""
        return [x for row in self._rows for x in row]

    def pressure_depth(self, time: float, north: float, east: float, depth: float) -> float:
        """Return the depth (m) in calm water with the same pressure as this position (m, NED) at `time` s.

        The theory is valid below the mean surface. With Wheeler's stretching (1970, J. Petroleum Technology 22:359) it
        is evaluated at z' = h (z + eta) / (h + eta) instead of z, where eta is the elevation. So the result is exactly
        0 at the surface of the wave, in crests and troughs, and continuous there. It is negative in the air.
        """
        elevation = self.elevation(time, north, east)
        stretched = max(0.0, depth + elevation) * self.depth / (self.depth + elevation)
        head = 0.0
        for kn, ke, k, omega, phase, _, echo, _, _, amplitude in self._rows:
            decay = exp(-k * stretched)
            share = (decay + echo / decay) / (1.0 + echo) if echo else decay
            head += amplitude * share * cos(kn * north + ke * east - omega * time + phase)
        return depth + head

    def motion(self, time: float, north: float, east: float, depth: float, *, plan: Plan = POINT) -> WaterMotion:
        """Return the motion of the water at a position (m, NED) at `time` s, as its mean over a hull of this `plan`.

        It takes about half a microsecond for each component, so callers use a result for some milliseconds.
        """
        length_north, length_east, width_north, width_east = plan
        depth = min(max(depth, 0.0), self.depth)
        v_north = v_east = v_down = a_north = a_east = a_down = 0.0
        nn = ne = ee = nd = ed = 0.0
        nn_rate = ne_rate = ee_rate = nd_rate = ed_rate = 0.0
        height = rate = slope_north = slope_east = 0.0
        for kn, ke, k, omega, phase, speed, echo, to_north, to_east, amplitude in self._rows:
            theta = kn * north + ke * east - omega * time + phase
            decay = exp(-k * depth)
            rise = echo / decay if echo else 0.0  # reflection by the seabed; none in deep water
            x, y = kn * length_north + ke * length_east, kn * width_north + ke * width_east
            mean, tilt = _sinc(x) * _sinc(y), _sinc(_TILT * x) * _sinc(_TILT * y)
            level, steep = speed * (decay + rise), speed * (decay - rise)
            cosine, sine = cos(theta), sin(theta)
            along, falling = mean * level * cosine, amplitude * sine
            height += amplitude * mean * cosine
            rate += omega * mean * falling
            slope_north -= kn * tilt * falling
            slope_east -= ke * tilt * falling
            v_north += along * to_north
            v_east += along * to_east
            v_down -= mean * steep * sine
            along = omega * mean * level * sine
            a_north += along * to_north
            a_east += along * to_east
            a_down += omega * mean * steep * cosine
            level *= tilt
            steep *= tilt
            along, falling = level * sine, steep * cosine
            nn -= along * kn * to_north
            ne -= along * kn * to_east
            ee -= along * ke * to_east
            nd -= falling * kn
            ed -= falling * ke
            along, falling = omega * level * cosine, omega * steep * sine
            nn_rate += along * kn * to_north
            ne_rate += along * kn * to_east
            ee_rate += along * ke * to_east
            nd_rate -= falling * kn
            ed_rate -= falling * ke
        a_north += v_north * nn + v_east * ne + v_down * nd
        a_east += v_north * ne + v_east * ee + v_down * ed
        a_down += v_north * nd + v_east * ed - v_down * (nn + ee)
        surface = (height, rate, slope_north, slope_east)
        rates = nn_rate, ne_rate, ee_rate, nd_rate, ed_rate
        return WaterMotion((v_north, v_east, v_down), (a_north, a_east, a_down), surface, (nn, ne, ee, nd, ed), rates)


def _sinc(x: float) -> float:
    """Return sin(x) / x; by its series up to 1.5, to 1e-8."""
    s = x * x
    if s > 2.25:
        return sin(x) / x
    return 1.0 - s / 6.0 * (1.0 - s / 20.0 * (1.0 - s / 42.0 * (1.0 - s / 72.0 * (1.0 - s / 110.0))))


_AT_REST = WaterMotion((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))


def _row(wave: Component, depth: float) -> tuple[float, ...]:
    """Return the numbers of one component that the methods of `WaveField` use.

    With d = exp(-k z) and the reflection by the seabed e = exp(-2 k h), cosh(k (h - z)) / sinh(k h) is
    (d + e/d) / (1 - e), and sinh(k (h - z)) / sinh(k h) is (d - e/d) / (1 - e).
    """
    k, to_north, to_east = wave.wave_number, cos(wave.heading), sin(wave.heading)
    echo = exp(-2.0 * k * depth)
    speed = wave.amplitude * wave.omega / (1.0 - echo)
    return k * to_north, k * to_east, k, wave.omega, wave.phase, speed, echo, to_north, to_east, wave.amplitude
