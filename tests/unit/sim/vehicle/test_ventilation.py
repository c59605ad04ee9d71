"""Ventilation: thrusters lose thrust as they come out of the water."""

from collections.abc import Sequence
from itertools import pairwise
from math import pi

import pytest

from sim.environment.ocean import Ocean, Waves
from sim.environment.world import World
from sim.rotations import from_euler
from sim.simulation import Simulation
from sim.vehicle.vehicle import load_vehicle
from sim.vehicle.ventilation import Ventilation, thrust_share

HEAVY, _ = load_vehicle("bluerov2_heavy")
REMUS, _ = load_vehicle("remus100")
NEARLY_OUT = -max(thruster.position[2] for thruster in HEAVY.thrusters)  # the lowest hubs at the surface
SEA = World("sea", "test", (-100.0, 100.0, -100.0, 100.0), 50.0)


def test_the_thrust_share_is_that_of_the_source() -> None:
    """The share is a third at the surface, none half a radius above it, all 1.3 radii below, and never jumps."""
    assert thrust_share(0.0) == pytest.approx(0.325)
    assert thrust_share(1.0) == pytest.approx(1.0 - 0.675 * 0.231**1.258)
    assert thrust_share(1.31) == thrust_share(1e9) == 1.0
    assert thrust_share(-0.49) == thrust_share(-1e300) == 0.0
    shares = [thrust_share(0.001 * step) for step in range(-600, 1500)]
    assert all(0.0 <= after - before < 0.003 for before, after in pairwise(shares))


def thrust_at_depth(depth: float, roll: float = 0.0, world: World = SEA) -> tuple[list[float], Sequence[float]]:
    """Return thrusts and wrench of bluerov2_heavy soon after a command of full ahead, held at `depth` m."""
    simulation = Simulation(HEAVY, world, {}, position=(0.0, 0.0, depth))
    for _ in range(200):
        state = simulation.state
        state.position, state.quaternion, state.nu = [0.0, 0.0, depth], from_euler(roll, 0.0, 0.0), [0.0] * 6
        simulation.step([1900] * 8)
    return simulation.thrusts, simulation.forces().thrusters


def test_a_vehicle_in_the_air_has_no_thrust() -> None:
    in_air, nothing = thrust_at_depth(-0.4)
    assert not any(in_air)
    assert not any(nothing)
    deep, force = thrust_at_depth(5.0)
    assert min(map(abs, deep)) > 10.0
    assert any(force)
    (*less,), _ = thrust_at_depth(NEARLY_OUT)
    assert all(0.0 <= a / b <= 1.0 for a, b in zip(less, deep, strict=True))
    assert 0.1 < sum(a / b for a, b in zip(less, deep, strict=True)) / 8 < 0.99


def test_thrust_is_whole_below_the_reach_and_lost_above_it() -> None:
    """Its hub is highest when the vehicle stands on its nose."""
    calm, on_its_nose = Ventilation(REMUS, None), from_euler(0.0, -0.5 * pi, 0.0)
    assert calm.shares((0.0, 0.0, calm.reach + 1e-3), on_its_nose, 0.0) == [1.0]
    assert calm.shares((0.0, 0.0, calm.reach - 0.02), on_its_nose, 0.0)[0] < 1.0


def test_each_thruster_loses_thrust_by_its_own_position() -> None:
    """A vehicle rolled by a quarter turn has the thrusters of one side in the air; those below have full thrust."""
    deep, _ = thrust_at_depth(5.0)
    ratios = [a / b for a, b in zip(thrust_at_depth(0.0, 0.5 * pi)[0], deep, strict=True)]
    up = [i for i, thruster in enumerate(HEAVY.thrusters) if thruster.position[1] < -0.1]
    down = [i for i, thruster in enumerate(HEAVY.thrusters) if thruster.position[1] > 0.1]
    assert up
    assert down
    assert [ratios[i] for i in up] == [0.0] * len(up)
    assert [ratios[i] for i in down] == pytest.approx([1.0] * len(down))


def test_waves_change_the_thrust_share() -> None:
    """The share at one position and depth rises and falls with the surface above it."""
    waves = Waves(significant_height=1.0, peak_period=5.0)
    simulation = Simulation(HEAVY, SEA._replace(ocean=Ocean(waves=waves)), {}, position=(0.0, 0.0, 0.5))
    wave_field = simulation.wave_field
    assert wave_field is not None
    surface = Ventilation(HEAVY, wave_field)
    calm = Ventilation(HEAVY, None)
    position, level = (3.0, -2.0, 0.0), (1.0, 0.0, 0.0, 0.0)
    for time in (0.0, 0.7, 1.9, 3.1):
        height = wave_field.elevation(time, 3.0, -2.0)
        assert surface.shares(position, level, time) == calm.shares((3.0, -2.0, height), level, time)
    assert {0.0, 1.0} <= {share for step in range(100) for share in surface.shares(position, level, 0.1 * step)}
    assert surface.reach == pytest.approx(calm.reach + wave_field.max_elevation)
