"""Uninstalling the service, and an installation that fails halfway: both leave all files unchanged."""

import re
import resource
from pathlib import Path

import pytest

from hil.install.units import FIREWALL, LIMITS, RULES, UNIT
from tests.support.boards.installed_service import CAN, SERIAL, executed, install, root, scenario, uninstall
from tests.support.boards.recorded import link, plant

__all__ = ["executed", "root", "scenario"]  # the fixtures


def test_units_are_stopped_before_their_files_are_removed(root: Path, scenario: str, executed: list[str]) -> None:
    Path(scenario).write_text(CAN)
    assert install(root, scenario, "--yes") == 0
    assert executed[:2] == ["systemctl daemon-reload", "systemctl enable uuv-hil-can.service uuv-hil.service"]
    executed.clear()
    Path(scenario).write_text(SERIAL)
    assert install(root, scenario, "--yes") == 0
    gone = "uuv-hil-can.service"
    assert executed[:2] == [f"systemctl disable --now {gone}", f"systemctl reset-failed {gone}"]
    assert "systemctl enable uuv-hil.service" in executed
    executed.clear()
    assert uninstall(root) == 0
    assert executed[:2] == ["systemctl disable --now uuv-hil.service", "systemctl reset-failed uuv-hil.service"]


def test_the_folder_of_the_firewall_is_removed(root: Path, scenario: str) -> None:
    before = sorted(root.rglob("*"))
    assert install(root, scenario, "--yes", "--listen", "tcp/0.0.0.0:7447") == 0
    assert (root / FIREWALL[1:]).exists()
    assert uninstall(root) == 0
    assert sorted(root.rglob("*")) == before


def test_a_unit_that_is_masked_is_left_alone(root: Path, scenario: str, capsys: pytest.CaptureFixture[str]) -> None:
    link(root, UNIT[1:], "/dev/null")
    assert install(root, scenario, "--yes") == 2
    assert f"{UNIT}: is a link to /dev/null; remove it first" in capsys.readouterr().err
    assert (root / UNIT[1:]).is_symlink()


@pytest.mark.parametrize(
    ("folder", "reported"),
    [
        (f"{RULES}/", f"{RULES}: was not written by `uuv-hil board install`"),
        ("/etc/uuv-hil", f"/etc/uuv-hil: is not a folder, but {FIREWALL} belongs into it"),
        (LIMITS, f"{LIMITS}: was not written by `uuv-hil board install`"),
    ],
)
def test_a_file_of_somebody_else_is_refused(
    root: Path, scenario: str, capsys: pytest.CaptureFixture[str], folder: str, reported: str
) -> None:
    plant(root, f"{folder[1:]}mine" if folder.endswith("/") else folder[1:], "")
    before = sorted(root.rglob("*"))
    assert install(root, scenario, "--yes", "--listen", "tcp/0.0.0.0:7447") == 2
    assert re.fullmatch(rf"uuv-hil board: {reported}.*; remove it first\n", capsys.readouterr().err)
    assert sorted(root.rglob("*")) == before


@pytest.mark.parametrize(("size", "path"), [(100, LIMITS), (1500, UNIT)])
def test_a_full_disk_leaves_every_file_unchanged(
    root: Path, scenario: str, capsys: pytest.CaptureFixture[str], size: int, path: str
) -> None:
    """The disk is full in the first file or in a later one, or the file size of the user is limited."""
    before = [(file, file.read_bytes() if file.is_file() else None) for file in sorted(root.rglob("*"))]
    _, hard = limit = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
    try:
        assert install(root, scenario, "--yes") == 3
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limit)
    assert capsys.readouterr().err.startswith(f"uuv-hil board: {path}: cannot be written: File too large; ")
    assert [(file, file.read_bytes() if file.is_file() else None) for file in sorted(root.rglob("*"))] == before
    assert uninstall(root) == 2
    assert "nothing is installed on this machine" in capsys.readouterr().err
