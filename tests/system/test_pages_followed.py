"""Every tutorial does what it says, typed in order into an empty folder."""

from pathlib import Path

import pytest

from tests.support.followed import Follower, pages

# How many commands of a page are typed at least, so that a page that is skipped is noticed.
TYPED = {
    "docs/tutorials/first_flight.md": 1, "docs/tutorials/own_scenario.md": 5, "docs/tutorials/own_vehicle.md": 7,
    "docs/tutorials/own_planner.md": 4, "docs/tutorials/own_sensor.md": 5, "docs/tutorials/two_machines.md": 3,
    "docs/tutorials/real_stm32.md": 5, "docs/tutorials/ros2.md": 5, "docs/tutorials/own_board.md": 5,
}  # fmt: skip


@pytest.mark.timeout(1200)
@pytest.mark.parametrize("page", list(pages()), ids=lambda page: Path(page).stem)
def test_a_page_is_followed(page: str, tmp_path: Path) -> None:
    with Follower(page, tmp_path) as follower:
        follower.follow()
        assert len(follower.steps) >= TYPED.get(page, 0), [step.line for step in follower.steps]


def test_every_tutorial_is_followed() -> None:
    assert set(pages()) == set(TYPED)
