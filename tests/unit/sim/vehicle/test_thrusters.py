"""Thrusters: curve and inverse, lag, and the wrench of their poses."""

from math import exp

import pytest

from hil.common.errors import ConfigError
from sim.vehicle.failures import Failure
from sim.vehicle.thrusters.azimuth import turned
from sim.vehicle.thrusters.bank import ThrusterSet, pulse_finder, steady_thrust, wrench_matrix
from sim.vehicle.vehicle import Thruster, load_vehicle

T200 = load_vehicle("bluerov2_heavy")[0].thrusters[0]
SQUARE = Thruster("square", (0, 0, 0), (1, 0, 0), 80.0, 40.0, dead_band_us=25)


@pytest.mark.parametrize(
    ("pulse", "thrust"),
    [(1500, 0.0), (1475, 0.0), (1525, 0.0), (1900, 80.0), (2200, 80.0), (1100, -40.0), (800, -40.0),
     (1525 + 375 // 3, 80.0 / 9.0), (1526, 80.0 / 375.0**2), (1474, -40.0 / 375.0**2)],
)  # fmt: skip
def test_the_square_curve_has_its_values(pulse: int, thrust: float) -> None:
    assert steady_thrust(SQUARE, pulse) == pytest.approx(thrust)


@pytest.mark.parametrize(
    ("pulse", "thrust"),
    [(1100, -39.91), (1200, -26.56), (1300, -14.10), (1400, -4.72), (1600, 5.92), (1700, 17.88), (1800, 33.54),
     (1900, 51.44)],
)  # fmt: skip
def test_the_t200_curve_follows_the_manufacturers_table(pulse: int, thrust: float) -> None:
    """The curve is that of Blue Robotics' T200 performance data, September 2019, 16 V, within 3 % of full thrust."""
    assert steady_thrust(T200, pulse) == pytest.approx(thrust, abs=0.03 * 51.44)


def test_the_inverse_skips_the_dead_band() -> None:
    assert pulse_finder(SQUARE)(0.01) >= 1525
    assert pulse_finder(SQUARE)(-0.01) <= 1475


@pytest.mark.parametrize("share", [0.0, 0.6, 1.0])
def test_a_denormal_thrust_gives_the_neutral_pulse(share: float) -> None:
    least = 5e-324
    assert [pulse_finder(SQUARE._replace(linear_share=share))(thrust) for thrust in (least, -least, -0.0)] == [1500] * 3


@pytest.mark.parametrize("thruster", [SQUARE, T200, T200._replace(pwm_neutral_us=1480, pwm_min_us=1000)])
def test_a_pulse_finder_inverts_the_curve_without_state(thruster: Thruster) -> None:
    """The thrust of the deflection x is k x + (1 - k) x² of the maximum; the finder returns the pulse that has it."""
    find, k = pulse_finder(thruster), thruster.linear_share
    for x in (0.3, -0.9, 1.0, 0.01, -0.01, -1.0, 0.3):
        most = thruster.max_forward if x > 0.0 else -thruster.max_reverse
        assert find(most * (k * abs(x) + (1.0 - k) * x * x)) == thruster.pulse_at(x)


@pytest.mark.parametrize("dt", [0.0005, 0.0025, 0.02])
def test_the_lag_does_not_depend_on_the_step(dt: float) -> None:
    """The response after 0.1 s at tau 0.05 s is 1 - exp(-2), whatever the step."""
    vehicle, _ = load_vehicle("paper_six")
    thrusters = ThrusterSet(vehicle, dt)
    for _ in range(round(0.1 / dt)):
        wrench = thrusters.step((1900,) * 6)
    assert thrusters.thrusts == pytest.approx([73.549875 * (1.0 - exp(-2.0))] * 6)
    assert wrench[0] == pytest.approx(4 * 0.5**0.5 * thrusters.thrusts[0])


def test_pulses_may_be_lists_or_tuples_of_the_right_length() -> None:
    vehicle, _ = load_vehicle("paper_six")
    one, other = ThrusterSet(vehicle, 0.01), ThrusterSet(vehicle, 0.01)
    assert one.step([1600] * 6) == other.step((1600,) * 6)
    with pytest.raises(ConfigError, match="5 pulses for a vehicle of 6 thrusters"):
        one.step([1600] * 5)


def test_a_thruster_that_fails_later_sticks_at_its_present_pulse() -> None:
    thrusters = ThrusterSet(load_vehicle("paper_six")[0], 1.0)
    thrusters.step((1700,) * 6)
    thrusters.fail([Failure("front_left", "stuck"), Failure("rear_left", "efficiency", efficiency=0.5)])
    assert (before := thrusters.reports) == thrusters.thrusts
    thrusters.step((1300,) * 6)
    assert thrusters.reports == thrusters.thrusts, "without a loss in the water"
    assert [i for i, (a, b) in enumerate(zip(thrusters.thrusts, before, strict=True)) if a == pytest.approx(b)] == [1]
    with pytest.raises(ConfigError, match="no thruster 'x'"):
        thrusters.fail([Failure("x", "off", time=9.0)])


def test_one_thruster_has_its_wrench() -> None:
    """The moment is position x force: a push down at the starboard bow rolls to starboard and lowers the bow."""
    vehicle = load_vehicle("paper_six")[0]
    at = (0.1, 0.2, 0.3)
    thrusters = tuple(SQUARE._replace(position=at, direction=d) for d in ((2, 0, 0), (0, 3, 0), (0, 0, 4)))
    assert [turned(each).direction for each in thrusters] == [(0, 2, 0), (-3, 0, 0), (0, 0, 4)]  # clockwise from above
    columns = list(zip(*wrench_matrix(vehicle._replace(thrusters=thrusters)), strict=True))
    assert columns == [(1, 0, 0, 0, 0.3, -0.2), (0, 1, 0, -0.3, 0, 0.1), (0, 0, 1, 0.2, -0.1, 0)]


def test_the_wrench_matrix_of_the_reference_vehicle_is_as_published() -> None:
    rows = wrench_matrix(load_vehicle("paper_six")[0])
    c, arm = 0.5**0.5, 0.25 * 0.5**0.5
    assert rows == [
        pytest.approx([c, c, c, c, 0, 0]),
        pytest.approx([-c, c, c, -c, 0, 0]),
        pytest.approx([0, 0, 0, 0, 1, 1]),
        pytest.approx([0, 0, 0, 0, 0.13, -0.13]),
        pytest.approx([0, 0, 0, 0, 0, 0]),
        pytest.approx([-arm, arm, -arm, arm, 0, 0]),
    ]
