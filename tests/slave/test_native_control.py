"""What makes pulses of a command in C gives the very bits of what does in Python; and which of the two is taken."""

import random
import sys
from collections.abc import Iterator
from pathlib import Path
from struct import pack
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hil.autonomy.allocation import Allocator
from hil.autonomy.control import CascadedController, Gains, Navigation, VelocityCommand, Wrench
from hil.autonomy.families import Controller
from hil.schema import parse, preset_names
from hil.slave.native import NativeAllocator, NativeCascade, make_allocator, make_cascade, make_pulse_finder
from hil.slave.pilot import OTHERS
from sim.rotations import from_euler
from sim.thrusters import pulse_finder, wrench_matrix
from sim.vehicle import Vehicle, load_vehicle, mass_matrix
from tests.autonomy.controller_contract import ANY, DT, ControllerContract, inputs
from tests.twins import EACH, taken_from

BINARY = "hil.slave.native._control"
INERTIA: Wrench = (20.0, 30.0, 40.0, 1.0, 2.0, 3.0)
LIMITS: Wrench = (200.0, 300.0, 400.0, 20.0, 40.0, 60.0)  # the usual gains' limits times the inertia
VEHICLES = [load_vehicle(name) for name in preset_names("sim/vehicles")]
PLAIN = [vehicle for vehicle, _ in VEHICLES if all(thruster.curve is None for thruster in vehicle.thrusters)]


@pytest.fixture(autouse=True)
def native(binaries: Path) -> Iterator[None]:
    with taken_from(binaries):
        yield


def bits(numbers: Any) -> bytes:
    return pack(f"{len(numbers)}d", *numbers)


def gains_of(seed: int) -> Gains:
    """All of a cascade's numbers at random: some loops with a derivative, some with a slew limit."""
    chance = random.Random(seed)

    def axis(usual: Any) -> Any:
        return usual._replace(
            p=chance.uniform(0.0, 8.0), i=chance.uniform(0.0, 8.0), d=chance.choice([0.0, chance.uniform(0.0, 1.0)]),
            limit=chance.uniform(0.5, 20.0), feedforward=chance.choice([0.0, chance.uniform(0.0, 2.0)]),
            filter=chance.uniform(0.0, 0.1), slew=chance.choice([float("inf"), chance.uniform(0.5, 50.0)]),
        )  # fmt: skip

    def hold(usual: Any) -> Any:
        return usual._replace(p=chance.uniform(0.0, 3.0), limit=chance.uniform(0.1, 1.5))

    usual = Gains()
    return Gains(*map(axis, usual[:6]), *map(hold, usual[6:]))


class TestNativeCascade(ControllerContract):
    limits = LIMITS

    def make(self) -> Controller:
        return NativeCascade(Gains(), INERTIA)


@EACH
@given(st.integers(0, 10_000), st.lists(inputs(ANY) | inputs(st.floats(-3.0, 3.0)), min_size=1, max_size=12))
def test_a_cascade_gives_the_same_bits_whatever_comes(seed: int, calls: list[Any]) -> None:
    gains = gains_of(seed)
    python, c = CascadedController(gains, INERTIA), NativeCascade(gains, INERTIA)
    for number, call in enumerate(calls):
        assert bits(c.update(*call)) == bits(python.update(*call)), f"call {number}"
        if number % 5 == 4:
            python.reset()
            c.reset()


@pytest.mark.parametrize(("vehicle", "control"), [pytest.param(*row, id=row[0].name) for row in VEHICLES])
def test_a_flight_of_each_vehicle_is_the_same(vehicle: Vehicle, control: dict[str, Any]) -> None:
    """Two thousand updates with its own gains: from the command to the pulses, what could not be had fed back."""
    gains = parse({key: value for key, value in control.items() if key not in OTHERS}, Gains, "control")
    limits = [t.max_forward for t in vehicle.thrusters], [t.max_reverse for t in vehicle.thrusters]
    matrix = wrench_matrix(vehicle, torque=False)
    x, y, z, k, m, n = (row[axis] for axis, row in enumerate(mass_matrix(vehicle)))
    python, c = (make(gains, (x, y, z, k, m, n)) for make in (CascadedController, NativeCascade))
    plain, quick = Allocator(matrix, *limits), NativeAllocator(matrix, *limits)
    lack = (0.0,) * 6
    chance = random.Random(vehicle.name)
    for number in range(2000):
        if number % 40 == 0:
            hold = chance.uniform(0.0, 20.0), chance.uniform(-7.0, 7.0)
            depth, heading = (value if chance.random() < 0.5 else None for value in hold)
            surge, sway, heave, turn = (chance.uniform(-1.5, 1.5) for _ in range(4))
            command = VelocityCommand(surge, sway, heave, turn, depth, heading)
        attitude = from_euler(*(chance.uniform(-2.0, 2.0) for _ in range(3)))
        p, q, r, u, v, w = (chance.uniform(-1.0, 1.0) for _ in range(6))
        navigation = Navigation(attitude, (p, q, r), (u, v, w), chance.uniform(0.0, 20.0))
        dt = chance.uniform(0.001, 0.04)
        wrench = python.update(command, navigation, dt, lack)
        assert bits(c.update(command, navigation, dt, lack)) == bits(wrench)
        thrusts, lack = plain.allocate(wrench)
        found, missing = quick.allocate(wrench)
        assert bits(found) == bits(thrusts)
        assert bits(missing) == bits(lack)


@pytest.mark.parametrize("strength", [0.1, 1.0, 10.0])
def test_an_allocator_gives_the_same_bits_within_its_limits_and_beyond(strength: float) -> None:
    limits = [40.0] * 6, [30.0] * 6
    matrix = wrench_matrix(load_vehicle("paper_six")[0], torque=False)
    python, c = Allocator(matrix, *limits), NativeAllocator(matrix, *limits)
    chance, beyond = random.Random(3), 0
    for _ in range(500):
        wrench: Any = [strength * chance.uniform(-60.0, 60.0) for _ in range(3)] + [chance.uniform(-9.0, 9.0)] * 3
        (thrusts, lack), (found, missing) = python.allocate(wrench), c.allocate(wrench)
        assert bits(found) == bits(thrusts)
        assert bits(missing) == bits(lack)
        beyond += max(map(abs, lack[:3])) > 1e-6
    assert (beyond > 400) == (strength == 10.0)
    assert (beyond < 100) == (strength == 0.1)


@EACH
@given(st.sampled_from(VEHICLES), st.tuples(*[ANY | st.floats(-300.0, 300.0)] * 6))
def test_an_allocator_gives_the_same_bits_whatever_comes(row: Any, wrench: Wrench) -> None:
    vehicle, _ = row
    limits = [t.max_forward for t in vehicle.thrusters], [t.max_reverse for t in vehicle.thrusters]
    matrix = wrench_matrix(vehicle, torque=False)
    for ours, theirs in zip(
        NativeAllocator(matrix, *limits).allocate(wrench), Allocator(matrix, *limits).allocate(wrench), strict=True
    ):
        assert [repr(x) for x in ours] == [repr(x) for x in theirs]  # a number that is none has no bits of its own


@EACH
@given(st.sampled_from(PLAIN), st.lists(ANY | st.floats(-120.0, 120.0), min_size=16, max_size=16))
def test_pulses_are_the_same_whatever_comes(vehicle: Vehicle, thrusts: list[float]) -> None:
    thrusts = thrusts[: len(vehicle.thrusters)]
    expected = tuple(pulse_finder(each)(thrust) for each, thrust in zip(vehicle.thrusters, thrusts, strict=True))
    assert make_pulse_finder(vehicle.thrusters)(thrusts) == expected


def test_every_pulse_is_found_again() -> None:
    """Each thrust at the edge between two pulses goes the way that Python rounds."""
    vehicle, _ = load_vehicle("bluerov2_heavy")
    one = vehicle.thrusters[0]
    quick, slow = make_pulse_finder([one]), pulse_finder(one)
    pulses = set()
    for step in range(-20_000, 20_001):
        thrust = step * 0.0025
        assert quick([thrust]) == (slow(thrust),), thrust
        pulses.add(slow(thrust))
    assert len(pulses) > 700


def test_the_quickest_is_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    limits = [40.0] * 6, [30.0] * 6
    matrix = wrench_matrix(load_vehicle("paper_six")[0])
    assert type(make_cascade(Gains(), INERTIA)) is NativeCascade
    assert type(make_allocator(matrix, *limits)) is NativeAllocator
    with monkeypatch.context() as patch:
        patch.setitem(sys.modules, BINARY, None)  # as if made before there was one
        assert type(make_cascade(Gains(), INERTIA)) is CascadedController
    monkeypatch.setenv("UUV_HIL_NATIVE", "0")
    assert type(make_cascade(Gains(), INERTIA)) is CascadedController
    assert type(make_allocator(matrix, *limits)) is Allocator


def test_a_thruster_with_a_curve_of_its_own_stays_in_python() -> None:
    curved = [vehicle for vehicle, _ in VEHICLES if vehicle not in PLAIN]
    assert curved
    for vehicle in curved:
        thrusts = [0.3 * thruster.max_forward for thruster in vehicle.thrusters]
        expected = tuple(pulse_finder(each)(thrust) for each, thrust in zip(vehicle.thrusters, thrusts, strict=True))
        assert make_pulse_finder(vehicle.thrusters)(thrusts) == expected


def test_what_cannot_be_meant_is_refused() -> None:
    module = sys.modules[BINARY]
    with pytest.raises(ValueError, match="448 bytes of parameters are needed, found 8"):
        module.Cascade(bytes(8))
    with pytest.raises(ValueError, match="up to 16 records of 112 bytes are needed, found 1904"):
        module.Allocation(bytes(17 * 112))
    with pytest.raises(ValueError, match="up to 16 records of 80 bytes are needed, found 3"):
        module.Pulses(b"123")
    cascade = NativeCascade(Gains(), INERTIA)
    at_rest = Navigation((1.0, 0.0, 0.0, 0.0), (0.0,) * 3, (0.0,) * 3, 5.0)
    short: Any = (0.0, 0.0)
    bad = at_rest._replace(velocity=short)
    with pytest.raises(ValueError, match="3 numbers are needed, found 2"):
        cascade.update(VelocityCommand(), bad, DT)
    unmeant: Any = "fast"
    with pytest.raises(TypeError):
        cascade.update(VelocityCommand(surge=unmeant), at_rest, DT)
    with pytest.raises(TypeError):
        cascade.update(VelocityCommand(depth=unmeant), at_rest, DT)
    with pytest.raises(ValueError, match="6 numbers are needed, found 5"):
        make_allocator(wrench_matrix(load_vehicle("paper_six")[0]), [40.0] * 6, [30.0] * 6).allocate((0.0,) * 5)
