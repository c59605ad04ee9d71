"""The figure of the modems: its curves agree with messages through the channels."""

import pytest

from sim.modems.acoustic import AcousticModem
from sim.modems.optical import OpticalModem
from tools.pages import modem_figure

SIGMA = 0.025  # of a share of 400 messages at its widest


@pytest.mark.parametrize("distance", [1980.0, 2060.0, 2120.0])
def test_acoustic_messages_are_lost_as_the_curve_shows(distance: float) -> None:
    modem = AcousticModem(source_level=140.0)
    snr, lost = modem_figure.by_sound(modem, distance)
    assert 0.2 < lost < 0.9
    assert modem_figure.lost_by_sound(modem, distance) == pytest.approx(lost, abs=3.5 * SIGMA)
    assert snr < modem_figure.by_sound(modem._replace(wind=0.0), distance)[0]


@pytest.mark.parametrize("distance", [20.4, 20.8, 21.2])
def test_optical_messages_are_lost_as_the_curve_shows(distance: float) -> None:
    _, lost = modem_figure.by_light(OpticalModem(), distance)
    assert 0.1 < lost < 0.9
    assert modem_figure.lost_by_light(OpticalModem(), distance) == pytest.approx(lost, abs=3.5 * SIGMA)
