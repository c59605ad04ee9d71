"""Pictures for the page: photographs, echoes of a forward sonar, the waterfall of a side scan."""

from io import BytesIO

import numpy as np
import pytest
from PIL import Image

from hil.ros.images import Picture
from hil.view.panels import pictures
from sim.sensors.imaging.samples import SideScanSample, SonarImageSample

PING = SideScanSample(1, 3, 0.1, 4e5, 1500.0, 0.01, 0.8, 2.0, "uint8", bytes((10, 20, 255)), bytes((1, 2, 3)))


def test_a_side_scan_scrolls() -> None:
    waterfall = pictures.Waterfall()
    assert waterfall.add(PING)
    assert not waterfall.add(PING)
    assert waterfall.add(PING._replace(time_ns=2, port=bytes(3), starboard=bytes(3)))
    picture = waterfall.picture()
    assert picture.shape == (pictures.WATERFALL, 6)
    assert picture[0].sum() == 0, "the newest on top"
    assert picture[1, 0] == 255, "port on the left, farthest outside"


def test_a_side_scan_scrolls_by_the_distance_travelled() -> None:
    """The pings are 1 m apart in bins of 10 cm: ten rows from one to the next, and between them a slope, no brick."""
    waterfall = pictures.Waterfall()
    for number in range(4):
        level = bytes([60 * number] * 3)
        assert waterfall.add(PING._replace(time_ns=number + 1, port=level, starboard=level), (float(number), 0.0, 5.0))
    grey = waterfall.picture()[:, 0].astype(int)
    assert (np.diff(grey[:31]) <= 0).all()
    assert np.abs(np.diff(grey[:31])).max() < 30
    assert (grey[40:] == 0).all()


def test_a_sonar_keeps_ranges_as_rows_and_beams_as_columns() -> None:
    echoes = np.zeros((100, 65), np.uint8)
    echoes[48:56, 40:48] = 255
    beams = tuple(np.linspace(-1.0, 1.0, 65))
    sample = SonarImageSample(1, beams, 100, 0.5, 0.1, 7e5, 1500.0, 0.02, 0.3, "uint8", echoes.tobytes())
    encoded = pictures.sonar_picture(sample)
    shown = np.asarray(Image.open(BytesIO(encoded.data)))
    assert shown.shape == (100, 65)
    assert np.abs(shown.astype(int) - echoes).mean() < 3.0
    assert (encoded.header["first"], encoded.header["step"], encoded.header["bins"]) == (0.5, 0.1, 100)


def test_camera_pictures_are_passed_on_and_malformed_ones_ignored() -> None:
    raw = Picture(1, 2, 1, "rgb8", bytes((1, 2, 3, 4, 5, 6)))
    encoded = pictures.camera_picture(raw)
    assert encoded
    assert (encoded.header["width"], encoded.header["height"]) == (2, 1)
    again = pictures.camera_picture(raw._replace(encoding="jpeg", data=encoded.data))
    assert again
    assert (again.data, again.header["type"]) == (encoded.data, "image/jpeg")
    for broken in (raw._replace(data=b"12"), Picture(1, 0, 0, "jpeg", b"no picture")):
        assert pictures.camera_picture(broken) is None


@pytest.mark.parametrize("encoding", ["uint8", "float32"])
def test_true_intensities_are_shown_too(encoding: str) -> None:
    kind = np.uint8 if encoding == "uint8" else np.float32
    echoes = np.full((4, 3), 200, kind)
    sample = SonarImageSample(1, (-0.1, 0.0, 0.1), 4, 0.0, 1.0, 7e5, 1500.0, 0.02, 0.3, encoding, echoes.tobytes())  # type: ignore[arg-type]
    assert np.asarray(Image.open(BytesIO(pictures.sonar_picture(sample).data))).min() > 190
