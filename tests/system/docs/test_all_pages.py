"""Every tutorial and how-to page is followed by a test."""

from tests.support.followed import pages
from tests.system.docs import (
    test_how_to_connect,
    test_how_to_fly,
    test_how_to_look,
    test_tutorials,
    test_tutorials_of_machines,
)

FOLLOWING = test_tutorials, test_tutorials_of_machines, test_how_to_fly, test_how_to_look, test_how_to_connect
# Pages whose programs another test runs.
ELSEWHERE = {
    "docs/how-to/python.md": "tests/system/docs/test_python_docs.py",
    "docs/how-to/rosbridge.md": "tests/system/gateways/test_rosbridge_clients.py",
    "docs/tutorials/ros1.md": "tests/system/gateways/test_ros1_debian.py",
    "docs/how-to/install.md": "tests/system/boards/test_install_script.py",  # what CI's machine can install
}


def test_every_page_is_followed_by_a_test() -> None:
    assert sorted(pages()) == sorted([*ELSEWHERE, *(page for module in FOLLOWING for page in module.TYPED)])
