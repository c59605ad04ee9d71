"""The how-to pages about samples: their commands work when typed in order in an empty folder."""

from pathlib import Path

import pytest

from tests.support.followed import follow

# How many commands of a page are typed at least, so that a page that is skipped is noticed.
TYPED = {
    "docs/how-to/foxglove.md": 6,
    "docs/how-to/imaging.md": 5,
    "docs/how-to/live_view.md": 5,
    "docs/how-to/record.md": 6,
}


@pytest.mark.timeout(1200)
@pytest.mark.parametrize("page", list(TYPED), ids=lambda page: Path(page).stem)
def test_a_page_is_followed(page: str, tmp_path: Path) -> None:
    assert follow(page, tmp_path) >= TYPED[page]
