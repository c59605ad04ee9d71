"""Any content of a file that a person writes: it is read, or refused in lines that name the file."""

import importlib
import math
import operator
import os
import re
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from boards import load_board
from hil.cli import main
from hil.common import tables
from hil.common.errors import ConfigError
from hil.common.schema import find_preset, preset_folder, preset_names
from hil.common.tables import read_table
from hil.links.frame.protocol import FrameProtocol
from hil.scenario.config import load_scenario
from sim.environment.world import load_world
from sim.vehicle.vehicle import load_vehicle

BAD_VALUES: list[Any] = [
    [], {}, [[]], [{}], [1], True, "", "x", "-1 s", "nan m", "1e400 s", math.nan, math.inf, -math.inf, -1, 0, 1e308,
    -1e308, 10**400, -(10**400), 2**63, [math.nan] * 3, [1e308] * 6, {"x": {}},
]  # fmt: skip
READERS: dict[str, Callable[[str], Any]] = {
    "hil/scenario/presets": load_scenario,
    "sim/vehicles": load_vehicle,
    "sim/worlds": load_world,
    "firmware_stub/frames": lambda name: FrameProtocol(find_preset("firmware_stub/frames", name)),
    "boards": load_board,
}


@pytest.fixture(autouse=True)
def use_own_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))


def key_paths(table: Any, so_far: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Yield the path of keys to every value in a table."""
    items = table.items() if isinstance(table, dict) else enumerate(table) if isinstance(table, list) else ()
    for key, value in items:
        yield (*so_far, key)
        yield from key_paths(value, (*so_far, key))


def copy(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: copy(item) for key, item in value.items()}
    return [copy(item) for item in value] if isinstance(value, list) else value


def change_value(table: Any, key_path: tuple[Any, ...], value: Any) -> Any:
    table = copy(table)
    inner = table
    for key in key_path[:-1]:
        inner = inner[key]
    inner[key_path[-1]] = value
    return table


PRESETS = [(folder, name) for folder in READERS for name in preset_names(folder)]


@pytest.mark.parametrize(("folder", "name"), PRESETS, ids=lambda text: text.rpartition("/")[2])
def test_a_wrong_value_of_any_key_is_refused_by_its_key(
    folder: str, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A preset's value, replaced by an invalid one, is accepted as meant, or refused by file and key."""
    path = os.path.join(preset_folder(folder), f"{name}.toml")
    table, read = read_table(path), tables.read_table
    failures: list[Any] = []
    compiled: dict[Any, Any] = {}  # the stored frames, by path
    monkeypatch.setattr("hil.links.frame.protocol._compiled", compiled)

    def read_changed(requested: str) -> dict[str, Any]:
        return copy(failures[0]) if requested == path else read(requested)

    for module in (
        "hil.common.schema",
        "hil.scenario.config",
        "sim.vehicle.vehicle",
        "sim.environment.world",
        "sim.sensors.sensor_set",
        "boards",
    ):
        monkeypatch.setattr(f"{module}.read_table", read_changed)
    first = PRESETS.index((folder, name))
    for number, key_path in enumerate(key_paths(table), first):  # each with a different one of them
        value = BAD_VALUES[number % len(BAD_VALUES)]
        failures[:] = [change_value(table, key_path, value)]
        compiled.clear()
        output = path
        try:
            READERS[folder](name)
        except ConfigError as error:
            output = str(error)
        except Exception as error:
            raise AssertionError(f"{key_path} = {value!r:.60}: {type(error).__name__}: {error}") from error
        for line in output.splitlines():
            assert path in line or re.fullmatch(r"and \d+ more", line), f"{key_path} = {value!r:.60}: {line}"


def write_scenario(folder: Path, data: bytes) -> str:
    path = folder / "odd.toml"
    path.write_bytes(data)
    return str(path)


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"a = " + b"[" * 100_000 + b"]" * 100_000, "32 deep"),
        (b"a = " + b"[" * 40 + b"]" * 40, "32 deep"),
        (b"a = " + b"{a = " * 100_000, "deep|valid TOML"),
        (b".".join([b"a"] * 100_000) + b" = 1", "32 deep"),
        (b"[" + b".".join([b"a"] * 5_000) + b"]", "32 deep"),
        (b"a = " + b"9" * 100_000, "not valid TOML"),
        (b"a = 1e" + b"9" * 100_000 + b"x", "not valid TOML"),
        ("a = 1".encode("utf-16"), "UTF-16; save it as UTF-8"),
        (b"\xff\xff", "is not UTF-8 text"),
        (b"\x00" * 100, "not valid TOML"),
        (b"a = 1\r", "not valid TOML"),
    ],
)
def test_invalid_toml_is_refused_with_the_file(tmp_path: Path, data: bytes, message: str) -> None:
    path = write_scenario(tmp_path, data)
    with pytest.raises(ConfigError, match=message) as error:
        read_table(path)
    assert str(error.value).startswith(path)
    assert len(str(error.value)) < len(path) + 200


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("seed = " + "9" * 5_000, "not valid TOML"), ("seed = " + "9" * 4_000, "seed: a number of hundreds of digits"),
        ("seed = 1" + "0" * 100_000, "not valid TOML"), ("x = " + "[" * 100_000 + "]" * 100_000, "32 deep"),
        ('[sensors.laser]\nkind = []', "sensors: laser"), ("[sensors]\nlaser = []", "sensors: laser"),
        ("[[force]]\nclass = []", "force"), ("[[force]]\nclass = 1", "force"), ("[modem]\nkind = []", "modem"),
    ],
    ids=lambda text: text[:20],
)  # fmt: skip
def test_a_hostile_scenario_is_refused_in_one_line(
    line: str, message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(f'vehicle = "paper_six"\nworld = "pool"\n{line}\n[master]\ngoal = [1, 1]\n', encoding="utf-8")
    for command in (["sim", "--fast"], ["slave"], ["campaign"]):
        assert main([command[0], str(path), *command[1:]]) == 2
        (output,) = capsys.readouterr().err.splitlines()
        assert f"{path}: " in output
        assert message in output
        assert len(output) < len(str(path)) + 250


def test_a_byte_order_mark_is_ignored(tmp_path: Path) -> None:
    assert read_table(write_scenario(tmp_path, b"\xef\xbb\xbfa = 1\n")) == {"a": 1}


def test_pipes_devices_folders_and_oversized_files_are_refused(tmp_path: Path) -> None:
    pipe, zero, huge = tmp_path / "pipe.toml", tmp_path / "zero.toml", tmp_path / "huge.toml"
    os.mkfifo(pipe)
    zero.symlink_to("/dev/zero")
    with huge.open("wb") as file:
        file.truncate(1 << 40)
    start = time.monotonic()
    for path, message in (
        (pipe, "no regular file"), (zero, "no regular file"), (huge, "at most 16 MiB"), (tmp_path, "is a folder"),
        (tmp_path / ("x" * 300), "File name too long"), (Path("a\0b"), "cannot be read"),
    ):  # fmt: skip
        with pytest.raises(ConfigError, match=message):
            read_table(str(path))
    assert time.monotonic() - start < 60.0, "it waited"


@pytest.mark.parametrize(
    ("ending", "reader"),
    [
        ("urdf", "sim.vehicle.urdf.text:read_xml"), ("xacro", "sim.vehicle.urdf.text:read_xml"),
        ("json", "hil.bench.record:load"),
        ("yaml", "hil.autonomy.paths.occupancy:OccupancyGrid.read"),
    ],
)  # fmt: skip
def test_no_reader_blocks_on_a_pipe_or_reads_an_oversized_file(ending: str, reader: str, tmp_path: Path) -> None:
    module, _, names = reader.partition(":")
    read = operator.attrgetter(names)(importlib.import_module(module))
    pipe, huge = tmp_path / f"pipe.{ending}", tmp_path / f"huge.{ending}"
    os.mkfifo(pipe)
    with huge.open("wb") as file:
        file.truncate(1 << 40)
    for path, words in ((pipe, "no regular file"), (huge, "has 1048576 MiB; such a file has at most")):
        with pytest.raises(ConfigError, match=words):
            read(str(path))


@pytest.mark.parametrize(
    ("ending", "reader"),
    [
        ("000", "hil.charts.sources.s57:read_cell"), ("tif", "hil.charts.sources.rasters:open_raster"),
        ("mcap", "hil.recording.reader:recording_files"),
    ],
)  # fmt: skip
def test_no_reader_of_large_files_blocks_on_a_pipe(ending: str, reader: str, tmp_path: Path) -> None:
    module, _, name = reader.partition(":")
    os.mkfifo(tmp_path / f"pipe.{ending}")
    with pytest.raises(ConfigError, match="no regular file"):
        getattr(importlib.import_module(module), name)(str(tmp_path / f"pipe.{ending}"))
