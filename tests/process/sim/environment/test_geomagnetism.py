"""The earth's magnetic field at the origin of a world, compared with the published test values of the model."""

import subprocess
import sys
from math import degrees

import pytest

from hil.common.errors import MissingExtraError
from sim.environment.geomagnetism import DEFAULT, field_at, field_of
from sim.environment.world import World
from sim.sensors.magnetometer import earth_field

POSITION = (54.005, 10.008)
SEA = World("sea", "test", (-100.0, 100.0, -100.0, 100.0), 20.0)

# WMM2025_TEST_VALUES.txt of NOAA's National Centers for Environmental Information and the British Geological Survey:
# year, altitude (km), latitude, longitude, declination, inclination (degrees), intensity (nT).
PUBLISHED = [
    (2025.0, 28, 89, -121, -99.77, 88.47, 56214.419888),
    (2025.0, 39, -59, -8, -15.75, -58.55, 28589.818346),
    (2025.0, 18, 0, 21, 1.29, -26.06, 32594.761714),
    (2025.5, 6, -36, -137, 20.28, -52.11, 41280.516301),
    (2025.5, 63, 26, 81, 0.51, 41.07, 46166.554053),
    (2026.5, 86, -11, 167, 10.24, -31.60, 38869.300019),
    (2027.0, 54, 54, 178, 0.63, 65.46, 49634.202547),
    (2027.0, 12, -63, 178, 57.87, -79.14, 62190.188377),
    (2029.0, 19, 46, -22, -5.65, 60.89, 46527.066578),
    (2029.5, 63, 88, 26, 36.52, 87.37, 55344.931586),
]


@pytest.mark.parametrize(("year", "height", "latitude", "longitude", "east", "down", "nanotesla"), PUBLISHED)
def test_published_test_values_are_met(
    year: float, height: float, latitude: float, longitude: float, east: float, down: float, nanotesla: float
) -> None:
    """The angles agree to the last digit, the intensity to 0.001 nT."""
    field = field_at(latitude, longitude, 1e3 * height, year)
    intensity, inclination, declination = field.angles
    assert intensity * 1e9 == pytest.approx(nanotesla, abs=1e-3)
    assert (degrees(declination), degrees(inclination)) == pytest.approx((east, down), abs=0.0051)
    assert field.year == year


def test_the_field_follows_from_the_origin_unless_it_is_given() -> None:
    """The field is that of the middle of the model's years, so that runs repeat; a value in the file overrides it."""
    field = field_at(*POSITION, altitude=40.0)
    assert (field.model, field.year) == ("WMM-2025", 2027.5)
    world = SEA._replace(origin=POSITION, origin_altitude=40.0)
    assert field_of(world) == field.angles != DEFAULT
    north, east, down = earth_field(world)
    assert (north**2 + east**2 + down**2) ** 0.5 == pytest.approx(field.angles[0])
    assert east > 0.0  # the compass points to the east of north in Holstein
    given = (50e-6, 1.1, 0.25)
    assert field_of(world._replace(magnetic_field=given)) == given
    assert field_of(SEA) == DEFAULT


def test_a_world_without_field_and_model_names_the_remedy(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pygeomag", None)
    assert field_of(SEA) == DEFAULT
    with pytest.raises(MissingExtraError) as caught:
        field_of(SEA._replace(origin=POSITION))
    assert str(caught.value) == (
        "sea: has an origin, but no magnetic_field: give it there, or else the World Magnetic Model needs "
        "pygeomag: pip install 'uuv-hil[chart]'"
    )


def test_a_board_with_a_field_in_its_world_needs_no_model() -> None:
    code = (
        "import sys; from sim.sensors.magnetometer import earth_field; from sim.environment.world import World\n"
        "earth_field(World('sea', 'test', (-1.0, 1.0, -1.0, 1.0), 9.0, origin=(54.0, 10.0),"
        " magnetic_field=(5e-5, 1.0, 0.1))); print('pygeomag' in sys.modules)"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=120)
    assert run.stdout == "False\n"
