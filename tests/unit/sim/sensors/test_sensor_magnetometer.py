"""The magnetometer: the earth's field, iron, mounting and errors."""

from math import atan2, cos, pi, sin
from statistics import pstdev

import pytest

from hil.common.errors import ConfigError
from sim.dynamics import State
from sim.environment.world import World
from sim.rotations import from_euler, rotate
from sim.sensors.error import ErrorModel
from sim.sensors.magnetometer import Magnetometer, MagnetometerModel, earth_field
from sim.sensors.mounting import Mounting
from sim.sensors.sensor_set import read_sensors
from tests.support.fitted import EXACT, scene

MODEL = MagnetometerModel(error_xy=EXACT, error_z=EXACT)
SEA = World("sea", "test", (-100.0, 100.0, -100.0, 100.0), 20.0, magnetic_field=(50e-6, 1.1, 0.25))
SCENE = scene(SEA)


def test_the_earths_field_has_its_components() -> None:
    north, east, down = earth_field(SEA)
    assert (north**2 + east**2 + down**2) ** 0.5 == pytest.approx(50e-6)
    assert atan2(east, north) == pytest.approx(0.25)
    assert atan2(down, (north**2 + east**2) ** 0.5) == pytest.approx(1.1)
    southern = earth_field(SEA._replace(magnetic_field=(50e-6, -1.1, 0.0)))
    assert southern[2] < 0.0


@pytest.mark.parametrize("heading", [0.0, 1.0, -2.0, pi])
def test_the_horizontal_field_points_to_magnetic_north(heading: float) -> None:
    """The level field's horizontal part points to magnetic north: heading less declination from the bow."""
    x, y, z = Magnetometer(MODEL, Mounting(), 1, SCENE).sample(7, State(quaternion=from_euler(0, 0, heading))).field
    level = 50e-6 * cos(1.1)
    assert (x, y, z) == pytest.approx((level * cos(heading - 0.25), -level * sin(heading - 0.25), 50e-6 * sin(1.1)))


def test_tilt_and_mounting_rotate_the_field() -> None:
    state = State(quaternion=from_euler(0.5, -0.4, 2.0))
    mounting = Mounting((0.3, 0.2, 0.1), (1.0, 0.5, -2.0))
    sample = Magnetometer(MODEL, mounting, 1, SCENE).sample(7, state)
    turned = rotate(state.quaternion, rotate(from_euler(*mounting.orientation), sample.field))
    assert sample.time_ns == 7
    assert turned == pytest.approx(earth_field(SEA))


def test_hard_and_soft_iron_distort_the_field() -> None:
    """Soft iron acts first, row after row, then hard iron, along the sensor's axes."""
    soft = (1.1, 0.2, 0.0, 0.0, 0.9, 0.0, 0.0, 0.1, 1.0)
    model = MODEL._replace(hard_iron=(3e-6, -2e-6, 1e-6), soft_iron=soft)
    north, east, down = earth_field(SEA)
    expected = 1.1 * north + 0.2 * east + 3e-6, 0.9 * east - 2e-6, 0.1 * east + down + 1e-6
    assert Magnetometer(model, Mounting(), 1, SCENE).sample(0, State()).field == pytest.approx(expected)


def test_the_noise_of_a_magnetometer_grows_with_its_rate() -> None:
    fast = Magnetometer(MODEL._replace(rate=100.0, error_xy=ErrorModel(noise_density=1e-7)), Mounting(), 1, SCENE)
    assert pstdev(fast.sample(i, State()).field[0] for i in range(2000)) == pytest.approx(1e-6, rel=0.05)


def test_magnetometer_keys_are_read_and_checked() -> None:
    sensors = read_sensors({"magnetometer": {"hard_iron": [1e-6, 0, 0]}}, "a.toml: sensors")
    assert sensors["magnetometer"].model.hard_iron == (1e-6, 0.0, 0.0)
    for sections, message in (
        ({"magnetometer": {"soft_iron": [1.0]}}, "soft_iron: expected 9 values"),
        ([{"magnetometer": {}}], "expected a table for each sensor"),
        ({"magnetmeter": {}}, "no sensor 'magnetmeter'; did you mean 'magnetometer'"),
        ({"magnetometer": {"second": {}}}, "no key 'second'; one more magnetometer is a section of its own"),
    ):
        with pytest.raises(ConfigError, match=f"a.toml: sensors.*: {message}"):
            read_sensors(sections, "a.toml: sensors")
