"""Rays of sound in a profile, against solutions in closed form."""

from math import asin, asinh, hypot, inf, sqrt
from unittest.mock import Mock

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sim.environment.ocean import Profile
from sim.environment.seawater import sound_rays
from sim.environment.seawater.absorption import francois_garrison
from sim.environment.seawater.pressure import depth_of, pressure_at
from sim.environment.seawater.sound_rays import Ray, SoundRays
from sim.environment.seawater.water_column import WaterColumn
from tests.support.examples import examples

# Jensen et al., Computational Ocean Acoustics: a channel with its axis at 1300 m, here by five straight lines
CHANNEL = [0.0, 200.0, 700.0, 1300.0, 2500.0, 5000.0], [1530.0, 1517.0, 1502.0, 1500.0, 1510.0, 1550.0]


def linear(gradient: float, deepest: float = 5000.0, bottom: float = inf) -> SoundRays:
    return SoundRays([0.0, deepest], [1500.0, 1500.0 + gradient * deepest], bottom)


@pytest.mark.parametrize("gradient", [0.017, -0.05, -0.2, 1e-4])
@pytest.mark.parametrize(("level", "start", "end"), [
    (100.0, 5.0, 50.0), (800.0, 300.0, 20.0), (500.0, 150.0, 150.0), (0.0, 5.0, 80.0), (300.0, 100.0, 101.0),
    (1000.0, 200.0, 200.001),
])  # fmt: skip
def test_a_linear_gradient_bends_rays_to_circles(gradient: float, level: float, start: float, end: float) -> None:
    """The travel time is that of a geodesic in a half plane, the length that of the arc over the chord."""
    ray = linear(gradient).between(level, start, end)
    assert ray is not None
    chord = hypot(level, end - start)
    product = (1500.0 + gradient * start) * (1500.0 + gradient * end)
    assert ray.time == pytest.approx(
        2.0 * asinh(abs(gradient) * chord / (2.0 * sqrt(product))) / abs(gradient), rel=1e-9
    )
    cosine = sqrt(1.0 - ray.departure**2)
    if level:
        radius = (1500.0 + gradient * start) / (abs(gradient) * cosine)
        if start == end:  # its turning point is in the middle
            sine = gradient / abs(gradient) * chord / (2.0 * radius)
            assert (ray.departure, ray.arrival) == pytest.approx((sine, -sine), rel=1e-6)
        assert ray.length == pytest.approx(2.0 * radius * asin(chord / (2.0 * radius)), rel=1e-9)
    else:
        assert ray.length == chord


@examples(100)
@given(st.floats(1.0, 8000.0), st.floats(0.0, 3000.0), st.floats(0.0, 3000.0))
def test_rays_follow_snells_law_and_are_reversible(level: float, start: float, end: float) -> None:
    rays = SoundRays(*CHANNEL, 5000.0)
    ray, reverse = rays.between(level, start, end), rays.between(level, end, start)
    assert (ray is None) == (reverse is None)
    if ray is None or reverse is None:
        return
    speed = WaterColumn(Profile(tuple(CHANNEL[0]), (1025.0,) * 6, tuple(CHANNEL[1])), 9.8).sound_speed
    snell = [sqrt(max(0.0, 1.0 - s * s)) / speed(z) for s, z in ((ray.departure, start), (ray.arrival, end))]
    assert snell[0] == pytest.approx(snell[1], rel=1e-9)
    assert (reverse.time, reverse.length) == pytest.approx((ray.time, ray.length), rel=1e-6)
    assert (reverse.departure, reverse.arrival) == pytest.approx((-ray.arrival, -ray.departure), abs=1e-5)
    straight = hypot(level, end - start)
    assert straight * (1.0 - 1e-9) <= ray.length < 1.05 * straight
    assert straight / 1550.0 < ray.time < ray.length / 1500.0 * (1.0 + 1e-9)


@pytest.mark.parametrize(
    ("level", "start", "end"), [(900.0, 100.0, 1200.0), (2500.0, 800.0, 900.0), (400.0, 1290.0, 60.0)]
)
def test_a_ray_ends_at_its_target(level: float, start: float, end: float, monkeypatch: pytest.MonkeyPatch) -> None:
    """A ray that is followed by its slope at the start ends at its target. The search for it takes few steps."""
    steps = Mock(side_effect=sound_rays._sums)
    monkeypatch.setattr(sound_rays, "_sums", steps)
    ray = SoundRays(*CHANNEL, 5000.0).between(level, start, end)
    assert steps.call_count <= 8
    assert ray is not None
    speed = WaterColumn(Profile(tuple(CHANNEL[0]), (1025.0,) * 6, tuple(CHANNEL[1])), 9.8).sound_speed
    depth, sine, time, step = start, ray.departure, 0.0, level / 20_000
    along = 0.0
    for _ in range(20_000):
        slope = sine / sqrt(1.0 - sine * sine)
        speed_here, gradient = speed(depth), (speed(depth + 0.01) - speed(depth - 0.01)) / 0.02
        angle_rate = -gradient / speed_here  # dθ/dx of a ray: its curvature over its cosine
        along += step * sqrt(1.0 + slope * slope)
        time += step * sqrt(1.0 + slope * slope) / speed_here
        depth += step * slope
        sine += step * angle_rate * sqrt(1.0 - sine * sine)
    assert depth == pytest.approx(end, abs=0.02 * max(1.0, level / 1000.0))
    assert time == pytest.approx(ray.time, rel=1e-4)
    assert along == pytest.approx(ray.length, rel=1e-4)


def test_the_shadow_begins_beyond_the_ray_that_grazes_the_surface() -> None:
    """The shadow begins at sqrt(2 R z1) + sqrt(2 R z2), R the radius of rays, in water that slows sound below."""
    rays, radius = linear(-0.1), 1500.0 / 0.1
    edge = sum(sqrt(2.0 * radius * z - z * z) for z in (10.0, 40.0))
    near = rays.between(edge - 1.0, 10.0, 40.0)
    assert near is not None
    assert near.departure < 0.0 < near.arrival, "it goes up first"
    assert rays.between(edge + 1.0, 10.0, 40.0) is None
    assert rays.between(edge + 1.0, 40.0, 10.0) is None


def test_the_bed_blocks_rays_that_bend_down_to_it() -> None:
    radius = 1500.0 / 0.05
    level = 2.0 * sqrt(2.0 * radius * 30.0)  # its vertex is about 30 m below a source near the surface
    assert linear(0.05, bottom=50.0).between(level, 1.0, 1.0) is not None
    assert linear(0.05, bottom=20.0).between(level, 1.0, 1.0) is None


def test_rays_are_straight_at_a_constant_speed_of_sound() -> None:
    layers = SoundRays([0.0, 50.0, 60.0, 100.0], [1520.0, 1520.0, 1505.0, 1500.0])
    assert layers.between(300.0, 10.0, 50.0) == Ray(
        hypot(300.0, 40.0) / 1520.0, hypot(300.0, 40.0), 40.0 / hypot(300.0, 40.0), 40.0 / hypot(300.0, 40.0)
    )
    level = layers.between(5000.0, 150.0, 150.0)
    assert level == Ray(5000.0 / 1500.0, 5000.0, 0.0, 0.0)
    assert layers.between(300.0, 50.0, 50.0) == Ray(300.0 / 1520.0, 300.0, 0.0, 0.0), "the layer above is even"
    assert layers.between(0.0, 20.0, 20.0) == Ray(0.0, 0.0, 0.0, 0.0)
    column = WaterColumn(Profile((0.0, 10.0), (1000.0, 1001.0), (1480.0, 1480.0)), 9.8)
    assert column.rays(50.0) is None
    assert WaterColumn(Profile((0.0,), (1000.0,)), 9.8).rays(50.0) is None


@pytest.mark.parametrize(
    ("arguments", "absorption"),
    [
        ((1e4,), 9.61402e-4), ((1e5,), 0.0335841), ((5e5,), 0.124574), ((1e5, 20.0), 0.0380052),
        ((1e5, 25.0, 38.0, 500.0), 0.0369211), ((5e4, 4.0, 35.0, 3000.0, 7.7), 9.70485e-3),
        ((3e5, 10.0, 0.0), 0.0279613),
    ],
)  # fmt: skip
def test_absorption_depends_on_frequency_temperature_salinity_depth_and_acidity(
    arguments: tuple[float, ...], absorption: float
) -> None:
    assert francois_garrison(*arguments) == pytest.approx(absorption, rel=6e-6)
    assert francois_garrison(1e5, 20.0001) == pytest.approx(francois_garrison(1e5, 20.0), rel=1e-3)


@pytest.mark.parametrize("depth", [-5.0, 0.0, 1.0, 100.0, 10_000.0])
def test_pressure_is_the_inverse_of_depth_and_none_in_air(depth: float) -> None:
    assert depth_of(pressure_at(depth)) == pytest.approx(max(0.0, depth), rel=1e-6)
