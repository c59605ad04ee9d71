"""Level flight of all vehicle presets up to their top speed, or up to the limit in their file."""

import pytest

from tests.support.flights.level_flight import (
    FIELD,
    LEVEL,
    LIMITS,
    MAX_TILT,
    NAMES,
    OPEN,
    SWIMMERS,
    check_level,
    fly_level,
    top_speed,
)

LIMITED = [name for name in NAMES if LIMITS[name] is not None]


@pytest.mark.parametrize("share", [0.75, 1.0, 1.5])
@pytest.mark.parametrize("name", LEVEL)
def test_a_vehicle_stays_level_up_to_its_top_speed_among_obstacles(name: str, share: float) -> None:
    """The vehicle flies round the obstacles, also with commands above its top speed."""
    check_level(name, share)


@pytest.mark.parametrize("name", LEVEL)
def test_a_vehicle_stays_level_at_its_top_speed_in_open_water(name: str) -> None:
    check_level(name, 1.0, OPEN, 90.0)


@pytest.mark.parametrize("name", SWIMMERS)
def test_a_torpedo_stays_level_at_its_top_speed(name: str) -> None:
    """The torpedo is at its depth from the start; it trims and turns by its fins."""
    found = fly_level(name, top_speed(name), OPEN, 20.0)
    assert found.tilt < 20.0


@pytest.mark.parametrize("scenario", [FIELD, OPEN])
@pytest.mark.parametrize("name", LIMITED)
def test_a_vehicle_stays_level_up_to_the_speed_in_its_file(name: str, scenario: str) -> None:
    """The stated speed is exact to 0.05 m/s, together with the next test."""
    limit = LIMITS[name]
    assert limit is not None
    assert limit < top_speed(name)
    assert fly_level(name, limit, scenario, 150.0).tilt < MAX_TILT


@pytest.mark.parametrize("name", LIMITED)
def test_a_vehicle_tips_beyond_the_speed_in_its_file(name: str) -> None:
    limit = LIMITS[name]
    assert limit is not None
    assert fly_level(name, limit + 0.05, FIELD, 150.0).tilt > MAX_TILT


@pytest.mark.parametrize(("name", "published"), [("bluerov2", 1.5), ("bluerov2_heavy", 0.8)])
def test_recommended_vehicles_stay_level_at_their_published_speed(name: str, published: float) -> None:
    """The bluerov2 reaches its published 1.5 m/s, the heavy one the speed that its measured drag allows."""
    assert name in LEVEL
    assert top_speed(name) > published
