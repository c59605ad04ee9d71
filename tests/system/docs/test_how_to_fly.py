"""The how-to pages about flights: their commands work when typed in order in an empty folder."""

from pathlib import Path

import pytest

from tests.support.followed import follow

# How many commands of a page are typed at least, so that a page that is skipped is noticed.
TYPED = {
    "docs/how-to/campaigns.md": 4,
    "docs/how-to/charts.md": 0,
    "docs/how-to/continuous_integration.md": 5,
    "docs/how-to/control.md": 2,
    "docs/how-to/disturbances.md": 4,
    "docs/how-to/editor.md": 1,
    "docs/how-to/fleets.md": 3,
    "docs/how-to/gazebo.md": 5,
}


@pytest.mark.timeout(1200)
@pytest.mark.parametrize("page", list(TYPED), ids=lambda page: Path(page).stem)
def test_a_page_is_followed(page: str, tmp_path: Path) -> None:
    assert follow(page, tmp_path) >= TYPED[page]
