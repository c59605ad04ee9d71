"""The tutorials: their commands work when typed in order in an empty folder."""

from pathlib import Path

import pytest

from tests.support.followed import follow

# How many commands of a page are typed at least, so that a page that is skipped is noticed.
TYPED = {
    "docs/tutorials/first_flight.md": 1,
    "docs/tutorials/own_scenario.md": 5,
    "docs/tutorials/own_vehicle.md": 7,
    "docs/tutorials/own_planner.md": 4,
    "docs/tutorials/own_sensor.md": 5,
}


@pytest.mark.timeout(1200)
@pytest.mark.parametrize("page", list(TYPED), ids=lambda page: Path(page).stem)
def test_a_page_is_followed(page: str, tmp_path: Path) -> None:
    assert follow(page, tmp_path) >= TYPED[page]
