"""GPS: geodesy, fixes at the surface only, acquisition and errors."""

from math import isnan, radians

import pytest

from hil.common.errors import ConfigError
from sim.dynamics import State
from sim.environment.ocean import Ocean, Waves
from sim.environment.world import World
from sim.geodesy import TangentPlane, earth_centred, geodetic
from sim.rotations import from_euler
from sim.sensors.gps import Gps, GpsModel
from sim.sensors.mounting import Mounting
from tests.support.fitted import EXACT, scene

MODEL = GpsModel(acquisition=0.0, horizontal=EXACT, vertical=EXACT)
ORIGIN = (57.7, 11.9)
SEA = World("sea", "test", (-100.0, 100.0, -100.0, 100.0), 20.0, origin=ORIGIN, origin_altitude=36.2)
SCENE = scene(SEA)
S = 1_000_000_000


# --- the earth

# Origin (deg, deg, m), place (NED, m), and that place as PROJ 9.5.1 has it (topocentric, then cart, inverse, WGS84).
PROJ = [
    ((57.7, 11.9, 36.2), (1000.0, -2000.0, 30.0), (57.708974429763394, 11.866449656856558, 6.591175411827862)),
    ((57.7, 11.9, 36.2), (3.0, 4.0, -2.0), (57.70002693648956, 11.90006708380619, 38.20000195596367)),
    ((-33.9, 151.3, 20.0), (1000.0, -2000.0, 30.0), (-33.89098262279403, 151.27837896195504, -9.608079967088997)),
    ((-33.9, 151.3, 20.0), (-5e4, 8e4, 4e3), (-34.347938405864596, 152.16998518106232, -3281.741399866529)),
    ((0.0, 0.0, 0.0), (1000.0, -2000.0, 30.0), (0.009043737071537956, -0.017966389599660054, -29.60750585142523)),
    ((71.1, -179.9999, 0.0), (1e3, -2e3, 30.0), (71.10895438162791, 179.94477522534845, -29.60915513895452)),
    ((89.9999, 10.0, 5.0), (1000.0, -2000.0, 30.0), (89.98002485101229, -106.30849703398988, -24.60934868361801)),
]


@pytest.mark.parametrize(("origin", "position", "expected"), PROJ)
def test_geodetic_positions_equal_those_of_proj(
    origin: tuple[float, float, float], position: tuple[float, float, float], expected: tuple[float, float, float]
) -> None:
    latitude, longitude, altitude = TangentPlane(*origin).geodetic(position)
    assert latitude == pytest.approx(expected[0], abs=2e-12)
    assert longitude == pytest.approx(expected[1], abs=2e-12)
    assert altitude == pytest.approx(expected[2], abs=1e-6)


@pytest.mark.parametrize("latitude", [-90.0, -60.0, -1e-9, 0.0, 12.3, 45.0, 89.99999, 90.0])
@pytest.mark.parametrize("altitude", [-11_000.0, 0.0, 9000.0])
def test_geodetic_coordinates_survive_a_round_trip(latitude: float, altitude: float) -> None:
    computed = geodetic(*earth_centred(latitude, 33.3, altitude))
    assert computed[0] == pytest.approx(latitude, abs=1e-13)
    assert computed[2] == pytest.approx(altitude, abs=5e-9)
    if abs(latitude) < 90.0:
        assert computed[1] == pytest.approx(33.3, abs=1e-8)


# --- the receiver


def test_a_fix_at_the_surface_is_exact_without_errors() -> None:
    """The place is that of the antenna, 0.5 m above the origin of a vehicle that rolls to its side."""
    gps = Gps(MODEL, Mounting((0.0, 0.0, -0.5)), 1, SCENE)
    sample = gps.sample(5, State((3.0, 4.0, 0.2)))
    assert sample.fix
    assert sample[:4] == pytest.approx((5, *TangentPlane(*ORIGIN, 36.2).geodetic((3.0, 4.0, -0.3))), rel=1e-14)
    on_its_side = State((3.0, 4.0, -0.1), from_euler(radians(90), 0.0, 0.0))
    latitude, longitude, altitude = TangentPlane(*ORIGIN, 36.2).geodetic((3.0, 4.5, -0.1))
    assert gps.sample(5, on_its_side)[1:4] == pytest.approx((latitude, longitude, altitude), rel=1e-14)
    with pytest.raises(ConfigError, match="does not say where on the earth it is"):
        Gps(MODEL, Mounting(), 1, scene())


def test_there_is_no_fix_under_water() -> None:
    gps = Gps(MODEL, Mounting((0.0, 0.0, -0.5)), 1, SCENE)
    for depth in (0.5, 0.6, 10.0):
        sample = gps.sample(1, State((0.0, 0.0, depth)))
        assert not sample.fix
        assert all(map(isnan, sample[1:4]))


def test_a_fix_takes_its_acquisition_time_after_each_dive() -> None:
    gps = Gps(MODEL._replace(acquisition=3.0), Mounting(), 1, SCENE)
    depths = [5.0, -0.1, -0.1, -0.1, -0.1, -0.1, 0.1, -0.1, -0.1, -0.1, -0.1]
    fixes = [gps.sample(i * S, State((0.0, 0.0, depth))).fix for i, depth in enumerate(depths)]
    assert fixes == [False, False, False, False, True, True, False, False, False, False, True]


def test_waves_over_the_antenna_interrupt_the_fix() -> None:
    """A long swell of 2 m over an antenna 0.3 m above the mean surface leaves fixes while the surface is lower."""
    ocean = Ocean(waves=Waves(2.0, 8.0, components=1))
    rough = scene(SEA._replace(ocean=ocean))
    gps, wave_field = Gps(MODEL, Mounting(), 1, rough), rough.wave_field
    assert wave_field is not None
    fixes = [gps.sample(i * S // 10, State((7.0, -3.0, -0.3))).fix for i in range(200)]
    assert fixes == [wave_field.elevation(i / 10.0, 7.0, -3.0) < 0.3 for i in range(200)]
    assert 20 < sum(fixes) < 180
