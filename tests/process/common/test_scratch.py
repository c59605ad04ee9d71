"""Temporary folders: removed at the end, or at the next start after a kill."""

import os
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

from hil.common.children import ROOT
from hil.common.scratch import PREFIX, ScratchFolder
from hil.common.tables import cache_path, read_table


def killed(base: Path, extra_code: str = "") -> str:
    """Return the folder of a process that was killed while it had one."""
    code = "import os; from hil.common.scratch import ScratchFolder\n"
    code += f"f = ScratchFolder('test', {str(base)!r}); print(f.path)\n"
    code += f"open(f.file('kept.toml'), 'w').write('a = 1')\n{extra_code}"
    code += "import sys; sys.stdout.flush(); os.kill(os.getpid(), 9)"
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == -9, done.stderr
    return done.stdout.strip()


def test_a_scratch_folder_is_private_and_removed_at_the_end(tmp_path: Path) -> None:
    with ScratchFolder("test", str(tmp_path)) as folder:
        assert Path(folder.path).stat().st_mode & 0o777 == 0o700
        Path(folder.file("a")).write_text("")
        assert os.path.basename(folder.path).startswith(f"{PREFIX}test-")
    assert not list(tmp_path.iterdir())
    folder.close()


def test_a_scratch_folder_is_removed_where_folders_cannot_be_locked(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "platform", "win32")
    with ScratchFolder("test", str(tmp_path)) as folder, ScratchFolder("test", str(tmp_path)):
        assert Path(folder.path).is_dir()
    folder.close()
    assert not any(tmp_path.iterdir())


def test_the_folder_of_a_killed_process_is_removed_by_the_next(tmp_path: Path) -> None:
    left = killed(tmp_path)
    assert os.path.exists(left)
    with ScratchFolder("other", str(tmp_path)) as folder:
        assert list(tmp_path.iterdir()) == [Path(folder.path)]


def test_cached_files_of_a_removed_folder_are_removed_too(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    left = killed(tmp_path, "from hil.common.tables import read_table; read_table(f.file('kept.toml'))\n")
    neighbour = tmp_path / "beside.toml"
    neighbour.write_text("a = 1")
    read_table(str(neighbour))
    assert os.path.exists(cache_path(f"{left}/kept.toml"))
    ScratchFolder("other", str(tmp_path)).close()
    assert os.listdir(tmp_path / "cache/uuv-hil") == [os.path.basename(cache_path(str(neighbour)))]


def test_folders_in_use_and_of_other_users_stay(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "mine").mkdir()
    (tmp_path / f"{PREFIX}link").symlink_to(tmp_path / "mine")
    (tmp_path / f"{PREFIX}file").write_text("")
    with ScratchFolder("one", str(tmp_path)) as one, ScratchFolder("two", str(tmp_path)):
        assert os.path.exists(one.path)
    outsider = tmp_path / f"{PREFIX}outsider"
    outsider.mkdir()
    with monkeypatch.context() as patch:
        patch.setattr(os, "geteuid", lambda: outsider.stat().st_uid + 1)
        ScratchFolder("three", str(tmp_path)).close()
    assert {path.name for path in tmp_path.iterdir()} == {
        "mine", f"{PREFIX}link", f"{PREFIX}file", f"{PREFIX}outsider"
    }  # fmt: skip


def test_a_folder_removed_by_another_process_before_it_is_locked_is_made_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Another process may remove it as abandoned between its creation and its locking."""
    import fcntl

    real = fcntl.flock
    begun: list[bool] = []
    other_folders: list[ScratchFolder] = []

    def lock_late(descriptor: int, operation: int) -> None:
        if operation == fcntl.LOCK_EX and not begun:
            begun.append(True)
            other_folders.append(ScratchFolder("other", str(tmp_path)))
        real(descriptor, operation)

    monkeypatch.setattr(fcntl, "flock", lock_late)
    with ScratchFolder("test", str(tmp_path)) as folder:
        assert {folder.path, other_folders[0].path} == {str(path) for path in tmp_path.iterdir()}
    other_folders[0].close()
    assert not list(tmp_path.iterdir())


def test_a_folder_removed_by_another_process_before_it_is_opened_is_made_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Another process may remove it as abandoned between its creation and its opening."""
    real = tempfile.mkdtemp
    other_folders: list[ScratchFolder] = []

    def make(prefix: str, dir: str) -> str:  # noqa: A002
        folder = real(prefix=prefix, dir=dir)
        if not other_folders:
            monkeypatch.setattr(tempfile, "mkdtemp", real)
            other_folders.append(ScratchFolder("other", str(tmp_path)))
            assert not os.path.exists(folder)
        return folder

    monkeypatch.setattr(tempfile, "mkdtemp", make)
    with ScratchFolder("test", str(tmp_path)) as folder:
        assert {folder.path, other_folders[0].path} == {str(path) for path in tmp_path.iterdir()}
    other_folders[0].close()
