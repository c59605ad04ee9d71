"""Fins, hull lift, damping, ballast, waves and wind in C give bit for bit the numbers of Python."""

import gc
import random
import weakref
from collections.abc import Sequence
from struct import pack

import pytest

from sim.dynamics import Dynamics, State
from sim.environment.ocean import GaussMarkov, Ocean, Waves
from sim.environment.water import SampledWaves
from sim.environment.wind import Wind
from sim.environment.world import World
from sim.forces import Force
from sim.native import NativeDynamics
from sim.native.waves import NativeSampledWaves, NativeWaveField
from sim.rotations import normalise
from sim.vehicle.body_lift import CrossFlow, CrossFlowDrag, FadingDamping, HullLift, Lift, SlowDamping, SpeedDamping
from sim.vehicle.fins import FinSet
from sim.vehicle.thrusters.model import Azimuth
from sim.vehicle.vehicle import Vehicle, load_vehicle
from tests.support.flights.ride import PULSES, Ride, twins

pytestmark = pytest.mark.usefixtures("native")

REMUS, TETHYS = (load_vehicle(name)[0] for name in ("remus100", "tethys"))
EXTENT = (-500.0, 500.0, -500.0, 500.0)
SWELL = Waves(1.5, 6.0, spread=0.3, components=20)
CALM = World("calm", "test", EXTENT, 60.0, current=(0.1, -0.05, 0.02), wind=Wind(8.0, -1.0))
ROUGH = CALM._replace(depth=12.0, ocean=Ocean(waves=SWELL), wind=None)
MIXED = ROUGH._replace(
    ocean=Ocean(waves=SWELL, gauss_markov=GaussMarkov((0.1, 0.1, 0.0), 60.0)), wind=Wind(15.0, 2.0, gusts=0.2)
)
MOTIONS = (0.0, 1e-9, 0.01, 0.5, 3.0, 30.0)


def ride(monkeypatch: pytest.MonkeyPatch, world: World, vehicle: Vehicle, depth: float = 4.0) -> Ride:
    position = (0.0, 0.0, depth)
    return Ride(twins(monkeypatch, world, vehicle, position=position, dt_ns=10_000_000))


def vehicle_of(name: str) -> Vehicle:
    """Return a preset; "azimuth" is an otter whose thrusters turn."""
    if name != "azimuth":
        return load_vehicle(name)[0]
    otter = load_vehicle("otter")[0]
    turning = [thruster._replace(azimuth=Azimuth(1.5, rate=2.0), torque=0.02) for thruster in otter.thrusters]
    return otter._replace(thrusters=tuple(turning))


VEHICLES = ("azimuth", "bluerov2", "eca_a9", "lauv", "otter", "remus100", "tethys")
WORLDS = {"wind": CALM, "waves": ROUGH, "waves, current and gusts": MIXED}


@pytest.mark.parametrize("name", VEHICLES)
@pytest.mark.parametrize("world", WORLDS)
def test_whole_steps_in_c_and_python_are_equal(name: str, world: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Steps are equal at depth, half out of the water, and among waves, each as one call of C."""
    flight = ride(monkeypatch, WORLDS[world], vehicle_of(name))
    assert flight.pair[1]._fused
    assert not flight.pair[0]._fused
    for depth in (4.0, 0.05, -0.2, 1.5):
        for simulation in flight.pair:
            simulation.state.position = [0.0, 0.0, depth]
        flight.run_and_compare(40)


def test_steps_after_a_dropped_weight_are_equal(monkeypatch: pytest.MonkeyPatch) -> None:
    flight = ride(monkeypatch, ROUGH, TETHYS)
    equipment = flight.pair[1].equipment
    assert equipment
    flight.run_and_compare(100, (1500, 1600))
    assert equipment.weights_aboard
    flight.run_and_compare(100, (1900,))
    assert not equipment.weights_aboard
    assert flight.pair[1]._fused
    flight.run_and_compare(100)


class Crosswind:
    """A user-defined force that depends on all its arguments."""

    def begin(self, time_ns: int) -> None:
        """Nothing changes."""

    def wrench(self, position: Sequence[float], rotation: Sequence[float], nu_r: Sequence[float]) -> Sequence[float]:
        return [rotation[1] * 3.0, nu_r[1] * -2.0, position[2] * 0.01, 0.1, nu_r[4] * -0.3, rotation[2]]


def test_a_user_defined_force_is_computed_in_python(monkeypatch: pytest.MonkeyPatch) -> None:
    flight = Ride(twins(monkeypatch, ROUGH, REMUS, forces=[Crosswind()]))
    assert flight.pair[1]._fused is None
    flight.run_and_compare(200)


def some_forces(rng: random.Random) -> list[Force]:
    """Return a force of every kind, with random numbers."""
    place = (rng.uniform(-1, 1), rng.uniform(-0.3, 0.3), rng.uniform(-0.3, 0.3))
    lift = Lift(rng.uniform(0.01, 1.0), 0.5, stall_angle=rng.choice((0.0, 0.3, 1.5)), position=place)
    fins = FinSet([fin._replace(straightening=rng.random()) for fin in REMUS.fins], 1025.0, 0.01)
    fins.step([rng.choice(PULSES) for _ in REMUS.fins])
    return [
        HullLift(lift._replace(plane=rng.choice(("any", "vertical"))), 1025.0),
        CrossFlowDrag(CrossFlow((1.1, 0.5, 0.3), (0.1, 0.5, 2.0)), (1.6, 0.2, 0.3), 1025.0),
        SpeedDamping([rng.uniform(-5.0, 5.0) for _ in range(36)]),
        SlowDamping(FadingDamping((1.0, 2.0, 3.0, 0.1, 0.2, 0.3), 3.0, rng.choice((0.5, 1.0, 2.0)))),
        fins,
    ]


def test_every_force_is_equal_at_any_motion() -> None:
    """One step is made from many states, with full damping matrices, and motions from none to absurd."""
    rng = random.Random(5)
    for _ in range(400):
        full = tuple(rng.uniform(-1.0, 1.0) + (9.0 if i % 7 == 0 else 0.0) for i in range(36))
        vehicle = REMUS._replace(linear_damping=full, quadratic_damping=full)
        forces = some_forces(rng)
        python = Dynamics(vehicle, 1025.0, 9.81, forces)
        states = State(), State()
        nu = [rng.choice((-1.0, 1.0)) * rng.choice(MOTIONS) for _ in range(6)]
        for state in states:
            state.position = [1.0, 2.0, 3.0]
            state.nu = list(nu)
        quaternion = normalise([rng.gauss(0.0, 1.0) for _ in range(4)])
        states[0].quaternion, states[1].quaternion = list(quaternion), list(quaternion)
        python.step(states[0], (1.0, 2.0, 3.0, 0.1, 0.2, 0.3), (0.1, 0.2, 0.3), 0.001)
        c = NativeDynamics(vehicle, 1025.0, 9.81, forces)
        assert c.has_native_forces
        c.step(states[1], (1.0, 2.0, 3.0, 0.1, 0.2, 0.3), (0.1, 0.2, 0.3), 0.001)
        numbers = [[*s.position, *s.quaternion, *s.nu, *s.nu_dot] for s in states]
        assert pack("19d", *numbers[0]) == pack("19d", *numbers[1])


@pytest.mark.parametrize("depth", [4.0, 12.0, 2000.0])
def test_wave_fields_are_equal(depth: float) -> None:
    from sim.environment.waves import WaveField

    python, c = WaveField(SWELL, depth, 9.81, 4), NativeWaveField(SWELL, depth, 9.81, 4)
    rng = random.Random(6)
    for _ in range(200):
        point = rng.uniform(0.0, 1e4), rng.uniform(-900, 900), rng.uniform(-900, 900)
        down = rng.uniform(-1.0, 1.2 * min(depth, 100.0))
        assert python.elevation(*point) == c.elevation(*point)
        assert python.pressure_depth(*point, down) == c.pressure_depth(*point, down)
        assert repr(python.motion(*point, down)) == repr(c.motion(*point, down))
    sampled, quick = SampledWaves(SWELL, CALM, 4), NativeSampledWaves(SWELL, CALM, 4)
    for step in range(500):  # a walk, and now and then a jump
        jump = rng.uniform(-5.0, 5.0) if step % 50 == 0 else 0.0
        here = (0.004 * step + jump, -0.002 * step, 2.0 + jump * jump)
        assert repr(sampled.motion(step * 2_500_000, here)) == repr(quick.motion(step * 2_500_000, here))
        time, north, east = 0.0025 * step + 0.001, here[0] + 0.003, here[1]
        assert sampled.wave_field.surface(time, north, east) == quick.wave_field.surface(time, north, east)


def test_an_unused_simulation_is_freed(monkeypatch: pytest.MonkeyPatch) -> None:
    """A whole step in C calls back for new pulses, so there is a reference cycle with its simulation."""
    gone = weakref.ref(twins(monkeypatch, MIXED, TETHYS)[1])
    gc.collect()
    assert gone() is None
