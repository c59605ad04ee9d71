"""The tool for virtual boards, without a board: command line, scripts, image and emulator options."""

import os
import signal
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

from boards.emulation import MARK
from hil.common.errors import DeviceError
from tests.support.processes import ROOT, wait_for
from tools.virtual_board import __main__ as tool
from tools.virtual_board import system
from tools.virtual_board.board import VirtualBoard, replace_interpreters, write_wrapper
from tools.virtual_board.commands import TO_BOOT
from tools.virtual_board.image import write_image
from tools.virtual_board.system import Booted, emulator


def documented() -> list[list[str]]:
    """Return the words of each example in the tool's help, as a shell splits them."""
    start = "    python -m tools.virtual_board "
    lines = [line.removeprefix(start) for line in (tool.__doc__ or "").splitlines() if line.startswith(start)]
    shells = [["sh", "-c", f"printf '%s\\n' {line}"] for line in lines]
    return [subprocess.run(shell, capture_output=True, text=True, check=True).stdout.splitlines() for shell in shells]


def test_the_documented_examples_are_parsed() -> None:
    options = [tool.parse(words) for words in documented()]
    assert [one.verb for one in options] == ["build", "run", "run", "python", "boot"]
    assert [one.arguments for one in options] == [
        [],
        ["slave", "paper_field"],
        ["bench", "startup", "--repeat", "3"],
        ["-c", "import platform; print(platform.machine())"],
        ["ip link; uuv-hil doctor"],
    ]
    assert options[0].package == ["numpy"]
    assert options[-1].port == ["7447:7447"]


def test_words_after_the_dashes_are_passed_on_unchanged() -> None:
    words = ["-m", "x", "--", "--port"]
    assert tool.parse(["python", "--folder", "here", "--", *words]).arguments == words


LONG = "'''exec' '/a long/python' \"$0\" \"$@\"\n' '''\nimport sys\n"  # for the shell, and text to Python


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("#!/home/me/.venv/bin/python3\nimport sys\n", "#!/usr/bin/python3\nimport sys\n"),
        (f"#!/bin/sh\n{LONG}", f"#!/usr/bin/python3\n{LONG}"),
        ("#!/bin/sh\necho no Python\n", "#!/bin/sh\necho no Python\n"),
        ("\x7fELF", "\x7fELF"),
    ],
)
def test_scripts_of_pip_start_the_python_of_the_board(tmp_path: Path, text: str, expected: str) -> None:
    path = tmp_path / "uuv-hil"
    path.write_text(text)
    path.chmod(0o755)
    replace_interpreters(str(tmp_path))
    assert path.read_text() == expected
    assert path.stat().st_mode & 0o777 == 0o755


@pytest.fixture
def empty(tmp_path: Path) -> VirtualBoard:
    """Provide almost empty folders of a board."""
    board = VirtualBoard(str(tmp_path / "a board"))
    for path in ("root/usr/bin", "root/usr/share/base-passwd", "modules/usr/lib/modules", "site"):
        os.makedirs(os.path.join(board.folder, path))
    for name in ("usr/bin/python3.11", "usr/share/base-passwd/passwd.master", "usr/share/base-passwd/group.master"):
        (Path(board.root) / name).touch()
    return board


def test_the_wrapper_runs_the_emulator_with_all_arguments(
    empty: VirtualBoard, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The tool passes itself, its files, the mark and the arguments to the emulator unchanged."""
    with pytest.raises(DeviceError, match="virtual_board build"):
        empty.command()
    write_wrapper(empty)
    fake = tmp_path / "qemu-aarch64"
    fake.write_text(f'#!/bin/sh\nprintf "%s\\n" "$@" "$PYTHONPATH" "${MARK}" "$MINE"\n')
    fake.chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}:{os.environ['PATH']}")
    output = subprocess.run(empty.command("-c", "print( 1 )", MINE="a b"), capture_output=True, text=True, check=True)
    assert output.stdout.splitlines() == [
        "-cpu", "cortex-a72", "-L", empty.root, "-0", empty.python, f"{empty.root}/usr/bin/python3.11",
        "-c", "print( 1 )", empty.site, "qemu-aarch64", "a b",
    ]  # fmt: skip


def test_files_in_the_image_have_their_modification_time(empty: VirtualBoard, tmp_path: Path) -> None:
    """Bytecode is used only if its recorded time is that of its source (PEP 552)."""
    source = Path(empty.site) / "module.py"
    source.touch()
    os.utime(source, (1_700_000_000, 1_700_000_000))
    write_image(empty, str(tmp_path / "image"))
    record = (tmp_path / "image").read_bytes().partition(b"opt/uuv-hil/module.py\0")[0][-110:]
    assert int(record[6 + 5 * 8 :][:8], 16) == 1_700_000_000


def test_the_kernel_command_line_marks_emulation() -> None:
    words = emulator("vmlinuz", "image", {7447: 7448})
    assert f"{MARK}=qemu-system-aarch64" in words[words.index("-append") + 1].split()
    assert "user,id=net,hostfwd=tcp:127.0.0.1:7447-:7448" in words


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


def test_a_missing_board_is_reported_with_the_command_to_build_it(tmp_path: Path) -> None:
    with pytest.raises(DeviceError, match="virtual_board build"):
        VirtualBoard(str(tmp_path)).command("-c", "")


def test_the_image_has_the_pam_files_for_sessions_of_other_users(empty: VirtualBoard, tmp_path: Path) -> None:
    """PAM refuses every session while an included file is missing; `uuv-hil doctor --user` needs one."""
    write_image(empty, str(tmp_path / "image"))
    image = (tmp_path / "image").read_bytes()
    for kind in ("auth", "account", "password", "session"):
        assert f"etc/pam.d/common-{kind}\0".encode() in image
