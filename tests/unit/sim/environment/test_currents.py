"""Currents: layers, series, wandering currents and tides, against formulas and other simulators."""

from itertools import pairwise
from math import exp, pi, radians, sqrt
from pathlib import Path
from random import Random
from statistics import fmean, pstdev

import pytest

from sim.environment.currents import TIDAL_SPEEDS, Current, GaussMarkovCurrent, layered, ocean_current, recorded, tidal
from sim.environment.ocean import Constituent, GaussMarkov, Layers, Ocean, Series, Tide
from sim.environment.world import load_world

SECOND = 1_000_000_000
HOUR = 3600 * SECOND
STILL = (0.0, 0.0, 0.0)


def test_currents_by_layer_are_interpolated_in_depth() -> None:
    current = layered(Layers((5.0, 15.0, 35.0), north=(0.4, 0.2, 0.0), down=(0.0, 0.0, 0.1)))
    assert current(0, 5.0) == (0.4, 0.0, 0.0)
    assert current(9 * HOUR, 10.0) == pytest.approx((0.3, 0.0, 0.0))
    assert current(0, 30.0) == pytest.approx((0.05, 0.0, 0.075))
    assert current(0, -1.0) == current(0, 5.0) == (0.4, 0.0, 0.0)  # the ends hold
    assert current(0, 99.0) == (0.0, 0.0, 0.1)


def test_recorded_currents_are_interpolated_in_time() -> None:
    current = recorded(Series((10.0, 20.0, 60.0), north=(0.1, 0.3, -0.1), east=(0.0, 1.0, 1.0)))
    assert current(15 * SECOND, 3.0) == pytest.approx((0.2, 0.5, 0.0))
    assert current(40 * SECOND, 3.0) == pytest.approx((0.1, 1.0, 0.0))
    assert current(0, 0.0) == (0.1, 0.0, 0.0)  # the ends hold
    assert current(999 * SECOND, 0.0) == (-0.1, 1.0, 0.0)
    assert Series((4.0,), east=(0.2,)).validate() is None
    assert recorded(Series((4.0,), east=(0.2,)))(0, 0.0) == (0.0, 0.2, 0.0)


# -- Gauss-Markov -------------------------------------------------------------------------------------------------

TAU, SD, MEAN = 1.0, 0.2, 0.5
MODEL = GaussMarkov((SD, 0.1, 0.0), TAU, (MEAN, 0.0, 0.0))
RATE_STEPS = {1000: 1_000_000, 100: 10_000_000, 10: 100_000_000}


def sampled(current: Current, dt_ns: int, seconds: float) -> list[float]:
    return [current(i * dt_ns, 0.0)[0] for i in range(round(seconds * SECOND / dt_ns))]


def test_a_wandering_current_has_its_mean_and_size_at_every_step() -> None:
    """The same seed gives the same current, whatever the step, and its mean and size are the requested ones."""
    long = sampled(GaussMarkovCurrent(MODEL, 3), RATE_STEPS[10], 1500.0)
    for rate, seconds in ((100, 150.0), (1000, 20.0)):
        path = sampled(GaussMarkovCurrent(MODEL, 3), RATE_STEPS[rate], seconds)
        assert path[:: rate // 10] == long[: round(10 * seconds)]
    assert fmean(long) == pytest.approx(MEAN, abs=0.03)
    assert pstdev(long) == pytest.approx(SD, rel=0.07)


def test_a_wandering_current_has_the_requested_correlation_time() -> None:
    values = sampled(GaussMarkovCurrent(MODEL, 4), RATE_STEPS[10], 1500.0)
    for lag in (1, 5, 10):
        changes = [b - a for a, b in zip(values, values[lag:], strict=False)]
        assert pstdev(changes) == pytest.approx(SD * sqrt(2.0 * (1.0 - exp(-0.1 * lag / TAU))), rel=0.06)


def test_the_seed_determines_a_wandering_current() -> None:
    assert GaussMarkovCurrent(MODEL, 3)(7 * SECOND, 0.0) == GaussMarkovCurrent(MODEL, 3)(7 * SECOND, 30.0)
    assert GaussMarkovCurrent(MODEL, 3)(7 * SECOND, 0.0) != GaussMarkovCurrent(MODEL, 4)(7 * SECOND, 0.0)
    assert GaussMarkovCurrent(MODEL, 42)(0, 0.0)[0] == pytest.approx(
        0.5 + SD * Random("42/ocean.gauss_markov").gauss(0.0, 1.0)
    )


# -- tides --------------------------------------------------------------------------------------------------------


SUN, MOON, PERIGEE = 0.0410686, 0.5490165, 0.0046418  # mean motion in degrees an hour (Schureman 1958, table 1)


@pytest.mark.parametrize(
    ("name", "speed", "hours"),
    [
        ("M2", 30.0 + 2.0 * SUN - 2.0 * MOON, 12.4206),
        ("S2", 30.0, 12.0),
        ("N2", 30.0 + 2.0 * SUN - 3.0 * MOON + PERIGEE, 12.6583),
        ("K1", 15.0 + SUN, 23.9345),
        ("O1", 15.0 + SUN - 2.0 * MOON, 25.8193),
    ],
)
def test_tidal_constituents_have_their_periods(name: Constituent, speed: float, hours: float) -> None:
    """Periods follow from the motions of sun, moon and the moon's perigee; in hours they are those of every almanac."""
    assert TIDAL_SPEEDS[name] == pytest.approx(speed, abs=1.5e-7)
    assert 360.0 / TIDAL_SPEEDS[name] == pytest.approx(hours, abs=6e-5)
    current = tidal([Tide(name, 1.0, 0.0)])
    period = 360.0 / speed * HOUR
    assert current(round(100.0 * period), 0.0)[0] == pytest.approx(1.0, abs=1e-9)
    assert current(round(0.25 * period), 0.0)[0] == pytest.approx(0.0, abs=1e-6)


def test_the_phase_of_a_tide_is_the_lag_of_its_flood() -> None:
    current = tidal([Tide("S2", 0.5, 0.0, phase=pi / 2)])
    assert current(0, 0.0)[0] == pytest.approx(0.0, abs=1e-12)
    assert current(3 * HOUR, 0.0)[0] == pytest.approx(0.5)


# -- combined -----------------------------------------------------------------------------------------------------


def test_currents_add_up() -> None:
    layers, tide = Layers((0.0, 10.0), north=(0.4, 0.0)), Tide("M2", 0.3, 1.0)
    series = Series((0.0, HOUR / SECOND), east=(0.0, 0.2))
    combined = ocean_current(Ocean(layers, MODEL, (tide,), series), (0.05, -0.05, 0.01), 9)
    for time, depth in pairwise((0, 3 * SECOND, 9 * SECOND)):
        currents = (
            layered(layers),
            GaussMarkovCurrent(MODEL, 9),
            tidal([tide]),
            recorded(series),
            lambda *_: (0.05, -0.05, 0.01),
        )
        expected = [sum(axis) for axis in zip(*(part(time, depth * 1e-9) for part in currents), strict=True)]
        assert combined(time, depth * 1e-9) == pytest.approx(expected, abs=1e-15)
    assert ocean_current(Ocean(), STILL, 1)(5, 5.0) == STILL


GOOD = """
name = "mine"
source = "test"
extent = [0, 9, 0, 9]
depth = 30
current = [0.1, 0, 0]
[ocean.layers]
depth = [0, 10]
north = ["0.5 kn", 0]
[ocean.gauss_markov]
sd = [0.05, 0.05, 0]
time = "5 min"
[[ocean.tide]]
constituent = "M2"
amplitude = "0.6 m/s"
heading = "75 deg"
[[ocean.tide]]
constituent = "S2"
amplitude = 0.2
heading = "75 deg"
phase = "30 deg"
[ocean.series]
time = [0, "10 min"]
down = [0, 0.1]
"""


def test_a_world_file_can_have_currents(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(GOOD)
    for _ in range(2):  # the second time from the cache
        world = load_world(str(path))
        assert world.ocean is not None
        assert world.ocean.moves
        assert world.ocean.layers == Layers((0.0, 10.0), north=(0.5 * 1852.0 / 3600.0, 0.0))
        assert world.ocean.tide[1] == Tide("S2", 0.2, radians(75.0), radians(30.0))
        assert world.ocean.series == Series((0.0, 600.0), down=(0.0, 0.1))
        assert world.current == (0.1, 0.0, 0.0)
