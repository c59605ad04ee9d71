"""Waves: spectra, dispersion and the flow of linear theory."""

from itertools import pairwise
from math import cos, cosh, exp, pi, sin, sqrt
from statistics import fmean, pstdev

import pytest

from sim.environment.ocean import Waves
from sim.environment.waves import WaveField, _sinc, components, spectral_density

G = 9.80665
SEA = Waves(significant_height=1.5, peak_period=7.0, direction=0.6, spread=0.3)
DEPTHS = [3.0, 20.0, 4000.0]  # shallow, in between, deep


def single(depth: float, period: float = 7.0) -> WaveField:
    """Return a wave field of one wave."""
    return WaveField(Waves(0.5, period, components=1), depth, G, 1)


def test_the_series_of_a_sinc_equals_it() -> None:
    assert _sinc(0.0) == 1.0
    for x in (0.1, 0.7, 1.2, 1.5, 1.6, 3.0):
        assert _sinc(x) == _sinc(-x) == pytest.approx(sin(x) / x, abs=4e-8)


# -- spectrum and components --------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("waves", "tolerance"),
    [
        (Waves(2.0, 8.0, "pierson_moskowitz"), 0.002),
        (Waves(2.0, 8.0, gamma=1.0), 0.002),
        (Waves(2.0, 8.0), 0.02),
        (Waves(2.0, 8.0, gamma=6.0), 0.03),
    ],
)
def test_the_spectrum_has_its_energy_and_peak(waves: Waves, tolerance: float) -> None:
    """The spectrum's area is Hs²/16; its greatest value is at the peak period."""
    omegas = [0.002 * i for i in range(100, 5000)]
    values = [spectral_density(waves, omega) for omega in omegas]
    assert 4.0 * sqrt(0.002 * sum(values)) == pytest.approx(2.0, rel=tolerance)
    assert omegas[values.index(max(values))] == pytest.approx(2.0 * pi / 8.0, abs=0.003)


def test_pierson_moskowitz_agrees_with_its_original_form() -> None:
    """The spectrum is 0.0081 g² / omega⁵ exp(-0.74 (g / (U omega))⁴) (Pierson and Moskowitz 1964), for its Hs, Tp."""
    wind = 12.0
    peak = (4.0 * 0.74 / 5.0) ** 0.25 * G / wind
    height = 4.0 * sqrt(0.0081 * G * G / (4.0 * 0.74) * (wind / G) ** 4)
    waves = Waves(height, 2.0 * pi / peak, "pierson_moskowitz")
    for omega in (0.5, 0.7, 1.0, 2.0):
        first = 0.0081 * G * G / omega**5 * exp(-0.74 * (G / (wind * omega)) ** 4)
        assert spectral_density(waves, omega) == pytest.approx(first, rel=1e-9)


@pytest.mark.parametrize(("count", "gamma"), [(5, 3.3), (50, 3.3), (50, 1.0), (200, 10.0)])
def test_the_components_have_the_energy_of_the_spectrum(count: int, gamma: float) -> None:
    """The elevation's sum of a²/2 is Hs²/16; its rate's sum of (a omega)²/2 is the second moment of the spectrum."""
    waves = Waves(1.5, 7.0, gamma=gamma, components=count)
    generated = components(waves, 50.0, G, 3)
    assert len(generated) == count
    assert sum(0.5 * wave.amplitude**2 for wave in generated) == pytest.approx(1.5**2 / 16.0, rel=1e-12)
    cell = 1e-3
    omegas = [cell * i for i in range(260, 5386)]  # 0.3 to 6 times the peak
    values = [spectral_density(waves, omega) for omega in omegas]
    moment = sum(v * w * w for v, w in zip(values, omegas, strict=True)) / sum(values)
    rate = sum(0.5 * (wave.amplitude * wave.omega) ** 2 for wave in generated) / (1.5**2 / 16.0)
    assert rate == pytest.approx(moment, rel=2e-3)
    assert all(b.omega > a.omega * (1.0 + 1e-5) for a, b in pairwise(generated))  # no two swing alike


def test_waves_depend_on_seed_and_direction() -> None:
    assert components(SEA, 30.0, G, 5) == components(SEA, 30.0, G, 5)
    assert components(SEA, 30.0, G, 5) != components(SEA, 30.0, G, 6)
    headings = [wave.heading for wave in components(SEA._replace(components=500), 30.0, G, 5)]
    assert fmean(headings) == pytest.approx(0.6, abs=0.05)
    assert pstdev(headings) == pytest.approx(0.3, rel=0.1)
    assert {wave.heading for wave in components(SEA._replace(spread=0.0), 30.0, G, 5)} == {0.6}


# -- the field ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("depth", DEPTHS)
def test_velocity_is_the_gradient_of_the_potential(depth: float) -> None:
    """The flow is that of phi = sum of a g / omega cosh(k (h - z)) / cosh(k h) sin(theta), and Laplace's equation
    holds.
    """
    wave_field = WaveField(SEA, depth, G, 2)

    def potential(time: float, north: float, east: float, z: float) -> float:
        total = 0.0
        for a, omega, k, heading, phase in wave_field.components:
            rise = cosh(k * (depth - z)) / cosh(k * depth) if k * depth < 300.0 else exp(-k * z)
            theta = k * (cos(heading) * north + sin(heading) * east) - omega * time + phase
            total += a * G / omega * rise * sin(theta)
        return total

    step = 1e-4
    for time, n, e, z in [(0.0, 1.0, 2.0, 0.5), (31.0, -8.0, 5.0, 1.7), (77.0, 40.0, -9.0, 2.5)]:
        gradient = (
            (potential(time, n + step, e, z) - potential(time, n - step, e, z)) / (2.0 * step),
            (potential(time, n, e + step, z) - potential(time, n, e - step, z)) / (2.0 * step),
            (potential(time, n, e, z + step) - potential(time, n, e, z - step)) / (2.0 * step),
        )
        assert wave_field.motion(time, n, e, z).velocity == pytest.approx(gradient, abs=1e-7)


@pytest.mark.parametrize("depth", DEPTHS)
def test_the_acceleration_is_that_of_a_fluid_particle(depth: float) -> None:
    """The acceleration is that of a particle that moves along; at a fixed point it differs."""
    wave_field, step = WaveField(SEA._replace(peak_period=4.0), depth, G, 4), 1e-4
    point = (5.0, 6.0, 1.0)
    for time in (0.0, 12.0, 100.0):
        velocity, acceleration, *_ = wave_field.motion(time, *point)
        next_point = [x + step * v for x, v in zip(point, velocity, strict=True)]
        previous_point = [x - step * v for x, v in zip(point, velocity, strict=True)]
        later, earlier = (
            wave_field.motion(time + step, *next_point).velocity,
            wave_field.motion(time - step, *previous_point).velocity,
        )
        rate = [(b - a) / (2.0 * step) for a, b in zip(earlier, later, strict=True)]
        assert acceleration == pytest.approx(rate, abs=1e-6)
        fixed = wave_field.motion(time + step, *point).velocity[0] - wave_field.motion(time - step, *point).velocity[0]
        assert abs(fixed / (2.0 * step) - acceleration[0]) > 1e-4


def test_the_surface_moves_with_the_water() -> None:
    """The elevation grows as fast as the water rises at that point."""
    wave_field, step = WaveField(SEA, 12.0, G, 6), 1e-4
    for time in (1.0, 20.0, 33.0):
        rate = (wave_field.elevation(time + step, 3.0, 4.0) - wave_field.elevation(time - step, 3.0, 4.0)) / (
            2.0 * step
        )
        assert -wave_field.motion(time, 3.0, 4.0, 0.0).velocity[2] == pytest.approx(rate, abs=1e-6)


def test_the_motion_ends_at_the_surface_and_at_the_seabed() -> None:
    wave_field = single(5.0)
    assert wave_field.motion(3.0, 0.0, 0.0, 5.0).velocity[2] == pytest.approx(0.0, abs=1e-12)
    assert wave_field.motion(3.0, 0.0, 0.0, 9.0) == wave_field.motion(3.0, 0.0, 0.0, 5.0)
    assert wave_field.motion(3.0, 0.0, 0.0, -1.0) == wave_field.motion(3.0, 0.0, 0.0, 0.0)


def test_nothing_overflows_far_below_short_waves() -> None:
    """The motion is finite where exp(k z) would overflow."""
    wave_field = WaveField(Waves(0.1, 1.0), 11_000.0, G, 1)
    assert wave_field.motion(1.0, 0.0, 0.0, 10_999.0).velocity == pytest.approx((0.0, 0.0, 0.0), abs=1e-300)
    assert any(wave_field.motion(1.0, 0.0, 0.0, 0.0).velocity)


def test_a_crest_travels_in_the_waves_direction() -> None:
    """A crest passes a point farther east k / omega later."""
    wave_field = WaveField(Waves(0.5, 7.0, direction=pi / 2.0, components=1), 50.0, G, 1)
    wave = wave_field.components[0]
    later = 10.0 * wave.wave_number / wave.omega
    assert wave_field.elevation(4.0 + later, 0.0, 10.0) == pytest.approx(wave_field.elevation(4.0, 0.0, 0.0))
    assert wave_field.elevation(4.0, 77.0, 0.0) == pytest.approx(wave_field.elevation(4.0, 0.0, 0.0))
