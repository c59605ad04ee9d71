"""Uninstalling the service, and an installation that fails halfway: both leave all files unchanged."""

import os
import re
import resource
from pathlib import Path

import pytest

from hil.install.changes import MANIFEST
from hil.install.units import LIMITS, RULES, UNIT
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


def test_a_changed_unit_is_stopped_but_its_file_is_left(
    root: Path, scenario: str, executed: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    """The unit is stopped like the others. Its file stays, and is reported, until somebody removes it."""
    assert install(root, scenario, "--yes") == 0
    plant(root, UNIT[1:], "# mine\n")
    for _ in range(2):
        executed.clear()
        assert uninstall(root) == 0
        assert f"{UNIT}: changed since it was written; it is left there; remove it with: sudo rm {UNIT}" in (
            capsys.readouterr().out
        )
        assert executed[0] == "systemctl disable --now uuv-hil.service"
    (root / UNIT[1:]).unlink()
    assert uninstall(root) == 0
    assert not (root / MANIFEST[1:]).exists()
    assert uninstall(root) == 2
    assert "nothing is installed on this machine" in capsys.readouterr().err


def test_created_folders_are_removed(root: Path, scenario: str) -> None:
    (root / "etc/udev").mkdir()
    before = sorted(root.rglob("*"))
    for text in (CAN, SERIAL):
        Path(scenario).write_text(text)
        assert install(root, scenario, "--yes") == 0
    assert uninstall(root) == 0
    assert sorted(root.rglob("*")) == before


def test_a_file_in_another_encoding_is_restored(root: Path, scenario: str, capsys: pytest.CaptureFixture[str]) -> None:
    before = "# für uuv\r\nuuv - rtprio 10\r\n".encode("latin-1")
    plant(root, LIMITS[1:], "")
    (root / LIMITS[1:]).write_bytes(before)
    assert install(root, scenario, "--yes") == 0
    assert "-# f\ufffdr uuv" in capsys.readouterr().out
    assert b"memlock" in (root / LIMITS[1:]).read_bytes()
    assert uninstall(root) == 0
    assert (root / LIMITS[1:]).read_bytes() == before


def test_a_unit_that_is_masked_is_left_alone(root: Path, scenario: str, capsys: pytest.CaptureFixture[str]) -> None:
    link(root, UNIT[1:], "/dev/null")
    assert install(root, scenario, "--yes") == 2
    assert f"{UNIT}: is a link to /dev/null; remove it first" in capsys.readouterr().err
    assert (root / UNIT[1:]).is_symlink()


@pytest.mark.parametrize(
    ("folder", "reported"),
    [
        (f"{RULES}/", f"{RULES}: is not a regular file"),
        (f"{MANIFEST}/", f"{MANIFEST}: is not a regular file"),
        ("/etc/udev", f"/etc/udev: is not a folder, but {RULES} belongs into it"),
        ("/etc/uuv-hil", f"/etc/uuv-hil: is not a folder, but {MANIFEST} belongs into it"),
    ],
)
def test_a_file_in_place_of_a_folder_is_refused(
    root: Path, scenario: str, capsys: pytest.CaptureFixture[str], folder: str, reported: str
) -> None:
    plant(root, f"{folder[1:]}mine" if folder.endswith("/") else folder[1:], "")
    before = sorted(root.rglob("*"))
    assert install(root, scenario, "--yes") == 2
    assert re.fullmatch(rf"uuv-hil board: {reported}.*; remove it first\n", capsys.readouterr().err)
    assert sorted(root.rglob("*")) == before


@pytest.mark.parametrize(("size", "path"), [(100, MANIFEST), (1500, UNIT)])
def test_a_full_disk_leaves_every_file_unchanged(
    root: Path, scenario: str, capsys: pytest.CaptureFixture[str], size: int, path: str
) -> None:
    """The disk is full in the first file or in a later one, or the file size of the user is limited."""
    plant(root, LIMITS[1:], "uuv - rtprio 10\n")
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


@pytest.mark.parametrize("text", ["", "{", "null", "[]", '""', '{"a": 3}', '{"a": {}}', '{"a": {"sha256": 1}}'])
def test_a_damaged_manifest_is_reported(
    root: Path, scenario: str, capsys: pytest.CaptureFixture[str], text: str
) -> None:
    plant(root, MANIFEST[1:], text)
    for code in (install(root, scenario, "--yes"), uninstall(root)):
        assert code == 2
    assert capsys.readouterr().err.count(f"{MANIFEST}: is damaged; remove it, and the files") == 2


def test_owner_and_mode_of_a_replaced_file_are_restored(root: Path, scenario: str) -> None:
    """The manifest holds owner and mode, and can be read only by users who could read the file."""
    plant(root, LIMITS[1:], "uuv - rtprio 10\n")
    limits_file, manifest = root / LIMITS[1:], root / MANIFEST[1:]
    limits_file.chmod(0o600)
    if os.geteuid() == 0:
        os.chown(limits_file, 999, 998)
    before = limits_file.stat()
    assert install(root, scenario, "--yes") == 0
    assert (limits_file.stat().st_mode & 0o777, limits_file.stat().st_uid) == (0o644, os.geteuid())
    assert manifest.stat().st_mode & 0o777 == 0o600
    assert uninstall(root) == 0
    after = limits_file.stat()
    assert (after.st_mode, after.st_uid, after.st_gid) == (before.st_mode, before.st_uid, before.st_gid)
