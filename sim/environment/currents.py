"""Currents: the velocity of the water as a function of time and depth, horizontally uniform.

Each is a function (time_ns, depth in m) -> velocity (north, east, down) in m/s. Not modelled: eddies, Ekman rotation of
the layers, the boundary layer of a tide at the seabed, modulation of the constituents over 18.6 years.
"""

from collections.abc import Callable, Sequence
from math import cos, exp, pi, sin, sqrt
from random import Random

from sim.environment.ocean import Constituent, GaussMarkov, Layers, Ocean, Series, Tide
from sim.interpolation import PiecewiseLinear

Velocity = tuple[float, float, float]
Current = Callable[[int, float], Velocity]

# Degrees an hour: P. Schureman, Manual of Harmonic Analysis and Prediction of Tides, US Coast and Geodetic
# Survey, Special Publication 98 (1958), table 2.
TIDAL_SPEEDS: dict[Constituent, float] = {
    "M2": 28.9841042, "S2": 30.0, "N2": 28.4397295, "K1": 15.0410686, "O1": 13.9430356,
}  # fmt: skip

UPDATE_NS = 10_000_000  # between two updates of a Gauss-Markov current


def ocean_current(ocean: Ocean, steady: Velocity, seed: int) -> Current:
    """Return the sum of all currents of an ocean and the `steady` one (m/s, NED); `seed` is the scenario's."""
    currents: list[Current] = []
    if ocean.layers:
        currents.append(layered(ocean.layers))
    if ocean.gauss_markov:
        currents.append(GaussMarkovCurrent(ocean.gauss_markov, seed))
    if ocean.tide:
        currents.append(tidal(ocean.tide))
    if ocean.series:
        currents.append(recorded(ocean.series))

    def current(time_ns: int, depth: float) -> Velocity:
        north, east, down = steady
        for part in currents:
            to_north, to_east, to_down = part(time_ns, depth)
            north += to_north
            east += to_east
            down += to_down
        return north, east, down

    return current


def layered(layers: Layers) -> Current:
    """Return a stratified current: linear in depth between the rows of its table."""
    table = _table(layers.depth, layers)
    return lambda _, depth: table(depth)


def recorded(series: Series) -> Current:
    """Return a current from a table over time: linear between its rows, constant before and after them."""
    table = _table(series.time, series)
    return lambda time_ns, _: table(time_ns * 1e-9)


def tidal(tides: Sequence[Tide]) -> Current:
    """Return a tidal current: the sum of its constituents, each along its own horizontal line."""
    waves = [
        (
            TIDAL_SPEEDS[tide.constituent] * pi / (180.0 * 3600.0),
            tide.phase,
            tide.amplitude * cos(tide.heading),
            tide.amplitude * sin(tide.heading),
        )
        for tide in tides
    ]

    def current(time_ns: int, _: float) -> Velocity:
        time = time_ns * 1e-9
        north = east = 0.0
        for speed, phase, to_north, to_east in waves:
            flood = cos(speed * time - phase)  # negative: ebb
            north += flood * to_north
            east += flood * to_east
        return north, east, 0.0

    return current


class GaussMarkovCurrent:
    """A first-order Gauss-Markov (Ornstein-Uhlenbeck) current about its mean, the same at every depth.

    It is updated every 10 ms by the exact discrete form (Gillespie 1996, Phys. Rev. E 54:2084) and constant in between,
    so the same seed gives the same current for any step of the simulation. It starts from its stationary distribution.
    Time only runs forward: for an earlier time the present value is returned.
    """

    def __init__(self, model: GaussMarkov, seed: int) -> None:
        self._gauss = Random(f"{seed}/ocean.gauss_markov").gauss
        self._mean = model.mean
        self._decay = exp(-1e-9 * UPDATE_NS / model.time)
        self._increments = [sd * sqrt(1.0 - self._decay * self._decay) for sd in model.sd]
        self._deviation = [self._gauss(0.0, sd) for sd in model.sd]
        self._value = self._velocity()
        self._next_ns = UPDATE_NS

    def __call__(self, time_ns: int, depth: float) -> Velocity:
        """Return the velocity at `time_ns`; it does not depend on the depth."""
        if time_ns >= self._next_ns:
            self._update(time_ns)
        return self._value

    def _update(self, time_ns: int) -> None:
        decay, gauss = self._decay, self._gauss
        while self._next_ns <= time_ns:
            self._next_ns += UPDATE_NS
            rows = zip(self._deviation, self._increments, strict=True)
            self._deviation = [decay * deviation + gauss(0.0, sd) for deviation, sd in rows]
        self._value = self._velocity()

    def _velocity(self) -> Velocity:
        (north, east, down), (a, b, c) = self._mean, self._deviation
        return north + a, east + b, down + c


def _table(at: Sequence[float], rows: Layers | Series) -> Callable[[float], Velocity]:
    zeros = (0.0,) * len(at)
    return PiecewiseLinear(at, rows.north or zeros, rows.east or zeros, rows.down or zeros)  # type: ignore[return-value]  # three columns
