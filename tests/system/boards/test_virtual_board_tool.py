"""The tool for virtual boards, without a board: command line, scripts, image and emulator options."""

import os
import signal
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

from tests.support.processes import ROOT, wait_for
from tools.virtual_board import system
from tools.virtual_board.board import VirtualBoard
from tools.virtual_board.commands import TO_BOOT
from tools.virtual_board.image import write_image
from tools.virtual_board.system import Booted


@pytest.fixture
def empty(tmp_path: Path) -> VirtualBoard:
    """Provide almost empty folders of a board."""
    board = VirtualBoard(str(tmp_path / "a board"))
    for path in ("root/usr/bin", "root/usr/share/base-passwd", "modules/usr/lib/modules", "site"):
        os.makedirs(os.path.join(board.folder, path))
    for name in ("usr/bin/python3.11", "usr/share/base-passwd/passwd.master", "usr/share/base-passwd/group.master"):
        (Path(board.root) / name).touch()
    return board


def test_files_in_the_image_have_their_modification_time(empty: VirtualBoard, tmp_path: Path) -> None:
    """Bytecode is used only if its recorded time is that of its source (PEP 552)."""
    source = Path(empty.site) / "module.py"
    source.touch()
    os.utime(source, (1_700_000_000, 1_700_000_000))
    write_image(empty, str(tmp_path / "image"))
    record = (tmp_path / "image").read_bytes().partition(b"opt/uuv-hil/module.py\0")[0][-110:]
    assert int(record[6 + 5 * 8 :][:8], 16) == 1_700_000_000


@pytest.mark.skipif(os.geteuid() != 0, reason="only root builds and boots a board")
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_no_process_or_file_outlives_an_ended_board(empty: VirtualBoard, tmp_path: Path, number: int) -> None:
    """The emulator reports its process number, and then runs for a minute."""
    os.makedirs(os.path.join(empty.root, "boot"))
    (Path(empty.root) / "boot" / "vmlinuz").touch()
    Path(empty.python).touch()
    programs, scratch = tmp_path / "programs", tmp_path / "scratch"
    programs.mkdir()
    scratch.mkdir()
    for name in TO_BOOT:
        (programs / name).write_text('#!/bin/sh\necho $$ >"$TMPDIR"/emulator\nexec sleep 60\n')
        (programs / name).chmod(0o755)
    environment = os.environ | {"PATH": f"{programs}:{os.environ['PATH']}", "TMPDIR": str(scratch)}
    command = [sys.executable, "-m", "tools.virtual_board", "boot", "--folder", empty.folder, "--", "true"]
    with subprocess.Popen(command, cwd=ROOT, env=environment) as process:
        output = wait_for(lambda: (scratch / "emulator").exists() and (scratch / "emulator").read_text().strip())
        assert output
        assert len(list(scratch.glob("uuv-hil-scratch-*"))) == 1
        process.send_signal(number)
        assert process.wait(60) == 130
    assert not Path(f"/proc/{output}").exists()
    assert not list(scratch.glob("uuv-hil-scratch-*"))


def test_a_board_that_cannot_be_booted_leaves_no_files(
    empty: VirtualBoard, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    Path(empty.python).touch()
    monkeypatch.setattr(system, "missing", lambda _: "")
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    with pytest.raises(FileNotFoundError, match="boot"):
        Booted(empty, "true")
    assert not list(tmp_path.glob("uuv-hil-scratch-*"))
