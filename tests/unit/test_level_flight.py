"""Vehicles that can stop and turn fly level at their top speed; tests/system/sim/test_level_flight.py has more."""

import pytest

from tests.support.flights.level_flight import LEVEL, check_level


@pytest.mark.parametrize("name", LEVEL)
def test_a_vehicle_is_level_at_its_top_speed(name: str) -> None:
    check_level(name, 1.0)
