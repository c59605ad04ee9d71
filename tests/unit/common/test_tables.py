"""The cache of parsed TOML files: used when valid, and never when the file has changed."""

import os
import sys
from pathlib import Path

import pytest

from hil.common import tables
from hil.common.errors import ConfigError
from hil.common.tables import cache_path, output_file, read_table


@pytest.fixture(autouse=True)
def use_own_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "a.toml"
    path.write_text("a = 1\n")
    return path


def test_the_second_read_uses_the_cache(file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert read_table(str(file)) == {"a": 1}
    monkeypatch.setitem(sys.modules, "tomllib" if sys.version_info >= (3, 11) else "tomli", None)
    assert read_table(str(file)) == {"a": 1}


@pytest.mark.parametrize(("max_count", "most_bytes"), [(10, 1 << 20), (1000, 600)], ids=["number", "size"])
def test_the_oldest_cached_tables_are_removed_beyond_the_limits(
    max_count: int, most_bytes: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tables, "MAX_CACHED", max_count)
    monkeypatch.setattr(tables, "MAX_CACHED_BYTES", most_bytes)
    program = Path(cache_path("x")).parent / f"{tables.PROGRAM}-abc"
    program.parent.mkdir(parents=True)
    program.write_bytes(b"x" * 1000)
    for number in range(40):
        path = tmp_path / f"{number}.toml"
        path.write_text(f"a = {number}\n")
        read_table(str(path))
        os.utime(cache_path(str(path)), (number, number))
        cached = [file for file in program.parent.iterdir() if file != program]
        assert len(cached) <= max_count
        assert sum(file.stat().st_size for file in cached) <= most_bytes
    assert Path(cache_path(str(tmp_path / "39.toml"))).exists(), "the newest"
    assert not Path(cache_path(str(tmp_path / "0.toml"))).exists(), "the oldest"
    assert program.exists(), "the compiled parser is not a cached table"


def test_large_files_are_not_cached(tmp_path: Path) -> None:
    path = tmp_path / "large.toml"
    path.write_text(f"a = '{'x' * tables.LARGEST_CACHED}'\n")
    read_table(str(path))
    assert not Path(cache_path(str(path))).exists()


def test_a_changed_file_is_read_again(file: Path) -> None:
    read_table(str(file))
    before = file.stat()
    file.write_text("a = 2\n")
    os.utime(file, ns=(before.st_atime_ns, before.st_mtime_ns + 1))
    assert read_table(str(file)) == {"a": 2}


@pytest.mark.parametrize("damage", [b"", b"\xff", b"i\x01\x00\x00\x00", b"(\x00\x00\x00\x00"])
def test_a_damaged_cache_entry_is_not_used(file: Path, damage: bytes) -> None:
    read_table(str(file))
    Path(cache_path(str(file))).write_bytes(damage)
    assert read_table(str(file)) == {"a": 1}


@pytest.mark.skipif(os.getuid() != 0, reason="only root can give a file away")
def test_a_cache_entry_of_another_user_is_not_used(file: Path) -> None:
    read_table(str(file))
    copy = Path(cache_path(str(file)))
    os.chown(copy, 12345, 12345)
    copy.write_bytes(copy.read_bytes().replace(b"a", b"b", 1))
    assert read_table(str(file)) == {"a": 1}


def test_files_that_cannot_be_cached_are_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    dated = tmp_path / "dated.toml"
    dated.write_text("day = 2026-01-01\n")
    assert read_table(str(dated))["day"].year == 2026
    monkeypatch.setenv("XDG_CACHE_HOME", "/proc/nowhere")
    dated.write_text("a = 3\n")
    assert read_table(str(dated)) == {"a": 3}


def test_a_deleted_file_is_reported_although_cached(file: Path) -> None:
    read_table(str(file))
    file.unlink()
    with pytest.raises(ConfigError, match="no such file"):
        read_table(str(file))


# -- files that are written --------------------------------------------------------------------------------------------


def test_checking_an_output_file_leaves_no_file_behind(tmp_path: Path) -> None:
    cache = tmp_path / "there.json"
    cache.write_text("earlier")
    assert [output_file(str(path)) for path in (tmp_path / "new.json", cache)]
    assert cache.read_text() == "earlier"
    assert not (tmp_path / "new.json").exists()


@pytest.mark.parametrize(
    ("output_path", "reason"),
    [
        ("folder", "Is a directory"),
        ("nowhere/a.json", "there is no folder FOLDER/nowhere"),
        ("nowhere/more/a.json", "there is no folder FOLDER/nowhere/more"),
        ("file/a.json", "FOLDER/file is a file"),
        ("pipe.json", "it is a pipe"),
        ("a\0b", "a zero byte is in its name"),
    ],
)
def test_an_output_that_cannot_be_written_is_refused(tmp_path: Path, output_path: str, reason: str) -> None:
    """The output is refused at once, also a pipe that nobody reads; and no folder is made."""
    (tmp_path / "folder").mkdir()
    (tmp_path / "file").write_text("")
    os.mkfifo(tmp_path / "pipe.json")
    before = set(tmp_path.iterdir())
    with pytest.raises(ConfigError) as error:
        output_file(str(tmp_path / output_path))
    reason = reason.replace("FOLDER", str(tmp_path))
    assert f"cannot be written: {reason}; name a file in a folder of yours" in str(error.value)
    assert set(tmp_path.iterdir()) == before


def test_a_pipe_with_a_reader_is_accepted_as_output() -> None:
    """The pipe may be `>(gzip > flight.csv.gz)` of a shell, or /dev/stdout."""
    reader, writer = os.pipe()
    try:
        assert output_file(f"/proc/self/fd/{writer}")
        assert output_file("/dev/null")
    finally:
        os.close(reader)
        os.close(writer)
