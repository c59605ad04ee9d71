"""The tutorials of boards, networks and other languages, as those of `test_tutorials`, beside which they run."""

from pathlib import Path

import pytest

from tests.support.followed import follow

# How many commands of a page are typed at least, so that a page that is skipped is noticed.
TYPED = {
    "docs/tutorials/zero_to_dive.md": 3,
    "docs/tutorials/matlab.md": 2,
    "docs/tutorials/two_machines.md": 3,
    "docs/tutorials/real_stm32.md": 9,
    "docs/tutorials/ros2.md": 5,
    "docs/tutorials/own_board.md": 5,
}


@pytest.mark.timeout(1200)
@pytest.mark.parametrize("page", list(TYPED), ids=lambda page: Path(page).stem)
def test_a_page_is_followed(page: str, tmp_path: Path) -> None:
    assert follow(page, tmp_path) >= TYPED[page]
