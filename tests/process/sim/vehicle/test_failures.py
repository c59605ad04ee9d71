"""Failures of thrusters, from the scenario and at run time."""

from itertools import pairwise
from statistics import pstdev
from typing import Any

import pytest

from hil.common.errors import ConfigError
from hil.common.schema import parse
from sim.assembly import make_thrusters
from sim.environment.world import load_world
from sim.simulation import Simulation
from sim.vehicle.failures import Failure
from sim.vehicle.thrusters.bank import ThrusterSet, steady_thrust
from sim.vehicle.vehicle import load_vehicle

LAGGED, _ = load_vehicle("paper_six")
VEHICLE = LAGGED._replace(thrusters=tuple(t._replace(time_constant=0.0) for t in LAGGED.thrusters))
FULL = VEHICLE.thrusters[0].max_forward
DT = 0.0025


def failing(*failures: dict[str, Any], seed: int = 0, dt: float = DT) -> ThrusterSet:
    parsed = [parse(table, Failure, "scenario.toml: failure[0]") for table in failures]
    return make_thrusters(VEHICLE, dt, parsed, seed)


def thrusts_of(thrusters: ThrusterSet, pulses: list[int], thruster: int = 1) -> list[float]:
    """Return the thrust of one thruster in each step; the others must not change."""
    thrusts = []
    for pulse in pulses:
        thrusters.step((pulse,) * 6)
        healthy = steady_thrust(VEHICLE.thrusters[0], pulse)
        assert [t for i, t in enumerate(thrusters.thrusts) if i != thruster] == pytest.approx([healthy] * 5)
        thrusts.append(thrusters.thrusts[thruster])
    return thrusts


def test_a_thruster_is_off_from_the_time_of_its_failure() -> None:
    """The failure at 0.1 s is after 40 steps of 2.5 ms: the 41st is the first without thrust."""
    assert thrusts_of(
        failing({"thruster": "front_left", "kind": "off", "time": "100 ms"}), [1900] * 60
    ) == pytest.approx([FULL] * 40 + [0.0] * 20)


def test_efficiency_is_reduced_until_the_repair() -> None:
    thrusters = failing(
        {"thruster": "front_left", "kind": "efficiency", "efficiency": 0.4},
        {"thruster": "front_left", "kind": "repaired", "time": 0.05},
    )
    assert thrusts_of(thrusters, [1900] * 30) == pytest.approx([0.4 * FULL] * 20 + [FULL] * 10)


def test_a_thruster_is_stuck_at_a_given_pulse_or_at_the_last_one() -> None:
    thrust = steady_thrust(VEHICLE.thrusters[0], 1700)
    thrusters = failing({"thruster": "front_left", "kind": "stuck", "pwm_us": 1700})
    assert thrusts_of(thrusters, [1900, 0, 1100]) == pytest.approx([thrust] * 3)
    thrusters = failing({"thruster": "front_left", "kind": "stuck", "time": 2 * DT})
    assert thrusts_of(thrusters, [1500, 1700, 1900, 0]) == pytest.approx([0.0, thrust, thrust, thrust])


def test_pulses_are_delayed_by_whole_steps() -> None:
    thrusters = failing({"thruster": "front_left", "kind": "delayed", "delay": "10 ms", "time": 2 * DT})
    pulses = [1600, 1700, 1500, 1900, 1100, 1600, 1500, 1500, 1500]
    acting = [1600, 1700, 1700, 1700, 1700, 1700, 1500, 1900, 1100]
    assert thrusts_of(thrusters, pulses) == pytest.approx(
        [steady_thrust(VEHICLE.thrusters[0], pulse) for pulse in acting]
    )


def test_noise_is_seeded_and_independent_of_the_step() -> None:
    table = {"thruster": "front_left", "kind": "noisy", "noise": 0.1}
    first, again, other = (thrusts_of(failing(table, seed=seed), [1900] * 200) for seed in (1, 1, 2))
    assert first == again
    assert first != other
    for dt in (0.005, 0.02):
        thrusts = thrusts_of(failing(table, seed=3, dt=dt), [1900] * round(100.0 / dt))
        assert pstdev(thrusts) == pytest.approx(0.1 * FULL, rel=0.09)  # 1000 correlation times: 2 sigma is 4.5 %
        steps = [b - a for a, b in pairwise(thrusts)]
        expected = 0.1 * FULL * (2.0 * (1.0 - 2.718281828 ** (-dt / 0.05))) ** 0.5
        assert pstdev(steps) == pytest.approx(expected, rel=0.06)


STUCK, DELAYED, OFF, WEAK, NOISY, REPAIRED = (
    {"thruster": "front_left", **table}
    for table in (
        {"kind": "stuck", "pwm_us": 1700}, {"kind": "delayed", "delay": "10 ms"}, {"kind": "off"},
        {"kind": "efficiency", "efficiency": 0.5}, {"kind": "noisy", "noise": 0.1, "time": 4 * DT},
        {"kind": "repaired", "time": 5 * DT},
    )
)  # fmt: skip


@pytest.mark.parametrize(
    ("failures", "pulse", "share"),
    [((OFF, STUCK, DELAYED), 1500, 1.0), ((STUCK, DELAYED), 1700, 1.0), ((DELAYED, STUCK), 1700, 1.0),
     ((WEAK, STUCK), 1700, 0.5), ((WEAK, {**WEAK, "efficiency": 0.25}), 1900, 0.25)],
)  # fmt: skip
def test_failures_act_together_in_their_order_and_end_together(
    failures: tuple[dict[str, Any], ...], pulse: int, share: float
) -> None:
    found = thrusts_of(failing(*failures, NOISY, REPAIRED), [1900] * 6)
    assert found[3] == pytest.approx(share * steady_thrust(VEHICLE.thrusters[0], pulse))
    assert found[5] == FULL


def test_the_thruster_lag_continues_during_a_failure() -> None:
    """Half efficiency of a lagged thruster is half of its lagged thrust, not a lag of halves."""
    half, full = make_thrusters(LAGGED, DT), make_thrusters(LAGGED, DT)
    half.fail([Failure("front_left", "efficiency", efficiency=0.5)])
    for pulse in [1900] * 30 + [1200] * 30:
        half.step((pulse,) * 6)
        full.step((pulse,) * 6)
        assert half.thrusts[1] == pytest.approx(0.5 * full.thrusts[1], rel=1e-15)
        assert half.thrusts[0] == full.thrusts[0]


def test_a_failure_at_run_time_turns_the_vehicle() -> None:
    """The bow goes to port when the front left thruster is lost on the way; the same failure later does the same."""
    final_states = []
    for planned in (True, False):
        failure = Failure("front_left", "off", time=0.5)
        simulation = Simulation(
            LAGGED, load_world("paper_field"), position=(0.0, 0.0, 3.0), failures=[failure] if planned else []
        )
        for step in range(400):
            if step == 200 and not planned:
                simulation.fail(failure)
            simulation.step((1600, 1600, 1600, 1600, 1500, 1500))
        final_states.append(simulation.truth())
    assert final_states[0] == final_states[1]
    assert final_states[0].nu[5] < -0.05
    assert simulation.thrusts[1] == pytest.approx(0.0, abs=0.01)


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ({"kind": "efficiency"}, "does nothing without efficiency"),
        ({"kind": "delayed"}, "does nothing without delay"),
        ({"kind": "noisy"}, "does nothing without noise"),
        ({"kind": "off", "delay": 1.0}, "delay belongs to kind 'delayed', not 'off'"),
        ({"kind": "of"}, "did you mean 'off'"),
        ({"kind": "off", "time": "1 m"}, "has the unit 'm'"),
    ],
)
def test_wrong_failures_are_named(table: dict[str, Any], message: str) -> None:
    with pytest.raises(ConfigError, match=r"scenario\.toml: failure") as caught:
        failing({"thruster": "front_left", **table})
    assert message in str(caught.value)


def test_an_unknown_thruster_is_named_with_the_nearest_name() -> None:
    with pytest.raises(ConfigError, match="no thruster 'front_lef'; did you mean 'front_left'"):
        failing({"thruster": "front_lef", "kind": "off"})
    with pytest.raises(ConfigError, match="5 pulses for a vehicle of 6"):
        failing({"thruster": "front_left", "kind": "off"}).step((1500,) * 5)


def test_failures_are_listed_from_their_time_on() -> None:
    weak, off = (
        Failure("front_left", "efficiency", efficiency=0.4),
        Failure("front_left", "off", time=0.05),
    )
    thrusters = make_thrusters(VEHICLE, DT, [off, weak])
    assert thrusters.failures("front_left") == (weak,)
    thrusts_of(thrusters, [1900] * 20)
    assert thrusters.failures("front_left") == (weak,)
    thrusts_of(thrusters, [1900])
    assert thrusters.failures("front_left") == (weak, off)
    weaker = weak._replace(efficiency=0.2)
    thrusters.fail([weaker])
    assert thrusters.failures("front_left") == (weaker, off), "one a kind, at once"
    thrusters.fail([Failure("front_left", "repaired")])
    assert thrusters.failures("front_left") == ()
    assert thrusters.failures("front_right") == ()
    assert make_thrusters(VEHICLE, DT).failures("front_left") == ()
