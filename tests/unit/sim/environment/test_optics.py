"""The model of the optical effects of water on a picture, against numbers worked out by hand."""

from math import exp, sqrt
from typing import get_args

import numpy as np
import pytest

from hil.common.errors import ConfigError
from hil.common.schema import preset_folder
from hil.common.tables import read_table
from sim.environment import optics
from sim.environment.optics import CLEAR, Water, jaffe_mcglamery, jerlov, ray_lengths, underwater
from sim.sensors.imaging.camera.model import WaterType

WATER = Water((0.5, 0.2, 0.1), (0.4, 0.3, 0.05), (0.02, 0.1, 0.2))
TYPES = [name for name in get_args(WaterType) if name != "clear"]


def test_a_picture_has_the_values_worked_out_by_hand() -> None:
    """Each term of the equation counts on its own, for two pixels at 2 m and at 10 m."""
    picture, ways = np.array([[[0.8, 0.6, 0.4], [1.0, 0.5, 0.0]]]), np.array([[2.0, 10.0]])
    wet = underwater(picture, ways, WATER)
    for column, distance in enumerate((2.0, 10.0)):
        for channel in range(3):
            scene = picture[0, column, channel] * exp(-WATER.attenuation[channel] * distance)
            veil = WATER.veil[channel] * (1.0 - exp(-WATER.backscatter[channel] * distance))
            assert wet[0, column, channel] == pytest.approx(scene + veil, rel=1e-6)
    assert wet[0, 0, 0] == pytest.approx(0.8 * 0.36787944 + 0.02 * (1.0 - 0.44932896), rel=1e-6)


def test_jaffe_mcglamery_is_the_case_of_equal_coefficients() -> None:
    """The equation I = J e^-cz + B (1 - e^-cz) leaves a picture of the veil's own colour as it is."""
    water = jaffe_mcglamery((0.3, 0.2, 0.1), (0.1, 0.2, 0.3))
    assert water.attenuation == water.backscatter
    wet = underwater(np.full((4, 3), (0.1, 0.2, 0.3)), [0.0, 1.0, 7.0, 400.0], water)
    assert wet == pytest.approx(np.full((4, 3), (0.1, 0.2, 0.3)), abs=1e-6)
    assert underwater([[1.0, 1.0, 1.0]], [2.0], water)[0] == pytest.approx(
        [exp(-0.6) * 0.9 + 0.1, exp(-0.4) * 0.8 + 0.2, exp(-0.2) * 0.7 + 0.3], rel=1e-6
    )


@pytest.mark.parametrize("water", [WATER, CLEAR])
@pytest.mark.parametrize("no_range", [np.inf, np.nan])
def test_infinite_or_undefined_ranges_give_the_veiling_light(water: Water, no_range: float) -> None:
    wet = underwater([[0.9, 0.9, 0.9], [0.9, 0.9, 0.9]], [no_range, 0.0], water)
    assert wet[0] == pytest.approx(water.veil)
    assert wet[1] == pytest.approx([0.9, 0.9, 0.9])


def test_bytes_are_srgb_encoded() -> None:
    """Each of the 256 levels comes back as it was; between, the light counts and not the level."""
    levels = np.arange(256, dtype=np.uint8)
    grey = np.stack([levels] * 3, axis=-1)
    assert (underwater(grey, np.full(256, 3.0), CLEAR) == grey).all()
    half = jaffe_mcglamery((np.log(2.0),) * 3, (0.0, 0.0, 0.0))
    assert underwater(np.full((1, 3), 255, np.uint8), [1.0], half).tolist() == [[188, 188, 188]]  # IEC 61966-2-1: 0.5
    assert optics.decode(np.array([0, 188, 255], np.uint8)) == pytest.approx([0.0, 0.5029, 1.0], abs=1e-4)
    assert optics.encode(np.array([-1.0, 0.0, 2.0])).tolist() == [0, 0, 255]


def test_ray_lengths_follow_from_the_depths() -> None:
    lengths = ray_lengths(3, 2, 2.0, 4.0, 1.0, 1.0)
    assert lengths[0] == pytest.approx([sqrt(1.3125), sqrt(1.0625), sqrt(1.3125)])
    assert lengths[1] == pytest.approx([sqrt(1.25), 1.0, sqrt(1.25)])


def test_every_jerlov_type_can_be_named_by_a_camera() -> None:
    table = read_table(f"{preset_folder('sim/data')}/jerlov.toml")
    assert sorted(TYPES) == sorted(table["types"])
    for rows in table["types"].values():
        assert len(rows["daylight"]) == len(table["wavelength"]) == len(table["pure_water"])
    assert jerlov("clear") == CLEAR
    with pytest.raises(ConfigError, match=r"no water 'IC'.*1C"):
        jerlov("IC")


def test_coefficients_of_one_wavelength_are_those_of_the_water(monkeypatch: pytest.MonkeyPatch) -> None:
    """A camera of 650, 550 and 450 nm alone has a + b for both coefficients there, and the veil 0.3125 b E / c."""
    lines = {"red": (650.0, 0.1), "green": (550.0, 0.1), "blue": (450.0, 0.1)}
    monkeypatch.setattr(optics, "_SENSITIVITY", lines)
    water = jerlov("III", depth=2.0, distance=3.0, forward=0.0)
    beams = 0.340 + 0.001 + 0.737, 0.0565 + 0.003 + 0.998, 0.00922 + 0.022 + 1.413
    assert water.attenuation == pytest.approx(beams, rel=1e-9)
    assert water.backscatter == pytest.approx(beams, rel=1e-9)
    light = [exp(-2.0 * k) for k in (0.445, 0.12, 0.135)]
    assert water.light == pytest.approx(light)
    scattering = 0.737, 0.998, 1.413
    assert water.veil == pytest.approx([0.3125 * b / c * e for b, c, e in zip(scattering, beams, light, strict=True)])
    forward = jerlov("III", depth=2.0, distance=3.0, forward=0.5)
    assert forward.attenuation[1] == pytest.approx(0.0595 + 0.499)


def test_broad_colours_have_different_coefficients_for_scene_and_veil() -> None:
    """Akkaynak & Treibitz found that the two coefficients differ, and the scene's falls with range."""
    near, far = jerlov("I", distance=1.0), jerlov("I", distance=20.0)
    assert near.attenuation[0] > 1.2 * near.backscatter[0]
    assert near.attenuation[0] > 1.2 * far.attenuation[0]
    assert near.veil == far.veil
