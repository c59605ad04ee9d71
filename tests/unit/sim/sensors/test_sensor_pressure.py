"""Pressure under waves: linear theory, and its limit at the surface."""

from itertools import pairwise
from math import cosh, exp, radians, sin
from statistics import pstdev

import pytest

from sim.dynamics import State
from sim.environment.ocean import Ocean, Profile, Waves
from sim.environment.seawater.pressure import ATMOSPHERE_PA, depth_of, pressure_at
from sim.environment.waves import WaveField
from sim.environment.world import World, water_pressure
from sim.sensors.mounting import Mounting
from sim.sensors.pressure import Pressure, PressureModel
from sim.simulation import Simulation
from tests.support.fitted import EXACT, VEHICLE

G = 9.80665
MODEL = PressureModel(error=EXACT)
SEA = World("sea", "test", (-100.0, 100.0, -100.0, 100.0), 25.0)
SMALL = Waves(0.02, 6.0, components=1)
ROUGH = Waves(2.0, 6.0, components=30, spread=0.4)
TIMES = [0.31 * i for i in range(40)]


@pytest.mark.parametrize(
    ("north", "depth", "decibar"),
    [(0.0, 9725.47, 1e4), (30.0, 9712.653, 1e4), (90.0, 9674.23, 1e4), (45.0, 6e3, 6134.9813), (45.0, 1e3, 1010.637)],
)
def test_pressure_is_that_of_published_tables(north: float, depth: float, decibar: float) -> None:
    """UNESCO 44 (1983), table and check value, and TEOS-10 (gsw.p_from_z), for the standard ocean."""
    sine = sin(radians(north)) ** 2
    weight = 1028.1063 * 9.780318 * (1.0 + (5.2788e-3 + 2.36e-5 * sine) * sine)
    assert pressure_at(depth, weight) == pytest.approx(1e4 * decibar, rel=1e-4)
    assert depth_of(pressure_at(depth, weight), weight) == pytest.approx(depth, rel=1e-7)
    assert pressure_at(-1.0) == 0.0


@pytest.mark.parametrize("depth", [3.0, 25.0, 4000.0])
@pytest.mark.parametrize("share", [0.02, 0.1, 0.5, 1.0])
def test_a_small_wave_gives_the_pressure_of_linear_theory(depth: float, share: float) -> None:
    """The pressure is rho g a cosh(k (h - z)) / cosh(k h) cos(theta), over rho g, to the square of steepness."""
    wave_field = WaveField(SMALL, depth, G, 3)
    (wave,) = wave_field.components
    z = share * min(depth, 50.0)
    k = wave.wave_number
    decay = cosh(k * (depth - z)) / cosh(k * depth) if k * depth < 300.0 else exp(-k * z)
    for time in TIMES:
        head = wave_field.pressure_depth(time, 4.0, -3.0, z) - z
        expected = wave_field.elevation(time, 4.0, -3.0) * decay
        assert head == pytest.approx(expected, abs=2.0 * k * wave.amplitude**2)


def test_pressure_is_zero_at_the_surface_in_crests_and_troughs() -> None:
    wave_field = WaveField(ROUGH, 25.0, G, 3)
    heights = [wave_field.elevation(time, 4.0, -3.0) for time in TIMES]
    assert max(heights) > 0.5
    assert min(heights) < -0.5
    for time, height in zip(TIMES, heights, strict=True):
        assert wave_field.pressure_depth(time, 4.0, -3.0, -height) == pytest.approx(0.0, abs=1e-12)
        assert wave_field.pressure_depth(time, 4.0, -3.0, -height - 0.2) < 0.0
        below = [wave_field.pressure_depth(time, 4.0, -3.0, -height + 0.05 * i) for i in range(400)]
        assert all(b > a for a, b in pairwise(below))  # more the deeper, from the surface on
        just = wave_field.pressure_depth(time, 4.0, -3.0, 0.01 - height)
        assert just == pytest.approx(0.01, rel=0.35)  # less the water's own acceleration


def test_waves_have_no_pressure_far_down() -> None:
    wave_field = WaveField(ROUGH, 4000.0, G, 3)
    assert pstdev(wave_field.pressure_depth(time, 0.0, 0.0, 2.0) for time in TIMES) > 0.2
    assert pstdev(wave_field.pressure_depth(time, 0.0, 0.0, 150.0) for time in TIMES) < 1e-3


@pytest.mark.parametrize("profile", [None, Profile((0.0, 10.0), (1020.0, 1030.0))])
def test_the_wave_pressure_is_that_at_the_sensor(profile: Profile | None) -> None:
    world = SEA._replace(ocean=Ocean(waves=ROUGH, profile=profile))
    simulation = Simulation(VEHICLE, world, {}, seed=5, position=(0.0, 0.0, 5.0))
    sensor, calm = Pressure(MODEL, Mounting((2.0, 0.0, 0.5)), 1, simulation), water_pressure(world)
    wave_field = WaveField(ROUGH, 25.0, world.gravity, 5)
    for time_ns in range(0, 20_000_000_000, 500_000_000):
        found = sensor.sample(time_ns, State((1.0, 2.0, 1.5))).pascal
        felt = wave_field.pressure_depth(time_ns * 1e-9, 3.0, 2.0, 2.0)
        assert found == pytest.approx(ATMOSPHERE_PA + calm(felt), rel=1e-14)
    in_the_air = sensor.sample(0, State((1.0, 2.0, -5.0))).pascal
    assert in_the_air == ATMOSPHERE_PA
