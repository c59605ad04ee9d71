"""Vehicles fly level under their own controller as fast as they go, or their file says up to which speed."""

import pytest

from tests.support.flights.level_flight import (
    FIELD,
    LEVEL,
    LIMITS,
    MOST_TILT,
    NAMES,
    OPEN,
    SWIMMERS,
    check_level,
    fly_level,
    top_speed,
)

TIPPING = [name for name in NAMES if LIMITS[name] is not None]


@pytest.mark.parametrize("share", [0.75, 1.0, 1.5])
@pytest.mark.parametrize("name", LEVEL)
def test_it_is_level_up_to_its_top_speed_in_the_field(name: str, share: float) -> None:
    """The vehicle flies round the obstacles, also where it is commanded more than it can do."""
    check_level(name, share)


@pytest.mark.parametrize("name", LEVEL)
def test_it_is_level_at_its_top_speed_in_open_water(name: str) -> None:
    check_level(name, 1.0, OPEN, 90.0)


@pytest.mark.parametrize("name", SWIMMERS)
def test_a_torpedo_keeps_its_attitude_at_its_top_speed(name: str) -> None:
    """The torpedo is at its depth from the start; it trims and turns by its fins."""
    found = fly_level(name, top_speed(name), OPEN, 20.0)
    assert found.tilt < 20.0


@pytest.mark.parametrize("scenario", [FIELD, OPEN])
@pytest.mark.parametrize("name", TIPPING)
def test_the_file_says_up_to_which_speed_a_published_set_is_level(name: str, scenario: str) -> None:
    """The stated speed holds to 0.05 m/s on either side: no warning is invented, and none is missing."""
    limit = LIMITS[name]
    assert limit is not None
    assert limit < top_speed(name)
    assert fly_level(name, limit, scenario, 150.0).tilt < MOST_TILT


@pytest.mark.parametrize("name", TIPPING)
def test_beyond_that_speed_it_is_not(name: str) -> None:
    limit = LIMITS[name]
    assert limit is not None
    assert fly_level(name, limit + 0.05, FIELD, 150.0).tilt > MOST_TILT


@pytest.mark.parametrize(("name", "published"), [("bluerov2", 1.5), ("bluerov2_heavy", 0.8)])
def test_the_recommended_ones_are_not_among_those_that_tip(name: str, published: float) -> None:
    """The bluerov2 flies at its published 1.5 m/s, the heavy one as fast as its drag from a tank lets it."""
    assert name in LEVEL
    assert top_speed(name) > published
