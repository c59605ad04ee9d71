"""The attitude and heading filter: exact without errors, its convergence, and its error sources."""

from math import asin, atan2, cos, degrees, exp, hypot, radians, sin
from statistics import fmean, pstdev

import pytest

from hil.common.vectors import Quaternion
from sim.dynamics import State
from sim.environment.geomagnetism import DEFAULT
from sim.environment.world import World
from sim.rotations import from_euler, integrate, multiply, rotate, to_euler
from sim.sensors.ahrs import Ahrs, AhrsModel
from sim.sensors.error import ErrorModel
from sim.sensors.mounting import Mounting
from sim.sensors.samples import ImuSample
from tests.support.fitted import EXACT, scene

MODEL = AhrsModel(rate=50.0, angular_velocity=EXACT, acceleration=EXACT, magnetic_field=EXACT)
SEA = World("sea", "test", (-100.0, 100.0, -100.0, 100.0), 20.0, magnetic_field=(50e-6, 1.1, 0.3))
SCENE = scene(SEA)


def angle(a: Quaternion, b: tuple[float, ...] | list[float]) -> float:
    """Return the angle between two attitudes, rad."""
    _, x, y, z = multiply((a[0], -a[1], -a[2], -a[3]), b)
    return 2.0 * asin(min(1.0, hypot(x, y, z)))


def run_filter(ahrs: Ahrs, state: State, seconds: float, rate: float = 50.0) -> ImuSample:
    for i in range(round(seconds * rate)):
        sample = ahrs.sample(i, state)
    return sample


@pytest.mark.parametrize("mounting", [Mounting(), Mounting((0.2, -0.1, 0.3), (0.4, -1.0, 2.5))])
def test_an_ahrs_is_exact_at_rest(mounting: Mounting) -> None:
    state = State((0.0, 0.0, 5.0), from_euler(0.4, -0.6, 2.8))
    sample = run_filter(Ahrs(MODEL, mounting, 1, SCENE), state, 20.0)
    assert angle(sample.orientation, mounting.attitude(state)) < 1e-7
    assert rotate(sample.orientation, sample.acceleration) == pytest.approx((0.0, 0.0, -9.80665))
    assert sample.angular_velocity == (0.0, 0.0, 0.0)


@pytest.mark.parametrize("mounting", [Mounting(), Mounting(orientation=(0.4, -1.0, 2.5))])
def test_an_ahrs_is_exact_while_turning_about_all_axes(mounting: Mounting) -> None:
    """The filter follows a turn on the spot, without accelerations, for 30 s and several turns."""
    ahrs = Ahrs(MODEL, mounting, 1, SCENE)
    state = State((0.0, 0.0, 5.0), from_euler(0.1, 0.2, 0.3))
    before, largest = [0.0, 0.0, 0.0], 0.0
    for i in range(1500):
        t = 0.02 * i
        rate = [0.5 * sin(0.7 * t), 0.4 * cos(0.5 * t), 0.8]
        mean = [0.5 * (a + b) for a, b in zip(before, rate, strict=True)]
        if i:
            state.quaternion = list(integrate(state.quaternion, mean, 0.02))
        state.nu, before = [0.0, 0.0, 0.0, *rate], rate
        sample = ahrs.sample(i, state)
        largest = max(largest, angle(sample.orientation, mounting.attitude(state)))
    assert largest < 1e-4


def test_a_wrong_attitude_converges_with_its_time_constants() -> None:
    """Tilt and heading errors die away as exp(-t / time), each with its own time."""
    model = MODEL._replace(level_time=5.0, heading_time=20.0)
    state = State((0.0, 0.0, 5.0))

    def after(seconds: float, *wrong: float) -> tuple[float, float, float]:
        ahrs = Ahrs(model, Mounting(), 1, SCENE)
        ahrs.sample(0, state)
        ahrs._attitude = from_euler(*wrong)
        return to_euler(run_filter(ahrs, state, seconds).orientation)

    roll, pitch, _ = after(10.0, 0.1, -0.05, 0.0)
    assert roll == pytest.approx(0.1 * exp(-2.0), rel=0.03)
    assert pitch == pytest.approx(-0.05 * exp(-2.0), rel=0.03)
    assert after(10.0, 0.0, 0.0, 0.5) == pytest.approx((0.0, 0.0, 0.5 * exp(-0.5)), rel=0.01, abs=1e-9)


def test_an_acceleration_tilts_the_attitude() -> None:
    """A long push ahead looks like a lean backwards: bow up, as the plumb line says."""
    state = State((0.0, 0.0, 5.0))
    state.nu_dot = [0.5, 0.0, 0.0, 0.0, 0.0, 0.0]
    _, pitch, _ = to_euler(run_filter(Ahrs(MODEL, Mounting(), 1, SCENE), state, 100.0).orientation)
    assert pitch == pytest.approx(atan2(0.5, 9.80665), rel=1e-3)


def test_magnetic_iron_turns_the_heading() -> None:
    """An iron of 1 µT ahead and to starboard, bow along a field of 50 µT cos(1.1), turns north to starboard."""
    iron = Ahrs(MODEL._replace(magnetic_field=ErrorModel(offset=1e-6)), Mounting(), 1, SCENE)
    found = to_euler(run_filter(iron, State((0.0, 0.0, 5.0), from_euler(0.0, 0.0, 0.3)), 150.0).orientation)
    assert found[2] - 0.3 == pytest.approx(-atan2(1e-6, 50e-6 * cos(1.1) + 1e-6), rel=1e-3)


def test_default_errors_equal_those_of_the_data_sheet() -> None:
    """The errors over many units are 0.4 deg of roll and pitch and 1 deg of heading, in the default world's field."""
    default = scene(SEA._replace(magnetic_field=DEFAULT))
    field = AhrsModel().magnetic_field._replace(noise=0.0)  # which at 100 Hz and over 10 s is nearly averaged out
    model = AhrsModel(rate=5.0, level_time=2.0, heading_time=2.0, magnetic_field=field)
    state = State((0.0, 0.0, 5.0), from_euler(0.0, 0.0, 1.0))
    errors = [
        to_euler(run_filter(Ahrs(model, Mounting(), seed, default), state, 15.0, 5.0).orientation)
        for seed in range(250)
    ]
    rolls, pitches, yaws = zip(*errors, strict=True)
    assert degrees(pstdev(rolls)) == pytest.approx(0.4, rel=0.15)
    assert degrees(pstdev(pitches)) == pytest.approx(0.4, rel=0.15)
    assert degrees(pstdev(yaws)) == pytest.approx(1.0, rel=0.2)
    assert fmean(yaws) == pytest.approx(1.0, abs=radians(0.3))
