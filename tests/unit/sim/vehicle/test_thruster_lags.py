"""Models of the thrusters' lag, against analytic responses and the published Euler step."""

from math import atan, isnan, log, sqrt, tanh
from typing import Any

import pytest

from hil.common.errors import ConfigError
from sim.assembly import make_thrusters
from sim.vehicle.thrusters.model import Thruster
from sim.vehicle.thrusters.tables import read_dynamics
from sim.vehicle.vehicle import load_vehicle

PAPER, _ = load_vehicle("paper_six")
PLAIN = Thruster("plain", (0, 0, 0), (1, 0, 0), 80.0, 80.0)
FULL = 300.0  # rad/s
YOERGER = {"kind": "yoerger", "alpha": 0.05, "full_speed": FULL}
BESSA = {"kind": "bessa", "inertia": 2e-4, "kv1": 1e-3, "kv2": 8e-6, "full_speed": FULL}
PI = {"kind": "rotor_pi", "inertia": 1e-3, "kp": 0.02, "ki": 0.5, "load": 5e-6, "full_speed": FULL}


def run(dynamics: dict[str, Any], dt: float, pulses: list[tuple[int, float]]) -> list[float]:
    """Return the rotor's speed (rad/s) after each of these (pulse, seconds), one after the other."""
    thruster = PLAIN._replace(dynamics=read_dynamics(dynamics, "test.toml: dynamics"))
    thrusters = make_thrusters(PAPER._replace(thrusters=(thruster,)), dt)
    speeds = []
    for pulse, seconds in pulses:
        for _ in range(round(seconds / dt)):
            thrusters.step((pulse,))
        thrust = thrusters.thrusts[0]
        speeds.append(FULL * sqrt(abs(thrust) / 80.0) * (1.0 if thrust > 0.0 else -1.0))
    return speeds


@pytest.mark.parametrize("dt", [0.0005, 0.0025, 0.01, 0.05])
def test_yoerger_has_its_analytic_step_response(dt: float) -> None:
    """The speed from rest is s = S tanh(alpha S t); then off, s = s0 / (1 + alpha s0 t); then reverse through zero."""
    up, off, reversed_thrust = run(YOERGER, dt, [(1900, 0.05), (1500, 0.1), (1100, 0.1)])
    s_up = FULL * tanh(0.05 * FULL * 0.05)
    s_off = s_up / (1.0 + 0.05 * s_up * 0.1)
    braking = atan(s_off / FULL) / (0.05 * FULL)  # s' = -alpha (S² + s²) until it stands
    assert up == pytest.approx(s_up, rel=1e-12)
    assert off == pytest.approx(s_off, rel=1e-12)
    assert reversed_thrust == pytest.approx(-FULL * tanh(0.05 * FULL * (0.1 - braking)), rel=1e-12)


@pytest.mark.parametrize("dynamics", [YOERGER, BESSA, {**BESSA, "kv2": 0.0}, {**BESSA, "kv1": 0.02}])
def test_reversals_match_many_small_steps(dynamics: dict[str, Any]) -> None:
    """Reversals both ways, braking with and without roots, match the plain equation in steps of 2 us."""
    k1 = dynamics.get("kv1", 0.0) / dynamics.get("inertia", 1.0)
    k2 = dynamics["kv2"] / dynamics["inertia"] if "kv2" in dynamics else dynamics["alpha"]
    speed, expected = 0.0, []
    for wanted in (FULL, -FULL, FULL * 0.1, 0.0):
        for _ in range(7_500):
            speed += 2e-6 * (k1 * (wanted - speed) + k2 * (wanted * abs(wanted) - speed * abs(speed)))
        expected.append(speed)
    pulses = [(1900, 0.015), (1100, 0.015), (1540, 0.015), (1500, 0.015)]
    for dt in (0.0025, 0.0005):
        assert run(dynamics, dt, pulses) == pytest.approx(expected, rel=2e-3, abs=0.01)
    assert run(dynamics, 0.0025, pulses) == pytest.approx(run(dynamics, 0.0005, pulses), rel=1e-9)


def test_a_pi_rotor_under_load_matches_small_steps() -> None:
    """The rotor matches the plain equations in steps of 2 us, is of second order in the step, and reaches its speed."""
    speed = integral = 0.0
    for _ in range(25_000):
        error = FULL - speed
        speed += 2e-6 * (0.02 * error + 0.5 * integral - 5e-6 * speed * abs(speed)) / 1e-3
        integral += 2e-6 * error
    errors = [abs(run(PI, dt, [(1900, 0.05)])[0] - speed) for dt in (0.01, 0.0025)]
    assert errors[1] < 0.1
    assert errors[0] / errors[1] > 6.0
    for dt in (0.0025, 0.02, 0.05):
        assert run(PI, dt, [(1900, 3.0)]) == pytest.approx([FULL], rel=1e-3)


def test_a_pi_rotor_with_a_weak_integral_stays_too_slow() -> None:
    """The torque left over is kp (S - s) + ki limit = load s²."""
    (speed,) = run({**PI, "integral_limit": 0.2}, 0.0025, [(1900, 3.0)])
    assert 0.02 * (FULL - speed) + 0.5 * 0.2 == pytest.approx(5e-6 * speed * speed, rel=0.02)


@pytest.mark.parametrize("dynamics", [YOERGER, BESSA, PI, {**BESSA, "inertia": 1e-8}, {**PI, "inertia": 1e-7}])
def test_long_steps_stay_stable(dynamics: dict[str, Any]) -> None:
    for dt in (0.02, 1.0):
        ends = run(dynamics, dt, [(1900, 4.0), (1100, 4.0), (1500, 4.0)])
        assert ends[:2] == pytest.approx([FULL, -FULL], rel=0.02)
        assert abs(ends[2]) < 10.0


def test_reverse_limit_and_time_to_half_thrust_are_exact() -> None:
    """The full speed is at each side's limit; the time to half thrust of Yoerger's rotor is that of tanh² = 1/2."""
    thruster = PLAIN._replace(max_reverse=40.0, dynamics=read_dynamics(YOERGER, "test.toml: dynamics"))
    thrusters = make_thrusters(PAPER._replace(thrusters=(thruster,)), 0.0001)
    half = log(1.0 + sqrt(2.0)) / (0.05 * FULL)
    for _ in range(round(half / 0.0001)):
        thrusters.step((1100,))
    assert thrusters.thrusts[0] == pytest.approx(-20.0, rel=2e-3)


def test_the_present_speed_of_a_rotor_is_reported_without_a_current() -> None:
    thruster = PLAIN._replace(dynamics=read_dynamics(YOERGER, "test.toml: dynamics"))
    thrusters = make_thrusters(PAPER._replace(thrusters=(thruster,)), 0.0025)
    for pulse, sign in ((1800, 1.0), (1200, -1.0)):
        for _ in range(200):
            thrusters.step((pulse,))
        ((speed, current),) = thrusters.motors((pulse,))
        assert speed == pytest.approx(sign * FULL * sqrt(abs(thrusters.thrusts[0]) / 80.0))
        assert abs(speed) > 100.0
        assert isnan(current)


def test_wrong_dynamics_are_reported() -> None:
    wrong = {"kind": "bessa", "inertia": 1e-4, "kv1": 0, "kv2": 0, "full_speed": 1}
    with pytest.raises(ConfigError, match="dynamics: kv1 and kv2 are both 0"):
        read_dynamics(wrong, "test.toml: dynamics")
    with pytest.raises(ConfigError, match="'bess' is not one of yoerger, bessa, rotor_pi"):
        read_dynamics({"kind": "bess"}, "test.toml: dynamics")
    with pytest.raises(ConfigError, match="expected a table like"):
        read_dynamics("bessa", "test.toml: dynamics")
