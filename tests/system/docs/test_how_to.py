"""The how-to pages: their commands work when typed in order in an empty folder. Every page is followed by a test."""

from pathlib import Path

import pytest

from tests.support.followed import follow, pages
from tests.system.docs import test_how_to_more, test_tutorials, test_tutorials_machines

# How many commands of a page are typed at least, so that a page that is skipped is noticed.
TYPED = {
    "docs/how-to/ardusub.md": 1,
    "docs/how-to/campaigns.md": 2,
    "docs/how-to/certificates.md": 6,
    "docs/how-to/charts.md": 0,
    "docs/how-to/cockpit.md": 0,
    "docs/how-to/continuous_integration.md": 5,
    "docs/how-to/control.md": 2,
    "docs/how-to/disturbances.md": 4,
    "docs/how-to/editor.md": 1,
}
# Pages whose programs another test runs.
ELSEWHERE = {
    "docs/how-to/blueos.md": "tests/unit/boards/test_container.py",
    "docs/how-to/ros2_bridge.md": "tests/system/ros/test_ros2_bridge.py",
    "docs/how-to/vehicle_computer.md": "tests/process/instruments/test_serving.py",  # names other computers
    "docs/how-to/python.md": "tests/system/docs/test_python_docs.py",
    "docs/how-to/rosbridge.md": "tests/system/gateways/test_rosbridge_clients.py",
    "docs/tutorials/ros1.md": "tests/system/gateways/test_ros1_debian.py",
    "docs/how-to/install.md": "tests/system/boards/test_install_script.py",  # what CI's machine can install
}


def test_every_page_is_followed_by_a_test() -> None:
    files = (test_how_to_more, test_tutorials, test_tutorials_machines)
    assert sorted(pages()) == sorted([*ELSEWHERE, *TYPED, *(page for file in files for page in file.TYPED)])


@pytest.mark.timeout(1200)
@pytest.mark.parametrize("page", list(TYPED), ids=lambda page: Path(page).stem)
def test_a_page_is_followed(page: str, tmp_path: Path) -> None:
    assert follow(page, tmp_path) >= TYPED[page]
