"""Every tutorial and how-to page does what it says, typed in order into an empty folder."""

from pathlib import Path

import pytest

from tests.support.followed import Follower, pages

# How many commands of a page are typed at least, so that a page that is skipped is noticed.
TYPED = {
    "docs/tutorials/first_flight.md": 1, "docs/tutorials/own_scenario.md": 5, "docs/tutorials/own_vehicle.md": 7,
    "docs/tutorials/own_planner.md": 4, "docs/tutorials/own_sensor.md": 5, "docs/tutorials/two_machines.md": 3,
    "docs/tutorials/real_stm32.md": 5, "docs/tutorials/ros2.md": 5, "docs/tutorials/own_board.md": 5,
    "docs/how-to/ardusub.md": 1, "docs/how-to/campaigns.md": 4, "docs/how-to/certificates.md": 6,
    "docs/how-to/charts.md": 0, "docs/how-to/continuous_integration.md": 5, "docs/how-to/control.md": 2,
    "docs/how-to/disturbances.md": 4, "docs/how-to/editor.md": 1, "docs/how-to/fleets.md": 3,
    "docs/how-to/foxglove.md": 4,
    "docs/how-to/imaging.md": 5, "docs/how-to/live_view.md": 5, "docs/how-to/matlab.md": 3,
    "docs/how-to/pixhawk.md": 0, "docs/how-to/px4.md": 0, "docs/how-to/qgroundcontrol.md": 4,
    "docs/how-to/record.md": 6, "docs/how-to/ros2.md": 0,
}  # fmt: skip


# Pages whose programs another test runs.
ELSEWHERE = {
    "docs/how-to/python.md": "tests/process/client/test_python_docs.py",
    "docs/how-to/install.md": "tests/system/boards/test_install_script.py",  # what CI's machine can install
}


@pytest.mark.timeout(1200)
@pytest.mark.parametrize("page", list(TYPED), ids=lambda page: Path(page).stem)
def test_a_page_is_followed(page: str, tmp_path: Path) -> None:
    with Follower(page, tmp_path) as follower:
        follower.follow()
        print(*(f"not typed: {line}: {reason}" for line, reason in follower.skipped), sep="\n")
        assert len(follower.steps) >= TYPED[page], [step.line for step in follower.steps]


def test_every_page_is_followed() -> None:
    assert set(pages()) == set(TYPED) | set(ELSEWHERE)
