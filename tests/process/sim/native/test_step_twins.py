"""A whole simulation in C gives the same numbers as in Python, also after changes between steps."""

import random
import sys
from itertools import pairwise
from math import pi

import pytest

from hil.common.errors import ConfigError
from sim.assembly import make_state
from sim.dynamics import State
from sim.environment.obstacles import Box, Cylinder
from sim.environment.relief import Sinusoid
from sim.environment.terrain import Terrain, covering
from sim.environment.world import World
from sim.rotations import from_euler, normalise
from sim.sensors.imu import Imu, ImuModel
from sim.sensors.mounting import Mounting
from sim.sensors.samples import ImuSample
from sim.vehicle.failures import Failure
from tests.support.flights.ride import Ride, all_of, twins

pytestmark = pytest.mark.usefixtures("native")

EXTENT = (-6.0, 6.0, -6.0, 6.0)
FLAT = World("flat", "test", EXTENT, 6.0, current=(0.1, -0.05, 0.02))
PILES = Cylinder(3.0, 0.0, 1.0), Cylinder(-4.0, 0.0, 1.5, top=4.0)
FIELD = FLAT._replace(walls=True, cylinder=PILES, box=(Box(0.0, 4.0, 3.0, 1.0, 0.5),))


def test_steps_are_equal_among_obstacles(monkeypatch: pytest.MonkeyPatch) -> None:
    """The vehicle is pushed against walls, piles, a block and the seabed, and put elsewhere, also into something."""
    ride = Ride(twins(monkeypatch, FIELD))
    assert ride.pair[1]._fused
    for _ in range(40):
        ride.run_and_compare(80)
        ride.set_position([ride.rng.uniform(-6.5, 6.5), ride.rng.uniform(-6.5, 6.5), ride.rng.uniform(-0.2, 6.2)])
    assert 50 < ride.touches < 2400
    assert ride.pair[0].contacts > 10
    assert ride.samples > 500


def test_steps_are_equal_over_relief(monkeypatch: pytest.MonkeyPatch) -> None:
    grid = covering(EXTENT, 0.5)
    relief = Terrain(grid, Sinusoid(5.0, 0.5, 5.0, 0.3).depths(grid), 5.0)
    ride = Ride(twins(monkeypatch, FLAT._replace(terrain=relief)))
    for depth in (3.0, 4.0, 4.5, 4.7, 4.8, 5.0, 5.5):
        ride.set_position((0.0, 0.0, depth))
        ride.run_and_compare(300)
    assert 20 < ride.touches < 2000


def test_a_failure_during_the_run_takes_effect_alike(monkeypatch: pytest.MonkeyPatch) -> None:
    """The failure is immediate or planned, with earlier pulses still held and other failures before it."""
    ride = Ride(twins(monkeypatch, FIELD))
    ride.run_and_compare(333)
    wrench = ride.pair[1].forces().thrusters
    failures = [Failure("front_left", "efficiency", 0.0, efficiency=0.5), Failure("front_right", "stuck", 1.5)]
    failures.append(Failure("rear_left", "noisy", 1.2, noise=0.3))
    for simulation in ride.pair:
        simulation.fail(*failures)
        assert simulation.forces().thrusters == wrench
        assert simulation.failures("front_left") == (failures[0],)
    assert all_of(ride.pair[0]) == all_of(ride.pair[1])
    assert ride.pair[1]._fused is None
    ride.run_and_compare(600)
    for simulation in ride.pair:
        simulation.fail(*[Failure(failure.thruster, "repaired") for failure in failures])
    ride.run_and_compare(300)


def test_wrong_pulses_and_failures_are_refused_in_both(monkeypatch: pytest.MonkeyPatch) -> None:
    ride = Ride(twins(monkeypatch, FLAT))
    for simulation in ride.pair:
        with pytest.raises(ConfigError, match="5 pulses for a vehicle of 8 thrusters"):
            simulation.step([1500] * 5)
        with pytest.raises(ConfigError, match="pwm_us = 1500: give a list of pulses"):
            simulation.step(1500)  # type: ignore[arg-type]
        with pytest.raises(ConfigError, match="no thruster 'nose'"):
            simulation.fail(Failure("nose", "off"))
        assert simulation.time_ns == 0
    ride.run_and_compare(100)


def test_the_fields_of_a_state_in_c_are_assigned_as_a_whole() -> None:
    state = make_state((1.0, 2.0, 3.0), from_euler(0.1, 0.2, 0.3))
    before = state.nu
    state.nu = [1, 2.0, 3.0, 4.0, 5.0, 6.0]
    assert list(before) == [0.0] * 6
    assert list(state.nu) == [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]
    with pytest.raises(TypeError):
        state.nu[0] = 7.0
    with pytest.raises(ValueError, match="3 numbers are needed, found 2"):
        state.position = (1.0, 2.0)
    with pytest.raises(TypeError):
        state.quaternion = ["x"] * 4  # type: ignore[list-item]
    with pytest.raises(AttributeError, match="nu_dot"):
        del state.nu_dot
    assert list(state.position) == [1.0, 2.0, 3.0]


@pytest.mark.parametrize("position", [(0.0, 0.0, 0.0), (0.3, -0.2, 0.1), (0.0, 0.0, -0.5)])
@pytest.mark.parametrize("angles", [(0.0, 0.0, 0.0), (0.0, pi, 0.2)])
def test_every_imu_sample_is_equal(
    position: tuple[float, float, float], angles: tuple[float, float, float], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The state may be one of Python or of C."""
    scenes = twins(monkeypatch, FLAT, sensors={})
    units = []
    for native, scene in zip("01", scenes, strict=True):
        monkeypatch.setenv("UUV_HIL_NATIVE", native)
        units.append(Imu(ImuModel(), Mounting(position, angles), 5, scene))
    rng = random.Random(2)
    for step in range(1000):
        quaternion = normalise([rng.gauss(0.0, 1.0) for _ in range(4)])
        states = State((0.0, 0.0, 5.0), quaternion), make_state((0.0, 0.0, 5.0), quaternion)
        nu, nu_dot = ([rng.gauss(0.0, 2.0) for _ in range(6)] for _ in "ab")
        for state in states:
            state.nu, state.nu_dot = nu, nu_dot
        first, second = (unit.sample(step, states[(step + i) % 2]) for i, unit in enumerate(units))
        assert type(first) is type(second) is ImuSample
        assert repr(first) == repr(second)
        assert hash(first) == hash(second)


def test_steps_and_samples_leak_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    """A leak grows with every thousand steps; modules and caches count once."""
    _, simulation = twins(monkeypatch, FIELD)
    state, counts = simulation.state, []
    for _ in range(5):
        for step in range(1000):
            simulation.step([1500 + step % 3] * 8)
            state.nu, state.nu_dot = state.nu, state.nu_dot
        counts.append((sys.getrefcount(state), sys.getallocatedblocks()))
    assert min(after[1] - before[1] for before, after in pairwise(counts)) < 100
    assert counts[4][0] == counts[1][0]


def test_the_extension_checks_the_arguments_of_a_step() -> None:
    module = sys.modules["sim.native._native"]
    state, bank = make_state((0.0,) * 3, (1.0, 0.0, 0.0, 0.0)), module.ThrusterBank(bytes(144))
    with pytest.raises(TypeError):
        module.FusedStep(State(), None, bank, print, 1, 0.1, (0.0,) * 3, None, None, None, (0.0,) * 5)
    with pytest.raises(TypeError):
        module.FusedStep(state, None, bank, print, 1, 0.1, (0.0,) * 3, None, None, None, (0.0,) * 5)
    with pytest.raises(ValueError, match="the errors of 9 quantities"):
        module.Imu(module.Errors(bytes(176), bytes(2500), None), ImuSample, (0.0,) * 3, 9.8)
    with pytest.raises(TypeError, match="a class of tuples"):
        module.Imu(module.Errors(bytes(9 * 176), bytes(2500), None), State, (0.0,) * 3, 9.8)
