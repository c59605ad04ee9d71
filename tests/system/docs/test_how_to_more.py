"""The how-to pages from F on, as those of `test_how_to`, beside which they run."""

from pathlib import Path

import pytest

from tests.support.followed import follow

# How many commands of a page are typed at least, so that a page that is skipped is noticed.
TYPED = {
    "docs/how-to/fleets.md": 3,
    "docs/how-to/foxglove.md": 6,
    "docs/how-to/gazebo.md": 5,
    "docs/how-to/imaging.md": 5,
    "docs/how-to/live_view.md": 5,
    "docs/how-to/matlab.md": 3,
    "docs/how-to/pixhawk.md": 0,
    "docs/how-to/plugins.md": 0,
    "docs/how-to/px4.md": 0,
    "docs/how-to/qgroundcontrol.md": 4,
    "docs/how-to/record.md": 6,
    "docs/how-to/ros2.md": 0,
}


@pytest.mark.timeout(1200)
@pytest.mark.parametrize("page", list(TYPED), ids=lambda page: Path(page).stem)
def test_a_page_is_followed(page: str, tmp_path: Path) -> None:
    assert follow(page, tmp_path) >= TYPED[page]
